"""From the values of a table to the Hermite coefficients that `optics.table.patch_sum` sums.

On each stored line of v, the rows in a strip and the exact values on its two cut-offs are nodes of a polynomial in τ
(`optics.table.strips`), piece by piece. It is read at nodes in τ that all lines of a lane share, at least as dense as
the rows are on any line. Slopes along v at fixed τ follow from differences between the lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from beamrider.arrays import Floats
from optics.table.strips import NEAR, Layout, Strip, local_weights, to_tau

# Common nodes in τ per row, and the nodes of the polynomial that leads from the rows to them.
_DENSITY = 1.5
_ROW_WIDTH = 7
_FEWEST = 8
# Nodes closer than this in τ are one.
_APART = 1e-5
_CELLS = 2048


@dataclass(frozen=True)
class Values:
    """Quantities on rows u (n_u) × lines v (n_v) and on cut-offs: nodes (k, n_u, n_v), on_curves (k, n_curves, n_v).

    parity (k): of each quantity under v → −v, where only v ≥ 0 is stored; None where both signs are.
    """

    u: Floats
    v: Floats
    nodes: Floats
    on_curves: Floats
    parity: Floats | None


@dataclass(frozen=True)
class Patches:
    """Coefficients of one strip: tau (n_tau), values (n_tau, n_v, k/4, 4, 4).

    The last two axes: value, ∂τ, ∂v, ∂τ∂v, and which of the four quantities that are looked up together.
    """

    strip: Strip
    tau: Floats
    values: Floats


def slope_matrix(nodes: Floats) -> Floats:
    """Matrix (n, n) giving the derivative at each node from the five (or all, if fewer) nearest nodes."""
    which, _, slope = local_weights(nodes, nodes)
    matrix = np.zeros((nodes.size, nodes.size))
    np.put_along_axis(matrix, which, slope, axis=1)
    return matrix


def v_slopes(v: Floats, f: Floats, parity: Floats | None) -> Floats:
    """∂f/∂v (k, m, n_v) at fixed τ; with a parity, lines from v = 0 on are mirrored to v < 0."""
    if parity is None or v[0] != 0.0:
        return np.asarray(f @ slope_matrix(v).T)
    more = v.size - 1
    both = slope_matrix(np.concatenate([-v[:0:-1], v]))[more:]
    kept, mirrored = both[:, more:], np.pad(both[:, more - 1 :: -1] if more else both[:, :0], ((0, 0), (1, 0)))
    slopes = f @ kept.T + parity[:, None, None] * (f @ mirrored.T)
    slopes[parity > 0, :, 0] = 0.0
    return np.asarray(slopes)


@dataclass(frozen=True)
class _Line:
    """A strip on one line of v: nodes tau (n), values (k, n), and whether its left and right end are window edges."""

    tau: Floats
    values: Floats
    edges: tuple[bool, bool]


def _line(layout: Layout, values: Values, strip: Strip, j: int) -> _Line:
    """Nodes within the strip and its two ends on line j."""
    curves, rows = len(layout.lines) - 2, values.u.size
    a, b = layout.at[strip.left, j], layout.at[strip.right, j]
    u = np.concatenate([values.u, layout.at[:curves, j]])
    x = (u - a) / max(b - a, NEAR)
    tau = to_tau(np.clip(x, 0.0, 1.0))
    order = np.argsort(u, kind="stable")
    order = order[(tau[order] > _APART) & (tau[order] < 1 - _APART)]
    order = order[np.diff(tau[order], prepend=0.0) > _APART]
    f = np.concatenate([values.nodes[:, :, j], values.on_curves[:, :, j]], axis=1)
    low, high = ((0, rows - 1)[k - curves] if k >= curves else rows + k for k in (strip.left, strip.right))
    inner = np.concatenate([[low], order, [high]])
    tau = np.concatenate([[0.0], tau[order], [1.0]])
    return _Line(tau, f[:, inner], (strip.left >= curves, strip.right >= curves))


def _common_tau(lines: list[_Line]) -> Floats:
    """Nodes in τ as dense everywhere as those of the densest line there, and a bit more."""
    middle = (np.arange(_CELLS) + 0.5) / _CELLS
    spacing = np.full(_CELLS, 1.0 / _FEWEST)
    for line in lines:
        n = line.tau.size - 1
        left, right = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 2, n)
        h = (line.tau[right] - line.tau[left]) / (right - left)
        spacing = np.minimum(spacing, h[np.searchsorted(line.tau, middle) - 1])
    count = np.concatenate([[0.0], np.cumsum(1.0 / spacing)]) / _CELLS
    wanted = np.linspace(0.0, count[-1], int(np.ceil(_DENSITY * count[-1])) + 1)
    tau = np.interp(wanted, count, np.linspace(0.0, 1.0, _CELLS + 1))
    tau[0], tau[-1] = 0.0, 1.0
    return np.asarray(tau)


def _resample(line: _Line, tau: Floats) -> tuple[Floats, Floats]:
    """Values and slopes in τ (k, n_tau) of a line at common nodes. Beyond a window edge the response is mirrored."""
    left, right = line.edges
    reach = min(_ROW_WIDTH // 2, line.tau.size - 1)
    a, b = reach if left else 0, reach if right else 0
    nodes = np.concatenate([-line.tau[1 : a + 1][::-1], line.tau, 2.0 - line.tau[-1 - b : -1][::-1]])
    f = line.values
    f = np.concatenate([f[:, 1 : a + 1][:, ::-1], f, f[:, -1 - b : -1][:, ::-1]], axis=1)
    which, value, slope = local_weights(nodes, tau, _ROW_WIDTH)
    values, slopes = (np.einsum("knw,nw->kn", f[:, which], weights) for weights in (value, slope))
    values[:, [0, -1]] = line.values[:, [0, -1]]
    slopes[:, 0] *= not left
    slopes[:, -1] *= not right
    return values, slopes


def _lane(layout: Layout, values: Values, lane: int) -> tuple[int, Floats, Floats]:
    """First v node of a lane, its common nodes in τ (n), and values and slopes (2, k, n, n_v of the lane)."""
    strips = [strip for strip in layout.strips if strip.lane == lane]
    first, last = strips[0].first, strips[-1].last
    lines = [
        _line(layout, values, next(s for s in strips if s.first <= j <= s.last), j) for j in range(first, last + 1)
    ]
    tau = _common_tau(lines)
    return first, tau, np.stack([np.stack(_resample(line, tau)) for line in lines], axis=-1)


def _curve_runs(layout: Layout, curve: int) -> list[tuple[int, int]]:
    """First and last v node of each range over which a curve is a boundary and meets no other line."""
    runs: list[tuple[int, int]] = []
    meets = [
        int(j)
        for j in layout.slab_first
        if np.sum(np.abs(layout.at[layout.lines.offset == 0.0, j] - layout.at[curve, j]) < NEAR) > 1
    ]
    for k, slab in enumerate(layout.slabs):
        first, last = int(layout.slab_first[k]), int(layout.slab_first[k + 1])
        if not any(curve in (layout.strips[s].left, layout.strips[s].right) for s in slab):
            continue
        if runs and runs[-1][1] == first and first not in meets:
            runs[-1] = (runs[-1][0], last)
        else:
            runs.append((first, last))
    return runs


def _curve_slopes(layout: Layout, values: Values, strip: Strip, curve: int) -> Floats:
    """∂v (k, n_v of the strip) along a curve, the same for the strips on both of its sides."""
    first, last = next(run for run in _curve_runs(layout, curve) if run[0] <= strip.first and strip.last <= run[1])
    along = values.on_curves[:, [curve], first : last + 1]
    slopes = v_slopes(values.v[first : last + 1], along, values.parity)[:, 0]
    return slopes[:, strip.first - first : strip.last - first + 1]


def _strip_patches(layout: Layout, values: Values, strip: Strip, tau: Floats, f: Floats) -> Patches:
    """Coefficients of a strip from its values and τ slopes f (2, k, n_tau, n_v)."""
    v = values.v[strip.first : strip.last + 1]
    f_v, f_tau_v = (v_slopes(v, part, values.parity) for part in f)
    for end, curve in ((0, strip.left), (-1, strip.right)):
        if curve < len(layout.lines) - 2:
            f_v[:, end] = _curve_slopes(layout, values, strip, curve)
    every = np.stack([*f, f_v, f_tau_v]).reshape(4, -1, 4, tau.size, v.size)
    return Patches(strip, tau, np.ascontiguousarray(every.transpose(3, 4, 1, 0, 2)))


def _moved(layout: Layout, strip: Strip, j: int, x: Floats) -> Floats:
    """∂u/∂v (n) at fixed places x (n) in a strip, on line j."""
    lines, v = layout.lines, layout.v[j]
    a, b = (-lines.sign[k] * v / np.sqrt(lines.index[k] ** 2 - v**2) for k in (strip.left, strip.right))
    return np.asarray(a + (b - a) * x)


def _join(layout: Layout, below: Patches, above: Patches) -> None:
    """Give two strips of a lane the same ∂v at fixed u, the mean of both, on the line where they meet.

    At fixed u it is ∂f/∂v − ∂f/∂τ (∂u/∂v)/(∂u/∂τ) of the strip. On a cut-off that ends there slopes stay as they are.
    """
    j, tau = above.strip.first, below.tau
    lower, upper = below.values[:, -1], above.values[:, 0]
    both = tau**2 + (1.0 - tau) ** 2
    x, inner = tau**2 / both, slice(1, -1)
    a, b = (layout.at[k, j] for k in (above.strip.left, above.strip.right))
    per_tau = (b - a) * 2.0 * (tau * (1.0 - tau))[inner] / both[inner] ** 2
    turned = (_moved(layout, above.strip, j, x) - _moved(layout, below.strip, j, x))[inner] / per_tau
    gap = np.zeros_like(lower[:, :, 2])
    gap[inner] = lower[inner, :, 1] * turned[:, None, None] - upper[inner, :, 2] + lower[inner, :, 2]
    along = np.einsum("ij,j...->i...", slope_matrix(tau), gap)
    for side, values in ((-0.5, lower), (0.5, upper)):
        values[:, :, 2] += side * gap
        values[:, :, 3] += side * along


def make_patches(layout: Layout, values: Values) -> list[Patches]:
    """Coefficients of every strip, in the order of `layout.strips`."""
    if not layout.curved:
        tau = (values.u - values.u[0]) / (values.u[-1] - values.u[0])
        slopes = np.einsum("ij,kjl->kil", slope_matrix(tau), values.nodes)
        return [_strip_patches(layout, values, layout.strips[0], tau, np.stack([values.nodes, slopes]))]
    lanes = [_lane(layout, values, lane) for lane in range(layout.lane_count)]
    patches = []
    for strip in layout.strips:
        first, tau, f = lanes[strip.lane]
        patches.append(_strip_patches(layout, values, strip, tau, f[..., strip.first - first : strip.last - first + 1]))
    for below, above in permutations(patches, 2):
        if below.strip.lane == above.strip.lane and below.strip.last == above.strip.first:
            _join(layout, below, above)
    return patches
