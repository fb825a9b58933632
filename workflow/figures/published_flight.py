"""A published flight as in the paper's panels: path, distance, speed, tilt, temperature, strain, and four snapshots."""

from __future__ import annotations

import sys
from pathlib import Path

# The list of published flights lies beside this folder
sys.path.append(str(Path(__file__).parents[1]))

from drawing import BLUE, GREEN, ORANGE, PURPLE, RED, Floats, named, np, parser, plt, read_series, save
from flown import Flown, outcome, read
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
from published import Expected, PublishedFlight, read_published
from snapshots import Snapshot
from snapshots import read as read_snapshots

from optics.files import run_stage

Columns = tuple[tuple[str, float, str | None], ...]

POINTS = 20_000
COLOURS = {"modal": BLUE, "published": ORANGE}
GREY = "0.6"
TEMPERATURES = {"max": RED, "mean": GREEN, "min": PURPLE}
#: Panels of series: quantity on the axis, its columns with factor and colour, labels.
PANELS = (
    ("pitch (°)", (("pitch", 57.29578, None),)), ("roll (°)", (("roll", 57.29578, None),)),
    ("temperature (K)", tuple((f"temperature_{name}", 1.0, colour) for name, colour in TEMPERATURES.items())),
    ("largest strain (%)", (("strain_max", 100.0, None),)),
)
PEAKS = {"peak temperature": ("temperature (K)", 1.0), "largest strain": ("largest strain (%)", 100.0)}
ROWS = {"temperature_max": ("temperature (K)", 1.0), "temperature_mean": ("temperature (K)", 1.0),
        "strain_max": ("largest strain (%)", 100.0)}


def _thin(series: dict[str, Floats]) -> dict[str, Floats]:
    every = max(1, series["time"].size // POINTS)
    return {name: values[::every] for name, values in series.items()}


def _path(axes: Axes, flights: dict[str, Flown], rigid: dict[str, Floats] | None) -> None:
    if rigid is not None:
        axes.plot(*rigid["position"][:, :2].T * 100, color=GREY, lw=0.8, label="rigid", rasterized=True)
    for name, flight in flights.items():
        position = _thin(flight.released)["position"] * 100
        axes.plot(*position[:, :2].T, color=COLOURS[name], lw=0.8, label=f"flexible, {name} tables", rasterized=True)
        axes.plot(*position[:1, :2].T, "k+", ms=9)
    axes.plot(0, 0, "x", color="magenta")
    axes.set(xlabel="x (cm)", ylabel="y (cm)", aspect="equal")
    axes.set_adjustable("datalim")
    axes.legend()


def _distance(axes: Axes, flights: dict[str, Flown]) -> None:
    for name, flight in flights.items():
        series = _thin(flight.released)
        x, y = series["position"][:, :2].T * 100
        for values, style, label in ((np.hypot(x, y), "-", "r"), (x, "--", "x"), (y, ":", "y")):
            axes.plot(series["time"], values, style, color=COLOURS[name], lw=0.8, label=label, rasterized=True)
    axes.set(xlabel="time since release (s)", ylabel="from the beam's axis (cm)")
    axes.legend(*(part[:3] for part in axes.get_legend_handles_labels()), ncols=3)


def _speed(axes: Axes, flights: dict[str, Flown]) -> None:
    for name, flight in flights.items():
        series = _thin(flight.released)
        axes.plot(series["time"], series["velocity"][:, 2], color=COLOURS[name], rasterized=True)
    axes.set(xlabel="time since release (s)", ylabel="speed along the beam (m/s)")


def _series(axes: Axes, label: str, columns: Columns, flights: dict[str, Flown]) -> None:
    for i, (name, flight) in enumerate(flights.items()):
        series = _thin(flight.released)
        for column, factor, colour in columns:
            axes.plot(series["time"], series[column] * factor, "-" if i == 0 else "--", color=colour or COLOURS[name],
                      lw=0.8, label=column.removeprefix("temperature_") if len(columns) > 1 else None, rasterized=True)
    axes.set(xlabel="time since release (s)", ylabel=label)
    if len(columns) > 1:
        axes.legend(*(part[: len(columns)] for part in axes.get_legend_handles_labels()))


def _paper(panels: dict[str, Axes], expected: list[Expected]) -> None:
    """Published numbers: lines for peaks, circles for values at a time."""
    for entry in expected:
        if not isinstance(entry.paper, float):
            continue
        if entry.at_s is None and entry.quantity in PEAKS:
            label, factor = PEAKS[entry.quantity]
            panels[label].axhline(entry.paper * factor, color="black", ls="--", lw=0.8)
        elif entry.at_s is not None and entry.quantity in ROWS:
            label, factor = ROWS[entry.quantity]
            panels[label].plot(entry.at_s, entry.paper * factor, "ko", ms=4, mfc="none")


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
    axes.set_title(f"{snapshot.time:.3g} s at ({x * 100:.2g}, {y * 100:.2g}) cm, {round(z, 6) + 0.0:.3g} m", fontsize=8)
    return faces


def _sails(figure: Figure, row: int, path: Path) -> None:
    sails = read_snapshots(path)
    temperature = np.concatenate([sail.temperature for sail in sails])
    reach = 100 * max(np.abs(sails[0].points - sails[0].points.mean(axis=0)).max(), 0.05)
    every = [figure.add_subplot(3, 4, 4 * row + 1 + i, projection="3d") for i in range(len(sails))]
    for axes, sail in zip(every, sails, strict=True):
        faces = _sail(axes, sail, temperature.min(), max(temperature.max(), temperature.min() + 1.0), reach)
    figure.colorbar(faces, ax=every, label="temperature (K)", shrink=0.8)


def _notes(axes: Axes, flights: dict[str, Flown], published: PublishedFlight) -> None:
    """In words: what became of each flight, and what the paper says."""
    lines = [
        f"{published.figure}, {flight.scene.sail.rings} rings, {source} tables:\n" + outcome(flight).replace(", ", "\n")
        for source, flight in flights.items()
    ]
    says = [f"{entry.quantity}: {entry.paper}" for entry in published.expected if entry.at_s is None]
    axes.text(0, 1, "\n\n".join([*lines, *(["\n".join(["paper:", *says])] if says else [])]), va="top", fontsize=9)
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
    _paper(panels, published.expected)
    _notes(notes, flights, published)
    _sails(figure, 2, next(iter(paths.values())))
    figure.suptitle(f"{name} · black dashes and circles: published numbers")
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
