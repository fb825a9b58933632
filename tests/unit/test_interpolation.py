"""Looking up many directions at once is looking them up one by one, to the bit."""

import numpy as np
import pytest

from optics.table import PressureTable, lookup, lookup_many
from tests.synthetic import smooth_tables


def film_table() -> PressureTable:
    s = np.linspace(0.0, 0.5, 31)
    q = np.stack([s**2, 0 * s, 1 - s**2])[:, :, None]
    return PressureTable(s, np.zeros(1), q, 0.1 * s[:, None], np.full((31, 1), 1e-9), axisymmetric=True)


@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("table", [*smooth_tables().values(), film_table()], ids=["te", "tm", "film"])
def test_many_at_once_are_the_same_bits_as_one_by_one(table: PressureTable, nearest: bool):
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-0.6, 0.6, (2, 1000))
    u[:3], v[:3] = [0.0, table.u[-1], table.u[4]], [0.0, 0.0, 0.1]
    arrays, out = table.arrays(nearest), np.empty((1000, 4))
    count, first = lookup_many(arrays, u, v, out)
    one = np.array([lookup(arrays, a, b) for a, b in zip(u, v, strict=True)])
    assert np.array_equal(out, one[:, :4])
    assert count == np.sum(one[:, 4] == 0) > 0
    assert first == np.flatnonzero(one[:, 4] == 0)[0]


def test_no_direction_outside_gives_none():
    table = film_table()
    assert lookup_many(table.arrays(), np.zeros(3), np.full(3, 0.2), np.empty((3, 4))) == (0, -1)
