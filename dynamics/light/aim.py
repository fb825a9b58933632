"""The beam's axis and power as time goes on, for compiled kernels; `dynamics.light.pointing` makes the tracks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Integers

SHIFT_X, SHIFT_Y, TILT_X, TILT_Y, POWER = range(5)


class Wander(NamedTuple):
    """Tracks that add up, each a piecewise cubic of five channels: shift (2), tilt (2) in rad, share of power beyond 1.

    starts (k + 1,): where the pieces of each begin. times (n,): beginnings of pieces, the last of a track its end.
    pieces (n, 5, 4): coefficients, highest power first. periods (k,): 0 of a track that stays at its ends.
    """

    starts: Integers
    times: Floats
    pieces: Floats
    periods: Floats


@numba.njit(cache=True, error_model="numpy")
def where(wander: Wander, t: float, out: Floats) -> None:
    """Write the channels (5,) at time t."""
    out[:] = 0.0
    for k in range(wander.periods.size):
        low, high = wander.starts[k], wander.starts[k + 1] - 1
        first, last, period = wander.times[low], wander.times[high], wander.periods[k]
        s = t - period * math.floor(t / period) if period > 0.0 else t
        s = min(max(s, first), last)
        while high - low > 1:
            middle = (low + high) // 2
            if wander.times[middle] <= s:
                low = middle
            else:
                high = middle
        s -= wander.times[low]
        for c in range(5):
            p = wander.pieces[low, c]
            out[c] += ((p[0] * s + p[1]) * s + p[2]) * s + p[3]


@numba.njit(cache=True, error_model="numpy")
def brightness(wander: Wander, t: float) -> float:
    """Factor of the power at time t, never below 0."""
    if wander.periods.size == 0:
        return 1.0
    now = np.empty(5)
    where(wander, t, now)
    return max(0.0, 1.0 + now[POWER])


@numba.njit(cache=True, error_model="numpy")
def axes(now: Floats, out: Floats) -> None:
    """Write the axes (3, 3), as rows, of a beam with channels `now`: the light's direction last.

    It goes along (tan a, tan b, 1), a and b the tilts; the first axis is x, turned by the least angle.
    """
    a, b = math.tan(now[TILT_X]), math.tan(now[TILT_Y])
    w = 1.0 / math.sqrt(1.0 + a * a + b * b)
    u, v = a * w, b * w
    share = 1.0 / (1.0 + w)
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - u * u * share, -u * v * share, -u
    out[1, 0], out[1, 1], out[1, 2] = -u * v * share, 1.0 - v * v * share, -v
    out[2, 0], out[2, 1], out[2, 2] = u, v, w


@numba.njit(cache=True, error_model="numpy")
def aim(wander: Wander, t: float, x: Floats) -> None:
    """Take points x (3, n) from the lab to the frame of the beam at time t: its axis z, its middle x = y = 0."""
    now, frame = np.empty(5), np.empty((3, 3))
    where(wander, t, now)
    axes(now, frame)
    for i in range(x.shape[1]):
        a, b, c = x[0, i] - now[SHIFT_X], x[1, i] - now[SHIFT_Y], x[2, i]
        for k in range(3):
            x[k, i] = frame[k, 0] * a + frame[k, 1] * b + frame[k, 2] * c
