"""Regions of directions in which the response of a grating is smooth: strips between its Rayleigh cut-offs.

A diffraction order m appears or vanishes in a half-space of index n on the curves u = ±√(n² − v²) − m λ/d. Beside such
a curve q behaves like the square root of the distance. Between two neighbouring curves a(v), b(v) it is smooth in τ,

    u = a + (b − a) x,   x = τ² / (τ² + (1 − τ)²),   τ = √x / (√x + √(1 − x)),

as u − a ∝ τ² beside the one and b − u ∝ (1 − τ)² beside the other. A window edge is treated as a curve; there q is even
in τ. Where curves cross, or leave the window, the range of v is split.

    v ↑   │  lane 0   ╲ ╱   lane 1   │      strip: one pair of neighbouring curves, over a range of v
          │            ╳             │      lane: strips that pass into each other where the range of v is split;
          │  lane 0   ╱2╲   lane 1   │            they share their nodes in τ, so that q is continuous across
          └──────────────────────────┴→ u
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers

# Closer than this in u or v, two curves meet.
NEAR = 1e-9


@dataclass(frozen=True)
class Curves:
    """Curves u(v) = sign √(index² − v²) − shift, arrays (n,), with shift = order · λ/d − offset.

    offset = 0: the cut-off of an order; otherwise a line of nodes beside it, where the response changes fast. sign = 0
    makes a straight line u = −shift: an edge of the window.
    """

    order: Integers
    sign: Floats
    index: Floats
    shift: Floats
    offset: Floats

    def __len__(self) -> int:
        return int(self.sign.size)

    def u(self, v: Floats) -> Floats:
        """Where the curves are (n, n_v) at v (n_v)."""
        root = np.sqrt((self.index**2)[:, None] - np.asarray(v) ** 2)
        return np.asarray(self.sign[:, None] * root - self.shift[:, None])

    def inside(self, v: Floats, u_min: float, u_max: float) -> NDArray[np.bool_]:
        """Which curves are within the window (n, n_v) at v (n_v)."""
        u = self.u(v)
        return np.asarray((u >= u_min - NEAR) & (u <= u_max + NEAR))

    def take(self, which: NDArray[np.bool_] | list[int]) -> Curves:
        """Some of the curves, by their numbers (n,) or a mask (n_curves,)."""
        return Curves(*(part[which] for part in vars(self).values()))

    def beside(self, offset: Floats) -> Curves:
        """The curves shifted by offsets (n,) in u."""
        return Curves(self.order, self.sign, self.index, self.shift - offset, self.offset + offset)

    def with_edges(self, u_min: float, u_max: float, v_max: float) -> Curves:
        """The curves followed by the two edges of the window."""
        far = max([v_max + 1.0, *self.index])
        return Curves(
            np.append(self.order, [0, 0]),
            np.append(self.sign, [0.0, 0.0]),
            np.append(self.index, [far, far]),
            np.append(self.shift, [-u_min, -u_max]),
            np.append(self.offset, [0.0, 0.0]),
        )


def no_curves() -> Curves:
    """For a response without cut-offs."""
    none = np.empty(0)
    return Curves(none.astype(np.int64), none, none, none, none)


def rayleigh_curves(pitch: float, indices: tuple[float, ...], u_min: float, u_max: float, v_max: float) -> Curves:
    """Cut-offs of all orders in half-spaces of the given `indices` that enter the window 0 ≤ v ≤ v_max."""
    most = int(np.ceil((max(indices) + max(abs(u_min), abs(u_max))) / pitch)) + 1
    found = [
        (m, sign, index, m * pitch)
        for index in sorted(set(indices))
        for m in range(-most, most + 1)
        for sign in (-1.0, 1.0)
    ]
    if not found:
        return no_curves()
    order, sign, index, shift = (np.array(column) for column in zip(*found, strict=True))
    curves = Curves(order.astype(np.int64), sign, index, shift, 0.0 * shift)
    return curves.take(np.any(curves.inside(np.linspace(0.0, v_max, 257), u_min, u_max), axis=1))


def _crossings(curves: Curves, i: int, j: int) -> list[float]:
    """v² where two curves may meet: with A = √(n₁² − v²), B = √(n₂² − v²) and s₁A − s₂B = d, A² − B² is known."""
    s, n, t = curves.sign, curves.index, curves.shift
    d = t[i] - t[j]
    if s[i] == 0.0 or s[j] == 0.0:
        c, line = (i, j) if s[j] == 0.0 else (j, i)
        return [n[c] ** 2 - (t[c] - t[line]) ** 2]
    if d == 0.0:
        return []
    return [n[i] ** 2 - ((d + (n[i] ** 2 - n[j] ** 2) / d) / 2) ** 2]


def breaks(curves: Curves, u_min: float, u_max: float, v_max: float) -> Floats:
    """Values (n,) of v, 0 and v_max among them, between which no curves cross and none leaves the window."""
    lines = curves.take(curves.offset == 0.0).with_edges(u_min, u_max, v_max)
    found = [0.0, v_max]
    for i in range(len(lines)):
        for j in range(i):
            for square in _crossings(lines, i, j) if lines.sign[i] or lines.sign[j] else []:
                v = np.sqrt(max(square, 0.0))
                if not v**2 < v_max**2 or min(abs(v - known) for known in found) < 1e-6:
                    continue
                u = lines.u(np.array([v]))[[i, j], 0]
                if abs(u[0] - u[1]) < NEAR and u_min - NEAR <= u[0] <= u_max + NEAR:
                    found.append(float(v))
    return np.array(sorted(found))


@dataclass(frozen=True)
class Strip:
    """The strip between curves `left` and `right` over v nodes first … last, and the lane it belongs to."""

    left: int
    right: int
    first: int
    last: int
    lane: int


@dataclass(frozen=True)
class Layout:
    """How curves split a window: `lines` are the curves and, last, both edges; `slabs` list strips from left to right.

    slab_first (n_slabs + 1): the v nodes at which the slabs begin and end.
    """

    lines: Curves
    v: Floats
    strips: list[Strip]
    slabs: list[list[int]]
    slab_first: Integers

    @cached_property
    def lane_count(self) -> int:
        """Number of lanes."""
        return 1 + max(strip.lane for strip in self.strips)

    @property
    def curved(self) -> bool:
        """Is there any cut-off in the table."""
        return len(self.lines) > 2

    @cached_property
    def at(self) -> Floats:
        """Where the lines are (n_lines, n_v)."""
        return self.lines.u(self.v)


def _ordered(lines: Curves, v: float) -> list[int]:
    """Lines within the window at v, from left to right."""
    u = lines.u(np.array([v]))[:, 0]
    low, high = len(lines) - 2, len(lines) - 1
    inner = [k for k in range(low) if lines.offset[k] == 0.0 and u[low] < u[k] < u[high]]
    return [low, *sorted(inner, key=lambda k: u[k]), high]


def lay_out(curves: Curves, u_min: float, u_max: float, v: Floats) -> Layout:
    """Strips and lanes of a window; every break of v (n,) must be a node, ValueError names one that is missing."""
    lines = curves.with_edges(u_min, u_max, float(v[-1]))
    at = breaks(curves, u_min, u_max, float(v[-1])) if len(curves) else np.array([v[0], v[-1]])
    nodes = np.abs(v[:, None] - at).argmin(axis=0)
    if np.abs(v[nodes] - at).max() > NEAR:
        raise ValueError(f"v must hold {at[np.abs(v[nodes] - at).argmax()]!r}, where cut-offs cross or leave the table")
    strips: list[Strip] = []
    slabs: list[list[int]] = []
    for first, last in pairwise(nodes):
        order = _ordered(lines, float(v[first] + v[last]) / 2)
        slab = []
        for left, right in pairwise(order):
            before = _passing(strips, slabs[-1], lines, v[first], left, right) if slabs else None
            lane = before.lane if before else 1 + max((strip.lane for strip in strips), default=-1)
            if before and (before.left, before.right) == (left, right):
                slab.append(strips.index(before))
                strips[slab[-1]] = Strip(left, right, before.first, int(last), lane)
            else:
                slab.append(len(strips))
                strips.append(Strip(left, right, int(first), int(last), lane))
        slabs.append(slab)
    return Layout(lines, v, strips, slabs, nodes)


def _passing(strips: list[Strip], slab: list[int], lines: Curves, v: float, left: int, right: int) -> Strip | None:
    """The strip of the slab below that covers the same u as (left, right) where the slabs meet."""
    u = lines.u(np.array([v]))[:, 0]
    if u[right] - u[left] < NEAR:
        return None
    for strip in (strips[k] for k in slab):
        if abs(u[strip.left] - u[left]) < NEAR and abs(u[strip.right] - u[right]) < NEAR:
            return strip
    return None


def to_tau(x: Floats) -> Floats:
    """τ (...) of the place x (...) in a strip, from 0 to 1."""
    left, right = np.sqrt(x), np.sqrt(1.0 - x)
    return np.asarray(left / (left + right))


def local_weights(nodes: Floats, at: Floats, width: int = 5) -> tuple[Integers, Floats, Floats]:
    """Polynomial through the `width` nodes nearest to each of `at` (m): its nodes, value and slope weights (m, width).

    Lagrange's form and its derivative; fewer nodes where there are not as many.
    """
    width = min(width, nodes.size)
    nearest = np.abs(nodes - at[:, None]).argmin(axis=1) if nodes.size < 64 else _nearest(nodes, at)
    which = np.clip(nearest - width // 2, 0, nodes.size - width)[:, None] + np.arange(width)
    x = nodes[which]
    # Products over the first axis; of the derivative, for each k: the sum over n ≠ k of products without k and n.
    d, own = (at[:, None] - x).T, np.eye(width, dtype=bool)[..., None]
    scale = np.where(own, 1.0, x.T - x.T[:, None]).prod(axis=0)
    value = np.where(own, 1.0, d[:, None]).prod(axis=0) / scale
    without = np.where(own[:, :, None] | own[:, None], 1.0, d[:, None, None]).prod(axis=0)
    value, slope = value.T, (np.where(own, 0.0, without).sum(axis=1) / scale).T
    return which, value, slope


def _nearest(nodes: Floats, at: Floats) -> Integers:
    right = np.clip(np.searchsorted(nodes, at), 1, nodes.size - 1)
    return np.where(at - nodes[right - 1] < nodes[right] - at, right - 1, right)
