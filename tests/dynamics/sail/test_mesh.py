"""The mesh: Euler's formula, areas, orientation, sectors; its lattice: masses, stiffness, conduction, frequency."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.membrane import build as model
from dynamics.membrane import lattice
from dynamics.membrane.effects.interface import slots
from dynamics.sail import mesh, regions
from dynamics.scene.schema import Scene, read_scene

SCENE = read_scene(Path(__file__).parents[3] / "workflow" / "scenes" / "s3.yaml")
SAIL = SCENE.sail


@lru_cache
def meshed(rings: int) -> mesh.Mesh:
    return mesh.sail_mesh(SAIL.model_copy(update={"rings": rings}))


@pytest.mark.parametrize("rings", [1, 2, 3, 30])
def test_counts_follow_the_formulas_of_ring_meshes(rings: int):
    m, n = meshed(rings), rings
    assert (len(m.nodes), len(m.triangles), len(m.edges), m.rim.sum()) == (
        1 + 3 * n + 3 * n**2,
        6 * n**2,
        9 * n**2 + 3 * n,
        6 * n,
    )
    assert len(m.nodes) - len(m.edges) + len(m.triangles) == 1


@pytest.mark.parametrize("rings", [1, 4, 30])
def test_triangles_fill_the_rim_polygon_and_face_downstream(rings: int):
    m = meshed(rings)
    a, b, c = (m.nodes[m.triangles[:, i]] for i in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0)
    assert m.areas.sum() == pytest.approx(3 * rings * SAIL.radius_m**2 * np.sin(np.pi / (3 * rings)), rel=1e-13)


def test_no_edge_has_a_node_beyond_its_circumcircle():
    """Delaunay: the angles opposite an inner edge add up to at most π, so no sum of cotangents is negative."""
    m = meshed(30)
    cotangents = np.bincount(m.triangle_edges.ravel(), lattice._half_cotangent(m).ravel())
    assert cotangents.min() > 0


def test_edges_and_triangles_point_at_each_other():
    m = meshed(5)
    for edge, pair in zip(m.edges, m.edge_triangles, strict=True):
        for triangle in pair[pair >= 0]:
            assert set(edge) <= set(m.triangles[triangle])


def test_the_mesh_of_30_rings_is_the_published_one():
    """Gao, Kelzenberg & Atwater: 2791 nodes, 5400 triangles; sizes, masses and sectors of their sail."""
    m = meshed(30)
    assert m.lengths.min() == pytest.approx(0.016667, abs=1e-6)
    assert m.lengths.max() == pytest.approx(0.023921, abs=1e-6)
    assert m.areas.min() == pytest.approx(1.2028e-4, abs=1e-8)
    assert m.areas.max() == pytest.approx(1.5750e-4, abs=1e-8)
    masses = lattice.lattice(SAIL, m, SCENE.flight).masses
    assert masses.sum() == pytest.approx(8.66903e-4, rel=1e-5)
    assert np.bincount(m.sector).tolist() == [1800, 900, 1800, 900]


def test_no_triangle_straddles_a_sector_boundary():
    m = meshed(30)
    angle = np.degrees(np.arctan2(m.nodes[m.triangles][..., 1], m.nodes[m.triangles][..., 0]))
    for sector, middle in enumerate((90.0, 180.0, 270.0, 0.0)):
        half = 60.0 if sector % 2 == 0 else 30.0
        corners = m.triangles[m.sector == sector]
        off = (angle[m.sector == sector] - middle + 180.0) % 360.0 - 180.0
        assert np.all((np.abs(off) <= half + 1e-9) | (corners == 0))


def test_a_point_on_a_boundary_belongs_to_the_sector_that_starts_there():
    points = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, -1e-3, 0.0]])
    two = [SAIL.sectors[0].model_copy(update={"from_deg": start}) for start in (0.0, 90.0)]
    assert regions.polar_sector(points, two).tolist() == [0, 1, 1]


def test_the_direction_across_the_ridges_turns_with_the_sail():
    m = meshed(4)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    nodes = m.nodes @ turn.T
    first = nodes[m.triangles[:, 1]] - nodes[m.triangles[:, 0]]
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    aside = np.cross([0.0, 0.0, 1.0], first)
    g = m.cos_across[:, None] * first + m.sin_across[:, None] * aside
    rest = np.array([[*s.g, 0.0] for s in SAIL.sectors])[m.sector]
    assert np.allclose(g, rest @ turn.T, atol=1e-14)


@pytest.mark.parametrize(
    ("form", "rim", "low", "high", "frequency"),
    [
        ("lattice", 2.0, 5.49e4, 11.68e4, 2.7862e5),
        ("lattice", 1.0, 5.13e4, 11.68e4, 2.1802e5),
        ("van_gelder", 1.0, 4.38e4, 12.55e4, 2.1751e5),
    ],
)
def test_stiffness_and_highest_frequency_of_the_published_mesh(
    form: str, rim: float, low: float, high: float, frequency: float
):
    m = meshed(30)
    k = lattice.stiffness(SAIL, m, form, rim)
    assert k.min() == pytest.approx(low, rel=1.5e-3)
    assert k.max() == pytest.approx(high, rel=1.5e-3)
    masses = lattice.lattice(SAIL, m, SCENE.flight).masses
    highest = lattice.highest_frequency(lattice.stiffness_matrix(m, k), masses)
    assert highest / (2 * np.pi) == pytest.approx(frequency, rel=5e-5)
    bound = np.sqrt(2 * np.bincount(m.edges.ravel(), np.repeat(k, 2)) / masses).max()
    assert highest <= bound


def test_van_gelder_is_the_lattice_on_equilateral_triangles_of_poisson_ratio_one_third():
    third = SAIL.sectors[0].properties.model_copy(update={"poisson": 1 / 3})
    sail = SAIL.model_copy(
        update={"rings": 1, "sectors": [s.model_copy(update={"material": third}) for s in SAIL.sectors]}
    )
    m = mesh.sail_mesh(sail)
    assert np.allclose(lattice.stiffness(sail, m, "van_gelder"), lattice.stiffness(sail, m, "lattice"), rtol=1e-13)


@pytest.mark.parametrize(
    ("form", "low", "high"),
    [
        ("cotangent", 1.0, 1.0),
        ("area", 1.45, 1.5),
        ("first_triangle", 0.73, 0.77),
    ],
)
def test_conduction_through_a_linear_field(form: str, low: float, high: float):
    """Σ G ΔT² = ∫ κ h |∇T|² dA for a linear field; the other forms err by 3/2 and 3/4."""
    m = meshed(30)
    temperature = m.nodes @ np.array([3.0, -2.0, 0.0])
    sheet = lattice.per_triangle(SAIL, m, "conductivity_W_mK") * lattice.per_triangle(SAIL, m, "thickness_m")
    drop = temperature[m.edges[:, 1]] - temperature[m.edges[:, 0]]
    share = (lattice.over_edges(m, lattice.conductance(SAIL, m, form)) @ drop**2) / (13.0 * sheet @ m.areas)
    assert low * (1 - 1e-12) <= share <= high * (1 + 1e-12)


def test_a_time_step_above_the_bound_is_refused_in_one_line():
    flight = SCENE.flight.model_copy(update={"time_step_s": 1.5e-6, "stiffness": "van_gelder"})
    scene: Scene = SCENE.model_copy(update={"flight": flight})
    m = meshed(30)
    with pytest.raises(InputError, match=r"flight.time_step_s = 1.5e-06: must be below 1.46") as caught:
        model.time_step(scene, m, lattice.lattice(SAIL, m, flight))
    assert "\n" not in str(caught.value)
    rk4 = scene.model_copy(update={"flight": flight.model_copy(update={"integrator": "rk4"})})
    assert model.time_step(rk4, m, lattice.lattice(SAIL, m, flight)) == 1.5e-6


def test_slots_list_every_edge_of_every_node_once():
    m = meshed(3)
    ends = slots(m.edges.ravel(), len(m.nodes), np.arange(m.edges.size), m.edges.size)
    for node in range(len(m.nodes)):
        found = ends[:, node][ends[:, node] < m.edges.size]
        assert sorted(found) == sorted(np.flatnonzero(m.edges.ravel() == node))
