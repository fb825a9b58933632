"""Error against time of flexible flights: mesh, time step, scheme, intervals, elasticity and tables, one at a time.

    python -m workflow.benchmarks.accuracy_flight --scene workflow/scenes/fig6.yaml --tables "modal 1e-3=te.h5,tm.h5" \
        "modal 1e-2=te2.h5,tm2.h5" --out accuracy_flight.csv --markdown flight.md --png accuracy_flight.png

The first 50 ms of a flight, with light and heat renewed every 16 steps. Rings are compared with the finest mesh, tables
with the first ones, all else with the same mesh at a quarter of the time step, light and heat renewed in every step.
Errors are the largest over the flight: of the place across the beam, of the peak temperature, of the largest strain
(relative). Seconds are CPU time of one core for a second of flight, its spin-up left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from beamrider.io.files import atomic, progress, run_stage
from dynamics.membrane.build import build
from dynamics.scene.schema import Scene
from workflow.benchmarks.flight_rows import COROTATING, Run, Tables, changed, flown, write_rows

mpl.use("Agg")

DURATION = 0.05
RINGS, FINEST = 10, 30
MESHES = (4, 6, 8, 12, 16, 22)
#: Shares of the default step, itself 0.8 of the bound, and how much finer the reference steps.
STEPS = (1.2, 1.0, 0.5)
FINE = 0.25
SCHEMES = ("semi_implicit_euler", "verlet", "rk4")
#: Steps in s of the co-rotating scheme, which renews light and heat in each of them.
SIZES = (20e-6, 40e-6, 80e-6, 160e-6)
INTERVALS = (1, 4, 16, 64)
ELASTICITY = ("triangles", "van_gelder", "lattice")


class Row(NamedTuple):
    """One measurement: largest errors over the flight, of the path in m, of the peak temperature in K, of strain."""

    knob: str
    setting: str
    error_path_m: float
    error_temperature_K: float
    error_strain: float
    seconds: float


def shortly(scene: Scene, rings: int, **flight: Any) -> Scene:
    """The scene's first moments on another mesh, with other settings of the flight."""
    return changed(scene, rings, DURATION, **{"optics_every": 16, "heat_every": 16, "series_every": 4, **flight})


def row(run: Run, knob: str, setting: str, best: Run) -> Row:
    """The errors against the best flight."""
    errors = run.errors(best)
    return Row(knob, setting, **{name: errors[name] for name in Row._fields if name in errors}, seconds=run.seconds)


def corotating(size: float) -> dict[str, Any]:
    """What semi-implicit steps of that size in s change of the flight."""
    return {**COROTATING, "time_step_s": size, "series_every": 1}


