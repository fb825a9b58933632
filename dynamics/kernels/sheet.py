"""Constant-strain triangles: plane stress in a thin sheet without bending stiffness, exact for any triangle.

With the squared sides q_i = ℓ_i² of a triangle, d_i = q_i − λ²L_i² and c_i the cotangent of the rest angle opposite
side i, its Green strain relative to the free, thermally expanded triangle has

    tr E = c·d/(4A),  det E = (2(d₀d₁ + d₁d₂ + d₂d₀) − d·d)/(64A²),

and the St Venant–Kirchhoff energy U = A h Y/(1 − ν²) ½[(tr E)² − 2(1 − ν) det E] has ∂U/∂q_i as a linear function of d:
forces act along the sides, as in springs (Delingette, IEEE Trans. Vis. Comput. Graphics 14 (2008) 329). So momentum and
angular momentum are kept to rounding. Nothing is divided by a length: a triangle may shrink to nothing or turn over.
The forces are in `stencil`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from dynamics.kernels.elastic import REFERENCE_TEMPERATURE, Floats, Indices, Springs


class Sheet(NamedTuple):
    """Triangles as elastic elements, all arrays empty where springs carry the load.

    sides (3t,): edges of the sides 01, then 12, then 20 of all triangles. rest (3t,): their squared rest lengths in m².
    cotangent (3t,): of the opposite rest angles. area (t,): 4A in m². modulus (t,): h Y/(8(1 − ν²)A) in N/m³; shear
    (t,): modulus · (1 − ν). poisson (t,). slots (2, e): positions, in [the 3t sides, 0], of the tensions of each edge.
    limit (t,): 4A(1 − ν²)σ/Y in m², σ the tensile strength; empty where nothing tears. expansion (t,): thermal
    expansion in 1/K, empty where it is off.
    """

    sides: Indices
    rest: Floats
    cotangent: Floats
    area: Floats
    modulus: Floats
    shear: Floats
    poisson: Floats
    slots: Indices
    limit: Floats
    expansion: Floats


class SheetWork(NamedTuple):
    """Work space: squared free lengths (3t,) and squared lengths (e,) in m²; tension (3t,): d in m².

    trace (t,): 4A tr E in m²; sum (t,): d₀ + d₁ + d₂. modulus,
    shear and limit (t,): those of the sheet as it is now, 0, 0 and ∞ where a triangle has been removed.
    """

    free: Floats
    squares: Floats
    tension: Floats
    trace: Floats
    sum: Floats
    modulus: Floats
    shear: Floats
    limit: Floats


@numba.njit(cache=True, error_model="numpy")
def grow(sheet: Sheet, corners: Indices, temperature: Floats, free: Floats) -> None:
    """Squared free lengths (3t,) λ²L², λ = 1 + α(T − 300 K) at the mean of the corners' T (n,), where they expand."""
    alpha, rest = sheet.expansion, sheet.rest
    t = alpha.size
    c0, c1, c2 = corners[0], corners[1], corners[2]
    for i in range(t):
        mean = (temperature[c0[i]] + temperature[c1[i]] + temperature[c2[i]]) / 3.0
        stretch = 1.0 + alpha[i] * (mean - REFERENCE_TEMPERATURE)
        square = stretch * stretch
        free[i] = square * rest[i]
        free[t + i] = square * rest[t + i]
        free[2 * t + i] = square * rest[2 * t + i]


@numba.njit(cache=True, error_model="numpy")
def measure(springs: Springs, x: Floats, squares: Floats) -> None:
    """Squared lengths (e,) of the edges at nodes x (3, n)."""
    x0, x1, x2 = x[0], x[1], x[2]
    for i in range(squares.size):
        a, b = springs.start[i], springs.end[i]
        d0, d1, d2 = x0[b] - x0[a], x1[b] - x1[a], x2[b] - x2[a]
        squares[i] = d0 * d0 + d1 * d1 + d2 * d2


@numba.njit(cache=True, error_model="numpy")
def _excess(sides: Indices, squares: Floats, free: Floats, d: Floats) -> None:
    """Write d (≥ 3t,) = squares − free of the sides."""
    for i in range(sides.size):
        d[i] = squares[sides[i]] - free[i]


@numba.njit(cache=True, error_model="numpy")
def _sums(c: Floats, d: Floats, trace: Floats, total: Floats) -> None:
    """Write trace (t,) = c·d and total (t,) = d₀ + d₁ + d₂."""
    t = trace.size
    c0, c1, c2, d0, d1, d2 = c[:t], c[t : 2 * t], c[2 * t : 3 * t], d[:t], d[t : 2 * t], d[2 * t : 3 * t]
    for i in range(t):
        trace[i] = c0[i] * d0[i] + c1[i] * d1[i] + c2[i] * d2[i]
    for i in range(t):
        total[i] = d0[i] + d1[i] + d2[i]


