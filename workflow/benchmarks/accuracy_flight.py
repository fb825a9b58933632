"""Error against time of flexible flights: mesh, time step, scheme, intervals, elasticity and tables, one at a time.

    python workflow/benchmarks/accuracy_flight.py --scene workflow/scenes/fig6.yaml --tables "modal 1e-3=te.h5,tm.h5" \
        "modal 1e-2=te2.h5,tm2.h5" --out accuracy_flight.csv --markdown flight.md --png accuracy_flight.png

The first 50 ms of a flight. Rings are compared with the finest mesh, tables with the first ones, all else with the same
mesh at a quarter of the time step, light and heat renewed in every step. Errors are the largest over the flight: of the
place across the beam, of the peak temperature, of the largest strain (relative). Seconds are CPU time of one core for a
second of flight, spin-up included, without compilation.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from flown_rows import Tables, write_flown

from dynamics.membrane import Flight
from dynamics.model import build
from dynamics.scene import Scene
from optics.files import InputError, atomic, progress, run_stage

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

DURATION = 0.05
RINGS, FINEST = 10, 30
MESHES = (4, 6, 8, 12, 16, 22)
#: Shares of the default step, itself 0.8 of the bound, and how much finer the reference steps.
STEPS = (1.2, 1.0, 0.5)
FINE = 0.25
SCHEMES = ("semi_implicit_euler", "verlet", "rk4")
#: Steps in s of the co-rotating scheme, which renews light and heat in each of them.
COROTATING = (20e-6, 40e-6, 80e-6, 160e-6)
INTERVALS = (1, 4, 16, 64)
ELASTICITY = ("triangles", "van_gelder", "lattice")
TIMES = np.linspace(0.0, DURATION, 401)


class Row(NamedTuple):
    """One measurement: largest errors over the flight, of the path in m, of the peak temperature in K, of strain."""

    knob: str
    setting: str
    error_path_m: float
    error_temperature_K: float
    error_strain: float
    seconds: float


@dataclass(frozen=True)
class Run:
    """x, y (t, 2) in m and the peak temperature (t,) in K at TIMES, the largest strain, CPU seconds a second."""

    path: np.ndarray
    temperature: np.ndarray
    strain: float
    seconds: float

    def row(self, knob: str, setting: str, best: Run) -> Row:
        """The errors against the best flight."""
        path = np.hypot(*(self.path - best.path).T).max()
        temperature = np.abs(self.temperature - best.temperature).max()
        return Row(knob, setting, path, temperature, abs(self.strain / best.strain - 1.0), self.seconds)


def changed(scene: Scene, rings: int, **flight: Any) -> Scene:
    """The scene on another mesh, with other settings of the flight."""
    settings = {"duration_s": DURATION, "snapshot_every_s": DURATION, "series_every": 4, **flight}
    return scene.model_copy(update={
        "sail": scene.sail.model_copy(update={"rings": rings}), "flight": scene.flight.model_copy(update=settings),
    })


def flown(scene: Scene, tables: Tables) -> Run:
    """Fly; InputError where the flight ends before its time."""
    with tempfile.TemporaryDirectory() as folder:
        flight = Flight(scene, tables, Path(folder))
        begin = time.process_time()
        end = flight.fly()
        seconds = time.process_time() - begin
        series = {name: np.array(values) for name, (values, _) in flight.columns().items()}
    if end.reason != "finished":
        raise InputError(f"{scene.name}: ended by {end.reason} at {end.time:.4g} s; nothing to compare")
    path = [np.interp(TIMES, series["time"], series["position"][:, i]) for i in (0, 1)]
    temperature = np.interp(TIMES, series["time"], series["temperature_max"])
    strain = series["strain_max"][series["time"] >= 0].max()
    return Run(np.stack(path, axis=1), temperature, float(strain), seconds / DURATION)


def corotating(size: float) -> dict[str, Any]:
    """What semi-implicit steps of that size in s change of the flight."""
    return {"integrator": "corotating", "time_step_s": size, "optics_every": 1, "heat_every": 1, "series_every": 1}


def settings(step: float) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Knob, setting and what they change of the flight, but for rings and tables; `step`: the default one in s."""
    for share in STEPS:
        yield "time step", f"{0.8 * share:.2g} of the bound", {"time_step_s": share * step}
    for scheme in SCHEMES:
        yield "scheme", scheme, {"integrator": scheme}
    for size in COROTATING:
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
    for first in ({}, corotating(max(COROTATING))):
        flown(changed(scene, 4, **first), tables)  # compiles
    finest = flown(changed(scene, FINEST), tables)
    for rings in progress(MESHES, "rings"):
        yield flown(changed(scene, rings), tables).row("rings", str(rings), finest)
    yield finest.row("rings", f"{FINEST}", finest)
    step = build(changed(scene, RINGS), tables).model.dt
    best = flown(changed(scene, RINGS, time_step_s=FINE * step, optics_every=1, heat_every=1), tables)
    for knob, setting, changes in progress(list(settings(step)), "knobs"):
        yield flown(changed(scene, RINGS, **changes), tables).row(knob, setting, best)
    default = flown(changed(scene, RINGS), tables)
    for name, other in list(sets.items())[1:]:
        yield flown(changed(scene, RINGS), other).row("tables", name, default)


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
    "time step": "time step, of the bound", "corotating": "corotating, step in µs",
    "optics every": "optics every … steps", "heat every": "heat every … steps",
}
#: Column of a row, factor and label of what is drawn.
ERRORS = (
    ("error_path_m", 1e3, "place across the beam (mm)"), ("error_temperature_K", 1.0, "peak temperature (K)"),
    ("error_strain", 100.0, "largest strain (%)"),
)


def _panel(axes: Axes, points: list[tuple[float, float, str]]) -> None:
    """Errors of one knob against time, (seconds, error, setting) each; a line where the settings are numbers."""
    points.sort()
    ordered = all(setting[0].isdigit() for _, _, setting in points)
    seconds, errors = [point[0] for point in points], [point[1] for point in points]
    axes.loglog(seconds, errors, "o-" if ordered else "o", linewidth=0.8, markersize=4)
    side = {"textcoords": "offset points", "rotation_mode": "anchor", "ha": "center" if ordered else "left"}
    for k, (x, y, setting) in enumerate(points):
        up = 1 - 2 * (k % 2)
        place = {"xytext": (0 if ordered else 4, 5 * up), "va": "bottom" if up > 0 else "top"}
        text = setting.split()[0] if ordered else setting
        axes.annotate(text, (x, y), rotation=0 if ordered else 20 * up, fontsize=8, **place, **side)
    wider = 1.5 * max(1.0, 2.0 / np.sqrt(seconds[-1] / seconds[0]))
    axes.set_xlim(seconds[0] / wider, seconds[-1] * wider * (1.0 if ordered else 1.5))
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
            mine = [(row.seconds, getattr(row, name) * factor, row.setting) for row in found if row.knob == knob]
            if points := [point for point in mine if point[1] > 0.0]:
                _panel(axes, points)
        line[0].set(ylabel=f"error of the {label}")
        line[0].margins(y=0.15)
    for axes, knob in zip(panels[0], knobs, strict=True):
        axes.set_title(TITLES.get(knob, knob))
    figure.supxlabel("CPU time of one second of flight (s)")
    figure.suptitle(f"{title}, first {DURATION:g} s; {RINGS} rings but for the first column")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    run_stage(lambda: write_flown(__doc__, rows, markdown, draw))
