"""Rigid sails in beams of any profile that wander and flicker: force and torque, flights, linear stability."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from beamrider.io.files import InputError
from dynamics.light import beam as light
from dynamics.light.beam import Beam
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.light.pointing import Noise, at, seen
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.rigid.body import rigid_body
from dynamics.scene.schema import Scene
from dynamics.stability import floquet
from dynamics.stability.derivatives import linearise
from dynamics.stability.linear import QUARTER, LinearModel
from tests.dynamics.light.test_profiles import PARTS, TILTED, measured
from tests.membranes import FIG6, altered, film
from tests.synthetic import smooth_tables

TABLES = smooth_tables()
SHORT = {"duration_s": 0.02, "tolerance": 1e-11}
NEW: dict[str, dict[str, Any]] = {
    "super_gaussian": {"profile": {"kind": "super_gaussian", "order": 8}, "radius_m": 0.45},
    "flat_top": {"profile": {"kind": "flat_top", "order": 12}, "radius_m": 0.45},
    "ring": {"profile": {"kind": "ring"}, "radius_m": 0.35},
    "astigmatic": {**TILTED},
    "sum": {
        "profile": {
            "kind": "sum",
            "parts": [
                {"radius_m": 0.3, "x_m": 0.1, "y_m": 0.02},
                {"radius_m": 0.3, "x_m": -0.1, "y_m": -0.02},
            ],
        }
    },
}


def lit(scene: Scene = FIG6, **beam: Any) -> Scene:
    """The scene in another beam."""
    data = scene.model_dump()
    plain = {key: data["beam"][key] for key in ("intensity_W_m2", "radius_m", "rise_s", "on_s")}
    if beam.get("profile", {}).get("kind") in ("map", "sum"):
        del plain["radius_m"]
    return Scene.model_validate(data | {"beam": plain | beam})


def mirror(scene: Scene) -> Scene:
    return altered(scene, sail={"sectors": film(reflectance=1.0, absorptance=0.0)})


def all_of_it(which: Beam, place: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Power and its first moments about a place on a disc of half a metre, by midpoints of rings without thrift."""
    n, m = 1200, 720
    x, w = np.polynomial.legendre.leggauss(n)
    d, angle = 0.25 * (x + 1.0), 2.0 * np.pi * (np.arange(m) + 0.5) / m
    u, v = np.outer(d, np.cos(angle)), np.outer(d, np.sin(angle))
    e = light.intensity(which, u + place[0], v + place[1]) * (0.25 * w * d)[:, None] * 2.0 * np.pi / m
    return np.array([e.sum(), (e * u).sum(), (e * v).sum()])


@pytest.mark.parametrize("name", NEW)
def test_a_mirror_gets_all_of_the_light_that_falls_on_it(name: str):
    scene = mirror(lit(**NEW[name]))
    body = rigid_body(scene, {})
    for place in ((0.0, 0.0), (0.1, -0.05), (0.3, 0.2)):
        force, torque, _ = body.load(np.array([*place, 0.0]), np.eye(3))
        power, x, y = all_of_it(scene.beam, place)
        assert force[2] == pytest.approx(2.0 * power / LIGHT_SPEED, rel=1e-9)
        assert np.abs(torque - 2.0 / LIGHT_SPEED * np.array([y, -x, 0.0])).max() < 1e-9 * force[2]


def test_a_mirror_gets_the_light_of_a_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    scene = mirror(lit(profile={"kind": "map", "file": measured(tmp_path)}))
    force, _, _ = rigid_body(scene, {}).load(np.array([0.1, 0.05, 0.0]), np.eye(3))
    assert force[2] == pytest.approx(2.0 * all_of_it(scene.beam, (0.1, 0.05))[0] / LIGHT_SPEED, rel=1e-6)


def test_a_gaussian_by_any_other_name_flies_the_same():
    """To the error of quadrature: by the Gaussian's own rules, and by those of any profile."""
    flights = [
        rigid.fly(altered(which, rigid=SHORT), TABLES)
        for which in (
            FIG6,
            lit(profile={"kind": "super_gaussian", "order": 2}),
            lit(profile={"kind": "flat_top", "order": 0}),
            lit(profile={"kind": "sum", "parts": [{"radius_m": 0.4, "share": 0.25}] * 4}),
        )
    ]
    for flight in flights[1:]:
        assert np.abs(flight.position - flights[0].position).max() < 1e-11
        assert np.abs(flight.rotation - flights[0].rotation).max() < 1e-9


