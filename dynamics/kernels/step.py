"""Time stepping: evaluate forces and heat, advance, many steps a call.

State and work arrays are changed in place. Arrays of effects that are off are empty, and nothing is computed for them.
A step starts from and ends with the acceleration and heating rate of its state, so a run may stop between any two steps
and go on later to the same bits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dynamics.kernels import elastic, failure, optical, record, thermal, triangles
from dynamics.kernels.beam import ramp
from dynamics.kernels.elastic import Floats, Springs
from dynamics.kernels.optical import Light, LightWork
from dynamics.kernels.spin import SpinUp, kick
from dynamics.kernels.thermal import Heat, HeatWork
from dynamics.kernels.triangles import Triangles

SEMI_IMPLICIT_EULER, VERLET, RK4 = range(3)


class Model(NamedTuple):
    """What flies, unchanging: see the parts.

    rest (3, n): shape in m the attitude is fitted to. lit, warm: are light and heat computed. dt in s; release: the
    step that starts at t = 0; end: the last one. optics_every: steps between updates of the held light; series_every:
    between rows. fly_away: distance in m from the axis at which a run ends.
    """

    springs: Springs
    triangles: Triangles
    masses: Floats
    per_mass: Floats
    rest: Floats
    lit: bool
    light: Light
    warm: bool
    heat: Heat
    spin_up: SpinUp
    integrator: int
    dt: float
    release: int
    end: int
    optics_every: int
    series_every: int
    fly_away: float


class State(NamedTuple):
    """x, v (3, n) in m and m/s; temperature (n,) in K, empty where heat is off; impulse (3,) of the light in N s."""

    x: Floats
    v: Floats
    temperature: Floats
    impulse: Floats


class Work(NamedTuple):
    """Work space: free lengths (e,) in m, pull (3, 2e + 1), acceleration (3, n), sides (6, t), and that of the effects.

    flags: [1 if the held light is valid, failed edge or triangle]. gain (1,): the ramp at the latest evaluation. stage:
    arrays of rk4, empty for the others.
    """

    free: Floats
    pull: Floats
    acceleration: Floats
    sides: Floats
    light: LightWork
    heat: HeatWork
    flags: NDArray[np.int64]
    gain: Floats
    stage: Stage


class Stage(NamedTuple):
    """Work space of rk4: positions and velocities of a stage, and their weighted sums (3, n); temperatures alike."""

    x: Floats
    v: Floats
    sum_x: Floats
    sum_v: Floats
    temperature: Floats
    sum_rate: Floats


@numba.njit(cache=True, error_model="numpy")
def axpy(y: Floats, factor: float, slope: Floats, out: Floats) -> None:
    """Write y + factor · slope into out, for contiguous arrays of one shape."""
    a, b, c = y.reshape(-1), slope.reshape(-1), out.reshape(-1)
    for i in range(a.size):
        c[i] = a[i] + factor * b[i]


@numba.njit(cache=True, error_model="numpy")
def accumulate(out: Floats, factor: float, slope: Floats) -> None:
    """Add factor · slope to out, contiguous arrays of one shape."""
    a, b = out.reshape(-1), slope.reshape(-1)
    for i in range(a.size):
        a[i] += factor * b[i]


@numba.njit(cache=True, error_model="numpy")
def _light_up(model: Model, work: Work, x: Floats) -> int:
    """Add the light's forces to the acceleration, with new coefficients if flags[0] is 0; INTACT or LEFT_TABLE."""
    if work.flags[0] == 0:
        optical.refresh(model.light, work.light, x, work.sides)
        if work.light.outside[0] > 0 and not model.light.clamp:
            work.flags[1] = work.light.outside[1]
            return failure.LEFT_TABLE
        work.flags[0] = 1
    optical.turn(work.light, work.sides, work.gain[0])
    triangles.add_vectors(model.triangles.slots, work.light.force, work.acceleration)
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def _warm_up(model: Model, work: Work, temperature: Floats) -> int:
    """Free lengths at new temperatures; INTACT, THERMAL or NON_FINITE."""
    elastic.free_lengths(model.springs, temperature, work.free)
    code, work.flags[1] = failure.first_burnt(model.springs, model.heat.limit, model.heat.lowest, temperature)
    return code


