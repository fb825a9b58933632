"""Snapshots of the flexible sail, seen along the beam: temperature, and distance from the best-fitting plane."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from beamrider.arrays import Floats
from beamrider.io.files import reading, run_stage
from beamrider.io.hdf5 import read_hdf5
from workflow.figures.drawing import parser, save

COUNT = 4


@dataclass(frozen=True)
class Snapshot:
    """The sail at `time` (s): points (n, 3) in m, triangles (m, 3) that are left, their temperature (m,) in K."""

    time: float
    points: Floats
    triangles: np.ndarray
    temperature: Floats

    @property
    def deviation(self) -> Floats:
        """Distance (n,) in m of the points from the plane that fits them best (the third singular vector)."""
        centred = self.points - self.points.mean(axis=0)
        normal = np.linalg.svd(centred, full_matrices=False)[2][2]
        return centred @ (normal * np.sign(normal[2]))


def read(path: Path) -> list[Snapshot]:
    """COUNT snapshots from release, or from the start if it never came, to the end of a transient VTKHDF grid."""
    with reading(path, "a readable flight"), read_hdf5(path) as file:
        grid = file["VTKHDF"]
        steps, cells = grid["Steps"], grid["CellData/temperature"]
        times = steps["Values"][()]
        released = np.flatnonzero(times >= 0) if times[-1] >= 0 else np.arange(times.size)
        chosen = np.unique(released[np.linspace(0, released.size - 1, COUNT).round().astype(int)])
        n, m = int(grid["NumberOfPoints"][0]), int(grid["NumberOfCells"][0])
        triangles = grid["Connectivity"][: 3 * m].reshape(m, 3)
        starts = [(int(steps["PointOffsets"][i]), int(steps["CellDataOffsets/temperature"][i])) for i in chosen]
        # What has been removed has no strain; what has failed and was only recorded is still there.
        left = [~np.isnan(grid["CellData/strain"][c : c + m]) for _, c in starts]
        return [
            Snapshot(times[i], grid["Points"][p : p + n], triangles[kept], cells[c : c + m][kept])
            for i, (p, c), kept in zip(chosen, starts, left, strict=True)
        ]


def _row(axes: np.ndarray, sails: list[Snapshot], values: list[Floats], label: str, **style: Any) -> None:
    for one, sail, value in zip(axes, sails, values, strict=True):
        x, y = (sail.points[:, :2] - sail.points[:, :2].mean(axis=0)).T * 100
        image = one.tripcolor(Triangulation(x, y, sail.triangles), value, rasterized=True, **style)
        one.set_aspect("equal")
        one.grid(False)
    axes[0].figure.colorbar(image, ax=axes, label=label)
    axes[0].set_ylabel("y from the centre (cm)")


def draw(name: str, sails: list[Snapshot]) -> Figure:
    """Two rows, temperature and deviation from a plane, each on one scale; a column a time."""
    size = (2.9 * len(sails) + 1, 6)
    figure, (hot, bent) = plt.subplots(2, len(sails), figsize=size, sharex=True, sharey=True, squeeze=False)
    temperature = [sail.temperature for sail in sails]
    low, high = min(t.min() for t in temperature), max(t.max() for t in temperature)
    _row(hot, sails, temperature, "temperature (K)", cmap="inferno", vmin=low, vmax=high)
    deviation = [sail.deviation * 1e3 for sail in sails]
    most = max(np.abs(d).max() for d in deviation) or 1.0
    style = {"cmap": "PuOr", "vmin": -most, "vmax": most, "shading": "gouraud"}
    _row(bent, sails, deviation, "from the best-fitting plane (mm)", **style)
    for top, bottom, sail in zip(hot, bent, sails, strict=True):
        top.set_title(f"t = {sail.time:.4g} s, z = {round(sail.points[:, 2].mean(), 6) + 0.0:.4g} m")
        bottom.set_xlabel("x from the centre (cm)")
    figure.suptitle(f"{name}: the sail seen along the beam")
    return figure


def main() -> None:
    """Draw snapshots of one flight."""
    arguments = parser(__doc__)
    arguments.add_argument("--flight", required=True, type=Path, help="flight.vtkhdf")
    arguments.add_argument("--name", required=True, help="scene, for the title")
    given = arguments.parse_args()
    save(draw(given.name, read(given.flight)), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
