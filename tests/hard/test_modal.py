"""Cases that break grating solvers; each asserts a number."""

import numpy as np
import pytest

from optics.cells.schema import Index, Layer, Metagrating, ThinFilm
from optics.modal.stage import solve
from optics.thin_film.stage import pressure

GOLD = {"n": 0.26, "k": 6.97}  # at 1064 nm, Johnson & Christy


def one(cell, u, v, order):
    response = solve(cell, np.array([u]), np.array([v]), order)
    return response.q[0, 0], response.absorptance[0, 0]


def changed(cell, **updates):
    return Metagrating.model_validate(cell.model_dump() | updates)


@pytest.mark.parametrize("fixture", ["te", "tm"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_rayleigh_cutoff_hit_exactly_is_the_limit(fixture, sign, request):
    """q has a square-root kink there: a step of δ in u moves it by about √δ, not by more."""
    cell = request.getfixturevalue(fixture)
    cut = sign * (1 - cell.pitch)
    here = one(cell, cut, 0.0, 12)[0]
    for side in (-1e-14, 1e-14):
        assert np.abs(one(cell, cut + side, 0.0, 12)[0] - here).max() < 1e-6


@pytest.mark.parametrize("fixture", ["te", "tm"])
def test_normal_incidence_is_no_special_case(fixture, request):
    cell = request.getfixturevalue(fixture)
    here = one(cell, 0.0, 0.0, 15)[0]
    for u, v in ((1e-15, 0.0), (0.0, 1e-15), (-1e-300, 1e-300), (-0.0, -0.0)):
        assert np.abs(one(cell, u, v, 15)[0] - here).max() < 1e-12


@pytest.mark.parametrize("axis", ["g", "r"])
def test_glancing_light_is_reflected_and_conserved(tm, axis):
    cell = changed(tm, index={"n": 2.0, "k": 0.0}, electric_axis=axis)
    u = np.sin(np.radians(89.99))
    response = solve(cell, np.array([u]), np.array([0.0]), 15)
    assert abs(response.absorptance[0, 0]) < 1e-10
    assert response.reflected[0, 0, 15] > 0.99


def test_two_hundred_and_one_orders_agree_with_sixty(te):
    q, _ = one(te, 0.05, 0.05, 100)
    assert np.abs(q - one(te, 0.05, 0.05, 30)[0]).max() < 3e-4


def test_touching_ridges_are_one_ridge(tm):
    split = changed(tm, ridges_nm=[[0.0, 200.0], [200.0, 320.0], [720.0, 200.0]])
    assert np.abs(one(tm, 0.1, 0.05, 15)[0] - one(split, 0.1, 0.05, 15)[0]).max() < 1e-12


def test_a_vanishing_ridge_leaves_the_membrane(tm):
    cell = changed(tm, ridges_nm=[[0.0, 1e-9]])
    film = ThinFilm(
        kind="thin_film",
        name="film",
        wavelength_nm=1064.0,
        polarisation="p",
        layers=[Layer(thickness_nm=200.0, index=Index(n=2.0, k=2e-6))],
    )
    assert np.abs(one(cell, 0.2, 0.0, 10)[0] - pressure(film, np.array([0.2]))[0][0]).max() < 1e-9


def test_equal_permittivity_everywhere_is_no_grating_at_all(te):
    nothing = changed(te, index={"n": 1.0, "k": 0.0})
    q, absorptance = one(nothing, 0.1, 0.2, 15)
    assert np.abs(q).max() < 1e-12
    assert abs(absorptance) < 1e-12


def test_a_symmetric_cell_with_degenerate_modes_does_not_push_sideways(te):
    """At u = 0 every mode of the empty part comes twice."""
    symmetric = changed(te, ridges_nm=[[700.0, 200.0]], index={"n": 1.0 + 1e-9, "k": 0.0})
    assert abs(one(symmetric, 0.0, 0.0, 15)[0][0]) < 1e-13


def test_gold_in_tm_converges(tm):
    """Metal across the field: the case that needs the inverse rule. 1e-3 of a solution with 401 orders."""
    gold = changed(tm, index=GOLD, ridges_nm=[[0.0, 520.0]])
    coarse, fine = one(gold, 0.05, 0.0, 60), one(gold, 0.05, 0.0, 200)
    assert np.abs(coarse[0] - fine[0]).max() < 1e-3
    assert 0.0 < fine[1] < 0.5


@pytest.mark.parametrize("k", [0.0, 1e-3])
def test_a_hundred_wavelengths_of_grating_do_not_overflow(tm, k):
    cell = changed(tm, ridge_height_nm=106400.0, index={"n": 2.0, "k": k})
    q, absorptance = one(cell, 0.05, 0.1, 15)
    assert np.all(np.isfinite(q))
    if k == 0.0:
        assert abs(absorptance) < 1e-10
    else:
        assert 0.3 < absorptance < 1.0


def test_an_absorptance_of_a_millionth_is_resolved(te):
    """Linear in k where absorption is weak: a(k)/k to 1 % from k = 1e-7 on."""
    weak, strong = (one(changed(te, index={"n": 2.0, "k": k}), 0.02, 0.03, 15)[1] for k in (1e-7, 1e-5))
    assert 5e-7 < weak < 5e-6
    assert weak / 1e-7 == pytest.approx(strong / 1e-5, rel=1e-2)
