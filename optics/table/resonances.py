"""Narrow guided-mode resonances of a grating: the poles of its response, found on lines of v and followed along v.

An efficiency is a Hermitian form of amplitudes that are meromorphic in u between cut-offs, where every guided mode that
leaks is a pole (Hessel & Oliner 1965, Appl. Opt. 4, 1275; Fan & Joannopoulos 2002, Phys. Rev. B 65, 235112). Real
quantities have each pole p and its conjugate, both simple, together

    Re[h γ / (u − p)],   p = x + iγ,

with one h for each quantity: its height at u = x is about |h|. In τ (`optics.table.strips`) the response has no branch
point at the cut-offs either, so that a rational function through samples 0.006 apart in u converges to 1e-8 or better,
and a resonance of width γ is seen in samples that are D away by its tail, at least h (γ/D)².
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Complexes, Floats
from optics.table.rational import Rational, fit
from optics.table.strips import NEAR, Curves, to_tau

# Quantities (k, n) at directions u (n) on the line v.
Along = Callable[[Floats, float], Floats]

# Resonances of half this width in u and in τ are taken out whole, wider ones in part, those of the full width not at
# all.
_WIDE_U, _WIDE_TAU = 4e-3, 0.04
_ROWS_BEYOND = 5
# Residues below this cannot be told from rounding.
_FAINT = 1e-8
# The rational function has to agree with new samples by this.
_RIGHT, _FIT = 1e-7, 1e-10
_EVEN, _MOST_POLES, _ROUNDS = 12, 60, 8
_BESIDE = np.array([-30.0, -9.0, -3.1, -1.1, -0.3, 0.4, 1.3, 3.3, 10.0, 33.0])


@dataclass(frozen=True)
class Window:
    """Where resonances are felt, low ≤ u ≤ high, and looked for, `reach` beyond; `curves`: all cut-offs there.

    Those that lie beyond an edge fade out on the way to the reach.
    """

    low: float
    high: float
    reach: float
    curves: Curves

    def edges(self, v: float) -> Floats:
        """Ends (n,) of the strips between cut-offs on a line."""
        ends = self.low - self.reach, self.high + self.reach
        cut = self.curves.u(np.array([v]))[:, 0]
        found = np.unique([*ends, *cut[(cut > ends[0]) & (cut < ends[1])]])
        return np.asarray(found[np.append(True, np.diff(found) > NEAR)])

    def rows(self) -> Floats:
        """Rows (n,) beyond the edges."""
        far = self.reach * np.arange(1, _ROWS_BEYOND + 1) / _ROWS_BEYOND
        return np.concatenate([self.low - far[::-1], self.high + far])

    def felt(self, u: Floats) -> Floats:
        """The part of a resonance at u (n) that is taken out."""
        return _fade(np.maximum(np.maximum(self.low - u, u - self.high), 0.0) / self.reach)


@dataclass(frozen=True)
class LinePoles:
    """Poles p (n), Im p > 0, on a line of v, and the heights h (k, n) that are to be taken out.

    missed: where in u the rational function did not converge, and by how much.
    """

    v: float
    p: Complexes
    h: Complexes
    missed: tuple[tuple[float, float], ...] = ()

    def __call__(self, u: Floats) -> Floats:
        """The sum over the poles (k, n_u) at u."""
        return np.asarray((self.h * self.p.imag) @ (1.0 / (u - self.p[:, None]))).real


def _fade(x: Floats) -> Floats:
    """1 up to x = 1/2, 0 from x = 1 on, smooth between."""
    s = np.clip(2.0 - 2.0 * x, 0.0, 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))


def _join(tau: Floats, values: Floats, more: Floats, found: Floats) -> tuple[Floats, Floats]:
    """Samples and more samples, in order."""
    order = np.argsort(every := np.append(tau, more))
    return every[order], np.concatenate([values, found], axis=1)[:, order]


@dataclass
class _Strip:
    """The strip a … b on a line: samples tau (n), values (k, n), and the largest error of the rational function."""

    solve: Along
    v: float
    a: float
    b: float
    tau: Floats
    values: Floats
    error: float = np.inf

    def place(self, tau: Complexes | Floats) -> Complexes:
        """U (...) at τ (...)."""
        return np.asarray(self.a + (self.b - self.a) * tau**2 / (tau**2 + (1.0 - tau) ** 2), complex)

    def beside(self, x: Floats, scale: Floats) -> Floats:
        """Places τ within the strip that are some scales away from x (n) in u."""
        u = (x[:, None] + scale[:, None] * _BESIDE).ravel()
        return to_tau((u[(u > self.a) & (u < self.b)] - self.a) / (self.b - self.a))

    def add(self, tau: Floats, rational: Rational | None = None) -> float:
        """Take more samples at tau (n,); the largest error there of the rational function so far."""
        tau = np.array([t for t in np.unique(tau) if np.abs(self.tau - t).min(initial=1.0) > NEAR])
        if not tau.size:
            return 0.0
        new = self.solve(self.place(tau).real, self.v)
        self.tau, self.values = _join(self.tau, self.values, tau, new)
        return float(np.abs(rational(tau) - new).max()) if rational else 0.0

    def poles(self, rational: Rational) -> tuple[Complexes, Complexes, Floats]:
        """Poles (n,) near the strip, Im ≥ 0, with 2 × residues (n_q, n), in u, and how wide they are in τ (n,)."""
        at, residues = rational.poles()
        keep = (at.imag >= 0) & (at.imag < _WIDE_TAU) & (at.real > -_WIDE_TAU) & (at.real < 1.0 + _WIDE_TAU)
        at, residues = at[keep], residues[:, keep]
        p = self.place(at)
        c = 4.0 * residues * (self.b - self.a) * at * (1.0 - at) / (at**2 + (1.0 - at) ** 2) ** 2
        keep = (p.imag >= 0.0) & (p.imag < _WIDE_U) & (np.abs(c).max(axis=0, initial=0.0) > _FAINT)
        return p[keep], c[:, keep], at.imag[keep]

    def find(self) -> tuple[Complexes, Complexes, Floats]:
        """Poles (n,), heights (n_q, n) and widths in τ (n,), once the rational function is right at samples there.

        From afar the place and the residue of a pole are seen, but not its width: it seems to be on the real axis. The
        residue is the width times a height of about 1.
        """
        for _ in range(_ROUNDS):
            rational = fit(self.tau, self.values, _FIT, min(_MOST_POLES, 2 * self.tau.size // 3))
            p, c, width = self.poles(rational)
            self.error = rational.error
            if rational.error > _RIGHT:
                self.add((self.tau[1:] + self.tau[:-1]) / 2)
                continue
            near = self.beside(p.real, np.maximum(p.imag, np.abs(c).max(axis=0, initial=0.0)))
            self.error = max(rational.error, self.add(near, rational))
            if self.error < _RIGHT:
                break
        real = p.imag > 0.1 * _FAINT
        return p[real], c[:, real] / p.imag[real], width[real]


def _strip(solve: Along, v: float, a: float, b: float, rows: Floats, values: Floats, known: Complexes) -> _Strip:
    """A strip with the rows in it as its first samples, more where they are few, and some beside known poles."""
    inside = (rows > a + NEAR) & (rows < b - NEAR)
    strip = _Strip(solve, v, a, b, to_tau((rows[inside] - a) / (b - a)), values[:, inside])
    even = (1.0 - np.cos(np.pi * np.arange(_EVEN + 1) / _EVEN)) / 2
    lonely = np.abs(even[:, None] - strip.tau).min(axis=1, initial=1.0) > 0.4 / _EVEN
    lonely[[0, -1]] = True
    strip.add(np.append(even[lonely], strip.beside(known.real, known.imag)))
    return strip


def _once(p: Complexes, strip: NDArray[np.int64]) -> list[int]:
    """Poles that are not found again in a neighbouring strip."""
    kept: list[int] = []
    for k in np.argsort(p.real):
        if all(strip[k] == strip[j] or abs(p[k] - p[j]) > max(p[k].imag, p[j].imag) for j in kept):
            kept.append(int(k))
    return kept


def find_poles(
    solve: Along,
    window: Window,
    rows: Floats,
    v: float,
    lowest: float,
    values: Floats | None = None,
    known: Complexes | None = None,
) -> LinePoles:
    """Narrow poles on the line v, those of heights above `lowest`.

    Samples are taken on `rows` (n), where the `values` (k, n) may be known already, and beside `known` poles.
    """
    values = solve(rows, v) if values is None else values
    more = window.rows()
    rows, values = _join(rows, values, more, solve(more, v))
    edges, found, missed = window.edges(v).tolist(), [], []
    for a, b in pairwise(edges):
        strip = _strip(solve, v, a, b, rows, values, np.empty(0, complex) if known is None else known)
        p, h, width = strip.find()
        left, right = (a if a > edges[0] else -np.inf), (b if b < edges[-1] else np.inf)
        own = (p.real > left - 3.0 * p.imag) & (p.real < right + 3.0 * p.imag)
        found.append((p[own], h[:, own] * _fade(width[own] / _WIDE_TAU)))
        if strip.error > _RIGHT:
            missed.append(((a + b) / 2, strip.error))
    p, h = np.concatenate([p for p, _ in found]), np.concatenate([h for _, h in found], axis=1)
    h = h * _fade(p.imag / _WIDE_U) * window.felt(p.real)
    strips = np.repeat(np.arange(len(found)), [p.size for p, _ in found])
    kept = [k for k in _once(p, strips) if np.abs(h[:, k]).max() > lowest]
    return LinePoles(v, p[kept], h[:, kept], tuple(missed))