def test_wandering_off_is_how_a_displaced_sail_sees_it():
    """A beam displaced by −d on a sail in the middle is a sail displaced by d."""
    still = altered(FIG6, rigid=SHORT, release={"offset_m": [0.03, -0.02]})
    beam = lit(pointing={"path": [[0, -0.03, 0.02], [1, -0.03, 0.02]]})
    moved = altered(beam, rigid=SHORT, release={"offset_m": [0.0, 0.0]})
    one, other = (rigid.fly(which, TABLES) for which in (still, moved))
    assert np.abs(one.position - other.position - [0.03, -0.02, 0.0]).max() < 1e-10
    assert np.abs(one.rotation - other.rotation).max() < 1e-8


def test_a_tilted_beam_is_a_tilted_world():
    """A flight in a beam along k is one in a beam along z, all of it turned."""
    a, b = 1.2, -0.7
    tilted = altered(lit(pointing={"path": [[0, 0, 0, a, b], [1, 0, 0, a, b]]}), rigid=SHORT)
    units, wander = rigid_body(FIG6, TABLES).units, tilted.beam.wander
    start = rigid_body(FIG6, TABLES).start(FIG6.release)[:13] * units.state[:13]
    straight = rigid.fly(altered(FIG6, rigid=SHORT), TABLES, start)
    _, frame = seen(wander, np.zeros(1), np.zeros((1, 3)), np.eye(3)[None])
    turn = frame[0].T  # from the beam's frame to the lab
    w, x, y, z = start[6:10]
    turned = (Rotation.from_matrix(turn) * Rotation.from_quat([x, y, z, w])).as_quat()
    begun = np.concatenate([turn @ start[:3], turn @ start[3:6], turned[[3, 0, 1, 2]], start[10:13]])
    flight = rigid.fly(tilted, TABLES, begun)
    assert np.abs(flight.position - straight.position @ turn.T).max() < 1e-10
    assert np.abs(flight.rotation - turn @ straight.rotation).max() < 1e-8
    assert np.abs(flight.energy_balance).max() < 1e-9 * flight.energy_kinetic.max()


def test_power_that_fluctuates_gives_the_impulse_of_its_integral():
    noise = {"rms": 0.05, "cutoff_Hz": 400.0, "seed": 5, "record_s": 0.05}
    scene = mirror(lit(power_noise=noise, rise_s=0.0))
    scene = altered(scene, rigid=SHORT, release={"offset_m": [0, 0], "pitch_deg": 0.0, "roll_deg": 0.0})
    flight = rigid.fly(scene, {})
    times, shares = scene.beam.power_noise.record(4)  # type: ignore[union-attr]
    light_until = flight.time + CubicSpline(times, shares, bc_type="periodic").antiderivative()(flight.time)
    speed = 2.0 * all_of_it(scene.beam)[0] / LIGHT_SPEED / flight.mass * light_until
    assert np.abs(flight.velocity[:, 2] - speed).max() < 1e-8 * speed.max()


def test_the_axial_distance_of_published_runs_is_for_round_gaussian_beams():
    scene = altered(lit(**NEW["ring"]), rigid={"beam_distance": "published"})
    with pytest.raises(InputError, match=r"rigid.beam_distance = 'published': must be 'lateral' but for a round Gauss"):
        rigid_body(scene, {**TABLES})


def test_tilts_need_the_true_incidence():
    scene = altered(lit(pointing={"path": [[0, 0, 0, 1, 0], [1, 0, 0, 1, 0]]}), incidence="yaw_blind")
    with pytest.raises(InputError, match="tilts need incidence: sail_frame"):
        rigid_body(scene, TABLES)


def test_a_beam_too_steep_is_refused_in_one_line():
    with pytest.raises(InputError, match=r"fig6.yaml: beam.profile: changes within .* too steep for quad") as found:
        rigid_body(lit(radius_y_m=1e-4), TABLES)
    assert "\n" not in str(found.value)


# Linear stability


def small_motion(model: LinearModel, units: Any, small: np.ndarray) -> np.ndarray:
    """State of motion (13,) in SI of a small one (8,): place, velocity, tilt (roll, pitch), lateral rates in body."""
    x, y, vx, vy, roll, pitch, p, q = small
    state = np.array([x, y, 0, vx, vy, 0, 1.0, 0.5 * roll, 0.5 * pitch, 0.0, p, q, model.spin])
    return state * units.state[:13]


