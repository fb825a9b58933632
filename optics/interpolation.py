"""Bicubic Hermite interpolation of pressure tables: compiled functions on plain arrays, used through `optics.table`.

A table without cut-offs is one strip in which τ = x is linear in u; see `optics.strips` for the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from optics.packing import LINE, NODE, STRIP, Floats, Indices, TableArrays
from optics.packing import pack as pack
from optics.patch_sum import prefetch, read, value_and_slopes, values

# Slopes on a cut-off are infinite; they are taken this far from it in τ.
_OFF_CURVE = 1e-8
_THIN = 1e-300
# Directions taken through the passes of `lookup_many` together, so that what is between them stays in the cache, and
# how many directions ahead of its sum a patch is fetched from memory.
_BLOCK = 128
_AHEAD = 8
# Where each pass puts its numbers: v folded, both roots, u − a and b − a, τ, the place in the patch and its steps
# (s, h along τ; r, g along v), buckets of the strip, and what turns slopes by τ and v into slopes by u and v.
_V, _ROOT_0, _ROOT_1, _ABOVE, _WIDTH, _TAU, _S, _H, _R, _G, _MANY, _PER_U, _TAU_V, _PER_V = (
    k * _BLOCK for k in range(14)
)
_BUCKET, _STRIP, _START, _ROW, _LINE = (k * _BLOCK for k in range(5))

class _Parts(NamedTuple):
    """The numbers at the beginning of the arrays of `TableArrays` and where the parts begin, see `optics.packing`."""

    n: Floats
    h: Indices
    k: int
    many: int
    v: int
    lines: int
    parity: int
    bucket_v: int
    top: float
    slab: int
    strips: int
    mirror: bool
    curved: bool
    nearest: bool
    square_0: float
    square_1: float
    u_first: float
    u_last: float
    v_first: float
    v_last: float
    per_v: float


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _open(t: TableArrays) -> _Parts:
    """Where `pack` has put the parts."""
    n, h = t.numbers, t.places
    return _Parts(
        n, h, h[0], h[1], h[2], h[3], h[4], h[5], float(h[6] - 1), h[7], h[8], h[9] != 0, h[10] != 0,
        t.nearest, n[0], n[1], n[2], n[3], n[4], n[5], n[6],
    )


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _clamp(x: float, low: float, high: float) -> float:
    """Bring x within low … high; NaN becomes low, so that no place is outside the arrays."""
    x = x if x > low else low
    return x if x < high else high


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _fold(p: _Parts, v: float) -> float:
    """|v| where the table is mirrored, v where not, within the table."""
    return _clamp(abs(v) if p.mirror else v, p.v_first, p.v_last)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _inside(p: _Parts, u: float, v: float) -> bool:
    """Is the direction within the table."""
    return bool((u >= p.u_first) & (u <= p.u_last) & (_fold(p, v) == (abs(v) if p.mirror else v)))


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _line_at(n: Floats, at: int, root_0: float, root_1: float) -> float:
    """Where the line is that is stored from `at` on."""
    return read(n, at) * root_0 + read(n, at + 1) * root_1 - read(n, at + 2)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _find(n: Floats, first: int, i: int, x: float) -> int:
    """The interval that holds x, from i on, of the nodes stored from `first` on; the last of them is infinite."""
    while x >= read(n, first + NODE * (i + 1)):
        i += 1
    return i


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _within(n: Floats, at: int, x: float) -> tuple[float, float]:
    """The place of x (0 … 1) in the interval stored from `at` on, and its width."""
    return (x - read(n, at)) * read(n, at + 2), read(n, at + 1)


class _Band(NamedTuple):
    """Where a direction lies in v, and its strip.

    strip: where that is stored; start: first coefficient of line v in the strip; r: the place (0 … 1) between two
    lines, g: their distance; line: where the left line is stored; above, width: u − a and b − a.
    """

    strip: int
    start: int
    r: float
    g: float
    line: int
    above: float
    width: float


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _band(p: _Parts, u: float, v: float, bucket: int, root_0: float, root_1: float) -> _Band:
    """The band of a direction with v folded."""
    n, h, u = p.n, p.h, _clamp(u, p.u_first, p.u_last)
    j = _find(n, p.v, read(h, p.bucket_v + bucket), v)
    at = p.v + NODE * j
    slab = read(h, p.slab + j)
    lines = p.lines + slab * (p.many * LINE)
    e = 0
    for other in range(1, p.many - 1):
        e += u >= _line_at(n, lines + LINE * other, root_0, root_1)
    line = lines + LINE * e
    a = _line_at(n, line, root_0, root_1)
    width = _line_at(n, line + LINE, root_0, root_1) - a
    strip = p.strips + (slab * (p.many - 1) + e) * STRIP
    start = read(h, strip + 3) + j * (4 * p.k)
    r, g = _within(n, at, v)
    return _Band(strip, start, r, g, line, u - a, width)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _part(above: float, width: float) -> float:
    """x, the place in a strip (0 … 1)."""
    return _clamp(above / (width if width > _THIN else _THIN), 0.0, 1.0)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _tau(x: float) -> float:
    """τ of the place x in a strip between cut-offs."""
    root = np.sqrt(x)
    return _clamp(root / (root + np.sqrt(1.0 - x)), _OFF_CURVE, 1.0 - _OFF_CURVE)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _bucket(x: float, scale: float, top: float) -> int:
    """The bucket of x ≥ 0."""
    x = x * scale
    return int(x if x < top else top)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _column(p: _Parts, strip: int, bucket: int, tau: float) -> tuple[int, int, float, float]:
    """Interval of τ in a strip, numbers from one interval to the next, place in it, its width."""
    first = read(p.h, strip)
    i = _find(p.n, first, read(p.h, read(p.h, strip + 1) + bucket), tau)
    s, h = _within(p.n, first + NODE * i, tau)
    return i, read(p.h, strip + 4), s, h


class _Place(NamedTuple):
    """Where a direction lies.

    start: first coefficient of its patch; row: numbers from there to the next τ node; s, r: the place in the patch
    (0 … 1) along τ and v, h, g: its steps; line: where the line on its left is stored; u − a, b − a and τ.
    """

    start: int
    row: int
    s: float
    h: float
    r: float
    g: float
    line: int
    above: float
    width: float
    tau: float


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _roots(p: _Parts, v: float) -> tuple[float, float]:
    """√(index² − v²) of both half-spaces."""
    return np.sqrt(p.square_0 - v * v), np.sqrt(p.square_1 - v * v)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _place(p: _Parts, u: float, v: float, root_0: float, root_1: float) -> _Place:
    """Where (u, v) lies, v folded; clamped to the table."""
    band = _band(p, u, v, _bucket(v - p.v_first, p.per_v, p.top), root_0, root_1)
    x = _part(band.above, band.width)
    tau = _tau(x) if p.curved else x
    many = float(read(p.h, band.strip + 2))
    i, row, s, h = _column(p, band.strip, _bucket(tau, many, many - 1.0), tau)
    return _Place(band.start + i * row, row, s, h, band.r, band.g, band.line, band.above, band.width, tau)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _turning(
    p: _Parts, v: float, root_0: float, root_1: float, line: int, above: float, width: float, tau: float,
    h: float, g: float, turned: bool,
) -> tuple[float, float, float]:
    """∂s/∂u, ∂s/∂v at fixed u, and ∂r/∂v of the place s, r in a patch; v is folded, `turned` if it was negative.

    √(index² − v²) in the lines changes by −v / √(index² − v²) per v.
    """
    n, x = p.n, _part(above, width)
    left, right = 1.0 - x, x
    moved = (read(n, line) * left + read(n, line + LINE) * right) / root_0
    moved += (read(n, line + 1) * left + read(n, line + LINE + 1) * right) / root_1
    width = width if width > _THIN else _THIN
    per_u = 1.0 / (width * h)
    if p.curved:
        rest = 1.0 - tau
        both = tau * tau + rest * rest
        per_u = both * both / (2.0 * tau * rest * width * h)
    sign = -1.0 if turned else 1.0
    return per_u, sign * (v * moved * per_u), sign / g


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _snap(p: _Parts, s: float) -> float:
    """The place in an interval that is looked up: that of the nearest node, or s itself."""
    end = 1.0 if s > 0.5 else 0.0
    return end if p.nearest else s


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _turned(p: _Parts, v: float) -> bool:
    """Is v < 0 to be had from −v."""
    return bool(p.mirror & (v < 0.0))


@numba.njit(cache=True, error_model="numpy")
def lookup(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """(q_g, q_r, q_n, absorptance, inside) of one direction; outside the table the edge value with inside = False."""
    p = _open(t)
    x, y = (np.sqrt(u * u + v * v), 0.0) if t.axisymmetric else (u, v)
    inside, folded = _inside(p, x, y), _fold(p, y)
    root_0, root_1 = _roots(p, folded)
    at = _place(p, x, folded, root_0, root_1)
    s, r = _snap(p, at.s), _snap(p, at.r)
    q0, q1, q2, q3 = values(p.n, at.start, at.row, 4 * p.k, s, at.h, r, at.g, p.parity, _turned(p, y))
    if t.axisymmetric:
        q0, q1 = (q0 * u / x, q0 * v / x) if x > 0.0 else (0.0, 0.0)
    return q0, q1, q2, q3, inside


@numba.njit(cache=True, error_model="numpy")
def lookup_slopes(t: TableArrays, u: float, v: float, out: Floats) -> bool:
    """Write value, ∂u and ∂v of (q_g, q_r, q_n, absorptance, …) into out (3, k); returns inside.

    Not for axisymmetric tables. On a cut-off, where slopes are infinite, they are large.
    """
    p = _open(t)
    folded, turned = _fold(p, v), _turned(p, v)
    root_0, root_1 = _roots(p, folded)
    at = _place(p, u, folded, root_0, root_1)
    per = _turning(p, folded, root_0, root_1, at.line, at.above, at.width, at.tau, at.h, at.g, turned)
    for c in range(0, p.k, 4):
        place = at.start + 4 * c
        q = value_and_slopes(
            p.n, place, at.row, 4 * p.k, at.s, at.h, at.r, at.g, p.parity + c, turned, per[0], per[1], per[2]
        )
        _store(out, c, q)
    return _inside(p, u, v)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _store(out: Floats, c: int, q: tuple[float, ...]) -> None:
    """Four values and their slopes into out (3, k)."""
    out[0, c], out[0, c + 1], out[0, c + 2], out[0, c + 3] = q[:4]
    out[1, c], out[1, c + 1], out[1, c + 2], out[1, c + 3] = q[4:8]
    out[2, c], out[2, c + 1], out[2, c + 2], out[2, c + 3] = q[8:]


@numba.njit(cache=True, error_model="numpy")
def _fold_many(p: _Parts, v: Floats, begin: int, size: int, f: Floats, b: Indices) -> None:
    """First pass: what depends on v alone."""
    for i in range(size):
        f[_V + i] = _fold(p, read(v, begin + i))
    for i in range(size):
        f[_ROOT_0 + i], f[_ROOT_1 + i] = _roots(p, f[_V + i])
    for i in range(size):
        b[_BUCKET + i] = _bucket(f[_V + i] - p.v_first, p.per_v, p.top)


@numba.njit(cache=True, error_model="numpy")
def _band_many(p: _Parts, u: Floats, begin: int, size: int, f: Floats, b: Indices) -> None:
    """Second pass: lines and strips."""
    for i in range(size):
        band = _band(p, read(u, begin + i), f[_V + i], b[_BUCKET + i], f[_ROOT_0 + i], f[_ROOT_1 + i])
        f[_ABOVE + i], f[_WIDTH + i], f[_R + i], f[_G + i] = band.above, band.width, band.r, band.g
        b[_STRIP + i], b[_START + i], b[_LINE + i] = band.strip, band.start, band.line
        f[_MANY + i] = float(read(p.h, band.strip + 2))


@numba.njit(cache=True, error_model="numpy")
def _tau_many(p: _Parts, size: int, f: Floats, b: Indices) -> None:
    """Third pass: τ and its bucket."""
    if p.curved:
        for i in range(size):
            f[_TAU + i] = _tau(_part(f[_ABOVE + i], f[_WIDTH + i]))
    else:
        for i in range(size):
            f[_TAU + i] = _part(f[_ABOVE + i], f[_WIDTH + i])
    for i in range(size):
        b[_BUCKET + i] = _bucket(f[_TAU + i], f[_MANY + i], f[_MANY + i] - 1.0)


@numba.njit(cache=True, error_model="numpy")
def _column_many(p: _Parts, size: int, f: Floats, b: Indices) -> None:
    """Fourth pass: the patch and the place in it."""
    for i in range(size):
        k, row, s, h = _column(p, b[_STRIP + i], b[_BUCKET + i], f[_TAU + i])
        f[_S + i], f[_H + i] = s, h
        b[_ROW + i] = row
        b[_START + i] += k * row


@numba.njit(cache=True, error_model="numpy")
def _turn_many(p: _Parts, v: Floats, begin: int, size: int, f: Floats, b: Indices) -> None:
    """Fifth pass, for slopes: what turns those by s and r into those by u and v."""
    for i in range(size):
        f[_PER_U + i], f[_TAU_V + i], f[_PER_V + i] = _turning(
            p, f[_V + i], f[_ROOT_0 + i], f[_ROOT_1 + i], b[_LINE + i], f[_ABOVE + i], f[_WIDTH + i], f[_TAU + i],
            f[_H + i], f[_G + i], _turned(p, read(v, begin + i)),
        )


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _fetch(p: _Parts, i: int, size: int, b: Indices) -> None:
    """Have the coefficients brought that will be summed soon."""
    ahead = i + _AHEAD
    ahead = ahead if ahead < size else size - 1
    start, row = b[_START + ahead], b[_ROW + ahead]
    for c in range(0, 4 * p.k, 8):
        prefetch(p.n, start + c)
        prefetch(p.n, start + 4 * p.k + c)
        prefetch(p.n, start + row + c)
        prefetch(p.n, start + row + 4 * p.k + c)


@numba.njit(cache=True, error_model="numpy")
def _sum_many(p: _Parts, v: Floats, begin: int, size: int, f: Floats, b: Indices, out: Floats) -> None:
    """Last pass: the sums over patches."""
    for i in range(size):
        _fetch(p, i, size, b)
        start, row, turned = b[_START + i], b[_ROW + i], _turned(p, read(v, begin + i))
        s, h, r, g = _snap(p, f[_S + i]), f[_H + i], _snap(p, f[_R + i]), f[_G + i]
        for c in range(0, p.k, 4):
            q = values(p.n, start + 4 * c, row, 4 * p.k, s, h, r, g, p.parity + c, turned)
            out[begin + i, c], out[begin + i, c + 1], out[begin + i, c + 2], out[begin + i, c + 3] = q


@numba.njit(cache=True, error_model="numpy")
def _slope_many(p: _Parts, v: Floats, begin: int, size: int, f: Floats, b: Indices, out: Floats) -> None:
    """Last pass, with slopes."""
    for i in range(size):
        _fetch(p, i, size, b)
        start, row, turned = b[_START + i], b[_ROW + i], _turned(p, read(v, begin + i))
        s, h, r, g = f[_S + i], f[_H + i], f[_R + i], f[_G + i]
        per_u, tau_v, per_v = f[_PER_U + i], f[_TAU_V + i], f[_PER_V + i]
        for c in range(0, p.k, 4):
            place = start + 4 * c
            q = value_and_slopes(
                p.n, place, row, 4 * p.k, s, h, r, g, p.parity + c, turned, per_u, tau_v, per_v
            )
            _store(out[begin + i], c, q)


@numba.njit(cache=True, error_model="numpy")
def _locate_many(p: _Parts, u: Floats, v: Floats, begin: int, size: int, f: Floats, b: Indices) -> None:
    """The passes that find the patches of a block."""
    _fold_many(p, v, begin, size, f, b)
    _band_many(p, u, begin, size, f, b)
    _tau_many(p, size, f, b)
    _column_many(p, size, f, b)


@numba.njit(cache=True, error_model="numpy")
def _outside(p: _Parts, u: Floats, v: Floats) -> tuple[int, int]:
    """How many directions lie outside the table, and the first of them, or −1."""
    count = 0
    for i in range(u.size):
        count += not _inside(p, u[i], v[i])
    for i in range(u.size if count else 0):
        if not _inside(p, u[i], v[i]):
            return count, i
    return count, -1


@numba.njit(cache=True, error_model="numpy")
def _many(p: _Parts, u: Floats, v: Floats, out: Floats) -> None:
    """Values of many directions, block by block."""
    f, b = np.empty(14 * _BLOCK), np.empty(5 * _BLOCK, np.int64)
    for begin in range(0, u.size, _BLOCK):
        size = min(_BLOCK, u.size - begin)
        _locate_many(p, u, v, begin, size, f, b)
        _sum_many(p, v, begin, size, f, b, out)


@numba.njit(cache=True, error_model="numpy")
def lookup_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> tuple[int, int]:
    """`lookup` of many directions u, v (n,) into out (n, k): q_g, q_r, q_n, absorptance, …; the same bits.

    Returns how many directions lie outside the table (they get the edge value) and the first of them, or −1.
    """
    p = _open(t)
    x, y = u, v
    if t.axisymmetric:
        x, y = np.sqrt(u * u + v * v), np.zeros(u.size)
    _many(p, x, y, out)
    if t.axisymmetric:
        for i in range(u.size):
            along = out[i, 0]
            out[i, 0], out[i, 1] = (along * u[i] / x[i], along * v[i] / x[i]) if x[i] > 0.0 else (0.0, 0.0)
    return _outside(p, x, y)


@numba.njit(cache=True, error_model="numpy")
def lookup_slopes_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> None:
    """`lookup_slopes` of many directions u, v (n,) into out (n, 3, k); the same bits."""
    p = _open(t)
    f, b = np.empty(14 * _BLOCK), np.empty(5 * _BLOCK, np.int64)
    for begin in range(0, u.size, _BLOCK):
        size = min(_BLOCK, u.size - begin)
        _locate_many(p, u, v, begin, size, f, b)
        _turn_many(p, v, begin, size, f, b)
        _slope_many(p, v, begin, size, f, b, out)
