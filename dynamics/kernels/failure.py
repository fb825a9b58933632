"""Tearing and overheating: which edge fails first, and where."""

from __future__ import annotations

import math

import numba
import numpy as np

from dynamics.kernels.elastic import Floats, Springs
from dynamics.kernels.thermal import hottest

INTACT, TENSILE, THERMAL, LEFT_TABLE, FLY_AWAY, NON_FINITE, BROKEN, BEYOND = range(8)


@numba.njit(cache=True, error_model="numpy")
def first_torn(springs: Springs, x: Floats, free: Floats) -> tuple[int, int]:
    """(TENSILE or NON_FINITE, edge) of the lowest edge past its limit, or of no finite length; (INTACT, −1) if none.

    NON_FINITE wins over TENSILE.
    """
    stretch = springs.stretch
    torn = -1
    for i in range(springs.start.size):
        a = springs.start[i]
        b = springs.end[i]
        d0, d1, d2 = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
        length = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        if not (length < np.inf and free[i] < np.inf):
            return NON_FINITE, i
        if stretch.size > 0 and torn < 0 and not length <= free[i] * stretch[i]:
            torn = i
    return (INTACT if torn < 0 else TENSILE), torn


@numba.njit(cache=True, error_model="numpy")
def first_burnt(springs: Springs, limit: Floats, lowest: float, temperature: Floats) -> tuple[int, int]:
    """(THERMAL or NON_FINITE, edge) of the lowest edge whose mean temperature is past its limit; (INTACT, −1) if none.

    limit (e,) in K, of which `lowest` is the least; empty where nothing fails.
    """
    if limit.size == 0 or hottest(temperature) <= lowest:
        return INTACT, -1
    for i in range(limit.size):
        mean = 0.5 * (temperature[springs.start[i]] + temperature[springs.end[i]])
        if not mean <= limit[i]:
            return (THERMAL if mean < np.inf else NON_FINITE), i
    return INTACT, -1
