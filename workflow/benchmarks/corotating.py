"""Cost and error of the co-rotating scheme against explicit flight, by rings and time step.

    python -m workflow.benchmarks.corotating --scene workflow/scenes/fig6.yaml --tables te.h5 tm.h5 --out corotating.csv

Flown are the first 20 ms. Errors are the largest after the release against half of the explicit step with light and
heat renewed in every step: of the place across the beam, of the tilt (both angles), of the peak temperature, and of the
largest strain. Seconds are CPU time of one core for a second of flight, its spin-up left out, the best of two; where
strain or slopes outgrow the scheme there are no numbers. `explicit` is the default: 0.8 of the stability bound, light
and heat renewed as often as the scene says.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from beamrider.io.files import progress, run_stage
from dynamics.membrane.build import build
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from workflow.benchmarks.flight_rows import COROTATING, BeyondScheme, Run, Tables, changed, flown
from workflow.benchmarks.rows import write

DURATION = 0.02
RINGS = (10, 20, 30, 60)
#: Steps of the co-rotating scheme in s.
STEPS = (28e-6, 56e-6, 80e-6)
REPEATS = 2
RENEWED = {"optics_every": 1, "heat_every": 1, "series_every": 16}


class Row(NamedTuple):
    """A scheme on a mesh: time step in s, largest errors over the flight, CPU seconds a second of flight."""

    scheme: str
    rings: int
    step_s: float
    error_path_m: float = math.nan
    error_tilt: float = math.nan
    error_temperature_K: float = math.nan
    error_strain: float = math.nan
    seconds: float = math.nan


def schemes(step: float) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Name, time step in s and settings of what is compared; `step`: the explicit one in s."""
    yield "explicit", step, {}
    for size in STEPS:
        yield "corotating", size, {**COROTATING, "series_every": 1}


def best(scene: Scene, tables: Tables) -> Run | None:
    """The fastest of several flights; None where they leave what the scheme bears."""
    try:
        return min((flown(scene, tables) for _ in range(REPEATS)), key=lambda run: run.seconds)
    except BeyondScheme:
        return None


def rows(scene: Scene, tables: Tables, many: tuple[int, ...]) -> Iterator[Row]:
    """A row for each mesh, scheme and time step."""
    for first in ({}, COROTATING):
        flown(changed(scene, 2, DURATION, **first), tables)  # compiles
    for rings in progress(many, "rings"):
        step = build(changed(scene, rings, DURATION), tables).model.dt
        true = flown(changed(scene, rings, DURATION, time_step_s=0.5 * step, **RENEWED), tables)
        for name, size, settings in schemes(step):
            run = best(changed(scene, rings, DURATION, time_step_s=size, **settings), tables)
            yield Row(name, rings, size, **({} if run is None else {**run.errors(true), "seconds": run.seconds}))


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", required=True, type=Path)
    parser.add_argument("--tables", required=True, nargs="+", help="pressure tables of the scene's designs")
    parser.add_argument("--rings", nargs="+", type=int, default=RINGS)
    parser.add_argument("--out", required=True, type=Path, help="CSV to write")
    given = parser.parse_args()
    scene = read_scene(given.scene)
    write(given.out, rows(scene, load_tables(given.tables, scene), tuple(given.rings)))


if __name__ == "__main__":
    run_stage(main)