@numba.njit(cache=True, error_model="numpy")
def evaluate(
    model: Model, work: Work, x: Floats, temperature: Floats, t: float, renew: bool, warmed: bool, heating: bool
) -> int:
    """Acceleration and heating rate at positions x (3, n), temperature (n,) and time t in s; a failure code.

    renew: update the held light; warmed: the temperature has changed; heating: update the heating rate.
    """
    if warmed:
        code = _warm_up(model, work, temperature)
        if code != failure.INTACT:
            return code
    if elastic.forces(model.springs, x, work.free, work.pull, work.acceleration) > 0:
        code, work.flags[1] = failure.first_torn(model.springs, x, work.free)
        return code
    gain = ramp(t, model.light.delay, model.light.rise, model.light.on) if model.lit else 0.0
    work.gain[0] = gain
    if renew or gain == 0.0:
        work.flags[0] = 0
    if gain > 0.0 or heating:
        triangles.sides(x, model.triangles.corners, work.sides)
    if gain > 0.0:
        code = _light_up(model, work, x)
        if code != failure.INTACT:
            return code
    for c in range(3):
        a = work.acceleration[c]
        for i in range(a.size):
            a[i] *= model.per_mass[i]
    if heating:
        thermal.rates(
            model.heat, work.heat, model.springs, model.triangles.slots, work.sides, temperature, work.light.absorbed,
            gain,
        )
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def _add_impulse(work: Work, time: float, impulse: Floats) -> None:
    """Add the light's impulse over `time` in s."""
    if work.gain[0] > 0.0:
        for c in range(3):
            impulse[c] += time * work.light.total[c]


@numba.njit(cache=True, error_model="numpy")
def _euler(model: Model, state: State, work: Work) -> None:
    """Semi-implicit Euler: v += a Δt, then x += v Δt with the new v (Hairer, Lubich & Wanner, §I.1.2)."""
    _add_impulse(work, model.dt, state.impulse)
    accumulate(state.v, model.dt, work.acceleration)
    accumulate(state.x, model.dt, state.v)


@numba.njit(cache=True, error_model="numpy")
def _half_kick(model: Model, state: State, work: Work) -> None:
    """Velocity Verlet: half a kick before and after the drift (Hairer, Lubich & Wanner, §I.1.4)."""
    _add_impulse(work, 0.5 * model.dt, state.impulse)
    accumulate(state.v, 0.5 * model.dt, work.acceleration)


@numba.njit(cache=True, error_model="numpy")
def _rk4(model: Model, state: State, work: Work, k: int) -> None:
    """Classical Runge–Kutta of order 4: add slope k = 0 … 3, go to the next stage, after the last to the new state.

    The light is held over the stages in the frame of the triangles.
    """
    dt, s = model.dt, work.stage
    if k == 0:
        s.sum_x[:] = state.x
        s.sum_v[:] = state.v
        s.v[:] = state.v
    weight = dt / 6.0 if k in (0, 3) else dt / 3.0
    _add_impulse(work, weight, state.impulse)
    accumulate(s.sum_x, weight, s.v)
    accumulate(s.sum_v, weight, work.acceleration)
    if k == 3:
        state.x[:] = s.sum_x
        state.v[:] = s.sum_v
        return
    step = dt if k == 2 else 0.5 * dt
    axpy(state.x, step, s.v, s.x)
    axpy(state.v, step, work.acceleration, s.v)


@numba.njit(cache=True, error_model="numpy")
def _rk4_heat(model: Model, state: State, work: Work, k: int) -> None:
    """The same for the temperatures."""
    dt, s, rate = model.dt, work.stage, work.heat.rate
    if k == 0:
        s.sum_rate[:] = state.temperature
    accumulate(s.sum_rate, dt / 6.0 if k in (0, 3) else dt / 3.0, rate)
    if k == 3:
        state.temperature[:] = s.sum_rate
        return
    axpy(state.temperature, dt if k == 2 else 0.5 * dt, rate, s.temperature)


