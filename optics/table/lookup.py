"""Bicubic Hermite interpolation of pressure tables: compiled functions on plain arrays, used through `optics.table`.

Many directions are taken through each step together, block by block: steps of arithmetic become vector code, and the
coefficients of a patch are fetched from memory while those before are summed.
"""

from __future__ import annotations

import numba
import numpy as np

from beamrider.arrays import Floats, Integers
from beamrider.machine_code.standalone import standalone
from optics.table import films as film_table
from optics.table import thick_membranes as thick_table
from optics.table.layout import pack as pack
from optics.table.locate import (
    Parts,
    TableArrays,
    bucket_of,
    clamp,
    find_band,
    find_column,
    find_place,
    fold,
    is_inside,
    is_turned,
    part_of,
    roots,
    snapped,
    tau_of,
    turning,
    unpack,
)
from optics.table.patch_sum import prefetch, read, value_and_slopes, values
from optics.table.pole_sum import pole_slopes, pole_values

# Directions taken through the passes of `lookup_many` together, so that what is between them stays in the cache, and
# how many directions ahead of its sum a patch is fetched from memory.
_BLOCK = 128
_AHEAD = 8
# Where each pass puts its numbers: v folded, both roots, u − a and b − a, τ, the place in the patch and its steps
# (s, h along τ; r, g along v), buckets of the strip, ∂s/∂u, ∂s/∂v and ∂r/∂v.
_FLOATS, _PLACES = 14, 5
_V, _ROOT_0, _ROOT_1, _ABOVE, _WIDTH, _TAU, _S, _H, _R, _G, _MANY, _S_U, _S_V, _R_V = (
    k * _BLOCK for k in range(_FLOATS)
)
_BUCKET, _STRIP, _START, _ROW, _LINE = (k * _BLOCK for k in range(_PLACES))


