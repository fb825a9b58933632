"""The sail as a rigid body on its beam, in the normalised units of the equations of motion, and back to SI.

Units (Gao, Kelzenberg & Atwater, supplementary text): length D, mass m, time t₀ = √(m c/(I₀ D)), so that the force unit
is I₀D²/c and the torque unit I₀D³/c.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.light.gaussian_rules import ERROR, NARROWEST, beam_rules
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.light.pointing import wander
from dynamics.light.rules import TooSteep, profile_rules, scaled
from dynamics.light.sectors import Rules
from dynamics.light.spots import pack
from dynamics.rigid import equations as kernel
from dynamics.rigid.towing import Towing
from dynamics.sail.attitude import quaternion_from_angles, rotation_from_quaternion
from dynamics.sail.masses import designed
from dynamics.sail.payload import Tethers, on_disc, tethers
from dynamics.sail.sectors import SailShape, sail_shape
from dynamics.scene import schema as scenes
from optics.table.pressure_table import PressureTable, TableArrays


@dataclass(frozen=True)
class Units:
    """Length in m, mass in kg and time in s that count as one."""

    length: float
    mass: float
    time: float

    @property
    def state(self) -> Floats:
        """SI values (17,) of the units of position, velocity, quaternion, angular velocity, work, angular impulse."""
        speed = self.length / self.time
        scale = [self.length] * 3 + [speed] * 3 + [1.0] * 4 + [1.0 / self.time] * 3 + [self.mass * speed**2]
        return np.array(scale + [self.mass * self.length * speed] * 3)

    @property
    def force(self) -> float:
        """Unit of force in N."""
        return self.mass * self.length / self.time**2

    @property
    def torque(self) -> float:
        """Unit of torque in N m."""
        return self.force * self.length


def normal_units(shape: SailShape, intensity: float) -> Units:
    """Units of a sail in light of that intensity in W/m²; without light the time unit is a second."""
    time = np.sqrt(shape.mass * LIGHT_SPEED / (intensity * shape.diameter)) if intensity > 0 else 1.0
    return Units(shape.diameter, shape.mass, float(time))


@dataclass(frozen=True)
class RigidBody:
    """A scene's sail, beam and tables as the compiled kernels want them."""

    shape: SailShape
    units: Units
    sail: kernel.RigidSail
    light: kernel.Light
    tables: tuple[TableArrays, ...]
    payload: Tethers

    @property
    def scale(self) -> Floats:
        """SI values of the units of a state: of the sail (17,), positions, velocities of the payload, its tethers."""
        size, unit = 3 * self.payload.mass.size, self.units
        more = [np.full(size, unit.length), np.full(size, unit.length / unit.time), np.ones(self.payload.body.size)]
        return np.concatenate([unit.state, *more])

    def load(self, position: Floats, turn: Floats, time: float = 0.0) -> tuple[Floats, Floats, int]:
        """Force (3,) in N in lab components, torque (3,) in N m in body components, flag, at full intensity.

        `position` (3,) in m of the centre of mass in the lab, `turn` (3, 3) from body to lab components; the time in s
        matters for a beam whose polarisation turns.
        """
        out = np.empty(6)
        x, y = position[0] / self.units.length, position[1] / self.units.length
        matrix, t = np.ascontiguousarray(turn, float), time / self.units.time
        flag = kernel.load(self.sail, self.tables, self.light, t, matrix, x, y, out)
        return turn @ out[:3] * self.units.force, out[3:] * self.units.torque, flag

    def start(self, release: scenes.Release) -> Floats:
        """State (17,) at release in normalised units: tilted about the origin, spin axis included, then shifted.

        With a payload, which turns with the sail as if it were a part of it, longer by that.
        """
        quaternion = quaternion_from_angles(np.radians(release.roll_deg), np.radians(release.pitch_deg), 0.0)
        state = np.zeros(kernel.STATE)
        state[:3] = rotation_from_quaternion(quaternion) @ [*self.shape.centre, 0.0]
        state[:2] += release.offset_m
        state[6:10] = quaternion
        state[12] = 2.0 * np.pi * release.spin_Hz
        return self.loaded(state / self.units.state)

    def loaded(self, state: Floats) -> Floats:
        """A state (17,) in normalised units, with the payload where it is from the sail at the start."""
        if self.payload.mass.size == 0:
            return state
        turn = rotation_from_quaternion(state[6:10])
        arm = (self.payload.position - np.array([*self.shape.centre, 0.0])) / self.units.length
        place = state[:3] + arm @ turn.T
        speed = state[3:6] + np.cross(state[10:13], arm) @ turn.T
        return np.concatenate([state, place.ravel(), speed.ravel(), np.ones(self.payload.body.size)])


def rigid_body(
    scene: scenes.Scene, tables: dict[str, PressureTable], lookup: str | None = None, quadrature: float | None = ERROR
) -> RigidBody:
    """The scene's rigid body.

    `lookup` overrides the scene's rule of that name; `quadrature` is the error of a sector's integrals, as a share of
    the power on the centred sail; None for a body whose load is not asked for. InputError where the beam is too narrow.
    """
    shape = sail_shape(designed(scene, tables).sail)
    units = normal_units(shape, scene.beam.intensity_W_m2)
    nearest = (lookup or scene.lookup) == "nearest"
    if scene.holding is not None:
        raise InputError(f"{scene.name}.yaml: held: must be left out, or effects.held be false, for a rigid sail")
    return carrying(
        scene,
        RigidBody(
            shape,
            units,
            _arrays(shape, units, tables, _rules(scene, shape, quadrature)),
            _light(scene, units),
            _tables(tables, nearest, scene.beam.polarisation),
            tethers([]),
        ),
    )


