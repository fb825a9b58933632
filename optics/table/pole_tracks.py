"""Poles of a grating's response followed along v: how many nodes in v it takes, and what is left between them.

Places, widths and heights of the poles are stored on lines of v that all poles share, with cubic Hermite interpolation
between. A pole that fades out, or comes into the window, has height zero on the other lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import linear_sum_assignment

from beamrider.arrays import Complexes, Floats
from beamrider.io.files import progress
from optics.table.hermite import Values, v_slopes
from optics.table.pole_sum import pack_poles, sum_poles
from optics.table.resonances import LinePoles, Window
from optics.table.strips import Curves

# From v to the poles there, near those that are expected.
Find = Callable[[float, Complexes], LinePoles]

# Poles further apart on neighbouring lines are not the same. Narrower intervals of v are not halved.
_REACH, _SMALLEST_V, _MOST_LINES, _ROUNDS = 0.02, 1e-4, 400, 16
# Where two sums are compared: this many widths from every pole.
_COMPARED = np.array([-10.0, -3.0, -1.0, -0.4, 0.0, 0.4, 1.0, 3.0, 10.0])


@dataclass(frozen=True)
class Resonances:
    """Poles over v: v (n) ascending from 0, p (n_p, n) with Im p > 0, heights h (k, n_p, n), parity (k) under v → −v.

    For v ≥ 0 they add Re[h γ / (u − p)], γ = Im p, to each of the k quantities.
    """

    v: Floats
    p: Complexes
    h: Complexes
    parity: Floats

    @property
    def count(self) -> int:
        """Number of poles."""
        return len(self.p)

    @cached_property
    def felt(self) -> NDArray[np.bool_]:
        """Where a pole has a height (n_p, n): on consecutive nodes."""
        return np.asarray((self.h != 0.0).any(axis=0))

    def take(self, quantities: slice) -> Resonances:
        """The same poles in some of the quantities."""
        part = Resonances(self.v, self.p, self.h[quantities], self.parity[quantities])
        part.__dict__["felt"] = self.felt  # slopes shall be the same
        return part

    @cached_property
    def slopes(self) -> tuple[Complexes, Complexes]:
        """∂v of p (n_poles, n_v) and h (n_q, n_poles, n_v), from the nodes on which each pole is felt."""
        p_v, h_v = np.zeros_like(self.p), np.zeros_like(self.h)
        for k, felt in enumerate(self.felt):
            at = np.flatnonzero(felt)
            if not at.size:
                continue
            part = slice(at[0], at[-1] + 1)
            p_v[k, part] = _slopes(self.v[part], self.p[[k], part], np.ones(1))[0]
            h_v[:, k, part] = _slopes(self.v[part], self.h[:, k, part], self.parity)
            p_v[k, : part.start], p_v[k, part.stop :] = p_v[k, at[0]].real, p_v[k, at[-1]].real
        return p_v, h_v

    @cached_property
    def packed(self) -> Floats:
        """The numbers (n,) for `optics.table.pole_sum`."""
        return pack_poles(self.v, self.p, self.h, *self.slopes)

    def on(self, u: Floats, v: Floats) -> Floats:
        """What they add (k, ...) at directions u, v ≥ 0 (broadcast), k a multiple of 4."""
        uu, vv = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        out = np.empty((uu.size, len(self.h)))
        sum_poles(self.packed, self.count, self.v.size, uu.flatten(), vv.flatten(), out)
        return np.moveaxis(out.reshape(*uu.shape, len(self.h)), -1, 0)

    def place(self, pole: int, v: Floats) -> Complexes:
        """Where a pole is (n) at v (n)."""
        return np.asarray(CubicHermiteSpline(self.v, self.p[pole], self.slopes[0][pole])(v))

    def line(self, v: float) -> LinePoles:
        """The poles that are felt on the line v."""
        j = int(np.clip(np.searchsorted(self.v, v) - 1, 0, self.v.size - 2))
        felt = self.felt[:, j : j + 2].any(axis=1)
        pair, (p_v, h_v) = slice(j, j + 2), self.slopes
        p = CubicHermiteSpline(self.v[pair], self.p[felt, pair], p_v[felt, pair], axis=-1)(v)
        h = CubicHermiteSpline(self.v[pair], self.h[:, felt, pair], h_v[:, felt, pair], axis=-1)(v)
        return LinePoles(v, p, h)


def _slopes(v: Floats, f: Complexes, parity: Floats) -> Complexes:
    """∂f/∂v (k, n) of complex quantities f (k, n) on lines v (n)."""
    if v.size < 2:
        return np.zeros_like(f)
    real, imag = (v_slopes(v, part[:, None], parity)[:, 0] for part in (f.real, f.imag))
    return np.asarray(real + 1j * imag)


def without(values: Values, curves: Curves, resonances: Resonances) -> Values:
    """The values of a table less those of its resonances: what is interpolated."""
    u = curves.u(values.v)
    return replace(
        values,
        nodes=values.nodes - resonances.on(values.u[:, None], values.v),
        on_curves=values.on_curves - resonances.on(u, values.v),
    )


def no_resonances(parity: Floats) -> Resonances:
    """None at all, of quantities of parity (n_q,)."""
    none, heights = np.empty((0, 2), complex), np.empty((parity.size, 0, 2), complex)
    return Resonances(np.array([0.0, 1.0]), none, heights, parity)


@dataclass
class _Run:
    """One pole on consecutive lines, the first of which is `first`."""

    first: int
    p: list[complex] = field(default_factory=list)
    h: list[Complexes] = field(default_factory=list)

    def expected(self, lines: list[LinePoles], j: int) -> complex:
        """Where it should be on line j, from the last two: p is even in v."""
        if len(self.p) < 2:
            return self.p[-1]
        a, b, c = (lines[i].v ** 2 for i in (j - 2, j - 1, j))
        return self.p[-1] + (self.p[-1] - self.p[-2]) * (c - b) / (b - a)


def _chain(lines: list[LinePoles]) -> list[_Run]:
    """Poles that belong together, line by line."""
    done: list[_Run] = []
    open_: list[_Run] = []
    for j, line in enumerate(lines):
        expected = np.array([run.expected(lines, j) for run in open_], complex)
        apart = np.abs(expected[:, None] - line.p)
        pairs = [(a, b) for a, b in zip(*linear_sum_assignment(apart), strict=True) if apart[a, b] < _REACH]
        goes_on = {a for a, _ in pairs}
        done += [run for a, run in enumerate(open_) if a not in goes_on]
        new = [_Run(j, [line.p[b]], [line.h[:, b]]) for b in range(line.p.size) if b not in {b for _, b in pairs}]
        for a, b in pairs:
            open_[a].p.append(line.p[b])
            open_[a].h.append(line.h[:, b])
        open_ = [open_[a] for a in sorted(goes_on)] + new
    return sorted([*done, *open_], key=lambda run: (run.first, run.p[0].real))


def join(lines: list[LinePoles], parity: Floats) -> Resonances:
    """Poles over v from those on lines in order of v; parity (n_q,)."""
    runs, v = _chain(lines), np.array([line.v for line in lines])
    p, h = np.zeros((len(runs), v.size), complex), np.zeros((parity.size, len(runs), v.size), complex)
    for k, run in enumerate(runs):
        part = slice(run.first, run.first + len(run.p))
        h[:, k, part] = np.array(run.h).T
        # Beyond its ends, where it is not felt, the pole goes on as it ended.
        slope = _slopes(v[part], np.array([run.p]), np.ones(1))[0].real
        p[k, part] = run.p
        p[k, : part.start] = run.p[0] + slope[0] * (v[: part.start] - v[part.start])
        p[k, part.stop :] = run.p[-1] + slope[-1] * (v[part.stop :] - v[part.stop - 1])
    return Resonances(v, p, h, parity)


def difference(one: LinePoles, other: LinePoles, window: Window, leading: int) -> float:
    """Largest difference of two sums on a line, around all their poles."""
    p = np.concatenate([one.p, other.p])
    u = (p.real[:, None] + p.imag[:, None] * _COMPARED).ravel()
    u = u[(u >= window.low) & (u <= window.high)]
    return float(np.abs((one(u) - other(u))[:leading]).max(initial=0.0))


@dataclass(frozen=True)
class Followed:
    """The poles, where a resonance is not met (v, error), and lines on which a search for poles did not end."""

    resonances: Resonances
    left: tuple[tuple[float, float], ...]
    missed: tuple[LinePoles, ...]


def follow(
    find: Find,
    lines: list[LinePoles],
    window: Window,
    parity: Floats,
    leading: int,
    tolerance: float,
    name: str = "table",
) -> Followed:
    """Poles over v from those on `lines`; more lines until the sum is right to `tolerance` halfway between.

    parity (n_q,).
    """
    lines, tested = sorted(lines, key=lambda line: line.v), {}
    if not any(line.p.size for line in lines):
        return Followed(no_resonances(parity), (), tuple(line for line in lines if line.missed))
    for _ in progress(range(_ROUNDS), f"{name}: resonances", unit="round"):
        resonances = join(lines, parity)
        more: list[LinePoles] = []
        for a, b in pairwise(line.v for line in lines):
            if (a, b) in tested:
                continue
            line = find((a + b) / 2, resonances.line((a + b) / 2).p)
            tested[a, b] = difference(resonances.line(line.v), line, window, leading)
            if tested[a, b] > tolerance and b - a > _SMALLEST_V and len(lines) + len(more) < _MOST_LINES:
                more.append(line)
        if not more:
            break
        lines = sorted([*lines, *more], key=lambda line: line.v)
    resonances = join(lines, parity)
    left = tuple(
        ((a + b) / 2, tested.get((a, b), np.inf))
        for a, b in pairwise(line.v for line in lines)
        if tested.get((a, b), np.inf) > tolerance
    )
    return Followed(resonances, left, tuple(line for line in lines if line.missed))