@standalone()
def lookup(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """(q_g, q_r, q_n, absorptance, inside) of one direction; outside the table the edge value with inside = False."""
    if thick_table.is_thick(t):
        return thick_table.look_up(t, u, v)
    if film_table.is_film(t):
        return film_table.look_up(t, u, v)
    p = unpack(t)
    x, y = (np.sqrt(u * u + v * v), 0.0) if t.axisymmetric else (u, v)
    inside, folded = is_inside(p, x, y), fold(p, y)
    root_0, root_1 = roots(p, folded)
    at = find_place(p, x, folded, root_0, root_1)
    s, r = snapped(p, at.s), snapped(p, at.r)
    q0, q1, q2, q3 = values(p.n, at.start, at.row, 4 * p.k, s, at.h, r, at.g, p.parity, is_turned(p, y))
    if p.poles:
        more = _resonant(p, 0, x, folded, is_turned(p, y))
        q0, q1, q2, q3 = q0 + more[0], q1 + more[1], q2 + more[2], q3 + more[3]
    if t.axisymmetric:
        q0, q1 = (q0 * u / x, q0 * v / x) if x > 0.0 else (0.0, 0.0)
    return q0, q1, q2, q3, inside


@standalone()
def lookup_slopes(t: TableArrays, u: float, v: float, out: Floats) -> bool:
    """Write value, ∂u and ∂v of (q_g, q_r, q_n, absorptance, …) into out (3, k); returns inside.

    Not for axisymmetric tables. On a cut-off, where slopes are infinite, they are large.
    """
    if thick_table.is_thick(t):
        return thick_table.look_up_slopes(t, u, v, out)
    p = unpack(t)
    folded, turned = fold(p, v), is_turned(p, v)
    root_0, root_1 = roots(p, folded)
    at = find_place(p, u, folded, root_0, root_1)
    per = turning(p, folded, root_0, root_1, at.line, at.above, at.width, at.tau, at.h, at.g, turned)
    for c in range(0, p.k, 4):
        place = at.start + 4 * c
        q = value_and_slopes(
            p.n, place, at.row, 4 * p.k, at.s, at.h, at.r, at.g, p.parity + c, turned, per[0], per[1], per[2]
        )
        _store(out, c, q)
    if p.poles:
        _add_resonant_slopes(p, u, folded, turned, out)
    return is_inside(p, u, v)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _parity(p: Parts, c: int, turned: bool) -> float:
    """The sign of quantity c where v is turned."""
    return read(p.n, p.parity + c) if turned else 1.0


@numba.njit(cache=True, error_model="numpy")
def _resonant(p: Parts, c: int, u: float, v: float, turned: bool) -> tuple[float, float, float, float]:
    """What narrow resonances add to the quantities c … c + 3, v folded; clamped to the table."""
    q = pole_values(p.n, p.pole_at, p.pole_nodes, p.poles, p.k, c, clamp(u, p.u_first, p.u_last), v)
    return (
        q[0] * _parity(p, c, turned),
        q[1] * _parity(p, c + 1, turned),
        q[2] * _parity(p, c + 2, turned),
        q[3] * _parity(p, c + 3, turned),
    )


@numba.njit(cache=True, error_model="numpy")
def _add_resonant_slopes(p: Parts, u: float, v: float, turned: bool, out: Floats) -> None:
    """Add what narrow resonances give to values and slopes (3, k), v folded."""
    u, sign = clamp(u, p.u_first, p.u_last), -1.0 if turned else 1.0
    for c in range(0, p.k, 4):
        value = pole_values(p.n, p.pole_at, p.pole_nodes, p.poles, p.k, c, u, v)
        slope = pole_slopes(p.n, p.pole_at, p.pole_nodes, p.poles, p.k, c, u, v)
        for i in range(4):
            parity = _parity(p, c + i, turned)
            out[0, c + i] += value[i] * parity
            out[1, c + i] += slope[i] * parity
            out[2, c + i] += slope[4 + i] * (parity * sign)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _store(out: Floats, c: int, q: tuple[float, ...]) -> None:
    """Four values and their slopes into out (3, k)."""
    out[0, c], out[0, c + 1], out[0, c + 2], out[0, c + 3] = q[:4]
    out[1, c], out[1, c + 1], out[1, c + 2], out[1, c + 3] = q[4:8]
    out[2, c], out[2, c + 1], out[2, c + 2], out[2, c + 3] = q[8:]


@numba.njit(cache=True, error_model="numpy")
def _fold_many(p: Parts, v: Floats, begin: int, size: int, f: Floats, b: Integers) -> None:
    """First pass: what depends on v alone."""
    for i in range(size):
        f[_V + i] = fold(p, read(v, begin + i))
    for i in range(size):
        f[_ROOT_0 + i], f[_ROOT_1 + i] = roots(p, f[_V + i])
    for i in range(size):
        b[_BUCKET + i] = bucket_of(f[_V + i] - p.v_first, p.per_v, p.top)


@numba.njit(cache=True, error_model="numpy")
def _band_many(p: Parts, u: Floats, begin: int, size: int, f: Floats, b: Integers) -> None:
    """Second pass: lines and strips."""
    for i in range(size):
        band = find_band(p, read(u, begin + i), f[_V + i], b[_BUCKET + i], f[_ROOT_0 + i], f[_ROOT_1 + i])
        f[_ABOVE + i], f[_WIDTH + i], f[_R + i], f[_G + i] = band.above, band.width, band.r, band.g
        b[_STRIP + i], b[_START + i], b[_LINE + i] = band.strip, band.start, band.line
        f[_MANY + i] = float(read(p.h, band.strip + 2))


@numba.njit(cache=True, error_model="numpy")
def _tau_many(p: Parts, size: int, f: Floats, b: Integers) -> None:
    """Third pass: τ and its bucket."""
    if p.curved:
        for i in range(size):
            f[_TAU + i] = tau_of(part_of(f[_ABOVE + i], f[_WIDTH + i]))
    else:
        for i in range(size):
            f[_TAU + i] = part_of(f[_ABOVE + i], f[_WIDTH + i])
    for i in range(size):
        b[_BUCKET + i] = bucket_of(f[_TAU + i], f[_MANY + i], f[_MANY + i] - 1.0)


@numba.njit(cache=True, error_model="numpy")
def _column_many(p: Parts, size: int, f: Floats, b: Integers) -> None:
    """Fourth pass: the patch and the place in it."""
    for i in range(size):
        k, row, s, h = find_column(p, b[_STRIP + i], b[_BUCKET + i], f[_TAU + i])
        f[_S + i], f[_H + i] = s, h
        b[_ROW + i] = row
        b[_START + i] += k * row


@numba.njit(cache=True, error_model="numpy")
def _turn_many(p: Parts, v: Floats, begin: int, size: int, f: Floats, b: Integers) -> None:
    """Fifth pass, for slopes: what turns those by s and r into those by u and v."""
    for i in range(size):
        f[_S_U + i], f[_S_V + i], f[_R_V + i] = turning(
            p,
            f[_V + i],
            f[_ROOT_0 + i],
            f[_ROOT_1 + i],
            b[_LINE + i],
            f[_ABOVE + i],
            f[_WIDTH + i],
            f[_TAU + i],
            f[_H + i],
            f[_G + i],
            is_turned(p, read(v, begin + i)),
        )


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _fetch(p: Parts, i: int, size: int, b: Integers) -> None:
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
def _sum_many(p: Parts, v: Floats, begin: int, size: int, f: Floats, b: Integers, out: Floats) -> None:
    """Last pass: the sums over patches."""
    for i in range(size):
        _fetch(p, i, size, b)
        start, row, turned = b[_START + i], b[_ROW + i], is_turned(p, read(v, begin + i))
        s, h, r, g = snapped(p, f[_S + i]), f[_H + i], snapped(p, f[_R + i]), f[_G + i]
        for c in range(0, p.k, 4):
            q = values(p.n, start + 4 * c, row, 4 * p.k, s, h, r, g, p.parity + c, turned)
            out[begin + i, c], out[begin + i, c + 1], out[begin + i, c + 2], out[begin + i, c + 3] = q


@numba.njit(cache=True, error_model="numpy")
def _add_resonant(p: Parts, u: Floats, v: Floats, begin: int, size: int, f: Floats, out: Floats) -> None:
    """Add what narrow resonances give to the sums of a block."""
    for i in range(size):
        x, y, turned = read(u, begin + i), f[_V + i], is_turned(p, read(v, begin + i))
        for c in range(0, p.k, 4):
            more = _resonant(p, c, x, y, turned)
            for k in range(4):
                out[begin + i, c + k] += more[k]


@numba.njit(cache=True, error_model="numpy")
def _slope_many(p: Parts, v: Floats, begin: int, size: int, f: Floats, b: Integers, out: Floats) -> None:
    """Last pass, with slopes."""
    for i in range(size):
        _fetch(p, i, size, b)
        start, row, turned = b[_START + i], b[_ROW + i], is_turned(p, read(v, begin + i))
        s, h, r, g = f[_S + i], f[_H + i], f[_R + i], f[_G + i]
        s_u, s_v, r_v = f[_S_U + i], f[_S_V + i], f[_R_V + i]
        for c in range(0, p.k, 4):
            place = start + 4 * c
            q = value_and_slopes(p.n, place, row, 4 * p.k, s, h, r, g, p.parity + c, turned, s_u, s_v, r_v)
            _store(out[begin + i], c, q)


@numba.njit(cache=True, error_model="numpy")
def _locate_many(p: Parts, u: Floats, v: Floats, begin: int, size: int, f: Floats, b: Integers) -> None:
    """The passes that find the patches of a block."""
    _fold_many(p, v, begin, size, f, b)
    _band_many(p, u, begin, size, f, b)
    _tau_many(p, size, f, b)
    _column_many(p, size, f, b)


@numba.njit(cache=True, error_model="numpy")
def _outside(p: Parts, u: Floats, v: Floats) -> tuple[int, int]:
    """How many directions lie outside the table, and the first of them, or −1."""
    count = 0
    for i in range(u.size):
        count += not is_inside(p, u[i], v[i])
    for i in range(u.size if count else 0):
        if not is_inside(p, u[i], v[i]):
            return count, i
    return count, -1


@numba.njit(cache=True, error_model="numpy")
def _many(p: Parts, u: Floats, v: Floats, out: Floats) -> None:
    """Values of many directions, block by block."""
    f, b = np.empty(_FLOATS * _BLOCK), np.empty(_PLACES * _BLOCK, np.int64)
    for begin in range(0, u.size, _BLOCK):
        size = min(_BLOCK, u.size - begin)
        _locate_many(p, u, v, begin, size, f, b)
        _sum_many(p, v, begin, size, f, b, out)
        if p.poles:
            _add_resonant(p, u, v, begin, size, f, out)


@standalone()
def lookup_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> tuple[int, int]:
    """`lookup` of many directions u, v (n,) into out (n, k): q_g, q_r, q_n, absorptance, …; the same bits.

    Returns how many directions lie outside the table (they get the edge value) and the first of them, or −1.
    """
    if thick_table.is_thick(t):
        return thick_table.look_up_many(t, u, v, out)
    if film_table.is_film(t):
        return film_table.look_up_many(t, u, v, out)
    p = unpack(t)
    x, y = u, v
    if t.axisymmetric:
        x, y = np.sqrt(u * u + v * v), np.zeros(u.size)
    _many(p, x, y, out)
    if t.axisymmetric:
        for i in range(u.size):
            along = out[i, 0]
            out[i, 0], out[i, 1] = (along * u[i] / x[i], along * v[i] / x[i]) if x[i] > 0.0 else (0.0, 0.0)
    return _outside(p, x, y)


@standalone()
def lookup_slopes_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> None:
    """`lookup_slopes` of many directions u, v (n,) into out (n, 3, k); the same bits."""
    for i in range(u.size if thick_table.is_thick(t) else 0):
        thick_table.look_up_slopes(t, u[i], v[i], out[i])
    if thick_table.is_thick(t):
        return
    p = unpack(t)
    f, b = np.empty(_FLOATS * _BLOCK), np.empty(_PLACES * _BLOCK, np.int64)
    for begin in range(0, u.size, _BLOCK):
        size = min(_BLOCK, u.size - begin)
        _locate_many(p, u, v, begin, size, f, b)
        _turn_many(p, v, begin, size, f, b)
        _slope_many(p, v, begin, size, f, b, out)
        if p.poles:
            for i in range(begin, begin + size):
                _add_resonant_slopes(p, u[i], f[_V + i - begin], is_turned(p, v[i]), out[i])