@pytest.mark.parametrize("name", NEW)
@pytest.mark.parametrize("spin", [-120.0, 0.0])
def test_small_motions_fly_as_the_linear_model_says(name: str, spin: float):
    """For a turn, in beams that are round and that are not."""
    scene = altered(lit(**NEW[name], rise_s=0.0), release={"spin_Hz": spin})
    scene = altered(scene, rigid={"duration_s": 1 / 120, "tolerance": 1e-12}, release={"offset_m": [0.0, 0.0]})
    if spin == 0.0 and name in ("astigmatic", "sum"):  # they turn a sail that stands about the axis
        with pytest.raises(InputError, match="it must vanish for a stability analysis"):
            floquet.analyse(scene, TABLES)
        return
    units, model = rigid_body(scene, TABLES).units, floquet.analyse(scene, TABLES).model
    assert model.periodic == (spin != 0.0 and name in ("astigmatic", "sum"))
    small = 1e-6 * np.array([1.0, -0.5, 2.0, 1.0, 0.7, -0.4, 3.0, 1.5])
    flights = [rigid.fly(scene, TABLES, small_motion(model, units, sign * small)) for sign in (1.0, -1.0)]
    ends = [np.concatenate([f.position[-1], f.velocity[-1]]) / units.state[:6] for f in flights]
    end = 0.5 * (ends[0] - ends[1])
    tilts = [np.array([-f.rotation[-1, 1, 2], f.rotation[-1, 0, 2]]) for f in flights]
    found = np.array([end[0], end[1], end[3], end[4], *(0.5 * (tilts[0] - tilts[1]))])
    still = spin == 0.0
    want = (expm(model.corotating() / 120 / units.time) if still else model.monodromy()) @ small
    assert np.allclose(found, want[:6], atol=3e-4 * 1e-6 * np.abs(want[:6] / 1e-6).max())


def test_a_beam_oval_by_nothing_has_the_multipliers_of_the_round_one():
    round_one = floquet.analyse(FIG6, TABLES)
    oval = floquet.analyse(lit(radius_y_m=0.4 * (1 + 1e-12)), TABLES)
    assert oval.corotating is None
    assert floquet.distance(round_one.multipliers, oval.multipliers) < 1e-8
    assert oval.verdict == round_one.verdict


def test_what_has_no_equilibrium_is_refused_with_the_reason():
    for keys, said in (
        ({"profile": {"kind": "sum", "parts": PARTS}}, "force or torque on the centred, level sail"),
        ({"pointing": {"path": [[0, 0, 0], [1, 0.1, 0]]}}, "a beam that moves has no equilibrium"),
    ):
        with pytest.raises(InputError, match=said):
            floquet.analyse(lit(**keys), TABLES)
    with pytest.raises(InputError, match="must be round for a stability analysis with incidence: yaw_blind"):
        floquet.analyse(altered(lit(**TILTED), incidence="yaw_blind"), TABLES)
    slow = altered(lit(**TILTED), release={"spin_Hz": -2.0})
    with pytest.raises(InputError, match="its spin would swing by"):
        floquet.analyse(slow, TABLES)


def test_jitter_is_left_out_of_stability_and_that_is_said():
    noise = {"rms": 1e-3, "cutoff_Hz": 50.0, "seed": 1}
    scene = lit(pointing={"jitter_m": noise}, power_noise=noise)
    found = floquet.report(scene, TABLES, floquet.analyse(scene, TABLES))
    assert found["left_out"].startswith("jitter and fluctuations")
    assert floquet.distance(*(floquet.analyse(s, TABLES).multipliers for s in (scene, FIG6))) < 1e-13


# Jitter


