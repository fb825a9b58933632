"""Where a direction lies in the arrays of a pressure table: its strip, its patch and the place in that; compiled.

A table without cut-offs is one strip in which τ = x is linear in u; see `optics.table.strips` for the others. All of it
is drawn into the functions that call it, so that one direction and a block of them share the arithmetic, to the bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Integers
from optics.table.patch_sum import read

# How many numbers belong to the table, a node, a line and a strip. A strip: where its nodes of τ begin and their
# buckets, how many of these, where its coefficients would begin if it began at the first v node, numbers to the next τ.
HEADER, NODE, LINE, STRIP = 16, 3, 3, 5
# Slopes on a cut-off are infinite; they are taken this far from it in τ.
_OFF_CURVE = 1e-8
_THIN = 1e-200


class TableArrays(NamedTuple):
    """A table for compiled kernels: see `lookup`. What the arrays hold is known to `optics.table.layout`.

    numbers (n,), places (m,): everything, one after the other. axisymmetric: v is collapsed, u is the sine of the angle
    of incidence. nearest: return the nearest node's value.
    """

    numbers: Floats
    places: Integers
    axisymmetric: bool
    nearest: bool


class Parts(NamedTuple):
    """The numbers at the beginning of the arrays of `TableArrays` and where the parts begin, see `layout`."""

    n: Floats
    h: Integers
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
    poles: int
    pole_at: int
    pole_nodes: int


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def unpack(t: TableArrays) -> Parts:
    """Where `pack` has put the parts."""
    n, h = t.numbers, t.places
    return Parts(
        n,
        h,
        h[0],
        h[1],
        h[2],
        h[3],
        h[4],
        h[5],
        float(h[6] - 1),
        h[7],
        h[8],
        h[9] != 0,
        h[10] != 0,
        t.nearest,
        n[0],
        n[1],
        n[2],
        n[3],
        n[4],
        n[5],
        n[6],
        h[11],
        h[12],
        h[13],
    )


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def clamp(x: float, low: float, high: float) -> float:
    """Bring x within low … high; NaN becomes low, so that no place is outside the arrays."""
    x = x if x > low else low
    return x if x < high else high


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def fold(p: Parts, v: float) -> float:
    """|v| where the table is mirrored, v where not, within the table."""
    return clamp(abs(v) if p.mirror else v, p.v_first, p.v_last)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def is_inside(p: Parts, u: float, v: float) -> bool:
    """Is the direction within the table."""
    return bool((u >= p.u_first) & (u <= p.u_last) & (fold(p, v) == (abs(v) if p.mirror else v)))


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


class Band(NamedTuple):
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
def find_band(p: Parts, u: float, v: float, bucket: int, root_0: float, root_1: float) -> Band:
    """The band of a direction with v folded."""
    n, h, u = p.n, p.h, clamp(u, p.u_first, p.u_last)
    j = _find(n, p.v, read(h, p.bucket_v + bucket), v)
    at = p.v + NODE * j
    slab = read(h, p.slab + j)
    lines = p.lines + slab * (p.many * LINE)
    e = 0
    for other in range(1, p.many - 1):
        e += u > _line_at(n, lines + LINE * other, root_0, root_1)  # never beyond the edge of the window
    line = lines + LINE * e
    a = _line_at(n, line, root_0, root_1)
    width = _line_at(n, line + LINE, root_0, root_1) - a
    strip = p.strips + (slab * (p.many - 1) + e) * STRIP
    start = read(h, strip + 3) + j * (4 * p.k)
    r, g = _within(n, at, v)
    return Band(strip, start, r, g, line, u - a, width)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def part_of(above: float, width: float) -> float:
    """The place x in a strip (0 … 1)."""
    return clamp(above / (width if width > _THIN else _THIN), 0.0, 1.0)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def tau_of(x: float) -> float:
    """τ of the place x in a strip between cut-offs."""
    root = np.sqrt(x)
    return clamp(root / (root + np.sqrt(1.0 - x)), _OFF_CURVE, 1.0 - _OFF_CURVE)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def bucket_of(x: float, scale: float, top: float) -> int:
    """The bucket of x ≥ 0."""
    x = x * scale
    return int(x if x < top else top)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def find_column(p: Parts, strip: int, bucket: int, tau: float) -> tuple[int, int, float, float]:
    """Interval of τ in a strip, numbers from one interval to the next, place in it, its width."""
    first = read(p.h, strip)
    i = _find(p.n, first, read(p.h, read(p.h, strip + 1) + bucket), tau)
    s, h = _within(p.n, first + NODE * i, tau)
    return i, read(p.h, strip + 4), s, h


class Place(NamedTuple):
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
def roots(p: Parts, v: float) -> tuple[float, float]:
    """√(index² − v²) of both half-spaces."""
    return np.sqrt(p.square_0 - v * v), np.sqrt(p.square_1 - v * v)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def find_place(p: Parts, u: float, v: float, root_0: float, root_1: float) -> Place:
    """Where (u, v) lies, v folded; clamped to the table."""
    band = find_band(p, u, v, bucket_of(v - p.v_first, p.per_v, p.top), root_0, root_1)
    x = part_of(band.above, band.width)
    tau = tau_of(x) if p.curved else x
    many = float(read(p.h, band.strip + 2))
    i, row, s, h = find_column(p, band.strip, bucket_of(tau, many, many - 1.0), tau)
    return Place(band.start + i * row, row, s, h, band.r, band.g, band.line, band.above, band.width, tau)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def turning(
    p: Parts,
    v: float,
    root_0: float,
    root_1: float,
    line: int,
    above: float,
    width: float,
    tau: float,
    h: float,
    g: float,
    turned: bool,
) -> tuple[float, float, float]:
    """∂s/∂u, ∂s/∂v at fixed u, and ∂r/∂v of the place s, r in a patch; v is folded, `turned` if it was negative.

    √(index² − v²) in the lines changes by −v / √(index² − v²) per v.
    """
    n, x = p.n, part_of(above, width)
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
def snapped(p: Parts, s: float) -> float:
    """The place in an interval that is looked up: that of the nearest node, or s itself."""
    end = 1.0 if s > 0.5 else 0.0
    return end if p.nearest else s


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def is_turned(p: Parts, v: float) -> bool:
    """Is v < 0 to be had from −v."""
    return bool(p.mirror & (v < 0.0))
