"""An effect for tests: a uniform drag −γ m v on every node, and the power that it takes."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, starts
from dynamics.membrane.state import State
from dynamics.scene.schema import Scene

NAME = "drag"
COST = "a pass over all nodes in each step; steps are taken one at a time"
COLUMNS = {"drag_force": (3, "N"), "drag_power": (1, "W")}
_FORCE, _POWER = starts(COLUMNS)
#: γ in 1/s, of sails that are not named calm.
RATE = 200.0


def _decide(scene: Scene, so_far: Plan) -> Decision:
    return Decision(on=scene.name != "calm", reason="air around the sail")


PLAN = {"drag": _decide}


class Drag(NamedTuple):
    """rate (n,): γ in 1/s of each node; empty where it is off."""

    rate: Floats


class DragWork(NamedTuple):
    """power (1,): in W, at the latest evaluation."""

    power: Floats


def build(setup: Setup) -> Drag:
    """The same rate for all nodes."""
    return Drag(np.full(len(setup.mesh.nodes) if setup.on("drag") else 0, RATE))


def work(model: Model) -> DragWork:
    """Nothing yet."""
    return DragWork(np.zeros(1 if model.effects.drag.rate.size else 0))


@hook
def acts_each_step(model: Model) -> bool:
    """It depends on velocities."""
    return model.effects.drag.rate.size > 0


@hook
def accelerate(model: Model, work: WorkSpace, x: Floats, v: Floats, t: float) -> None:
    """Add −γ v."""
    if model.effects.drag.rate.size > 0:
        work.effects.drag.power[0] = brake(model.effects.drag.rate, model.masses, v, work.acceleration)


@numba.njit(cache=True)
def brake(rate: Floats, masses: Floats, v: Floats, acceleration: Floats) -> float:
    """Add −γ v to acceleration (3, n); the power in W that it takes."""
    power = 0.0
    for c in range(3):
        for i in range(rate.size):
            acceleration[c, i] -= rate[i] * v[c, i]
            power += masses[i] * rate[i] * v[c, i] * v[c, i]
    return power


@hook
def write(model: Model, work: WorkSpace, state: State, centre: Floats, row: Floats) -> None:
    """Total force and power."""
    for i in range(model.effects.drag.rate.size):
        for c in range(3):
            row[_FORCE + c] -= model.effects.drag.rate[i] * model.masses[i] * state.v[c, i]
        row[_POWER] = work.effects.drag.power[0]
