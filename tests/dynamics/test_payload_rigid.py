"""Point masses on tethers to rigid sails: closed forms, conserved quantities, and the linear model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from beamrider.io.files import InputError
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.rigid.body import rigid_body
from dynamics.rigid.stage import RigidFlight, fly
from dynamics.scene.schema import Scene
from dynamics.stability import floquet
from dynamics.stability.derivatives import linearise
from dynamics.stability.towed import TowedModel, rig, towed
from tests.membranes import FIG6, altered, film
from tests.payloads import behind, ring
from tests.synthetic import smooth_table, smooth_tables

TABLES = smooth_tables()
STILL = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0, "spin_Hz": 0.0}
#: Cells whose sail is marginally stable without spin: a tilt hardly pushes it aside.
CALM = {
    "mark1e_te": smooth_table("mark1e_te", (0.152, 1.0, -1.0, -0.2), (0.714, -2.7, 4.0, -1.5), 0.4, 9.448e-6),
    "mark1e_tm": smooth_table("mark1e_tm", (0.142, 0.3, -1.0, 0.2), (0.233, -0.8, 2.0, 0.4), 0.4, 9.763e-6),
}


def black(payload: list[dict[str, Any]], **groups: Any) -> Scene:
    """An absorbing disc in light that is the same everywhere: pushed along the beam, whatever its tilt."""
    sail = {"sectors": film(absorptance=1.0, reflectance=0.0)}
    beam = {"intensity_W_m2": 1e8, "radius_m": 1e4, "rise_s": 0.0, "on_s": 10.0}
    return altered(FIG6, **{"sail": sail, "beam": beam, "release": STILL, "payload": payload, **groups})


def momentum(flight: RigidFlight) -> np.ndarray:
    """Momentum (n, 3) of sail and payload."""
    assert flight.payload is not None
    return flight.mass * flight.velocity + np.einsum("b,nbi->ni", flight.payload.mass, flight.payload.velocity)


def test_two_bodies_turn_about_each_other_on_their_tether():
    """T = μ ω² ℓ with the reduced mass μ: a constant tension on a circle (Landau & Lifshitz, Mechanics, §13)."""
    mass, length, stiffness, omega = 2e-4, 0.4, 1e3, 50.0
    plain = altered(FIG6, beam={"intensity_W_m2": 0.0}, release=STILL)
    sail = rigid_body(plain, TABLES, quadrature=None).shape.mass
    want = sail * mass / (sail + mass) * omega**2 * length
    tether = [{"to_m": [0.0, 0.0], "stiffness_N_m": stiffness, "length_m": length - want / stiffness}]
    scene = altered(plain, payload=[behind(mass, length, tether)], rigid={"duration_s": 0.2, "tolerance": 1e-12})
    start = np.zeros(13)
    start[6], start[10] = 1.0, omega
    flight = fly(scene, TABLES, start)
    assert flight.payload is not None
    assert flight.payload.tension[:, 0] == pytest.approx(want, rel=1e-8)
    assert flight.payload.position[:, 0, 1] - flight.position[:, 1] == pytest.approx(
        length * np.sin(omega * flight.time), abs=1e-8
    )


def test_a_towed_mass_swings_as_a_pendulum_behind_its_sail():
    """ω² = F/(M ℓ) and T = m F/(M + m), of a sail of mass M under a force F with a mass m on a line of length ℓ."""
    mass, length, aside = 1e-4, 0.5, 1e-4
    tether = [{"to_m": [0.0, 0.0], "stiffness_N_m": 2e3, "damping_s": 2e-4}]
    payload = [{**behind(mass, length, tether), "position_m": [aside, 0.0, -length]}]
    scene = black(payload, rigid={"duration_s": 0.5, "tolerance": 1e-11}, flight={"fly_away_m": 1e9})
    flight = fly(scene, {})
    assert flight.payload is not None
    force = 1e8 * np.pi * 0.25 / LIGHT_SPEED
    tension = mass * force / (flight.mass + mass)
    late = flight.time > 0.1
    # Its steps are those of the stiff, damped line, at the edge of stability: about the mean it is noise
    assert flight.payload.tension[late, 0].mean() == pytest.approx(tension, rel=1e-6)
    assert np.abs(flight.payload.tension[late, 0] - tension).max() < 2e-4 * tension
    x, t = flight.payload.position[:, 0, 0] - flight.position[:, 0], flight.time
    zero = np.flatnonzero((x[:-1] * x[1:] < 0.0) & late[1:])
    crossing = t[zero] - x[zero] * (t[zero + 1] - t[zero]) / (x[zero + 1] - x[zero])
    stretched = length + tension / 2e3
    assert np.pi / np.diff(crossing) == pytest.approx(np.sqrt(force / (flight.mass * stretched)), rel=1e-6)


CROWD = [
    behind(1e-4, 0.3, ring(3, 0.31, 400.0)),
    {"mass_kg": 5e-5, "position_m": [0.1, -0.05, -0.2], "tethers": [
        {"to_m": [0.13, 0.02], "stiffness_N_m": 50.0, "length_m": 0.202},
        {"to_m": [-0.2, 0.11], "stiffness_N_m": 80.0, "pushes": True},
    ]},
]


def test_momentum_and_energy_of_sail_and_payload_are_kept():
    """In the dark momentum to 1e-12, energy as the tolerance allows; the light's work is what both gain."""
    scene = altered(FIG6, payload=CROWD, beam={"intensity_W_m2": 0.0}, rigid={"duration_s": 0.05, "tolerance": 1e-12})
    start = np.zeros(13)
    start[6], start[3:6], start[10:13] = 1.0, [0.3, -0.1, 0.5], [3.0, -2.0, 60.0]
    flight = fly(scene, TABLES, start)
    assert flight.payload is not None
    scale = np.abs(flight.payload.mass @ np.linalg.norm(flight.payload.velocity, axis=2).T).max()
    assert np.abs(momentum(flight) - momentum(flight)[0]).max() < 1e-12 * scale
    for lit in (flight, fly(altered(scene, beam={"intensity_W_m2": 1e8}), TABLES, start)):
        assert lit.payload is not None
        energy = lit.energy_kinetic + lit.payload.energy_kinetic + lit.payload.energy_elastic
        assert np.abs(energy - energy[0] - lit.work).max() < 1e-8 * energy.max()


