"""Shapes and regions of sails: counts, positions, areas and masses; what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from beamrider.io.files import InputError
from dynamics.membrane import lattice
from dynamics.membrane.build import build
from dynamics.membrane.plan import plan
from dynamics.sail import mesh_checks, shapes
from dynamics.sail.attitude import rotation_from_angles
from dynamics.sail.mesh import Mesh, sail_mesh
from dynamics.sail.sectors import sail_shape
from dynamics.scene.sail_schema import Sail
from dynamics.scene.schema import read_scene
from tests.membranes import FIG6, altered

SCENES = Path(__file__).parents[3] / "workflow" / "scenes"
SILICON = {"from_deg": 0.0, "material": "silicon_43nm", "reflectance": 0.45}


def sail(**given: Any) -> Sail:
    """A silicon sail of half a metre, turned by 30°."""
    plain = {"radius_m": 0.5, "rings": 24, "rotation_deg": 30.0, "sectors": [SILICON]}
    return Sail.model_validate({**plain, **given})


def mass(given: Sail) -> float:
    m = sail_mesh(given)
    return float(lattice.lump(m, lattice.per_triangle(given, m, "areal_mass")).sum())


@pytest.mark.parametrize(("outline", "sides"), [("round", 6), ("hexagonal", 6), ("square", 8)])
@pytest.mark.parametrize("rings", [1, 2, 5, 24])
def test_counts_of_nodes_triangles_and_edges(outline: str, sides: int, rings: int):
    m, n = sail_mesh(sail(outline=outline, rings=rings)), rings
    rim, k = sides * n, sides // 2
    assert len(m.nodes) == (1 + k * n + k * n**2 if sides == 6 else (2 * n + 1) ** 2)
    assert len(m.triangles) == sides * n**2
    assert len(m.edges) == (9 * n**2 + 3 * n if sides == 6 else 12 * n**2 + 4 * n)
    assert m.rim.sum() == rim
    a, b, c = (m.nodes[m.triangles[:, i], :2] for i in range(3))
    assert np.all(np.cross(b - a, c - a) > 0)


ROUND = {"outline": "round", "profile": "paraboloid", "depth": 1.4}


@pytest.mark.parametrize(
    ("given", "area", "kilograms", "rim", "depth"),
    [
        ({"outline": "hexagonal"}, 0.649519, 6.5075e-5, 0.5, 0.0),
        ({"outline": "round"}, 0.785149, 7.8664e-5, 0.5, 0.0),
        (ROUND, 0.837846, 8.3944e-5, 0.386498, 0.418267),
        ({**ROUND, "rescale": True}, 1.402197, 1.40486e-4, 0.5, 0.541098),
        ({**ROUND, "outline": "hexagonal", "rescale": True}, 1.092958, 1.09503e-4, 0.5, 0.541098),
        ({**ROUND, "depth": 1.05, "rescale": True}, 1.226460, 1.22879e-4, 0.5, 0.436379),
        ({**ROUND, "depth": 0.48, "rescale": True}, 0.928705, 9.3047e-5, 0.5, 0.226242),
    ],
)
def test_areas_masses_and_depths_of_published_shapes(
    given: dict[str, Any], area: float, kilograms: float, rim: float, depth: float
):
    """Of Gao, Kelzenberg & Atwater's specular sails, 43 nm of silicon."""
    m = sail_mesh(sail(**given))
    assert m.areas.sum() == pytest.approx(area, rel=1e-6)
    assert mass(sail(**given)) == pytest.approx(kilograms, rel=2e-5)
    assert np.hypot(*m.nodes[:, :2].T).max() == pytest.approx(rim, rel=2e-6)
    assert -m.nodes[:, 2].min() == pytest.approx(depth, abs=1e-6)
    assert m.nodes[:, 2].max() == 0.0


def test_rim_slope_and_focus_of_the_deep_paraboloid():
    """Slope 65.2°, focal length 0.0893 m, 0.1155 m when it is stretched to the full radius."""
    given = sail(**ROUND)
    rim = shapes.seed_radii(given)[-1]
    assert np.degrees(np.arctan(2 * 1.4 * rim / 0.5)) == pytest.approx(65.2, abs=0.05)
    nodes = shapes.shape_nodes(given)[1:]
    assert np.allclose((nodes[:, :2] ** 2).sum(axis=1) / (-4 * nodes[:, 2]), 0.0893, atol=5e-5)
    nodes = shapes.shape_nodes(sail(**ROUND, rescale=True))[1:]
    assert np.allclose((nodes[:, :2] ** 2).sum(axis=1) / (-4 * nodes[:, 2]), 0.1155, atol=5e-5)