@numba.njit(cache=True, inline="always")
def holds(trace: float, spread: float, poisson: float, limit: float) -> bool:
    """Whether the larger principal stress is below the strength: given 4A tr E, `spread` and the scaled strength.

    The principal strains are (trace ± √spread)/(8A), spread = 16A²((tr E)² − 4 det E). The larger principal stress is
    Y/(1 − ν²) times ½(1 + ν) tr E + ½(1 − ν)√spread/(4A); no root is needed to compare it. False for NaN.
    """
    margin = limit - 0.5 * (1.0 + poisson) * trace
    share = 0.5 * (1.0 - poisson)
    return share * share * spread <= margin * abs(margin)


@numba.njit(cache=True, error_model="numpy")
def strain(sheet: Sheet, work: SheetWork) -> None:
    """Excess of the squared sides, their sum and the trace, at work.squares and work.free."""
    _excess(sheet.sides, work.squares, work.free, work.tension)
    _sums(sheet.cotangent, work.tension, work.trace, work.sum)


@numba.njit(cache=True, error_model="numpy")
def _spread(sheet: Sheet, work: SheetWork, i: int) -> float:
    """16A²((tr E)² − 4 det E) of triangle i, work.tension being d; nothing cancels, as the equal part is taken out."""
    t = work.trace.size
    equal = work.trace[i] / sheet.area[i]
    p = work.tension[i] - equal * sheet.rest[i]
    q = work.tension[t + i] - equal * sheet.rest[t + i]
    r = work.tension[2 * t + i] - equal * sheet.rest[2 * t + i]
    return 2.0 * (p * p + q * q + r * r) - (p + q + r) * (p + q + r)


@numba.njit(cache=True, inline="always")
def _stretch(green: float) -> float:
    """Relative change of length √(1 + 2E) − 1 of a Green strain E."""
    return 2.0 * green / (1.0 + math.sqrt(max(1.0 + 2.0 * green, 0.0)))


@numba.njit(cache=True, inline="always")
def _green(sheet: Sheet, work: SheetWork, i: int) -> tuple[float, float]:
    """Larger and smaller principal Green strain of triangle i; work.tension being d."""
    root, double = math.sqrt(max(_spread(sheet, work, i), 0.0)), 2.0 * sheet.area[i]
    return (work.trace[i] + root) / double, (work.trace[i] - root) / double


@numba.njit(cache=True, error_model="numpy")
def principal(sheet: Sheet, work: SheetWork, i: int) -> tuple[float, float]:
    """Larger and smaller principal elastic strain of triangle i as relative change of length; work.tension being d."""
    first, second = _green(sheet, work, i)
    return _stretch(first), _stretch(second)


@numba.njit(cache=True, error_model="numpy")
def energy(work: SheetWork, i: int) -> float:
    """Elastic energy of triangle i in J; work.tension being d."""
    t = work.trace.size
    p, q, r = work.tension[i], work.tension[t + i], work.tension[2 * t + i]
    squares = p * p + q * q + r * r
    form = work.sum[i] * work.sum[i] - 2.0 * squares
    return 0.25 * (work.modulus[i] * work.trace[i] * work.trace[i] - 0.5 * work.shear[i] * form)


@numba.njit(cache=True, error_model="numpy")
def strain_and_energy(sheet: Sheet, work: SheetWork, springs: Springs, x: Floats) -> tuple[float, float, float]:
    """Largest and smallest principal strain, and elastic energy in J, at nodes x (3, n)."""
    measure(springs, x, work.squares)
    strain(sheet, work)
    largest, smallest, total = -np.inf, np.inf, 0.0
    for i in range(sheet.modulus.size):
        if work.modulus[i] == 0.0:
            continue
        first, second = _green(sheet, work, i)
        largest = max(largest, first)
        smallest = min(smallest, second)
        total += energy(work, i)
    return _stretch(largest), _stretch(smallest), total


@numba.njit(cache=True, error_model="numpy")
def tears(sheet: Sheet, work: SheetWork, i: int) -> bool:
    """Is triangle i above its strength; work.tension being d."""
    return sheet.limit.size > 0 and not holds(
        work.trace[i], _spread(sheet, work, i), sheet.poisson[i], work.limit[i]
    )


@numba.njit(cache=True, error_model="numpy")
def first_torn(sheet: Sheet, work: SheetWork, springs: Springs, x: Floats) -> tuple[int, bool]:
    """Lowest triangle above its strength, or one that is not finite, which wins; is it finite. −1 if there is none."""
    measure(springs, x, work.squares)
    strain(sheet, work)
    torn = -1
    for i in range(sheet.modulus.size):
        if not abs(work.trace[i]) < np.inf:
            return i, False
        if torn < 0 and tears(sheet, work, i):
            torn = i
    return torn, True
