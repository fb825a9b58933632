"""Time stepping: evaluate forces and heat, advance, many steps a call.

State and work arrays are changed in place. Arrays of effects that are off are empty, and nothing is computed for them.
A step starts from and ends with the acceleration and heating rate of its state, so a run may stop between any two steps
and go on later to the same bits.
"""

from __future__ import annotations

import numba
import numpy as np

from beamrider.arrays import Floats
from dynamics.membrane.arrays import Model, Work
from dynamics.membrane.effects import damping, failure, held, properties, reflections, sheet, tearing, tethers, thermal
from dynamics.membrane.effects import springs as elastic
from dynamics.membrane.effects.spin import foresee, kick
from dynamics.membrane.layout import rows as stencil
from dynamics.membrane.layout.rows import Pace
from dynamics.membrane.layout.sweep import add_up
from dynamics.membrane.output.record import write_due, write_last
from dynamics.membrane.state import State
from dynamics.membrane.stepping.force_steps import add_impulse, free_run, gain_at, glide
from dynamics.membrane.stepping.integrators import RK4, VERLET, accumulate, advance, advance_heat, copy
from dynamics.membrane.stepping.threads import dismiss, respond_all, sweep_all


@numba.njit(cache=True, error_model="numpy")
def _darken(model: Model, work: Work) -> None:
    """No light on the triangles that are gone."""
    for i in range(work.broken.gone.size):
        tearing.darken(work.broken, work.light, model.stencil, work.stencil.held, i)


@numba.njit(cache=True, error_model="numpy")
def _light_up(model: Model, work: Work, x: Floats, v: Floats, temperature: Floats, t: float) -> int:
    """New coefficients of the light's forces at time t in s; INTACT or LEFT_TABLE.

    What is held over k steps is that of the middle of them, (k − 1)/2 steps ahead: late coefficients would be an error
    of first order.
    """
    ahead = 0.5 * (model.optics_every - 1) * model.dt
    if model.optics_every > 1:
        foresee(model.masses, x, v, ahead, work.ahead)
    else:
        copy(x, work.ahead)
    properties.absorb(model.curves.absorption, model.light.corners, temperature, work.light.absorptance)
    respond_all(model.light, work.light, work.ahead, work.broken.gone, model.stencil, work.stencil)
    if work.light.outside[2] > 0 or (work.light.outside[0] > 0 and not model.light.clamp):
        return failure.LEFT_TABLE
    _darken(model, work)
    if model.mirror.kind.size > 0:
        patch = stencil.patch(work.stencil.scratch, 0)
        reflections.bounce(
            model.mirror, work.mirror, model.light, work.light, patch, work.ahead, work.broken.gone, t + ahead
        )
        stencil.hold(model.stencil, patch.response, 0, 0, model.stencil.cells.size, work.stencil.held)
        _darken(model, work)
    work.flags[0] = 1
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def warm_up(model: Model, work: Work, x: Floats, temperature: Floats, t: float, whole: bool) -> int:
    """Free lengths at new temperatures; INTACT, THERMAL or NON_FINITE. What fails is tested after `whole` steps."""
    layout, corners = model.stencil, model.triangles.corners
    sheet.grow(model.sheet, layout, corners, temperature, work.stencil.free)
    properties.grow(model.curves.expansion, model.sheet, layout, corners, temperature, work.stencil.free)
    elastic.free_lengths(model.springs, temperature, work.free)
    if model.springs.expansion.size > 0:
        stencil.spread(work.free, model.stencil.joins, work.stencil.lengths)
    if not whole:
        return failure.INTACT
    code, found = failure.first_burnt(corners, model.heat.limit, model.heat.lowest, temperature)
    if code == failure.THERMAL and work.broken.failed.size > 0:
        tearing.burn(
            work.broken, model.sheet, work.sheet, model.heat, work.heat, work.light, layout, work.stencil.held,
            model.springs, corners, x, temperature, t,
        )
        lay_out(model, work)
        return failure.INTACT
    work.flags[1] = found
    return code


@numba.njit(cache=True, error_model="numpy")
def lay_out(model: Model, work: Work) -> None:
    """To the stencil what triangles carry, which changes as they fail."""
    carried = work.sheet
    stencil.stiffen(
        model.stencil, model.sheet.cotangent, carried.modulus, carried.shear, carried.limit, work.stencil
    )


@numba.njit(cache=True, error_model="numpy")
def _pull(model: Model, work: Work, x: Floats, t: float, gain: float) -> int:
    """Accelerations by elasticity and held light into work.stencil; INTACT, TENSILE or NON_FINITE."""
    still = Pace(False, 0.0, 0.0, 0.0, gain / 3.0)
    stencil.lay(model.stencil.place, x, work.stencil.scratch.x[0])
    if sweep_all(model.stencil, work.stencil, 0, still) == 0:
        return failure.INTACT
    if model.sheet.modulus.size == 0:
        code, work.flags[1] = failure.first_torn(model.springs, x, work.free)
        return code
    if work.broken.failed.size == 0:
        torn, finite = sheet.first_torn(
            model.sheet, work.sheet, model.stencil, work.stencil.free, model.triangles.corners, x
        )
        if torn < 0:
            return failure.INTACT
        work.flags[1] = torn
        return failure.TENSILE if finite else failure.NON_FINITE
    code, work.flags[1], torn = tearing.tear(
        work.broken, model.sheet, work.sheet, work.heat, work.light, model.stencil, work.stencil, model.springs,
        model.triangles.corners, x, t,
    )
    if torn > 0:
        lay_out(model, work)
        sweep_all(model.stencil, work.stencil, 0, still)
    return code


