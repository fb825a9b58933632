"""Sails that are held: clamped, on springs, under a tension of their own, in gravity, shaken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.optimize import brentq
from scipy.special import jn_zeros, jv

from beamrider.io.files import InputError
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.strains import strains
from dynamics.sail.held import area_slopes, rim_lengths, supports
from dynamics.sail.mesh import sail_mesh
from tests.membranes import FILM, dark, film, steps

RADIUS, STIFFNESS, AREAL = 0.5, FILM["young_Pa"] * FILM["thickness_m"], FILM["density_kg_m3"] * FILM["thickness_m"]
DARK = {"emissivity_front": 0.0, "emissivity_back": 0.0}
MIRROR = {**DARK, "absorptance": 0.0, "reflectance": 1.0, "conductivity_W_mK": 0.0}


def hencky(poisson: float) -> tuple[float, float]:
    """w₀/(a (p a/(E h))^⅓), and the stress in the middle over (E p² a²/h²)^⅓/4, of a clamped disc under a load p.

    N = ¼ (E h p² a²)^⅓ b(ρ) with b² (b″ + 3 b′/ρ) = −8, as a power series; no radial displacement at the rim (Hencky,
    Z. Math. Phys. 63 (1915) 311; Fichter, NASA TP-3658 (1997)).
    """

    def series(first: float) -> list[float]:
        b = [first]
        for n in range(1, 40):
            square = polynomial.polymul(b, b)[:n]
            rest = sum(square[n - 1 - m] * 4 * (m + 1) * (m + 2) * b[m + 1] for m in range(n - 1))
            b.append(((-8.0 if n == 1 else 0.0) - rest) / (square[0] * 4 * n * (n + 1)))
        return b

    def rim(first: float) -> float:
        return sum((2 * n + 1 - poisson) * b for n, b in enumerate(series(first)))

    first = brentq(rim, 1.55, 2.2, xtol=1e-14)
    r, weight = np.polynomial.legendre.leggauss(60)
    r, weight = 0.5 * (r + 1.0), 0.5 * weight
    slope = 2.0 * r / polynomial.polyval(r**2, series(first))  # −dw/dρ = p a² ρ/(2 N)
    return float(weight @ slope), first


def test_hencky_coefficients_are_the_published_ones():
    """b₀ and the deflection of Fichter's table for ν = 0.2, 0.3, 0.4."""
    assert [round(hencky(nu)[1], 3) for nu in (0.2, 0.3, 0.4)] == [1.683, 1.724, 1.777]
    assert hencky(0.3)[0] == pytest.approx(0.6534, abs=2e-4)


def at_rest(rings: int, held: dict[str, Any], **groups: Any) -> Flight:
    """A held sail that has come to rest."""
    flight, end, _ = fly(dark(rings=rings, held=held, **groups), {})
    assert end.reason == "at_rest"
    return flight


def bulged(rings: int, load: float, light: bool) -> float:
    """Deflection in the middle over Hencky's of a clamped sail under a load in units of E h/a: gravity, or light."""
    pressure = load * STIFFNESS / RADIUS
    held = {"rim": "clamped", "drag_1_s": 600.0, "rest_speed_m_s": 1e-7}
    flight = {"duration_s": 1.0, "snapshot_every_s": 5e-3}
    if light:
        beam = {"intensity_W_m2": pressure * LIGHT_SPEED / 2.0, "radius_m": 1e3, "on_s": 10.0}
        held_sail = at_rest(rings, held, flight=flight, beam=beam, sail={"sectors": film(**MIRROR)})
    else:
        held["gravity_m_s2"] = [0.0, 0.0, pressure / AREAL]
        held_sail = at_rest(rings, held, flight=flight)
    return float(held_sail.state.x[2, 0] / (hencky(FILM["poisson"])[0] * RADIUS * load ** (1.0 / 3.0)))


@pytest.mark.parametrize("light", [False, True])
def test_a_clamped_disc_bulges_as_hencky_says(light: bool):
    """Within 2e-3 of the series when extrapolated from two meshes; the slopes, 0.03 at the rim, leave 1e-3."""
    coarse, fine = bulged(6, 1e-6, light), bulged(12, 1e-6, light)
    assert abs(fine - 1.0) < 0.01
    assert fine + (fine - coarse) / 3.0 == pytest.approx(1.0, abs=2e-3)


