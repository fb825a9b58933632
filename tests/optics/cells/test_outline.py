"""Cross-sections as polygons and as staircases."""

import numpy as np
import pytest

from beamrider.io.files import InputError, validate
from optics.cells.outline import depth_nm, polygons, read_grating, staircase, upright
from optics.cells.schema import LamellarStack, Metagrating, Profile

SLANTED = {
    "kind": "profile",
    "name": "slanted",
    "wavelength_nm": 1064.0,
    "electric_axis": "r",
    "period_nm": 1500.0,
    "depth_nm": 600.0,
    "polygons": [
        {"index": {"n": 2.0}, "vertices_nm": [[200.0, 0.0], [600.0, 0.0], [800.0, 400.0], [100.0, 400.0]]},
        {"index": {"n": 1.5}, "vertices_nm": [[0.0, 400.0], [1500.0, 400.0], [1500.0, 600.0], [0.0, 600.0]]},
    ],
}


def area(stack: LamellarStack) -> float:
    """∫ (ε − 1) over a period, nm²."""
    total = 0.0
    for layer in stack.layers:
        around = layer.index.permittivity.real
        inside = sum(r.width_nm * (r.index.permittivity.real - around) for r in layer.ridges)
        total += layer.thickness_nm * ((around - 1) * stack.period_nm + inside)
    return total


def rounded(te, radius):
    return Metagrating.model_validate(te.model_dump() | {"corner_radius_nm": radius})


def test_a_metagrating_is_its_ridges_and_membrane(te):
    stack = staircase(te, 5)
    assert [layer.thickness_nm for layer in stack.layers] == [400.0, 200.0]
    assert [(r.start_nm, r.width_nm) for r in stack.layers[0].ridges] == [(0.0, 600.0), (790.0, 200.0)]
    assert not stack.layers[1].ridges
    assert stack.layers[1].index == te.index
    assert upright(te) is te
    assert depth_nm(te) == 600.0
    np.testing.assert_array_equal(staircase(stack, 3).model_dump(), stack.model_dump())


def test_a_staircase_of_straight_walls_keeps_the_area_for_any_number_of_slices():
    cell = Profile.model_validate(SLANTED)
    exact = (400 + 700) / 2 * 400 * 3 + 1500 * 200 * 1.25
    for slices in (1, 7, 40):
        assert area(staircase(cell, slices)) == pytest.approx(exact, rel=1e-12)


def test_a_rounded_corner_loses_the_area_outside_of_its_arc_at_second_order(te):
    radius = 100.0
    exact = area(staircase(te, 1)) - 3 * 4 * (1 - np.pi / 4) * radius**2
    coarse, fine = (abs(area(staircase(rounded(te, radius), n)) - exact) for n in (2, 4))
    assert fine < 0.3 * coarse
    assert fine < 2e-3 * area(staircase(te, 1))
    tops = [vertices for vertices, _ in polygons(rounded(te, radius)) if vertices[:, 1].min() == 0]
    for vertices, (start, width) in zip(tops, te.ridges_nm, strict=True):
        assert (vertices[:, 0].min(), vertices[:, 0].max()) == (start, start + width)


def test_walls_that_meet_at_any_decimal_leave_no_overlap():
    """Start and width of a ridge are rounded apart: their sum may pass the start of the next by a bit."""
    rng = np.random.default_rng(0)
    for period in np.round(rng.uniform(700, 2500, 200), 2).tolist():
        a, b = np.sort(rng.uniform(0, period, 2)).tolist()
        left = [[0.0, 0.0], [a, 0.0], [b, 600.0], [0.0, 600.0]]
        right = [[a, 0.0], [period, 0.0], [period, 600.0], [b, 600.0]]
        polygons = [{"index": {"n": n}, "vertices_nm": wall} for n, wall in ((2.0, left), (1.5, right))]
        cell = Profile.model_validate(SLANTED | {"period_nm": period, "polygons": polygons})
        exact = 300 * (a + b) * (4 - 2.25) + 600 * period * 1.25
        assert area(staircase(cell, 8)) == pytest.approx(exact, rel=1e-12)


def test_a_later_polygon_lies_over_an_earlier_one():
    hole = {"index": {"n": 1.0}, "vertices_nm": [[300.0, 450.0], [500.0, 450.0], [500.0, 550.0], [300.0, 550.0]]}
    cell = Profile.model_validate(SLANTED | {"polygons": [*SLANTED["polygons"], hole]})
    assert area(staircase(Profile.model_validate(SLANTED), 4)) - area(staircase(cell, 4)) == pytest.approx(
        200 * 100 * 1.25, rel=1e-9
    )


@pytest.mark.parametrize(("radius", "most"), [(101.0, "100"), (-1.0, "greater than or equal to 0")])
def test_a_corner_too_round_for_its_ridge_is_refused(te, radius, most):
    with pytest.raises(InputError, match=most):
        validate(te.model_dump() | {"corner_radius_nm": radius}, Metagrating, "cell.yaml")


def test_a_film_is_no_grating():
    with pytest.raises(InputError, match="must be a grating"):
        read_grating("workflow/designs/si43.yaml")
