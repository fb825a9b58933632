"""Properties that change with temperature: emissivity, absorptance, conductivity, heat capacity, expansion.

Only materials that give tables have curves here; with no curve nothing is computed, and the numbers of the sail stay
those of the model. A triangle has the temperature of the mean of its corners.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices, Integers
from beamrider.io.files import InputError
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects.interface import Setup, hook
from dynamics.membrane.effects.sheet import Sheet
from dynamics.membrane.effects.springs import REFERENCE_TEMPERATURE
from dynamics.membrane.lattice import cotangents, membrane_thickness, per_triangle
from dynamics.membrane.layout.rows import Stencil
from dynamics.sail.mesh import Mesh
from dynamics.scene.materials import Changing, Material
from dynamics.scene.schema import Scene

NAME = "properties"
COST = "a pass over all triangles for each changing property whenever temperatures change"


class PropertyCurve(NamedTuple):
    """One property of the triangles, linear between knots and constant beyond them; no arrays where nothing changes.

    region (t,): which curve is a triangle's, −1 for none. starts (k + 1,): where each curve begins in kelvin and value
    (m,). weight (t,): what the value is multiplied by; of conduction (3t,), for the sides 01, 12, 20 of each triangle.
    """

    region: Integers
    starts: Integers
    kelvin: Floats
    value: Floats
    weight: Floats


class PropertyCurves(NamedTuple):
    """The curves of a sail: emission in W/(m² K⁴), absorptance, conductance in W/K, capacity in J/K, expansion in 1/K.

    rate: factor on the speed of all heating. sides (t, 3): the edges of the triangles.
    """

    emission: PropertyCurve
    absorption: PropertyCurve
    conduction: PropertyCurve
    capacity: PropertyCurve
    expansion: PropertyCurve
    rate: float
    sides: Integers


NONE = PropertyCurve(np.empty(0, np.int64), np.zeros(1, np.int64), np.empty(0), np.empty(0), np.empty(0))


def knots(material: Material, names: tuple[Changing, ...]) -> tuple[Floats, Floats]:
    """Temperatures (m,) in K and values (m,) of the sum of a material's properties; one knot where none changes."""
    given = [material.with_temperature[name] for name in names if name in material.with_temperature]
    kelvin = np.unique([row[0] for table in given for row in table]) if given else np.array([300.0])
    total = np.zeros(kelvin.size)
    for name in names:
        table = np.array(material.with_temperature.get(name, [[300.0, getattr(material, name)]]))
        total += np.interp(kelvin, table[:, 0], table[:, 1])
    return kelvin, total


def _curve(
    on: bool, scene: Scene, mesh: Mesh, names: tuple[Changing, ...], weight: Floats, only_changing: bool
) -> PropertyCurve:
    """PropertyCurves of a sum of properties; none if the effect is off or no material changes in them.

    only_changing: triangles of a material that doesn't change have no curve, not one of a single knot.
    """
    materials = [region.properties for region in scene.sail.regions]
    changing = [any(name in m.with_temperature for name in names) for m in materials]
    if not on or not any(changing):
        return NONE
    pairs = [knots(m, names) for m in materials]
    starts = np.cumsum([0, *(kelvin.size for kelvin, _ in pairs)])
    numbers = [k if c or not only_changing else -1 for k, c in enumerate(changing)]
    return PropertyCurve(
        np.array(numbers)[mesh.sector],
        starts,
        np.concatenate([kelvin for kelvin, _ in pairs]),
        np.concatenate([value for _, value in pairs]),
        np.ascontiguousarray(weight),
    )


def _of_tables(scene: Scene, curve: PropertyCurve) -> PropertyCurve:
    """Absorptances where a table's count: minus the factor by which they change from 300 K.

    As in `LightPressure`. Both grow with the extinction of the material, which is small. InputError where there is
    nothing to grow from.
    """
    value = curve.value.copy()
    for k, region in enumerate(scene.sail.regions):
        plain, own = region.properties.absorptance, slice(curve.starts[k], curve.starts[k + 1])
        if scene.tabled(region) and "absorptance" in region.properties.with_temperature:
            if plain == 0.0:
                raise InputError(
                    f"{scene.name}.yaml: sail: region {k}: material.absorptance = 0: must be above 0, as its table of "
                    "temperatures tells by what factor the absorptance of the design changes"
                )
            value[own] = -value[own] / plain
    return curve._replace(value=value)


