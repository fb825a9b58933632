"""Materials that damp, and materials whose properties change with temperature: closed forms, conservation, refusals."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.sparse import diags
from scipy.sparse.linalg import eigsh

from beamrider.io.files import InputError
from dynamics.membrane import build as model
from dynamics.membrane.effects import properties
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.lattice import STABILITY, highest_frequency, lattice, sheet_matrix
from dynamics.membrane.output.record import COLUMNS
from dynamics.membrane.plan import plan
from dynamics.sail.mesh import sail_mesh
from dynamics.scene.schema import Scene
from tests.membranes import altered, column, dark, film, heating, steps

SIGMA, AREAL, CAPACITY = 5.670374419e-8, 2700.0 * 400e-9, 800.0
COLD = {"emissivity_front": 0.0, "emissivity_back": 0.0}
WIDE = {"intensity_W_m2": 1e9, "radius_m": 1e4, "on_s": 1.0}
FAR = {"fly_away_m": 1e9}


# Damping


def damped(tau: float, rings: int = 4, **groups: Any) -> Scene:
    """A dark film that damps."""
    return dark(rings, sail={"sectors": film(**COLD, damping_s=tau)}, **groups)


def test_a_mode_dies_out_as_kelvin_and_voigt_say(tmp_path: Path):
    """x'' + τω²x' + ω²x = 0: energy falls as exp(−τω²t); the lowest breathing and shearing modes of a disc."""
    scene = damped(4e-6, flight={"series_every": 1})
    flight = Flight(scene, {}, tmp_path)
    masses = flight.model.masses
    scale = diags(np.repeat(1.0 / np.sqrt(masses), 3))
    stiff = scale @ sheet_matrix(scene.sail, flight.membrane.mesh) @ scale
    values, vectors = eigsh(stiff.tocsc(), k=14, sigma=(2.0 * np.pi * 8000.0) ** 2, v0=np.ones(stiff.shape[0]))
    square, mode = values[-1], (scale @ vectors[:, -1]).reshape(-1, 3).T
    flight.state.x[...] += 1e-8 * mode / np.abs(mode).max()
    rows = steps(flight, 400)
    energy = column(rows, "energy_kinetic") + column(rows, "energy_elastic")
    time = column(rows, "time") - column(rows, "time")[0]
    period = round(2.0 * np.pi / np.sqrt(square) / flight.model.dt)
    # The energy falls in steps, twice a period: compare whole periods
    later = period * (len(time) // period) - 1
    want = np.exp(-4e-6 * square * (time[later] - time[period - 1]))
    assert want < 0.5
    assert energy[later] / energy[period - 1] == pytest.approx(want, rel=0.03)


def test_damping_keeps_momentum_and_angular_momentum_and_takes_energy(tmp_path: Path):
    flight = Flight(damped(2e-6, flight={"series_every": 1}), {}, tmp_path)
    x, y, _ = flight.state.x
    flight.state.x[2] = 1e-3 * (x**2 - y**2)
    flight.state.v[...] = [3.0 - 40.0 * y, -1.0 + 44.0 * x, 7.0 + 8.0 * x * y]
    rows = steps(flight, 3000)
    momentum, angular = column(rows, "velocity"), column(rows, "angular_momentum")
    energy = column(rows, "energy_kinetic") + column(rows, "energy_elastic")
    assert np.abs(momentum - momentum[0]).max() < 1e-12 * np.linalg.norm(momentum[0])
    assert np.abs(angular - angular[0]).max() < 1e-12 * np.linalg.norm(angular[0])
    assert energy[-1] < energy[0]
    assert np.diff(energy).max() < 1e-4 * (energy[0] - energy[-1])


def test_a_sail_that_only_turns_is_not_braked(tmp_path: Path):
    """Damped or not, a rigidly turning sail has the same forces but for rounding."""
    flight = Flight(damped(1e-5), {}, tmp_path)
    x, y, _ = flight.state.x
    flight.state.v[...] = [5.0 - 700.0 * y, 700.0 * x, 2.0 + 0.0 * x]
    steps(flight, 0)
    force = flight.work.effects.damping.force
    stretched = 700.0 * 1e-5 * 270e9 * 400e-9 * 0.1  # of a strain rate as large as the spin
    assert np.abs(force).max() < 1e-12 * stretched


@pytest.mark.parametrize("integrator", ["verlet", "semi_implicit_euler"])
def test_damping_shortens_the_longest_stable_step(tmp_path: Path, integrator: str):
    """2/ω (√(1 + ζ²) − ζ), ζ = ωτ/2: above it refused, just below it energy only falls."""
    scene = damped(1e-5, 3, flight={"integrator": integrator, "series_every": 1}, effects={"tensile_failure": False})
    mesh = sail_mesh(scene.sail)
    omega = highest_frequency(sheet_matrix(scene.sail, mesh), lattice(scene.sail, mesh, scene.flight).masses)
    zeta = 0.5 * omega * 1e-5
    limit = STABILITY[integrator] / omega * (np.hypot(1.0, zeta) - zeta)
    assert limit < 0.8 * STABILITY[integrator] / omega
    with pytest.raises(InputError, match=r"flight\.time_step_s = .*: must be below"):
        Flight(altered(scene, flight={"time_step_s": 1.0001 * limit}), {}, tmp_path)
    for share, grows in ((0.99, False), (1.05, True)):
        flight = Flight(altered(scene, flight={"time_step_s": 0.99 * limit}), {}, tmp_path)
        flight = flight if share < 1 else longer(flight, share / 0.99)
        flight.state.x[...] += 1e-9 * np.random.default_rng(1).standard_normal(flight.state.x.shape)
        rows = steps(flight, 60)
        assert (column(rows, "energy_elastic")[-1] > 2.0 * column(rows, "energy_elastic")[0]) == grows


def longer(flight: Flight, factor: float) -> Flight:
    """The flight with a time step so many times longer, which no scene may ask for."""
    flight.model = flight.model._replace(dt=flight.model.dt * factor)
    return flight


def test_damping_that_is_off_leaves_every_bit_as_it_was():
    groups: dict[str, Any] = {"release": {"spin_Hz": -120.0}, "flight": {"duration_s": 2e-4, "time_step_s": 2e-6}}
    plain, off = fly(damped(0.0, **groups), {})[0], fly(damped(1e-7, effects={"damping": False}, **groups), {})[0]
    on = fly(damped(1e-7, **groups), {})[0]
    assert all(np.array_equal(a, b) for a, b in zip(plain.state, off.state, strict=True))
    assert not np.array_equal(plain.state.x, on.state.x)
    assert plain.model.effects.damping.time.size == plain.work.effects.damping.tension.size == 0
    assert not plan(damped(0.0))["damping"].on


@pytest.mark.parametrize("flight", [{"integrator": "rk4"}, {"stiffness": "van_gelder"}])
def test_damping_is_refused_where_it_is_not_computed(tmp_path: Path, flight: dict[str, Any]):
    with pytest.raises(InputError, match=r"flight\.(integrator|stiffness) = '.*': must be .* has damping"):
        Flight(damped(1e-7, flight=flight), {}, tmp_path)


# Properties that change with temperature


def changing(name: str, table: list[list[float]], **material: Any) -> list[dict[str, Any]]:
    """One sector all round of a film with a table of one property."""
    return film(**{**material, "with_temperature": {name: table}})


def heated(sectors: list[dict[str, Any]], **flight: Any) -> tuple[Flight, dict[str, np.ndarray]]:
    """A film in uniform light, heated at every step."""
    scene = dark(
        3,
        sail={"sectors": sectors},
        beam=WIDE,
        effects={"tensile_failure": False},
        flight={"duration_s": 5e-4, "heat_every": 1, "optics_every": 1, **FAR, **flight},
    )
    flown, end, series = fly(scene, {})
    assert end.reason == "finished"
    return flown, series


def test_a_heat_capacity_that_rises_with_temperature_stores_the_light():
    """c = c₀T/300 K: ρh c₀ (T² − 300²)/600 = a I t."""
    table = [[100.0, CAPACITY / 3], [3000.0, 10 * CAPACITY]]
    flight, series = heated(changing("heat_capacity_J_kgK", table, **COLD, absorptance=1e-3))
    time = series["time"][-1] - 0.5e-6  # half of the rise is lost
    want = np.sqrt(300.0**2 + 600.0 * 1e-3 * 1e9 * time / (AREAL * CAPACITY))
    step = 1e-3 * 1e9 * flight.model.dt / (AREAL * CAPACITY)
    assert want > 600.0
    assert abs(series["temperature_mean"][-1] - want) < step


def test_an_absorptance_that_rises_with_temperature_heats_exponentially():
    """a = a₀T/300 K: T = 300 K exp(a₀It/(300 K ρhc)), where light and heat are renewed at every step."""
    table = [[100.0, 1e-3 / 3], [3000.0, 1e-2]]
    flight, series = heated(changing("absorptance", table, **COLD, absorptance=1e-3), series_every=1, duration_s=2.5e-4)
    rate = 1e-3 * 1e9 / (300.0 * AREAL * CAPACITY)
    want = 300.0 * np.exp(rate * (series["time"][-1] - 0.5e-6))
    assert want > 500.0
    assert series["temperature_mean"][-1] == pytest.approx(want, abs=2.0 * rate * 300.0 * flight.model.dt * 2.0)
    share = series["power_absorbed"][-1] / series["power_incident"][-1]
    assert share == pytest.approx(1e-3 * series["temperature_mean"][-2] / 300.0, rel=2.0 * rate * flight.model.dt)


def test_an_emissivity_that_rises_with_temperature_cools_by_the_fifth_power():
    """ε_f + ε_b = 0.2T/300 K: T⁻⁴ = T₀⁻⁴ + 4 · 0.2σt/(300 K ρhc); front and back have tables of their own."""
    tables = {"emissivity_front": [[150.0, 0.05], [3000.0, 1.0]], "emissivity_back": [[300.0, 0.1], [2000.0, 2 / 3]]}
    scene = dark(
        3,
        sail={"sectors": film(with_temperature=tables)},
        effects={"expansion": False},
        flight={"duration_s": 2e-3, "heat_every": 1, "start_temperature_K": 1500.0},
    )
    _, _, series = fly(scene, {})
    time = series["time"][-1] - series["time"][0]
    first, last = series["temperature_mean"][[0, -1]]
    want = (first**-4 + 4.0 * 0.2 * SIGMA * time / (300.0 * AREAL * CAPACITY)) ** -0.25
    assert first - want > 5.0
    assert last - first == pytest.approx(want - first, rel=5e-3)


def test_a_conductivity_that_rises_with_temperature_keeps_the_heat_and_kirchhoffs_transform(tmp_path: Path):
    """κ ∝ T: where T² is linear in x no heat gathers inside, at second order in the mesh; none is ever made."""
    gathered = []
    for rings in (6, 12, 24):
        table = [[100.0, 1.0], [3000.0, 30.0]]
        sectors = changing("conductivity_W_mK", table, **COLD)
        scene = dark(rings, sail={"sectors": sectors}, effects={"conduction": True})
        flight = Flight(scene, {}, tmp_path / str(rings))
        m, w = flight.model, flight.work
        flight.state.temperature[:] = np.sqrt(600.0**2 + 600.0**2 * m.rest[0])
        steps(flight, 0)
        flow = w.effects.heat.rate / m.effects.heat.per_capacity
        edge = np.unique(flight.membrane.mesh.edges[flight.membrane.mesh.rim])
        inner = np.setdiff1d(np.arange(len(flow)), edge)
        assert abs(flow.sum()) < 1e-12 * np.abs(flow).max()
        gathered.append(
            np.abs(flow[inner] / flight.membrane.lattice.heat_capacities[inner]).mean()
            / np.abs(3.0 * 600.0 * 400e-9 / AREAL / CAPACITY)
        )
    # The defect of the scheme on a mesh of changing shapes: it falls at least at first order
    assert gathered[2] < 0.6 * gathered[1] < 0.36 * gathered[0]


def test_an_expansion_that_rises_with_temperature_leaves_a_free_sheet_without_stress(tmp_path: Path):
    """λ = 1 + ∫ α dT: 1e-6 at 200 K, 3e-6 at 400 K, constant from there on; also below 300 K."""
    scene = dark(
        3,
        sail={"sectors": changing("expansion_1_K", [[200.0, 1e-6], [400.0, 3e-6]], **COLD, expansion_1_K=2e-6)},
        effects={"expansion": True},
    )
    for kelvin, stretch in ((700.0, 1.0 + 2.5e-4 + 9e-4), (250.0, 1.0 - 50.0 * 1.75e-6), (150.0, 1.0 - 1.5e-4 - 5e-5)):
        flight = Flight(scene, {}, tmp_path / str(kelvin))
        flight.state.temperature[:] = kelvin
        flight.state.x[...] *= stretch
        rows = steps(flight, 50)
        assert np.abs(rows[:, [COLUMNS["strain_max"], COLUMNS["strain_min"]]]).max() < 1e-14


def test_tables_that_say_the_plain_value_change_nothing():
    """Constant tables of everything, in one of two regions: the same flight to rounding."""
    names = (
        "heat_capacity_J_kgK",
        "absorptance",
        "emissivity_front",
        "emissivity_back",
        "conductivity_W_mK",
        "expansion_1_K",
    )
    plain = {**film()[0]["material"]}
    tables = {name: [[250.0, plain[name]], [900.0, plain[name]]] for name in names}
    flights = []
    for given in ({}, tables):
        sectors = [{**film()[0], "from_deg": 30.0}, {**film(with_temperature=given)[0], "from_deg": 210.0}]
        flights.append(
            fly(
                dark(
                    4,
                    sail={"sectors": sectors},
                    beam={"intensity_W_m2": 1e9},
                    release={"spin_Hz": -120.0},
                    flight={"duration_s": 5e-4},
                ),
                {},
            )[0]
        )
    (one, two) = flights
    assert two.model.effects.properties.capacity.region.size == 96
    assert (two.model.effects.properties.absorption.region >= 0).sum() == 48
    assert np.allclose(one.state.temperature, two.state.temperature, rtol=1e-12)
    assert np.allclose(one.state.x, two.state.x, rtol=0, atol=1e-12)


@pytest.mark.parametrize("effect", ["absorption", "emission", "conduction", "expansion"])
def test_tables_of_an_effect_that_is_off_change_no_bit(effect: str):
    names = {
        "absorption": "absorptance",
        "emission": "emissivity_front",
        "conduction": "conductivity_W_mK",
        "expansion": "expansion_1_K",
    }
    value = film()[0]["material"][names[effect]]
    scene = dark(
        3, sail={"sectors": film()}, beam={"intensity_W_m2": 1e9}, effects={effect: False}, flight={"duration_s": 2e-4}
    )
    tabled = altered(scene, sail={"sectors": changing(names[effect], [[300.0, value], [400.0, 2.0 * value]])})
    one, two = fly(scene, {})[0], fly(tabled, {})[0]
    assert all(np.array_equal(a, b) for a, b in zip(one.state, two.state, strict=True))
    assert all(curve.region.size == 0 for curve in two.model.effects.properties[:5])


def test_curves_are_linear_between_knots_and_constant_beyond(tmp_path: Path):
    table = [[200.0, 0.05], [400.0, 0.15], [1000.0, 0.3]]
    scene = dark(2, sail={"sectors": changing("emissivity_front", table)}, effects={"emission": True})
    curve = Flight(scene, {}, tmp_path).model.effects.properties.emission
    for kelvin in (100.0, 200.0, 333.0, 400.0, 800.0, 1000.0, 2000.0):
        want = np.interp(kelvin, *np.transpose(table)) + 0.1
        assert properties.at(curve, 7, kelvin) == pytest.approx(want, rel=1e-14)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"absorptance": [[300.0, 2e-5]]}, "gives 2e-05 at 300 K: must be absorptance = 1e-05"),
        ({"absorptance": [[300.0, 1e-5], [900.0, 1.5]]}, "values must be from 0 to 1"),
        ({"absorptance": [[300.0, 1e-5], [200.0, 1e-5]]}, "must be positive and ascend"),
        ({"heat_capacity_J_kgK": [[300.0, 800.0], [900.0, 0.0]]}, "values must be above 0"),
        ({"density_kg_m3": [[300.0, 2700.0]]}, "with_temperature"),
        ({"absorptance": []}, "at least 1 item"),
    ],
)
def test_tables_that_make_no_sense_are_refused(tables: dict[str, Any], message: str):
    with pytest.raises(ValidationError, match=message):
        dark(2, sail={"sectors": film(with_temperature=tables)})


