"""What compiled kernels need of any beam: the exponential, the ramp; `dynamics.light.pulse` is the layer above."""

from __future__ import annotations

import math

import numba
import numpy as np

#: Speed of light in m/s, exact.
LIGHT_SPEED = 299792458.0


#: ln 2 in two parts, the first of few digits: its small multiples are exact.
_LN2, _LN2_REST = 6.93147180369123816490e-01, 1.90821492927058770002e-10


@numba.njit(cache=True, inline="always")
def decay(s: float) -> float:
    """exp(s) for s ≤ 0, to 2 units in the last place, as arithmetic that the compiler turns into vector code.

    s = k ln 2 + r (Muller, Elementary Functions, §11): a power of two, whose exponent is written into its bits, times
    the series of exp(r) up to r¹³. Below −690, where it is 0 for all purposes, it stays at exp(−690).
    """
    s = max(s, -690.0)
    k = math.floor(s * 1.4426950408889634 + 0.5)
    r = (s - k * _LN2) - k * _LN2_REST
    p = 1.0 / 6227020800.0 * r + 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r * r + r + 1.0
    return p * float(np.int64((np.int64(k) + np.int64(1023)) << np.int64(52)).view(np.float64))


@numba.njit(cache=True, error_model="numpy")
def ramp(t: float, delay: float, rise: float, on: float) -> float:
    """Share of the full intensity at time t in s: dark until `delay`, raised-cosine rise, 1 for `on`, equal fall."""
    s = t - delay
    if s <= 0.0 or s >= on + 2.0 * rise:
        return 0.0
    if s < rise:
        return 0.5 * (1.0 - math.cos(math.pi * s / rise))
    if s <= rise + on:
        return 1.0
    return 0.5 * (1.0 + math.cos(math.pi * (s - rise - on) / rise))


@numba.njit(cache=True, error_model="numpy")
def ramp_integral(t: float, delay: float, rise: float, on: float) -> float:
    """Time in s for which the full beam would have given the light that `ramp` has let through until t."""
    s = min(max(t - delay, 0.0), on + 2.0 * rise)
    if s < rise:
        return 0.5 * (s - rise / math.pi * math.sin(math.pi * s / rise))
    if s <= rise + on:
        return s - 0.5 * rise
    late = s - rise - on
    return 0.5 * rise + on + 0.5 * (late + rise / math.pi * math.sin(math.pi * late / rise))


@numba.njit(cache=True, error_model="numpy")
def mean_ramp(begin: float, end: float, delay: float, rise: float, on: float) -> float:
    """Mean of `ramp` from `begin` to a later `end`, in s."""
    let_through = ramp_integral(end, delay, rise, on) - ramp_integral(begin, delay, rise, on)
    return min(max(let_through / (end - begin), 0.0), 1.0)
