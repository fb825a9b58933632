"""Solution of sparse linear equations with dense blocks along a tree of separators."""

from __future__ import annotations

from typing import NamedTuple

import numba

from beamrider.arrays import Floats, Integers
from beamrider.machine_code.standalone import standalone


class Factor(NamedTuple):
    """Block LU factors of a matrix with unknowns in the order of elimination (`dissection_setup.factorise`).

    order (n,): the unknown at each place of that order. begin (k + 1,): first place of each block of s unknowns. rows:
    places of the r later unknowns that each block touches, of block k from first_row[k] (k + 1,) on. numbers: for each
    block, from first_number[k] (k + 1,) on, with F the block's front: F₁₁⁻¹ transposed (s, s), F₂₁F₁₁⁻¹ transposed
    (s, r) and F₁₁⁻¹F₁₂ transposed (r, s). widest: the largest s or r.
    """

    order: Integers
    begin: Integers
    rows: Integers
    first_row: Integers
    numbers: Floats
    first_number: Integers
    widest: int


class Solution(NamedTuple):
    """Work space of `solve_factorised`: y (n,) in the order of elimination; part and more (widest,) of a block."""

    y: Floats
    part: Floats
    more: Floats


@numba.njit(cache=True, error_model="numpy")
def _add_combination(matrix: Floats, weights: Floats, out: Floats) -> None:
    """Add to out (c,) the sum of the rows of a flat matrix (r·c,), times weights (r,); four rows at a time."""
    c, r = out.size, weights.size
    last = r - r % 4
    for j in range(0, last, 4):
        w0, w1, w2, w3 = weights[j], weights[j + 1], weights[j + 2], weights[j + 3]
        m0, m1 = matrix[j * c : (j + 1) * c], matrix[(j + 1) * c : (j + 2) * c]
        m2, m3 = matrix[(j + 2) * c : (j + 3) * c], matrix[(j + 3) * c : (j + 4) * c]
        for i in range(c):
            out[i] += (m0[i] * w0 + m1[i] * w1) + (m2[i] * w2 + m3[i] * w3)
    for j in range(last, r):
        w0, m0 = weights[j], matrix[j * c : (j + 1) * c]
        for i in range(c):
            out[i] += m0[i] * w0


@numba.njit(cache=True, error_model="numpy")
def _eliminate(factor: Factor, space: Solution) -> None:
    """Forward: subtract from the later unknowns what each block of right-hand sides y contributes."""
    y = space.y
    for k in range(factor.begin.size - 1):
        a, b = factor.begin[k], factor.begin[k + 1]
        rows = factor.rows[factor.first_row[k] : factor.first_row[k + 1]]
        start = factor.first_number[k] + (b - a) * (b - a)
        sums = space.part[: rows.size]
        for i in range(rows.size):
            sums[i] = 0.0
        _add_combination(factor.numbers[start : start + (b - a) * rows.size], y[a:b], sums)
        for i in range(rows.size):
            y[rows[i]] -= sums[i]


@numba.njit(cache=True, error_model="numpy")
def _substitute(factor: Factor, space: Solution) -> None:
    """Backward: the unknowns of each block from those after it."""
    y = space.y
    for k in range(factor.begin.size - 2, -1, -1):
        a, b = factor.begin[k], factor.begin[k + 1]
        rows = factor.rows[factor.first_row[k] : factor.first_row[k + 1]]
        start, middle = factor.first_number[k], factor.first_number[k] + (b - a) * (b - a)
        later, found = space.part[: rows.size], space.more[: b - a]
        for i in range(rows.size):
            later[i] = -y[rows[i]]
        for i in range(b - a):
            found[i] = 0.0
        _add_combination(factor.numbers[start:middle], y[a:b], found)
        _add_combination(factor.numbers[middle + (b - a) * rows.size : factor.first_number[k + 1]], later, found)
        for i in range(b - a):
            y[a + i] = found[i]


@standalone()
def solve_factorised(factor: Factor, space: Solution, values: Floats) -> None:
    """Replace the right-hand sides in values (n,), in their own order, by the unknowns."""
    order, y = factor.order, space.y
    for i in range(order.size):
        y[i] = values[order[i]]
    _eliminate(factor, space)
    _substitute(factor, space)
    for i in range(order.size):
        values[order[i]] = y[i]
