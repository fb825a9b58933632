"""Sampling: the error promised is the error found."""

import numpy as np
import pytest

from beamrider.io.files import InputError
from optics.refinement.directions import choose_nodes, even_nodes, fill, refine
from optics.waves.incidence import cutoffs, electric_vector, order_cosines, wave_vector


def _resonance(u, v=0.0):
    return 1 / (1 + ((u - 0.1 - 0.2 * v * v) / 0.01) ** 2)


def test_refine_meets_the_tolerance_at_a_resonance():
    found = refine(lambda u: _resonance(u)[:, None], np.linspace(-0.2, 0.2, 9), 1e-4, 1e-6)
    from scipy.interpolate import CubicHermiteSpline

    from optics.table.hermite import slope_matrix

    values = _resonance(found.nodes)
    spline = CubicHermiteSpline(found.nodes, values, slope_matrix(found.nodes) @ values)
    u = np.random.default_rng(0).uniform(-0.2, 0.2, 5000)
    assert np.abs(spline(u) - _resonance(u)).max() < 3e-4
    assert found.error.max() <= 1e-4
    assert found.nodes.size < 200
    assert np.diff(found.nodes).min() < 0.1 * np.diff(found.nodes).max()


def test_refine_stops_at_a_kink_and_reports_what_is_left():
    found = refine(lambda u: np.sqrt(np.abs(u - 0.0123))[:, None], np.linspace(-0.1, 0.1, 9), 1e-5, 1e-3)
    assert np.diff(found.nodes).min() > 4e-4
    assert found.error.max() > 1e-3


def test_choose_nodes_then_fill_meets_the_tolerance():
    u, v = np.linspace(-0.18, 0.18, 181), np.linspace(0, 0.18, 13)
    values = _resonance(u[:, None], v)[..., None]
    for tolerance in (3e-2, 3e-3):
        u_nodes, v_nodes = choose_nodes(u, v, values, tolerance)
        rebuilt = fill(u_nodes, v_nodes, _resonance(u_nodes[:, None], v_nodes)[..., None], u, v)
        assert np.abs(rebuilt - values).max() < tolerance
        assert u_nodes.size * v_nodes.size < u.size * v.size / 8


def test_too_small_a_tolerance_is_refused():
    u, v = np.linspace(-0.18, 0.18, 181), np.linspace(0, 0.18, 13)
    with pytest.raises(InputError, match="tolerance = 1e-12"):
        choose_nodes(u, v, _resonance(u[:, None], v)[..., None], 1e-12)


def test_fill_is_exact_for_even_polynomials_in_v():
    u, v_nodes, v = np.linspace(-1, 1, 7), even_nodes(0.3, 3), np.linspace(0, 0.3, 11)
    values = (1 + u[:, None] ** 3) * (1 + v_nodes**2 - 2 * v_nodes**4)
    exact = (1 + u[:, None] ** 3) * (1 + v**2 - 2 * v**4)
    assert np.allclose(fill(u, v_nodes, values[..., None], u, v)[..., 0], exact, atol=1e-14)


def test_cutoffs_are_where_an_order_grazes(te):
    for u in cutoffs(te.pitch, 0.42):
        _, w = order_cosines(u, 0.0, te.pitch, np.arange(-4, 5))
        assert np.abs(w).min() < 1e-7
    assert cutoffs(te.pitch, 0.42) == pytest.approx([-0.335, -0.33, 0.33, 0.335])


def test_electric_vector_is_transverse_and_continuous_at_normal_incidence():
    u, v = np.random.default_rng(0).uniform(-0.6, 0.6, (2, 100))
    for axis in ("g", "r"):
        e = electric_vector(u, v, axis)
        assert np.allclose((e * wave_vector(u, v)).sum(-1), 0, atol=1e-15)
        assert np.allclose(np.linalg.norm(e, axis=-1), 1)
        assert np.array_equal(electric_vector(0.0, 0.0, axis), [axis == "g", axis == "r", 0])
