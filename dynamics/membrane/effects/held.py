"""Sails that are held: springs to where nodes are at rest, gravity, shaking of the holder, drag of the surroundings.

Nodes that are held fast have no place here: their mass counts as infinite wherever forces are divided by it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.bodies import inertial, mounted
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, only_if, unsigned
from dynamics.sail.held import area_slopes, supports
from dynamics.scene.schema import Scene

NAME = "held"
COST = "a pass over all nodes in each step; steps are taken one at a time, but where nodes are held fast and no more"


def _held(scene: Scene, so_far: Plan) -> Decision:
    return Decision(on=scene.held is not None, reason="held in the scene" if scene.held else "nothing holds the sail")


PLAN = {"held": _held}


class Holder(NamedTuple):
    """What acts on the nodes of a held sail; acts: does anything.

    nodes (s,) on springs of `stiffness` (s,) in N/m with their ends at `anchor` (3, s) in m, under a constant pull
    (3, s) in N. gravity (3,) in m/s²; shaking (3,): amplitude of the holder's acceleration in m/s², of `rate` in rad/s
    and `phase` in rad. drag in 1/s. per_mass (n,) in 1/kg, 0 for nodes that are held fast; empty where it does not act.
    """

    acts: bool
    nodes: Indices
    stiffness: Floats
    anchor: Floats
    pull: Floats
    gravity: Floats
    shaking: Floats
    rate: float
    phase: float
    drag: float
    per_mass: Floats


def build(setup: Setup) -> Holder:
    """The holder of a scene; nothing where that is off."""
    scene, mesh, masses = setup.scene, setup.mesh, setup.lattice.masses
    held, none, empty = scene.holding, np.zeros(3), np.empty((3, 0))
    if held is None:
        nobody = np.empty(0)
        return Holder(False, np.empty(0, np.uint32), nobody, empty, empty, none, none, 0.0, 0.0, 0.0, nobody)
    found, shaking = supports(held, mesh), held.shaking
    nodes, gravity = found.sprung, np.array(held.gravity_m_s2)
    pull = np.zeros((3, nodes.size))
    if held.tension_N_m > 0.0:
        pull[:, found.rim > 0.0] = held.tension_N_m * area_slopes(mesh)[nodes[found.rim > 0.0]].T
    acts = bool(nodes.size or gravity.any() or shaking or held.drag_1_s)
    ends = mesh.nodes[nodes] - masses @ mesh.nodes / masses.sum()
    return Holder(
        acts=acts,
        nodes=unsigned(nodes),
        stiffness=found.stiffness,
        anchor=np.ascontiguousarray(mounted(scene, ends.T)),
        pull=np.ascontiguousarray(mounted(scene, pull) - mounted(scene, np.zeros((3, 1)))),
        gravity=gravity,
        shaking=np.array(shaking.acceleration_m_s2) if shaking else none,
        rate=2.0 * math.pi * shaking.frequency_Hz if shaking else 0.0,
        phase=math.radians(shaking.phase_deg) if shaking else 0.0,
        drag=held.drag_1_s,
        per_mass=only_if(acts, 1.0 / inertial(scene, mesh, masses)),
    )


@hook
def acts_each_step(model: Model) -> bool:
    """Its forces depend on velocities and time, which no sweep over rows knows."""
    return model.effects.held.acts


@hook
def accelerate(model: Model, work: WorkSpace, x: Floats, v: Floats, t: float) -> None:
    """Add what the holder does."""
    if model.effects.held.acts:
        hold(model.effects.held, x, v, t, work.acceleration)


@numba.njit(cache=True, error_model="numpy")
def field(holder: Holder, t: float, c: int) -> float:
    """Acceleration in m/s² along axis c at time t in s of what is free, in the holder's frame; no shaking for t < 0."""
    shaken = holder.shaking[c] * math.sin(holder.rate * t + holder.phase) if t >= 0.0 else 0.0
    return holder.gravity[c] - shaken


@standalone()
def hold(holder: Holder, x: Floats, v: Floats, t: float, acceleration: Floats) -> None:
    """Add what the holder does at time t in s to nodes x, v (3, n) to acceleration (3, n) in m/s²."""
    per_mass = holder.per_mass
    for c in range(3):
        everywhere = field(holder, t, c)
        for i in range(per_mass.size):
            if per_mass[i] > 0.0:
                acceleration[c, i] += everywhere - holder.drag * v[c, i]
        for k in range(holder.nodes.size):
            i = holder.nodes[k]
            force = holder.pull[c, k] - holder.stiffness[k] * (x[c, i] - holder.anchor[c, k])
            acceleration[c, i] += force * per_mass[i]
