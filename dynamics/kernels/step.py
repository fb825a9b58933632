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

from dynamics.kernels import (
    damping,
    elastic,
    failure,
    optical,
    properties,
    record,
    reflections,
    sheet,
    stencil,
    tearing,
    thermal,
    triangles,
)
from dynamics.kernels.beam import ramp
from dynamics.kernels.damping import DampingWork
from dynamics.kernels.elastic import Floats, Springs
from dynamics.kernels.integrators import RK4, VERLET, Stage, State, accumulate, advance, advance_heat
from dynamics.kernels.optical import Light, LightWork
from dynamics.kernels.properties import Curves
from dynamics.kernels.reflections import Mirror, MirrorWork
from dynamics.kernels.sheet import Sheet, SheetWork
from dynamics.kernels.spin import SpinUp, foresee, kick
from dynamics.kernels.stencil import Stencil, StencilWork
from dynamics.kernels.tearing import Broken
from dynamics.kernels.thermal import Heat, HeatWork
from dynamics.kernels.triangles import Triangles


class Model(NamedTuple):
    """What flies, unchanging: see the parts.

    rest (3, n): shape in m the attitude is fitted to. lit, warm: are light and heat computed. dt in s; release: the
    step that starts at t = 0; end: the last one. optics_every: steps between updates of the held light; series_every:
    between rows. fly_away: distance in m from the axis at which a run ends; most_broken: failed triangles it outlives.
    retardation (t,): of the damping, in s, empty where that is off. curves: properties that change with temperature.
    """

    springs: Springs
    sheet: Sheet
    stencil: Stencil
    retardation: Floats
    triangles: Triangles
    masses: Floats
    per_mass: Floats
    rest: Floats
    lit: bool
    light: Light
    mirror: Mirror
    warm: bool
    heat: Heat
    curves: Curves
    spin_up: SpinUp
    integrator: int
    dt: float
    release: int
    end: int
    optics_every: int
    series_every: int
    fly_away: float
    most_broken: int


class Work(NamedTuple):
    """Work space: free lengths (e,) in m, pull (3, 2e + 1), acceleration (3, n), sides (6, t), and that of the effects.

    sheet: that of elastic triangles. flags: [1 if the held light is valid, failed edge or triangle]. gain (1,): the
    ramp at the latest evaluation. ahead (3, n): nodes in the middle of the time over which light is held, empty where
    it is renewed at every step. stage: arrays of rk4, empty for the others.
    """

    free: Floats
    sheet: SheetWork
    stencil: StencilWork
    damping: DampingWork
    pull: Floats
    acceleration: Floats
    sides: Floats
    light: LightWork
    mirror: MirrorWork
    broken: Broken
    heat: HeatWork
    flags: NDArray[np.int64]
    gain: Floats
    ahead: Floats
    stage: Stage