@numba.njit(cache=True, error_model="numpy")
def _finite(x: Floats) -> bool:
    """Is every number finite."""
    flat, largest = x.reshape(-1), 0.0
    for i in range(flat.size):
        largest = largest if abs(flat[i]) <= largest else abs(flat[i])
    return largest < np.inf


@numba.njit(cache=True, error_model="numpy")
def evaluate(
    model: Model, work: Work, x: Floats, v: Floats, temperature: Floats, t: float, gain: float, renew: bool,
    heating: bool,
) -> int:
    """Acceleration and heating rate at x, v (3, n), temperature (n,) and time t in s; a failure code.

    gain: share of the beam's full intensity; renew: update the held light; heating: update the heating rate.
    """
    work.gain[0], light = gain, failure.INTACT
    if renew or gain == 0.0:
        work.flags[0] = 0
    if gain > 0.0 and work.flags[0] == 0 and _finite(x):
        light = _light_up(model, work, x, v, temperature, t)
    code = _pull(model, work, x, t, gain)
    if code == failure.INTACT and light != failure.INTACT:
        work.flags[1] = work.light.outside[1]
        return light
    if code != failure.INTACT:
        return code
    add_up(work.stencil.scratch.sums[0], work.light.total)
    stencil.pick(model.stencil.place, work.stencil.scratch.v[1], work.acceleration)
    if model.retardation.size > 0:
        damping.resist(
            model.retardation, model.sheet, work.sheet, model.springs, work.damping, x, v, model.per_mass,
            work.acceleration
        )
    if model.holder.acts:
        held.hold(model.holder, x, v, model.per_mass, t, work.acceleration)
    if model.tethers.mass.size > 0:
        tethers.tie(model.tethers, work.tethers, model.holder, x, v, model.per_mass, t, work.acceleration)
    if heating:
        properties.update(
            model.curves, model.triangles.corners, temperature, work.broken.gone, work.heat.emission,
            work.heat.conductance, work.heat.per_capacity,
        )
        thermal.rates(
            model.heat, work.heat, model.springs, model.triangles.corners, stencil.patch(work.stencil.scratch, 0), x,
            temperature, work.light.absorbed, gain,
        )
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def step(model: Model, state: State, work: Work, n: int, fresh: bool, most: int) -> tuple[int, int]:
    """From step n at most `most` steps on, or, if `fresh`, just the evaluation of a state that came from no step.

    Returns (failure code, step reached).
    """
    integrator, dt = model.integrator, model.dt
    if not fresh and n < model.spin_up.steps:
        turn = kick(model.spin_up, n, dt, model.masses, state.x, state.v)
        tethers.turn_on(work.tethers, turn)
    evaluations = 4 if integrator == RK4 and not fresh else 1
    now = n if fresh else n + 1
    for k in range(evaluations):
        last = k == evaluations - 1
        warmed, heating = model.warm, model.warm
        if not fresh:
            acts = advance(integrator, dt, work.acceleration, state, work.stage, k)
            add_impulse(work.gain[0], work.light.total, acts, state.impulse)
            if model.tethers.mass.size > 0:
                tethers.drift(work.tethers, acts, dt)
            if model.warm:
                warmed, heating = advance_heat(
                    integrator, dt, model.heat.every, work.heat.rate, state, work.stage, n - model.release, k
                )
        x = state.x if last else work.stage.x
        temperature = work.stage.temperature if not last and model.heat.every == 1 else state.temperature
        t = (now - model.release) * dt if last else (n - model.release + (1.0 if k == 2 else 0.5)) * dt
        if warmed:
            code = warm_up(model, work, x, temperature, t, last)
            if code != failure.INTACT:
                return code, now
        if not fresh and most > 1:
            now += glide(model, state, work, now, most - 1)
            t, heating = (now - model.release) * dt, model.warm and (now - model.release) % model.heat.every == 0
        renew = fresh or (last and (now - model.release) % model.optics_every == 0)
        v = state.v if last else work.stage.v
        code = evaluate(model, work, x, v, temperature, t, gain_at(model, t), renew, heating)
        if code != failure.INTACT:
            return code, now
    if integrator == VERLET and not fresh:
        accumulate(state.v, 0.5 * dt, work.acceleration)
        add_impulse(work.gain[0], work.light.total, 0.5 * dt, state.impulse)
        tethers.settle(work.tethers, dt)
    return failure.INTACT, now


@numba.njit(cache=True, error_model="numpy", nogil=True)
def run(
    model: Model, state: State, work: Work, n: int, stop: int, fresh: bool, rows: Floats
) -> tuple[int, int, int]:
    """Steps from n to `stop`, with a row (·, WIDTH) every series_every steps, at t = 0, at the end and where it fails.

    fresh: the state at n did not come from a step (the start, or after the release). Returns (failure code, step
    reached, rows written). With a code other than INTACT the state is the one in which it was found. Where the work
    space is for several threads, the others must be in `threads.assist`; they are dismissed at the end.
    """
    written, code = 0, failure.INTACT
    while code == failure.INTACT and (fresh or n < stop):
        code, n = step(model, state, work, n, fresh, free_run(model, n, stop))
        if code == failure.INTACT:
            code, written = write_due(model, state, work, n, fresh, rows, written)
        fresh = False
    written = write_last(model, state, work, n, code, rows, written)
    dismiss(work.stencil.scratch.board)
    return code, n, written
