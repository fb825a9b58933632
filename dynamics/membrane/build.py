"""From a scene and its pressure tables to the arrays that the kernels fly. An effect that is off gets no arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers
from beamrider.io.files import InputError
from dynamics.membrane import arrays as flown
from dynamics.membrane import bodies
from dynamics.membrane.effects import light_pressure as optical
from dynamics.membrane.effects import polarisation, reflections, sheet, spin, thermal, tree
from dynamics.membrane.effects import springs as elastic
from dynamics.membrane.effects.tethers import Tethers
from dynamics.membrane.lattice import (
    STABILITY,
    Lattice,
    cotangents,
    highest_frequency,
    lattice,
    per_triangle,
    sheet_matrix,
    sheet_modulus,
    stiffness_matrix,
)
from dynamics.membrane.layout import triangles
from dynamics.membrane.plan import Effect, plan
from dynamics.membrane.property_curves import build_curves
from dynamics.membrane.row_layout import layout, with_springs
from dynamics.membrane.stepping import corotating_setup as corotating
from dynamics.membrane.stepping import integrators
from dynamics.membrane.stepping.corotating import Carrier
from dynamics.membrane.stepping.time_step import check_heat, damped_share, highest_absorptances, viscous_share
from dynamics.sail.caught_light import check_light
from dynamics.sail.masses import designed
from dynamics.sail.mesh import Mesh, sail_mesh
from dynamics.sail.mesh_checks import check_mesh
from dynamics.sail.regions import directions
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable, TableArrays

Plan = dict[str, Effect]

#: Share of the stability bound that is taken as time step when the scene gives none; tension stiffens a spinning sail.
MARGIN = 0.8
INTEGRATORS = {
    "semi_implicit_euler": integrators.SEMI_IMPLICIT_EULER, "verlet": integrators.VERLET, "rk4": integrators.RK4,
    "corotating": integrators.VERLET,
}


@dataclass(frozen=True)
class Membrane:
    """Everything a flexible flight needs: the scene and its plan, mesh and lattice, and the kernels' model.

    carrier: what the co-rotating scheme adds to it, if that flies.
    """

    scene: Scene
    effects: Plan
    mesh: Mesh
    lattice: Lattice
    model: flown.Model
    carrier: Carrier | None = None

    @property
    def elastic_triangles(self) -> bool:
        """Do triangles, not springs, carry the load."""
        return self.model.sheet.modulus.size > 0


def slots(groups: Integers, size: int, positions: Integers, empty: int) -> NDArray[np.uint32]:
    """Padded lists (d, size): for each of `size` nodes the `positions` whose entry of `groups` is that node."""
    order = np.argsort(groups, kind="stable")
    counts = np.bincount(groups, minlength=size)
    rank = np.arange(groups.size) - np.repeat(np.cumsum(counts) - counts, counts)
    table = np.full((int(counts.max()), size), empty, dtype=np.uint32)
    table[rank, groups[order]] = positions[order]
    return table


def unsigned(values: Any) -> NDArray[np.uint32]:
    """Contiguous unsigned indices: compiled code need not test them for a negative sign."""
    return np.ascontiguousarray(values, dtype=np.uint32)


def _if(on: bool, values: Any) -> Floats:
    """The values, or nothing where an effect is off."""
    return np.ascontiguousarray(values, dtype=float) if on else np.empty(0)


def _springs(mesh: Mesh, lat: Lattice, effects: Plan) -> elastic.Springs:
    m, lists = len(mesh.edges), np.empty((0, 0), np.uint32)
    if effects["damping"].on:
        lists = slots(mesh.edges.ravel(), len(mesh.nodes), (np.arange(m)[:, None] + np.array([0, m])).ravel(), 2 * m)
    return elastic.Springs(
        start=unsigned(mesh.edges[:, 0]), end=unsigned(mesh.edges[:, 1]), stiffness=lat.stiffness,
        rest=_if(lat.stiffness.size > 0, mesh.lengths), slots=lists,
        stretch=_if(effects["tensile_failure"].on and lat.stiffness.size > 0, 1.0 + lat.limit_strain),
        expansion=_if(effects["expansion"].on and lat.stiffness.size > 0, lat.expansion),
    )


def _sheet(scene: Scene, mesh: Mesh, effects: Plan) -> sheet.Sheet:
    """Triangles as elastic elements; empty where springs carry the load."""
    on, sail, t = scene.flight.stiffness == "triangles", scene.sail, len(mesh.triangles)
    poisson, young = per_triangle(sail, mesh, "poisson"), per_triangle(sail, mesh, "young_Pa")
    limit = 4.0 * mesh.areas * (1.0 - poisson**2) * per_triangle(sail, mesh, "strength_Pa") / young
    expansion = per_triangle(sail, mesh, "expansion_1_K")
    if scene.flight.expansion_1_K is not None:
        expansion = np.full(t, scene.flight.expansion_1_K)
    sides = mesh.triangle_edges.T.ravel()
    lists = np.empty((2, 0), np.uint32)
    if on and (effects["damping"].on or scene.flight.on_failure == "remove"):
        lists = slots(sides, len(mesh.edges), np.arange(3 * t), 3 * t)
    modulus, rest = sheet_modulus(sail, mesh), _if(on, mesh.lengths[sides] ** 2)
    return sheet.Sheet(
        sides=unsigned(sides if on else []), rest=rest, free=bodies.free_squares(scene, mesh, rest),
        cotangent=_if(on, cotangents(mesh).T.ravel()), area=_if(on, 4.0 * mesh.areas), modulus=_if(on, modulus),
        shear=_if(on, modulus * (1.0 - poisson)), poisson=_if(on, poisson), slots=lists,
        limit=_if(on and effects["tensile_failure"].on, limit),
        expansion=_if(on and effects["expansion"].on, expansion),
    )


def _triangles(scene: Scene, mesh: Mesh) -> triangles.Triangles:
    return triangles.Triangles(
        corners=unsigned(mesh.triangles.T),
        masses=per_triangle(scene.sail, mesh, "areal_mass") * mesh.areas,
    )


def is_warm(effects: Plan) -> bool:
    """Does any effect need temperatures."""
    return any(effects[name].on for name in ("absorption", "emission", "conduction", "expansion", "thermal_failure"))


def _heat(scene: Scene, mesh: Mesh, lat: Lattice, effects: Plan) -> thermal.Heat:
    flight = scene.flight
    faces = per_triangle(scene.sail, mesh, "emissivity_front") + per_triangle(scene.sail, mesh, "emissivity_back")
    limits = per_triangle(scene.sail, mesh, "failure_temperature_K")
    return thermal.Heat(
        per_capacity=_if(is_warm(effects), flight.thermal_rate / lat.heat_capacities),
        absorbs=effects["absorption"].on,
        emission=_if(effects["emission"].on, flight.stefan_boltzmann * faces / 3.0),
        background=flight.background_temperature_K**4,
        conductance=_if(effects["conduction"].on, lat.conductance),
        limit=_if(effects["thermal_failure"].on, limits), lowest=float(limits.min()),
        every=flight.heat_every,
    )


def _tables(arrays: list[TableArrays], nearest: bool) -> optical.Tables:
    """Tables one after the other; none at all is allowed."""
    numbers = np.concatenate([np.empty(0), *(t.numbers for t in arrays)])
    places = np.concatenate([np.empty(0, np.int64), *(t.places for t in arrays)])
    starts = np.cumsum([[0, 0], *([t.numbers.size, t.places.size] for t in arrays)], axis=0)
    axisymmetric = np.array([t.axisymmetric for t in arrays], dtype=bool)
    return optical.Tables(numbers, places, starts, axisymmetric, nearest)


def _ranges(scene: Scene, mesh: Mesh) -> Integers:
    """Table (−1: constant reflectance), first and end triangle of each region (s, 3)."""
    designs, regions = scene.sail.designs, scene.sail.regions
    ends = np.searchsorted(mesh.sector, np.arange(len(regions) + 1))
    which = [designs.index(r.design) if r.design else -1 for r in regions]
    return np.stack([which, ends[:-1], ends[1:]], axis=1)


def _light(
    scene: Scene, mesh: Mesh, corners: NDArray[np.uint32], tables: dict[str, PressureTable], effects: Plan
) -> optical.Light:
    on = effects["light"].on
    regions, nearest = scene.sail.regions, scene.lookup == "nearest"
    absorptance = per_triangle(scene.sail, mesh, "absorptance")
    absorptance = np.where(np.array([scene.tabled(r) for r in regions])[mesh.sector], -1.0, absorptance)
    g = directions(mesh.nodes[mesh.triangles].mean(axis=1), mesh.sector, scene.sail).T[:2]
    return optical.Light(
        corners=corners if on else np.empty((3, 0), np.uint32),
        cos_across=_if(on, mesh.cos_across), sin_across=_if(on, mesh.sin_across),
        rest_g=np.array(g if scene.incidence == "yaw_blind" else g[:, :0], order="C"),
        absorptance=_if(on, absorptance),
        reflectance=_if(on, np.array([r.reflectance or 0.0 for r in regions])[mesh.sector]),
        tables=_tables([tables[design].arrays(nearest) for design in scene.sail.designs] if on else [], nearest),
        ranges=_ranges(scene, mesh), intensity=scene.beam.intensity_W_m2, radius=scene.beam.radius_m,
        delay=scene.beam.delay_s, rise=scene.beam.rise_s, on=scene.beam.on_s,
        yaw_blind=scene.incidence == "yaw_blind", clamp=scene.outside_table == "clamp",
    )


def _polariser(
    scene: Scene, mesh: Mesh, lat: Lattice, tables: dict[str, PressureTable], on: bool
) -> polarisation.Polariser:
    """The beam's field and the films' amplitudes, if polarisation is tracked; InputError where a table has none."""
    beam, tracked = scene.beam, on and scene.reflections.polarisation == "tracked"
    films = [part for design in scene.sail.designs if tracked for part in tables[design].amplitude_arrays()]
    arms = lat.masses * centred(mesh, lat.masses)[:, :2].T
    return polarisation.Polariser(
        tracked=tracked, films=_tables(films, False), angle=math.radians(beam.polarisation_deg),
        rate=2.0 * math.pi * beam.polarisation_Hz,
        arms=np.array(arms if tracked and beam.polarisation == "sail" else arms[:, :0], order="C"),
    )


def _mirror(
    scene: Scene, mesh: Mesh, lat: Lattice, tables: dict[str, PressureTable], effects: Plan
) -> reflections.Mirror:
    """The sail as mirrors; InputError where a region is a grating, which throws light in more than one direction."""
    on, given, designs = effects["light"].on and effects["reflections"].on, scene.reflections, scene.sail.designs
    gratings = [design for design in designs if on and not tables[design].axisymmetric]
    if gratings:
        raise InputError(
            f"{scene.name}.yaml: effects.reflections: '{gratings[0]}' is a grating; only light from specular films is "
            "traced: set effects.reflections: false"
        )
    kinds = np.array([designs.index(r.design) if r.design else -1 for r in scene.sail.regions])[mesh.sector]
    centres = mesh.nodes[mesh.triangles].mean(axis=1)
    return reflections.Mirror(
        tree=tree.plant(centres if on else centres[:0]), kind=kinds if on else kinds[:0],
        last=np.array([tables[design].u[-1] for design in designs] if on else [], float), bounces=given.bounces,
        rays=given.rays_a_side, cutoff=given.cutoff, least=1e-9 * float(np.ptp(mesh.nodes, axis=0).max()),
        polariser=_polariser(scene, mesh, lat, tables, on),
    )


def spin_up_time(scene: Scene) -> float:
    """Length of the spin-up in s; if not given Gao et al.'s |f|/(1801.8 max(|f|/100 Hz, Γ)), Γ = 10, curved sails 2.

    That is for sails of 0.5 m; larger ones, which elastic waves take as much longer to cross, get more.
    """
    if scene.flight.spin_up_s is not None:
        return scene.flight.spin_up_s
    f = abs(scene.release.spin_Hz)
    larger = max(1.0, scene.sail.radius_m / 0.5)
    return f / (1801.8 * max(f / 100.0, 10.0 if scene.sail.profile == "flat" else 2.0)) * larger


def _spin_up(scene: Scene, effects: Plan, dt: float) -> spin.SpinUp:
    if not effects["spin_up"].on:
        return spin.SpinUp(0.0, 0, 0.0)
    rate, duration, gain = 2.0 * math.pi * scene.release.spin_Hz, spin_up_time(scene), scene.flight.spin_up_gain
    return spin.SpinUp(rate, math.ceil(duration / dt), math.nan if gain is None else gain * rate / duration)


def time_step(scene: Scene, mesh: Mesh, lat: Lattice, tethers: Tethers | None = None) -> float:
    """The scene's time step in s, or MARGIN · 2/ω_max and at most 1° of turn; InputError above the stability bound."""
    flight, share = scene.flight, 1.0
    if flight.integrator == "corotating":
        return corotating.time_step(scene)
    springs = lat.stiffness.size > 0
    matrix = stiffness_matrix(mesh, lat.stiffness) if springs else sheet_matrix(scene.sail, mesh)
    masses = lat.masses
    if tethers is not None:
        matrix, masses = bodies.stiffened(scene, mesh, matrix, masses, tethers)
    omega = highest_frequency(matrix, masses)
    if plan(scene)["damping"].on:
        share = damped_share(scene, omega)
    if tethers is not None and tethers.retardation.any():
        share = min(share, viscous_share(omega, float(tethers.retardation.max())))
    bound = share * STABILITY[flight.integrator] / omega
    if flight.time_step_s is None:
        turn = 1.0 / (360.0 * abs(scene.release.spin_Hz)) if scene.release.spin_Hz else math.inf
        return float(f"{min(share * MARGIN * 2.0 / omega, turn):.4e}")
    if flight.time_step_s >= bound:
        raise InputError(
            f"{scene.name}.yaml: flight.time_step_s = {flight.time_step_s:g}: must be below {bound:.5g} s, the "
            f"stability bound of {flight.integrator} on this mesh (highest frequency {omega / (2 * math.pi):.5g} Hz)"
        )
    return flight.time_step_s


