"""How much solid a cell has, and how much of it is continuous."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from optics.cells.cross_section import cross_section
from optics.cells.outline import polygons, staircase
from optics.cells.schema import KINDS, read_cell

DESIGNS = Path(__file__).parents[3] / "workflow" / "designs"
SOLID, VOID = {"n": 2.0, "k": 1e-6}, {"n": 1.0}


def section(**cell: Any) -> Any:
    common = {"name": "x", "wavelength_nm": 1000.0, "electric_axis": "r", "period_nm": 1000.0}
    if cell["kind"] == "thin_film":
        common = {"name": "x", "wavelength_nm": 1000.0}
    return cross_section(KINDS[cell["kind"]].model_validate(common | cell).model_dump())


def slab(top: float, bottom: float, left: float = 0.0, right: float = 1000.0) -> list[list[float]]:
    return [[left, top], [right, top], [right, bottom], [left, bottom]]


def profile(*pieces: Any, depth: float = 1000.0) -> Any:
    return section(kind="profile", depth_nm=depth, polygons=[{"index": i, "vertices_nm": v} for i, v in pieces])


@pytest.mark.parametrize("design", ["mark1e_te", "gap20_te", "wide_gap_te"])
def test_te_cells_of_the_paper_weigh_what_the_library_says_to_the_bit(design):
    found = cross_section(read_cell(DESIGNS / f"{design}.yaml").model_dump())
    assert (found.mean_m, found.membrane_m, found.materials) == (400e-9, 200e-9, 1)


@pytest.mark.parametrize("design", ["mark1e_tm", "gap20_tm", "wide_gap_tm"])
def test_tm_cells_too(design):
    found = cross_section(read_cell(DESIGNS / f"{design}.yaml").model_dump())
    assert (found.mean_m, found.membrane_m, found.materials) == (1240e-9 / 3, 200e-9, 1)


@pytest.mark.parametrize("design", ["rounded_te", "rounded_tm"])
def test_rounded_corners_weigh_less(design):
    cell = read_cell(DESIGNS / f"{design}.yaml")
    want = sum(_area(vertices) for vertices, _ in polygons(cell)) / cell.period_nm
    # Ridges reach half into the membrane there, so that there is no seam; 16 pieces to a quarter circle
    want -= cell.fill * cell.membrane_nm / 2
    assert cross_section(cell.model_dump()).mean_m == pytest.approx(want * 1e-9, rel=1e-5)
    assert cross_section(cell.model_dump()).membrane_m == 200e-9


def _area(vertices: np.ndarray) -> float:
    """Area of a polygon (the shoelace formula)."""
    g, n = vertices.T
    return 0.5 * abs(np.dot(g, np.roll(n, 1)) - np.dot(n, np.roll(g, 1)))


def test_kinds_agree_on_the_same_cell(te):
    stack = section(
        kind="lamellar",
        layers=[
            {"thickness_nm": 400, "index": VOID, "ridges": [{"start_nm": 100, "width_nm": 300, "index": SOLID}]},
            {"thickness_nm": 200, "index": SOLID},
        ],
    )
    ridges = section(kind="metagrating", ridges_nm=[[100, 300]], ridge_height_nm=400, membrane_nm=200, index=SOLID)
    outline = profile((SOLID, slab(0, 500, 100, 400)), (SOLID, slab(400, 600)))
    for found in (stack, ridges, outline):
        assert found.mean_m == pytest.approx(320e-9, rel=1e-12)
        assert (found.membrane_m, found.materials) == (pytest.approx(200e-9, rel=1e-12), 1)


def test_grooves_are_what_a_solid_layer_lacks():
    found = section(
        kind="lamellar",
        layers=[
            {"thickness_nm": 100, "index": SOLID, "ridges": [{"start_nm": 200, "width_nm": 250, "index": VOID}]},
        ],
    )
    assert found.mean_m == pytest.approx(75e-9)
    assert found.membrane_m == 0.0


def test_ridges_that_fill_the_period_are_continuous():
    whole = {"ridges_nm": [[0, 400], [400, 600]], "ridge_height_nm": 300, "membrane_nm": 0}
    found = section(kind="metagrating", index=SOLID, **whole)
    assert (found.mean_m, found.membrane_m) == (300e-9, 300e-9)


def test_films_are_whole_and_air_weighs_nothing():
    layers = [{"thickness_nm": t, "index": index} for t, index in ((100, SOLID), (500, VOID), (50, SOLID))]
    found = section(kind="thin_film", layers=layers)
    assert (found.mean_m, found.membrane_m, found.materials) == (150e-9, 150e-9, 1)
    two = section(kind="thin_film", layers=[*layers, {"thickness_nm": 10, "index": {"n": 1.45}}])
    assert (two.mean_m, two.materials) == (pytest.approx(160e-9), 2)


def test_what_has_the_index_in_front_is_no_solid():
    found = section(
        kind="metagrating",
        ridges_nm=[[0, 500]],
        ridge_height_nm=300,
        membrane_nm=100,
        index=SOLID,
        surroundings={"front": 1.33},
    )
    assert found.mean_m == pytest.approx(250e-9)
    ridge = {"start_nm": 0, "width_nm": 500, "index": SOLID}
    liquid = section(
        kind="lamellar",
        surroundings={"front": 1.33},
        layers=[{"thickness_nm": 300, "index": {"n": 1.33}, "ridges": [ridge]}],
    )
    assert liquid.mean_m == pytest.approx(150e-9)
    with pytest.raises(ValueError, match="no solid"):
        section(kind="thin_film", layers=[{"thickness_nm": 10, "index": VOID}])


def test_slanted_walls_and_triangles():
    found = profile((SOLID, [[200, 0], [700, 0], [900, 400], [100, 400]]), (SOLID, slab(400, 600)), depth=600.0)
    assert found.mean_m == pytest.approx((0.5 * (500 + 800) * 400 / 1000 + 200) * 1e-9, rel=1e-12)
    assert found.membrane_m == pytest.approx(200e-9, rel=1e-12)
    blaze = profile((SOLID, [[0, 300], [1000, 0], [1000, 300]]), (SOLID, slab(300, 400)), depth=400.0)
    assert blaze.mean_m == pytest.approx(250e-9, rel=1e-12)
    assert blaze.membrane_m == pytest.approx(100e-9, rel=1e-12)


def test_polygons_that_cross_count_once_and_later_ones_win():
    cell = KINDS["profile"].model_validate(
        {
            "kind": "profile",
            "name": "x",
            "wavelength_nm": 1000,
            "electric_axis": "r",
            "period_nm": 1000,
            "depth_nm": 1000,
            "polygons": [
                {"index": SOLID, "vertices_nm": [[0, 0], [1000, 600], [1000, 1000], [0, 400]]},
                {"index": SOLID, "vertices_nm": [[1000, 0], [0, 600], [0, 1000], [1000, 400]]},
            ],
        }
    )
    # Two bands of 400 nm along n that cross: what both cover is a rhombus of 400 nm by a third of the period
    assert cross_section(cell.model_dump()).mean_m == pytest.approx((800 - 400**2 / 1.2 / 1000) * 1e-9)
    assert cross_section(cell.model_dump()).mean_m == pytest.approx(staircase_area(cell) * 1e-9, rel=1e-4)
    hollow = profile((SOLID, slab(0, 1000)), (VOID, slab(200, 700, 100, 600)))
    assert hollow.mean_m == pytest.approx((1000 - 0.5 * 500) * 1e-9, rel=1e-12)
    assert hollow.membrane_m == pytest.approx(500e-9, rel=1e-12)


def staircase_area(cell: Any) -> float:
    """Solid in nm² per nm, from the staircase that the modal method takes, in fine slices."""
    area = 0.0
    for layer in staircase(cell, 2000).layers:
        whole = cell.period_nm if layer.index.n == 2 else 0.0
        area += layer.thickness_nm * (sum(r.width_nm for r in layer.ridges) if layer.ridges else whole)
    return area / cell.period_nm
