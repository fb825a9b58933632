"""Rigid flight: six degrees of freedom of the sail on its beam, from release to the end of the scene.

    python -m dynamics.rigid --scene workflow/scenes/s3.yaml --tables te.h5 tm.h5 --out rigid.h5

The attitude is a unit quaternion inside; pitch, roll and yaw appear in the file alone. The equations are integrated by
the explicit Runge–Kutta method of order 8(5,3) of Dormand & Prince (Hairer, Nørsett & Wanner, Solving Ordinary
Differential Equations I, §II.5 and §II.10) with its dense output of order 7 for the rows of the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from dynamics import scene as scenes
from dynamics.attitude import angles_from_rotation, rotation_from_quaternion
from dynamics.beam import knots
from dynamics.command import stage_arguments
from dynamics.kernels.rigid import INSIDE, LIT_FROM_BEHIND, STATE
from dynamics.rigid_body import RigidBody, rigid_body
from dynamics.sail import check_release, load_tables, provenance, sail_shape
from optics.files import Stopwatch, atomic, progress, run_stage, versions
from optics.table import PressureTable

Floats = NDArray[np.float64]

COUNTS = ("end_reason", "steps", "evaluations", "clamped_steps", "wall_seconds")


@dataclass(frozen=True)
class RigidFlight:
    """A flight in SI units, n rows.

    time (n,) in s; position, velocity (n, 3) of the centre of mass in the lab; quaternion (n, 4) body to lab;
    angular_velocity (n, 3) in rad/s, body components; work (n,) in J of the light on the sail since release.
    clamped_steps counts steps that ended outside a table; evaluations those of the equations of motion.
    """

    time: Floats
    position: Floats
    velocity: Floats
    quaternion: Floats
    angular_velocity: Floats
    work: Floats
    end_reason: str
    steps: int
    evaluations: int
    clamped_steps: int
    wall_seconds: float

    @property
    def angles(self) -> tuple[Floats, Floats, Floats]:
        """(roll, pitch, yaw), each (n,) in rad."""
        return angles_from_rotation(rotation_from_quaternion(self.quaternion))

    @property
    def spin(self) -> Floats:
        """Spin (n,) in turns a second about the normal, negative where clockwise seen against +z."""
        return self.angular_velocity[:, 2] / (2.0 * np.pi)

    def kinetic_energy(self, mass: float, inertia: Floats) -> Floats:
        """Kinetic energy (n,) in J of a sail of that mass in kg and inertia tensor (3, 3) in kg m²."""
        turning = np.einsum("ni,ij,nj->n", self.angular_velocity, inertia, self.angular_velocity)
        return 0.5 * (mass * (self.velocity**2).sum(axis=1) + turning)


class Integrator:
    """Steps through a flight in normalised units, from knot to knot of the ramp, until there is a reason to end.

    `known` is the time up to which the flight is known, `end_state` (14,) the state there.
    """

    def __init__(self, body: RigidBody, scene: scenes.Scene, start: Floats | None = None) -> None:
        self._body = body
        self._tolerance = scene.rigid.tolerance
        self._clamp = scene.outside_table == "clamp"
        self._limit = scene.flight.fly_away_m / body.units.length
        self.duration = scene.rigid.duration_s / body.units.time
        stops = {min(knot / body.units.time, self.duration) for knot in knots(scene.beam)} | {self.duration}
        self._stops = sorted(stops - {0.0})
        self._flag = INSIDE
        self._dense: Callable[[float], Floats] | None = None
        self.end_reason = ""
        self.steps = self.evaluations = self.clamped_steps = 0
        self.known, self.end_state = 0.0, body.start(scene.release) if start is None else start
        self._solver: Any = None
        self._begin()

    def step(self) -> None:
        """One step of the integrator, then the reasons to end."""
        if self._solver.status == "finished":
            self._begin()
        if self.end_reason:
            return
        self._renormalise()
        self._dense = None
        self._solver.step()
        if self._solver.status == "failed":
            # A NaN never passes the error control: the step shrinks to nothing, and the stages tell why
            self.end_reason = "step_too_small" if np.all(np.isfinite(self._solver.K)) else "non_finite"
            return
        self.steps += 1
        self.clamped_steps += self._flag != INSIDE
        self.known, self.end_state = float(self._solver.t), self._solver.y
        if self._reason(self.end_state, self._flag):
            self._cut()
        elif self.known >= self.duration:
            self.end_reason = "finished"

    def at(self, t: float) -> Floats:
        """State (14,) at a time within the last step."""
        if self._dense is None:
            self._dense = self._solver.dense_output()
        return self._dense(t)

    def _begin(self) -> None:
        """A solver from the state known so far to the next knot, unless that state is a reason to end."""
        slope = self._derivative(self.known, self.end_state)
        if not np.all(np.isfinite(slope)):
            self.end_reason = "non_finite"
            return
        self.end_reason = self._reason(self.end_state, self._flag)
        stop = next(stop for stop in self._stops if stop > self.known)
        self._solver = DOP853(
            self._derivative, self.known, self.end_state, stop, rtol=self._tolerance, atol=self._tolerance
        )

    def _derivative(self, t: float, state: Floats) -> Floats:
        """d(state)/dt; remembers the flag, which after a step is that of its end: the last stage lies there."""
        out = np.empty(STATE)
        self._flag = self._body.derivative(t, state, out)
        self.evaluations += 1
        return out

    def _renormalise(self) -> None:
        """Unit quaternion. q̇ is linear in q and nothing else depends on |q|, so the derivative at hand scales too."""
        norm = float(np.linalg.norm(self._solver.y[6:10]))
        self._solver.y[6:10] /= norm
        self._solver.f[6:10] /= norm

    def _reason(self, state: Floats, flag: int) -> str:
        if flag == LIT_FROM_BEHIND or (flag != INSIDE and not self._clamp):
            return "left_table"
        return "fly_away" if math.hypot(state[0], state[1]) > self._limit else ""

    def _cut(self) -> None:
        """Move the end of the flight back to the moment where its reason arose, by bisection within the last step."""
        before, after = self._solver.t_old, self.known
        for _ in range(50):
            middle = 0.5 * (before + after)
            candidate = self.at(middle)
            self._derivative(middle, candidate)
            if self._reason(candidate, self._flag):
                after = middle
            else:
                before = middle
        self.known, self.end_state = after, self.at(after)
        self._derivative(after, self.end_state)
        self.end_reason = self._reason(self.end_state, self._flag)


def fly(scene: scenes.Scene, tables: dict[str, PressureTable], start: Floats | None = None) -> RigidFlight:
    """Fly a scene with the pressure table of each of its designs.

    `start` (14,) replaces the release of the scene: position, velocity, quaternion, angular velocity and work in SI.
    """
    watch = Stopwatch()
    body = rigid_body(scene, tables)
    integrator = Integrator(body, scene, None if start is None else np.asarray(start, float) / body.units.state)
    times, states = _rows(integrator, scene, body.units.time)
    si = np.array(states) * body.units.state
    quaternion = si[:, 6:10] / np.linalg.norm(si[:, 6:10], axis=1, keepdims=True)
    return RigidFlight(
        np.array(times) * body.units.time, si[:, :3], si[:, 3:6], quaternion, si[:, 10:13], si[:, 13],
        integrator.end_reason, integrator.steps, integrator.evaluations, integrator.clamped_steps, watch.seconds,
    )


def _rows(integrator: Integrator, scene: scenes.Scene, unit: float) -> tuple[list[float], list[Floats]]:
    """Times and states in normalised units at the scene's output rate, and at the end."""
    times, states = [0.0], [integrator.end_state.copy()]
    spacing = 1.0 / (scene.rigid.output_Hz * unit)
    before_end = math.ceil(integrator.duration / spacing * (1.0 - 1e-12))
    for k in progress(range(1, before_end), f"rigid {scene.name}", unit="row"):
        while not integrator.end_reason and integrator.known < k * spacing:
            integrator.step()
        if integrator.known < k * spacing:
            break  # the flight has ended
        times.append(k * spacing)
        states.append(integrator.at(k * spacing))
    while not integrator.end_reason:
        integrator.step()
    if integrator.known > times[-1]:
        times.append(integrator.known)
        states.append(integrator.end_state.copy())
    return times, states


