"""Cores: the same response as direct solutions, cut-offs and resonances included, or none at all."""

import numpy as np
import pytest

from optics.cells.outline import Grating
from optics.cells.schema import LamellarStack, Profile
from optics.modal.core import Cores, find_core
from optics.modal.response import solve
from optics.modal.steps import modal_cell

REACH = (0.45, 0.4)


def directions(count=7):
    rng = np.random.default_rng(3)
    return rng.uniform(-REACH[0], REACH[0], count), rng.uniform(-REACH[1], REACH[1], 3)


def agrees(cell: Grating, order: int, error: float):
    core, (u, v) = find_core(cell, order, REACH, 1e-6), directions()
    assert core is not None
    found, exact = core.solve(u, v), solve(cell, u, v, order)
    for name in vars(exact):
        assert np.abs(getattr(found, name) - getattr(exact, name)).max() < error, name
    each = core.solve_each(np.repeat(u, v.size), np.tile(v, u.size))
    assert np.abs(each.q_stokes.reshape(found.q_stokes.shape) - found.q_stokes).max() < 1e-12


@pytest.mark.parametrize("fixture", ["te", "tm"])
def test_a_core_gives_what_direct_solutions_give(fixture, request):
    agrees(request.getfixturevalue(fixture), 13, 2e-6)


def test_a_core_of_several_layers_on_another_medium():
    """Asymmetric in depth: what comes from behind is not what comes from in front."""
    ridges = [{"start_nm": 100.0, "width_nm": 300.0, "index": {"n": 2.0, "k": 0.01}}]
    agrees(
        LamellarStack.model_validate(
            {
                "kind": "lamellar",
                "name": "layers",
                "wavelength_nm": 1064.0,
                "electric_axis": "g",
                "period_nm": 900.0,
                "layers": [
                    {"thickness_nm": 150.0, "index": {"n": 1.0}, "ridges": ridges},
                    {"thickness_nm": 90.0, "index": {"n": 1.7}},
                    {"thickness_nm": 200.0, "index": {"n": 1.2}, "ridges": ridges},
                    {"thickness_nm": 80.0, "index": {"n": 2.0}},
                ],
                "surroundings": {"front": 1.0, "back": 1.45},
            }
        ),
        12,
        2e-6,
    )


def test_a_core_of_a_profile_is_seen_from_behind_too():
    agrees(
        modal_cell(
            Profile.model_validate(
                {
                    "kind": "profile",
                    "name": "blaze",
                    "wavelength_nm": 1064.0,
                    "electric_axis": "g",
                    "period_nm": 1100.0,
                    "depth_nm": 500.0,
                    "polygons": [{"index": {"n": 2.0}, "vertices_nm": [[0, 500], [0, 300], [1100, 0], [1100, 500]]}],
                }
            ),
            8,
        ),
        7,
        2e-6,
    )


def test_a_core_holds_on_a_cutoff_and_at_normal_incidence(te):
    core = find_core(te, 13, REACH, 1e-6)
    u, v = np.array([1 - te.pitch, 0.0]), np.array([0.0])
    assert core is not None
    assert np.abs(core.solve(u, v).q - solve(te, u, v, 13).q).max() < 2e-6


def test_channels_that_are_too_many_have_no_core(te):
    assert find_core(te, 4, REACH, 1e-6) is None


def test_cores_are_found_once_and_hold_within_their_reach(te):
    cores = Cores(REACH, 1e-3)
    core = cores.of(te, 13)
    assert core is not None
    assert cores.of(te, 13) is core
    assert core.holds(np.array([-0.45]), np.array([0.4]))
    assert not core.holds(np.array([0.46]), np.array([0.0]))
