"""Bicubic Hermite interpolation of pressure tables: compiled functions on plain arrays, used through `optics.table`."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class TableArrays(NamedTuple):
    """Plain arrays of a table for compiled kernels; see `lookup`.

    u (n_u), v (n_v): ascending nodes. bucket_u, bucket_v: node at or left of the start of each of the equal buckets.
    coefficients (n_u, n_v, 16): the values of q_g, q_r, q_n and absorptance, then their ∂u, their ∂v, their ∂u∂v.
    axisymmetric: v is collapsed, u is the sine of the angle of incidence. nearest: return the nearest node's value.
    """

    u: Floats
    v: Floats
    bucket_u: NDArray[np.int64]
    bucket_v: NDArray[np.int64]
    coefficients: Floats
    axisymmetric: bool
    nearest: bool


@numba.njit(cache=True, inline="always")
def _locate(nodes: Floats, buckets: NDArray[np.int64], x: float) -> int:
    """Index i of the interval nodes[i] ≤ x ≤ nodes[i + 1]; x must lie within the nodes."""
    span = nodes[-1] - nodes[0]
    b = min(max(int((x - nodes[0]) / span * buckets.size), 0), buckets.size - 1)
    i = buckets[b]
    while i < nodes.size - 2 and x >= nodes[i + 1]:
        i += 1
    while i > 0 and x < nodes[i]:
        i -= 1
    return i


@numba.njit(cache=True, inline="always")
def _hermite(s: float, h: float) -> tuple[float, float, float, float]:
    """Cubic Hermite weights of (value left, value right, slope left, slope right) at s in [0, 1] of a step h."""
    r = 1.0 - s
    return (1.0 + 2.0 * s) * r * r, s * s * (3.0 - 2.0 * s), h * s * r * r, -h * s * s * r


@numba.njit(cache=True, inline="always")
def _hermite_slope(s: float, h: float) -> tuple[float, float, float, float]:
    """Derivatives of the `_hermite` weights by x."""
    r = 1.0 - s
    return -6.0 * s * r / h, 6.0 * s * r / h, r * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)


@numba.njit(cache=True, inline="always")
def _patch(
    c: Floats, i: int, j: int, k: int,
    a: tuple[float, float, float, float], b: tuple[float, float, float, float],
) -> float:
    """Tensor Hermite sum of quantity k over the patch (i, j) with weights a along u and b along v.

    The order of the additions is that of `_patches`, to the bit.
    """
    f, g, p, q = c[i, j], c[i, j + 1], c[i + 1, j], c[i + 1, j + 1]
    left = (b[0] * f[k] + b[2] * f[8 + k]) + (b[1] * g[k] + b[3] * g[8 + k])
    left_u = (b[0] * f[4 + k] + b[2] * f[12 + k]) + (b[1] * g[4 + k] + b[3] * g[12 + k])
    right = (b[0] * p[k] + b[2] * p[8 + k]) + (b[1] * q[k] + b[3] * q[8 + k])
    right_u = (b[0] * p[4 + k] + b[2] * p[12 + k]) + (b[1] * q[4 + k] + b[3] * q[12 + k])
    return (a[0] * left + a[2] * left_u) + (a[1] * right + a[3] * right_u)


@numba.njit(cache=True)
def _lookup_plain(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """(q_g, q_r, q_n, absorptance, inside) on the (u, v) grid itself, clamped to its edge when outside."""
    uu = min(max(u, t.u[0]), t.u[-1])
    vv = min(max(v, t.v[0]), t.v[-1])
    inside = uu == u and vv == v
    i = _locate(t.u, t.bucket_u, uu)
    j = _locate(t.v, t.bucket_v, vv)
    hu = t.u[i + 1] - t.u[i]
    hv = t.v[j + 1] - t.v[j]
    s = (uu - t.u[i]) / hu
    r = (vv - t.v[j]) / hv
    c = t.coefficients
    if t.nearest:
        f = c[i + (1 if s > 0.5 else 0), j + (1 if r > 0.5 else 0)]
        return f[0], f[1], f[2], f[3], inside
    a = _hermite(s, hu)
    b = _hermite(r, hv)
    q_g, q_r, q_n = _patch(c, i, j, 0, a, b), _patch(c, i, j, 1, a, b), _patch(c, i, j, 2, a, b)
    return q_g, q_r, q_n, _patch(c, i, j, 3, a, b), inside


@numba.njit(cache=True)
def lookup(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """(q_g, q_r, q_n, absorptance, inside) of one direction; outside the table the edge value with inside = False."""
    if not t.axisymmetric:
        return _lookup_plain(t, u, v)
    s = np.sqrt(u * u + v * v)
    along, _, q_n, a, inside = _lookup_plain(t, s, 0.0)
    if s == 0.0:
        return 0.0, 0.0, q_n, a, inside
    return along * u / s, along * v / s, q_n, a, inside


@numba.njit(cache=True)
def lookup_gradient(t: TableArrays, u: float, v: float, out: Floats) -> bool:
    """Write ∂(q_g, q_r, q_n, absorptance)/∂(u, v) into out (4, 2); returns inside. Not for axisymmetric tables."""
    uu = min(max(u, t.u[0]), t.u[-1])
    vv = min(max(v, t.v[0]), t.v[-1])
    i = _locate(t.u, t.bucket_u, uu)
    j = _locate(t.v, t.bucket_v, vv)
    hu = t.u[i + 1] - t.u[i]
    hv = t.v[j + 1] - t.v[j]
    s = (uu - t.u[i]) / hu
    r = (vv - t.v[j]) / hv
    a = _hermite(s, hu)
    b = _hermite(r, hv)
    da = _hermite_slope(s, hu)
    db = _hermite_slope(r, hv)
    for k in range(4):
        out[k, 0] = _patch(t.coefficients, i, j, k, da, b)
        out[k, 1] = _patch(t.coefficients, i, j, k, a, db)
    return bool(uu == u and vv == v)


@numba.njit(cache=True, error_model="numpy")
def _cells(nodes: Floats, buckets: NDArray[np.int64], x: Floats, cell: NDArray[np.int64], s: Floats, h: Floats) -> None:
    """Interval, place in it (0 … 1) and its width for each x, clamped to the nodes."""
    first, end = nodes[0], nodes[-1]
    scale = buckets.size / (end - first)
    top = np.uint64(buckets.size - 1)
    for p in range(x.size):
        inner = min(max(x[p], first), end)
        i = buckets[min(np.uint64((inner - first) * scale), top)]
        while i < nodes.size - 2 and inner >= nodes[i + 1]:
            i += 1
        while i > 0 and inner < nodes[i]:
            i -= 1
        cell[p] = i
        h[p] = nodes[i + 1] - nodes[i]
        s[p] = (inner - nodes[i]) / h[p]


@numba.njit(cache=True, error_model="numpy")
def _weights(s: Floats, h: Floats, w: Floats) -> None:
    """The `_hermite` weights w (4, n) of many places s in intervals of width h."""
    w0, w1, w2, w3 = w[0], w[1], w[2], w[3]
    for p in range(s.size):
        w0[p], w1[p], w2[p], w3[p] = _hermite(s[p], h[p])


@numba.njit(cache=True, error_model="numpy")
def _patches(
    c: Floats, i: NDArray[np.int64], j: NDArray[np.int64], a: Floats, b: Floats, half: Floats, out: Floats
) -> None:
    """`_patch` of all four quantities at many places: first along v for the value and ∂u (half, 16), then along u.

    The eight numbers of the first loop lie side by side in memory, so that it becomes vector code.
    """
    flat = c.reshape(-1)
    row = c.shape[1] * 16
    a0, a1, a2, a3 = a[0], a[1], a[2], a[3]
    b0, b1, b2, b3 = b[0], b[1], b[2], b[3]
    eight = half.size // 2
    for p in range(i.size):
        start = i[p] * row + j[p] * 16
        f = flat[start : start + 32]
        g = flat[start + row : start + row + 32]
        y0, y1, y2, y3 = b0[p], b1[p], b2[p], b3[p]
        for k in range(eight):
            half[k] = (y0 * f[k] + y2 * f[8 + k]) + (y1 * f[16 + k] + y3 * f[24 + k])
            half[8 + k] = (y0 * g[k] + y2 * g[8 + k]) + (y1 * g[16 + k] + y3 * g[24 + k])
        x0, x1, x2, x3 = a0[p], a1[p], a2[p], a3[p]
        for k in range(4):
            out[p, k] = (x0 * half[k] + x2 * half[4 + k]) + (x1 * half[8 + k] + x3 * half[12 + k])


@numba.njit(cache=True, error_model="numpy")
def _nearest(c: Floats, i: NDArray[np.int64], j: NDArray[np.int64], s: Floats, r: Floats, out: Floats) -> None:
    """Values at the nearest nodes."""
    for p in range(i.size):
        for k in range(4):
            out[p, k] = c[i[p] + (1 if s[p] > 0.5 else 0), j[p] + (1 if r[p] > 0.5 else 0), k]


_BLOCK = 256


@numba.njit(cache=True, error_model="numpy")
def _many_plain(t: TableArrays, u: Floats, v: Floats, out: Floats) -> None:
    """`_lookup_plain` for many directions, in blocks that stay in the cache."""
    cells = np.empty((2, _BLOCK), np.int64)
    place, w, half = np.empty((4, _BLOCK)), np.empty((8, _BLOCK)), np.empty(16)
    for begin in range(0, u.size, _BLOCK):
        end = min(begin + _BLOCK, u.size)
        n = end - begin
        i, j = cells[0, :n], cells[1, :n]
        s, h, r, g = place[0, :n], place[1, :n], place[2, :n], place[3, :n]
        _cells(t.u, t.bucket_u, u[begin:end], i, s, h)
        _cells(t.v, t.bucket_v, v[begin:end], j, r, g)
        if t.nearest:
            _nearest(t.coefficients, i, j, s, r, out[begin:end])
            continue
        _weights(s, h, w[:4])
        _weights(r, g, w[4:])
        _patches(t.coefficients, i, j, w[:4], w[4:], half, out[begin:end])


@numba.njit(cache=True, error_model="numpy")
def _outside(t: TableArrays, u: Floats, v: Floats) -> tuple[int, int]:
    count, first = 0, -1
    for p in range(u.size):
        if not (t.u[0] <= u[p] <= t.u[-1] and t.v[0] <= v[p] <= t.v[-1]):
            count += 1
            if first < 0:
                first = p
    return count, first


@numba.njit(cache=True, error_model="numpy")
def lookup_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> tuple[int, int]:
    """`lookup` of many directions u, v (n,) into out (n, 4): q_g, q_r, q_n, absorptance; same bits, ten times faster.

    Returns how many directions lie outside the table (they get the edge value) and the first of them, or −1.
    """
    if not t.axisymmetric:
        _many_plain(t, u, v, out)
        return _outside(t, u, v)
    sine = np.sqrt(u * u + v * v)
    level = np.zeros(u.size)
    _many_plain(t, sine, level, out)
    for p in range(u.size):
        along = out[p, 0]
        out[p, 0] = along * u[p] / sine[p] if sine[p] > 0.0 else 0.0
        out[p, 1] = along * v[p] / sine[p] if sine[p] > 0.0 else 0.0
    return _outside(t, sine, level)
