"""Cases that break FDTD; each asserts a number. Meep runs in a process of its own."""

import importlib.util

import numpy as np
import pytest

from beamrider.io.files import InputError
from optics.cells.outline import staircase
from optics.cells.schema import Metagrating, Profile, read_cell
from optics.fdtd.direction import solve_direction
from optics.fdtd.grid import FdtdSettings
from optics.fdtd.orders import grazing
from optics.modal.response import solve
from optics.modal.steps import Slanted

pytestmark = [
    pytest.mark.meep,
    pytest.mark.skipif(importlib.util.find_spec("meep") is None, reason="Meep is not installed"),
]
TRIPLE = FdtdSettings(pixels_per_wavelength=[7.45, 10.65, 14.9])


def changed(cell, **updates):
    return Metagrating.model_validate(cell.model_dump() | updates)


def exact(cell, u, v, order=40):
    return solve(cell, np.array([u]), np.array([v]), order).q[0, 0]


def test_a_pulse_that_is_cut_off_is_refused_with_what_it_lacks(tm, apart):
    with pytest.raises(InputError, match=r"u = 0\.122, v = 0: .*60 periods .*: residual 0\.0\d+, allowed 0\.0033"):
        apart(solve_direction, tm, 0.122, 0.0, FdtdSettings(longest=60.0))


def test_a_resonance_too_sharp_to_ring_down_is_refused(te, apart):
    """A lossless membrane with a shallow grating: its guided wave is 2e-3 wide in u, and rings for 1000s of periods."""
    cell = changed(te, period_nm=700.0, ridges_nm=[[200.0, 300.0]], ridge_height_nm=20.0, index={"n": 2.0, "k": 0.0})
    u = np.linspace(-0.08, -0.03, 1001)
    q = solve(cell, u, np.zeros(1), 8).q[:, 0, 2]
    with pytest.raises(InputError, match="still ring after 600 periods"):
        apart(solve_direction, cell, float(u[q.argmax()]), 0.0, FdtdSettings(pixels_per_wavelength=[7.45, 10.65]))


@pytest.mark.parametrize("offset", [-1e-3, -1e-9, 0.0, 1e-4, 4e-3])
def test_an_order_that_grazes_the_absorber_is_refused(te, offset):
    u = 1 - te.pitch + offset
    assert grazing(te, u, 0.0) < 0.1
    with pytest.raises(InputError, match=r"a diffraction order grazes, \|w\| = 0?\.?\d"):
        solve_direction(te, u, 0.0, TRIPLE)


@pytest.mark.parametrize("which", ["te", "tm"])
def test_edges_that_are_nowhere_on_the_grid_cost_no_accuracy(request, apart, which):
    cell = request.getfixturevalue(which)
    ridges = [[start + 0.3 * (start > 0), width + 0.9] for start, width in cell.ridges_nm]
    odd = changed(
        cell,
        period_nm=cell.period_nm + 3.7,
        ridges_nm=ridges,
        ridge_height_nm=403.3,
        membrane_nm=197.1,
    )
    result = apart(solve_direction, odd, 0.03, 0.05, TRIPLE)
    difference = np.abs(result.q - exact(odd, 0.03, 0.05)).max()
    assert difference < result.error
    assert difference < 4e-3
    assert abs(result.energy_imbalance) < 1e-3


@pytest.mark.parametrize("which", ["rounded_te", "rounded_tm"])
def test_rounded_corners_agree_with_the_modal_staircase(apart, which):
    cell = read_cell(f"workflow/designs/{which}.yaml")
    result = apart(solve_direction, cell, 0.03, 0.0, TRIPLE)
    difference = np.abs(result.q - exact(staircase(cell, 16), 0.03, 0.0, 30)).max()
    assert difference < result.error
    assert difference < 3e-3


@pytest.mark.parametrize(("axis", "tolerance"), [("r", 1.5e-3), ("g", 4e-3)])
def test_slanted_walls_agree_with_the_modal_method(apart, axis, tolerance):
    cell = Profile.model_validate(
        {
            "kind": "profile",
            "name": "slanted",
            "wavelength_nm": 1064.0,
            "electric_axis": axis,
            "period_nm": 1500.0,
            "depth_nm": 600.0,
            "polygons": [
                {"index": {"n": 2.0}, "vertices_nm": [[200.0, 0.0], [600.0, 0.0], [800.0, 400.0], [100.0, 400.0]]},
                {"index": {"n": 2.0}, "vertices_nm": [[0.0, 400.0], [1500.0, 400.0], [1500.0, 600.0], [0.0, 600.0]]},
            ],
        }
    )
    coarse, fine = (exact(Slanted(cell, steps), -0.09, 0.09, 14) for steps in (32, 64))
    result = apart(solve_direction, cell, -0.09, 0.09, TRIPLE)
    difference = np.abs(result.q - (fine + (fine - coarse) / 3)).max()
    assert difference < result.error
    assert difference < tolerance


def test_a_blaze_agrees_with_the_modal_method(apart):
    """Walls that lean by 63°, light with its field across them: a staircase errs by more than FDTD states."""
    cell = Profile.model_validate(
        {
            "kind": "profile",
            "name": "blaze",
            "wavelength_nm": 1064.0,
            "electric_axis": "g",
            "period_nm": 1600.0,
            "depth_nm": 1000.0,
            "polygons": [{"index": {"n": 2.0}, "vertices_nm": [[0, 1000], [0, 800], [1600, 0], [1600, 1000]]}],
        }
    )
    coarse, fine = (exact(Slanted(cell, steps), 0.05, 0.1, 14) for steps in (32, 64))
    result = apart(solve_direction, cell, 0.05, 0.1, FdtdSettings())
    assert np.abs(result.q - (fine + (fine - coarse) / 3)).max() < result.error < 1e-2