@pytest.mark.parametrize("profile", ["paraboloid", "cone", "sphere"])
@pytest.mark.parametrize("outline", ["round", "hexagonal", "square"])
def test_smooth_surfaces_hold_every_node_and_faceted_ones_plane_rings(outline: str, profile: str):
    smooth = sail(outline=outline, profile=profile, depth=0.6, rings=6)
    nodes = shapes.shape_nodes(smooth)
    r = np.hypot(*nodes[:, :2].T) / (np.sqrt(2.0) if (outline, profile) == ("square", "sphere") else 1.0)
    assert np.allclose(nodes[:, 2], shapes.height(smooth, r), atol=1e-14)
    faceted = shapes.shape_nodes(smooth.model_copy(update={"surface": "faceted"}))
    for n in range(1, 7):
        ring = faceted[shapes.ring_start(outline, n) : shapes.ring_start(outline, n + 1), 2]
        assert np.ptp(ring) < 1e-15
        assert ring[0] == pytest.approx(float(shapes.height(smooth, shapes.seed_radii(smooth)[n])), abs=1e-15)


def test_rings_of_spheres_and_cones_are_evenly_spaced_along_the_slope():
    for profile in ("sphere", "cone"):
        nodes = shapes.shape_nodes(sail(profile=profile, depth=0.5, rings=20, rotation_deg=0.0))
        along = nodes[[shapes.ring_start("round", n) for n in range(21)]]
        hops = np.linalg.norm(np.diff(along, axis=0), axis=1)
        assert np.allclose(hops, hops[0], rtol=1e-12)
        assert hops.sum() == pytest.approx(0.5, rel=1e-3)


def test_negative_depth_turns_the_sail_round():
    up, down = (shapes.shape_nodes(sail(profile="cone", depth=d, rings=3)) for d in (0.5, -0.5))
    assert np.array_equal(up * [1.0, 1.0, -1.0], down)


def test_the_order_of_nodes_on_polygons():
    """One hop after the first corner on +x (hexagon) or +x −y (square); that corner comes last, and defines yaw 0."""
    hexagon = shapes.shape_nodes(sail(outline="hexagonal", rings=2, rotation_deg=0.0))
    assert np.allclose(hexagon[7], [0.5 - 0.125, 0.125 * np.sqrt(3.0), 0.0])
    assert np.allclose(hexagon[shapes.reference_node(sail(outline="hexagonal", rings=2))], [0.5, 0.0, 0.0])
    square = shapes.shape_nodes(sail(outline="square", rings=2, rotation_deg=0.0))
    assert np.allclose(square[9], [0.5, -0.25, 0.0])
    assert np.allclose(square[shapes.reference_node(sail(outline="square", rings=2))], [0.5, -0.5, 0.0])


def test_the_sails_of_fig_3_have_equal_areas_and_those_of_fig_4_a_metre_of_diameter():
    scenes = {path.stem: read_scene(path) for path in SCENES.glob("fig[34]_*.yaml")}
    assert len(scenes) == 7
    areas = {name: sail_mesh(scene.sail).areas.sum() for name, scene in scenes.items()}
    third = [area for name, area in areas.items() if name.startswith("fig3")]
    assert np.ptp(third) < 3e-4 * third[0]
    assert third[0] * 2330 * 43e-9 == pytest.approx(6.5075e-5, rel=3e-4)
    for name in ("fig4_direct", "fig4_reflections"):
        assert np.hypot(*sail_mesh(scenes[name].sail).nodes[:, :2].T).max() == pytest.approx(0.5, rel=1e-12)
        assert plan(scenes[name])["reflections"].on == (name == "fig4_reflections")


# Regions


def test_a_rim_and_a_grid_lie_over_the_sectors():
    thick = {"material": "silicon_43nm", "thickness_m": 86e-9, "reflectance": 0.3}
    given = sail(
        sectors=[SILICON, {**SILICON, "from_deg": 180.0}],
        rim={"from_m": 0.4, "sectors": [{**thick, "from_deg": 0.0}]},
        grid={"x_m": [0.0], "y_m": [0.2], "regions": [[None, None], [None, {**thick, "thickness_m": 43e-8}]]},
    )
    m = sail_mesh(given)
    centre = m.nodes[m.triangles].mean(axis=1)
    want = np.where(centre[:, 1] >= 0, 0, 1)
    want = np.where(np.hypot(*centre[:, :2].T) >= 0.4, 2, want)
    want = np.where((centre[:, 0] >= 0) & (centre[:, 1] >= 0.2), 3, want)
    clear = np.abs(centre[:, 1]) > 1e-9  # of the boundary between the sectors
    assert np.array_equal(m.sector[clear], want[clear])
    thickness = lattice.per_triangle(given, m, "thickness_m")
    assert np.array_equal(np.unique(thickness[m.sector == 2]), [86e-9])
    assert mass(given) == pytest.approx(2330 * float(thickness @ m.areas), rel=1e-12)