def settings(step: float) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Knob, setting and what they change of the flight, but for rings and tables; `step`: the default one in s."""
    for share in STEPS:
        yield "time step", f"{0.8 * share:.2g} of the bound", {"time_step_s": share * step}
    for scheme in SCHEMES:
        yield "scheme", scheme, {"integrator": scheme}
    for size in SIZES:
        yield "corotating", f"{size * 1e6:g} µs", corotating(size)
    for every in INTERVALS:
        yield "optics every", f"{every} steps", {"optics_every": every}
    for every in INTERVALS:
        yield "heat every", f"{every} steps", {"heat_every": every}
    for stiffness in ELASTICITY:
        yield "elasticity", stiffness, {"stiffness": stiffness}


def rows(scene: Scene, sets: dict[str, Tables]) -> Iterator[Row]:
    """Every knob at every setting."""
    tables = next(iter(sets.values()))
    for first in ({}, corotating(max(SIZES))):
        flown(shortly(scene, 4, **first), tables)  # compiles
    finest = flown(shortly(scene, FINEST), tables)
    for rings in progress(MESHES, "rings"):
        yield row(flown(shortly(scene, rings), tables), "rings", str(rings), finest)
    yield row(finest, "rings", f"{FINEST}", finest)
    step = build(shortly(scene, RINGS), tables).model.dt
    best = flown(shortly(scene, RINGS, time_step_s=FINE * step, optics_every=1, heat_every=1), tables)
    for knob, setting, changes in progress(list(settings(step)), "knobs"):
        yield row(flown(shortly(scene, RINGS, **changes), tables), knob, setting, best)
    default = flown(shortly(scene, RINGS), tables)
    for name, other in list(sets.items())[1:]:
        yield row(flown(shortly(scene, RINGS), other), "tables", name, default)


def markdown(found: list[Row]) -> str:
    """Rows as a table for the README."""
    head = "| knob | setting | path, mm | peak temperature, K | largest strain, % | CPU s per s |"
    lines = [head, "|" + "---|" * 6]
    for row in found:
        errors = (row.error_path_m * 1e3, row.error_temperature_K, row.error_strain * 100)
        cells = ["–" if x == 0.0 else f"{x:.2g}" for x in errors]
        lines.append(f"| {row.knob} | {row.setting} | {' | '.join(cells)} | {row.seconds:.3g} |")
    return "\n".join(lines) + "\n"


TITLES = {
    "time step": "time step, of the bound",
    "corotating": "corotating, step in µs",
    "optics every": "optics every … steps",
    "heat every": "heat every … steps",
}
#: Column of a row, factor and label of what is drawn.
ERRORS = (
    ("error_path_m", 1e3, "place across the beam (mm)"),
    ("error_temperature_K", 1.0, "peak temperature (K)"),
    ("error_strain", 100.0, "largest strain (%)"),
)


def _panel(axes: Axes, points: list[tuple[float, float, str]]) -> None:
    """Errors of one knob against time, (seconds, error, setting) each: a line with labels if settings are numbers."""
    if all(setting[0].isdigit() for _, _, setting in points):
        points = sorted(point for point in points if point[1] > 0.0)
        axes.loglog([x for x, _, _ in points], [y for _, y, _ in points], "o-", linewidth=0.8, markersize=4)
        for k, (x, y, setting) in enumerate(points):
            up = 1 - 2 * (k % 2)
            axes.annotate(
                setting.split()[0],
                (x, y),
                xytext=(0, 5 * up),
                textcoords="offset points",
                ha="center",
                va="bottom" if up > 0 else "top",
                fontsize=8,
            )
    else:
        for (x, y, setting), marker in zip(points, itertools.cycle("os^vD"), strict=False):
            axes.loglog(x, y or np.nan, marker, label=setting, markersize=5, linestyle="none")
    seconds = [x for x, _, _ in points]
    wider = 1.5 * max(1.0, 2.0 / np.sqrt(max(seconds) / min(seconds)))
    axes.set_xlim(min(seconds) / wider, max(seconds) * wider)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, alpha=0.3)


def draw(path: Path, found: list[Row], title: str) -> None:
    """Error against time: a line of panels an error, a column a knob. A setting without error has no point."""
    knobs = list(dict.fromkeys(row.knob for row in found))
    figure, panels = plt.subplots(
        3, len(knobs), figsize=(3 * len(knobs), 9), sharex="col", sharey="row", layout="constrained", squeeze=False
    )
    for line, (name, factor, label) in zip(panels, ERRORS, strict=True):
        for axes, knob in zip(line, knobs, strict=True):
            _panel(axes, [(r.seconds, getattr(r, name) * factor, r.setting) for r in found if r.knob == knob])
        line[0].set(ylabel=f"error of the {label}")
        line[0].margins(y=0.15)
    for axes, knob in zip(panels[0], knobs, strict=True):
        axes.set_title(TITLES.get(knob, knob))
        if axes.get_legend_handles_labels()[1]:
            axes.legend(fontsize=8)
    figure.supxlabel("CPU time of one second of flight (s)")
    figure.suptitle(f"{title}, first {DURATION:g} s; {RINGS} rings but for the first column")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)
    plt.close(figure)


def main() -> None:
    """Measure and write."""
    write_rows(__doc__, rows, markdown, draw)


if __name__ == "__main__":
    run_stage(main)
