"""Rigid and flexible flight of each scene: path across the beam, tilt and temperature against time."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.arrays import Floats
from beamrider.io.files import run_stage
from workflow.figures.drawing import BLUE, GREEN, ORANGE, RED, named, parser, read_series, save

Series = dict[str, Floats]
MODELS = (("rigid", BLUE, 1.8), ("flexible", ORANGE, 0.8))


def _span(flights: dict[str, Series]) -> tuple[float, float]:
    """From release to the end of the shorter flight; all there is where none lived to be released."""
    ends = [series["time"][-1] for series in flights.values()]
    released = [end for end in ends if end >= 0]
    return (0.0, min(released)) if released else (min(series["time"][0] for series in flights.values()), max(ends))


def _path(axes: Axes, flights: dict[str, Series], span: tuple[float, float]) -> None:
    for name, colour, width in MODELS:
        if name in flights:
            time, position = flights[name]["time"], flights[name]["position"] * 100
            shown = (time >= span[0]) & (time <= span[1])
            if time[-1] > span[1]:
                label = f"{name}, to {time[-1]:.3g} s"
                axes.plot(*position[time >= span[1], :2].T, color=colour, lw=0.4, alpha=0.4, label=label)
            label = f"{name}, to {min(time[-1], span[1]):.3g} s"
            axes.plot(*position[shown, :2].T, color=colour, lw=width, label=label)
            axes.plot(*position[shown][:1, :2].T, "k+", ms=9)
    axes.set(xlabel="x (cm)", ylabel="y (cm)", aspect="equal")
    axes.set_adjustable("datalim")
    axes.legend()


def _tilt(axes: Axes, flights: dict[str, Series], angle: str, span: tuple[float, float]) -> None:
    for name, colour, width in MODELS:
        if name in flights:
            shown = (flights[name]["time"] >= span[0]) & (flights[name]["time"] <= span[1])
            degrees = np.degrees(flights[name][angle][shown])
            axes.plot(flights[name]["time"][shown], degrees, color=colour, lw=width, label=name)
    axes.set(xlabel="time since release (s)", ylabel=f"{angle} (°)")
    if span[0] < span[1]:
        axes.set_xlim(*span)


def _temperature(axes: Axes, flexible: Series | None) -> None:
    if flexible is None:
        axes.set_axis_off()
        return
    for name, colour, label in (("temperature_max", RED, "hottest"), ("temperature_mean", GREEN, "mean")):
        axes.plot(flexible["time"], flexible[name], color=colour, label=label)
    axes.set(xlabel="time since release (s)", ylabel="temperature (K)")
    axes.legend()


def draw(scenes: dict[str, dict[str, Series]]) -> Figure:
    """A column a scene: path, pitch, roll, temperature. The time axes end with the shorter of the two flights."""
    size = (5.2 * len(scenes), 11)
    figure, grid = plt.subplots(4, len(scenes), figsize=size, squeeze=False, height_ratios=[2, 1, 1, 1])
    for column, (scene, flights) in zip(grid.T, scenes.items(), strict=True):
        span = _span(flights)
        column[0].set_title(scene)
        _path(column[0], flights, span)
        _tilt(column[1], flights, "pitch", span)
        _tilt(column[2], flights, "roll", span)
        _temperature(column[3], flights.get("flexible"))
    return figure


def main() -> None:
    """Draw the flights of several scenes."""
    arguments = parser(__doc__)
    arguments.add_argument("--rigid", nargs="*", default=[], type=named, help="NAME=rigid.h5 of each scene")
    arguments.add_argument("--flexible", nargs="*", default=[], type=named, help="NAME=flight.vtkhdf of each scene")
    given = arguments.parse_args()
    scenes: dict[str, dict[str, Series]] = {}
    for model, pairs in (("rigid", given.rigid), ("flexible", given.flexible)):
        for name, path in pairs:
            scenes.setdefault(name, {})[model] = read_series(path)
    save(draw(scenes), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
