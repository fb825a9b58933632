"""Basin maps side by side: time to the loss above, largest distance of the bounded flights below."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.io.files import InputError, reading, run_stage
from beamrider.io.hdf5 import read_hdf5
from dynamics.light.beam import Beam
from workflow.figures.drawing import parser, save

TITLES = {"sail_frame": "incidence seen by the sail", "yaw_blind": "incidence of the paper, blind to yaw"}


def read(path: Path) -> dict[str, Any]:
    """Datasets of a whole map, and its scene and grid; InputError where it is none."""
    with reading(path, "a readable basin map"), read_hdf5(path) as file:
        data = {name: item[()] for name, item in file.items()}
        data |= {name: json.loads(file.attrs[name]) for name in ("scene", "grid", "reasons")}
    if data["end_time"].ndim != 2:
        raise InputError(f"{path}: one part of a basin map; give the map")
    return data


def _panel(axes: Axes, data: dict[str, Any], values: Any, label: str, most: float, colours: str) -> None:
    """One map: tilt along, offset up; what has no value stays grey."""
    axes.set_facecolor("0.85")
    image = axes.pcolormesh(
        np.degrees(data["tilt"]), 100 * data["offset"], values, cmap=colours, vmin=0, vmax=most, rasterized=True
    )
    axes.figure.colorbar(image, ax=axes, label=label)
    _release(axes, data)
    axes.set(xlabel="tilt (°)", ylabel="offset (cm)")
    axes.grid(False)


def _release(axes: Axes, data: dict[str, Any]) -> None:
    """A cross at the scene's own release, where it lies on the map."""
    release, grid = data["scene"]["release"], data["grid"]
    towards = np.radians(grid["tilt_direction_deg"])
    tilt = release["pitch_deg"] * np.cos(towards) + release["roll_deg"] * np.sin(towards)
    axes.plot(tilt, 100 * np.hypot(*release["offset_m"]), "k+", ms=9, mew=1.5)


def draw(maps: list[dict[str, Any]], names: list[str]) -> Figure:
    """A column a map, under the names of their scenes."""
    figure, grid = plt.subplots(2, len(maps), figsize=(5.2 * len(maps), 7.5), squeeze=False)
    for (top, bottom), data, name in zip(grid.T, maps, names, strict=True):
        bounded = data["end_code"] == data["reasons"].index("finished")
        share = 100 * bounded.mean()
        top.set_title(f"{name}, {TITLES[data['scene']['incidence']]}: {share:.0f} % bounded")
        lost: Any = np.ma.masked_array(data["end_time"], bounded)
        _panel(top, data, lost, "time to the loss (s), grey: bounded", data["grid"]["duration_s"], "viridis")
        distance: Any = np.ma.masked_array(100 * data["distance_max"], ~bounded)
        limit = 100 * (data["grid"]["limit_m"] or Beam.model_validate(data["scene"]["beam"]).reach_m)
        _panel(bottom, data, distance, "largest distance (cm), grey: lost", limit, "magma_r")
    return figure


def main() -> None:
    """Draw basin maps of a scene."""
    arguments = parser(__doc__)
    arguments.add_argument("--maps", nargs="+", required=True, type=Path, help="files of dynamics.basin")
    arguments.add_argument("--names", nargs="*", help="names to show (default: those of their scenes)")
    given = arguments.parse_args()
    maps = [read(path) for path in given.maps]
    names = given.names or [data["scene"]["name"] for data in maps]
    if len(names) != len(maps):
        raise InputError(f"--names: {len(names)} names; must be one for each of the {len(maps)} maps")
    save(draw(maps, names), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