@numba.njit(cache=True, error_model="numpy")
def _light_up(model: Model, work: Work, x: Floats, v: Floats, temperature: Floats, t: float) -> int:
    """Add the light's forces, with new coefficients if flags[0] is 0; INTACT or LEFT_TABLE.

    What is held over k steps is that of the middle of them, (k − 1)/2 steps ahead: late coefficients would be an error
    of first order.
    """
    if work.flags[0] == 0:
        ahead = 0.5 * (model.optics_every - 1) * model.dt
        if model.optics_every > 1:
            foresee(model.masses, x, v, ahead, work.ahead)
            x = work.ahead
        triangles.sides(x, model.triangles.corners, work.sides)
        properties.absorb(model.curves.absorption, model.light.corners, temperature, work.light.absorptance)
        optical.refresh(model.light, work.light, x, work.sides)
        if work.light.outside[2] > 0 or (work.light.outside[0] > 0 and not model.light.clamp):
            work.flags[1] = work.light.outside[1]
            return failure.LEFT_TABLE
        for i in range(work.broken.gone.size):
            tearing.darken(work.broken, work.light, i)
        if model.mirror.kind.size > 0:
            reflections.bounce(
                model.mirror, work.mirror, model.light, work.light, x, work.sides, work.broken.gone,
                t + ahead,
            )
        stencil.hold(model.stencil, work.light.held, work.stencil.held)
        work.flags[0] = 1
    stencil.push(model.stencil, work.stencil, work.gain[0], work.light.total)
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def _warm_up(model: Model, work: Work, x: Floats, temperature: Floats, t: float) -> int:
    """Free lengths at new temperatures; INTACT, THERMAL or NON_FINITE."""
    sheet.grow(model.sheet, model.triangles.corners, temperature, work.sheet.free)
    properties.grow(
        model.curves.expansion, model.sheet, model.triangles.corners, temperature, work.sheet.free
    )
    elastic.free_lengths(model.springs, temperature, work.free)
    if model.sheet.expansion.size > 0 or model.curves.expansion.region.size > 0:
        stencil.spread(work.sheet.free, model.stencil.slots, work.stencil.free)
    if model.springs.expansion.size > 0:
        stencil.spread(work.free, model.stencil.edges, work.stencil.lengths)
    code, found = failure.first_burnt(model.springs, model.heat.limit, model.heat.lowest, temperature)
    if code == failure.THERMAL and work.broken.failed.size > 0:
        tearing.burn(
            work.broken, model.sheet, work.sheet, model.heat, work.heat, work.light, model.springs, x, temperature, t
        )
        _lay_out(model, work)
        return failure.INTACT
    work.flags[1] = found
    return code


@numba.njit(cache=True, error_model="numpy")
def _lay_out(model: Model, work: Work) -> None:
    """To the stencil what changes as triangles fail: what they carry, and the light on them."""
    stencil.spread(work.sheet.modulus, model.stencil.cells, work.stencil.modulus)
    stencil.spread(work.sheet.limit, model.stencil.cells, work.stencil.limit)
    if model.lit:
        stencil.hold(model.stencil, work.light.held, work.stencil.held)


@numba.njit(cache=True, error_model="numpy")
def _pull(model: Model, work: Work, x: Floats, t: float) -> int:
    """Elastic forces into work.stencil; INTACT, TENSILE or NON_FINITE."""
    if stencil.pull(model.stencil, work.stencil, x) == 0:
        return failure.INTACT
    if model.sheet.modulus.size == 0:
        code, work.flags[1] = failure.first_torn(model.springs, x, work.free)
        return code
    if work.broken.failed.size == 0:
        work.flags[1], finite = sheet.first_torn(model.sheet, work.sheet, model.springs, x, work.pull)
        return failure.TENSILE if finite else failure.NON_FINITE
    code, work.flags[1] = tearing.tear(
        work.broken, model.sheet, work.sheet, work.heat, work.light, model.springs, x, work.pull, t
    )
    _lay_out(model, work)
    stencil.pull(model.stencil, work.stencil, x)
    return code


@numba.njit(cache=True, error_model="numpy")
def evaluate(
    model: Model, work: Work, x: Floats, v: Floats, temperature: Floats, t: float, renew: bool, warmed: bool,
    heating: bool,
) -> int:
    """Acceleration and heating rate at x, v (3, n), temperature (n,) and time t in s; a failure code.

    renew: update the held light; warmed: the temperature has changed; heating: update the heating rate.
    """
    if warmed:
        code = _warm_up(model, work, x, temperature, t)
        if code != failure.INTACT:
            return code
    code = _pull(model, work, x, t)
    if code != failure.INTACT:
        return code
    gain = ramp(t, model.light.delay, model.light.rise, model.light.on) if model.lit else 0.0
    work.gain[0] = gain
    if renew or gain == 0.0:
        work.flags[0] = 0
    if gain > 0.0:
        code = _light_up(model, work, x, v, temperature, t)
        if code != failure.INTACT:
            return code
    stencil.accelerations(model.stencil, work.stencil, model.per_mass, work.acceleration)
    if model.retardation.size > 0:
        damping.resist(
            model.retardation, model.sheet, work.sheet, model.springs, work.damping, x, v, model.per_mass,
            work.acceleration
        )
    if heating:
        triangles.sides(x, model.triangles.corners, work.sides)
        properties.update(
            model.curves, model.triangles.corners, temperature, work.broken.gone, work.heat.emission,
            work.heat.conductance, work.heat.per_capacity,
        )
        thermal.rates(
            model.heat, work.heat, model.springs, model.triangles.slots, work.sides, temperature, work.light.absorbed,
            gain,
        )
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def _add_impulse(gain: float, force: Floats, time: float, impulse: Floats) -> None:
    """Add the impulse of the light's force (3,) over `time` in s."""
    if gain > 0.0:
        for c in range(3):
            impulse[c] += time * force[c]


