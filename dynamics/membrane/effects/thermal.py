"""Heat of the nodes: absorbed light, emission from both faces, conduction along the edges."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices
from dynamics.membrane.effects.springs import Springs
from dynamics.membrane.layout.triangles import Patch, sides, weighted_areas


class Heat(NamedTuple):
    """Heat links of the lattice; what is off has no array.

    per_capacity (n,): thermal rate factor over heat capacity, K/J. absorbs: is the absorbed light counted. emission
    (t,): one third of σ_SB (ε_front + ε_back), W/(m² K⁴); background: T_bg⁴ in K⁴. conductance (e,) in W/K. limit (t,):
    failure temperature of the triangles in K, lowest: the lowest of them. every: steps between updates.
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
    """Work space: rate (n,) in K/s; emission (t,), conductance (e,) and per_capacity (n,) as they are now.

    The last three are the model's own arrays where nothing can change them. Of what has been removed there is neither
    emission nor conductance, but nodes keep the heat capacity that they had.
    """

    rate: Floats
    emission: Floats
    conductance: Floats
    per_capacity: Floats


@numba.njit(cache=True, error_model="numpy")
def _absorb(corners: Indices, absorbed: Floats, gain: float, rate: Floats) -> None:
    """One third of the power absorbed in each triangle to each corner."""
    c0, c1, c2 = corners[0], corners[1], corners[2]
    for i in range(absorbed.size):
        third = absorbed[i] * gain / 3.0
        rate[c0[i]] += third
        rate[c1[i]] += third
        rate[c2[i]] += third


@numba.njit(cache=True, error_model="numpy")
def _emitting(emission: Floats, x: Floats, corners: Indices, patch: Patch, begin: int) -> tuple[int, Floats]:
    """Emission × current area of the triangles from `begin` on that fill a patch: how many, and the array."""
    n, out = min(patch.sides.shape[1], emission.size - begin), patch.frame[0]
    sides(x, corners, begin, n, 0, patch.sides)
    weighted_areas(patch.sides, emission[begin : begin + n], out)
    return n, out


@numba.njit(cache=True, error_model="numpy")
def _emit(
    emission: Floats, x: Floats, corners: Indices, patch: Patch, temperature: Floats, background: float, rate: Floats
) -> None:
    """Stefan–Boltzmann emission σ (ε_f + ε_b) A (T⁴ − T_bg⁴) with one third of the current areas at each node."""
    begin = 0
    while begin < emission.size:
        n, share = _emitting(emission, x, corners, patch, begin)
        for i in range(n):
            for c in range(3):
                node = corners[c, begin + i]
                square = temperature[node] * temperature[node]
                rate[node] -= share[i] * (square * square - background)
        begin += n


@numba.njit(cache=True, error_model="numpy")
def _conduct(conductance: Floats, springs: Springs, temperature: Floats, rate: Floats) -> None:
    """Flow G (T_b − T_a) along each edge into its start, and out of its end."""
    start, end = springs.start, springs.end
    for e in range(conductance.size):
        a, b = start[e], end[e]
        flow = conductance[e] * (temperature[b] - temperature[a])
        rate[a] += flow
        rate[b] -= flow


@numba.njit(cache=True, error_model="numpy")
def rates(
    heat: Heat, work: HeatWork, springs: Springs, corners: Indices, patch: Patch, x: Floats, temperature: Floats,
    absorbed: Floats, gain: float,
) -> None:
    """work.rate (n,) in K/s of nodes x (3, n) at `temperature` (n,).

    corners (3, t): nodes of the triangles; patch: to work in; absorbed (t,) in W at full ramp.
    """
    for i in range(work.rate.size):
        work.rate[i] = 0.0
    if heat.absorbs and gain > 0.0:
        _absorb(corners, absorbed, gain, work.rate)
    if heat.emission.size > 0:
        _emit(work.emission, x, corners, patch, temperature, heat.background, work.rate)
    if heat.conductance.size > 0:
        _conduct(work.conductance, springs, temperature, work.rate)
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
def radiated(
    emission: Floats, x: Floats, corners: Indices, patch: Patch, temperature: Floats, background: float
) -> float:
    """Net power in W that the sail emits."""
    power, begin = 0.0, 0
    while begin < emission.size:
        n, share = _emitting(emission, x, corners, patch, begin)
        for i in range(n):
            for c in range(3):
                square = temperature[corners[c, begin + i]] * temperature[corners[c, begin + i]]
                power += share[i] * (square * square - background)
        begin += n
    return power
