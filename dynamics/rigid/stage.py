"""Rigid flight: six degrees of freedom of the sail on its beam, from release to the end of the scene.

    python -m dynamics.rigid --scene workflow/scenes/s3.yaml --tables te.h5 tm.h5 --out rigid.h5

The attitude is a unit quaternion inside; pitch, roll and yaw appear in the file alone. `dynamics.rigid.integrator`
integrates the equations. A flight ends when it has lasted (`finished`), leaves the beam (`fly_away`), tilts beyond its
tables (`left_table`) or turns a grating's back to the light (`turned_over`).
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.arguments import stage_arguments
from beamrider.io.files import Stopwatch, finish, progress, versions
from beamrider.io.hdf5 import new_hdf5
from beamrider.machine_code.notice import compiling
from dynamics.light import pointing, pulse
from dynamics.light.gaussian_rules import ERROR
from dynamics.rigid import integrator as kernel
from dynamics.rigid.body import RigidBody, Units, rigid_body
from dynamics.rigid.payload_flight import TowedFlight, towed
from dynamics.sail.attitude import angles_from_rotation, rotation_from_quaternion
from dynamics.sail.forecast import require_rows, say_rigid
from dynamics.sail.neglected import neglected, said
from dynamics.sail.sectors import check_place, check_release, load_tables, provenance
from dynamics.sail.table_error import TableErrors, rigid_errors
from dynamics.scene import schema as scenes
from optics.table.pressure_table import PressureTable

REASONS = (
    "",
    "finished",
    "fly_away",
    "left_table",
    "turned_over",
    "non_finite",
    "step_too_small",
    "too_many_steps",
)  # in the order of the kernel's codes
COMPONENTS = (
    *(f"{what} {axis}" for what in ("position", "velocity") for axis in "xyz"),
    *(f"quaternion {i}" for i in "wxyz"),
    *(f"angular velocity {i}" for i in "xyz"),
    "work",
    *(f"angular impulse {i}" for i in "xyz"),
)
COUNTS = ("end_reason", "end_place", "steps", "evaluations", "clamped_steps", "wall_seconds")
PORTION = 2000  # steps between two looks at the progress
TRIAL = 200  # steps whose time is taken


@dataclass(frozen=True)
class RigidFlight:
    """A flight in SI units, n rows, of a sail of that mass in kg and inertia tensor (3, 3) in kg m².

    time (n,) in s; position, velocity (n, 3) of the centre of mass in the lab; quaternion (n, 4) body to lab;
    angular_velocity (n, 3) in rad/s, body components; work (n,) in J and angular_impulse (n, 3) in kg m²/s, lab
    components, of the light on the sail since release. end_place: where a flight broke off whose numbers failed.
    clamped_steps counts steps that ended outside a table; evaluations those of the equations of motion.
    payload: of a sail that carries one.
    """

    time: Floats
    position: Floats
    velocity: Floats
    quaternion: Floats
    angular_velocity: Floats
    work: Floats
    angular_impulse: Floats
    mass: float
    inertia: Floats
    end_reason: str
    end_place: str
    steps: int
    evaluations: int
    clamped_steps: int
    wall_seconds: float
    payload: TowedFlight | None = None

    @property
    def rotation(self) -> Floats:
        """Rotations (n, 3, 3) from body to lab components."""
        return rotation_from_quaternion(self.quaternion)

    @property
    def angles(self) -> tuple[Floats, Floats, Floats]:
        """(roll, pitch, yaw), each (n,) in rad."""
        return angles_from_rotation(self.rotation)

    @property
    def spin(self) -> Floats:
        """Spin (n,) in turns a second about the normal, negative where clockwise seen against +z."""
        return self.angular_velocity[:, 2] / (2.0 * np.pi)

    @property
    def angular_momentum(self) -> Floats:
        """Angular momentum (n, 3) about the centre of mass in kg m²/s, lab components (Goldstein, §5.1)."""
        return np.einsum("nij,jk,nk->ni", self.rotation, self.inertia, self.angular_velocity)

    @property
    def energy_kinetic(self) -> Floats:
        """Kinetic energy (n,) in J (Goldstein, §5.3)."""
        turning = np.einsum("ni,ij,nj->n", self.angular_velocity, self.inertia, self.angular_velocity)
        return 0.5 * (self.mass * (self.velocity**2).sum(axis=1) + turning)

    @property
    def energy_balance(self) -> Floats:
        """Gain in kinetic energy less the work of the light (n,) in J: zero but for the error of integration."""
        return self.energy_kinetic - self.energy_kinetic[0] - self.work

    @property
    def momentum_balance(self) -> Floats:
        """Gain in angular momentum less the angular impulse of the light (n, 3) in kg m²/s: zero likewise."""
        return self.angular_momentum - self.angular_momentum[0] - self.angular_impulse


def fly(
    scene: scenes.Scene, tables: dict[str, PressureTable], start: Floats | None = None, quadrature: float = ERROR
) -> RigidFlight:
    """Fly a scene with the pressure table of each of its designs.

    `start` (13,) replaces the release of the scene: position, velocity, quaternion, angular velocity in SI.
    `quadrature`: error of a sector's integrals, as in `rigid_body`.
    """
    watch, rows = Stopwatch(), require_rows(scene)
    body = rigid_body(scene, tables, quadrature=quadrature)
    state = body.start(scene.release)
    if start is None:
        check_place(scene, state[:2] * body.units.length)
    else:
        state[: kernel.MOTION] = np.asarray(start, float) / body.units.state[: kernel.MOTION]
        state = body.loaded(state[: kernel.STATE])
    terms = terms_of(scene, body.units)
    work = kernel.start(state, terms.rows.size)
    steps, seconds = step_seconds(body, terms, work)
    say_rigid(scene, rows, steps, seconds)
    _integrate(body, terms, work, scene.name)
    times, states = _rows(terms, work)
    si = states * body.scale
    si[:, 6:10] /= np.linalg.norm(si[:, 6:10], axis=1, keepdims=True)
    steps, evaluations, clamped = (int(work.counts[i]) for i in (kernel.STEPS, kernel.EVALUATIONS, kernel.CLAMPED))
    return RigidFlight(
        times * body.units.time,
        si[:, :3],
        si[:, 3:6],
        si[:, 6:10],
        si[:, 10:13],
        si[:, 13],
        si[:, 14:17],
        body.shape.mass,
        body.shape.inertia,
        REASONS[work.counts[kernel.REASON]],
        _place(work, body.units),
        steps,
        evaluations,
        clamped,
        watch.seconds,
        towed(body, states, si),
    )


def terms_of(scene: scenes.Scene, units: Units) -> kernel.Terms:
    """What governs the flight, in normalised units; rows at the scene's output rate, without the end."""
    duration = scene.rigid.duration_s / units.time
    beam = scene.beam
    knots = [*pulse.knots(beam), *pointing.knots(beam.pointing, beam.power_noise, scene.rigid.duration_s)]
    stops = {min(knot / units.time, duration) for knot in knots} | {duration}
    spacing = 1.0 / (scene.rigid.output_Hz * units.time)
    rows = spacing * np.arange(max(1, math.ceil(duration / spacing * (1.0 - 1e-12))), dtype=float)
    return kernel.Terms(
        scene.rigid.tolerance,
        scene.fly_away / units.length,
        scene.outside_table == "clamp",
        scene.rigid.most_steps,
        np.array(sorted(stops - {0.0})),
        rows,
    )