def test_a_tether_snaps_where_it_reaches_its_strength():
    """Then the mass flies on straight, and nothing pulls the sail aside any more."""
    tether = [{"to_m": [0.0, 0.0], "stiffness_N_m": 100.0, "strength_N": 0.02}]
    scene = black([behind(1e-4, 0.5, tether)], rigid={"duration_s": 0.05, "output_Hz": 1e5, "tolerance": 1e-11})
    flight = fly(scene, {})
    assert flight.payload is not None
    gone = flight.payload.snapped[:, 0] == 1.0
    first = int(np.argmax(gone))
    assert 0 < first < len(gone) - 10
    assert np.all(gone[first:])
    assert np.all(flight.payload.tension[gone] == 0.0)
    assert 0.0199 < flight.payload.tension.max() <= 0.02 * (1.0 + 1e-9)
    assert np.ptp(flight.payload.velocity[gone], axis=0).max() < 1e-15
    force = 1e8 * np.pi * 0.25 / LIGHT_SPEED
    rate = np.diff(flight.velocity[gone, 2]) / np.diff(flight.time[gone])
    assert rate == pytest.approx(force / flight.mass, rel=1e-6)


def model_of(scene: Scene, tables: dict[str, Any]) -> TowedModel:
    """The linear model of a scene with a payload."""
    body = rigid_body(scene, tables, lookup="smooth", quadrature=None)
    jacobian, thrust = linearise(scene, tables, body)
    return towed(body, jacobian, thrust, 2.0 * np.pi * scene.release.spin_Hz * body.units.time, scene)


def swung(scene: Scene, tables: dict[str, Any], aside: float) -> tuple[np.ndarray, np.ndarray]:
    """Lateral (sail, payload) positions (n, 4) of a flight, and of the linear model from the same start, in the lab."""
    body, model = rigid_body(scene, tables), model_of(scene, tables)
    settled = rig(body.sail.towing, model.start, float(model.thrust))
    depth = float(settled.depth[0]) * body.units.length
    payload = [{**scene.model_dump()["payload"][0], "position_m": [0.0, 0.0, depth]}]
    lengths = body.sail.towing.length * body.units.length
    for line, length in zip(payload[0]["tethers"], lengths, strict=True):
        line["length_m"] = float(length)
    start = np.zeros(13)
    start[6], start[0], start[12] = 1.0, aside, 2.0 * np.pi * scene.release.spin_Hz
    flight = fly(altered(scene, payload=payload), tables, start)
    assert flight.payload is not None
    found = np.column_stack([flight.position[:, :2], flight.payload.position[:, 0, :2]])
    # All starts aside as a whole, the masses' velocity that of the turning axis: none
    state = np.zeros(model.size)
    state[0] = state[8] = aside
    generator = model.lab(0.0)
    want = []
    for time in flight.time / body.units.time:
        angle = model.spin * time
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        here = expm(model.corotating() * time) @ state
        want.append(np.concatenate([turn @ here[:2], turn @ here[8:10]]))
    assert generator.shape == (model.size, model.size)
    return found, np.array(want)


