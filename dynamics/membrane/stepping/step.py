"""Time stepping: evaluate forces and heat, advance, many steps a call.

State and work arrays are changed in place. Arrays of effects that are off are empty, and nothing is computed for them.
A step starts from and ends with the acceleration and heating rate of its state, so a run may stop between any two steps
and go on later to the same bits.
"""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Floats
from beamrider.machine_code.standalone import standalone
from beamrider.machine_code.streams import uncounted
from dynamics.light.aim import aim
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects import composition, failure, properties, sheet, tearing, tethers, thermal
from dynamics.membrane.effects.spin import extrapolate, kick
from dynamics.membrane.layout.rows import StepTimes, gather, scatter, stiffen
from dynamics.membrane.layout.sweep import add_up
from dynamics.membrane.output.record import write_due, write_last
from dynamics.membrane.state import State
from dynamics.membrane.stepping.force_steps import add_impulse, free_steps, gain_at, take_free_steps
from dynamics.membrane.stepping.integrators import RK4, VERLET, accumulate, advance, advance_heat, copy
from dynamics.membrane.stepping.threads import dismiss, respond_all, sweep_all


@uncounted()
def _light_up(model: Model, work: WorkSpace, x: Floats, v: Floats, temperature: Floats, t: float) -> int:
    """New coefficients of the light's forces at time t in s; INTACT or LEFT_TABLE.

    What is held over k steps is that of the middle of them, (k − 1)/2 steps ahead: late coefficients would be an error
    of first order. Coefficients are those of the triangles' own frames, so the nodes may be seen in that of a beam that
    wanders.
    """
    ahead, own, light = 0.5 * (model.optics_every - 1) * model.dt, model.effects.light, work.effects.light
    if model.optics_every > 1:
        extrapolate(model.masses, x, v, ahead, work.ahead)
    else:
        copy(x, work.ahead)
    if own.wander.periods.size > 0:
        aim(own.wander, t + ahead, work.ahead)
    properties.absorb(model.effects.properties.absorption, own.corners, temperature, light.absorptance)
    respond_all(own, light, work.ahead, work.effects.tearing.gone, model.stencil, work.stencil)
    if light.outside[2] > 0 or (light.outside[0] > 0 and not own.clamp):
        return failure.LEFT_TABLE
    tearing.remove_all_light(work.effects.tearing, light, model.stencil, work.stencil.held)
    composition.relight(model, work, work.ahead, t + ahead)
    work.flags[0] = 1
    return failure.INTACT


@standalone(_nrt=False)
def warm_up(model: Model, work: WorkSpace, x: Floats, temperature: Floats, t: float, whole: bool) -> int:
    """Free lengths at new temperatures (n,); INTACT, THERMAL or NON_FINITE. Failure is tested after `whole` steps."""
    composition.lengthen(model, work, temperature)
    if not whole:
        return failure.INTACT
    corners, heat, broken = model.triangles.corners, model.effects.heat, work.effects.tearing
    code, found = failure.first_burnt(corners, heat.limit, heat.lowest, temperature)
    if code == failure.THERMAL and broken.failed.size > 0:
        tearing.burn(
            broken,
            model.effects.sheet,
            work.effects.sheet,
            heat,
            work.effects.heat,
            work.effects.light,
            model.stencil,
            work.stencil.held,
            model.effects.springs,
            corners,
            x,
            temperature,
            t,
        )
        lay_out(model, work)
        return failure.INTACT
    work.flags[1] = found
    return code


@uncounted()
def lay_out(model: Model, work: WorkSpace) -> None:
    """To the stencil what triangles carry, which changes as they fail."""
    now = work.effects.sheet
    stiffen(model.stencil, model.effects.sheet.cotangent, now.modulus, now.shear, now.limit, work.stencil)


@uncounted()
def _pull(model: Model, work: WorkSpace, x: Floats, t: float, gain: float) -> int:
    """Accelerations by elasticity and held light into work.stencil; INTACT, TENSILE or NON_FINITE."""
    still, own, now = StepTimes(False, 0.0, 0.0, 0.0, gain / 3.0), model.effects, work.effects
    scatter(model.stencil.place, x, work.stencil.scratch.x[0])
    if sweep_all(model.stencil, work.stencil, 0, still) == 0:
        return failure.INTACT
    if own.sheet.modulus.size == 0:
        code, work.flags[1] = failure.first_torn(own.springs, x, now.springs.free)
        return code
    if now.tearing.failed.size == 0:
        torn, finite = sheet.first_torn(
            own.sheet, now.sheet, model.stencil, work.stencil.free, model.triangles.corners, x
        )
        if torn < 0:
            return failure.INTACT
        work.flags[1] = torn
        return failure.TENSILE if finite else failure.NON_FINITE
    code, work.flags[1], torn = tearing.tear(
        now.tearing,
        own.sheet,
        now.sheet,
        now.heat,
        now.light,
        model.stencil,
        work.stencil,
        own.springs,
        model.triangles.corners,
        x,
        t,
    )
    if torn > 0:
        lay_out(model, work)
        sweep_all(model.stencil, work.stencil, 0, still)
    return code


