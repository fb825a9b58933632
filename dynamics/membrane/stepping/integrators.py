"""Integrators: how state and temperatures advance between two evaluations of forces and heat, in place."""

from __future__ import annotations

import numba

from beamrider.arrays import Floats
from dynamics.membrane.state import Stage, State

SEMI_IMPLICIT_EULER, VERLET, RK4 = range(3)


@numba.njit(cache=True, error_model="numpy")
def axpy(y: Floats, factor: float, slope: Floats, out: Floats) -> None:
    """Write y + factor · slope into out, for contiguous arrays of one shape (...)."""
    a, b, c = y.reshape(-1), slope.reshape(-1), out.reshape(-1)
    for i in range(a.size):
        c[i] = a[i] + factor * b[i]


@numba.njit(cache=True, error_model="numpy")
def copy(source: Floats, out: Floats) -> None:
    """Copy contiguous arrays of one shape (...); a plain loop compiles in a tenth of the time of a slice assignment."""
    a, b = source.reshape(-1), out.reshape(-1)
    for i in range(a.size):
        b[i] = a[i]


@numba.njit(cache=True, error_model="numpy")
def accumulate(out: Floats, factor: float, slope: Floats) -> None:
    """Add factor · slope to out, contiguous arrays of one shape (...)."""
    a, b = out.reshape(-1), slope.reshape(-1)
    for i in range(a.size):
        a[i] += factor * b[i]


@numba.njit(cache=True, error_model="numpy")
def _euler(dt: float, acceleration: Floats, state: State) -> None:
    """Semi-implicit Euler: v += a Δt, then x += v Δt with the new v (Hairer, Lubich & Wanner, §I.1.2)."""
    accumulate(state.v, dt, acceleration)
    accumulate(state.x, dt, state.v)


@numba.njit(cache=True, error_model="numpy")
def _kick_and_drift(dt: float, acceleration: Floats, state: State) -> None:
    """Velocity Verlet but for its second half kick (Hairer, Lubich & Wanner, §I.1.4)."""
    accumulate(state.v, 0.5 * dt, acceleration)
    accumulate(state.x, dt, state.v)


@numba.njit(cache=True, error_model="numpy")
def _rk4(dt: float, acceleration: Floats, state: State, s: Stage, k: int) -> None:
    """Classical Runge–Kutta of order 4: add slope k = 0 … 3, go to the next stage, after the last to the new state.

    The light is held over the stages in the frame of the triangles.
    """
    if k == 0:
        copy(state.x, s.sum_x)
        copy(state.v, s.sum_v)
        copy(state.v, s.v)
    weight = dt / 6.0 if k in (0, 3) else dt / 3.0
    accumulate(s.sum_x, weight, s.v)
    accumulate(s.sum_v, weight, acceleration)
    if k == 3:
        copy(s.sum_x, state.x)
        copy(s.sum_v, state.v)
        return
    step = dt if k == 2 else 0.5 * dt
    axpy(state.x, step, s.v, s.x)
    axpy(state.v, step, acceleration, s.v)


@numba.njit(cache=True, error_model="numpy")
def _rk4_heat(dt: float, rate: Floats, state: State, s: Stage, k: int) -> None:
    """The same for the temperatures."""
    if k == 0:
        copy(state.temperature, s.sum_rate)
    accumulate(s.sum_rate, dt / 6.0 if k in (0, 3) else dt / 3.0, rate)
    if k == 3:
        copy(s.sum_rate, state.temperature)
        return
    axpy(state.temperature, dt if k == 2 else 0.5 * dt, rate, s.temperature)


@numba.njit(cache=True, error_model="numpy")
def advance(integrator: int, dt: float, acceleration: Floats, state: State, stage: Stage, k: int) -> float:
    """Go to the place of evaluation k of a step, with acceleration (3, n) in m/s².

    Returns the time in s over which the present forces act.
    """
    if integrator == RK4:
        _rk4(dt, acceleration, state, stage, k)
        return dt / 6.0 if k in (0, 3) else dt / 3.0
    if integrator == VERLET:
        _kick_and_drift(dt, acceleration, state)
        return 0.5 * dt
    _euler(dt, acceleration, state)
    return dt


@numba.njit(cache=True, error_model="numpy")
def advance_heat(
    integrator: int, dt: float, every: int, rate: Floats, state: State, stage: Stage, n: int, k: int
) -> tuple[bool, bool]:
    """The same for the temperatures, with their rate (n,) in K/s. Returns whether they changed, and if it is due."""
    if integrator == RK4 and every == 1:
        _rk4_heat(dt, rate, state, stage, k)
        return True, True
    last = integrator != RK4 or k == 3
    warmed = last and n % every == 0
    if warmed:
        accumulate(state.temperature, dt * every, rate)
    return warmed, last and (n + 1) % every == 0
