"""The pressure tables of a sail, one after the other in memory."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers
from optics.table.pressure_table import TableArrays


class Tables(NamedTuple):
    """Pressure tables one after the other, so that compiled code is the same for any number of them.

    numbers, places: as in `TableArrays`, concatenated. starts (k + 1, 2): where each table begins in them. axisymmetric
    (k,); nearest: for all of them.
    """

    numbers: Floats
    places: Integers
    starts: Integers
    axisymmetric: NDArray[np.bool_]
    nearest: bool


def concatenated(arrays: list[TableArrays], nearest: bool) -> Tables:
    """Tables one after the other; none at all is allowed."""
    numbers = np.concatenate([np.empty(0), *(t.numbers for t in arrays)])
    places = np.concatenate([np.empty(0, np.int64), *(t.places for t in arrays)])
    starts = np.cumsum([[0, 0], *([t.numbers.size, t.places.size] for t in arrays)], axis=0)
    axisymmetric = np.array([t.axisymmetric for t in arrays], dtype=bool)
    return Tables(numbers, places, starts, axisymmetric, nearest)


@numba.njit(cache=True, error_model="numpy")
def table(tables: Tables, k: int) -> TableArrays:
    """Table k of the concatenation."""
    a, b = tables.starts[k], tables.starts[k + 1]
    return TableArrays(
        tables.numbers[a[0] : b[0]],
        tables.places[a[1] : b[1]],
        tables.axisymmetric[k],
        tables.nearest,
    )
