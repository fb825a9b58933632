"""From materials whose properties change with temperature to the curves that the kernels follow."""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.membrane.effects.properties import Curve, Curves
from dynamics.membrane.lattice import cotangents, membrane_thickness, per_triangle
from dynamics.membrane.plan import Effect
from dynamics.sail.mesh import Mesh
from dynamics.scene.materials import Changing, Material
from dynamics.scene.schema import Scene

NONE = Curve(np.empty(0, np.int64), np.zeros(1, np.int64), np.empty(0), np.empty(0), np.empty(0))


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
) -> Curve:
    """Curves of a sum of properties; none if the effect is off or no material changes in them.

    only_changing: triangles of a material that doesn't change have no curve, not one of a single knot.
    """
    materials = [region.properties for region in scene.sail.regions]
    changing = [any(name in m.with_temperature for name in names) for m in materials]
    if not on or not any(changing):
        return NONE
    pairs = [knots(m, names) for m in materials]
    starts = np.cumsum([0, *(kelvin.size for kelvin, _ in pairs)])
    numbers = [k if c or not only_changing else -1 for k, c in enumerate(changing)]
    return Curve(
        np.array(numbers)[mesh.sector], starts, np.concatenate([kelvin for kelvin, _ in pairs]),
        np.concatenate([value for _, value in pairs]), np.ascontiguousarray(weight),
    )


def _of_tables(scene: Scene, curve: Curve) -> Curve:
    """Absorptances where a table's count: minus the factor by which they change from 300 K, as in `optical.Light`.

    Both grow with the extinction of the material, which is small. InputError where there is nothing to grow from.
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


def build_curves(scene: Scene, mesh: Mesh, effects: dict[str, Effect], warm: bool) -> Curves:
    """The curves of a scene's sail; InputError where a scheme that knows no change with temperature is asked for."""
    sail, flight = scene.sail, scene.flight
    thickness = membrane_thickness(sail, mesh)
    absorbs = effects["absorption"].on and effects["light"].on
    absorption = _curve(absorbs, scene, mesh, ("absorptance",), np.ones(len(mesh.sector)), True)
    expands = effects["expansion"].on and flight.expansion_1_K is None
    expansion = _curve(expands, scene, mesh, ("expansion_1_K",), np.ones(len(mesh.sector)), True)
    conduction = _curve(
        effects["conduction"].on, scene, mesh, ("conductivity_W_mK",),
        (0.5 * cotangents(mesh) * thickness[:, None]).ravel(), False,
    )
    for curve, key, needed in (
        (expansion, "stiffness", "triangles"), (conduction, "conductance", "cotangent"),
    ):
        if curve.region.size and getattr(flight, key) != needed:
            raise InputError(
                f"{scene.name}.yaml: flight.{key} = '{getattr(flight, key)}': must be '{needed}' for a material that "
                "changes with temperature"
            )
    return Curves(
        emission=_curve(
            effects["emission"].on, scene, mesh, ("emissivity_front", "emissivity_back"),
            np.full(len(mesh.sector), flight.stefan_boltzmann / 3.0), False,
        ),
        absorption=_of_tables(scene, absorption) if absorption.region.size else absorption,
        conduction=conduction,
        capacity=_curve(
            warm, scene, mesh, ("heat_capacity_J_kgK",), per_triangle(sail, mesh, "areal_mass") * mesh.areas, False,
        ),
        expansion=expansion, rate=flight.thermal_rate,
        sides=mesh.triangle_edges if conduction.region.size else mesh.triangle_edges[:0],
    )
