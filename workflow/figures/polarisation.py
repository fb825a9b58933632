"""Does the sail lock to the beam's polarisation by itself? Spin torque against its angle, and flights without lock.

Spin torque: of the sail displaced, tilted, and both, against the angle a between the beam's polarisation and the one
that the cells are made for. Its mean over the azimuths of offset and tilt, each for itself, is odd in a, because the
sail has mirror planes, and of period 180°: K sin 2a. With K > 0 the sail is turned after the polarisation and would
swing about it once in 2π √(I_z/2K). What the torque is at one azimuth, its root mean square, pulls either way.
Flights: beams whose polarisation turns with the sail, at the spin of release or near it, and stays in the lab.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.arrays import Floats
from beamrider.io.files import atomic, run_stage
from dynamics.rigid import stage as rigid
from dynamics.rigid.body import rigid_body
from dynamics.sail.attitude import rotation_from_angles
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from optics.table.pressure_table import PressureTable
from workflow.figures.drawing import COLOURS, parser, save

Tables = dict[str, PressureTable]
NOMINAL = 90.0  # the cells are made for E along body y
ANGLES = np.arange(0.0, 180.0, 15.0)
AZIMUTHS = np.radians(np.arange(0.0, 360.0, 15.0))
POSES = {
    "5 cm off, level": (0.05, 0.0),
    "centred, 2° tilt": (0.0, 2.0),
    "5 cm off, 2° tilt": (0.05, 2.0),
    "5 cm off, 4° tilt": (0.05, 4.0),
}
NEAR = 0.02  # Hz off the spin of release
DURATION = 15.0  # s, for slow slips to show
START = 30.0  # degrees between the sail and the polarisation at release, for one that does not start aligned


def altered(scene: Scene, **beam: Any) -> Scene:
    """The scene with other settings of its beam."""
    return Scene.model_validate({**scene.model_dump(), "beam": {**scene.beam.model_dump(), **beam}})


def spin_torque(scene: Scene, tables: Tables, angle: float, offset: float, tilt: float) -> Floats:
    """Torque (n, m) in N m about the sail's normal at azimuths of offset and of tilt; E at `angle` ° from body x.

    Half a turn of both leaves the sail as it is, so that offsets of half a turn suffice.
    """
    body = rigid_body(altered(scene, polarisation="lab", polarisation_deg=angle), tables)
    out = []
    for along in AZIMUTHS[: AZIMUTHS.size // 2]:
        place = offset * np.array([np.cos(along), np.sin(along), 0.0])
        for towards in AZIMUTHS:
            roll, pitch = np.radians(tilt) * np.array([np.cos(towards), np.sin(towards)])
            out.append(body.load(place, rotation_from_angles(roll, pitch, 0.0))[1][2])
    return np.array(out).reshape(-1, AZIMUTHS.size)


@dataclass(frozen=True)
class Beam:
    """How a beam's polarisation turns: at `hertz` in the lab (None: with the sail), at release `start` degrees off."""

    hertz: float | None
    start: float = 0.0

    def scene(self, base: Scene) -> Scene:
        """The base scene on this beam."""
        if self.hertz is None:
            return base
        return altered(base, polarisation="turning", polarisation_deg=NOMINAL + self.start, polarisation_Hz=self.hertz)

    def angle(self, flight: rigid.RigidFlight) -> Floats:
        """Angle (n,) in degrees by which the polarisation is ahead of the sail's own."""
        if self.hertz is None:
            return np.zeros(flight.time.size)
        turned = 2.0 * np.pi * self.hertz * flight.time - flight.angles[2]
        return self.start + np.degrees(np.unwrap(turned))


def beams(spin: float) -> dict[str, Beam]:
    """The beams that are flown, by name."""
    return {
        "with the sail": Beam(None),
        f"at {spin:g} Hz, as the sail at release": Beam(spin),
        f"the same, {START:g}° ahead at release": Beam(spin, START),
        f"at {spin + NEAR:g} Hz": Beam(spin + NEAR),
        f"at {spin - NEAR:g} Hz": Beam(spin - NEAR),
        "fixed in the lab": Beam(0.0),
    }