@pytest.mark.parametrize(("g", "sign"), [("radial", 1), ("-radial", -1), ("tangential", 1), ("-tangential", -1)])
def test_radial_and_tangential_directions_lie_in_the_triangles(g: str, sign: int):
    given = sail(profile="paraboloid", depth=1.0, rings=5, sectors=[{**SILICON, "g": g}])
    m = sail_mesh(given)
    x = m.nodes[m.triangles]
    first = (x[:, 1] - x[:, 0]) / np.linalg.norm(x[:, 1] - x[:, 0], axis=1, keepdims=True)
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = m.cos_across[:, None] * first + m.sin_across[:, None] * np.cross(normal, first)
    out = x.mean(axis=1) * [1.0, 1.0, 0.0]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    want = sign * (out if "radial" in g else np.cross([0.0, 0.0, 1.0], out))
    want -= np.sum(want * normal, axis=1, keepdims=True) * normal
    want /= np.linalg.norm(want, axis=1, keepdims=True)
    assert np.allclose(across, want, atol=1e-12)


# What is refused


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"profile": "cone"}, "depth: must be given for curved profiles"),
        ({"depth": 1.0}, "and for them only"),
        ({"profile": "sphere", "depth": 0.9}, "must be from -0.8 to 0.8"),
        ({"outline": "oval"}, "outline"),
        ({"grid": {"x_m": [0.0], "regions": [[None]]}}, "must be 1 rows .* of 2 entries"),
        ({"rim": {"from_m": 0.4, "sectors": [SILICON, SILICON]}}, "from_deg must ascend"),
    ],
)
def test_shapes_that_contradict_themselves_are_refused(given: dict[str, Any], message: str):
    with pytest.raises(ValidationError, match=message):
        sail(**given)


@pytest.mark.parametrize("given", [{"outline": "square"}, {**ROUND}, {"sectors": [{**SILICON, "g": "radial"}]}])
def test_the_rigid_model_refuses_what_it_cannot_fly(given: dict[str, Any]):
    with pytest.raises(InputError, match=r"sail\.(outline|profile|sectors\[0\]\.g) = '(square|paraboloid|radial)': "):
        sail_shape(sail(**given))


def without(m: Mesh, triangles: list[int]) -> Mesh:
    keep = np.setdiff1d(np.arange(len(m.triangles)), triangles)
    return replace(m, triangles=m.triangles[keep], sector=m.sector[keep])


def test_slivers_holes_pieces_and_shadows_are_refused_by_name():
    m = sail_mesh(sail(rings=4))
    mesh_checks.check_mesh(m, "sail")
    inner = [i for i, t in enumerate(m.triangles) if 0 in t]
    second = [i for i, t in enumerate(m.triangles) if len({*t} & set(range(7, 19))) > 0 and 0 not in t]
    for broken, message in (
        (without(m, inner), "has 1 holes"),
        (without(m, second), "2 pieces"),
        (replace(m, nodes=m.nodes * [1.0, 0.01, 1.0]), "is a sliver"),
        (replace(m, nodes=m.nodes * [1.0, -1.0, 1.0]), "turns away from the beam: the sail shades itself"),
    ):
        used, numbers = np.unique(broken.triangles, return_inverse=True)
        broken = replace(broken, nodes=broken.nodes[used], triangles=numbers.reshape(-1, 3))
        with pytest.raises(InputError, match=message) as caught:
            mesh_checks.check_mesh(broken, "s.yaml: sail")
        assert str(caught.value).startswith("s.yaml: sail: ")
    with pytest.raises(InputError, match=r"fig6\.yaml: sail: triangle \d+ is a sliver"):
        build(altered(FIG6, sail=sail(profile="cone", depth=80.0, rings=3).model_dump()), {})


def test_a_deep_sail_must_not_be_released_with_its_rim_in_the_shade():
    m = sail_mesh(sail(**ROUND))
    mesh_checks.check_shadow(m, rotation_from_angles(0.0, np.radians(20.0), 0.0), "s.yaml")
    with pytest.raises(InputError, match="lit from behind and the sail shades itself"):
        mesh_checks.check_shadow(m, rotation_from_angles(0.0, np.radians(30.0), 0.0), "s.yaml")


def test_regions_give_back_no_more_light_than_they_get():
    black = {**FIG6.sail.sectors[0].properties.model_dump(), "absorptance": 0.7}
    scene = altered(FIG6, sail={"rings": 2, "sectors": [{"from_deg": 0.0, "material": black, "reflectance": 0.4}]})
    with pytest.raises(InputError, match=r"fig6\.yaml: sail: region 0: reflectance = 0.4: .* must not exceed 1"):
        build(scene, {})


def test_published_scenes_still_fly(tmp_path: Path):
    assert build(altered(FIG6, sail={"rings": 3}, effects={"light": False}), {}).mesh.nodes.shape == (37, 3)
