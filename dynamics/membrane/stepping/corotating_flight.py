"""Flight in the semi-implicit steps of `corotating`, light and heat renewed in each of them."""

from __future__ import annotations

import numba

from beamrider.arrays import Floats
from dynamics.light.aim import brightness
from dynamics.light.intensity import mean_ramp
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects import failure
from dynamics.membrane.effects.spin import SpinUp, kick
from dynamics.membrane.output.record import write_due, write_last
from dynamics.membrane.state import State
from dynamics.membrane.stepping.corotating import (
    Corotating,
    CorotatingWork,
    beyond,
    replace_accelerations,
    replace_at_release,
)
from dynamics.membrane.stepping.integrators import VERLET, accumulate, advance, copy
from dynamics.membrane.stepping.step import evaluate, warm_up
from dynamics.membrane.stepping.threads import dismiss


@numba.njit(cache=True, error_model="numpy")
def _gain(model: Model, begin: float, end: float) -> float:
    """Mean share of the beam's full intensity from `begin` to `end` in s: it may rise within a small part of a step."""
    if not model.lit:
        return 0.0
    light = model.effects.light
    return mean_ramp(begin, end, light.delay, light.rise, light.on) * brightness(light.wander, 0.5 * (begin + end))


@numba.njit(cache=True, error_model="numpy")
def _act(model: Model, work: WorkSpace, state: State) -> None:
    """Half a step of the present accelerations."""
    accumulate(state.v, 0.5 * model.dt, work.acceleration)
    if work.gain[0] > 0.0:
        for c in range(3):
            state.impulse[c] += 0.5 * model.dt * work.effects.light.total[c]


@numba.njit(cache=True, error_model="numpy")
def _warm(model: Model, state: State, work: WorkSpace, own: CorotatingWork) -> None:
    """Temperatures one step on, by the two-step method of Adams & Bashforth (Hairer, Nørsett & Wanner, §III.1)."""
    for i in range(state.temperature.size):
        rate = work.effects.heat.rate[i]
        state.temperature[i] += model.dt * (1.5 * rate - 0.5 * own.rate[i])
        own.rate[i] = rate


@numba.njit(cache=True, error_model="numpy")
def _spin(model: Model, scheme: Corotating, state: State, work: WorkSpace, n: int, k: int) -> float:
    """To the evaluation of explicit step k within step n of the spin-up; returns the time left of step n in s."""
    size = model.dt / scheme.substeps
    given = model.effects.spin_up
    spin_up = SpinUp(given.rate, given.steps * scheme.substeps, given.acceleration)
    kick(spin_up, n * scheme.substeps + k, size, model.masses, state.x, state.v)
    advance(VERLET, size, work.acceleration, state, work.stage, 0)
    return (scheme.substeps - 1 - k) * size


@numba.njit(cache=True, error_model="numpy")
def _finish(model: Model, scheme: Corotating, state: State, work: WorkSpace, own: CorotatingWork, fresh: bool) -> int:
    """From the true accelerations to those of the scheme, and to the end of the step; a failure code."""
    if fresh:
        replace_at_release(model, scheme, own, state.x, state.v, work.acceleration)
    else:
        replace_accelerations(model, scheme, own, state.x, state.v, work.acceleration)
        _act(model, work, state)
    triangle = beyond(model.effects.springs, scheme, model.stencil.slots, work.stencil.free, own)
    if triangle >= 0:
        work.flags[1] = triangle
        return failure.BEYOND
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def _step(
    model: Model, scheme: Corotating, state: State, work: WorkSpace, own: CorotatingWork, n: int, fresh: bool
) -> int:
    """From step n to n + 1, or, if `fresh`, just the evaluation of a state that came from no step; a failure code."""
    spinning_up = n < model.release
    if model.warm and not fresh:
        _warm(model, state, work, own)
    pieces = scheme.substeps if spinning_up and not fresh else 1
    t, gain = ((n if fresh else n + 1) - model.release) * model.dt, 0.0
    for k in range(pieces):
        when = t
        if spinning_up and not fresh:
            when -= _spin(model, scheme, state, work, n, k)
        elif not spinning_up:
            if not fresh:
                _act(model, work, state)
                accumulate(state.x, model.dt, state.v)
            gain = _gain(model, t if fresh else t - 0.5 * model.dt, t + 0.5 * model.dt)
        heating = model.warm and k == pieces - 1
        code = failure.INTACT
        if model.warm and k == 0:
            code = warm_up(model, work, state.x, state.temperature, when, True)
        if code == failure.INTACT:
            code = evaluate(model, work, state.x, state.v, state.temperature, when, gain, True, heating)
        if code != failure.INTACT:
            return code
        if spinning_up and not fresh:
            accumulate(state.v, 0.5 * model.dt / scheme.substeps, work.acceleration)
    if model.warm and fresh:
        copy(work.effects.heat.rate, own.rate)
    return failure.INTACT if spinning_up else _finish(model, scheme, state, work, own, fresh)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def run(
    model: Model,
    scheme: Corotating,
    state: State,
    work: WorkSpace,
    own: CorotatingWork,
    n: int,
    stop: int,
    fresh: bool,
    rows: Floats,
) -> tuple[int, int, int]:
    """As `dynamics.membrane.stepping.step.run`, with the steps of this scheme.

    With BEYOND the step is done all the same; a stiffer scheme goes on from there.
    """
    written, code = 0, failure.INTACT
    while code == failure.INTACT and (fresh or n < stop):
        code = _step(model, scheme, state, work, own, n, fresh)
        n += 0 if fresh else 1
        if code in (failure.INTACT, failure.BEYOND):
            found, written = write_due(model, state, work, n, fresh, rows, written)
            code = found if found != failure.INTACT else code
        fresh = False
    if code != failure.BEYOND:
        written = write_last(model, state, work, n, code, rows, written)
    dismiss(work.stencil.scratch.board)
    return code, n, written
