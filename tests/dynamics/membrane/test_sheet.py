"""Constant-strain triangles: the elastic sheet against finite elements, closed forms of discs and drums, breakage."""

from pathlib import Path

import numpy as np
import pytest
import skfem
from scipy.optimize import brentq
from scipy.sparse import csr_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh, spsolve
from scipy.special import j0, j1, jn_zeros
from skfem.models.elasticity import lame_parameters, linear_elasticity

from dynamics.membrane import lattice
from dynamics.membrane.build import build
from dynamics.membrane.effects import tearing
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.output.record import COLUMNS, WIDTH
from dynamics.membrane.stepping.step import run
from dynamics.membrane.strains import strains
from dynamics.sail.mesh import Mesh, sail_mesh
from dynamics.scene.materials import MATERIALS
from dynamics.scene.schema import Scene
from tests.membranes import (
    DRUM_MODES,
    FIG6,
    altered,
    dark,
    drum_mode,
    film,
    heating,
    stencil_forces,
    steps,
    tensions,
)
from tests.synthetic import smooth_tables

YOUNG, POISSON, DENSITY, THICKNESS, RADIUS = 270e9, 0.27, 2700.0, 400e-9, 0.5
TWO_DIMENSIONS = np.array([True, True, False])


def meshed(rings: int) -> tuple[Scene, Mesh, np.ndarray]:
    """A disc of nitride, its mesh and its node masses."""
    scene = dark(rings)
    mesh = sail_mesh(scene.sail)
    return scene, mesh, lattice.lump(mesh, lattice.per_triangle(scene.sail, mesh, "areal_mass"))


def in_plane(mesh: Mesh, matrix: csr_matrix) -> csr_matrix:
    keep = np.flatnonzero(np.tile(TWO_DIMENSIONS, len(mesh.nodes)))
    return matrix[keep][:, keep]


# Statics


def test_the_stiffness_matrix_is_that_of_linear_finite_elements():
    """Against scikit-fem: linear triangles in plane stress, λ* = 2λμ/(λ + 2μ)."""
    scene, mesh, _ = meshed(3)
    nodes = mesh.nodes.copy()
    nodes[:, :2] += 0.02 * np.random.default_rng(2).standard_normal((len(nodes), 2))  # no symmetry helps
    mesh = Mesh(nodes, mesh.triangles, mesh.sector, mesh.cos_across, mesh.sin_across, mesh.reference_node)
    lame, mu = lame_parameters(YOUNG * THICKNESS, POISSON)
    grid = skfem.MeshTri(nodes[:, :2].T, mesh.triangles.T)
    basis = skfem.Basis(grid, skfem.ElementVector(skfem.ElementTriP1()))
    want = linear_elasticity(2 * lame * mu / (lame + 2 * mu), mu).assemble(basis).toarray()
    order = np.argsort(basis.nodal_dofs.T.ravel())
    got = in_plane(mesh, lattice.sheet_matrix(scene.sail, mesh)).toarray()[order][:, order]
    assert np.abs(got - want).max() < 1e-12 * np.abs(want).max()


def test_a_sheet_is_slack_where_it_would_have_to_bear_pressure():
    """Drawn along x it narrows by ν times that without stress across, by more under pressure. Heat makes it wider."""
    scene = altered(FIG6, sail={"rings": 3})
    sail = build(scene, smooth_tables())
    rest, cold = sail.mesh.nodes, np.full(len(sail.mesh.nodes), 300.0)

    def slack(along: float, across: float, temperature: np.ndarray = cold) -> set[float]:
        found = strains(sail, rest * (1 + np.array([along, across, 0.0])), temperature)[1]
        assert found is not None
        assert found.shape == sail.mesh.areas.shape
        return set(found)

    assert slack(0.0, 0.0) == {0.0}
    assert slack(1e-4, -0.99e-4 * POISSON) == {0.0}
    assert slack(1e-4, -1.01e-4 * POISSON) == {1.0}
    assert slack(0.0, 0.0, cold + 10.0) == {1.0}
    assert slack(2.4e-5, 2.4e-5, cold + 10.0) == {0.0}


