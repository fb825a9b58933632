"""Tearing and overheating: which edge or triangle fails first. Heat is tested at the nodes."""

from __future__ import annotations

import math

import numba
import numpy as np

from beamrider.arrays import Floats, Indices
from dynamics.membrane.effects.springs import Springs
from dynamics.membrane.effects.thermal import hottest

INTACT, TENSILE, THERMAL, LEFT_TABLE, FLY_AWAY, NON_FINITE, BROKEN, BEYOND = range(8)


@numba.njit(cache=True, error_model="numpy")
def first_torn(springs: Springs, x: Floats, free: Floats) -> tuple[int, int]:
    """(TENSILE or NON_FINITE, edge) of the lowest edge past its limit, or of no finite length; (INTACT, −1) if none.

    x (3, n) in m, free lengths (edges,) in m. NON_FINITE wins over TENSILE.
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
def first_burnt(corners: Indices, limit: Floats, lowest: float, temperature: Floats) -> tuple[int, int]:
    """(THERMAL or NON_FINITE, triangle) of the lowest triangle with a node past its limit; (INTACT, −1) if none.

    corners (3, t): nodes. limit (t,) in K, of which `lowest` is the least; empty where nothing fails.
    """
    if limit.size == 0 or hottest(temperature) <= lowest:
        return INTACT, -1
    for i in range(limit.size):
        c = hot_corner(corners, limit, temperature, i)
        if c >= 0:
            return (THERMAL if temperature[corners[c, i]] < np.inf else NON_FINITE), i
    return INTACT, -1


@numba.njit(cache=True, inline="always")
def hot_corner(corners: Indices, limit: Floats, temperature: Floats, i: int) -> int:
    """The first of the corners (3, triangles) of triangle i whose temperature (n,) is past its limit; −1 if none.

    One that is no number is past it too.
    """
    for c in range(3):
        if not temperature[corners[c, i]] <= limit[i]:
            return c
    return -1
