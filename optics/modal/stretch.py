"""Plane waves along a stretched coordinate: a basis for gratings that is fine where the permittivity jumps.

Fields of a lamellar grating have kinks at the walls of its ridges, and poles at the edges of metal, which plane waves
in x resolve slowly. Plane waves exp(iα_m ξ) along a coordinate ξ whose x(ξ) is flat at every wall resolve them fast:
adaptive spatial resolution (Granet 1999, J. Opt. Soc. Am. A 16, 2510; Vallius & Honkanen 2002, Opt. Express 10, 24).
With f = dx/dξ and ⟦·⟧ the Toeplitz matrix of Fourier coefficients over ξ, −i d/dx obeys the Hermitian pencil

    K w = κ ⟦f⟧ w,   K = diag(u_m),   wᴴ ⟦f⟧ w = 1,

whose low eigenvalues κ are the cosines u_m to rounding: its eigenvectors W are the plane waves of homogeneous space.
They are the basis. In it the equations of `optics.modal.lamellar` stay as they are: cosines are κ, half-spaces stay
diagonal, ⟦ε⟧ becomes Wᴴ ⟦fε⟧ W, which is Hermitian where ε is real, so that energy is conserved to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, toeplitz

from beamrider.arrays import Complexes, Floats

# A piece of a layer: start and width in periods, value.
Piece = tuple[float, float, complex]

# Fourier coefficients of f in each interval between walls: ∝ 1 − cos, x moves as the third power of ξ beside a wall, or
# where fields have poles, at the edges of metal, ∝ (1 − cos)², as the fifth.
_SMOOTH, _METAL = (-1 / 2, 1.0, -1 / 2), (1 / 6, -2 / 3, 1.0, -2 / 3, 1 / 6)
# At most this share of ξ is dealt out evenly among the intervals, the rest by their widths.
_EVEN = 0.5
# f at a wall is (2.1 intervals / order)³ of its mean: finer than the orders resolve it would only cost digits.
# (of metal more so, whose matrices are not Hermitian).
_FLOOR, _LEAST, _LEAST_METAL = 2.1, 1e-4, 1e-3
# The longest step of the basis is to leave this many orders for each wave that runs in the densest material.
_FILL = 0.7
_STRENGTHS = np.linspace(1.0, 0.05, 20)
# Walls closer than this (in periods) count as one; orders whose κ is this close to u_m (in pitches) take u_m itself.
THINNEST, _EXACT = 1e-4, 1e-3


@dataclass(frozen=True)
class Mesh:
    """Where a cell jumps: walls in periods, ascending within 0 … 1; its densest index × d/λ; whether there is metal."""

    walls: tuple[float, ...]
    reach: float
    metal: bool


@dataclass(frozen=True)
class Stretch:
    """x(ξ) in periods: where intervals start in x (k + 1, the first again one period on).

    `even`: share of ξ that is dealt out evenly among them. `shape` holds the Fourier coefficients −p … p over an
    interval of f, as a share of its mean there.
    """

    x: tuple[float, ...]
    even: float
    shape: tuple[float, ...]

    @cached_property
    def xi(self) -> tuple[float, ...]:
        """Where the intervals start in ξ (k + 1)."""
        lengths = (1 - self.even) * np.diff(self.x) + self.even / (len(self.x) - 1)
        return tuple((self.x[0] + np.concatenate([[0.0], np.cumsum(lengths)])).tolist())

    def place(self, x: float) -> float:
        """ξ at x, by bisection: x(ξ) ascends."""
        turns, x = divmod(x - self.x[0], 1.0)
        i = min(int(np.searchsorted(self.x, x + self.x[0], side="right")) - 1, len(self.x) - 2)
        share = (x + self.x[0] - self.x[i]) / (self.x[i + 1] - self.x[i])
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if _reached(middle, self.shape) < share else (low, middle)
        t = low if share < 0.5 else high
        return turns + self.xi[i] + t * (self.xi[i + 1] - self.xi[i])

    def coefficients(self, pieces: tuple[Piece, ...], count: int) -> Complexes:
        """Fourier coefficients (2 count + 1,), −count first, over ξ of f times a function, 0 but on the pieces."""
        m = np.arange(-count, count + 1)
        total = np.zeros(m.size, complex)
        for start, width, value in pieces:
            a, b = self.place(start), self.place(start) + width if width == 1.0 else self.place(start + width)
            for i, turn in ((i, t) for t in (-1, 0, 1) for i in range(len(self.x) - 1)):
                low, high = max(a, self.xi[i] + turn), min(b, self.xi[i + 1] + turn)
                if high > low:
                    total = total + value * self._integral(m, i, low - turn, high - turn)
        return total

    @property
    def _harmonics(self) -> list[tuple[int, float]]:
        return list(enumerate(self.shape, -(len(self.shape) // 2)))

    def _integral(self, m: NDArray[np.int64], i: int, low: float, high: float) -> Complexes:
        """∫ f exp(−2πi m ξ) dξ over low … high within interval i."""
        start, length = self.xi[i], self.xi[i + 1] - self.xi[i]
        mean, middle, width = (self.x[i + 1] - self.x[i]) / length, (low + high) / 2, high - low
        parts = [
            c * np.sinc((m - q / length) * width) * np.exp(2j * np.pi * q * (middle - start) / length)
            for q, c in self._harmonics
        ]
        return np.asarray(mean * width * np.exp(-2j * np.pi * m * middle) * np.sum(parts, axis=0))


def _reached(t: float, shape: tuple[float, ...]) -> float:
    """Share of an interval's width that is passed at the share t of its length in ξ."""
    waves = enumerate(shape[len(shape) // 2 + 1 :], 1)
    return t + sum(c * math.sin(2 * math.pi * q * t) / (math.pi * q) for q, c in waves)


@dataclass(frozen=True)
class Basis:
    """Plane waves at one u: cosines κ (n,), ascending, and their coefficients W (n, n) over exp(iα_m ξ).

    Without a stretch κ is u_m, and W is the identity, held as None.
    """

    stretch: Stretch | None
    cosines: Floats
    columns: Complexes | None

    def take(self, matrix: Complexes) -> Complexes:
        """Wᴴ M W of a matrix (n, n) over exp(iα_m ξ)."""
        if self.columns is None:
            return matrix
        return np.asarray(self.columns.conj().T @ (matrix @ self.columns))


def fourier_coefficients(within: Stretch | None, pieces: tuple[Piece, ...], count: int) -> Complexes:
    """Fourier coefficients (2 count + 1,) of a function that is 0 but on the pieces, times f over ξ if stretched."""
    if within:
        return within.coefficients(pieces, count)
    m = np.arange(-count, count + 1)
    total = np.zeros(m.size, complex)
    for start, width, value in pieces:
        total += value * width * np.sinc(m * width) * np.exp(-2j * np.pi * m * (start + width / 2))
    return total


def toeplitz_matrix(coefficients: Complexes) -> Complexes:
    """Toeplitz matrix (n, n) of Fourier coefficients −(n − 1) … n − 1."""
    n = coefficients.size // 2
    return np.asarray(toeplitz(coefficients[n:], coefficients[n::-1]))


def mesh(layers: list[tuple[complex, tuple[Piece, ...]]], reach: float, metal: bool) -> Mesh:
    """Walls of layers, each with its background and ridges (start, width, permittivity)."""
    edges = np.unique([x % 1.0 for _, ridges in layers for start, width, _ in ridges for x in (start, start + width)])
    walls: list[float] = []
    for x in edges:
        if all(min(abs(x - y), 1 - abs(x - y)) > THINNEST for y in walls):
            walls.append(float(x))
    middles = [((a + b) / 2) % 1.0 for a, b in pairwise([*walls, *(x + 1.0 for x in walls[:1])])]
    values = np.array([[_value(layer, x) for layer in layers] for x in middles])
    jumps = [bool(np.any(values[i - 1] != values[i])) for i in range(len(walls))]
    return Mesh(tuple(x for x, jump in zip(walls, jumps, strict=True) if jump), reach, metal)


def _value(layer: tuple[complex, tuple[Piece, ...]], x: float) -> complex:
    background, ridges = layer
    return next((value for start, width, value in ridges if start < x < start + width), background)


@lru_cache(maxsize=256)
def stretch(of: Mesh, order: int) -> Stretch | None:
    """The strongest stretch that leaves enough orders for the waves that run; None where orders are too few for any."""
    k, form = len(of.walls), np.array(_METAL if of.metal else _SMOOTH)
    floor = max(_LEAST_METAL if of.metal else _LEAST, (_FLOOR * k / order) ** 3) if k else 1.0
    x = np.array([*of.walls, *(wall + 1.0 for wall in of.walls[:1])])
    for strength in _STRENGTHS if floor < 1 else ():
        depth = strength * (1 - floor)
        shape = depth * form + (1 - depth) * (np.arange(form.size) == form.size // 2)
        found = Stretch(tuple(x.tolist()), _EVEN * strength, tuple(shape.tolist()))
        longest = (np.diff(x) / np.diff(found.xi)).max() * (1 + depth * (np.abs(form).sum() - 1))
        if of.reach * longest <= _FILL * order:
            return found
    return None


@lru_cache(maxsize=256)
def weight(of: Stretch, n: int) -> Complexes:
    """⟦f⟧ (n, n), Hermitian and positive definite."""
    found = toeplitz_matrix(of.coefficients(((of.x[0], 1.0, 1.0),), n - 1))
    return np.asarray((found + found.conj().T) / 2)


@lru_cache(maxsize=256)
def exact(of: Stretch, n: int) -> NDArray[np.bool_]:
    """Which of the orders (n,) have their own cosine but for rounding."""
    m = np.arange(n) - n // 2
    return np.asarray(np.abs(eigh(np.diag(m.astype(float)), weight(of, n), eigvals_only=True) - m) < _EXACT)


def basis(of: Stretch | None, u: float, pitch: float, order: int) -> Basis:
    """The basis of orders −order … order at one u."""
    u_m = (u + pitch * np.arange(-order, order + 1)).astype(np.float64)
    if of is None:
        return Basis(None, u_m, None)
    cosines, columns = eigh(np.diag(u_m), weight(of, u_m.size))
    return Basis(of, np.where(exact(of, u_m.size), u_m, cosines).astype(np.float64), columns.astype(complex))