def test_a_tensioned_disc_hangs_through_as_the_linear_membrane():
    """w₀ = q a²/(4N) (Timoshenko & Woinowsky-Krieger, Theory of Plates and Shells, §97), as the mesh gets finer."""
    tension, gravity = 10.0, 5.0
    held = {
        "rim": "clamped",
        "tension_N_m": tension,
        "gravity_m_s2": [0.0, 0.0, -gravity],
        "drag_1_s": 600.0,
        "rest_speed_m_s": 1e-8,
    }
    found = [
        -at_rest(rings, held, flight={"duration_s": 1.0, "snapshot_every_s": 5e-3}).state.x[2, 0] for rings in (6, 12)
    ]
    want = AREAL * gravity * RADIUS**2 / (4.0 * tension)
    assert found[1] + (found[1] - found[0]) / 3.0 == pytest.approx(want, rel=1e-3)


def drum(folder: Path, rings: int, diameters: int, circle: int, tension: float = 10.0) -> float:
    """Frequency of a clamped drum's mode over that of the closed form, j_{m,n}/a √(N/χ)."""
    flight = Flight(dark(rings=rings, held={"rim": "clamped", "tension_N_m": tension}), {}, folder)
    wave = jn_zeros(diameters, circle)[-1] / RADIUS
    x, y, _ = flight.model.rest
    shape = jv(diameters, wave * np.hypot(x, y)) * np.cos(diameters * np.arctan2(y, x))
    shape[supports(flight.membrane.scene.held, flight.membrane.mesh).fixed] = 0.0
    flight.state.x[2] = 1e-6 * RADIUS * shape
    omega, found = wave * np.sqrt(tension / AREAL), []
    stride = round(0.3 / (omega * flight.model.dt))
    for k in range(24):
        steps(flight, stride, fresh=k == 0)
        found.append(float(flight.model.masses * shape @ flight.state.x[2]))
    p = np.array(found)
    cosine = (p[2:] + p[:-2]) @ p[1:-1] / (2.0 * p[1:-1] @ p[1:-1])
    return float(np.arccos(cosine) / (stride * flight.model.dt) / omega)


@pytest.mark.parametrize(("diameters", "circle"), [(0, 1), (1, 1), (2, 1), (0, 2)])
def test_frequencies_of_a_clamped_drum(tmp_path: Path, diameters: int, circle: int):
    """Rayleigh, Theory of Sound, §206; second order in the mesh."""
    coarse, fine = drum(tmp_path, 6, diameters, circle), drum(tmp_path, 12, diameters, circle)
    assert fine + (fine - coarse) / 3.0 == pytest.approx(1.0, abs=2e-3)


def test_a_pad_on_springs_moves_by_the_force_of_the_light_over_their_stiffness():
    spring, tension = 50.0, 3.0
    held = {
        "rim": "springs",
        "rim_stiffness_N_m2": spring,
        "tension_N_m": tension,
        "drag_1_s": 500.0,
        "rest_speed_m_s": 1e-10,
    }
    beam = {"intensity_W_m2": 1e7, "radius_m": 0.3, "on_s": 10.0}
    scene = dark(
        rings=6,
        held=held,
        beam=beam,
        sail={"sectors": film(**MIRROR)},
        flight={"duration_s": 2.0, "snapshot_every_s": 5e-3},
    )
    flight, end, columns = fly(scene, {})
    assert end.reason == "at_rest"
    lengths = rim_lengths(flight.membrane.mesh)
    pull = spring * lengths @ flight.state.x[2]
    assert pull == pytest.approx(columns["force"][-1, 2], rel=1e-6)
    assert columns["force"][-1, 2] > 1e-3


def test_a_tension_of_its_own_keeps_a_sail_on_springs_where_it_is():
    """The springs' constant pull balances the tension on the mesh: at rest from the start, whatever its size."""
    held = {"rim": "springs", "rim_stiffness_N_m2": 1e3, "tension_N_m": 40.0}
    scene = dark(rings=4, held=held, flight={"duration_s": 2e-4})
    flight, _, columns = fly(scene, {})
    assert np.abs(flight.state.x - flight.model.rest).max() < 1e-13
    strain = 40.0 * (1.0 - FILM["poisson"]) / STIFFNESS
    assert columns["strain_max"][-1] == pytest.approx(strain, rel=2.0 * strain)
    assert columns["strain_min"][-1] == pytest.approx(columns["strain_max"][-1], rel=1e-9)


def test_a_single_held_node_carries_the_sail():
    """A film that hangs on a spring at its middle: the spring bears its weight."""
    held = {
        "parts": [{"at_m": [0.0, 0.0], "stiffness_N_m": 5.0}],
        "gravity_m_s2": [0.0, 9.81, 0.0],
        "drag_1_s": 150.0,
        "rest_speed_m_s": 1e-7,
    }
    held_sail = at_rest(4, held, flight={"duration_s": 1.0, "snapshot_every_s": 1e-3})
    mass = held_sail.model.masses.sum()
    assert 5.0 * held_sail.state.x[1, 0] == pytest.approx(9.81 * mass, rel=1e-4)


