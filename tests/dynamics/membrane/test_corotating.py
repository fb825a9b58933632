"""The semi-implicit scheme in the frame of a spinning sail: what it keeps, its order, and where it does not fly."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from beamrider.io.files import InputError
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.stepping.corotating import replace_accelerations
from dynamics.membrane.stepping.step import evaluate
from dynamics.scene.schema import Scene
from optics.cells.schema import ThinFilm
from optics.thin_film.stage import make_table
from tests.membranes import DRUM_MODES, altered, dark, drum_mode, film, small
from tests.synthetic import smooth_tables

FAST = {"integrator": "corotating", "optics_every": 1, "heat_every": 1, "series_every": 1, "time_step_s": 80e-6}
BEAM = {"intensity_W_m2": 1e9}
TILTED = {"offset_m": [0.05, 0.05], "pitch_deg": 2.0, "roll_deg": 2.0, "spin_Hz": -120.0}


def spinning(rings: int = 5, lit: bool = True, warm: bool = False, **flight: Any) -> Scene:
    """A tilted, displaced film of constant reflectance that spins."""
    heat = ("absorption", "emission", "conduction", "expansion", "thermal_failure")
    cold = {} if warm else dict.fromkeys(heat, False)
    scene = dark(rings, sail={"sectors": film()}, beam=BEAM if lit else {}, release=TILTED, effects=cold)
    return altered(scene, flight={**FAST, "duration_s": 0.02, **flight})


def flown(scene: Scene) -> dict[str, np.ndarray]:
    """The series from the release on of a flight that ends in time."""
    _, end, series = fly(scene, {})
    assert end.reason == "finished"
    return {name: values[series["time"] >= 0] for name, values in series.items()}


def test_a_free_sail_keeps_momentum_angular_momentum_and_energy():
    """Momenta to rounding; energy to the share of the in-plane waves, which the scheme slows, and without a drift."""
    series = flown(spinning(lit=False))
    speed = 2 * np.pi * 120 * 0.5
    assert np.abs(series["velocity"] - series["velocity"][0]).max() < 1e-11 * speed
    spin = series["angular_momentum"]
    assert np.abs(spin - spin[0]).max() < 1e-11 * np.abs(spin).max()
    energy = series["energy_kinetic"] + series["energy_elastic"]
    assert np.abs(energy / energy[0] - 1).max() < 2e-3
    early, late = energy[: len(energy) // 4], energy[-len(energy) // 4 :]
    assert abs(late.mean() / early.mean() - 1) < 1e-4


@pytest.mark.parametrize(
    "beam", [{"rise_s": 1e-6}, {"rise_s": 0.0}, {"rise_s": 0.0, "delay_s": 3.1e-4, "on_s": 1.2e-3}]
)
def test_momentum_changes_by_the_impulse_of_the_light_alone(beam: dict[str, float]):
    """The light's full impulse too, where the ramp lies within a step or light comes and goes at once.

    Explicit steps take light that comes and goes at once for up to one of them less: 8e-5 of the impulse.
    """
    scene = altered(spinning(duration_s=2e-3), beam=beam)
    flight, _, series = fly(scene, {})
    gained = flight.model.masses.sum() * series["velocity"]
    assert np.abs(gained - series["impulse"]).max() < 1e-10 * np.linalg.norm(series["impulse"][-1])
    fine = {"integrator": "verlet", "time_step_s": 1e-7, "optics_every": 64, "series_every": 64}
    explicit = fly(altered(scene, flight=fine), {})[2]
    at = np.interp(1.6e-3, explicit["time"], explicit["impulse"][:, 2])
    assert np.interp(1.6e-3, series["time"], series["impulse"][:, 2]) == pytest.approx(at, rel=1e-4)


def test_a_sail_turns_at_its_spin_and_stretches_as_that_asks():
    """At asin(Ω Δt)/Δt it would be 9 mrad ahead. Of the energy, force 2(1 − cos Ω Δt)/Δt² for Ω² takes (Ω Δt)²/6."""
    series, explicit = [
        flown(spinning(lit=False, **how))
        for how in ({}, {"integrator": "verlet", "time_step_s": None, "series_every": 16})
    ]
    rate, energies = -2 * np.pi * 120, [run["energy_elastic"].mean() for run in (series, explicit)]
    assert np.abs(np.unwrap(series["yaw"]) - rate * series["time"]).max() < 2e-5
    assert energies[0] / energies[1] == pytest.approx(1.0, rel=(rate * 80e-6) ** 2 / 6)


def drummed(tmp_path: Path, rings: int, step: float) -> np.ndarray:
    """ω/Ω of the drum modes of a flat sail that spins, each struck at its release a little: fitted to what follows."""
    scene = spinning(rings, lit=False, duration_s=0.04, time_step_s=step, snapshot_every_s=112e-6)
    flat = altered(scene, release={"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0})
    flight = Flight(flat, {}, tmp_path / f"{rings} {step}")
    while flight.step < flight.model.release:
        flight.advance()
    nodes, masses = flight.membrane.mesh.nodes, flight.model.masses
    shapes = np.stack([drum_mode(nodes, *mode)[1][0] for mode in DRUM_MODES])
    flight.state.x[2] += 1e-6 * shapes.sum(axis=0)
    steps, seen = [], []
    while flight.step < flight.model.end:
        assert flight.advance() is None
        steps.append(flight.step - flight.model.release)
        seen.append(shapes @ (masses * flight.state.x[2]))
    t = step * np.array(steps)

    def rest(rate: float, values: np.ndarray) -> float:
        waves = np.stack([np.cos(rate * t), np.sin(rate * t), np.ones_like(t)], axis=1)
        return float(np.linalg.norm(values - waves @ np.linalg.lstsq(waves, values, rcond=None)[0]))

    found = []
    for mode, values in zip(DRUM_MODES, np.transpose(seen), strict=True):
        guess = 2 * np.pi * 120 * drum_mode(nodes, *mode)[0]
        best = minimize_scalar(rest, (0.95 * guess, 1.05 * guess), (0.7 * guess, 1.1 * guess), (values,), "bounded")
        found.append(best.x / guess)
    return np.array(found)


def test_drum_modes_have_the_frequencies_of_the_closed_form(tmp_path: Path):
    """The tilt exactly; the others with errors of second order in the mesh, and next to none of the step."""
    errors = []
    for rings in (6, 12):
        coarse, middle, fine = [drummed(tmp_path, rings, step) for step in (56e-6, 28e-6, 14e-6)]
        assert np.abs(np.array([coarse[0], middle[0], fine[0]]) - 1.0).max() < 1e-6
        assert np.abs(middle - fine).max() < 1e-4
        assert np.abs(coarse - fine).max() < 1.5e-3
        errors.append(np.abs(fine - 1.0)[1:])
    assert errors[1].max() < 0.04
    assert np.all(errors[1] < 0.35 * errors[0])


def stepped(flight: Flight, x: np.ndarray, v: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Nodes and, times the step, velocities half a step ago, one step on in the dark, turned back: (6n,)."""
    model, work = flight.model, flight.work
    x, v = np.ascontiguousarray(x), np.ascontiguousarray(v)
    assert evaluate(model, work, x, v, flight.state.temperature, 0.0, 0.0, False, False) == 0
    replace_accelerations(model, flight.corotating, flight.corotating_work, x, v, work.acceleration)
    v = v + model.dt * work.acceleration
    return np.concatenate([(turn @ (x + model.dt * v)).ravel(), (turn @ v).ravel() * model.dt])