def spun(rings: int, omega: float) -> tuple[Mesh, np.ndarray]:
    """Displacements (n, 2) in m of a disc that spins steadily, from the linear stiffness."""
    scene, mesh, masses = meshed(rings)
    matrix = in_plane(mesh, lattice.sheet_matrix(scene.sail, mesh))
    load = (masses[:, None] * omega**2 * mesh.nodes[:, :2]).ravel()
    free = np.setdiff1d(np.arange(load.size), [0, 1, 2 * mesh.reference_node + 1])
    turn = np.array([[np.cos(np.pi / 6), np.sin(np.pi / 6)], [-np.sin(np.pi / 6), np.cos(np.pi / 6)]])
    assert np.allclose((turn @ mesh.nodes[mesh.reference_node, :2]), [RADIUS, 0.0])
    # Turn the axes so that the pinned node can only move outward
    blocks = csr_matrix(np.kron(np.eye(len(mesh.nodes)), turn))
    u = np.zeros(load.size)
    turned = (blocks @ matrix @ blocks.T).tocsr()
    u[free] = spsolve(turned[free][:, free], (blocks @ load)[free])
    return mesh, (blocks.T @ u).reshape(-1, 2)


def polar_stress(mesh: Mesh, u: np.ndarray) -> np.ndarray:
    """σ_r and σ_θ (t, 2) in Pa of displacements u (n, 2) on linear triangles."""
    x, d = mesh.nodes[mesh.triangles][..., :2], u[mesh.triangles]
    gradient = np.swapaxes(np.linalg.solve(x[:, 1:] - x[:, :1], d[:, 1:] - d[:, :1]), 1, 2)
    strain = 0.5 * (gradient + np.swapaxes(gradient, 1, 2))
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
    stress = YOUNG / (1 - POISSON**2) * ((1 - POISSON) * strain + POISSON * trace * np.eye(2))
    out = x.mean(axis=1) / np.linalg.norm(x.mean(axis=1), axis=1, keepdims=True)
    round_ = np.stack([-out[:, 1], out[:, 0]], axis=1)
    return np.stack([np.einsum("ti,tij,tj->t", axis, stress, axis) for axis in (out, round_)], axis=1)


