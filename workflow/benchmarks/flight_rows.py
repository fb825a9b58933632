"""What the accuracy benchmarks of flights share: flights on other settings, command line, and what they write."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from beamrider.io.files import InputError, atomic
from dynamics.membrane.flight import Flight
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from optics.table.pressure_table import PressureTable
from workflow.benchmarks.rows import write

Tables = dict[str, PressureTable]


#: What the co-rotating scheme needs of the flight.
COROTATING = {"integrator": "corotating", "optics_every": 1, "heat_every": 1}
#: Times of a flight at which it is compared with another.
COUNT = 401


class BeyondScheme(InputError):
    """Strain or slopes outgrew the co-rotating scheme."""


class Run(NamedTuple):
    """Place across the beam (2, t) in m, tilt (2, t) in rad and peak temperature (t,) in K at equal times from release
    to the end; the largest strain between them; CPU seconds for a second of flight, its spin-up left out."""

    path: np.ndarray
    tilt: np.ndarray
    temperature: np.ndarray
    strain: float
    seconds: float

    def errors(self, best: Run) -> dict[str, float]:
        """The largest errors over the flight against the best one, that of the strain relative."""
        return {
            "error_path_m": float(np.hypot(*(self.path - best.path)).max()),
            "error_tilt": float(np.abs(self.tilt - best.tilt).max()),
            "error_temperature_K": float(np.abs(self.temperature - best.temperature).max()),
            "error_strain": abs(self.strain / best.strain - 1.0),
        }


def changed(scene: Scene, rings: int, duration: float, **flight: Any) -> Scene:
    """The scene on another mesh, for so long in s, with other settings of the flight."""
    settings = {"duration_s": duration, "snapshot_every_s": duration, **flight}
    return scene.model_copy(
        update={
            "sail": scene.sail.model_copy(update={"rings": rings}),
            "flight": scene.flight.model_copy(update=settings),
        }
    )


def flown(scene: Scene, tables: Tables) -> Run:
    """Fly; InputError where the flight ends before its time, BeyondScheme where it leaves what its scheme bears."""
    with tempfile.TemporaryDirectory() as folder:
        flight, end = Flight(scene, tables, Path(folder)), None
        while flight.step < flight.model.release and end is None:
            end = flight.advance()
        begin = time.process_time()
        while flight.step < flight.model.end and end is None:
            end = flight.advance()
        seconds = time.process_time() - begin
        columns = {name: np.array(values) for name, (values, _) in flight.columns().items()}
    if end is not None:
        kind = BeyondScheme if end.reason == "beyond_scheme" else InputError
        raise kind(f"{scene.name}: ended by {end.reason} at {end.time:.4g} s; nothing to compare")
    after, times = columns["time"] >= 0, np.linspace(0.0, scene.flight.duration_s, COUNT)
    at = {
        name: CubicSpline(columns["time"][after], columns[name][after])(times)
        for name in ("position", "pitch", "roll", "temperature_max")
    }
    strain = float(columns["strain_max"][after].max())
    return Run(
        at["position"][:, :2].T,
        np.stack([at["pitch"], at["roll"]]),
        at["temperature_max"],
        strain,
        seconds / scene.flight.duration_s,
    )


def _set(text: str, scene: Scene) -> tuple[str, Tables]:
    """'NAME=FILE,FILE' as (name, tables)."""
    name, separator, files = text.partition("=")
    if not separator:
        raise InputError(f"--tables {text}: must be NAME=FILE,FILE…")
    return name, load_tables(files.split(","), scene)


def write_rows(
    description: str | None,
    rows: Callable[[Scene, dict[str, Tables]], Iterable[Any]],
    markdown: Callable[[list[Any]], str],
    draw: Callable[[Path, list[Any], str], None],
) -> None:
    """Command line of a benchmark: measure the rows of a scene on sets of tables; write CSV, Markdown and figure."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", required=True, type=Path)
    parser.add_argument("--tables", required=True, nargs="+", help="NAME=FILE,FILE… of each source, the best first")
    parser.add_argument("--out", required=True, type=Path, help="CSV to write")
    parser.add_argument("--markdown", required=True, type=Path, help="table to write")
    parser.add_argument("--png", required=True, type=Path, help="figure to write")
    arguments = parser.parse_args()
    scene = read_scene(arguments.scene)
    found = list(rows(scene, dict(_set(text, scene) for text in arguments.tables)))
    write(arguments.out, found)
    with atomic(arguments.markdown) as temporary:
        temporary.write_text(markdown(found), encoding="utf-8")
    draw(arguments.png, found, scene.name)
