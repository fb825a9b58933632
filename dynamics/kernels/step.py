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
from dynamics.kernels.optical import Light, LightWork
from dynamics.kernels.properties import Curves
from dynamics.kernels.reflections import Mirror, MirrorWork
from dynamics.kernels.sheet import Sheet, SheetWork
from dynamics.kernels.spin import SpinUp, kick
from dynamics.kernels.stencil import Stencil, StencilWork
from dynamics.kernels.tearing import Broken
from dynamics.kernels.thermal import Heat, HeatWork
from dynamics.kernels.triangles import Triangles

SEMI_IMPLICIT_EULER, VERLET, RK4 = range(3)


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


class State(NamedTuple):
    """x, v (3, n) in m and m/s; temperature (n,) in K, empty where heat is off; impulse (3,) of the light in N s."""

    x: Floats
    v: Floats
    temperature: Floats
    impulse: Floats


class Work(NamedTuple):
    """Work space: free lengths (e,) in m, pull (3, 2e + 1), acceleration (3, n), sides (6, t), and that of the effects.

    sheet: that of elastic triangles. flags: [1 if the held light is valid, failed edge or triangle]. gain (1,): the
    ramp at the latest evaluation. stage: arrays of rk4, empty for the others.
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
def copy(source: Floats, out: Floats) -> None:
    """Copy contiguous arrays of one shape; a plain loop compiles in a tenth of the time of a slice assignment."""
    a, b = source.reshape(-1), out.reshape(-1)
    for i in range(a.size):
        b[i] = a[i]


@numba.njit(cache=True, error_model="numpy")
def accumulate(out: Floats, factor: float, slope: Floats) -> None:
    """Add factor · slope to out, contiguous arrays of one shape."""
    a, b = out.reshape(-1), slope.reshape(-1)
    for i in range(a.size):
        a[i] += factor * b[i]


@numba.njit(cache=True, error_model="numpy")
def _light_up(model: Model, work: Work, x: Floats, temperature: Floats) -> int:
    """Add the light's forces to the acceleration, with new coefficients if flags[0] is 0; INTACT or LEFT_TABLE."""
    if work.flags[0] == 0:
        properties.absorb(model.curves.absorption, model.light.corners, temperature, work.light.absorptance)
        optical.refresh(model.light, work.light, x, work.sides)
        if work.light.outside[2] > 0 or (work.light.outside[0] > 0 and not model.light.clamp):
            work.flags[1] = work.light.outside[1]
            return failure.LEFT_TABLE
        for i in range(work.broken.gone.size):
            tearing.darken(work.broken, work.light, i)
        if model.mirror.kind.size > 0:
            reflections.bounce(
                model.mirror, work.mirror, model.light, work.light, x, work.sides, work.broken.gone
            )
        work.flags[0] = 1
    optical.turn(work.light, work.sides, work.gain[0])
    triangles.add_vectors(model.triangles.slots, work.light.force, work.acceleration)
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
    """Triangles as they are now, free lengths apart, to the stencil: after some have failed."""
    stencil.spread(work.sheet.modulus, model.stencil.cells, work.stencil.modulus)
    stencil.spread(work.sheet.limit, model.stencil.cells, work.stencil.limit)


@numba.njit(cache=True, error_model="numpy")
def _pull(model: Model, work: Work, x: Floats, t: float) -> int:
    """Elastic forces into work.acceleration; INTACT, TENSILE or NON_FINITE."""
    if stencil.forces(model.stencil, work.stencil, x, work.acceleration) == 0:
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
    stencil.forces(model.stencil, work.stencil, x, work.acceleration)
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
    if model.retardation.size > 0:
        damping.resist(
            model.retardation, model.sheet, work.sheet, model.springs, work.damping, x, v, work.acceleration
        )
    gain = ramp(t, model.light.delay, model.light.rise, model.light.on) if model.lit else 0.0
    work.gain[0] = gain
    if renew or gain == 0.0:
        work.flags[0] = 0
    if gain > 0.0 or heating:
        triangles.sides(x, model.triangles.corners, work.sides)
    if gain > 0.0:
        code = _light_up(model, work, x, temperature)
        if code != failure.INTACT:
            return code
    for c in range(3):
        a = work.acceleration[c]
        for i in range(a.size):
            a[i] *= model.per_mass[i]
    if heating:
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
def _advance(integrator: int, dt: float, acceleration: Floats, state: State, stage: Stage, k: int) -> float:
    """Go to the place of evaluation k of a step. Returns the time in s over which the present forces act."""
    if integrator == RK4:
        _rk4(dt, acceleration, state, stage, k)
        return dt / 6.0 if k in (0, 3) else dt / 3.0
    if integrator == VERLET:
        _kick_and_drift(dt, acceleration, state)
        return 0.5 * dt
    _euler(dt, acceleration, state)
    return dt


@numba.njit(cache=True, error_model="numpy")
def _advance_heat(
    integrator: int, dt: float, every: int, rate: Floats, state: State, stage: Stage, n: int, k: int
) -> tuple[bool, bool]:
    """The same for the temperatures. Returns whether they have changed, and whether their rate is due."""
    if integrator == RK4 and every == 1:
        _rk4_heat(dt, rate, state, stage, k)
        return True, True
    last = integrator != RK4 or k == 3
    warmed = last and n % every == 0
    if warmed:
        accumulate(state.temperature, dt * every, rate)
    return warmed, last and (n + 1) % every == 0


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
            acts = _advance(integrator, dt, work.acceleration, state, work.stage, k)
            _add_impulse(work.gain[0], work.light.total, acts, state.impulse)
            if model.warm:
                warmed, heating = _advance_heat(
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
