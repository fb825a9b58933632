"""Linear algebra on small complex matrices, for compiled functions: the same bits on every machine."""

from __future__ import annotations

import numba
import numpy as np

from beamrider.arrays import Complexes


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _size(z: complex) -> float:
    return abs(z.real) + abs(z.imag)


@numba.njit(cache=True, error_model="numpy")
def _exchange(a: Complexes, i: int, j: int) -> None:
    """Exchange two rows."""
    for k in range(a.shape[1]):
        a[i, k], a[j, k] = a[j, k], a[i, k]


@numba.njit(cache=True, error_model="numpy")
def _pivot(a: Complexes, k: int) -> int:
    """The row from k on with the largest number in column k."""
    best = k
    for i in range(k + 1, a.shape[0]):
        if _size(a[i, k]) > _size(a[best, k]):
            best = i
    return best


@numba.njit(cache=True, error_model="numpy")
def eliminate(a: Complexes, b: Complexes) -> None:
    """Solve a x = b in place: b (n, columns) becomes x, a (n, n) is used up. Gauss, with partial pivoting."""
    n = a.shape[0]
    for k in range(n):
        row = _pivot(a, k)
        if row != k:
            _exchange(a, k, row)
            _exchange(b, k, row)
        scale = 1.0 / a[k, k]
        for i in range(k + 1, n):
            factor = a[i, k] * scale
            if factor == 0.0:
                continue
            for j in range(k + 1, n):
                a[i, j] -= factor * a[k, j]
            for j in range(b.shape[1]):
                b[i, j] -= factor * b[k, j]
    for k in range(n - 1, -1, -1):
        scale = 1.0 / a[k, k]
        for j in range(b.shape[1]):
            total = b[k, j]
            for i in range(k + 1, n):
                total -= a[k, i] * b[i, j]
            b[k, j] = total * scale


@numba.njit(cache=True, error_model="numpy")
def product(a: Complexes, b: Complexes) -> Complexes:
    """The product of two matrices, (n, k) and (k, m)."""
    out = np.zeros((a.shape[0], b.shape[1]), np.complex128)
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@numba.njit(cache=True, error_model="numpy")
def norm(a: Complexes) -> float:
    """Root of the sum of all |a|², a (n, m)."""
    total = 0.0
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            total += a[i, j].real * a[i, j].real + a[i, j].imag * a[i, j].imag
    return float(np.sqrt(total))


@numba.njit(cache=True, error_model="numpy")
def unit(n: int) -> Complexes:
    """The unit matrix (n, n)."""
    out = np.zeros((n, n), np.complex128)
    for i in range(n):
        out[i, i] = 1.0
    return out
