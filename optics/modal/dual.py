"""Forward-mode derivatives of array expressions: a value and its derivatives by several parameters, carried together.

Griewank & Walther, Evaluating Derivatives (SIAM 2008), §3.1; derivatives of eigenvectors after Giles, An extended
collection of matrix derivative results for forward and reverse mode algorithmic differentiation (Oxford 2008), §3.1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
# Eigenvalues closer than this (relative) are taken for a space in which any basis will do.
_DEGENERATE = 1e-13


class Dual:
    """An array `value` (...) and its derivatives `dot` (n_parameters, ...)."""

    __array_ufunc__ = None  # NumPy leaves mixed expressions to this class

    def __init__(self, value: Any, dot: Any) -> None:
        self.value = np.asarray(value)
        self.dot = np.asarray(dot)

    def __add__(self, other: Any) -> Dual:
        a, b = _aligned(self, other)
        return Dual(a.value + b.value, a.dot + b.dot)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.dot)

    def __sub__(self, other: Any) -> Dual:
        return self + (-lift(other, self))

    def __rsub__(self, other: Any) -> Dual:
        return lift(other, self) + (-self)

    def __mul__(self, other: Any) -> Dual:
        a, b = _aligned(self, other)
        return Dual(a.value * b.value, a.dot * b.value + a.value * b.dot)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        a, b = _aligned(self, other)
        ratio = a.value / b.value
        return Dual(ratio, (a.dot - ratio * b.dot) / b.value)

    def __rtruediv__(self, other: Any) -> Dual:
        return lift(other, self) / self

    def __matmul__(self, other: Any) -> Dual:
        b = lift(other, self)
        return Dual(self.value @ b.value, self.dot @ b.value + self.value @ b.dot)

    def __rmatmul__(self, other: Any) -> Dual:
        return lift(other, self) @ self

    def __getitem__(self, key: Any) -> Dual:
        every = (slice(None), *key) if isinstance(key, tuple) else (slice(None), key)
        return Dual(self.value[key], self.dot[every])

    @property
    def conj(self) -> Dual:
        """Complex conjugate."""
        return Dual(self.value.conj(), self.dot.conj())

    @property
    def real(self) -> Dual:
        """Real part."""
        return Dual(self.value.real, self.dot.real)

    def sum(self) -> Dual:
        """Sum of all elements."""
        return Dual(self.value.sum(), self.dot.reshape(self.dot.shape[0], -1).sum(axis=1))

    def where(self, condition: Array) -> Dual:
        """Self where the condition (same shape) holds, else 0."""
        return Dual(np.where(condition, self.value, 0.0), np.where(condition, self.dot, 0.0))


def lift(x: Any, like: Dual) -> Dual:
    """`x` as it is if it is a Dual, else a constant with as many derivatives as `like`."""
    if isinstance(x, Dual):
        return x
    value = np.asarray(x)
    return Dual(value, np.zeros((like.dot.shape[0], *value.shape)))


def _aligned(a: Dual, other: Any) -> tuple[Dual, Dual]:
    """Both operands with equally many axes, so that none is mistaken for the parameters' axis in front."""
    b = lift(other, a)
    n = max(a.value.ndim, b.value.ndim)
    return _widened(a, n), _widened(b, n)


def _widened(x: Dual, n: int) -> Dual:
    shape = (*(1,) * (n - x.value.ndim), *x.value.shape)
    return Dual(x.value.reshape(shape), x.dot.reshape(x.dot.shape[0], *shape))


def sqrt(x: Dual, root: Callable[[Array], Array] = np.sqrt) -> Dual:
    """Square root on the branch that `root` chooses."""
    value = root(x.value)
    return Dual(value, x.dot / (2.0 * value))


def exp(x: Dual) -> Dual:
    """Exponential."""
    value = np.exp(x.value)
    return Dual(value, value * x.dot)


def concatenate(parts: list[Dual], axis: int) -> Dual:
    """Arrays of equal shape but for `axis` ≥ 0, one after the other."""
    return Dual(np.concatenate([x.value for x in parts], axis), np.concatenate([x.dot for x in parts], axis + 1))


def stack(parts: list[Dual]) -> Dual:
    """Scalars as a vector."""
    return Dual(np.stack([x.value for x in parts]), np.stack([x.dot for x in parts], axis=1))


def diagonal(x: Dual) -> Dual:
    """Vector (n,) as a diagonal matrix (n, n)."""
    return Dual(np.diag(x.value), x.dot[:, :, None] * np.eye(x.value.size))


def solve(a: Dual, b: Dual | Array) -> Dual:
    """X of A X = B: dX = A⁻¹ (dB − dA X)."""
    right = lift(b, a)
    x = np.linalg.solve(a.value, right.value)
    return Dual(x, np.linalg.solve(a.value, right.dot - a.dot @ x))


def transpose(x: Dual) -> Dual:
    """Transposed matrix."""
    return Dual(x.value.T, np.swapaxes(x.dot, 1, 2))


def eig(a: Dual) -> tuple[Dual, Dual]:
    """Eigenvalues (n,) and eigenvectors (n, n) of A; with P = X⁻¹ dA X: dλ = diag P, dX = X (P_ij/(λ_j − λ_i))_i≠j."""
    values, vectors = np.linalg.eig(a.value)
    p = np.linalg.solve(vectors, a.dot @ vectors)
    gaps = values[None, :] - values[:, None]
    apart = np.abs(gaps) > _DEGENERATE * np.abs(values).max()
    turn = np.where(apart, p, 0.0) / np.where(apart, gaps, 1.0)
    return Dual(values, np.einsum("tii->ti", p)), Dual(vectors, vectors @ turn)
