"""Does the sail lock to the beam's polarisation by itself? Spin torque against its angle, and flights without lock.

Spin torque: of the sail level and centred, displaced, tilted, and both, averaged over the azimuth of that pose, against
the angle from the polarisation that the cells are made for. A lock would need a torque that turns the sail back.
Flights: beams whose polarisation turns with the sail, at the sail's rate from release, and stays in the lab.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drawing import BLUE, COLOURS, Floats, np, parser, plt, save
from matplotlib.figure import Figure

from dynamics import rigid
from dynamics.attitude import rotation_from_angles
from dynamics.rigid_body import rigid_body
from dynamics.scene import Scene, read_scene
from optics.cells import read_metagrating
from optics.files import run_stage
from optics.modal import solve
from optics.table import PressureTable

Tables = dict[str, PressureTable]
ORDERS = 16  # q to 2e-3 here: the question is of signs and sizes
U, V = np.linspace(-0.3, 0.3, 121), np.linspace(0.0, 0.3, 31)
NOMINAL = 90.0  # the cells are made for E along body y
AZIMUTHS = np.arange(0.0, 360.0, 15.0)
POSES = {"centred, level": (0.0, 0.0), "5 cm off, level": (0.05, 0.0), "centred, 2° tilt": (0.0, 2.0),
         "5 cm off, 2° tilt": (0.05, 2.0)}


def stokes_table(cell_file: Path) -> PressureTable:
    """Modal table of all polarisations; `q` is for that of the cell."""
    cell = read_metagrating(cell_file)
    found = solve(cell, U, V, ORDERS)
    return PressureTable(
        U, V, np.moveaxis(found.q, -1, 0), found.absorptance, np.full((U.size, V.size), 2e-3), mirror_v=True,
        attrs={"name": cell.name}, q_stokes=np.moveaxis(found.q_stokes, (2, 3), (0, 1)),
        absorptance_stokes=np.moveaxis(found.absorptance_stokes, 2, 0),
    )


def altered(scene: Scene, **beam: Any) -> Scene:
    """The scene with other settings of its beam."""
    return Scene.model_validate({**scene.model_dump(), "beam": {**scene.beam.model_dump(), **beam}})


def spin_torque(scene: Scene, tables: Tables, angle: float, offset: float, tilt: float) -> Floats:
    """Torque (n,) in N m about the sail's normal at each azimuth of the pose; E at `angle` in degrees from body x."""
    out = []
    for azimuth in np.radians(AZIMUTHS):
        place = offset * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        roll, pitch = np.radians(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
        body = rigid_body(altered(scene, polarisation="lab", polarisation_deg=angle), tables)
        out.append(body.load(place, rotation_from_angles(roll, pitch, 0.0))[1][2])
    return np.array(out)


def fly(scene: Scene, tables: Tables) -> dict[str, rigid.RigidFlight]:
    """Flights by how the beam's polarisation turns; the sail is released with its own along it."""
    spin = scene.release.spin_Hz
    return {
        "with the sail": rigid.fly(scene, tables),
        f"at {spin:g} Hz, as the sail at release": rigid.fly(
            altered(scene, polarisation="turning", polarisation_deg=NOMINAL, polarisation_Hz=spin), tables),
        "fixed in the lab": rigid.fly(altered(scene, polarisation="lab", polarisation_deg=NOMINAL), tables),
    }


def draw(scene: Scene, tables: Tables) -> Figure:
    """Torque curves on the left; distance from the axis and angle between sail and polarisation of the flights."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(15, 4.5))
    angles = np.arange(0.0, 181.0, 15.0)
    scale = scene.beam.intensity_W_m2 / 299792458.0
    for (name, pose), colour in zip(POSES.items(), COLOURS, strict=False):
        torque = np.array([spin_torque(scene, tables, NOMINAL + a, *pose) for a in angles]) / scale
        left.plot(angles, torque.mean(axis=1), color=colour, label=name)
        left.fill_between(angles, torque.min(axis=1), torque.max(axis=1), color=colour, alpha=0.15)
        mean, most = np.abs(torque.mean(axis=1)).max(), np.abs(torque).max()
        print(f"{name}: c/I times the torque within {mean:.2e} m³ on average, {most:.2e} m³ at any azimuth")
    left.set(xlabel="polarisation from the sail's own (°)", ylabel="spin torque × c/I₀ (m³)",
             title="mean over azimuth, and range")
    left.legend()
    rates = {"with the sail": None, "fixed in the lab": 0.0}
    for (name, flight), colour in zip(fly(scene, tables).items(), COLOURS, strict=False):
        middle.plot(flight.time, 100 * np.hypot(*flight.position[:, :2].T), color=colour, label=name)
        rate = rates.get(name, scene.release.spin_Hz)
        turned = np.degrees(np.unwrap(flight.angles[2])) if rate is not None else np.zeros(flight.time.size)
        if rate:
            turned = np.degrees(np.unwrap(flight.angles[2] - 2 * np.pi * rate * flight.time))
            right.plot(flight.time, turned, color=colour, label=name)
        print(f"{name}: {flight.end_reason} at {flight.time[-1]:.4g} s, spin {flight.spin[-1]:.9g} Hz, "
              f"slip {turned[-1]:.4g}°")
    middle.set(xlabel="time (s)", ylabel="distance from the axis (cm)", title=scene.name)
    middle.legend()
    right.set(xlabel="time (s)", ylabel="yaw of the sail from the polarisation (°)", title="does it lock?")
    right.axhline(0.0, color=BLUE, lw=0.5)
    return figure


def main() -> None:
    """Draw, and print the numbers."""
    arguments = parser(__doc__)
    arguments.add_argument("--scene", required=True, type=Path)
    arguments.add_argument("--cells", required=True, nargs="+", type=Path, help="YAML of each design of the scene")
    given = arguments.parse_args()
    scene = read_scene(given.scene)
    tables = {table.name: table for table in map(stokes_table, given.cells)}
    save(draw(scene, {name: tables[name] for name in scene.sail.designs}), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