@uncounted()
def _finite(x: Floats) -> bool:
    """Is every number finite."""
    flat, largest = x.reshape(-1), 0.0
    for i in range(flat.size):
        largest = largest if abs(flat[i]) <= largest else abs(flat[i])
    return largest < np.inf


@standalone(_nrt=False)
def evaluate(
    model: Model,
    work: WorkSpace,
    x: Floats,
    v: Floats,
    temperature: Floats,
    t: float,
    gain: float,
    renew: bool,
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
        work.flags[1] = work.effects.light.outside[1]
        return light
    if code != failure.INTACT:
        return code
    add_up(work.stencil.scratch.sums[0], work.effects.light.total)
    gather(model.stencil.place, work.stencil.scratch.v[1], work.acceleration)
    composition.accelerate(model, work, x, v, t)
    if heating:
        thermal.begin(work.effects.heat)
        composition.heat(model, work, x, temperature)
        thermal.end(work.effects.heat)
    return failure.INTACT


@uncounted()
def step(model: Model, state: State, work: WorkSpace, n: int, fresh: bool, most: int) -> tuple[int, int]:
    """From step n at most `most` steps on, or, if `fresh`, just the evaluation of a state that came from no step.

    Returns (failure code, step reached).
    """
    integrator, dt, every = model.integrator, model.dt, model.effects.heat.every
    if not fresh and n < model.effects.spin_up.steps:
        turn = kick(model.effects.spin_up, n, dt, model.masses, state.x, state.v)
        tethers.turn_on(work.effects.tethers, turn)
    evaluations = 4 if integrator == RK4 and not fresh else 1
    now = n if fresh else n + 1
    for k in range(evaluations):
        last = k == evaluations - 1
        warmed, heating = model.warm, model.warm
        if not fresh:
            acts = advance(integrator, dt, work.acceleration, state, work.stage, k)
            add_impulse(work.gain[0], work.effects.light.total, acts, state.impulse)
            tethers.drift(work.effects.tethers, acts, dt)
            if model.warm:
                warmed, heating = advance_heat(
                    integrator, dt, every, work.effects.heat.rate, state, work.stage, n - model.release, k
                )
        x = state.x if last else work.stage.x
        temperature = work.stage.temperature if not last and every == 1 else state.temperature
        t = (now - model.release) * dt if last else (n - model.release + (1.0 if k == 2 else 0.5)) * dt
        if warmed:
            code = warm_up(model, work, x, temperature, t, last)
            if code != failure.INTACT:
                return code, now
        if not fresh and most > 1:
            now += take_free_steps(model, state, work, now, most - 1)
            t, heating = (now - model.release) * dt, model.warm and (now - model.release) % every == 0
        renew = fresh or (last and (now - model.release) % model.optics_every == 0)
        v = state.v if last else work.stage.v
        code = evaluate(model, work, x, v, temperature, t, gain_at(model, t), renew, heating)
        if code != failure.INTACT:
            return code, now
    if integrator == VERLET and not fresh:
        accumulate(state.v, 0.5 * dt, work.acceleration)
        add_impulse(work.gain[0], work.effects.light.total, 0.5 * dt, state.impulse)
        tethers.settle(work.effects.tethers, dt)
    return failure.INTACT, now


@uncounted(nogil=True)
def run(
    model: Model, state: State, work: WorkSpace, n: int, stop: int, fresh: bool, rows: Floats
) -> tuple[int, int, int]:
    """Steps from n to `stop`; rows (k, WIDTH): one every series_every steps, at t = 0, at the end and where it fails.

    fresh: the state at n did not come from a step (the start, or after the release). Returns (failure code, step
    reached, rows written). With a code other than INTACT the state is the one in which it was found. Where the work
    space is for several threads, the others must be in `threads.assist`; they are dismissed at the end.
    """
    written, code = 0, failure.INTACT
    while code == failure.INTACT and (fresh or n < stop):
        code, n = step(model, state, work, n, fresh, free_steps(model, n, stop))
        if code == failure.INTACT:
            code, written = write_due(model, state, work, n, fresh, rows, written)
        fresh = False
    written = write_last(model, state, work, n, code, rows, written)
    dismiss(work.stencil.scratch.board)
    return code, n, written
