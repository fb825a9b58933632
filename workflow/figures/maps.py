"""Force and torque maps of the sail on its beam: restoring where force and torque fall through zero at the centre."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.io.files import reading, run_stage
from beamrider.io.hdf5 import read_hdf5
from dynamics.stability.maps import equilibria
from workflow.figures.drawing import BLUE, ORANGE, parser, save

Maps = dict[str, np.ndarray]


def _force(axes: Axes, maps: Maps, axis: str, tilt: str, symbol: str) -> None:
    """F over shift and tilt; the grey line is where it vanishes, black where it restores at a fixed tilt."""
    values, degrees = 1e3 * maps[f"F_{axis}"], np.degrees(maps["tilt"])
    largest = np.nanmax(np.abs(values))
    image = axes.pcolormesh(
        maps["shift"], degrees, values.T, vmin=-largest, vmax=largest, cmap="RdBu_r", shading="gouraud", rasterized=True
    )
    axes.contour(maps["shift"], degrees, values.T, levels=[0.0], colors="0.4", linewidths=1.2)
    found = [(x, t) for t, force in zip(degrees, values.T, strict=True) for x in equilibria(maps["shift"], force)]
    axes.plot(*np.reshape(found, (-1, 2)).T, ".", color="black", ms=3)
    axes.set(xlabel=f"{axis}/D", ylabel=f"{tilt} {symbol} (°)")
    axes.set_title(f"$F_{axis}$({axis}, {symbol}); grey: equilibrium, black: restoring")
    axes.grid(False)
    axes.figure.colorbar(image, ax=axes, label=rf"$F_{axis}$ ($10^{{-3}}\,I_0D^2/c$)")


def draw(maps: Maps, name: str) -> Figure:
    """F_x over x and pitch, F_y over y and roll, and the torques over tilt at the beam's centre."""
    figure, (x, y, torque) = plt.subplots(1, 3, figsize=(13, 3.9))
    _force(x, maps, "x", "pitch", "θ")
    _force(y, maps, "y", "roll", "φ")
    degrees = np.degrees(maps["tilt"])
    torque.plot(degrees, 1e3 * maps["tau_y"], color=BLUE, label=r"$\tau_y$ over pitch θ")
    torque.plot(degrees, 1e3 * maps["tau_x"], color=ORANGE, label=r"$\tau_x$ over roll φ")
    torque.axhline(0.0, color="0.4", lw=0.8)
    torque.set(xlabel="tilt (°)", ylabel=r"$\tau$ ($10^{-3}\,I_0D^3/c$)", title="torque at the beam's centre")
    torque.legend()
    figure.suptitle(f"{name}: rigid sail at rest, yaw 0")
    return figure


def main() -> None:
    """Draw the maps of one scene."""
    arguments = parser(__doc__)
    arguments.add_argument("--maps", required=True, type=Path, help="file of dynamics.maps")
    arguments.add_argument("--name", required=True, help="name of the scene")
    given = arguments.parse_args()
    with reading(given.maps, "a readable map"), read_hdf5(given.maps) as file:
        maps = {name: file[name][()] for name in file}
    save(draw(maps, given.name), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
