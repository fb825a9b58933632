"""What narrow resonances add to a pressure table: a sum over poles, with its slopes; compiled.

For each pole p = x + iγ and each quantity, Re[h γ / (u − p)]: see `optics.table.resonances`. x, γ and h are cubic in v
between nodes. The numbers are, one after the other: the nodes in v, then, interval by interval and pole by pole, those
of x, γ, and Re h and Im h of each quantity: left and right value, left and right slope times the width of the interval.
"""

from __future__ import annotations

import numba
import numpy as np

from beamrider.arrays import Complexes, Floats
from optics.table.patch_sum import read

# Numbers of each cubic.
_CUBIC = 4
# Between nodes an interpolated width may come out as zero or less.
_SHARPEST = 1e-12


def pack_poles(v: Floats, p: Complexes, h: Complexes, p_v: Complexes, h_v: Complexes) -> Floats:
    """The numbers, from nodes v (n), poles p (n_p, n), heights h (k, n_p, n) and the slopes of both in v."""
    f = np.concatenate([[p.real, p.imag], np.stack([h.real, h.imag], axis=1).reshape(-1, *p.shape)])
    f_v = np.concatenate([[p_v.real, p_v.imag], np.stack([h_v.real, h_v.imag], axis=1).reshape(-1, *p.shape)])
    width = np.diff(v)
    cubics = np.stack([f[..., :-1], f[..., 1:], f_v[..., :-1] * width, f_v[..., 1:] * width], axis=-1)
    return np.concatenate([v, np.ascontiguousarray(cubics.transpose(2, 1, 0, 3)).ravel()])


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _interval(n: Floats, first: int, nodes: int, v: float) -> int:
    """The interval of the nodes from `first` on that holds v."""
    low, high = 0, nodes - 1
    while high - low > 1:
        middle = (low + high) // 2
        if v >= read(n, first + middle):
            low = middle
        else:
            high = middle
    return low


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _cubic(n: Floats, at: int, r: float) -> float:
    """A cubic at r (0 … 1)."""
    s = 1.0 - r
    left, right = read(n, at) * (1.0 + 2.0 * r) + read(n, at + 2) * r, read(n, at + 1) * (3.0 - 2.0 * r)
    return left * (s * s) + (right - read(n, at + 3) * s) * (r * r)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _cubic_slope(n: Floats, at: int, r: float) -> float:
    """The derivative of a cubic by r."""
    s = 1.0 - r
    rise = 6.0 * r * s * (read(n, at + 1) - read(n, at))
    return rise + read(n, at + 2) * s * (1.0 - 3.0 * r) + read(n, at + 3) * r * (3.0 * r - 2.0)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _place(n: Floats, first: int, nodes: int, poles: int, k: int, v: float) -> tuple[int, float, float]:
    """Where the numbers of the interval begin that holds v, the place in it (0 … 1) and its width."""
    j = _interval(n, first, nodes, v)
    low = read(n, first + j)
    width = read(n, first + j + 1) - low
    r = (v - low) / width
    r = r if r > 0.0 else 0.0
    return first + nodes + j * (poles * (2 + 2 * k) * _CUBIC), (r if r < 1.0 else 1.0), width


@numba.njit(cache=True, error_model="numpy")
def pole_values(
    n: Floats, first: int, nodes: int, poles: int, k: int, c: int, u: float, v: float
) -> tuple[float, float, float, float]:
    """What the poles add to the quantities c … c + 3 of k at (u, v), v ≥ 0."""
    at, r, _ = _place(n, first, nodes, poles, k, v)
    q0 = q1 = q2 = q3 = 0.0
    for _ in range(poles):
        d, width = u - _cubic(n, at, r), max(_cubic(n, at + _CUBIC, r), _SHARPEST)
        scale = width / (d * d + width * width)
        real, imag = d * scale, width * scale
        h = at + (2 + 2 * c) * _CUBIC
        q0 += _cubic(n, h, r) * real - _cubic(n, h + 4, r) * imag
        q1 += _cubic(n, h + 8, r) * real - _cubic(n, h + 12, r) * imag
        q2 += _cubic(n, h + 16, r) * real - _cubic(n, h + 20, r) * imag
        q3 += _cubic(n, h + 24, r) * real - _cubic(n, h + 28, r) * imag
        at += (2 + 2 * k) * _CUBIC
    return q0, q1, q2, q3


@numba.njit(cache=True, error_model="numpy")
def pole_slopes(
    n: Floats, first: int, nodes: int, poles: int, k: int, c: int, u: float, v: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """∂u, then ∂v, of what the poles add to the quantities c … c + 3; n (size,): see `pack_poles`."""
    at, r, step = _place(n, first, nodes, poles, k, v)
    u0 = u1 = u2 = u3 = v0 = v1 = v2 = v3 = 0.0
    for _ in range(poles):
        width, width_v = _cubic(n, at + _CUBIC, r), _cubic_slope(n, at + _CUBIC, r) / step
        if width <= _SHARPEST:
            width, width_v = _SHARPEST, 0.0
        away = 1.0 / complex(u - _cubic(n, at, r), -width)
        by_u = -width * away * away
        moved = complex(_cubic_slope(n, at, r) / step, width_v)
        # ∂v of γ / (u − p) at a fixed height, and γ / (u − p) itself.
        by_v, shape = width_v * away - by_u * moved, width * away
        h = at + (2 + 2 * c) * _CUBIC
        u0, v0 = _add_slopes(n, h, r, step, by_u, by_v, shape, u0, v0)
        u1, v1 = _add_slopes(n, h + 8, r, step, by_u, by_v, shape, u1, v1)
        u2, v2 = _add_slopes(n, h + 16, r, step, by_u, by_v, shape, u2, v2)
        u3, v3 = _add_slopes(n, h + 24, r, step, by_u, by_v, shape, u3, v3)
        at += (2 + 2 * k) * _CUBIC
    return u0, u1, u2, u3, v0, v1, v2, v3


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _add_slopes(
    n: Floats, h: int, r: float, step: float, by_u: complex, by_v: complex, shape: complex, s_u: float, s_v: float
) -> tuple[float, float]:
    """Add ∂u and ∂v of one pole in one quantity, whose height is stored at `h`."""
    height = complex(_cubic(n, h, r), _cubic(n, h + _CUBIC, r))
    height_v = complex(_cubic_slope(n, h, r) / step, _cubic_slope(n, h + _CUBIC, r) / step)
    return s_u + (height * by_u).real, s_v + (height * by_v + height_v * shape).real


@numba.njit(cache=True, error_model="numpy")
def sum_poles(n: Floats, poles: int, nodes: int, u: Floats, v: Floats, out: Floats) -> None:
    """What the poles add at directions u, v ≥ 0 (n_d), for all quantities, into out (n_d, k), k a multiple of 4."""
    k = out.shape[1]
    for i in range(u.size):
        for c in range(0, k, 4):
            out[i, c], out[i, c + 1], out[i, c + 2], out[i, c + 3] = pole_values(n, 0, nodes, poles, k, c, u[i], v[i])