@pytest.mark.parametrize(
    ("name", "flight"),
    [
        ("expansion_1_K", {"stiffness": "van_gelder"}),
        ("conductivity_W_mK", {"conductance": "area"}),
    ],
)
def test_schemes_that_know_no_change_with_temperature_are_refused(tmp_path: Path, name: str, flight: dict[str, Any]):
    value = film()[0]["material"][name]
    scene = dark(2, sail={"sectors": changing(name, [[300.0, value], [900.0, 2 * value]])}, flight=flight)
    with pytest.raises(InputError, match=r"for a material that changes with temperature"):
        model.build(scene, {})


# Heat on nodes of next to no mass


def thin(kelvin: float, **flight: Any) -> Scene:
    """A dark film without elasticity to speak of, thin enough to radiate its heat away within a few steps."""
    return dark(
        2,
        sail={"sectors": film(thickness_m=1e-10)},
        effects={"expansion": False, "thermal_failure": False},
        flight={"start_temperature_K": kelvin, "heat_every": 1, "series_every": 1, **flight},
    )


def test_temperature_to_the_fourth_on_a_node_of_tiny_mass_is_refused_or_right(tmp_path: Path):
    """The fastest rate 4σεT³/(ρhc) + 2ΣG/C times the step must be below 2; below it T falls to the fourth power law."""
    areal = 2700.0 * 1e-10
    scene = thin(1500.0, duration_s=1e-3)
    flight = Flight(altered(scene, flight={"time_step_s": 4e-7}), {}, tmp_path / "short")
    rows = steps(flight, 200)
    mean = column(rows, "temperature_mean")
    time = column(rows, "time") - column(rows, "time")[0]
    rate = 4.0 * SIGMA * 0.2 * 1500.0**3 / (areal * CAPACITY)
    assert 0.2 < rate * flight.model.dt < 2.0
    assert np.all(np.diff(mean) < 0)
    # The steps are explicit: their error is of first order in the first rate, and gone when the sail has cooled
    want = (1500.0**-3 + 3.0 * SIGMA * 0.2 * time / (areal * CAPACITY)) ** (-1 / 3)
    assert np.abs(mean / want - 1.0).max() < 0.5 * rate * flight.model.dt
    assert mean[-1] == pytest.approx(want[-1], rel=0.02)
    with pytest.raises(InputError, match=r"flight\.heat_every = 12: so many steps of 4e-07 s must be below"):
        Flight(altered(scene, flight={"time_step_s": 4e-7, "heat_every": 12}), {}, tmp_path / "long")


