"""The release: a spinning sail brought to its place on the beam."""

from __future__ import annotations

import math

import numpy as np

from dynamics.membrane.build import Membrane
from dynamics.membrane.effects.tethers import TetherWork
from dynamics.membrane.state import State
from dynamics.membrane.stepping.corotating_setup import chord_speed
from dynamics.sail.attitude import rotation_from_angles
from dynamics.sail.mesh import sail_mesh
from dynamics.sail.mesh_checks import check_shadow
from dynamics.scene.schema import Scene


def release(membrane: Membrane, state: State, tethers: TetherWork) -> None:
    """Bring the spinning sail to its place at t = 0, as a rigid body and at once.

    In this order: turn positions and velocities about z until the reference node is back at its azimuth (yaw 0); tilt
    both by A_x(roll) A_y(pitch) about the origin, the spin axis with them; shift by the offset. In the co-rotating
    scheme nodes go on along chords. The payload goes with the sail. A sail that is held stays as it is mounted.
    """
    if membrane.scene.holding is not None:
        return
    given = membrane.scene.release
    node, masses = membrane.mesh.reference_node, membrane.lattice.masses
    centre = state.x @ masses / masses.sum()
    arm, rest = state.x[:, node] - centre, membrane.model.rest[:, node]
    yaw = math.atan2(rest[1], rest[0]) - math.atan2(arm[1], arm[0])
    tilt = rotation_from_angles(np.radians(given.roll_deg), np.radians(given.pitch_deg), yaw)
    state.x[...] = tilt @ state.x + np.array([*given.offset_m, 0.0])[:, None]
    state.v[...] = tilt @ state.v
    tethers.x[...] = tilt @ tethers.x + np.array([*given.offset_m, 0.0])[:, None]
    tethers.v[...] = tilt @ tethers.v
    if membrane.corotating is not None:
        state.v[...] *= chord_speed(membrane.scene, membrane.model.dt)


def check_tilt(scene: Scene) -> None:
    """InputError where the released sail would shade itself, as deep ones do when they are tilted."""
    given = scene.release
    if scene.sail.profile != "flat" and scene.beam.intensity_W_m2 > 0:
        tilt = rotation_from_angles(np.radians(given.roll_deg), np.radians(given.pitch_deg), 0.0)
        check_shadow(sail_mesh(scene.sail), tilt, f"{scene.name}.yaml: release.pitch_deg, roll_deg")
