"""Heat of the nodes: absorbed light, emission from both faces, conduction along the edges."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from dynamics.kernels.elastic import Floats, Indices, Springs, difference, negate
from dynamics.kernels.triangles import node_sum, weighted_areas


class Heat(NamedTuple):
    """Heat links of the lattice; what is off has no array.

    per_capacity (n,): thermal rate factor over heat capacity, K/J. absorbs: is the absorbed light counted. emission
    (t,): one third of σ_SB (ε_front + ε_back), W/(m² K⁴); background: T_bg⁴ in K⁴. conductance (e,) in W/K. limit (e,):
    failure temperature of the edges in K, lowest: the lowest of them. every: steps between updates.
    """

    per_capacity: Floats
    absorbs: bool
    emission: Floats
    background: float
    conductance: Floats
    limit: Floats
    lowest: float
    every: int


class HeatWork(NamedTuple):
    """Work space: rate (n,) in K/s, emitting (t + 1,): emission × current area, flow (2e + 1,) in W; last entries 0.

    emission (t,), conductance (e,): those of the sail as it is now, without what has been removed.
    per_capacity (n,): nodes keep the heat capacity that they had.
    """

    rate: Floats
    emitting: Floats
    flow: Floats
    emission: Floats
    conductance: Floats
    per_capacity: Floats


@numba.njit(cache=True, error_model="numpy")
def _absorb(slots: Indices, absorbed: Floats, gain: float, rate: Floats) -> None:
    """One third of the power absorbed in each triangle to each corner."""
    for i in range(rate.size):
        rate[i] += node_sum(slots, absorbed, i) * gain / 3.0


@numba.njit(cache=True, error_model="numpy")
def _emit(
    emission: Floats, emitting: Floats, sides: Floats, slots: Indices, temperature: Floats, background: float,
    rate: Floats,
) -> None:
    """Stefan–Boltzmann emission σ (ε_f + ε_b) A (T⁴ − T_bg⁴) with one third of the current areas at each node."""
    weighted_areas(sides, emission, emitting)
    for i in range(rate.size):
        square = temperature[i] * temperature[i]
        rate[i] -= node_sum(slots, emitting, i) * (square * square - background)


@numba.njit(cache=True, error_model="numpy")
def _conduct(conductance: Floats, springs: Springs, temperature: Floats, flow: Floats, rate: Floats) -> None:
    """Flow G (T_b − T_a) along each edge into its start, and out of its end."""
    difference(temperature, springs.start, springs.end, flow)
    for e in range(conductance.size):
        flow[e] *= conductance[e]
    negate(flow, conductance.size)
    for i in range(rate.size):
        rate[i] += node_sum(springs.slots, flow, i)


@numba.njit(cache=True, error_model="numpy")
def rates(
    heat: Heat, work: HeatWork, springs: Springs, slots: Indices, sides: Floats, temperature: Floats,
    absorbed: Floats, gain: float,
) -> None:
    """work.rate (n,) in K/s of nodes at `temperature` (n,).

    slots (d, n): triangles at each node; sides (6, t): of the triangles now; absorbed (t + 1,) in W at full ramp.
    """
    for i in range(work.rate.size):
        work.rate[i] = 0.0
    if heat.absorbs and gain > 0.0:
        _absorb(slots, absorbed, gain, work.rate)
    if heat.emission.size > 0:
        _emit(work.emission, work.emitting, sides, slots, temperature, heat.background, work.rate)
    if heat.conductance.size > 0:
        _conduct(work.conductance, springs, temperature, work.flow, work.rate)
    for i in range(work.rate.size):
        work.rate[i] *= work.per_capacity[i]


@numba.njit(cache=True, error_model="numpy")
def hottest(temperature: Floats) -> float:
    """Largest value of temperature (n,); NaN if one of them is NaN."""
    largest = -np.inf
    for i in range(temperature.size):
        if not temperature[i] <= largest:
            largest = temperature[i]
    return largest


@numba.njit(cache=True, error_model="numpy")
def radiated(emitting: Floats, slots: Indices, temperature: Floats, background: float) -> float:
    """Net power in W that the sail emits, with the areas of the latest heat update."""
    power = 0.0
    if emitting.size > 0:
        for i in range(temperature.size):
            power += node_sum(slots, emitting, i) * (temperature[i] ** 4 - background)
    return power
