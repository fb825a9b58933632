"""Triangles of the mesh: their sides and areas as they are now."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from beamrider.arrays import Floats, Indices


class Triangles(NamedTuple):
    """Node indices corners (3, t); masses (t,) in kg."""

    corners: Indices
    masses: Floats


class Patch(NamedTuple):
    """Triangles that are looked at together, few enough for the first cache: c of them, or all where rays are traced.

    sides (6, c): two sides, as in `triangles.sides`. frame (10, c): n (3), double area, 1/|e₁|, e₂·ê₁, the z components
    of ê₁ and n × ê₁, u, v and later the sums of the corners' x and y. response (c, 4): q_g, q_r, q_n, absorptance.
    """

    sides: Floats
    frame: Floats
    response: Floats


@numba.njit(cache=True, error_model="numpy")
def sides(x: Floats, corners: Indices, begin: int, n: int, at: int, out: Floats) -> None:
    """First and last side of n triangles from `begin` on, from column `at` of out (6, ·) on, of nodes x (3, n).

    out[:3] = x₁ − x₀, out[3:] = x₂ − x₀.
    """
    x0, x1, x2, end, last = x[0], x[1], x[2], at + n, begin + n
    a0, a1, a2, b0, b1, b2 = (
        out[0, at:end],
        out[1, at:end],
        out[2, at:end],
        out[3, at:end],
        out[4, at:end],
        out[5, at:end],
    )
    c0, c1, c2 = corners[0, begin:last], corners[1, begin:last], corners[2, begin:last]
    for i in range(n):
        p = c0[i]
        q = c1[i]
        s = c2[i]
        a0[i] = x0[q] - x0[p]
        a1[i] = x1[q] - x1[p]
        a2[i] = x2[q] - x2[p]
        b0[i] = x0[s] - x0[p]
        b1[i] = x1[s] - x1[p]
        b2[i] = x2[s] - x2[p]


@numba.njit(cache=True, error_model="numpy")
def weighted_areas(e: Floats, weight: Floats, out: Floats) -> None:
    """Out (≥ n,) = weight (n,) × area of the first n triangles with sides e (6, ·)."""
    a0, a1, a2, b0, b1, b2 = e[0], e[1], e[2], e[3], e[4], e[5]
    for i in range(weight.size):
        c0 = a1[i] * b2[i] - a2[i] * b1[i]
        c1 = a2[i] * b0[i] - a0[i] * b2[i]
        c2 = a0[i] * b1[i] - a1[i] * b0[i]
        out[i] = weight[i] * 0.5 * math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)


@numba.njit(cache=True, error_model="numpy")
def total(values: Floats, size: int) -> float:
    """Sum of the first `size` of values (n,), in four chains of fixed order (in one, each waits for the last)."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = size - size % 4
    for i in range(0, whole, 4):
        s0 += values[i]
        s1 += values[i + 1]
        s2 += values[i + 2]
        s3 += values[i + 3]
    for i in range(whole, size):
        s0 += values[i]
    return (s0 + s1) + (s2 + s3)
