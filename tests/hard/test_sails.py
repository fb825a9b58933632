"""Hard cases of flexible sails: slivers, extreme stiffness ratios, thermal shock, the edge of stability, hot spots."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.membrane import build as model
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.lattice import STABILITY, highest_frequency, sheet_matrix
from dynamics.membrane.output.record import COLUMNS
from dynamics.sail.mesh import sail_mesh
from dynamics.scene.schema import Scene
from tests.membranes import FILM, altered, column, dark, film, steps


def energy(rows: np.ndarray) -> np.ndarray:
    return np.asarray(rows[:, COLUMNS["energy_kinetic"]] + rows[:, COLUMNS["energy_elastic"]])


def bound(scene: Scene) -> float:
    """The longest stable time step in s of a scene's integrator on its mesh."""
    mesh = sail_mesh(scene.sail)
    masses = model.lattice(scene.sail, mesh, scene.flight).masses
    return float(STABILITY[scene.flight.integrator] / highest_frequency(sheet_matrix(scene.sail, mesh), masses))


def finer(scene: Scene, folder: Path, times: int, count: int) -> np.ndarray:
    """`swing` at a time step so many times shorter than the default one."""
    flight = {"series_every": 1, "time_step_s": Flight(scene, {}, folder).model.dt / times}
    return swing(Flight(altered(scene, flight=flight), {}, folder), count)


def swing(flight: Flight, count: int) -> np.ndarray:
    """Rows of a sail that starts stretched by 1e-4 and bent, drifting."""
    flight.state.x[...] *= 1.0 + 1e-4
    flight.state.v[...] = [1.0 + 0.0 * flight.state.x[0], 20.0 * flight.state.x[0], 5.0 * flight.state.x[1]]
    return steps(flight, count)


def test_slivers_a_thousand_times_longer_than_wide_keep_energy_and_momentum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A mesh that would be refused, flown all the same: the elements themselves know no slenderness."""

    def squeezed(sail: Any) -> Any:
        mesh = sail_mesh(sail)
        return replace(mesh, nodes=mesh.nodes * [1.0, 1e-3, 1.0])

    monkeypatch.setattr(model, "sail_mesh", squeezed)
    monkeypatch.setattr(model, "check_mesh", lambda *_: None)
    rows = finer(dark(2, effects={"tensile_failure": False}, flight={"duration_s": 1e-3}), tmp_path, 8, 4000)
    assert np.ptp(energy(rows)) < 0.02 * rows[:, COLUMNS["energy_elastic"]].max()
    assert np.allclose(column(rows, "velocity")[-1], column(rows, "velocity")[0], atol=1e-12)


def test_a_stiffness_ratio_of_a_million_keeps_energy_and_momentum(tmp_path: Path):
    """Half the sail nitride, half of it a million times softer: one time step, the right bound, no drift."""
    soft = {**FILM, "emissivity_front": 0.0, "emissivity_back": 0.0, "young_Pa": 270e3, "strength_Pa": 6.4e9}
    stiff = {**soft, "young_Pa": 270e9}
    sectors = [{"from_deg": start, "material": m, "reflectance": 0.5} for start, m in ((30.0, stiff), (210.0, soft))]
    rows = finer(dark(4, sail={"sectors": sectors}), tmp_path, 4, 6000)
    assert np.ptp(energy(rows)) < 2e-3 * energy(rows)[0]
    momentum = column(rows, "velocity")
    assert np.abs(momentum - momentum[0]).max() < 1e-12 * np.linalg.norm(momentum[0])


@pytest.mark.parametrize("integrator", ["semi_implicit_euler", "verlet", "rk4"])
def test_the_time_step_just_above_the_bound_is_refused_and_just_below_it_is_stable(tmp_path: Path, integrator: str):
    scene = dark(3, flight={"integrator": integrator, "series_every": 1})
    limit = bound(scene)
    with pytest.raises(InputError, match=r"flight\.time_step_s = .*: must be below"):
        Flight(altered(scene, flight={"time_step_s": 1.0001 * limit}), {}, tmp_path)
    flight = Flight(altered(scene, flight={"time_step_s": 0.99 * limit}), {}, tmp_path)
    flight.state.x[...] *= 1.0 + 1e-9
    rows = steps(flight, 4000)
    # Close to the bound the energy that symplectic steps keep differs from the true one by up to 1/(1 − 0.99²)
    assert energy(rows).max() < 60.0 * energy(rows)[0]


def test_thermal_shock_heats_as_the_closed_form_says_and_strains_no_more_than_twice_the_expansion():
    """0 to 5 GW/m² in a microsecond. T − T₀ = aIt/(ρhc); the sail overshoots its new rest shape by as much again."""
    scene = dark(
        6,
        sail={"sectors": film(absorptance=1e-4, emissivity_front=0.0, emissivity_back=0.0)},
        beam={"intensity_W_m2": 5e9, "radius_m": 1e4, "rise_s": 1e-6, "on_s": 1.0},
        flight={"duration_s": 5e-4, "heat_every": 1, "optics_every": 1, "series_every": 1},
    )
    flight, end, series = fly(scene, {})
    assert end.reason == "finished"
    rate = 1e-4 * 5e9 / (2700.0 * 400e-9 * 800.0)
    after = series["time"] > 1e-6
    want = 300.0 + rate * (series["time"][after] - 0.5e-6)
    assert np.abs(series["temperature_mean"][after] - want).max() < 2.0 * rate * flight.model.dt
    grown = 2.3e-6 * (series["temperature_max"] - 300.0)
    assert np.all(np.abs(series["strain_min"]) <= 2.0 * grown + 1e-9)
    assert np.all(series["strain_max"] <= 2.0 * grown + 1e-9)


def test_without_spin_and_offset_nothing_turns():
    """A film pushed by the light on its axis keeps its angular momentum of exactly nothing but rounding."""
    scene = dark(4, beam={"intensity_W_m2": 1e9, "radius_m": 0.4}, flight={"duration_s": 2e-3, "series_every": 1})
    flight, end, series = fly(scene, {})
    assert end.reason == "finished"
    assert flight.model.effects.spin_up.steps == 0
    size = flight.model.masses.sum() * series["velocity"][-1, 2] * 0.5
    assert np.abs(series["angular_momentum"]).max() < 1e-12 * size
    assert np.hypot(*series["position"][-1, :2]) < 1e-12


def test_a_hot_spot_spreads_by_four_times_its_diffusivity_a_second(tmp_path: Path):
    """⟨r²⟩ = ⟨r²⟩₀ + 4Dt, D = κ/(ρc), while the spot is far from the rim; no heat is lost."""
    quick = {"conductivity_W_mK": 3e6, "emissivity_front": 0.0, "emissivity_back": 0.0}
    scene = dark(
        20,
        sail={"sectors": film(**quick)},
        effects={"conduction": True, "expansion": False},
        flight={"heat_every": 1, "series_every": 1000},
    )
    flight = Flight(scene, {}, tmp_path)
    r2, weights = (flight.model.rest**2).sum(axis=0), flight.membrane.lattice.heat_capacities
    flight.state.temperature[:] = 300.0 + 100.0 * np.exp(-r2 / 0.01)

    def spread() -> tuple[float, float]:
        heat = weights * (flight.state.temperature - 300.0)
        return float(heat.sum()), float(heat @ r2 / heat.sum())

    heat, before = spread()
    steps(flight, 2000)
    kept, after = spread()
    time = 2000 * flight.model.dt
    assert kept == pytest.approx(heat, rel=1e-10)
    assert after - before == pytest.approx(4.0 * 3e6 / (2700.0 * 800.0) * time, rel=0.01)
