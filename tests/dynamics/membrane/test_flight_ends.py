"""How a flexible flight ends, what an effect costs that is off, and that the same flight gives the same bits."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.output.journal import leaves
from dynamics.scene.schema import Scene
from tests.membranes import altered, dark, film, small
from tests.synthetic import smooth_tables

TABLES = smooth_tables()
SHORT = {"flight": {"duration_s": 2e-4, "series_every": 4}}
WIDE = {"intensity_W_m2": 1e9, "radius_m": 100.0}


# Ends


def test_a_sail_that_spins_too_fast_tears_and_says_where():
    end = fly(dark(release={"spin_Hz": -3000.0}, flight={"spin_up_s": 2e-3}), {})[1]
    assert end.reason == "tensile_failure"
    assert end.time < 0
    assert np.linalg.norm(end.position) < 0.51
    assert end.detail.startswith("triangle ")


def test_a_sail_without_that_effect_does_not_tear():
    scene = dark(release={"spin_Hz": -3000.0}, flight={"spin_up_s": 2e-3, "duration_s": 1e-5})
    assert fly(altered(scene, effects={"tensile_failure": False}), {})[1].reason == "finished"


@pytest.mark.parametrize("stiffness", ["triangles", "van_gelder"])
def test_tearing_starts_at_the_limit(stiffness: str):
    """Springs tear at a strain of σ/Y. In a sheet stretched alike both ways σ = Y/(1 − ν) (λ² − 1)/2."""
    limit = 6.4e9 / 270e9
    for share, reason in ((0.999, "finished"), (1.001, "tensile_failure")):
        scene = dark(2, flight={"duration_s": 1e-7, "time_step_s": 1e-7, "stiffness": stiffness})
        sheet = np.sqrt(1.0 + 2.0 * (1.0 - 0.27) * share * limit)
        assert stretched(scene, sheet if stiffness == "triangles" else 1.0 + share * limit) == reason


def stretched(scene: Scene, factor: float) -> str:
    """How the flight of a sail ends that starts stretched by a factor."""
    with tempfile.TemporaryDirectory() as folder:
        flight = Flight(scene, {}, Path(folder))
        flight.state.x[...] *= factor
        return flight.fly().reason


def test_a_sail_that_absorbs_too_much_burns():
    scene = dark(sail={"sectors": film(absorptance=1e-3)}, beam=WIDE, flight={"duration_s": 5e-3, "fly_away_m": 1e9})
    flight, end, _ = fly(scene, {})
    assert end.reason == "thermal_failure"
    step = 1e-3 * 1e9 / (2700.0 * 400e-9 * 800.0) * 4 * flight.model.dt
    assert 1673.15 < flight.state.temperature.max() < 1673.15 + step


def test_a_sail_that_the_beam_pushes_out_flies_away():
    scene = dark(
        sail={"sectors": film(absorptance=0.0)},
        beam={"intensity_W_m2": 1e9},
        release={"pitch_deg": 20.0},
        flight={"fly_away_m": 1e-4, "duration_s": 1e-2},
    )
    _, end, series = fly(scene, {})
    assert end.reason == "fly_away"
    assert np.hypot(*series["position"][-1, :2]) > 1e-4 > np.hypot(*series["position"][-2, :2])


def test_a_tilt_outside_the_table_ends_the_flight_or_is_clamped():
    narrow = smooth_tables(u_max=0.02)
    flight, end, _ = fly(small(**SHORT), narrow)
    assert end.reason == "left_table"
    assert end.time <= flight.model.dt
    assert "u = " in end.detail
    flight, end, series = fly(small(outside_table="clamp", **SHORT), narrow)
    assert end.reason == "finished"
    assert flight.work.effects.light.outside[0] == series["outside_table"][-1] > 0


def test_light_from_behind_leaves_the_table(tmp_path: Path):
    flight = Flight(small(**SHORT), TABLES, tmp_path)
    flight.step = flight.model.release
    flight.state.x[1:] *= -1.0
    assert flight.fly().reason == "left_table"


def test_a_nan_ends_the_flight_at_once_with_the_last_good_state(tmp_path: Path):
    flight = Flight(dark(flight={"duration_s": 1e-2}), {}, tmp_path)
    flight.advance()
    at = flight.step
    flight.state.v[2, 40] = np.nan
    end = flight.fly()
    assert (end.reason, end.step) == ("non_finite", at)
    assert end.detail == "node 40"
    frame = flight.journal.frames[-1]
    assert np.isfinite(frame[1 : 1 + 3 * flight.model.masses.size]).all()


def test_bad_time_step_is_refused():
    with pytest.raises(InputError, match=r"flight\.time_step_s = 0\.001: must be below"):
        fly(dark(flight={"time_step_s": 1e-3}), {})


# Effects


def final(scene: Scene) -> list[np.ndarray]:
    flight, end, _ = fly(scene, TABLES if scene.sail.designs else {})
    assert end.reason == "finished"
    return [flight.state.x.copy(), flight.state.v.copy(), flight.state.temperature.copy()]


OFF: dict[str, dict[str, Any]] = {
    "emission": {"emissivity_front": 0.0, "emissivity_back": 0.0},
    "conduction": {"conductivity_W_mK": 0.0},
    "expansion": {"expansion_1_K": 0.0},
    "absorption": {"absorptance": 0.0},
    "tensile_failure": {},
    "thermal_failure": {},
}


@pytest.mark.parametrize("integrator", ["verlet", "rk4"])
@pytest.mark.parametrize("effect", list(OFF))
def test_an_effect_that_is_off_equals_one_that_does_nothing_to_the_bit(effect: str, integrator: str):
    scene = dark(
        sail={"sectors": film(**OFF[effect])},
        beam={"intensity_W_m2": 1e9},
        release={"pitch_deg": 2.0, "spin_Hz": -120.0},
        flight={"duration_s": 2e-4, "integrator": integrator},
    )
    on, off = (final(altered(scene, effects={effect: value})) for value in (True, False))
    assert all(np.array_equal(a, b) for a, b in zip(on, off, strict=True))


def test_light_that_is_off_equals_no_intensity_to_the_bit():
    scene = dark(beam={"intensity_W_m2": 0.0}, release={"spin_Hz": -120.0}, flight={"duration_s": 2e-4})
    on, off = (final(altered(scene, effects={"light": value})) for value in (True, False))
    assert all(np.array_equal(a, b) for a, b in zip(on, off, strict=True))


@pytest.mark.parametrize("effect", ["spin_up", "damping", "reflections"])
def test_effects_with_nothing_to_do_leave_every_bit_as_it_was(effect: str):
    """No spin, no retardation time, a flat sail: on, each does what it does off."""
    scene = dark(4, sail={"sectors": film()}, beam={"intensity_W_m2": 1e9}, flight={"duration_s": 2e-4})
    on, off = (final(altered(scene, effects={effect: value})) for value in (True, False))
    assert all(np.array_equal(a, b) for a, b in zip(on, off, strict=True))


def test_what_is_off_has_no_arrays(tmp_path: Path):
    flight = Flight(dark(effects={"tensile_failure": False, "expansion": False}), {}, tmp_path)
    sizes = {name: array.size for name, array in leaves(flight.work)}
    assert all(size <= 3 for name, size in sizes.items() if name.startswith(("light.", "heat.", "stage.")))
    assert flight.model.effects.springs.stretch.size == flight.model.effects.springs.expansion.size == 0
    assert flight.model.effects.light.tables.numbers.size == flight.state.temperature.size == 0


# Repetition


@pytest.mark.parametrize("integrator", ["semi_implicit_euler", "verlet", "rk4"])
def test_the_same_flight_gives_the_same_bits_however_it_is_cut(integrator: str, tmp_path: Path):
    scene = small(**SHORT)
    scene = altered(scene, flight={"integrator": integrator})
    whole = fly(scene, TABLES)[0]
    cut = Flight(scene, TABLES, tmp_path)
    while cut.step < cut.model.end:
        cut.advance()
        cut.checkpoint()
        cut = Flight(scene, TABLES, tmp_path)
        assert cut.resume()
    assert np.array_equal(cut.state.x, whole.state.x)
    assert np.array_equal(cut.state.v, whole.state.v)
    assert np.array_equal(cut.state.temperature, whole.state.temperature)


def test_light_held_over_steps_is_that_of_their_middle():
    """Nothing is late by half of the time that it is held for."""
    ends = {j: final(small(flight={"duration_s": 2e-3, "optics_every": j, "heat_every": 1}))[0] for j in (1, 2, 4, 8)}
    errors = np.array([np.abs(ends[j] - ends[1]).max() for j in (2, 4, 8)])
    assert np.all(errors < [4e-8, 1.5e-7, 4e-7])
