"""State at the start of a flight, and the work arrays of its model. An effect that is off gets no arrays."""

from __future__ import annotations

import numpy as np

from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.bodies import mounted
from dynamics.membrane.build import Membrane
from dynamics.membrane.effects.composition import work_all
from dynamics.membrane.row_layout import scratch_space, stencil_work
from dynamics.membrane.state import Stage, State
from dynamics.membrane.stepping import integrators
from dynamics.membrane.stepping.step import lay_out

#: Triangles of a patch, which then fits into the first cache.
PATCH = 256


def initial_state(membrane: Membrane) -> State:
    """At rest, centred or as it is mounted, at the start temperature."""
    x = mounted(membrane.scene, membrane.model.rest)
    start = np.full(x.shape[1], membrane.scene.flight.start_temperature_K)
    return State(x, np.zeros_like(x), start if membrane.model.warm else start[:0], np.zeros(3))


def work_space(model: Model, threads: int = 1) -> WorkSpace:
    """Work arrays for a model; those of effects that are off, and of rk4 where it is not used, are empty."""
    n, t, effects = model.masses.size, model.triangles.masses.size, model.effects
    stages = n if model.integrator == integrators.RK4 else 0
    traced = effects.reflections.kind.size > 0
    patch = t if traced else min(t, PATCH)
    work = WorkSpace(
        stencil=stencil_work(
            model.stencil,
            effects.springs,
            effects.sheet,
            model.lit,
            scratch_space(model.stencil, model.lit, patch, 1 if traced else threads, threads),
        ),
        acceleration=np.zeros((3, n)),
        flags=np.zeros(2, np.int64),
        gain=np.zeros(1),
        ahead=np.zeros((3, n if model.lit else 0)),
        stage=Stage(*np.zeros((4, 3, stages)), *np.zeros((2, stages if model.warm else 0))),
        effects=work_all(model),
    )
    lay_out(model, work)
    return work