def step_seconds(body: RigidBody, terms: kernel.Terms, work: kernel.Work) -> tuple[float, float]:
    """Steps and wall time in s that a flight would take which went on as it begins, with everything compiled."""
    copies: list[Any] = [array.copy() for array in work]
    trial = kernel.Work(*copies)._replace(states=work.states[:0])
    brief = terms._replace(rows=terms.rows[:0])
    kernel.fly(body.sail, body.tables, body.light, brief, trial, 1)
    steps, begun, watch = trial.counts[kernel.STEPS], trial.clock[kernel.T], Stopwatch()
    kernel.fly(body.sail, body.tables, body.light, brief, trial, TRIAL)
    span, taken = trial.clock[kernel.T] - begun, int(trial.counts[kernel.STEPS] - steps)
    if span <= 0.0:
        return 1.0, 0.0
    whole = terms.stops[-1] / span
    return max(1.0, taken * whole), watch.seconds * whole


def _integrate(body: RigidBody, terms: kernel.Terms, work: kernel.Work, name: str) -> None:
    """Fly to the end in portions, with progress in hundredths of the duration."""
    for k in progress(range(1, 101), f"rigid {name}", unit="%"):
        while work.counts[kernel.REASON] == kernel.FLYING and work.clock[kernel.T] < 0.01 * k * terms.stops[-1]:
            kernel.fly(body.sail, body.tables, body.light, terms, work, PORTION)
        if work.counts[kernel.REASON] != kernel.FLYING:
            break


