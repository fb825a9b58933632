"""Sails that are held: springs to where nodes are at rest, gravity, shaking of the holder, drag of the surroundings.

Nodes that are held fast have no place here: their mass counts as infinite wherever forces are divided by it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from beamrider.arrays import Floats, Indices


class Holder(NamedTuple):
    """What acts on the nodes of a held sail; acts: does anything.

    nodes (s,) on springs of `stiffness` (s,) in N/m with their ends at `anchor` (3, s) in m, under a constant pull
    (3, s) in N. gravity (3,) in m/s²; shaking (3,): amplitude of the holder's acceleration in m/s², of `rate` in rad/s
    and `phase` in rad. drag in 1/s.
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


@numba.njit(cache=True, error_model="numpy")
def field(holder: Holder, t: float, c: int) -> float:
    """Acceleration in m/s² along axis c at time t in s of what is free, in the holder's frame; no shaking for t < 0."""
    shaken = holder.shaking[c] * math.sin(holder.rate * t + holder.phase) if t >= 0.0 else 0.0
    return holder.gravity[c] - shaken


@numba.njit(cache=True, error_model="numpy")
def hold(holder: Holder, x: Floats, v: Floats, per_mass: Floats, t: float, acceleration: Floats) -> None:
    """Add what the holder does to nodes x, v (3, n) to acceleration (3, n); per_mass (n,) in 1/kg: 0 for fixed ones."""
    for c in range(3):
        everywhere = field(holder, t, c)
        for i in range(per_mass.size):
            if per_mass[i] > 0.0:
                acceleration[c, i] += everywhere - holder.drag * v[c, i]
        for k in range(holder.nodes.size):
            i = holder.nodes[k]
            force = holder.pull[c, k] - holder.stiffness[k] * (x[c, i] - holder.anchor[c, k])
            acceleration[c, i] += force * per_mass[i]