@pytest.mark.parametrize("spin", [0.0, -120.0])
@pytest.mark.parametrize("damping", [0.0, 2e-4])
def test_small_motions_fly_as_the_linear_model_says(spin: float, damping: float):
    """Damped or not, turning or not: to a thousandth of the swing over many of its periods."""
    payload = [behind(1e-4, 0.2, ring(4, 0.3, 300.0, damping_s=damping))]
    scene = altered(
        FIG6, payload=payload, beam={"rise_s": 0.0}, release={**STILL, "spin_Hz": spin},
        rigid={"duration_s": 0.1, "tolerance": 1e-11, "output_Hz": 500.0},
    )
    found, want = swung(scene, CALM, 1e-6)
    assert np.abs(found - want).max() < 2e-3 * np.abs(want).max()


def test_both_routes_agree_with_a_payload():
    scene = altered(FIG6, payload=[behind(1e-4, 0.3, ring(3, 0.3, 300.0, damping_s=1e-4))])
    found = floquet.assess(model_of(scene, TABLES), [])
    assert found.route_difference is not None
    assert found.route_difference < 1e-9
    assert found.corotating is not None
    assert found.corotating.shape == (12,)


def test_damping_within_makes_a_sail_asymptotically_stable():
    """A mass on damped struts takes up the swings of a sail that is marginally stable without spin.

    Without damping it stays marginal. (The means of Rafat et al., Phys. Rev. Applied 17, 024016 (2022); the sail is
    another.)
    """
    plain = altered(FIG6, release=STILL, beam={"rise_s": 0.0})
    unit = rigid_body(plain, CALM, quadrature=None).units.time
    found = {}
    for damping in (0.0, 0.03):
        lines = ring(6, 0.2, 0.2, damping_s=damping, pushes=True)
        found[damping] = floquet.assess(model_of(altered(plain, payload=[behind(3e-4, 0.3, lines)]), CALM), [], unit)
    assert found[0.0].max_modulus == pytest.approx(1.0, abs=1e-9)
    assert found[0.03].verdict == "asymptotically_stable"
    assert found[0.03].margin == pytest.approx(0.19, abs=0.02)


def test_damping_in_a_turning_sail_feeds_swings_that_are_slower_than_the_turn():
    """As friction in a shaft does beyond its critical speed (Kimball, 1924; Genta, Dynamics of Rotating Systems)."""
    lines = ring(6, 0.2, 1e3, damping_s=1e-3)
    scene = altered(FIG6, payload=[behind(1e-4, 0.3, lines)])
    still = floquet.assess(model_of(altered(FIG6, payload=[behind(1e-4, 0.3, ring(6, 0.2, 1e3))]), TABLES), [])
    turning = floquet.assess(model_of(scene, TABLES), [])
    assert still.max_modulus == pytest.approx(1.0, abs=1e-9)
    assert turning.max_modulus > 1.0 + 1e-9


@pytest.mark.parametrize(("payload", "said"), [
    ([{"mass_kg": 1e-4, "position_m": [0.1, 0.0, -0.2], "tethers": ring(3, 0.2, 10.0)}], "must be on the sail's axis"),
    ([{"mass_kg": 1e-4, "position_m": [0.0, 0.0, 0.2], "tethers": ring(3, 0.2, 10.0)}], "do not hold it there"),
    ([behind(1e-4, 0.2, ring(1, 0.2, 10.0))], "pull the sail aside"),
])
def test_what_has_no_equilibrium_is_refused(payload: list[dict[str, Any]], said: str):
    with pytest.raises(InputError, match=said):
        model_of(altered(FIG6, payload=payload), TABLES)


def test_what_a_rigid_sail_cannot_be_is_refused():
    with pytest.raises(InputError, match="held: must be left out"):
        rigid_body(altered(FIG6, release=STILL, held={"rim": "clamped"}), TABLES, quadrature=None)
    line = [{"to_m": [0.0, 0.6], "stiffness_N_m": 1.0}]
    with pytest.raises(InputError, match=r"to_m = \[0.0, 0.6\]: must be at most 0.5 m away"):
        rigid_body(altered(FIG6, payload=[behind(1e-4, 0.1, line)]), TABLES, quadrature=None)