def _rows(terms: kernel.Terms, work: kernel.Work) -> tuple[Floats, Floats]:
    """Times and states in normalised units at the rows that were reached, and at the end of the flight."""
    n = work.counts[kernel.ROW]
    times, states, end = terms.rows[:n], work.states[:n], work.clock[kernel.T]
    if n == 0 or end > times[-1]:
        times, states = np.append(times, end), np.vstack([states, work.y])
    return times, states


def _place(work: kernel.Work, units: Units) -> str:
    """Where a flight ended that broke off: the quantity that was not finite and the state before; empty otherwise."""
    if work.counts[kernel.REASON] not in (kernel.NON_FINITE, kernel.STEP_TOO_SMALL, kernel.TOO_MANY_STEPS):
        return ""
    bad = work.counts[kernel.BAD]
    name = COMPONENTS[bad] if bad < len(COMPONENTS) else "payload"
    what = "" if bad < 0 else f"rate of {name} not finite, "
    x, y, z = work.y[:3] * units.length
    return f"{what}t = {work.clock[kernel.T] * units.time:.9g} s, x = {x:.6g} m, y = {y:.6g} m, z = {z:.6g} m"


def remark(flight: RigidFlight, scene: scenes.Scene, tables: dict[str, PressureTable]) -> str:
    """What the flight neglected, and from when on; '' for nothing."""
    turned = flight.rotation[:, 2, 2] <= 0.0
    behind = float(flight.time[np.argmax(turned)]) if turned.any() else None
    return neglected(scene, tables, flight.time, flight.position, flight.velocity, behind)


def write(path: str | Path, flight: RigidFlight, scene: scenes.Scene, tables: dict[str, PressureTable]) -> TableErrors:
    """Write a flight as HDF5, atomically: one dataset a quantity, its unit an attribute; the scene as JSON.

    Returns what the tables' stated errors come to on its way, which the file says too.
    """
    seen = pointing.seen(scene.beam.wander, flight.time, flight.position, flight.rotation)
    met = rigid_errors(scene, tables, *seen)
    roll, pitch, yaw = flight.angles
    columns = {
        "time": (flight.time, "s"),
        "position": (flight.position, "m"),
        "velocity": (flight.velocity, "m/s"),
        "pitch": (pitch, "rad"),
        "roll": (roll, "rad"),
        "yaw": (yaw, "rad"),
        "spin": (flight.spin, "Hz"),
        "angular_velocity": (flight.angular_velocity, "rad/s"),
        "quaternion": (flight.quaternion, "1"),
        "energy_kinetic": (flight.energy_kinetic, "J"),
        "work": (flight.work, "J"),
        "energy_balance": (flight.energy_balance, "J"),
        "angular_momentum": (flight.angular_momentum, "kg m2/s"),
        "angular_impulse": (flight.angular_impulse, "kg m2/s"),
        "angular_momentum_balance": (flight.momentum_balance, "kg m2/s"),
    }
    if flight.payload is not None:
        # The balances are those of a sail on which nothing but light acts
        columns = {name: values for name, values in columns.items() if not name.endswith("_balance")}
        columns |= flight.payload.columns()
    with new_hdf5(path) as file:
        for name, (values, unit) in columns.items():
            file.create_dataset(name, data=values).attrs["units"] = unit
        file.attrs.update(
            {
                "scene": scene.model_dump_json(),
                "tables": json.dumps(provenance(tables)),
                "versions": json.dumps(versions("numpy", "scipy", "numba")),
                "neglected": remark(flight, scene, tables),
                "mass_kg": flight.mass,
                "inertia_kg_m2": flight.inertia,
                **{key: getattr(flight, key) for key in COUNTS},
                **met.attributes(),
            }
        )
    return met


def main() -> None:
    """Fly the rigid sail of a scene and write its flight."""
    arguments = stage_arguments("dynamics.rigid", main.__doc__, "HDF5 file to write")
    scene = scenes.read_scene(arguments.scene)
    tables = load_tables(arguments.tables, scene)
    check_release(scene, tables)
    with compiling("30 s"):
        flight = fly(scene, tables)
    met = write(arguments.out, flight, scene, tables)
    place = f" ({flight.end_place})" if flight.end_place else ""
    end = f"{flight.end_reason} at {flight.time[-1]:.6g} s, {flight.steps} steps{place}"
    finish(arguments.out, arguments.watch, end, [met.text, said(remark(flight, scene, tables))])
