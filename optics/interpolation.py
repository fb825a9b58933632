"""Bicubic Hermite interpolation of pressure tables: compiled functions on plain arrays, used through `optics.table`.

A table without cut-offs is one strip in which τ = x is linear in u; see `optics.strips` for the others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from optics.patches import Patches, Values, buckets
from optics.strips import Layout

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_HEADER = 10
_STRIP = 8
# Slopes on a cut-off are infinite; they are taken this far from it in τ.
_OFF_CURVE = 1e-8
_THIN = 1e-300

Weights = tuple[float, float, float, float]


class TableArrays(NamedTuple):
    """A table for compiled kernels: see `lookup`. What the arrays hold is known to this module alone.

    numbers (n,), places (m,): everything, one after the other. axisymmetric: v is collapsed, u is the sine of the angle
    of incidence. nearest: return the nearest node's value.
    """

    numbers: Floats
    places: Indices
    axisymmetric: bool
    nearest: bool


class _Parts(NamedTuple):
    """Where things begin in the two arrays of `TableArrays`, so that none has to be cut out of them.

    In n: v (n_v nodes), lines (3 each: u = l₀ √(square₀ − v²) + l₁ √(square₁ − v²) − l₂; edges last), parity (k, ±1
    under v → −v), tau (nodes of all strips), c (coefficients). In h: bucket_v; slab, of each interval in v; first, the
    first strip of each slab; strips (8 each): line on the left and on the right, first node in tau and how many, first
    bucket and how many, where the coefficients of the strip would begin if it began at the first v node, numbers from
    one τ node to the next; bucket_tau. mirror: only v ≥ 0 is held; curved: τ is that of `optics.strips`, not x itself.
    """

    n: Floats
    h: Indices
    n_v: int
    k: int
    v: int
    lines: int
    edges: int
    parity: int
    tau: int
    c: int
    bucket_v: int
    buckets: int
    slab: int
    first: int
    strips: int
    bucket_tau: int
    mirror: bool
    curved: bool


def _line_table(layout: Layout) -> tuple[Floats, list[float]]:
    """`lines` of `_Parts` and the squares of its two indices."""
    lines, curves = layout.lines, len(layout.lines) - 2
    squares = sorted(set(lines.index[:curves] ** 2)) or [lines.index[-1] ** 2]
    if len(squares) > 2:
        raise ValueError("cutoff_index holds more than two refractive indices; there are two half-spaces")
    table = np.zeros((len(lines), 3))
    table[:curves, 0] = lines.sign[:curves] * (lines.index[:curves] ** 2 == squares[0])
    table[:, 1] = lines.sign - table[:, 0]
    table[:, 2] = lines.shift
    return table, [squares[0], squares[-1]]


def pack(layout: Layout, values: Values, patches: list[Patches], axisymmetric: bool, nearest: bool) -> TableArrays:
    """Plain arrays of a table; `nearest`: to be looked up at its nearest node."""
    k, n = values.nodes.shape[0], len(patches)
    lines, squares = _line_table(layout)
    parity = np.ones(k) if values.parity is None else values.parity
    taus, found = [patch.tau for patch in patches], [buckets(patch.tau) for patch in patches]
    numbers = [np.array(squares), values.v, lines.ravel(), parity, *taus, *(p.values.ravel() for p in patches)]
    first_tau, first_bucket, first_c = (
        np.cumsum([0, *(part.size for part in parts)]) for parts in (taus, found, [p.values for p in patches])
    )
    rows = np.zeros((n, _STRIP), np.int64)
    for i, patch in enumerate(patches):
        rows[i] = [
            patch.strip.left, patch.strip.right, first_tau[i], patch.tau.size, first_bucket[i], found[i].size,
            first_c[i] - patch.strip.first * 4 * k, patch.values[0].size,
        ]
    order = [k for slab in layout.slabs for k in slab]
    slab_first = np.cumsum([0, *(len(slab) for slab in layout.slabs)])
    slab = np.searchsorted(layout.slab_first, np.arange(values.v.size - 1), side="right") - 1
    bucket_v = buckets(values.v)
    header = [
        values.v.size, len(lines), k, first_tau[-1], bucket_v.size, slab_first.size, len(order), first_bucket[-1],
        values.parity is not None, layout.curved,
    ]
    places = [np.array(header), bucket_v, slab, slab_first, rows[order].ravel(), *found]
    return TableArrays(np.concatenate(numbers), np.concatenate(places).astype(np.int64), axisymmetric, nearest)


@numba.njit(cache=True, inline="always")
def _open(t: TableArrays) -> _Parts:
    """Where `pack` has put the parts."""
    h = t.places
    n_v, lines, k = h[0], 2 + h[0], h[2]
    parity = lines + 3 * h[1]
    slab = _HEADER + h[4]
    first = slab + n_v - 1
    strips = first + h[5]
    return _Parts(
        t.numbers, h, n_v, k, 2, lines, parity - 6, parity, parity + k, parity + k + h[3], _HEADER, h[4], slab, first,
        strips, strips + h[6] * _STRIP, h[8] != 0, h[9] != 0,
    )


@numba.njit(cache=True, inline="always")
def _locate(n: Floats, first: int, count: int, guess: int, x: float) -> int:
    """Interval i of the `count` nodes from n[first] on with nodes[i] ≤ x ≤ nodes[i + 1]; x must lie within them."""
    i = guess
    while i < count - 2 and x >= n[first + i + 1]:
        i += 1
    while i > 0 and x < n[first + i]:
        i -= 1
    return i


@numba.njit(cache=True, inline="always")
def _hermite(s: float, h: float) -> Weights:
    """Cubic Hermite weights of (value left, value right, slope left, slope right) at s in [0, 1] of a step h."""
    r = 1.0 - s
    return (1.0 + 2.0 * s) * r * r, s * s * (3.0 - 2.0 * s), h * s * r * r, -h * s * s * r


@numba.njit(cache=True, inline="always")
def _hermite_slope(s: float, h: float) -> Weights:
    """Derivatives of the `_hermite` weights by x."""
    r = 1.0 - s
    return -6.0 * s * r / h, 6.0 * s * r / h, r * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)


def _wide_sum(builder: ir.IRBuilder, weights: list[ir.Value], groups: list[ir.Value]) -> ir.Value:
    """Sum of four vectors of four numbers, times a weight each."""
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), 4), [0, 0, 0, 0])
    parts = []
    for weight, group in zip(weights, groups, strict=True):
        first = builder.insert_element(ir.Constant(group.type, ir.Undefined), weight, ir.Constant(ir.IntType(32), 0))
        parts.append(builder.fmul(builder.shuffle_vector(first, first, lanes), group))
    return builder.fadd(builder.fadd(parts[0], parts[1]), builder.fadd(parts[2], parts[3]))


@intrinsic
def _patch(context: Any, f: Any, start: Any, row: Any, next_v: Any, a: Any, b: Any) -> Any:
    """Tensor Hermite sum of four quantities over the patch at `start`, with weights a along τ and b along v.

    At each node lie the four values, the four ∂τ, ∂v and ∂τ∂v; the next node in v is `next_v` numbers on, that in τ
    `row`. It is written as LLVM instructions to keep the four in one vector: numba takes them one by one otherwise,
    which is three times slower.
    """

    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        array, start, row, next_v, a, b = given
        pointer = context.make_array(signature.args[0])(context, builder, array).data
        a, b = (cgutils.unpack_tuple(builder, weights, 4) for weights in (a, b))
        wide = ir.VectorType(ir.DoubleType(), 4)

        def load(*steps: ir.Value | int) -> ir.Value:
            place = start
            for step in steps:
                place = builder.add(place, ir.Constant(start.type, step) if isinstance(step, int) else step)
            return builder.load(builder.bitcast(builder.gep(pointer, [place]), wide.as_pointer()), align=8)

        sides = []
        for side in (ir.Constant(start.type, 0), row):
            for slope in (0, 4):
                nodes = [load(side, slope, *more) for more in ((), (8,), (next_v,), (next_v, 8))]
                sides.append(_wide_sum(builder, [b[0], b[2], b[1], b[3]], nodes))
        total = _wide_sum(builder, [a[0], a[2], a[1], a[3]], sides)
        lanes = [builder.extract_element(total, ir.Constant(ir.IntType(32), i)) for i in range(4)]
        return context.make_tuple(builder, signature.return_type, lanes)

    return numba.types.UniTuple(numba.float64, 4)(f, numba.int64, numba.int64, numba.int64, a, b), build


class _Place(NamedTuple):
    """Where a direction lies.

    First coefficient of its patch, numbers from there to the next τ node; s, r: the place in the patch (0 … 1) along τ
    and v, with its steps h, g; x and τ in its strip, and the lines on both sides of that.
    """

    start: int
    row: int
    s: float
    h: float
    r: float
    g: float
    x: float
    tau: float
    left: int
    right: int


@numba.njit(cache=True, inline="always")
def _clamped(p: _Parts, v: float) -> float:
    """|v| where the table is mirrored, v where not, within the table."""
    return min(max(abs(v) if p.mirror else v, p.n[p.v]), p.n[p.v + p.n_v - 1])


@numba.njit(cache=True, inline="always")
def _line_at(p: _Parts, line: int, root_0: float, root_1: float) -> float:
    """Where a line is."""
    at = p.lines + 3 * line
    return p.n[at] * root_0 + p.n[at + 1] * root_1 - p.n[at + 2]


@numba.njit(cache=True, inline="always")
def _place(p: _Parts, u: float, v: float) -> _Place:
    """Where (u, v) lies, clamped to the table; v < 0 is mirrored where the table is."""
    n, h = p.n, p.h
    v = _clamped(p, v)
    part = (v - n[p.v]) / (n[p.v + p.n_v - 1] - n[p.v])
    j = _locate(n, p.v, p.n_v, h[p.bucket_v + min(int(part * p.buckets), p.buckets - 1)], v)
    slab = p.first + h[p.slab + j]
    root_0, root_1 = np.sqrt(n[0] - v * v), np.sqrt(n[1] - v * v)
    e = h[slab]
    for other in range(e, h[slab + 1] - 1):
        e += u >= _line_at(p, h[p.strips + _STRIP * other + 1], root_0, root_1)
    strip = p.strips + _STRIP * e
    left, right = h[strip], h[strip + 1]
    a = _line_at(p, left, root_0, root_1)
    x = min(max((u - a) / max(_line_at(p, right, root_0, root_1) - a, _THIN), 0.0), 1.0)
    tau = x
    if p.curved:
        root = np.sqrt(x)
        tau = min(max(root / (root + np.sqrt(1.0 - x)), _OFF_CURVE), 1.0 - _OFF_CURVE)
    first, many = p.tau + h[strip + 2], h[strip + 5]
    i = _locate(n, first, h[strip + 3], h[p.bucket_tau + h[strip + 4] + min(int(tau * many), many - 1)], tau)
    row = h[strip + 7]
    start = h[strip + 6] + i * row + j * 4 * p.k
    step, g = n[first + i + 1] - n[first + i], n[p.v + j + 1] - n[p.v + j]
    return _Place(p.c + start, row, (tau - n[first + i]) / step, step, (v - n[p.v + j]) / g, g, x, tau, left, right)


@numba.njit(cache=True, inline="always")
def _signed(p: _Parts, q: Weights, v: float, c: int) -> Weights:
    """Quantities c … c + 3 of v < 0 from those of −v."""
    if p.mirror and v < 0.0:
        n, at = p.n, p.parity + c
        return q[0] * n[at], q[1] * n[at + 1], q[2] * n[at + 2], q[3] * n[at + 3]
    return q


@numba.njit(cache=True, inline="always")
def _four(p: _Parts, nearest: bool, at: _Place, v: float, c: int) -> Weights:
    """Quantities c … c + 3."""
    f, start = p.n, at.start + 4 * c
    if nearest:
        node = start + (at.row if at.s > 0.5 else 0) + (4 * p.k if at.r > 0.5 else 0)
        return _signed(p, (f[node], f[node + 1], f[node + 2], f[node + 3]), v, c)
    return _signed(p, _patch(f, start, at.row, 4 * p.k, _hermite(at.s, at.h), _hermite(at.r, at.g)), v, c)


@numba.njit(cache=True, inline="always")
def _inside(p: _Parts, u: float, v: float) -> bool:
    """Is the direction within the table."""
    return bool(-p.n[p.edges + 2] <= u <= -p.n[p.edges + 5] and _clamped(p, v) == (abs(v) if p.mirror else v))


@numba.njit(cache=True)
def lookup(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """(q_g, q_r, q_n, absorptance, inside) of one direction; outside the table the edge value with inside = False."""
    p = _open(t)
    if not t.axisymmetric:
        q0, q1, q2, q3 = _four(p, t.nearest, _place(p, u, v), v, 0)
        return q0, q1, q2, q3, _inside(p, u, v)
    s = np.sqrt(u * u + v * v)
    q0, q1, q2, q3 = _four(p, t.nearest, _place(p, s, 0.0), 0.0, 0)
    g, r = (q0 * u / s, q0 * v / s) if s > 0.0 else (0.0, 0.0)
    return g, r, q2, q3, _inside(p, s, 0.0)


@numba.njit(cache=True, error_model="numpy")
def lookup_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> tuple[int, int]:
    """`lookup` of many directions u, v (n,) into out (n, k): q_g, q_r, q_n, absorptance, …; the same bits.

    Returns how many directions lie outside the table (they get the edge value) and the first of them, or −1.
    """
    p = _open(t)
    count, first = 0, -1
    for i in range(u.size):
        x, y = u[i], v[i]
        if t.axisymmetric:
            x, y = np.sqrt(x * x + y * y), 0.0
        at = _place(p, x, y)
        for c in range(0, p.k, 4):
            out[i, c], out[i, c + 1], out[i, c + 2], out[i, c + 3] = _four(p, t.nearest, at, y, c)
        if t.axisymmetric:
            along = out[i, 0]
            out[i, 0], out[i, 1] = (along * u[i] / x, along * v[i] / x) if x > 0.0 else (0.0, 0.0)
        if not _inside(p, x, y):
            count += 1
            first = i if first < 0 else first
    return count, first


@numba.njit(cache=True, inline="always")
def _turning(p: _Parts, at: _Place, v: float) -> tuple[float, float]:
    """∂τ/∂u, and ∂τ/∂v at fixed u, of a place; √(index² − v²) in the lines changes by −v / √(index² − v²)."""
    n, left, right = p.n, p.lines + 3 * at.left, p.lines + 3 * at.right
    root_0, root_1 = np.sqrt(n[0] - v * v), np.sqrt(n[1] - v * v)
    width = _line_at(p, at.right, root_0, root_1) - _line_at(p, at.left, root_0, root_1)
    tau_x = 1.0
    if p.curved:
        both = at.tau * at.tau + (1.0 - at.tau) * (1.0 - at.tau)
        tau_x = both * both / (2.0 * at.tau * (1.0 - at.tau))
    per_u = tau_x / max(width, _THIN)
    moved = (n[left] + (n[right] - n[left]) * at.x) / root_0
    moved += (n[left + 1] + (n[right + 1] - n[left + 1]) * at.x) / root_1
    return per_u, v * moved * per_u


@numba.njit(cache=True, inline="always")
def _slopes(p: _Parts, u: float, v: float, out: Floats) -> None:
    """Value, ∂u and ∂v of each quantity (3, k) at one direction."""
    at = _place(p, u, v)
    tau_u, tau_v = _turning(p, at, _clamped(p, v))
    a, b = _hermite(at.s, at.h), _hermite(at.r, at.g)
    da, db = _hermite_slope(at.s, at.h), _hermite_slope(at.r, at.g)
    k = p.k
    turned = -1.0 if p.mirror and v < 0.0 else 1.0
    for c in range(0, k, 4):
        start = at.start + 4 * c
        f = _signed(p, _patch(p.n, start, at.row, 4 * k, a, b), v, c)
        f_tau = _signed(p, _patch(p.n, start, at.row, 4 * k, da, b), v, c)
        f_v = _signed(p, _patch(p.n, start, at.row, 4 * k, a, db), v, c)
        out[0, c], out[0, c + 1], out[0, c + 2], out[0, c + 3] = f
        for i in numba.literal_unroll((0, 1, 2, 3)):
            out[1, c + i] = f_tau[i] * tau_u
            out[2, c + i] = turned * (f_v[i] + f_tau[i] * tau_v)


@numba.njit(cache=True)
def lookup_slopes(t: TableArrays, u: float, v: float, out: Floats) -> bool:
    """Write value, ∂u and ∂v of (q_g, q_r, q_n, absorptance, …) into out (3, k); returns inside.

    Not for axisymmetric tables. On a cut-off, where slopes are infinite, they are large.
    """
    p = _open(t)
    _slopes(p, u, v, out)
    return _inside(p, u, v)


@numba.njit(cache=True, error_model="numpy")
def lookup_slopes_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> None:
    """`lookup_slopes` of many directions u, v (n,) into out (n, 3, k); the same bits."""
    p = _open(t)
    for i in range(u.size):
        _slopes(p, u[i], v[i], out[i])
