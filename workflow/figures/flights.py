"""Rigid and flexible flight of each scene: path across the beam, tilt and temperature against time."""

from __future__ import annotations

from drawing import BLUE, GREEN, ORANGE, RED, Floats, named, np, parser, plt, read_series, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from optics.files import run_stage

Series = dict[str, Floats]
MODELS = (("rigid", BLUE, 1.8), ("flexible", ORANGE, 0.8))


def _path(axes: Axes, flights: dict[str, Series], until: float) -> None:
    for name, colour, width in MODELS:
        if name in flights:
            time, position = flights[name]["time"], flights[name]["position"] * 100
            shown = (time >= 0) & (time <= until)
            if time[-1] > until:
                label = f"{name}, to {time[-1]:.3g} s"
                axes.plot(*position[time >= until, :2].T, color=colour, lw=0.4, alpha=0.4, label=label)
            axes.plot(*position[shown, :2].T, color=colour, lw=width, label=f"{name}, to {until:.3g} s")
            axes.plot(*position[shown][0, :2], "k+", ms=9)
    axes.set(xlabel="x (cm)", ylabel="y (cm)", aspect="equal")
    axes.set_adjustable("datalim")
    axes.legend()


def _tilt(axes: Axes, flights: dict[str, Series], angle: str, until: float) -> None:
    for name, colour, width in MODELS:
        if name in flights:
            shown = (flights[name]["time"] >= 0) & (flights[name]["time"] <= until)
            degrees = np.degrees(flights[name][angle][shown])
            axes.plot(flights[name]["time"][shown], degrees, color=colour, lw=width, label=name)
    axes.set(xlabel="time since release (s)", ylabel=f"{angle} (°)", xlim=(0, until))


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
        until = min(series["time"][-1] for series in flights.values())
        column[0].set_title(scene)
        _path(column[0], flights, until)
        _tilt(column[1], flights, "pitch", until)
        _tilt(column[2], flights, "roll", until)
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