@numba.njit(cache=True, error_model="numpy")
def _advance(model: Model, state: State, work: Work, n: int, k: int) -> tuple[float, bool, bool]:
    """Go to the place of evaluation k of step n.

    Returns its time in s after the step's start, whether the temperatures have changed, and whether their rate is due.
    """
    stages = model.integrator == RK4
    last = not stages or k == 3
    if stages:
        _rk4(model, state, work, k)
    elif model.integrator == VERLET:
        _half_kick(model, state, work)
        accumulate(state.x, model.dt, state.v)
    else:
        _euler(model, state, work)
    after = model.dt if k >= 2 or last else 0.5 * model.dt
    if not model.warm:
        return after, False, False
    if stages and model.heat.every == 1:
        _rk4_heat(model, state, work, k)
        return after, True, True
    warmed = last and n % model.heat.every == 0
    if warmed:
        accumulate(state.temperature, model.dt * model.heat.every, work.heat.rate)
    return after, warmed, last and (n + 1) % model.heat.every == 0


@numba.njit(cache=True, error_model="numpy")
def step(model: Model, state: State, work: Work, n: int, fresh: bool) -> int:
    """From step n to n + 1, or, if `fresh`, just the evaluation of a state that came from no step; a failure code."""
    if not fresh and n < model.spin_up.steps:
        kick(model.spin_up, n, model.dt, model.masses, state.x, state.v)
    evaluations = 4 if model.integrator == RK4 and not fresh else 1
    for k in range(evaluations):
        after, warmed, heating = 0.0, model.warm, model.warm
        if not fresh:
            after, warmed, heating = _advance(model, state, work, n, k)
        last = k == evaluations - 1
        x = state.x if last else work.stage.x
        temperature = work.stage.temperature if not last and model.heat.every == 1 else state.temperature
        now = n if fresh else n + 1
        renew = fresh or (last and (now - model.release) % model.optics_every == 0)
        t = (now - model.release) * model.dt if last else (n - model.release) * model.dt + after
        code = evaluate(model, work, x, temperature, t, renew, warmed, heating)
        if code != failure.INTACT:
            return code
    if model.integrator == VERLET and not fresh:
        _half_kick(model, state, work)
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def write_row(model: Model, state: State, work: Work, n: int, row: Floats) -> int:
    """One row (WIDTH,) about the state at step n; INTACT, FLY_AWAY or NON_FINITE."""
    row[:] = 0.0
    row[0] = (n - model.release) * model.dt
    record.motion(model.masses, model.rest, state.x, state.v, row)
    row[28], row[29], row[31] = elastic.strain_and_energy(model.springs, state.x, work.free)
    if model.warm:
        record.warmth(model.triangles, state.temperature, row)
        row[34] = thermal.radiated(work.heat.emitting, model.triangles.slots, state.temperature, model.heat.background)
    if work.gain[0] > 0.0:
        record.illumination(model.light, work.light, state.x, work.gain[0], row)
    row[41:44] = state.impulse
    row[44] = work.light.outside[0]
    for value in row:
        if not math.isfinite(value):
            return failure.NON_FINITE
    return failure.FLY_AWAY if math.hypot(row[1], row[2]) > model.fly_away else failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def run(
    model: Model, state: State, work: Work, n: int, stop: int, fresh: bool, rows: Floats
) -> tuple[int, int, int]:
    """Steps from n to `stop`, with a row (·, WIDTH) every series_every steps, at t = 0 and at the end.

    fresh: the state at n did not come from a step (the start, or after the release). Returns (failure code, step
    reached, rows written). With a code other than INTACT the state is the one in which it was found.
    """
    written = 0
    while fresh or n < stop:
        code = step(model, state, work, n, fresh)
        n += 0 if fresh else 1
        if code != failure.INTACT:
            return code, n, written
        due = (n - model.release) % model.series_every == 0 or n == model.end
        if due and (fresh or n != model.release):
            code = write_row(model, state, work, n, rows[written])
            written += 1
            if code != failure.INTACT:
                return code, n, written
        fresh = False
    return failure.INTACT, n, written
