"""Steps through a profile joined into slabs, whose transfer matrices are polynomials in u and v.

What a step does to the fields is, but for the Padé approximant, exp(−i h M) with M of second degree in u and v
(`optics.modal.slanted`): an entire function, and so is the product F of all steps of a slab. For a slab that is thin
against the decay of the highest orders F is smooth over a table's window: Chebyshev series of few terms hold it to
`_RIGHT`, found from the steps themselves at Chebyshev nodes (Trefethen, Approximation Theory and Approximation
Practice, SIAM 2013, chapters 3 and 8: errors fall geometrically, faster for entire functions). A direction then costs
one product a slab instead of one exponential a step. Resonances are not in F but in the reflection ρ, which is carried
upwards as before: nothing is interpolated that could have a pole.

F takes f± = ẑ × E ± h from the bottom of a slab to its top. M(u, −v) is M(u, v) with the signs of all y components
turned: blocks of F between x and x or y and y are even in v, the others odd.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander
from numpy.typing import NDArray

from beamrider.arrays import Complexes, Floats
from optics.modal.slanted import Products, Steps, even_part, full_matrix, generator, products, steps, transfer
from optics.modal.steps import Slanted

# A slab ends before what grows in it grows by more than this: rounding grows as much.
_GROWTH = 3e3
# Series are right by this, relative to the largest entry of F, at the corner of the window, or are not used.
_RIGHT, _MOST_TERMS, _MOST_BYTES = 1e-10, 14, 2**29
# Directions that are worked on together.
_BLOCK = 32


class Slabs(NamedTuple):
    """Coefficients over Chebyshev polynomials in u/u_max (n_u) and v/v_max (n_v, even or odd ones) of F.

    even, odd (n_slabs, n_u · n_v, 2, 2, n, 2, n): blocks of x and x, y and y; of x and y, y and x; each between f₊, f₋.
    """

    reach: tuple[float, float]
    terms: tuple[int, int]
    even: Complexes
    odd: Complexes


@numba.njit(cache=True, error_model="numpy")
def _ends(of: Steps, by: Products, u_m: Floats, v: float) -> NDArray[np.int64]:
    """Numbers of the steps after the last of each slab."""
    n = u_m.size
    matrix, even = np.empty((2, 4 * n, 4 * n), np.complex128)
    product, ends = np.eye(4 * n, dtype=np.complex128), np.zeros(of.thickness.size, np.int64)
    count = 0
    for i in range(of.thickness.size):
        generator(of, i, u_m, v, matrix)
        even_part(of, by, i, u_m, v, even)
        own = transfer(matrix, even)
        product = product @ np.ascontiguousarray(own)
        if i > 0 and np.abs(product).max() > _GROWTH:
            ends[count], product = i, np.ascontiguousarray(own)
            count += 1
    ends[count] = of.thickness.size
    return ends[: count + 1]


@numba.njit(cache=True, error_model="numpy")
def _products(of: Steps, by: Products, ends: NDArray[np.int64], u_m: Floats, v: float, out: Complexes) -> None:
    """F of each slab (n_slabs, 4n, 4n), in the order f₊x, f₊y, f₋x, f₋y."""
    m, first = 2 * u_m.size, 0
    matrix, even = np.empty((2, 2 * m, 2 * m), np.complex128)
    for s in range(ends.size):
        product = np.eye(2 * m, dtype=np.complex128)
        for i in range(first, ends[s]):
            generator(of, i, u_m, v, matrix)
            even_part(of, by, i, u_m, v, even)
            product = product @ np.ascontiguousarray(transfer(matrix, even))
        plus, minus = product[:m] + product[m:], product[:m] - product[m:]
        out[s, :m, :m], out[s, :m, m:] = (plus[:, :m] + plus[:, m:]) / 2, (plus[:, :m] - plus[:, m:]) / 2
        out[s, m:, :m], out[s, m:, m:] = (minus[:, :m] + minus[:, m:]) / 2, (minus[:, :m] - minus[:, m:]) / 2
        first = ends[s]


def _cosines(cell: Slanted, u: float, order: int) -> Floats:
    return np.asarray(u + cell.pitch * np.arange(-order, order + 1))


def _apart(f: Complexes) -> tuple[Complexes, Complexes]:
    """Blocks (n_slabs, 2, 2, n, 2, n) of F (n_slabs, 4n, 4n) that are even and odd in v."""
    n = f.shape[-1] // 4
    parts = f.reshape(-1, 2, 2, n, 2, 2, n)  # ±, xy, order; ±, xy, order
    even, odd = (
        np.stack([parts[:, :, a, :, :, b] for a, b in pairs], axis=1) for pairs in (((0, 0), (1, 1)), ((0, 1), (1, 0)))
    )
    return even, odd


def _together(even: Complexes, odd: Complexes) -> Complexes:
    """F (n_d, 4n, 4n) from its blocks (n_d, 2, 2, n, 2, n); the reverse of `_apart`."""
    n = even.shape[-1]
    out = np.empty((len(even), 2, 2, n, 2, 2, n), complex)
    out[:, :, 0, :, :, 0], out[:, :, 1, :, :, 1] = even[:, 0], even[:, 1]
    out[:, :, 0, :, :, 1], out[:, :, 1, :, :, 0] = odd[:, 0], odd[:, 1]
    return out.reshape(len(even), 4 * n, 4 * n)


def _series(of: Slabs, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """The even and odd polynomials (n_d, n_u · n_v) at directions (n_d)."""
    n_u, n_v = of.terms
    in_u, in_v = chebvander(u / of.reach[0], n_u - 1), chebvander(v / of.reach[1], 2 * n_v - 1)
    even, odd = ((in_u[:, :, None] * in_v[:, None, part::2]).reshape(u.size, -1) for part in (0, 1))
    return even, odd


def _sum(weights: Floats, coefficients: Complexes) -> Complexes:
    """Σ weight × coefficients (n_d, …), real weights (n_d, terms)."""
    flat = weights @ coefficients.reshape(len(coefficients), -1).view(float)
    return np.asarray(flat.view(complex).reshape(-1, *coefficients.shape[1:]))


def _fit(cell: Slanted, of: Steps, by: Products, ends: NDArray[np.int64], order: int, terms: tuple[int, int]) -> Slabs:
    """The series with so many terms, from as many nodes."""
    assert cell.reach is not None
    n, (n_u, n_v) = 2 * order + 1, terms
    x, y = chebpts1(n_u), chebpts1(2 * n_v)[n_v:]
    even, odd = np.empty((2, n_u, n_v, ends.size, 2, 2, n, 2, n), complex)
    whole = np.empty((ends.size, 4 * n, 4 * n), complex)
    for i, a in enumerate(x):
        for j, b in enumerate(y):
            _products(of, by, ends, _cosines(cell, a * cell.reach[0], order), b * cell.reach[1], whole)
            even[i, j], odd[i, j] = _apart(whole)
    in_v = chebvander(y, 2 * n_v - 1)
    per_u, found = np.linalg.inv(chebvander(x, n_u - 1)), []
    for values, part in ((even, 0), (odd, 1)):
        per = np.asarray(np.kron(per_u, np.linalg.inv(in_v[:, part::2])), float)
        c = _sum(per, values.reshape(n_u * n_v, -1))
        found.append(np.ascontiguousarray(np.swapaxes(c.reshape(n_u * n_v, *values.shape[2:]), 0, 1)))
    return Slabs(cell.reach, terms, *found)


def _terms(size: float) -> int:
    """Terms of a Chebyshev series of exp(size x) that leave `_RIGHT` / 10: I_k(size) ≈ (size/2)^k / k!."""
    left, k = 1.0, 0
    while left > 0.1 * _RIGHT and k < _MOST_TERMS:
        k += 1
        left *= size / 2 / k
    return max(k, 2)


@lru_cache(maxsize=3)
def slabs(cell: Slanted, order: int) -> Slabs | None:
    """The slabs of a profile over the directions that it says it will be asked for.

    None where it does not, or where they would not be right or take too much memory.
    """
    if cell.reach is None:
        return None
    of, by, (u, v) = steps(cell, order), products(cell, order), cell.reach
    corner = _cosines(cell, u, order), v
    ends = _ends(of, by, *corner)
    thickest = max(float(part.sum()) for part in np.split(of.thickness, ends[:-1]))
    terms = _terms(thickest * u), (_terms(thickest * v) + 1) // 2
    exact = np.empty((ends.size, *2 * (8 * order + 4,)), complex)
    _products(of, by, ends, *corner, exact)
    for more in (0, 2):
        n_u, n_v = terms[0] + more, terms[1] + more // 2
        if n_u * n_v * exact.nbytes > _MOST_BYTES:
            return None
        found = _fit(cell, of, by, ends, order, (n_u, n_v))
        in_even, in_odd = _series(found, np.array([u]), np.array([v]))
        error = max(
            float(np.abs(_together(_sum(in_even, a), _sum(in_odd, b))[0] - f).max() / np.abs(f).max())
            for a, b, f in zip(found.even, found.odd, exact, strict=True)
        )
        if error < _RIGHT:
            return found
    return None


def climb_slabs(
    of: Slabs,
    u: Floats,
    v: Floats,
    front: Complexes,
    back: Complexes,
    source: Complexes,
    outer: Complexes,
    inner: Complexes,
) -> None:
    """As `optics.modal.slanted.climb_steps`, for directions u, v (n_d)."""
    for begin in range(0, u.size, _BLOCK):
        part = slice(begin, begin + _BLOCK)
        weights = _series(of, u[part], v[part])
        rho, through = np.stack([full_matrix(one) for one in back[part]]), []
        m = rho.shape[-1]
        for even, odd in zip(of.even[::-1], of.odd[::-1], strict=True):
            f = _together(_sum(weights[0], even), _sum(weights[1], odd))
            top = f[..., :m] + f[..., m:] @ rho
            through.append(top[:, :m])
            rho = np.swapaxes(np.linalg.solve(np.swapaxes(top[:, :m], 1, 2), np.swapaxes(top[:, m:], 1, 2)), 1, 2)
        ahead = np.stack([full_matrix(one) for one in front[part]])
        field = np.linalg.solve(np.eye(m) - ahead @ rho, source[part])
        outer[part, 0], outer[part, 1] = field, rho @ field
        for plus in reversed(through):
            field = np.linalg.solve(plus, field)
        inner[part] = field