def write(path: str | Path, flight: RigidFlight, scene: scenes.Scene, tables: dict[str, PressureTable]) -> None:
    """Write a flight as HDF5, atomically: one dataset a quantity, its unit an attribute; the scene as JSON."""
    body = sail_shape(scene.sail)
    roll, pitch, yaw = flight.angles
    columns = {
        "time": (flight.time, "s"), "position": (flight.position, "m"), "velocity": (flight.velocity, "m/s"),
        "pitch": (pitch, "rad"), "roll": (roll, "rad"), "yaw": (yaw, "rad"), "spin": (flight.spin, "Hz"),
        "angular_velocity": (flight.angular_velocity, "rad/s"), "quaternion": (flight.quaternion, "1"),
        "energy_kinetic": (flight.kinetic_energy(body.mass, body.inertia), "J"), "work": (flight.work, "J"),
    }
    with atomic(path) as temporary, h5py.File(temporary, "w") as file:
        for name, (values, unit) in columns.items():
            file.create_dataset(name, data=values).attrs["units"] = unit
        file.attrs.update({
            "scene": scene.model_dump_json(), "tables": json.dumps(provenance(tables)),
            "versions": json.dumps(versions("numpy", "scipy", "numba")),
            "mass_kg": body.mass, "inertia_kg_m2": body.inertia, **{key: getattr(flight, key) for key in COUNTS},
        })


def main() -> None:
    """Fly the rigid sail of a scene and write its flight."""
    arguments = stage_arguments("dynamics.rigid", main.__doc__, "HDF5 file to write")
    scene = scenes.read_scene(arguments.scene)
    tables = load_tables(arguments.tables, scene)
    check_release(scene, tables)
    flight = fly(scene, tables)
    write(arguments.out, flight, scene, tables)
    print(f"{scene.name}: {flight.end_reason} at {flight.time[-1]:.6g} s, {flight.steps} steps")


if __name__ == "__main__":
    run_stage(main)