def test_stress_of_a_spinning_disc_converges_to_the_closed_form_at_first_order():
    """σ_r = (3 + ν)ρΩ²(R² − r²)/8, σ_θ = ρΩ²((3 + ν)R² − (1 + 3ν)r²)/8 (Timoshenko & Goodier, §32)."""
    omega, errors = 2 * np.pi * 120.0, []
    for rings in (6, 12, 24):
        mesh, u = spun(rings, omega)
        r2 = (mesh.nodes[mesh.triangles].mean(axis=1) ** 2).sum(axis=1)
        want = (
            DENSITY
            * omega**2
            / 8
            * np.stack([(3 + POISSON) * (RADIUS**2 - r2), (3 + POISSON) * RADIUS**2 - (1 + 3 * POISSON) * r2], axis=1)
        )
        off = polar_stress(mesh, u) - want
        errors.append(np.sqrt(mesh.areas @ off**2 / (mesh.areas @ want**2)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(rates > 0.9)
    assert np.all(rates[-1] > 0.95)
    assert np.all(errors[-1] < 0.03)


def test_the_rim_of_a_spinning_disc_moves_as_the_closed_form_says_at_second_order():
    """ρΩ²R³(1 − ν)/(4Y)."""
    omega, errors = 2 * np.pi * 120.0, []
    for rings in (6, 12, 24):
        mesh, u = spun(rings, omega)
        rim = np.unique(mesh.edges[mesh.rim])
        got = np.sum(u[rim] * mesh.nodes[rim, :2], axis=1).mean() / RADIUS
        errors.append(abs(got / (DENSITY * omega**2 * RADIUS**3 * (1 - POISSON) / (4 * YOUNG)) - 1))
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 1.9)
    assert errors[-1] < 1e-3


def edge_tensions(scene: Scene, x: np.ndarray, folder: Path) -> csr_matrix:
    """Geometric stiffness (n, n) in N/m of the sheet at nodes x (3, n): forces across it per displacement across it."""
    flight = Flight(scene, {}, folder)
    a, b = flight.membrane.mesh.edges.T
    k, n = tensions(flight, x), x.shape[1]
    matrix = csr_matrix((np.concatenate([-k, -k]), (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(n, n))
    return (matrix - diags(np.asarray(matrix.sum(axis=1)).ravel())).tocsr()


def test_a_stretched_membrane_bulges_under_pressure_as_the_closed_form_says(tmp_path: Path):
    """w = p(R² − r²)/(4T) (Timoshenko & Woinowsky-Krieger, §92), second order in the mesh."""
    errors = []
    for rings in (8, 16, 32):
        scene, mesh, _ = meshed(rings)
        stretch = 1e-4
        tension = YOUNG * THICKNESS / (1 - POISSON) * stretch
        matrix = edge_tensions(scene, (mesh.nodes * (1 + stretch)).T, tmp_path)
        load = lattice.lump(mesh, np.ones(len(mesh.triangles))) * 10.0
        inside = np.setdiff1d(np.arange(len(mesh.nodes)), mesh.edges[mesh.rim])
        w = spsolve(matrix[inside][:, inside], load[inside])
        errors.append(abs(w[0] / (10.0 * RADIUS**2 / (4 * tension)) - 1))
    assert errors[-1] < 1e-3
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 1.75)


# Vibration


def nearest_mode(matrix: csr_matrix, masses: np.ndarray, guess: float, shape: np.ndarray) -> float:
    """Frequency in rad/s of the mode near `guess` that looks most like `shape`."""
    scale = diags(1 / np.sqrt(masses))
    values, vectors = eigsh((scale @ matrix @ scale).tocsc(), k=6, sigma=(0.98 * guess) ** 2, v0=np.ones(masses.size))
    return float(np.sqrt(values[np.argmax(np.abs((np.sqrt(masses) * shape) @ vectors))]))


@pytest.mark.parametrize("wave", ["longitudinal", "shear"])
def test_waves_travel_at_the_speeds_of_a_plate(wave: str):
    """A free disc breathes at ωR/c with xJ₀(x) = (1 − ν)J₁(x), c² = Y/(ρ(1 − ν²)), and twists at J₂(x) = 0 with
    c² = Y/(2ρ(1 + ν)) (Love, Theory of Elasticity, §314)."""
    if wave == "longitudinal":
        root = brentq(lambda x: x * j0(x) - (1 - POISSON) * j1(x), 1.0, 3.0)
        speed = np.sqrt(YOUNG / (DENSITY * (1 - POISSON**2)))
    else:
        root, speed = jn_zeros(2, 1)[0], np.sqrt(YOUNG / (2 * DENSITY * (1 + POISSON)))
    errors = []
    for rings in (6, 12, 24):
        scene, mesh, masses = meshed(rings)
        r = np.maximum(np.linalg.norm(mesh.nodes, axis=1, keepdims=True), 1e-12)
        along = mesh.nodes[:, :2] if wave == "longitudinal" else mesh.nodes[:, 1::-1] * [-1.0, 1.0]
        shape = along / r * j1(root * r / RADIUS)
        matrix = in_plane(mesh, lattice.sheet_matrix(scene.sail, mesh))
        got = nearest_mode(matrix, np.repeat(masses, 2), root * speed / RADIUS, shape.ravel())
        errors.append(abs(got * RADIUS / (root * speed) - 1))
    assert errors[-1] < 4e-3
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 1.7)


@pytest.mark.parametrize(("diameters", "circles"), DRUM_MODES)
def test_drum_modes_of_a_spinning_membrane(tmp_path: Path, diameters: int, circles: int):
    """Frequencies in the turning frame, from the tensions of the sheet where it spins steadily."""
    omega, errors = 2 * np.pi * 120.0, []
    for rings in (12, 24):
        mesh, u = spun(rings, omega)
        scene, _, masses = meshed(rings)
        x = mesh.nodes.copy()
        x[:, :2] += u
        matrix = edge_tensions(scene, x.T, tmp_path)
        ratio, shapes = drum_mode(mesh.nodes, diameters, circles)
        want = omega * ratio
        scale = diags(1 / np.sqrt(masses))
        scaled = (scale @ matrix @ scale).tocsc()
        values, vectors = eigsh(scaled, k=8, sigma=(0.99 * want) ** 2, v0=np.ones(len(masses)))
        like = (((np.sqrt(masses) * shapes) @ vectors) ** 2).sum(axis=0)
        errors.append(abs(np.sqrt(values[np.argmax(like)]) / want - 1))
    assert errors[1] < 0.012
    assert errors[1] < 0.4 * errors[0] or errors[1] < 1e-3


# Motion

ENERGIES = [COLUMNS["energy_kinetic"], COLUMNS["energy_elastic"]]


def test_energy_does_not_drift_over_a_million_steps(tmp_path: Path):
    flight = Flight(dark(1, flight={"series_every": 100}), {}, tmp_path)
    flight.state.x[...] *= 1.0 + 1e-3
    flight.state.x[2] = 1e-2 * flight.state.x[0] ** 2
    flight.state.v[...] = [-40.0 * flight.state.x[1], 40.0 * flight.state.x[0], 8.0 * flight.state.x[0]]
    energy = steps(flight, 1_000_000)[:, ENERGIES].sum(axis=1)
    first, last = energy[:1000].mean(), energy[-1000:].mean()
    assert abs(last - first) < 2e-3 * np.ptp(energy[:1000])


@pytest.mark.parametrize(("spin", "reason"), [(450.0, "finished"), (480.0, "tensile_failure")])
def test_a_silicon_disc_tears_between_450_and_480_turns_a_second(spin: float, reason: str):
    """The stress at the centre, (3 + ν)ρΩ²R²/8, reaches the strength of 2.1 GPa at 473 Hz."""
    silicon = {**MATERIALS["silicon_43nm"].model_dump(), "emissivity_front": 0.0, "emissivity_back": 0.0}
    scene = dark(
        10,
        sail={"sectors": [{"from_deg": 0.0, "material": silicon, "reflectance": 0.0}]},
        release={"spin_Hz": -spin},
        flight={"spin_up_s": 0.02, "duration_s": 1e-4},
    )
    end = fly(scene, {})[1]
    assert end.reason == reason
    if reason != "finished":
        assert np.linalg.norm(end.position[:2]) < 0.1


# Hard cases


def test_a_triangle_turned_over_and_shrunk_to_nothing_pulls_finitely(tmp_path: Path):
    flight = Flight(dark(2, effects={"tensile_failure": False}), {}, tmp_path)
    for factor in (1.0, 0.0, -1.0):
        x = flight.model.rest * np.array([[factor], [1.0], [1.0]])
        force, bad = stencil_forces(flight, x)
        assert bad == 0
        assert np.isfinite(force).all()
        size = np.abs(tensions(flight, x)).max() * 0.5
        assert np.abs(force.sum(axis=1)).max() < 1e-14 * max(size, 1e-6)
    # Turned over, its sides have their lengths again: no force
    assert np.abs(force).max() < 1e-9


def test_a_sail_that_folds_flat_keeps_its_energy_and_momentum(tmp_path: Path):
    """Two halves close like a book in 10 ms and go through each other: the error of the energy is of order Δt²."""
    swing = []
    for dt in (4e-6, 2e-6):
        flight = Flight(dark(5, effects={"tensile_failure": False}, flight={"time_step_s": dt}), {}, tmp_path)
        x, masses = flight.model.rest, flight.model.masses
        flight.state.v[2] = 150.0 * np.abs(x[0])
        flight.state.v[2] -= masses @ flight.state.v[2] / masses.sum()
        rows, width = [], []
        for k in range(16):
            rows.append(steps(flight, round(1e-3 / dt), k == 0))
            width.append(np.abs(flight.state.x[0]).mean())
        energy = np.concatenate(rows)[:, ENERGIES].sum(axis=1)
        swing.append(np.ptp(energy) / energy[0])
        assert np.linalg.norm(rows[-1][-1, 4:7]) < 1e-12 * 150.0
        assert min(width) < 0.3 * np.abs(x[0]).mean()
    assert swing[0] < 1e-3
    assert 3.0 < swing[0] / swing[1] < 5.0


def test_run_is_the_same_to_the_bit(tmp_path: Path):
    ends = []
    for _ in range(2):
        flight = Flight(dark(4), {}, tmp_path)
        flight.state.x[...] *= 1.001
        rows = np.empty((300, WIDTH))
        run(flight.model, flight.state, flight.work, 0, 500, True, rows)
        ends.append(flight.state.x.copy())
    assert np.array_equal(*ends)


def pieces(flight: Flight) -> int:
    """Connected parts of what is left of a sail."""
    mesh, left = flight.membrane.mesh, flight.work.effects.tearing.gone == 0
    pairs = mesh.edges[np.unique(mesh.triangle_edges[left])]
    ones, n = np.ones(len(pairs)), len(mesh.nodes)
    _, label = connected_components(csr_matrix((ones, pairs.T), shape=(n, n)), directed=False)
    return len(np.unique(label[mesh.triangles[left]]))


def test_a_sail_torn_in_two_flies_on_in_two_pieces(tmp_path: Path):
    """Halves thrown apart at 900 m/s: the middle tears, momentum stays, energy never grows."""
    scene = dark(8, flight={"on_failure": "remove", "series_every": 1}, effects={"emission": False})
    flight = Flight(scene, {}, tmp_path)
    x = flight.model.rest
    flight.state.v[0] = 900.0 * np.sign(np.round(x[0], 9))
    momentum = flight.model.masses @ flight.state.v[0]
    rows = steps(flight, 400)
    energy = rows[:, COLUMNS["energy_kinetic"]] + rows[:, COLUMNS["energy_elastic"]]
    assert pieces(flight) >= 2
    broken = flight.work.effects.tearing
    assert broken.tally[0] == broken.gone.sum() == rows[-1, COLUMNS["failed_tensile"]] > 10
    assert np.all(np.diff(energy) < 2e-3 * energy[0])
    assert energy[-1] < energy[0]
    assert abs(flight.model.masses @ flight.state.v[0] - momentum) < 1e-12 * 900.0 * flight.model.masses.sum()
    left, right = (np.abs(flight.state.v[0][side]).mean() for side in (x[0] < -0.2, x[0] > 0.2))
    assert min(left, right) > 600.0


def test_recorded_failures_leave_the_flight_as_it_was(tmp_path: Path):
    """'record' only counts: bits as without the effect, until too many have failed."""
    groups = {"release": {"spin_Hz": -850.0}, "flight": {"spin_up_s": 2e-3, "duration_s": 1e-5}}
    recorded = fly(dark(5, **{**groups, "flight": {**groups["flight"], "on_failure": "record"}}), {})
    free = fly(dark(5, **groups, effects={"tensile_failure": False}), {})
    assert recorded[1].reason == free[1].reason == "finished"
    assert np.array_equal(recorded[0].state.x, free[0].state.x)
    failed = recorded[2]["failed_tensile"]
    assert 0 < failed[-1] < 150
    assert np.all(np.diff(failed) >= 0)
    limited = {**groups["flight"], "on_failure": "record", "broken_fraction": 0.0}
    assert fly(dark(5, **{**groups, "flight": limited}), {})[1].reason == "broken"


def test_what_burns_is_removed_and_takes_no_more_light():
    scene = dark(
        4,
        sail={"sectors": [{**film(absorptance=a)[0], "from_deg": start} for start, a in ((30.0, 1e-3), (210.0, 0.0))]},
        beam={"intensity_W_m2": 1e9, "radius_m": 100.0},
        flight={"duration_s": 3e-3, "fly_away_m": 1e9, "on_failure": "remove"},
        effects={"conduction": False},
    )
    flight, end, series = fly(scene, {})
    assert end.reason == "finished"
    gone = flight.work.effects.tearing.gone == 1
    assert np.array_equal(gone, flight.membrane.mesh.sector == 0)
    assert series["failed_thermal"][-1] == gone.sum() == 48
    assert series["power_absorbed"][-1] == 0.0
    assert series["power_incident"][-1] == pytest.approx(0.5 * series["power_incident"].max(), rel=1e-2)


def test_a_sail_of_which_nothing_is_left_is_broken_not_lost_in_numbers():
    flight = {"duration_s": 2e-3, "on_failure": "remove", "broken_fraction": 0.9, "fly_away_m": 1e9}
    scene = dark(2, sail={"sectors": film(strength_Pa=1e5)}, release={"spin_Hz": -120.0}, flight=flight)
    flown, end, series = fly(scene, {})
    assert end.reason == "broken"
    assert flown.work.effects.tearing.gone.mean() > 0.9
    assert all(np.isfinite(values).all() for values in series.values())


def test_half_a_strip_conducts_half_as_much(tmp_path: Path):
    """T = 400 + 100 x: heat κ h b |∇T| crosses a sheet of breadth b, half of it once the half y > 0 is removed."""
    cold = film(emissivity_front=0.0, emissivity_back=0.0)
    scene = dark(
        6,
        sail={"outline": "square", "rotation_deg": 0.0, "sectors": cold},
        flight={"on_failure": "remove"},
        effects={"conduction": True, "thermal_failure": False},
    )
    flight = Flight(scene, {}, tmp_path)
    model, work, state = flight.model, flight.work, flight.state
    own, now = model.effects, work.effects
    state.temperature[...] = 400.0 + 100.0 * model.rest[0]
    capacity, left = 1.0 / own.heat.per_capacity, model.rest[0] < -1e-9

    def flow() -> float:
        """W into the half x < 0, which touches x = 0 along edges only."""
        return float(np.sum((capacity * heating(flight))[left]))

    breadth = np.ptp(model.rest[1])
    assert flow() == pytest.approx(3.0 * 400e-9 * breadth * 100.0, rel=1e-12)
    for half, share in ((1.0, 0.5), (-1.0, 0.0)):
        now.sheet.limit[half * model.rest[1][model.triangles.corners].mean(axis=0) > 0.0] = -1.0
        tearing.tear(
            now.tearing,
            own.sheet,
            now.sheet,
            now.heat,
            now.light,
            model.stencil,
            work.stencil,
            own.springs,
            model.triangles.corners,
            state.x,
            0.0,
        )
        assert flow() == pytest.approx(share * 3.0 * 400e-9 * breadth * 100.0, rel=1e-12)
    assert now.tearing.gone.all()
    assert not now.heat.conductance.any()
