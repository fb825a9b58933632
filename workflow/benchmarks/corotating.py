"""Cost and error of the co-rotating scheme against explicit flight, by rings and time step.

    python workflow/benchmarks/corotating.py --scene workflow/scenes/fig6.yaml --tables te.h5 tm.h5 --out corotating.csv

Flown are the first 20 ms. Errors are the largest after the release against half of the explicit step with light and
heat renewed in every step: of the place across the beam, of the tilt (both angles), of the peak temperature, and of the
largest strain of the whole flight. Seconds are CPU time of one core for a second of flight, its spin-up left out, the
best of three, not a number where strain or slopes outgrow the scheme; `explicit` is the default: 0.8 of the stability
bound, light and heat renewed every 16 steps.
"""

from __future__ import annotations

import argparse
import csv
import math
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dynamics.membrane import Flight
from dynamics.model import build
from dynamics.sail import load_tables
from dynamics.scene import Scene, read_scene
from optics.files import InputError, atomic, progress, run_stage
from optics.table import PressureTable

Tables = dict[str, PressureTable]

DURATION = 0.02
RINGS = (10, 20, 30, 60)
#: Steps of the co-rotating scheme in s.
STEPS = (28e-6, 56e-6, 80e-6)
TIMES = np.linspace(0.0, 0.99 * DURATION, 201)[1:]
HELD = {"optics_every": 16, "heat_every": 16}
RENEWED = {"optics_every": 1, "heat_every": 1}


class Run(NamedTuple):
    """Place across the beam (2, t) in m, tilt (2, t) in rad, peak temperature (t,) in K at TIMES; largest strain;
    time step in s, CPU seconds a second of flight."""

    path: np.ndarray
    tilt: np.ndarray
    temperature: np.ndarray
    strain: float
    step: float
    seconds: float


def changed(scene: Scene, rings: int, **flight: Any) -> Scene:
    """The scene on another mesh, with other settings of the flight."""
    settings = {"duration_s": DURATION, "snapshot_every_s": DURATION, **flight}
    return scene.model_copy(update={
        "sail": scene.sail.model_copy(update={"rings": rings}), "flight": scene.flight.model_copy(update=settings),
    })


def flown(scene: Scene, tables: Tables) -> Run | None:
    """Fly; None where the flight leaves what the scheme bears, InputError where it ends before its time otherwise."""
    with tempfile.TemporaryDirectory() as folder:
        flight, end = Flight(scene, tables, Path(folder)), None
        while flight.step < flight.model.release:
            flight.advance()
        begin = time.process_time()
        while flight.step < flight.model.end and end is None:
            end = flight.advance()
        seconds = time.process_time() - begin
        columns = {name: np.array(values) for name, (values, _) in flight.columns().items()}
    if end is not None and end.reason == "beyond_scheme":
        return None
    if end is not None:
        raise InputError(f"{scene.name}: ended by {end.reason} at {end.time:.4g} s; nothing to compare")
    series = {name: values[columns["time"] >= 0] for name, values in columns.items()}
    at = {name: np.interp(TIMES, series["time"], series[name]) for name in ("pitch", "roll", "temperature_max")}
    path = np.stack([np.interp(TIMES, series["time"], series["position"][:, i]) for i in (0, 1)])
    strain = float(series["strain_max"].max())
    return Run(
        path, np.stack([at["pitch"], at["roll"]]), at["temperature_max"], strain, flight.model.dt, seconds / DURATION
    )


def best(scene: Scene, tables: Tables) -> Run | None:
    """The fastest of three flights; None where they leave what the scheme bears."""
    runs = [run for run in (flown(scene, tables) for _ in range(3)) if run is not None]
    return min(runs, key=lambda run: run.seconds) if runs else None


def rows(scene: Scene, tables: Tables, many: tuple[int, ...]) -> list[list[Any]]:
    """A row for each scheme, rings and time step."""
    found = []
    for rings in progress(many, "rings"):
        step = build(changed(scene, rings), tables).model.dt
        true = flown(changed(scene, rings, time_step_s=0.5 * step, series_every=16, **RENEWED), tables)
        runs = {"explicit": best(changed(scene, rings, series_every=32, **HELD), tables)}
        for size in STEPS:
            fast = changed(scene, rings, integrator="corotating", time_step_s=size, series_every=2, **RENEWED)
            runs[f"corotating {size * 1e6:.3g} µs"] = best(fast, tables)
        for name, run in runs.items():
            if run is None or true is None:
                found.append([name, rings, *[math.nan] * 6])
                continue
            path = np.hypot(*(run.path - true.path)).max()
            tilt, warmth = np.abs(run.tilt - true.tilt).max(), np.abs(run.temperature - true.temperature).max()
            found.append([name, rings, run.step, path, tilt, warmth, run.strain / true.strain - 1.0, run.seconds])
    return found


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", required=True, type=Path)
    parser.add_argument("--tables", required=True, nargs="+", help="pressure tables of the scene's designs")
    parser.add_argument("--rings", nargs="+", type=int, default=RINGS)
    parser.add_argument("--out", required=True, type=Path, help="CSV to write")
    given = parser.parse_args()
    scene = read_scene(given.scene)
    tables = load_tables(given.tables, scene)
    flown(changed(scene, 2), tables)  # compiles
    found = rows(scene, tables, tuple(given.rings))
    errors = ["error_path_m", "error_tilt", "error_temperature_K", "error_strain"]
    names = ["scheme", "rings", "step_s", *errors, "seconds"]
    with atomic(given.out) as temporary, Path(temporary).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([names, *found])


if __name__ == "__main__":
    run_stage(main)
