"""Properties that change with temperature: emissivity, absorptance, conductivity, heat capacity, expansion.

Only materials that give tables have curves here; with no curve nothing is computed, and the numbers of the sail stay
those of the model. A triangle has the temperature of the mean of its corners.
"""

from __future__ import annotations

from typing import NamedTuple

import numba

from beamrider.arrays import Floats, Indices, Integers
from dynamics.membrane.effects.sheet import Sheet
from dynamics.membrane.effects.springs import REFERENCE_TEMPERATURE
from dynamics.membrane.layout.rows import Stencil


class Curve(NamedTuple):
    """One property of the triangles, linear between knots and constant beyond them; no arrays where nothing changes.

    region (t,): which curve is a triangle's, −1 for none. starts (k + 1,): where each curve begins in kelvin and value
    (m,). weight (t,): what the value is multiplied by; of conduction (3t,), for the sides 01, 12, 20 of each triangle.
    """

    region: Integers
    starts: Integers
    kelvin: Floats
    value: Floats
    weight: Floats


class Curves(NamedTuple):
    """The curves of a sail: emission in W/(m² K⁴), absorptance, conductance in W/K, capacity in J/K, expansion in 1/K.

    rate: factor on the speed of all heating. sides (t, 3): the edges of the triangles.
    """

    emission: Curve
    absorption: Curve
    conduction: Curve
    capacity: Curve
    expansion: Curve
    rate: float
    sides: Integers


@numba.njit(cache=True, inline="always")
def _mean(corners: Indices, temperature: Floats, i: int) -> float:
    return (temperature[corners[0, i]] + temperature[corners[1, i]] + temperature[corners[2, i]]) / 3.0


@numba.njit(cache=True, error_model="numpy")
def at(curve: Curve, i: int, kelvin: float) -> float:
    """Value of triangle i at a temperature in K, without its weight."""
    first, end = curve.starts[curve.region[i]], curve.starts[curve.region[i] + 1]
    k = first
    while k + 1 < end and curve.kelvin[k + 1] <= kelvin:
        k += 1
    if k + 1 == end or kelvin <= curve.kelvin[first]:
        return curve.value[k]
    share = (kelvin - curve.kelvin[k]) / (curve.kelvin[k + 1] - curve.kelvin[k])
    return curve.value[k] + share * (curve.value[k + 1] - curve.value[k])


@numba.njit(cache=True, error_model="numpy")
def integral(curve: Curve, i: int, kelvin: float) -> float:
    """Integral of triangle i's value from 300 K to a temperature in K: trapezoids between the knots are exact."""
    first, end = curve.starts[curve.region[i]], curve.starts[curve.region[i] + 1]
    low, high = min(kelvin, REFERENCE_TEMPERATURE), max(kelvin, REFERENCE_TEMPERATURE)
    total, here = 0.0, low
    for k in range(first, end + 1):
        there = high if k == end else min(max(curve.kelvin[k], low), high)
        total += 0.5 * (at(curve, i, here) + at(curve, i, there)) * (there - here)
        here = there
    return total if kelvin >= REFERENCE_TEMPERATURE else -total


@numba.njit(cache=True, error_model="numpy")
def grow(
    curve: Curve, sheet: Sheet, layout: Stencil, corners: Indices, temperature: Floats, out: Floats
) -> None:
    """Squared free lengths λ²L² of triangles with a curve, λ = 1 + ∫ α dT from 300 K, to out (f, 3, p)."""
    t, free = curve.region.size, out.reshape(-1)
    for i in range(t):
        if curve.region[i] >= 0:
            stretch = 1.0 + integral(curve, i, _mean(corners, temperature, i))
            for side in range(3):
                free[layout.slots[side * t + i]] = stretch * stretch * sheet.free[side * t + i]


@numba.njit(cache=True, error_model="numpy")
def absorb(curve: Curve, corners: Indices, temperature: Floats, absorptance: Floats) -> None:
    """Absorptance (t,) of triangles with a curve."""
    for i in range(curve.region.size):
        if curve.region[i] >= 0:
            absorptance[i] = at(curve, i, _mean(corners, temperature, i))


@numba.njit(cache=True, error_model="numpy")
def _emit(curve: Curve, corners: Indices, temperature: Floats, gone: Integers, emission: Floats) -> None:
    for i in range(curve.region.size):
        left = gone.size == 0 or gone[i] == 0
        emission[i] = curve.weight[i] * at(curve, i, _mean(corners, temperature, i)) if left else 0.0


@numba.njit(cache=True, error_model="numpy")
def _conduct(
    curve: Curve, sides: Integers, corners: Indices, temperature: Floats, gone: Integers, conductance: Floats
) -> None:
    """Conductance (e,) of all edges, the sum over their triangles; removed triangles conduct nothing any more."""
    for e in range(conductance.size):
        conductance[e] = 0.0
    for i in range(curve.region.size):
        if gone.size == 0 or gone[i] == 0:
            value = at(curve, i, _mean(corners, temperature, i))
            for side in range(3):
                conductance[sides[i, side]] += curve.weight[3 * i + side] * value


@numba.njit(cache=True, error_model="numpy")
def _warm(curve: Curve, rate: float, corners: Indices, temperature: Floats, per_capacity: Floats) -> None:
    """Thermal rate factor over heat capacity (n,) in K/J; a third of each triangle's capacity at each corner."""
    for n in range(per_capacity.size):
        per_capacity[n] = 0.0
    for i in range(curve.region.size):
        third = curve.weight[i] * at(curve, i, _mean(corners, temperature, i)) / 3.0
        for c in range(3):
            per_capacity[corners[c, i]] += third
    for n in range(per_capacity.size):
        per_capacity[n] = rate / per_capacity[n]


@numba.njit(cache=True, error_model="numpy")
def update(
    curves: Curves, corners: Indices, temperature: Floats, gone: Integers, emission: Floats, conductance: Floats,
    per_capacity: Floats,
) -> None:
    """Emission (t,), conductance (e,) and per_capacity (n,) at temperature (n,), where they have curves.

    gone (t,): not 0 for removed triangles, or empty.
    """
    if curves.emission.region.size > 0:
        _emit(curves.emission, corners, temperature, gone, emission)
    if curves.conduction.region.size > 0:
        _conduct(curves.conduction, curves.sides, corners, temperature, gone, conductance)
    if curves.capacity.region.size > 0:
        _warm(curves.capacity, curves.rate, corners, temperature, per_capacity)
