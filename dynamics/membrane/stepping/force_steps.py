"""Steps between which nothing but forces is due, several at once."""

from __future__ import annotations

from beamrider.arrays import Floats
from beamrider.machine_code.standalone import standalone
from beamrider.machine_code.streams import uncounted
from dynamics.light.aim import brightness
from dynamics.light.intensity import ramp
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects.composition import acts_each_step
from dynamics.membrane.layout.rows import StepTimes, clear, gather, scatter
from dynamics.membrane.layout.sweep import add_up
from dynamics.membrane.state import State
from dynamics.membrane.stepping.integrators import RK4, VERLET
from dynamics.membrane.stepping.threads import sweep_all


@uncounted()
def gain_at(model: Model, t: float) -> float:
    """Share of the beam's full intensity at time t in s."""
    light = model.effects.light
    return ramp(t, light.delay, light.rise, light.on) * brightness(light.wander, t) if model.lit else 0.0


@uncounted()
def add_impulse(gain: float, force: Floats, time: float, impulse: Floats) -> None:
    """Add the impulse of the light's force (3,) over `time` in s."""
    if gain > 0.0:
        for c in range(3):
            impulse[c] += time * force[c]


@uncounted()
def _left(count: int, every: int) -> int:
    """How many steps after `count` the next multiple of `every` comes."""
    return every - count % every


@uncounted()
def free_steps(model: Model, n: int, stop: int) -> int:
    """Steps from n to the next, not beyond `stop`, after which more than forces is due."""
    if n < model.effects.spin_up.steps or model.integrator == RK4 or acts_each_step(model):
        return 1
    most = min(stop - n, _left(n - model.release, model.series_every))
    if model.lit:
        most = min(most, _left(n - model.release, model.optics_every))
    return min(most, _left(n - model.release, model.effects.heat.every)) if model.warm else most


@uncounted()
def _steady(model: Model, work: WorkSpace, n: int, most: int) -> int:
    """At how many of so many steps from n on the light's ramp is as it was at the last evaluation."""
    for k in range(most if model.lit else 0):
        if gain_at(model, (n + k - model.release) * model.dt) != work.gain[0]:
            return k
    return most


@uncounted()
def _take_at_once(model: Model, state: State, work: WorkSpace, most: int, deepest: int) -> int:
    """At most so many whole steps on two copies of the nodes, up to `deepest` at once; how many.

    It ends early where an element may fail. −1 if that is within steps at once, of which none can be undone.
    """
    space, gain, half = work.stencil, work.gain[0], 0.5 * model.dt if model.integrator == VERLET else 0.0
    times, impulse = StepTimes(True, half, model.dt - half, model.dt, gain / 3.0), state.impulse
    before, done, levels = (impulse[0], impulse[1], impulse[2]), 0, 1
    scatter(model.stencil.place, state.x, space.scratch.x[0])
    scatter(model.stencil.place, state.v, space.scratch.v[0])
    while done < most:
        # Where an element is about to fail it often does so at the first step
        levels = min(levels, deepest, most - done)
        if sweep_all(model.stencil, space, done % 2, times, levels) > 0:
            clear(space.scratch, 1 - done % 2)
            if levels == 1:
                return done
            clear(space.scratch, done % 2)
            impulse[0], impulse[1], impulse[2] = before
            return -1
        for level in range(levels if gain > 0.0 else 0):
            add_up(space.scratch.sums[level], work.effects.light.total)
            add_impulse(gain, work.effects.light.total, times.close, impulse)
            add_impulse(gain, work.effects.light.total, times.open, impulse)
        done, levels = done + levels, 2 * levels
    return done


@standalone(_nrt=False)
def take_free_steps(model: Model, state: State, work: WorkSpace, n: int, most: int) -> int:
    """From nodes that have just moved to step n on: at most so many whole steps; how many.

    It ends early where the light's ramp changes or an element may fail.
    """
    most, deepest = _steady(model, work, n, most), work.stencil.scratch.sums.shape[0]
    done = -1 if most > 0 else 0
    while done < 0:
        done, deepest = _take_at_once(model, state, work, most, deepest), 1
    if done > 0:
        gather(model.stencil.place, work.stencil.scratch.x[done % 2], state.x)
        gather(model.stencil.place, work.stencil.scratch.v[done % 2], state.v)
    return done
