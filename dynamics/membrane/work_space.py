"""State at the start of a flight, and the work arrays of its kernels. An effect that is off gets no arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamrider.arrays import Floats
from dynamics.membrane.arrays import Model, Work
from dynamics.membrane.bodies import mounted
from dynamics.membrane.build import Membrane
from dynamics.membrane.effects import damping, reflections, sheet, tearing, tethers, thermal
from dynamics.membrane.effects import light_pressure as optical
from dynamics.membrane.row_layout import scratch_space, stencil_work
from dynamics.membrane.stepping import integrators
from dynamics.membrane.stepping.step import lay_out

#: Shares of the conductance of a sail that is never torn.
NONE = np.empty((0, 3))
#: Triangles of a patch, which then fits into the first cache.
PATCH = 256


def initial_state(membrane: Membrane) -> integrators.State:
    """At rest, centred or as it is mounted, at the start temperature."""
    x = mounted(membrane.scene, membrane.model.rest)
    start = np.full(x.shape[1], membrane.scene.flight.start_temperature_K)
    return integrators.State(x, np.zeros_like(x), start if membrane.model.warm else start[:0], np.zeros(3))


def _own(values: Any, changes: bool) -> Any:
    """Arrays to be changed in flight: copies, or, where nothing changes them, the model's own."""
    return values.copy() if changes else values


def _light_work(absorptance: Floats, changes: bool) -> optical.LightWork:
    """Work space for triangles of an absorptance (t,), which is empty where there is no light; does it change."""
    t = absorptance.size
    return optical.LightWork(
        incident=np.zeros(t), absorbed=np.zeros(t), outside=np.zeros(3, np.int64), direction=np.zeros(2),
        total=np.zeros(3), absorptance=_own(absorptance, changes),
    )


def _mirror_work(mirror: reflections.Mirror) -> reflections.MirrorWork:
    """Work space for tracing rays; next to nothing where that is off."""
    t, leaves = mirror.kind.size, mirror.tree.bounds.size - 1
    return reflections.MirrorWork(
        boxes=np.zeros((2 * leaves - 1 if t else 0, 6)), force=np.zeros((3, t)), heat=np.zeros(t),
        stack=np.zeros(64 if t else 0, np.int64), ray=np.zeros((3, 3)),
        field=np.zeros((2, 3)), first=np.zeros((2, 3)), account=np.zeros(8),
    )


def _tether_work(lines: tethers.Tethers) -> tethers.TetherWork:
    """Work space for masses on tethers, at rest where they start."""
    b, k = lines.mass.size, lines.body.size
    v, acceleration, force = np.zeros((3, 3, b))
    return tethers.TetherWork(
        lines.start.copy(), v, acceleration, force, tension=np.zeros(k), snapped=np.zeros(k, np.int64)
    )


def _broken(model: Model, on_failure: str, shares: Floats) -> tearing.Broken:
    """Nothing failed yet; shares (t, 3): of the conductance."""
    size = model.triangles.masses.size
    failed, gone = (size if on_failure != "stop" else 0), (size if on_failure == "remove" else 0)
    conducts = gone > 0 and model.heat.conductance.size > 0 and model.curves.conduction.region.size == 0
    return tearing.Broken(
        np.zeros(failed, np.int64), np.zeros(gone, np.int64), np.zeros(4, np.int64), np.zeros(4),
        shares.T.ravel() if conducts else np.empty(0),
    )


def work_space(
    model: Model, on_failure: str = "stop", shares: Floats = NONE, threads: int = 1
) -> Work:
    """Work arrays for a model; those of effects that are off, and of rk4 where it is not used, are empty.

    shares (t, 3): what each triangle gives its sides of their conductance in W/K; only needed to 'remove' triangles.
    """
    n, m, t = model.masses.size, model.springs.start.size, model.triangles.masses.size
    stages = n if model.integrator == integrators.RK4 else 0
    fails, tears, curves = on_failure != "stop", on_failure == "remove", model.curves
    heat = thermal.HeatWork(
        rate=np.zeros(n if model.warm else 0),
        emission=_own(model.heat.emission, tears or curves.emission.region.size > 0),
        conductance=_own(model.heat.conductance, tears or curves.conduction.region.size > 0),
        per_capacity=_own(model.heat.per_capacity, curves.capacity.region.size > 0),
    )
    elastic_sheet = sheet.SheetWork(
        modulus=_own(model.sheet.modulus, tears), shear=_own(model.sheet.shear, tears),
        limit=_own(model.sheet.limit, fails),
    )
    traced = model.mirror.kind.size > 0
    patch = t if traced else min(t, PATCH)
    damped = model.retardation.size > 0
    viscous = damping.DampingWork(
        pull=np.zeros((3, 2 * m + 1 if damped else 0)), rate=np.zeros(m if damped else 0),
        tension=np.zeros(3 * t + 1 if damped else 0),
        force=np.zeros((3, n if damped else 0)),
    )
    work = Work(
        free=model.springs.rest[: model.springs.stiffness.size].copy(), sheet=elastic_sheet,
        stencil=stencil_work(
            model.stencil, model.springs, model.sheet, model.lit,
            scratch_space(model.stencil, model.lit, patch, 1 if traced else threads, threads),
        ), damping=viscous,
        acceleration=np.zeros((3, n)),
        light=_light_work(model.light.absorptance, curves.absorption.region.size > 0),
        mirror=_mirror_work(model.mirror), broken=_broken(model, on_failure, shares), heat=heat,
        tethers=_tether_work(model.tethers),
        flags=np.zeros(2, np.int64), gain=np.zeros(1),
        ahead=np.zeros((3, n if model.lit else 0)),
        stage=integrators.Stage(*np.zeros((4, 3, stages)), *np.zeros((2, stages if model.warm else 0))),
    )
    lay_out(model, work)
    return work