def _torques(axes: Axes, scene: Scene, tables: Tables) -> list[list[str]]:
    """Torque curves; lines of the table: mean torque K, root mean square at one azimuth, period of the swing."""
    inertia, lines = rigid_body(scene, tables).shape.inertia[2, 2], []
    fine = np.linspace(0.0, 180.0, 181)
    for (name, pose), colour in zip(POSES.items(), COLOURS, strict=False):
        torque = np.array([spin_torque(scene, tables, NOMINAL + a, *pose) for a in ANGLES])
        mean, rms = torque.mean(axis=(1, 2)), float(np.sqrt((torque**2).mean()))
        amplitude = 2.0 * float((mean * np.sin(2.0 * np.radians(ANGLES))).mean())
        axes.plot(ANGLES, 1e9 * mean, "o", color=colour, ms=4)
        axes.plot(
            fine,
            1e9 * amplitude * np.sin(2.0 * np.radians(fine)),
            color=colour,
            label=f"{name}; at one azimuth {1e9 * rms:,.0f}",
        )
        period = 2.0 * np.pi * np.sqrt(inertia / (2.0 * amplitude)) if amplitude > 1e-6 * rms else np.inf
        lines.append([name, *(f"{x:.3g}" for x in (amplitude, rms, period))])
    axes.axhline(0.0, color="0.3", lw=0.8)
    axes.set(xlabel="polarisation ahead of the sail's own (°)", ylabel="mean spin torque (10⁻⁹ N m)")
    axes.set_title("mean over azimuth; above 0 where the sail is turned after the light")
    axes.legend(loc="lower left")
    return lines


def _flights(distance: Axes, angle: Axes, scene: Scene, tables: Tables) -> list[list[str]]:
    """Distance from the axis, and angle between polarisation and sail; lines of the table."""
    lines = []
    rigid_part = scene.rigid.model_copy(update={"duration_s": DURATION})
    longer = altered(scene.model_copy(update={"rigid": rigid_part}), on_s=DURATION)
    for (name, beam), colour in zip(beams(scene.release.spin_Hz).items(), COLOURS, strict=False):
        flight = rigid.fly(beam.scene(longer), tables)
        off, ahead = np.hypot(*flight.position[:, :2].T), beam.angle(flight)
        lost = flight.end_reason != "finished"
        distance.plot(flight.time, 100 * off, color=colour, lw=0.7)
        label = f"{name}{f': lost at {flight.time[-1]:.1f} s' if lost else ': stays'}"
        shown = slice(0 if beam.hertz == 0.0 else None)  # fixed in the lab: off the scale at once, in the legend alone
        angle.plot(flight.time[shown], ahead[shown], color=colour, label=label)
        numbers = (flight.time[-1], off.max(), flight.spin[-1], ahead[-1])
        lines.append([name, flight.end_reason, *(f"{x:.6g}" for x in numbers)])
    distance.set(xlabel="time (s)", ylabel="distance from the axis (cm)", title=f"flights of {scene.name}")
    distance.set_ylim(0.0, 80.0)
    angle.legend(title="polarisation turns", loc="upper right")
    angle.set(xlabel="time (s)", ylabel="polarisation ahead of the sail's own (°)", title="locked would be at 0")
    angle.axhline(0.0, color="0.3", lw=0.8)
    low, high = angle.get_ylim()
    angle.set_ylim(low, high + 0.6 * (high - low))  # room for the legend
    return lines


TORQUES = ["pose", "mean_torque_K_N_m", "rms_torque_N_m", "swing_period_s"]
FLIGHTS = ["polarisation_turns", "end", "time_s", "largest_distance_m", "spin_at_end_Hz", "polarisation_ahead_deg"]


def draw(scene: Scene, tables: Tables) -> tuple[Figure, list[list[str]]]:
    """Torque curves on the left; distance from the axis and angle from the polarisation of the flights; all numbers."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(15, 4.5))
    torques = _torques(left, scene, tables)
    return figure, [TORQUES, *torques, FLIGHTS, *_flights(middle, right, scene, tables)]


def main() -> None:
    """Draw, and write the numbers."""
    arguments = parser(__doc__)
    arguments.add_argument("--scene", required=True, type=Path)
    arguments.add_argument("--tables", required=True, nargs="+", type=Path, help="modal tables, of all polarisations")
    arguments.add_argument("--csv", required=True, type=Path, help="numbers to write")
    given = arguments.parse_args()
    scene = read_scene(given.scene)
    figure, lines = draw(scene, load_tables(given.tables, scene))
    with atomic(given.csv) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(lines)
    save(figure, given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
