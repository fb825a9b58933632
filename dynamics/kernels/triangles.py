"""Triangles of the mesh: their sides and areas as they are now, and sums over the triangles that meet at a node."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from dynamics.kernels.elastic import Floats, Indices


class Triangles(NamedTuple):
    """Node indices corners (3, t); slots (d, n): triangles that meet at each node, padded with t; masses (t,) in kg."""

    corners: Indices
    slots: Indices
    masses: Floats


@numba.njit(cache=True, error_model="numpy")
def sides(x: Floats, corners: Indices, out: Floats) -> None:
    """First and last side of each triangle: out[:3] = x₁ − x₀, out[3:] = x₂ − x₀ (6, t) of nodes x (3, n)."""
    x0, x1, x2 = x[0], x[1], x[2]
    a0, a1, a2, b0, b1, b2 = out[0], out[1], out[2], out[3], out[4], out[5]
    c0, c1, c2 = corners[0], corners[1], corners[2]
    for i in range(c0.size):
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
    """Out (≥ t,) = weight (t,) × area of triangles with sides e (6, t)."""
    a0, a1, a2, b0, b1, b2 = e[0], e[1], e[2], e[3], e[4], e[5]
    for i in range(a0.size):
        c0 = a1[i] * b2[i] - a2[i] * b1[i]
        c1 = a2[i] * b0[i] - a0[i] * b2[i]
        c2 = a0[i] * b1[i] - a1[i] * b0[i]
        out[i] = weight[i] * 0.5 * math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)


@numba.njit(cache=True, inline="always")
def node_sum(slots: Indices, source: Floats, node: int) -> float:
    """Sum of the entries of source (·,) listed in slots (d, n) for one node."""
    total = 0.0
    for j in range(slots.shape[0]):
        total += source[slots[j, node]]
    return total


@numba.njit(cache=True, error_model="numpy")
def total(values: Floats, size: int) -> float:
    """Sum of the first `size` values, in four chains of fixed order (in one chain each addition waits for the last)."""
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