def test_the_bound_of_heat_is_that_of_its_explicit_steps(tmp_path: Path):
    """A little below it a rough temperature field calms down, above it (which no scene may ask for) it blows up."""
    quick = {**COLD, "conductivity_W_mK": 1e9}
    scene = dark(3, sail={"sectors": film(**quick)}, effects={"conduction": True, "expansion": False})
    heat = Flight(altered(scene, flight={"duration_s": 1e-6, "time_step_s": 1e-9, "heat_every": 1}), {}, tmp_path)
    mesh, m = heat.membrane.mesh, heat.model.effects.heat
    rate = 2.0 * np.bincount(mesh.edges.ravel(), np.repeat(m.conductance, 2)) * m.per_capacity
    limit = 2.0 / rate.max()
    scene = altered(scene, flight={"duration_s": 1e-6})
    with pytest.raises(InputError, match=r"flight\.heat_every = 1: so many steps of .* must be below"):
        Flight(altered(scene, flight={"time_step_s": 1.001 * limit, "heat_every": 1}), {}, tmp_path)
    for factor, calms in ((0.999, True), (2.2, False)):
        flight = Flight(altered(scene, flight={"time_step_s": 0.999 * limit, "heat_every": 1}), {}, tmp_path)
        flight = flight if calms else longer(flight, factor / 0.999)
        flight.state.temperature[:] += np.random.default_rng(4).standard_normal(flight.state.temperature.size)
        before = np.ptp(flight.state.temperature)
        for _ in range(200):
            flight.state.temperature[:] += flight.model.dt * heating(flight)
        assert (np.ptp(flight.state.temperature) < before) == calms