def carrying(scene: scenes.Scene, body: RigidBody) -> RigidBody:
    """The body with the payload of a scene; InputError where a tether ends beside the sail."""
    payload = tethers(scene.carried)
    towing = _towing(scene, payload, body.shape, body.units)
    return replace(body, sail=body.sail._replace(towing=towing), payload=payload)


def _towing(scene: scenes.Scene, payload: Tethers, shape: SailShape, units: Units) -> Towing:
    """A payload in normalised units; InputError where a tether ends beside the sail."""
    ends = on_disc(payload.to, shape.radius, f"{scene.name}.yaml")
    force = units.force / units.length
    return Towing(
        mass=payload.mass / units.mass,
        body=payload.body,
        arm=(ends - np.array([*shape.centre, 0.0])) / units.length,
        stiffness=payload.stiffness / force,
        length=payload.lengths(ends) / units.length,
        retardation=payload.retardation / units.time,
        strength=payload.strength / units.force,
        pushes=payload.pushes,
        snaps=bool(np.isfinite(payload.strength).any()),
    )


def _light(scene: scenes.Scene, units: Units) -> kernel.Light:
    """The scene's beam in normalised units."""
    beam = scene.beam
    if beam.polarisation != "sail" and scene.incidence == "yaw_blind":
        raise InputError(f"beam.polarisation = '{beam.polarisation}': needs incidence: sail_frame, which knows the yaw")
    if scene.incidence == "yaw_blind" and beam.pointing.tilts:
        raise InputError(
            f"{scene.name}.yaml: beam.pointing: tilts need incidence: sail_frame; yaw_blind knows light along z alone"
        )
    return kernel.Light(
        1.0 if beam.intensity_W_m2 > 0 else 0.0,
        pack(beam.spots, 1.0 / units.length),
        wander(beam.pointing, beam.power_noise, units.length, units.time),
        beam.delay_s / units.time,
        beam.rise_s / units.time,
        beam.on_s / units.time,
        scene.incidence == "yaw_blind",
        scene.rigid.beam_distance == "published",
        beam.polarisation != "sail",
        float(np.radians(beam.polarisation_deg)),
        2.0 * np.pi * beam.polarisation_Hz * units.time,
    )


def _rules(scene: scenes.Scene, shape: SailShape, quadrature: float | None) -> Rules:
    """Quadrature of the beam over the sail in diameters, or none."""
    if quadrature is None:
        return Rules(np.zeros(0), np.zeros(0), np.zeros((0, 0), np.int64), np.zeros((0, 4)), 0.0)
    spans, beam = tuple((float(s.start), float(s.stop)) for s in shape.sectors), scene.beam
    if not beam.gaussian:
        return _profile_rules(scene, shape, spans, quadrature)
    if beam.radius_m < NARROWEST * shape.radius:
        raise InputError(
            f"{scene.name}.yaml: beam.radius_m = {beam.radius_m:g}: must be at least {NARROWEST:g} of "
            f"sail.radius_m, {NARROWEST * shape.radius:g}, for a rigid sail"
        )
    return beam_rules(spans, 0.5, beam.radius_m / shape.diameter, quadrature)


def _profile_rules(
    scene: scenes.Scene, shape: SailShape, spans: tuple[tuple[float, float], ...], quadrature: float
) -> Rules:
    """Those of all beams but round Gaussian ones."""
    if scene.rigid.beam_distance == "published":
        raise InputError(
            f"{scene.name}.yaml: rigid.beam_distance = 'published': must be 'lateral' but for a round Gaussian beam"
        )
    error = max([quadrature, *(spot.profile.error for spot in scene.beam.spots)])
    try:
        return scaled(profile_rules(scene.beam.spots, spans, shape.radius, error), shape.diameter)
    except TooSteep as refusal:
        raise InputError(f"{scene.name}.yaml: beam.profile: {refusal}") from None


def _arrays(shape: SailShape, units: Units, tables: dict[str, PressureTable], rules: Rules) -> kernel.RigidSail:
    """The sail's arrays in normalised units; tables are numbered in the order of the mapping."""
    inertia = shape.inertia / (units.mass * units.length**2)
    missing = [s.design for s in shape.sectors if s.design is not None and s.design not in tables]
    if missing:
        raise InputError(f"sail.sectors design = '{missing[0]}': no pressure table given")
    numbers = [-1 if s.design is None else list(tables).index(s.design) for s in shape.sectors]
    return kernel.RigidSail(
        np.array([s.g for s in shape.sectors]),
        rules,
        shape.centre / units.length,
        np.array(numbers, dtype=np.int64),
        np.array([s.reflectance for s in shape.sectors]),
        np.array([s.absorptance for s in shape.sectors]),
        inertia,
        np.asarray(np.linalg.inv(inertia), float),
    )


def _tables(tables: dict[str, PressureTable], nearest: bool, polarisation: str) -> tuple[TableArrays, ...]:
    """Tables for the kernels, which need at least one to be compiled: without any, a table that nobody reads."""
    lab = polarisation != "sail"
    for name in (name for name, table in tables.items() if lab and table.q_stokes is None):
        raise InputError(f"beam.polarisation = '{polarisation}': table '{name}' lacks the Stokes response")
    arrays = tuple(table.arrays(nearest, lab) for table in tables.values())
    if arrays:
        return arrays
    axis = np.array([0.0, 1.0])
    return (PressureTable(axis, axis, np.zeros((3, 2, 2)), np.zeros((2, 2)), np.ones((2, 2))).arrays(),)