def build(setup: Setup) -> PropertyCurves:
    """The curves of a scene's sail; InputError where a scheme that knows no change with temperature is asked for."""
    scene, mesh, sail, flight = setup.scene, setup.mesh, setup.scene.sail, setup.scene.flight
    thickness = membrane_thickness(sail, mesh)
    absorbs = setup.on("absorption") and setup.on("light")
    absorption = _curve(absorbs, scene, mesh, ("absorptance",), np.ones(len(mesh.sector)), True)
    expands = setup.on("expansion") and flight.expansion_1_K is None
    expansion = _curve(expands, scene, mesh, ("expansion_1_K",), np.ones(len(mesh.sector)), True)
    conduction = _curve(
        setup.on("conduction"),
        scene,
        mesh,
        ("conductivity_W_mK",),
        (0.5 * cotangents(mesh) * thickness[:, None]).ravel(),
        False,
    )
    for curve, key, needed in (
        (expansion, "stiffness", "triangles"),
        (conduction, "conductance", "cotangent"),
    ):
        if curve.region.size and getattr(flight, key) != needed:
            raise InputError(
                f"{scene.name}.yaml: flight.{key} = '{getattr(flight, key)}': must be '{needed}' for a material that "
                "changes with temperature"
            )
    return PropertyCurves(
        emission=_curve(
            setup.on("emission"),
            scene,
            mesh,
            ("emissivity_front", "emissivity_back"),
            np.full(len(mesh.sector), flight.stefan_boltzmann / 3.0),
            False,
        ),
        absorption=_of_tables(scene, absorption) if absorption.region.size else absorption,
        conduction=conduction,
        capacity=_curve(
            setup.warm,
            scene,
            mesh,
            ("heat_capacity_J_kgK",),
            per_triangle(sail, mesh, "areal_mass") * mesh.areas,
            False,
        ),
        expansion=expansion,
        rate=flight.thermal_rate,
        sides=mesh.triangle_edges if conduction.region.size else mesh.triangle_edges[:0],
    )


@hook
def lengthen(model: Model, work: WorkSpace, temperature: Floats) -> None:
    """Free lengths of triangles whose expansion changes with temperature (n,)."""
    grow(
        model.effects.properties.expansion,
        model.effects.sheet,
        model.stencil,
        model.triangles.corners,
        temperature,
        work.stencil.free,
    )


@numba.njit(cache=True, inline="always")
def _mean(corners: Indices, temperature: Floats, i: int) -> float:
    return (temperature[corners[0, i]] + temperature[corners[1, i]] + temperature[corners[2, i]]) / 3.0


@numba.njit(cache=True, error_model="numpy")
def at(curve: PropertyCurve, i: int, kelvin: float) -> float:
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
def integral(curve: PropertyCurve, i: int, kelvin: float) -> float:
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
    curve: PropertyCurve, sheet: Sheet, layout: Stencil, corners: Indices, temperature: Floats, out: Floats
) -> None:
    """Squared free lengths λ²L² of triangles with a curve, λ = 1 + ∫ α dT from 300 K, to out (f, 3, p)."""
    t, free = curve.region.size, out.reshape(-1)
    for i in range(t):
        if curve.region[i] >= 0:
            stretch = 1.0 + integral(curve, i, _mean(corners, temperature, i))
            for side in range(3):
                free[layout.slots[side * t + i]] = stretch * stretch * sheet.free[side * t + i]


@numba.njit(cache=True, error_model="numpy")
def absorb(curve: PropertyCurve, corners: Indices, temperature: Floats, absorptance: Floats) -> None:
    """Absorptance (t,) of triangles with a curve."""
    for i in range(curve.region.size):
        if curve.region[i] >= 0:
            absorptance[i] = at(curve, i, _mean(corners, temperature, i))


@numba.njit(cache=True, error_model="numpy")
def _emit(curve: PropertyCurve, corners: Indices, temperature: Floats, gone: Integers, emission: Floats) -> None:
    for i in range(curve.region.size):
        left = gone.size == 0 or gone[i] == 0
        emission[i] = curve.weight[i] * at(curve, i, _mean(corners, temperature, i)) if left else 0.0


@numba.njit(cache=True, error_model="numpy")
def _conduct(
    curve: PropertyCurve, sides: Integers, corners: Indices, temperature: Floats, gone: Integers, conductance: Floats
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
def _warm(curve: PropertyCurve, rate: float, corners: Indices, temperature: Floats, per_capacity: Floats) -> None:
    """Thermal rate factor over heat capacity (n,) in K/J; a third of each triangle's capacity at each corner."""
    for n in range(per_capacity.size):
        per_capacity[n] = 0.0
    for i in range(curve.region.size):
        third = curve.weight[i] * at(curve, i, _mean(corners, temperature, i)) / 3.0
        for c in range(3):
            per_capacity[corners[c, i]] += third
    for n in range(per_capacity.size):
        per_capacity[n] = rate / per_capacity[n]


@standalone()
def update(
    curves: PropertyCurves,
    corners: Indices,
    temperature: Floats,
    gone: Integers,
    emission: Floats,
    conductance: Floats,
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