@pytest.mark.parametrize("damping", [0.0, 1e-7])
def test_held_nodes_stay_to_the_bit(damping: float):
    """So they do in a film that damps its motion, which moves them with forces of its own."""
    held = {"parts": [{"at_m": [0.2, 0.1], "radius_m": 0.1}, {"at_m": [-0.3, 0.0]}], "gravity_m_s2": [3.0, 1.0, 100.0]}
    scene = dark(
        rings=5,
        held={**held, "rim": "clamped"},
        sail={"sectors": film(**DARK, damping_s=damping)},
        release={"offset_m": [0.1, 0.0], "pitch_deg": 3.0},
        flight={"duration_s": 1e-3},
    )
    flight, _, _ = fly(scene, {})
    fixed = supports(scene.held, flight.membrane.mesh).fixed
    assert 30 < fixed.size < 50
    start = Flight(scene, {}, flight.journal.folder).state.x
    assert np.array_equal(flight.state.x[:, fixed], start[:, fixed])
    assert np.ptp(flight.state.x[2] - start[2]) > 1e-6


def test_shaking_moves_what_is_free():
    """ẍ = −a sin(ωt + φ) from rest; the step that ends at t = 0 has half a kick of what begins then.

    Over whole periods velocity Verlet's drift errs by (ωΔt)²/12 of it: x(t + Δt) − 2x + x(t − Δt) = Δt² ẍ turns 1/ω²
    into Δt²/(2 − 2 cos ωΔt) (Hairer, Lubich & Wanner, Geometric Numerical Integration, §I.5).
    """
    for degrees in (0.0, 30.0):
        shaking = {"acceleration_m_s2": [0.0, 7.0, 20.0], "frequency_Hz": 100.0, "phase_deg": degrees}
        flight, _, columns = fly(dark(rings=2, held={"shaking": shaking}, flight={"duration_s": 2e-2}), {})
        t, omega, phase = columns["time"][-1], 2.0 * np.pi * 100.0, np.radians(degrees)
        want = (np.sin(omega * t + phase) - np.sin(phase)) / omega**2 - t * np.cos(phase) / omega
        want -= 0.5 * flight.model.dt * np.sin(phase) * t
        want *= 1.0 - (omega * flight.model.dt) ** 2 / 12.0
        assert columns["position"][-1] == pytest.approx(np.array([0.0, 7.0, 20.0]) * want, rel=1e-6)


def test_drag_takes_up_what_gravity_gives():
    """Speed g/γ (1 − exp(−γt)); velocity Verlet takes the drag of the step before, γΔt of it."""
    gravity, rate = np.array([0.0, -4.0, 9.0]), 500.0
    flight, _, columns = fly(
        dark(rings=2, held={"gravity_m_s2": gravity.tolist(), "drag_1_s": rate}, flight={"duration_s": 4e-3}), {}
    )
    lasted = columns["time"][-1] + flight.model.release * flight.model.dt
    want = gravity / rate * (1.0 - np.exp(-rate * lasted))
    assert columns["velocity"][-1] == pytest.approx(want, rel=rate * flight.model.dt)


def rippled(folder: Path, share: float) -> tuple[Flight, float]:
    """A clamped square film of one ripple z, lit from below, under a tension N = N₀ + P z; the share of dx N' − P dz.

    N₀: this share of P times the depth of the deepest triangle's middle. Columns of nodes are set so far apart that the
    Green strain of each triangle is that of its tension.
    """
    sail = {"outline": "square", "rotation_deg": 0.0, "sectors": film(**MIRROR)}
    beam = {"intensity_W_m2": 1e12, "radius_m": 1e4, "on_s": 10.0}
    flight = Flight(dark(rings=8, held={"rim": "clamped"}, beam=beam, sail=sail), {}, folder)
    flight.step, x, pressure = flight.model.release + 8, flight.state.x, 2.0 * 1e12 / LIGHT_SPEED
    columns, which = np.unique(np.round(x[0], 9), return_inverse=True)
    apart = np.diff(columns)
    z = 1e-4 * np.sin(np.pi * columns / RADIUS)
    middle = 0.5 * (z[1:] + z[:-1])
    tension = pressure * (middle - share * middle.min())
    # Of the second Piola-Kirchhoff stress h Y/(1 − ν²) E: the tension is (1 + E) of it
    strain = 0.5 * (np.sqrt(1.0 + 4.0 * tension * (1.0 - FILM["poisson"] ** 2) / STIFFNESS) - 1.0)
    width = np.sqrt(apart**2 * (1.0 + 2.0 * strain) - np.diff(z) ** 2)
    flight.state.x[0], flight.state.x[2] = np.append(0.0, np.cumsum(width))[which], z[which]
    steps(flight, 0)
    rest = np.abs(flight.model.rest)
    # In the corners' own fields every node has three triangles on either side
    inner = (rest[:2].min(axis=0) > 0.5 * apart[0]) & (rest[:2].max(axis=0) < RADIUS - 0.5 * apart[0])
    load = pressure * np.gradient(z)[which][inner] * apart[0]
    left = flight.work.acceleration[0, inner] * flight.model.masses[inner]
    return flight, float(np.abs(left).max() / np.abs(load).max())


