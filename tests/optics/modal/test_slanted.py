"""Profiles with slanted walls: conservation, reciprocity, limits that are known, and a staircase where it converges."""

import numpy as np
import pytest

from optics.cells.outline import upright
from optics.cells.schema import Profile, ThinFilm
from optics.modal.absorption import imbalance
from optics.modal.normal_incidence import normal_response
from optics.modal.response import solve
from optics.modal.slabs import slabs
from optics.modal.steps import Slanted, modal_cell
from optics.thin_film.stage import pressure

U, V = np.array([-0.2, 0.05, 0.31]), np.array([0.0, 0.15])
BLAZE = [[0, 1000], [0, 800], [1600, 0], [1600, 1000]]


def profile(vertices, axis="g", back=1.0, **index) -> Profile:
    return Profile.model_validate(
        {
            "kind": "profile",
            "name": "profile",
            "wavelength_nm": 1064.0,
            "electric_axis": axis,
            "period_nm": 1600.0,
            "depth_nm": 1000.0,
            "polygons": [{"index": {"n": 2.0} | index, "vertices_nm": vertices}],
            "surroundings": {"back": back},
        }
    )


def limit(cell: Profile, count: int, order: int):
    """q (n_u, n_v, 3) extrapolated from `count` steps and half as many."""
    fine, half = (solve(Slanted(cell, n), U, V, order).q for n in (count, count // 2))
    return fine + (fine - half) / 15


def test_nothing_is_lost_where_nothing_absorbs():
    found = solve(Slanted(profile(BLAZE, back=1.45), 16), U, V, 9)
    assert np.abs(found.absorptance_stokes).max() < 1e-12


def test_what_absorbs_takes_up_what_is_lost():
    """Fields' own loss, of an absorber and of silver, at any number of steps and orders."""
    for index in ({"k": 0.1}, {"n": 0.22, "k": 7.1}):
        cell = profile(BLAZE, **index)
        assert solve(Slanted(cell, 12), U, V, 7).absorptance.max() > 0.1
        assert imbalance(Slanted(cell, 12), U, np.array([0.0, 0.1, 0.2]), 7) < 1e-11


def test_light_is_reflected_alike_from_where_it_went():
    """Reciprocity: the specular order of an asymmetric grating at u and at −u, at normal and conical incidence."""
    found = solve(Slanted(profile(BLAZE, k=0.05), 32), np.array([-0.21, 0.21]), np.zeros(1), 12)
    assert found.reflected[0, 0, 12] == pytest.approx(found.reflected[1, 0, 12], abs=1e-10)
    assert abs(found.q[0, 0, 2] - found.q[1, 0, 2]) > 1e-2  # though nothing else is alike


def test_a_flat_profile_is_a_film():
    """Steps of a layer that does not change across: the film's closed form, with the Padé approximant's error alone."""
    cell = profile([[0, 0], [1600, 0], [1600, 1000], [0, 1000]], axis="r")
    film = ThinFilm.model_validate(
        {
            "kind": "thin_film",
            "name": "film",
            "wavelength_nm": 1064.0,
            "polarisation": "s",
            "layers": [{"thickness_nm": 1000.0, "index": {"n": 2.0}}],
        }
    )
    exact = pressure(film, np.abs(U))[0] * np.stack([np.sign(U), np.ones(3), np.ones(3)], axis=-1)
    error = [np.abs(solve(Slanted(cell, n), U, np.zeros(1), 4).q[:, 0] - exact).max() for n in (16, 32)]
    assert error[0] < 5e-3
    assert error[1] < error[0] / 14


@pytest.mark.parametrize("axis", ["g", "r"])
def test_walls_that_lean_ever_less_become_upright(axis):
    """A ridge with walls 0.2 nm out of plumb in steps, against the upright one by its modes."""
    leaning = profile([[300, 1000], [300.2, 0], [900.2, 0], [900, 1000]], axis=axis)
    plumb = profile([[300.1, 1000], [300.1, 0], [900.1, 0], [900.1, 1000]], axis=axis)
    assert isinstance(modal_cell(leaning), Slanted)
    assert not isinstance(modal_cell(plumb), Slanted)
    exact = solve(upright(plumb), U, V, 16).q
    assert np.abs(limit(leaning, 64, 16) - exact).max() < {"r": 1e-3, "g": 1e-2}[axis]


def test_both_ways_agree_where_a_staircase_converges():
    """Electric field along the ridges: no field is normal to a wall."""
    cell = profile(BLAZE, axis="r")
    fine, half = (solve(upright(cell, n), U, V[:1], 24).q for n in (64, 32))
    assert np.abs(limit(cell, 64, 16)[:, :1] - (fine + (fine - half) / 3)).max() < 3e-4


def test_the_order_of_limits_does_not_matter():
    """Field across the ridges: with more orders at so many steps, and with more of both, q stays. A staircase's moves.

    The value is that of FDTD: q_n = 0.2350 ± 0.0005 at u = 0.05 from 64 to 180 pixels a period (Meep 1.25).
    """
    cell = profile(BLAZE)
    q = [limit(cell, 64, order)[1, 0, 2] for order in (10, 16)]
    assert q == pytest.approx([0.235, 0.235], abs=7e-4)
    stairs = [solve(upright(cell, 64), U[1:2], V[:1], order).q[0, 0, 2] for order in (10, 16)]
    assert abs(stairs[1] - 0.235) > 5e-3


def test_the_response_at_normal_incidence_has_slopes():
    cell = Slanted(profile(BLAZE), 32)
    found = normal_response(cell, 12, Slanted(profile(BLAZE), 16))
    fine = solve(cell, 0.01 * np.array([-1.0, 1.0]), np.zeros(1), 12).q[:, 0]
    assert found.gradient[0, 0] == pytest.approx(np.diff(fine, axis=0)[0, 0] / 0.02, rel=0.02)


@pytest.mark.parametrize("index", [{}, {"k": 0.1}])
def test_slabs_of_many_steps_do_what_the_steps_do(index):
    """Polynomials in u and v, on both sides of the plane of incidence and up to the corners of what was asked for."""
    cell, reach = profile(BLAZE, back=1.45, **index), (0.25, 0.2)
    u, v = np.array([-0.25, -0.031, 0.17, 0.25]), np.array([-0.2, 0.0, 0.013, 0.2])
    assert slabs(Slanted(cell, 48, reach), 9) is not None
    one, other = (solve(of, u, v, 9) for of in (Slanted(cell, 48), Slanted(cell, 48, reach)))
    assert np.abs(one.q_stokes - other.q_stokes).max() < 1e-8
    assert np.abs(one.absorptance_stokes - other.absorptance_stokes).max() < 1e-8


def test_directions_beyond_the_reach_of_slabs_are_taken_in_steps():
    cell, u = profile(BLAZE), np.array([0.1, 0.3])
    one, other = (solve(of, u, V, 6) for of in (Slanted(cell, 16), Slanted(cell, 16, (0.25, 0.2))))
    assert np.array_equal(one.q_stokes, other.q_stokes)


def test_steps_too_thick_for_polynomials_are_not_joined():
    """Waves decay so fast in silver that the approximant of a step is far from an exponential: it has poles."""
    cell = profile(BLAZE, n=0.22, k=7.1)
    assert slabs(Slanted(cell, 8, (0.25, 0.2)), 9) is None
    one, other = (solve(of, U[1:2], V, 9) for of in (Slanted(cell, 8), Slanted(cell, 8, (0.25, 0.2))))
    assert np.array_equal(one.q_stokes, other.q_stokes)
