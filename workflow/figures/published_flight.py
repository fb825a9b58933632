"""A published flight as in the paper's panels: path, distance, speed, tilt, temperature, strain, and four snapshots."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from beamrider.arrays import Floats
from beamrider.io.files import run_stage
from workflow.figures.drawing import BLUE, GREEN, ORANGE, PURPLE, RED, named, parser, read_series, save
from workflow.figures.flight_result import FlightResult, outcome, read
from workflow.figures.snapshots import Snapshot
from workflow.figures.snapshots import read as read_snapshots
from workflow.published import Expected, PublishedFlight, read_published

Columns = tuple[tuple[str, float, str | None], ...]

POINTS = 20_000
COLOURS = {"modal": BLUE, "published": ORANGE}
GREY = "0.6"
TEMPERATURES = {"max": RED, "mean": GREEN, "min": PURPLE}
#: Panels of series: quantity on the axis, its columns with factor and colour, labels.
PANELS = (
    ("pitch (°)", (("pitch", 57.29578, None),)),
    ("roll (°)", (("roll", 57.29578, None),)),
    ("temperature (K)", tuple((f"temperature_{name}", 1.0, colour) for name, colour in TEMPERATURES.items())),
    ("largest strain (%)", (("strain_max", 100.0, None),)),
)
PEAKS = {"peak temperature": ("temperature (K)", 1.0), "largest strain": ("largest strain (%)", 100.0)}
ROWS = {
    "temperature_max_triangles": ("temperature (K)", 1.0),
    "temperature_mean": ("temperature (K)", 1.0),
    "strain_max": ("largest strain (%)", 100.0),
}


#: Units of the published numbers in words.
UNITS = {
    "largest distance from the axis": " m",
    "largest tilt": "°",
    "peak temperature": " K",
    "highest temperature of the coldest point": " K",
    "speed at the end": " m/s",
}


def _optics(source: str, flown: FlightResult) -> str:
    """What the light does to the sail, in words: only gratings have tables of several sources."""
    solvers = {table["solver"] for table in json.loads(flown.end["tables"]).values()}
    if not solvers:
        return "constant reflectance"
    return "thin film" if solvers == {"thin_film"} else f"{source} tables"


def _unwrapped(angle: Floats) -> Floats:
    """Degrees with a gap where they pass from 180° to −180°."""
    return np.where(np.abs(np.diff(angle, prepend=angle[0])) > 180, np.nan, angle)


def _thin(series: dict[str, Floats]) -> dict[str, Floats]:
    every = max(1, series["time"].size // POINTS)
    return {name: values[::every] for name, values in series.items()}


def _legend(axes: Axes, columns: int) -> None:
    """Above the panel, where it hides nothing."""
    handles, labels = axes.get_legend_handles_labels()
    style: dict[str, Any] = {"frameon": False, "handlelength": 1.5, "columnspacing": 1.0, "borderaxespad": 0.1}
    axes.legend(handles, labels, loc="lower left", bbox_to_anchor=(0, 1), ncols=columns, **style)


def _path(axes: Axes, flights: dict[str, FlightResult], rigid: dict[str, Floats] | None) -> None:
    if rigid is not None:
        flown = rigid["time"] <= max(flight.series["time"][-1] for flight in flights.values())
        axes.plot(*rigid["position"][flown, :2].T * 100, color=GREY, lw=0.8, label="rigid", rasterized=True)
    for name, flight in flights.items():
        position = _thin(flight.released)["position"] * 100
        label = f"flexible, {_optics(name, flight)}"
        axes.plot(*position[:, :2].T, color=COLOURS[name], lw=0.8, label=label, rasterized=True)
        axes.plot(*position[:1, :2].T, "k+", ms=9)
    axes.plot(0, 0, "x", color="magenta")
    axes.set(xlabel="x (cm)", ylabel="y (cm)", aspect="equal")
    axes.set_adjustable("datalim")
    _legend(axes, 1)


def _distance(axes: Axes, flights: dict[str, FlightResult]) -> None:
    """The distance of each flight; x and y, too, where there is but one."""
    for name, flight in flights.items():
        series = _thin(flight.released)
        x, y = series["position"][:, :2].T * 100
        curves = [("r" if len(flights) == 1 else f"r, {name} tables", np.hypot(x, y), COLOURS[name], 1.6)]
        curves += [("x", x, GREEN, 0.8), ("y", y, PURPLE, 0.8)] if len(flights) == 1 else []
        for label, values, colour, width in curves:
            axes.plot(series["time"], values, color=colour, lw=width, label=label, rasterized=True)
    axes.set(xlabel="time since release (s)", ylabel="from the beam's axis (cm)")
    _legend(axes, 3 if len(flights) == 1 else 1)


def _speed(axes: Axes, flights: dict[str, FlightResult]) -> None:
    for name, flight in flights.items():
        series = _thin(flight.released)
        axes.plot(series["time"], series["velocity"][:, 2], color=COLOURS[name], rasterized=True)
    axes.set(xlabel="time since release (s)", ylabel="speed along the beam (m/s)")


def _series(axes: Axes, label: str, columns: Columns, flights: dict[str, FlightResult]) -> None:
    for i, (name, flight) in enumerate(flights.items()):
        series = _thin(flight.released)
        for column, factor, colour in columns:
            values = series[column] * factor
            values = _unwrapped(values) if "°" in label else values
            style: dict[str, Any] = {"ls": "-", "alpha": 1.0} if i == 0 else {"ls": "--", "alpha": 0.7}
            shown = column.removeprefix("temperature_") if len(columns) > 1 and i == 0 else None
            style |= {"color": colour or COLOURS[name], "label": shown}
            axes.plot(series["time"], values, lw=0.8, rasterized=True, **style)
    axes.set(xlabel="time since release (s)", ylabel=label)
    if len(columns) > 1:
        if len(flights) > 1:
            axes.plot([], [], "--", color=GREY, label=f"{list(flights)[1]} tables")
        _legend(axes, 2 if len(flights) > 1 else len(columns))


def _paper(panels: dict[str, Axes], expected: list[Expected]) -> bool:
    """Published numbers, if there are any: lines for peaks, circles for values at a time."""
    drawn = False
    for entry in expected:
        if not isinstance(entry.paper, float):
            continue
        if entry.at_s is None and entry.quantity in PEAKS:
            label, factor = PEAKS[entry.quantity]
            panels[label].axhline(entry.paper * factor, color="black", ls="--", lw=0.8)
            drawn = True
        elif entry.at_s is not None and entry.quantity in ROWS:
            label, factor = ROWS[entry.quantity]
            panels[label].plot(entry.at_s, entry.paper * factor, "ko", ms=4, mfc="none")
            drawn = True
    return drawn


def _digits(value: float) -> str:
    """Three digits, never as a power of ten."""
    return f"{float(f'{value:.3g}'):.10g}"


def _sail(axes: Axes3D, snapshot: Snapshot, low: float, high: float, reach: float) -> Poly3DCollection:
    """The sail in perspective; the beam comes from below."""
    points = (snapshot.points - snapshot.points.mean(axis=0)) * 100
    corners = points[snapshot.triangles]
    faces = Poly3DCollection(corners, cmap="inferno", array=snapshot.temperature, lw=0, rasterized=True)
    faces.set_clim(low, high)
    axes.add_collection3d(faces)
    for name in "xyz":
        axes.set(**{f"{name}lim": (-reach, reach), f"{name}ticklabels": []})
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.view_init(elev=18, azim=-60)
    x, y, z = snapshot.points.mean(axis=0)
    where = ", ".join(_digits(round(100 * value, 1) + 0.0) for value in (x, y))
    axes.set_title(f"{snapshot.time:.3g} s at ({where}) cm, {_digits(round(z, 6) + 0.0)} m", fontsize=8)
    return faces


def _sails(figure: Figure, row: int, path: Path) -> None:
    sails = read_snapshots(path)
    temperature = np.concatenate([sail.temperature for sail in sails])
    reach = 100 * max(np.abs(sails[0].points - sails[0].points.mean(axis=0)).max(), 0.05)
    every = [figure.add_subplot(3, 4, 4 * row + 1 + i, projection="3d") for i in range(len(sails))]
    for axes, sail in zip(every, sails, strict=True):
        faces = _sail(axes, sail, temperature.min(), max(temperature.max(), temperature.min() + 1.0), reach)
    figure.colorbar(faces, ax=every, label=f"temperature (K); boxes {_digits(2 * reach)} cm wide", shrink=0.8)


def _published(entry: Expected) -> str:
    """A published quantity in words, with its unit."""
    if entry.quantity == "largest strain" and isinstance(entry.paper, float):
        return f"largest strain: {100 * entry.paper:g} %"
    value = f"{entry.paper:g}" if isinstance(entry.paper, float) else entry.paper
    return f"{entry.quantity}: {value}{UNITS.get(entry.quantity, '')}"


def _notes(axes: Axes, flights: dict[str, FlightResult], published: PublishedFlight) -> None:
    """In words: what became of each flight, and what the paper says."""
    lines = [
        f"{published.figure}, {flight.scene.sail.rings} rings, {_optics(source, flight)}:\n"
        + outcome(flight).replace(", ", "\n")
        for source, flight in flights.items()
    ]
    says = [_published(entry) for entry in published.expected if entry.at_s is None]
    text = "\n\n".join([*lines, *(["\n".join(["paper:", *says])] if says else [])])
    axes.text(-0.1, 1, text, va="top", fontsize=8.5).set_in_layout(False)
    axes.set_axis_off()


def draw(name: str, paths: dict[str, Path], rigid: dict[str, Floats] | None) -> Figure:
    """Three rows of panels: motion; tilt, temperature and strain; snapshots of the first of the flights."""
    flights = {source: read(path) for source, path in paths.items()}
    # Padding: room for the labels of axes of equal scale
    figure = plt.figure(figsize=(14, 10.5), layout=ConstrainedLayoutEngine(w_pad=0.15))
    path, distance, speed, notes = (figure.add_subplot(3, 4, i) for i in range(1, 5))
    _path(path, flights, rigid)
    _distance(distance, flights)
    _speed(speed, flights)
    panels = {}
    for i, (label, columns) in enumerate(PANELS):
        panels[label] = figure.add_subplot(3, 4, 5 + i)
        _series(panels[label], label, columns, flights)
    published = read_published()[name]
    shown = _paper(panels, published.expected)
    _notes(notes, flights, published)
    _sails(figure, 2, next(iter(paths.values())))
    figure.suptitle(f"{name} · black dashes and circles: published numbers" if shown else name)
    return figure


def main() -> None:
    """Draw one published flight."""
    arguments = parser(__doc__)
    arguments.add_argument("--name", required=True, help="scene")
    arguments.add_argument("--flights", required=True, nargs="+", type=named, help="TABLES=flight.vtkhdf")
    arguments.add_argument("--rigid", type=Path, help="rigid flight of the scene")
    given = arguments.parse_args()
    rigid = read_series(given.rigid) if given.rigid else None
    save(draw(given.name, dict(given.flights), rigid), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
