"""Looking up many directions at once is looking them up one by one, to the bit."""

import numpy as np
import pytest

from optics.table.contents import Cutoffs
from optics.table.lookup import lookup, lookup_many, lookup_slopes, lookup_slopes_many
from optics.table.pressure_table import PressureTable
from optics.table.strips import breaks, rayleigh_curves
from tests.synthetic import smooth_tables


def film_table() -> PressureTable:
    s = np.linspace(0.0, 0.5, 31)
    q = np.stack([s**2, 0 * s, 1 - s**2])[:, :, None]
    return PressureTable(s, np.zeros(1), q, 0.1 * s[:, None], np.full((31, 1), 1e-9), axisymmetric=True)


def split_table() -> PressureTable:
    """q = (u, v, 1 + u v², …) with cut-offs that cross and leave the table."""
    curves = rayleigh_curves(1.35, (1.0, 1.4), -0.4, 0.4, 0.4)
    u, v = np.linspace(-0.4, 0.4, 41), np.union1d(np.linspace(0.0, 0.4, 21), breaks(curves, -0.4, 0.4, 0.4))
    v = v[np.diff(v, prepend=-1.0) > 1e-9]
    on = np.where(curves.inside(v, -0.4, 0.4), curves.u(v), np.nan)

    def q(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.stack([u + 0 * v, v + 0 * u, 1 + u * v**2])

    grid = u[:, None] + 0 * v
    cutoffs = Cutoffs(curves, np.where(np.isnan(on), np.nan, q(on, v)), 0.1 * on)
    return PressureTable(u, v, q(u[:, None], v), 0.1 * grid, np.full(grid.shape, 1e-9), mirror_v=True, cutoffs=cutoffs)


TABLES = {"te": smooth_tables()["mark1e_te"], "tm": smooth_tables()["mark1e_tm"], "split": split_table()}


def directions(table: PressureTable) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 1000))
    u[:5], v[:5] = [0.0, table.u[-1], table.u[4], table.u[0], 0.1], [0.0, 0.0, 0.1, -table.v[-1], table.v[-1]]
    return u, v


@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("table", [*TABLES.values(), film_table()], ids=[*TABLES, "film"])
def test_many_at_once_are_the_same_bits_as_one_by_one(table: PressureTable, nearest: bool):
    u, v = directions(table)
    arrays, out = table.arrays(nearest), np.empty((1000, 4))
    count, first = lookup_many(arrays, u, v, out)
    one = np.array([lookup(arrays, a, b) for a, b in zip(u, v, strict=True)])
    assert np.array_equal(out, one[:, :4])
    assert count == np.sum(one[:, 4] == 0) > 0
    assert first == np.flatnonzero(one[:, 4] == 0)[0]


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_slopes_of_many_are_the_same_bits_as_one_by_one(table: PressureTable):
    u, v = directions(table)
    arrays, out, one = table.arrays(), np.empty((1000, 3, 4)), np.empty((1000, 3, 4))
    lookup_slopes_many(arrays, u, v, out)
    inside = [lookup_slopes(arrays, a, b, each) for a, b, each in zip(u, v, one, strict=True)]
    assert np.array_equal(out, one)
    values = np.empty((1000, 4))
    assert 1000 - sum(inside) == lookup_many(arrays, u, v, values)[0]
    assert np.array_equal(out[:, 0], values)


def test_nodes_are_given_back_by_both_rules():
    """At a node the weights of all others are 0, and the nearest node is the node itself."""
    table = TABLES["te"]
    u, v = (x.ravel() for x in np.meshgrid(table.u, table.v, indexing="ij"))
    out = np.empty((u.size, 4))
    for nearest in (False, True):
        lookup_many(table.arrays(nearest), u, v, out)
        assert np.allclose(out[:, :3].T, table.q_nodes.reshape(3, -1), rtol=0, atol=1e-14)


@pytest.mark.parametrize("table", [*TABLES.values(), film_table()], ids=[*TABLES, "film"])
def test_a_direction_that_is_no_number_is_outside(table: PressureTable):
    u, v = np.array([np.nan, 0.1, np.nan, np.inf, 0.1]), np.array([0.1, np.nan, np.nan, 0.1, -np.inf])
    arrays = table.arrays()
    assert lookup_many(arrays, u, v, np.empty((5, 4))) == (5, 0)
    assert not any(lookup(arrays, a, b)[4] for a, b in zip(u, v, strict=True))


def test_no_direction_outside_gives_none():
    table = film_table()
    assert lookup_many(table.arrays(), np.zeros(3), np.full(3, 0.2), np.empty((3, 4))) == (0, -1)