@numba.njit(cache=True, error_model="numpy")
def step(model: Model, state: State, work: Work, n: int, fresh: bool) -> int:
    """From step n to n + 1, or, if `fresh`, just the evaluation of a state that came from no step; a failure code."""
    integrator, dt = model.integrator, model.dt
    if not fresh and n < model.spin_up.steps:
        kick(model.spin_up, n, dt, model.masses, state.x, state.v)
    evaluations = 4 if integrator == RK4 and not fresh else 1
    now = n if fresh else n + 1
    for k in range(evaluations):
        last = k == evaluations - 1
        warmed, heating = model.warm, model.warm
        if not fresh:
            acts = advance(integrator, dt, work.acceleration, state, work.stage, k)
            _add_impulse(work.gain[0], work.light.total, acts, state.impulse)
            if model.warm:
                warmed, heating = advance_heat(
                    integrator, dt, model.heat.every, work.heat.rate, state, work.stage, n, k
                )
        x = state.x if last else work.stage.x
        temperature = work.stage.temperature if not last and model.heat.every == 1 else state.temperature
        t = (now - model.release) * dt if last else (n - model.release + (1.0 if k == 2 else 0.5)) * dt
        renew = fresh or (last and (now - model.release) % model.optics_every == 0)
        v = state.v if last else work.stage.v
        code = evaluate(model, work, x, v, temperature, t, renew, warmed, heating)
        if code != failure.INTACT:
            return code
    if integrator == VERLET and not fresh:
        accumulate(state.v, 0.5 * dt, work.acceleration)
        _add_impulse(work.gain[0], work.light.total, 0.5 * dt, state.impulse)
    return failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def write_row(model: Model, state: State, work: Work, n: int, row: Floats) -> int:
    """One row (WIDTH,) about the state at step n; INTACT, FLY_AWAY or NON_FINITE."""
    for i in range(row.size):
        row[i] = 0.0
    row[0] = (n - model.release) * model.dt
    record.motion(model.masses, model.rest, state.x, state.v, row)
    if model.sheet.modulus.size > 0:
        row[28], row[29], row[31] = sheet.strain_and_energy(
            model.sheet, work.sheet, model.springs, state.x, work.pull
        )
    else:
        row[28], row[29], row[31] = elastic.strain_and_energy(model.springs, state.x, work.free)
    if model.warm:
        record.warmth(model.triangles, state.temperature, row)
        row[34] = thermal.radiated(work.heat.emitting, model.triangles.slots, state.temperature, model.heat.background)
    if work.gain[0] > 0.0:
        triangles.sides(state.x, model.triangles.corners, work.sides)
        optical.turn(work.light, work.sides, work.gain[0])
        record.illumination(model.light, work.light, state.x, work.gain[0], row)
        row[45] = work.gain[0] * work.mirror.account[reflections.LEAVES]
    for c in range(3):
        row[41 + c] = state.impulse[c]
    row[44] = work.light.outside[0]
    row[46], row[47] = work.broken.tally[tearing.BY_STRESS], work.broken.tally[tearing.BY_HEAT]
    for i in range(row.size):
        if not math.isfinite(row[i]):
            return failure.NON_FINITE
    if row[46] + row[47] > model.most_broken:
        return failure.BROKEN
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