@pytest.mark.parametrize(("share", "goes_slack"), [(1.02, False), (0.98, True)])
def test_a_rippled_film_is_taut_above_its_critical_tension(tmp_path: Path, share: float, goes_slack: bool):
    """N₀ = P A, P = 2I/c, for a ripple of amplitude A: below it the troughs are under pressure.

    Light pushes a mirror of small slope z' sideways by −P z' an area: the membrane's balance N' = P z' (Timoshenko &
    Woinowsky-Krieger, Theory of Plates and Shells, §90) makes its tension N₀ + P z. Slopes of 6e-4 leave 1e-6.
    """
    flight, left = rippled(tmp_path, share)
    assert left < 2e-6
    _, slack = strains(flight.membrane, flight.state.x.T, np.full(flight.state.x.shape[1], 300.0))
    assert slack is not None
    assert bool(slack.any()) == goes_slack
    deep = flight.state.x[2][flight.membrane.mesh.triangles].mean(axis=1)
    assert np.all(deep[slack > 0.0] < -0.9e-4)


def test_a_clamped_film_goes_slack_where_heat_takes_its_tension():
    """At ΔT = N (1 − ν)/(E h α), where the smaller principal stress vanishes: a membrane wrinkles (Mansfield, §8)."""
    tension, edge = 10.0, 10.0 * (1.0 - FILM["poisson"]) / (STIFFNESS * FILM["expansion_1_K"])
    for share, slack in ((0.99, 0.0), (1.01, 1.0)):
        scene = dark(
            rings=3,
            held={"rim": "clamped", "tension_N_m": tension},
            effects={"expansion": True, "emission": True},
            flight={"start_temperature_K": 300.0 + share * edge, "duration_s": 1e-5, "heat_every": 1},
        )
        flight, _, _ = fly(scene, {})
        _, found = strains(flight.membrane, flight.state.x.T, flight.state.temperature)
        assert found is not None
        assert np.all(found == slack)


def test_area_slopes_are_those_of_the_area():
    mesh = sail_mesh(dark(rings=3, sail={"profile": "paraboloid", "depth": 0.5}).sail)
    change = 1e-6 * np.random.default_rng(1).standard_normal(mesh.nodes.shape)
    x = [(mesh.nodes + s * change)[mesh.triangles] for s in (-1.0, 1.0)]
    areas = [0.5 * np.linalg.norm(np.cross(y[:, 1] - y[:, 0], y[:, 2] - y[:, 0]), axis=1).sum() for y in x]
    assert (areas[1] - areas[0]) / 2.0 == pytest.approx(float(np.sum(area_slopes(mesh) * change)), rel=1e-6)


@pytest.mark.parametrize(
    ("held", "groups", "said"),
    [
        ({"rim": "springs"}, {}, "rim_stiffness_N_m2: must be given"),
        ({"tension_N_m": 1.0}, {}, "tension_N_m = 1: needs rim"),
        ({"rim": "clamped"}, {"release": {"spin_Hz": 10.0}}, "spin_Hz = 10: must be 0"),
    ],
)
def test_what_makes_no_sense_is_refused(held: dict[str, Any], groups: dict[str, Any], said: str):
    with pytest.raises(ValueError, match=said):
        dark(held=held, **groups)


@pytest.mark.parametrize(
    ("held", "flight", "said"),
    [
        ({"rim": "clamped", "tension_N_m": 1e5}, {}, "held.tension_N_m = 100000: must be below"),
        ({"rim": "clamped", "tension_N_m": 1.0}, {"stiffness": "lattice"}, "must be triangles with held.tension_N_m"),
        ({"rim": "clamped"}, {"integrator": "corotating"}, "must be verlet or semi_implicit_euler with held"),
        ({"drag_1_s": 1e9}, {}, "held.drag_1_s = 1e\\+09: must be at most"),
    ],
)
def test_what_the_schemes_cannot_fly_is_refused(
    tmp_path: Path, held: dict[str, Any], flight: dict[str, Any], said: str
):
    with pytest.raises(InputError, match=said):
        Flight(dark(held=held, flight=flight), {}, tmp_path)