def _check_energy(scene: Scene, absorptances: list[float]) -> None:
    """InputError where a region would take up or give back more light than it gets; of each the highest absorptance."""
    for i, (region, absorptance) in enumerate(zip(scene.sail.regions, absorptances, strict=True)):
        if region.reflectance is not None and region.reflectance + absorptance > 1.0:
            raise InputError(
                f"{scene.name}.yaml: sail: region {i}: reflectance = {region.reflectance:g}: with the material's "
                f"absorptance {absorptance:g} it must not exceed 1"
            )
        if absorptance > 1.0:
            raise InputError(
                f"{scene.name}.yaml: sail: region {i}: material.with_temperature.absorptance: times the table's own it "
                f"comes to {absorptance:g}: must not exceed 1"
            )


def build(scene: Scene, tables: dict[str, PressureTable]) -> Membrane:
    """Mesh, lattice and kernel arrays of a scene, with only the effects its plan calls for."""
    scene = designed(scene, tables)
    effects = plan(scene)
    mesh = sail_mesh(scene.sail)
    check_mesh(mesh, f"{scene.name}.yaml: sail")
    check_light(scene, mesh)
    bodies.check_bodies(scene)
    absorptances = highest_absorptances(scene, tables)
    _check_energy(scene, absorptances)
    lat = lattice(scene.sail, mesh, scene.flight)
    middle = centred(mesh, lat.masses)
    tethers = bodies.lines(scene, mesh, mesh.nodes[0] - middle[0])
    dt = time_step(scene, mesh, lat, tethers)
    bodies.check_drag(scene, dt)
    heat = _heat(scene, mesh, lat, effects)
    # Its two-step method for the temperatures is stable for half as long
    check_heat(scene, mesh, heat, effects, absorptances, 2.0 * dt if scene.flight.integrator == "corotating" else dt)
    spin_up, inert = _spin_up(scene, effects, dt), bodies.inertial(scene, mesh, lat.masses)
    asked = effects["damping"].on or effects["held"].on or effects["payload"].on
    release = max(spin_up.steps, 1)
    springs, elements, parts = _springs(mesh, lat, effects), _sheet(scene, mesh, effects), _triangles(scene, mesh)
    model = flown.Model(
        springs=springs, sheet=elements,
        stencil=with_springs(layout(mesh, scene.sail.outline, scene.sail.rings, inert), springs),
        retardation=_if(effects["damping"].on, per_triangle(scene.sail, mesh, "damping_s")),
        triangles=parts,
        masses=lat.masses, per_mass=_if(asked, 1.0 / inert), rest=np.ascontiguousarray(middle.T),
        lit=effects["light"].on, light=_light(scene, mesh, parts.corners, tables, effects),
        mirror=_mirror(scene, mesh, lat, tables, effects), warm=is_warm(effects),
        heat=heat, curves=build_curves(scene, mesh, effects, is_warm(effects)),
        spin_up=spin_up, holder=bodies.holder(scene, mesh, middle), tethers=tethers,
        integrator=INTEGRATORS[scene.flight.integrator], dt=dt, release=release,
        end=release + math.ceil(scene.flight.duration_s / dt - 1e-9), optics_every=scene.flight.optics_every,
        series_every=scene.flight.series_every, fly_away=scene.fly_away,
        most_broken=math.floor(scene.flight.broken_fraction * len(mesh.triangles)),
    )
    carried = corotating.carrier(scene, mesh, lat.masses, dt) if scene.flight.integrator == "corotating" else None
    return Membrane(scene, effects, mesh, lat, model, carried)


def centred(mesh: Mesh, masses: Floats) -> Floats:
    """Rest nodes (n, 3) in m about the centre of mass."""
    return np.asarray(mesh.nodes - masses @ mesh.nodes / masses.sum())
