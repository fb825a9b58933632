"""Damping of the material, after Kelvin and Voigt: stress = stiffness · (strain + τ · rate of strain).

The Green strain of a triangle is linear in its squared sides q, so the viscous part of its forces follows from τ dq/dt
as the elastic part does from the excess of q (see `sheet`). Forces act along the sides: momentum and angular momentum
stay as they are, and a sail that only turns is not braked.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.bodies import inertial
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, only_if
from dynamics.membrane.effects.sheet import Sheet, SheetWork
from dynamics.membrane.effects.springs import Springs, collect, negate, separations
from dynamics.membrane.lattice import per_triangle
from dynamics.scene.schema import Scene

NAME = "damping"
COST = "passes over all edges, triangles and nodes in each step; steps are taken one at a time and are shorter"


def _damping(scene: Scene, so_far: Plan) -> Decision:
    damps = any(region.properties.damping_s > 0 for region in scene.sail.regions)
    return Decision(on=damps, reason="a material with damping" if damps else "no material has damping")


PLAN = {"damping": _damping}


class Damping(NamedTuple):
    """time (t,): retardation time τ in s of the triangles; per_mass (n,) in 1/kg, 0 for nodes that are held fast.

    Empty where it is off.
    """

    time: Floats
    per_mass: Floats


class DampingWork(NamedTuple):
    """Work space: pull (3, 2e + 1), whose last column stays 0, rate (e,) in m²/s, tension (3t + 1,) in N/m, last 0.

    force (3, n): the sum at the nodes in N.
    """

    pull: Floats
    rate: Floats
    tension: Floats
    force: Floats


def build(setup: Setup) -> Damping:
    """Retardation times of the materials."""
    on, scene, mesh = setup.on("damping"), setup.scene, setup.mesh
    return Damping(
        time=only_if(on, per_triangle(scene.sail, mesh, "damping_s")),
        per_mass=only_if(on, 1.0 / inertial(scene, mesh, setup.lattice.masses)),
    )


def work(model: Model) -> DampingWork:
    """Zeros, or nothing where it is off."""
    t, n = model.effects.damping.time.size, model.effects.damping.per_mass.size
    m = model.effects.springs.start.size if t else 0
    return DampingWork(
        pull=np.zeros((3, 2 * m + 1 if t else 0)),
        rate=np.zeros(m),
        tension=np.zeros(3 * t + 1 if t else 0),
        force=np.zeros((3, n)),
    )


@hook
def acts_each_step(model: Model) -> bool:
    """Its forces depend on velocities, which no sweep over rows knows."""
    return model.effects.damping.time.size > 0


@hook
def accelerate(model: Model, work: WorkSpace, x: Floats, v: Floats, t: float) -> None:
    """Add what the triangles resist their motion with."""
    if model.effects.damping.time.size > 0:
        resist(
            model.effects.damping,
            model.effects.sheet,
            work.effects.sheet,
            model.effects.springs,
            work.effects.damping,
            x,
            v,
            work.acceleration,
        )


@numba.njit(cache=True, error_model="numpy")
def _rates(springs: Springs, v: Floats, pull: Floats, rate: Floats) -> None:
    """Rates (e,) 2 d·(v_b − v_a) of the squared lengths of edges with vectors pull[:, :e], nodes moving at v (3, n)."""
    for e in range(rate.size):
        a, b = springs.start[e], springs.end[e]
        rate[e] = 2.0 * (
            pull[0, e] * (v[0, b] - v[0, a]) + pull[1, e] * (v[1, b] - v[1, a]) + pull[2, e] * (v[2, b] - v[2, a])
        )


@numba.njit(cache=True, error_model="numpy")
def _tighten(tau: Floats, sheet: Sheet, modulus: Floats, shear: Floats, rate: Floats, tension: Floats) -> None:
    """Viscous tension (3t,) of the sides of all triangles."""
    t, c, sides = tau.size, sheet.cotangent, sheet.sides
    for i in range(t):
        p, q, s = tau[i] * rate[sides[i]], tau[i] * rate[sides[t + i]], tau[i] * rate[sides[2 * t + i]]
        trace, half = modulus[i] * (c[i] * p + c[t + i] * q + c[2 * t + i] * s), 0.5 * (p + q + s)
        tension[i] = c[i] * trace - shear[i] * (half - p)
        tension[t + i] = c[t + i] * trace - shear[i] * (half - q)
        tension[2 * t + i] = c[2 * t + i] * trace - shear[i] * (half - s)


@standalone()
def resist(
    damping: Damping,
    sheet: Sheet,
    elastic: SheetWork,
    springs: Springs,
    work: DampingWork,
    x: Floats,
    v: Floats,
    acceleration: Floats,
) -> None:
    """Add to acceleration (3, n) in m/s² what triangles with nodes x resist the motion v (3, n) with."""
    separations(x, springs.start, springs.end, work.pull)
    _rates(springs, v, work.pull, work.rate)
    _tighten(damping.time, sheet, elastic.modulus, elastic.shear, work.rate, work.tension)
    size = work.rate.size
    first, second = sheet.slots[0], sheet.slots[1]
    for c in range(3):
        for e in range(size):
            work.pull[c, e] *= work.tension[first[e]] + work.tension[second[e]]
        negate(work.pull[c], size)
    collect(work.pull, springs.slots, work.force)
    for c in range(3):
        for i in range(damping.per_mass.size):
            acceleration[c, i] += work.force[c, i] * damping.per_mass[i]
