"""Force and torque maps of a rigid sail at rest on its beam at yaw 0, normalised.

    python -m dynamics.maps --scene workflow/scenes/fig6.yaml --tables te.h5 tm.h5 --out maps.h5

F_x over (x, pitch) and F_y over (y, roll), total force in lab components in units of I₀D²/c; τ_y over pitch and τ_x
over roll at the beam's centre, in body components and units of I₀D³/c (Gao, Kelzenberg & Atwater, Fig. 5C–E). Where the
light comes from outside a table the value is NaN.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.arguments import stage_arguments
from beamrider.io.files import InputError, finish, versions
from beamrider.io.hdf5 import new_hdf5
from beamrider.machine_code.notice import compiling
from dynamics.rigid.body import RigidBody, rigid_body
from dynamics.rigid.equations import INSIDE
from dynamics.sail.attitude import rotation_from_angles
from dynamics.sail.sectors import load_tables, provenance
from dynamics.sail.table_error import TableErrors, rigid_errors
from dynamics.scene import schema as scenes
from optics.table.pressure_table import PressureTable

SHIFT = np.linspace(-0.4, 0.4, 81)
TILT = np.radians(np.linspace(-10.0, 10.0, 81))


@dataclass(frozen=True)
class Maps:
    """Normalised maps: shift (n,) in diameters, tilt (m,) in rad, F_x, F_y (n, m), tau_x, tau_y (m,).

    F_x belongs to shifts along x and to pitch, F_y to shifts along y and to roll, as do tau_y and tau_x.
    """

    shift: Floats
    tilt: Floats
    F_x: Floats
    F_y: Floats
    tau_x: Floats
    tau_y: Floats


def normalised_load(body: RigidBody, x: float = 0.0, y: float = 0.0, roll: float = 0.0, pitch: float = 0.0) -> Floats:
    """Force in the lab and torque in the body (6,) at a lateral position in diameters and a tilt in rad at yaw 0."""
    turn = rotation_from_angles(roll, pitch, 0.0)
    force, torque, flag = body.load(np.array([x, y, 0.0]) * body.units.length, turn)
    if flag != INSIDE:
        return np.full(6, np.nan)
    return np.concatenate([force / body.units.force, torque / body.units.torque])


def make_maps(
    scene: scenes.Scene, tables: dict[str, PressureTable], shift: Floats = SHIFT, tilt: Floats = TILT
) -> Maps:
    """The maps of a scene's sail over shifts (n,), in D, and tilts (m,) in rad; InputError without light."""
    if scene.beam.intensity_W_m2 == 0.0:
        raise InputError(f"{scene.name}.yaml: beam.intensity_W_m2 = 0: must be above 0 for maps of force and torque")
    body = rigid_body(scene, tables)
    along_x = np.array([[normalised_load(body, x=s, pitch=t) for t in tilt] for s in shift])
    along_y = np.array([[normalised_load(body, y=s, roll=t) for t in tilt] for s in shift])
    tau_x = np.array([normalised_load(body, roll=t)[3] for t in tilt])
    tau_y = np.array([normalised_load(body, pitch=t)[4] for t in tilt])
    return Maps(shift, tilt, along_x[..., 0], along_y[..., 1], tau_x, tau_y)


def equilibria(shift: Floats, force: Floats) -> Floats:
    """Shifts (k,) where a force (n,) vanishes and restores, its slope negative, by linear interpolation."""
    down = np.flatnonzero((force[:-1] > 0.0) & (force[1:] <= 0.0))
    share = force[down] / (force[down] - force[down + 1])
    return np.asarray(shift[down] + share * (shift[down + 1] - shift[down]))


def map_errors(tilt: Floats, scene: scenes.Scene, tables: dict[str, PressureTable]) -> TableErrors:
    """What the tables' stated errors come to on a sail at the beam's centre, pitched and rolled by tilt (m,) in rad."""
    turns = np.array([turn for t in tilt for turn in (rotation_from_angles(t, 0, 0), rotation_from_angles(0, t, 0))])
    return rigid_errors(scene, tables, np.zeros((len(turns), 3)), turns)


def write(path: str | Path, maps: Maps, scene: scenes.Scene, tables: dict[str, PressureTable]) -> TableErrors:
    """Write the maps as HDF5, atomically: one dataset a quantity, its unit an attribute; the scene as JSON.

    Returns what the tables' stated errors come to, which the file says too.
    """
    met = map_errors(maps.tilt, scene, tables)
    unit = {"shift": "D", "tilt": "rad", "F_x": "I₀D²/c", "F_y": "I₀D²/c", "tau_x": "I₀D³/c", "tau_y": "I₀D³/c"}
    with new_hdf5(path) as file:
        for name, values in vars(maps).items():
            file.create_dataset(name, data=values).attrs["units"] = unit[name]
        file.attrs.update(
            {
                "scene": scene.model_dump_json(),
                "tables": json.dumps(provenance(tables)),
                "versions": json.dumps(versions("numpy", "numba")),
                **met.attributes(),
            }
        )
    return met


def main() -> None:
    """Map force and torque on the sail of a scene."""
    arguments = stage_arguments("dynamics.maps", main.__doc__, "HDF5 file to write")
    scene = scenes.read_scene(arguments.scene)
    tables = load_tables(arguments.tables, scene)
    with compiling("10 s"):
        maps = make_maps(scene, tables)
    met = write(arguments.out, maps, scene, tables)
    outside = int(np.isnan(maps.F_x).sum() + np.isnan(maps.F_y).sum())
    places = maps.F_x.size + maps.F_y.size
    finish(arguments.out, arguments.watch, f"{places} places of force, {outside} outside a table", [met.text])
