"""A sail whose ridges are shallow: its dips are narrower than any grid, and a table has them all the same."""

import numpy as np
import pytest

from optics.cells.schema import Metagrating
from optics.modal.response import solve
from optics.modal.stage import make_table

SHALLOW = Metagrating(
    kind="metagrating",
    name="shallow",
    wavelength_nm=1064,
    electric_axis="r",
    period_nm=900,
    ridges_nm=[[0, 450]],
    ridge_height_nm=10,
    membrane_nm=200,
    index={"n": 2.0, "k": 0.0},
)


def test_the_dips_of_a_shallow_grating_are_met_everywhere():
    """A lossless slab reflects all light somewhere on a resonance: q_n = 2 w = 1.85 near |u| = 0.374 (R = 1, T = 0).

    It falls far below within 1e-3 of that. Seen with three times the orders.
    """
    table = make_table(SHALLOW, 0.4227, 0.4227, 1e-3)
    assert table.attrs["tolerance_met"] == 1
    assert table.attrs["missed_because"] == ""
    order = 3 * table.attrs["settings"]["orders"]
    u = 0.3744 + np.linspace(-3e-3, 3e-3, 121)
    exact = solve(SHALLOW, u, np.zeros(1), order).q[:, 0]
    top = exact[:, 2].argmax()
    assert exact[top, 2] == pytest.approx(2.0 * np.sqrt(1.0 - u[top] ** 2), abs=0.02)
    assert exact[np.abs(u - u[top]) < 1e-3, 2].min() < 0.69
    assert np.abs(table.q(u, 0.0) - exact).max() < 1e-3
    rng = np.random.default_rng(11)
    u, v = rng.uniform(-0.4227, 0.4227, (2, 60))
    exact = np.array([solve(SHALLOW, u[i : i + 1], v[i : i + 1], order).q[0, 0] for i in range(60)])
    assert np.abs(table.q(u, v) - exact).max() < 1e-3
