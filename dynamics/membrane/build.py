"""From a scene and its pressure tables to the model that is flown. An effect that is off gets no arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beamrider.io.files import InputError
from dynamics.membrane import bodies
from dynamics.membrane.arrays import Model
from dynamics.membrane.effects.composition import build_all
from dynamics.membrane.effects.interface import Plan, Setup, unsigned
from dynamics.membrane.lattice import (
    STABILITY,
    Lattice,
    centred,
    highest_frequency,
    lattice,
    per_triangle,
    sheet_matrix,
    stiffness_matrix,
)
from dynamics.membrane.layout.triangles import Triangles
from dynamics.membrane.plan import plan
from dynamics.membrane.row_layout import layout, with_springs
from dynamics.membrane.stepping import corotating_setup, integrators
from dynamics.membrane.stepping.corotating import Corotating
from dynamics.membrane.stepping.time_step import check_heat, highest_absorptances, retardation, viscous_share
from dynamics.sail.caught_light import check_light
from dynamics.sail.masses import designed
from dynamics.sail.mesh import Mesh, sail_mesh
from dynamics.sail.mesh_checks import check_mesh
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable

#: Share of the stability bound that is taken as time step when the scene gives none; tension stiffens a spinning sail.
MARGIN = 0.8
#: Updates of the held light to the shortest period of the beam's jitter: it then lags by less than 1 % of it.
HOLDS = 16
INTEGRATORS = {
    "semi_implicit_euler": integrators.SEMI_IMPLICIT_EULER,
    "verlet": integrators.VERLET,
    "rk4": integrators.RK4,
    "corotating": integrators.VERLET,
}


@dataclass(frozen=True)
class Membrane:
    """Everything a flexible flight needs: the scene and its plan, mesh and lattice, and the model of compiled code.

    corotating: what the co-rotating scheme adds to it, if that flies.
    """

    scene: Scene
    plan: Plan
    mesh: Mesh
    lattice: Lattice
    model: Model
    corotating: Corotating | None = None

    @property
    def elastic_triangles(self) -> bool:
        """Do triangles, not springs, carry the load."""
        return bool(self.model.effects.sheet.modulus.size > 0)


def time_step(scene: Scene, mesh: Mesh, lat: Lattice) -> float:
    """The scene's time step in s, or MARGIN · 2/ω_max and at most 1° of turn; InputError above the stability bound."""
    flight = scene.flight
    if flight.integrator == "corotating":
        return corotating_setup.time_step(scene)
    springs = lat.stiffness.size > 0
    matrix = stiffness_matrix(mesh, lat.stiffness) if springs else sheet_matrix(scene.sail, mesh)
    omega = highest_frequency(*bodies.stiffened(scene, mesh, matrix, lat.masses))
    slowness = retardation(scene) if plan(scene)["damping"].on else 0.0
    share = viscous_share(0.5 * omega * slowness + 0.5 * bodies.loss_rate(scene, mesh, lat.masses) / omega)
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


def _check_wander(scene: Scene, dt: float) -> None:
    """InputError where the held light is too old to follow the beam, or is that of light along z alone."""
    pointing, hold = scene.beam.pointing, scene.flight.optics_every * dt
    for key, noise in (("jitter_m", pointing.jitter_m), ("jitter_deg", pointing.jitter_deg)):
        if noise is not None and hold > 1.0 / (HOLDS * noise.highest):
            raise InputError(
                f"{scene.name}.yaml: flight.optics_every = {scene.flight.optics_every}: so many steps of {dt:.3g} s "
                f"must be below {1.0 / (HOLDS * noise.highest):.3g} s, for {HOLDS} to the shortest period of "
                f"beam.pointing.{key}"
            )
    if scene.incidence == "yaw_blind" and pointing.tilts:
        raise InputError(
            f"{scene.name}.yaml: beam.pointing: tilts need incidence: sail_frame; yaw_blind knows light along z alone"
        )


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


def _model(setup: Setup) -> Model:
    scene, mesh, masses = setup.scene, setup.mesh, setup.lattice.masses
    effects, flight = build_all(setup), setup.scene.flight
    inert = bodies.inertial(scene, mesh, masses)
    release = max(effects.spin_up.steps, 1)
    return Model(
        stencil=with_springs(layout(mesh, scene.sail.outline, scene.sail.rings, inert), effects.springs),
        triangles=Triangles(
            corners=unsigned(mesh.triangles.T), masses=per_triangle(scene.sail, mesh, "areal_mass") * mesh.areas
        ),
        masses=masses,
        rest=np.ascontiguousarray(centred(mesh, masses).T),
        lit=setup.on("light"),
        warm=setup.warm,
        integrator=INTEGRATORS[flight.integrator],
        dt=setup.dt,
        release=release,
        end=release + math.ceil(flight.duration_s / setup.dt - 1e-9),
        optics_every=flight.optics_every,
        series_every=flight.series_every,
        fly_away=scene.fly_away,
        effects=effects,
    )


def build(scene: Scene, tables: dict[str, PressureTable]) -> Membrane:
    """Mesh, lattice and arrays of a scene, with only the effects its plan calls for."""
    scene = designed(scene, tables)
    mesh = sail_mesh(scene.sail)
    check_mesh(mesh, f"{scene.name}.yaml: sail")
    check_light(scene, mesh)
    bodies.check_bodies(scene)
    absorptances = highest_absorptances(scene, tables)
    _check_energy(scene, absorptances)
    lat = lattice(scene.sail, mesh, scene.flight)
    setup = Setup(scene, tables, plan(scene), mesh, lat, time_step(scene, mesh, lat))
    _check_wander(scene, setup.dt)
    bodies.check_drag(scene, setup.dt)
    model, corotates = _model(setup), scene.flight.integrator == "corotating"
    # Its two-step method for the temperatures is stable for half as long
    check_heat(scene, mesh, model.effects.heat, setup.plan, absorptances, 2.0 * setup.dt if corotates else setup.dt)
    added = corotating_setup.corotating(scene, mesh, lat.masses, setup.dt) if corotates else None
    return Membrane(scene, setup.plan, mesh, lat, model, added)