def in_balance(flight: Flight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes and velocities half a step ago of a flat sail that turns steadily along chords, and a turn back by a step.

    Nodes settle in the scheme itself, as in-plane waves are damped.
    """
    while flight.step < flight.model.release + 40:
        assert flight.advance() is None
    nodes, scale = flight.membrane.mesh.nodes, np.linalg.norm(flight.state.x[:2]) / np.linalg.norm(flight.model.rest)
    angle = flight.model.dt * -2.0 * np.pi * 120.0
    turn = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    x = scale * nodes.T - (scale * nodes.T @ flight.model.masses / flight.model.masses.sum())[:, None]
    v = (x - turn @ x) / flight.model.dt
    for _ in range(60):
        found = stepped(flight, x, v, turn).reshape(2, 3, -1)
        x, v = found[0], (found[0] - turn @ found[0]) / flight.model.dt
    return x, v, turn


def test_no_wave_grows_and_in_plane_ones_are_gone_at_once(tmp_path: Path):
    """Eigenvalues of the map of one step about the steady turn: on the unit circle but for waves that are damped.

    What grows without damping does so by 3e-6 a step here. Rounding of differences splits the pairs at 1 of the rigid
    motion by 1e-5.
    """
    level = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0}
    flight = Flight(altered(spinning(3, lit=False), release=level), {}, tmp_path)
    x, v, turn = in_balance(flight)
    start, dt = np.concatenate([x.ravel(), v.ravel() * flight.model.dt]), flight.model.dt
    assert np.abs(stepped(flight, x, v, turn) - start).max() < 1e-13
    columns = []
    for k in range(start.size):
        pair = []
        for sign in (1.0, -1.0):
            moved = start.copy()
            moved[k] += sign * 1e-7
            pair.append(stepped(flight, *(moved.reshape(2, 3, -1) * np.array([1.0, 1.0 / dt])[:, None, None]), turn))
        columns.append((pair[0] - pair[1]) / 2e-7)
    values, vectors = np.linalg.eig(np.array(columns).T)
    moduli, n = np.abs(values), flight.model.masses.size
    across = np.abs(vectors[2 * n : 3 * n]).sum(axis=0) / np.abs(vectors[: 3 * n]).sum(axis=0)
    assert moduli.max() < 1.0 + 3e-5
    waves = (across < 0.5) & (moduli < 1.0 - 3e-5)
    assert waves.sum() == 2 * (2 * n - 3)
    assert moduli[waves].max() < 0.85
    assert (moduli[across > 0.5] > 0.97).all()


def test_tilt_converges_at_second_order():
    times = np.linspace(1e-3, 0.019, 100)
    tilts = []
    for step in (80e-6, 40e-6, 20e-6, 10e-6):
        series = flown(spinning(time_step_s=step))
        tilts.append(np.stack([np.interp(times, series["time"], series[name]) for name in ("pitch", "roll")]))
    errors = [np.abs(coarse - fine).max() for coarse, fine in pairwise(tilts)]
    assert errors[0] > 3.4 * errors[1] > 3.4**2 * errors[2]


def test_lit_and_warm_it_flies_as_the_explicit_scheme_does():
    """An error of second order: at 80 µs less than 1e-3 of what the light does, and of the temperature it raises."""
    times = np.linspace(1e-3, 0.019, 50)
    runs = [
        flown(spinning(warm=True, **how))
        for how in ({}, {"integrator": "verlet", "time_step_s": None, "series_every": 8})
    ]
    across, heat = [
        [np.stack([np.interp(times, run["time"], run[name][:, i] if k else run[name]) for i in (0, 1)]) for run in runs]
        for name, k in (("position", True), ("temperature_max", False))
    ]
    moved = np.abs(across[1] - 0.05).max()
    assert np.abs(across[0] - across[1]).max() < 1e-3 * moved
    assert np.abs(heat[0] - heat[1]).max() < 1e-3 * (heat[1].max() - 300.0)


def test_the_field_of_the_light_turns_with_the_time():
    """Where s and p differ, the absorbed power is that of the explicit scheme, not of a field at rest."""
    layer = {"thickness_nm": 43.0, "index": {"n": 3.48, "k": 0.05}}
    cell = ThinFilm.model_validate({"kind": "thin_film", "name": "glassy", "wavelength_nm": 1550, "layers": [layer]})
    sectors = [{"from_deg": 0.0, "material": "silicon_43nm", "design": "glassy"}]
    scene = altered(
        spinning(2, duration_s=4e-3),
        sail={"sectors": sectors},
        release={"pitch_deg": 30.0},
        absorptance="table",
        reflections={"polarisation": "tracked"},
        beam={"intensity_W_m2": 1e7},
    )
    times, tables = np.linspace(2e-4, 3.8e-3, 50), {"glassy": make_table(cell, 0.9, 1e-4)}
    power = []
    for beam, flight in (
        ({"polarisation": "turning", "polarisation_Hz": 60.0}, {}),
        ({"polarisation": "turning", "polarisation_Hz": 60.0}, {"integrator": "verlet", "time_step_s": None}),
        ({"polarisation": "lab"}, {}),
    ):
        _, end, series = fly(altered(scene, beam=beam, flight=flight), tables)
        assert end.reason == "finished"
        bright = series["time"] > 1e-4
        power.append(CubicSpline(series["time"][bright], series["power_absorbed"][bright])(times))
    turned = np.abs(power[1] / power[2] - 1.0).max()
    assert turned > 4e-3
    assert np.abs(power[0] / power[1] - 1.0).max() < 0.005 * turned


def test_a_flight_goes_on_from_a_checkpoint_to_the_same_bits(tmp_path: Path):
    scene = spinning(warm=True, duration_s=4e-3, snapshot_every_s=1e-3)
    whole, first, second = (Flight(scene, {}, tmp_path / name) for name in ("whole", "parts", "parts"))
    assert whole.fly().reason == "finished"
    while first.step < first.model.release + 20:
        first.advance()
    first.checkpoint()
    assert second.resume()
    assert second.fly().reason == "finished"
    assert np.array_equal(np.asarray(whole.journal.rows), np.asarray(second.journal.rows))
    assert np.array_equal(whole.state.x, second.state.x)


def test_a_sail_that_bends_more_than_the_scheme_bears_is_taken_for_stiffer(tmp_path: Path):
    """At 8 Hz the spin holds the sail against a beam of its own width no more; flights go on to the same bits."""
    scene = altered(spinning(duration_s=0.03, time_step_s=None), release={"spin_Hz": -8.0}, beam={"radius_m": 0.2})
    whole, first, second = (Flight(scene, {}, tmp_path / name) for name in ("whole", "parts", "parts"))
    ends = [whole.fly()]
    assert whole.corotating_work.stiffer[0] > 1.0
    while first.corotating_work.stiffer[0] == 1.0:
        assert first.advance() is None
    first.checkpoint()
    assert second.resume()
    ends.append(second.fly())
    assert ends[0].reason == ends[1].reason
    assert np.array_equal(np.asarray(whole.journal.rows), np.asarray(second.journal.rows))


def test_a_sail_that_bends_too_much_for_the_stiffest_scheme_ends_the_flight(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("dynamics.membrane.flight.STIFFEST", 1.0)
    scene = altered(spinning(duration_s=0.1, time_step_s=None), release={"spin_Hz": -8.0}, beam={"radius_m": 0.2})
    _, end, _ = fly(scene, {})
    assert end.reason == "beyond_scheme"
    assert "triangle" in end.detail


@pytest.mark.slow
def test_on_long_flights_it_keeps_to_the_explicit_scheme():
    """Strain does not grow and the path stays, where without damping slopes would grow to a third more strain."""
    times, runs = np.linspace(0.05, 0.95, 400), []
    explicit = {"integrator": "verlet", "optics_every": 8, "heat_every": 8, "series_every": 64}
    for how in ({"integrator": "corotating", "optics_every": 1, "heat_every": 1, "series_every": 8}, explicit):
        scene = altered(small(rings=12), absorptance="material", flight={"duration_s": 1.0, **how})
        _, end, series = fly(scene, smooth_tables())
        assert end.reason == "finished"
        runs.append({name: values[series["time"] >= 0.0] for name, values in series.items()})
    across = [np.stack([np.interp(times, run["time"], run["position"][:, i]) for i in (0, 1)]) for run in runs]
    moved = np.abs(across[1] - 0.05).max()
    assert np.abs(across[0] - across[1]).max() < 2e-3 * moved
    for name in ("strain_max", "temperature_max"):
        ends = [run[name][run["time"] > 0.5].max() for run in runs]
        assert ends[0] == pytest.approx(ends[1], rel=0.01)


@pytest.mark.parametrize(
    ("group", "change", "field"),
    [
        ("sail", {"profile": "paraboloid", "depth": 0.5}, "sail.profile"),
        ("release", {"spin_Hz": 0.0}, "effects.spin_up"),
        ("flight", {"stiffness": "van_gelder"}, "flight.stiffness"),
        ("flight", {"on_failure": "remove"}, "flight.on_failure"),
        ("flight", {"optics_every": 4}, "flight.optics_every"),
        ("flight", {"heat_every": 4}, "flight.heat_every"),
        ("flight", {"time_step_s": 3e-4}, "flight.time_step_s"),
    ],
)
def test_what_it_does_not_fly_is_refused_by_name(tmp_path: Path, group: str, change: dict[str, Any], field: str):
    with pytest.raises(InputError, match=rf"{field} = .*corotating"):
        Flight(altered(spinning(), **{group: change}), {}, tmp_path)


def test_the_film_may_not_be_viscous(tmp_path: Path):
    scene = altered(spinning(), sail={"sectors": film(damping_s=1e-6)})
    with pytest.raises(InputError, match=r"effects\.damping = True: must be False"):
        Flight(scene, {}, tmp_path)


def test_a_step_is_a_hundredth_of_a_turn_by_default(tmp_path: Path):
    flight = Flight(spinning(time_step_s=None), {}, tmp_path)
    assert flight.model.dt == pytest.approx(1 / 120 / 100, rel=1e-4)
