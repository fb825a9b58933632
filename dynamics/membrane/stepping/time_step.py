"""What damping and heat ask of the time step of a flexible flight."""

from __future__ import annotations

import math

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.membrane.effects import thermal
from dynamics.membrane.effects.interface import Plan
from dynamics.membrane.lattice import per_triangle
from dynamics.sail.mesh import Mesh
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable


def retardation(scene: Scene) -> float:
    """Longest retardation time in s of the materials; InputError where their viscous forces are not computed."""
    flight = scene.flight
    for key, allowed in (("stiffness", ("triangles",)), ("integrator", ("semi_implicit_euler", "verlet"))):
        if getattr(flight, key) not in allowed:
            raise InputError(
                f"{scene.name}.yaml: flight.{key} = '{getattr(flight, key)}': must be {' or '.join(allowed)} where a "
                "material has damping"
            )
    return max(region.properties.damping_s for region in scene.sail.regions)


def viscous_share(zeta: float) -> float:
    """Share √(1 + ζ²) − ζ of the stability bound that a damping ratio ζ leaves (Belytschko et al., §6.6).

    The viscous forces are those of the velocity half a step ago. A step Δt of a sail of stiffness K, damping C and mass
    M is stable where no eigenvalue of M⁻¹(Δt² K + 2 Δt C) exceeds 4; with those of M⁻¹K at most ω² and of M⁻¹C at most
    λ that is so up to this share of 2/ω, ζ = λ/(2ω).
    """
    return 1.0 / (math.hypot(1.0, zeta) + zeta)


def _most(pairs: list[tuple[float, float]]) -> float:
    """The largest ratio of pairs, 1 if there is none."""
    return max([1.0, *(a / b for a, b in pairs if b > 0)])


def highest_absorptances(scene: Scene, tables: dict[str, PressureTable]) -> list[float]:
    """The largest absorptance of each region, at any angle and temperature."""
    found = []
    for region in scene.sail.regions:
        own = region.properties.highest("absorptance")
        if scene.tabled(region) and region.design in tables:
            table, plain = tables[str(region.design)], region.properties.absorptance
            own = float(np.max(table.absorptance_nodes)) * (own / plain if plain > 0 else 1.0)
        found.append(own)
    return found


def hottest_possible(scene: Scene, mesh: Mesh, heat: thermal.Heat, absorptances: list[float], fails: bool) -> Floats:
    """Temperatures (t,) in K above which the triangles never get; absorptances: the highest of each region.

    Those of equilibrium with all of the light, of all of it kept since the start, of failure if that ends it: whichever
    is the lowest, but at least the temperatures of the start and of the surroundings.
    """
    flight, sail = scene.flight, scene.sail
    materials = [region.properties for region in sail.regions]
    faces = np.array([m.lowest("emissivity_front") + m.lowest("emissivity_back") for m in materials])[mesh.sector]
    light = np.zeros(len(mesh.areas))
    if heat.absorbs:
        light += scene.beam.brightest_W_m2 * np.array(absorptances)[mesh.sector]
    least = np.array([m.lowest("heat_capacity_J_kgK") for m in materials])[mesh.sector]
    capacity = per_triangle(sail, mesh, "areal_mass") * least
    kept = flight.start_temperature_K + light * flight.duration_s * flight.thermal_rate / capacity
    hottest = np.minimum(kept, (light / np.maximum(flight.stefan_boltzmann * faces, 1e-300)) ** 0.25)
    if fails:
        hottest = np.minimum(hottest, per_triangle(sail, mesh, "failure_temperature_K"))
    if heat.conductance.size:  # heat may come from hotter neighbours
        hottest = np.full_like(hottest, hottest.max())
    return np.maximum(hottest, max(flight.start_temperature_K, flight.background_temperature_K))


def check_heat(
    scene: Scene, mesh: Mesh, heat: thermal.Heat, effects: Plan, absorptances: list[float], dt: float
) -> None:
    """InputError where a node would lose its heat in less than half the time between two updates of its temperature.

    Its fastest rate is 4 Σ ε σ A T³/C at the hottest that it gets plus 2 Σ G/C (Gershgorin); explicit steps are stable
    up to twice the reciprocal.
    """
    flight, nodes, materials = scene.flight, len(mesh.nodes), [region.properties for region in scene.sail.regions]
    loss = np.zeros(nodes)
    if heat.emission.size:
        hottest = hottest_possible(scene, mesh, heat, absorptances, effects["thermal_failure"].on)
        faces = [m.highest("emissivity_front") + m.highest("emissivity_back") for m in materials]
        emission = flight.stefan_boltzmann / 3.0 * np.array(faces)[mesh.sector]
        rate = np.repeat(4.0 * emission * mesh.areas * hottest**3, 3)
        loss += np.bincount(mesh.triangles.ravel(), rate, minlength=nodes)
    if heat.conductance.size:
        conductance = np.abs(heat.conductance) * _most(
            [(m.highest("conductivity_W_mK"), m.conductivity_W_mK) for m in materials]
        )
        loss += 2.0 * np.bincount(mesh.edges.ravel(), np.repeat(conductance, 2), minlength=nodes)
    loss *= _most([(m.heat_capacity_J_kgK, m.lowest("heat_capacity_J_kgK")) for m in materials])
    if heat.per_capacity.size and (loss * heat.per_capacity).max() * flight.heat_every * dt >= 2.0:
        node = int(np.argmax(loss * heat.per_capacity))
        raise InputError(
            f"{scene.name}.yaml: flight.heat_every = {flight.heat_every}: so many steps of {dt:.3g} s must be below "
            f"{2.0 / (loss[node] * heat.per_capacity[node]):.3g} s, in which node {node} loses its heat; update more "
            "often or set time_step_s"
        )