def driven(scene: Scene) -> tuple[rigid.RigidFlight, np.ndarray]:
    """A flight from rest in a beam that jitters, and its path (n, 2) in m by the linear model driven by the record."""
    body, n = rigid_body(scene, TABLES), 8000
    jacobian, thrust = linearise(scene, TABLES, body)
    spin = 2.0 * np.pi * scene.release.spin_Hz * body.units.time
    model = LinearModel(jacobian, np.array(thrust), body.sail.inertia[:2, :2], spin, False)
    generator, flight = model.corotating(), rigid.fly(scene, TABLES)
    # Only the place against the beam counts: ẏ = A y − B ξ in turning axes, ξ the beam's place there
    h = scene.rigid.duration_s / n / body.units.time
    step, half = expm(generator * h), expm(generator * 0.5 * h)
    push = half @ (generator[:, :2] + np.vstack([spin * QUARTER, np.zeros((6, 2))])) * h
    times = (np.arange(n) + 0.5) * h
    beam = at(scene.beam.pointing, None, times * body.units.time)[:, :2] / body.units.length
    y, path = np.zeros(8), np.zeros((n + 1, 2))
    for i in range(n):
        c, s = np.cos(spin * times[i]), np.sin(spin * times[i])
        y = step @ y - push @ (np.array([[c, s], [-s, c]]) @ beam[i])
        c, s = np.cos(spin * (i + 1) * h), np.sin(spin * (i + 1) * h)
        path[i + 1] = np.array([[c, -s], [s, c]]) @ y[:2] * body.units.length
    return flight, path[np.round(flight.time / scene.rigid.duration_s * n).astype(int)]


def jittering(seed: int, rms: float) -> Scene:
    noise = {"rms": rms, "cutoff_Hz": 60.0, "seed": seed, "record_s": 0.5}
    return altered(
        lit(pointing={"jitter_m": noise}, rise_s=0.0),
        rigid={"duration_s": 0.2, "output_Hz": 500.0, "tolerance": 1e-10},
        release={"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0},
    )


def test_the_swings_that_jitter_excites_are_those_of_the_linear_model():
    """Realisation by realisation, so that the ensemble's growth is that of the model."""
    swings = []
    for seed in range(4):
        flight, path = driven(jittering(seed, 1e-5))
        most = np.abs(path).max()
        assert np.abs(flight.position[:, :2] - path).max() < 2e-3 * most
        swings.append([(flight.position[:, :2] ** 2).sum(axis=1), (path**2).sum(axis=1)])
    flown, linear = np.mean(swings, axis=0)
    assert flown[-1] == pytest.approx(linear[-1], rel=5e-3)
    quarter = flown.size // 4
    assert flown[quarter] == pytest.approx(linear[quarter], rel=1e-2)  # a path off by 2e-3 of the largest swing
    assert flown[-1] > 2.0 * flown[quarter]


def test_the_mean_square_of_an_oscillator_on_these_records_grows_as_the_closed_form():
    """ẍ = −ω²(x − ξ), ξ white of one-sided density S: ⟨x²⟩ = ω²S/4 (t − sin(2ωt)/(2ω)).

    Wang & Uhlenbeck, Rev. Mod. Phys. 17 (1945) 323. The sail's own ω in x, and a band far beyond it.
    """
    body = rigid_body(FIG6, TABLES)
    omega = np.sqrt(-linearise(FIG6, TABLES, body)[0][0, 0]) / body.units.time
    cutoff, duration, seeds = 40.0 * omega / (2.0 * np.pi), 3.0 * np.pi / omega, 1000
    t, squares = np.linspace(0.0, duration, 3001), np.zeros((seeds, 2))
    for seed in range(seeds):
        times, values = Noise(rms=1e-5, cutoff_Hz=cutoff, seed=seed, record_s=4.0 * duration).record(0)
        xi = np.interp(t, times, values)
        for k, end in enumerate((1501, 3001)):
            late = omega * np.sin(omega * (t[end - 1] - t[:end]))
            squares[seed, k] = simpson(late * xi[:end], x=t[:end]) ** 2
    ends = t[[1500, 3000]]
    want = 0.25 * omega**2 * 1e-5**2 / cutoff * (ends - np.sin(2.0 * omega * ends) / (2.0 * omega))
    assert np.allclose(squares.mean(axis=0), want, rtol=4.0 * np.sqrt(2.0 / seeds))


# The basin


@pytest.mark.parametrize("name", ["flat_top", "astigmatic"])
def test_the_basin_takes_any_beam(name: str):
    scene = lit(**NEW[name])
    grid = basin.Grid(n_offsets=2, n_tilts=1, tilts_deg=[0.0, 0.0], duration_s=0.02).over(scene.beam)
    assert grid.offsets_m == [0.0, pytest.approx(0.9 * scene.beam.reach_m)]
    found = basin.fly_cells(scene, TABLES, grid, [0, 1])
    assert np.all(np.isfinite(found.columns["distance_max"]))
    assert found.columns["end_code"][0] == 1.0
