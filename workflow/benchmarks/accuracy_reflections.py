"""Error of the light that a curved sail throws on itself, against rays per triangle and rings, and time of a trace.

    python -m workflow.benchmarks.accuracy_reflections --scene workflow/scenes/fig4_reflections.yaml --tables si43.h5 \
        --out reflections.csv --markdown reflections.md

The sail at rest in its first shape, at the offset of its release. Compared are the force of all light along and across
the beam, relative to that along it, and the temperature of the hottest triangle, the mean of its corners, in balance
with the light, without conduction: rays with MOST a side on the same mesh, rings with the finest mesh. Seconds are CPU
time of one core.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from beamrider.io.files import atomic, progress, run_stage
from dynamics.membrane.effects import reflections
from dynamics.membrane.flight import Flight
from dynamics.membrane.layout.rows import patch
from dynamics.membrane.output import record
from dynamics.membrane.stepping import step, threads
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from optics.table.pressure_table import PressureTable

RINGS, RAYS = 14, 2
MESHES, FINEST = (10, 14, 20, 28, 40, 56), 80
SIDES, MOST = (1, 2, 4, 8), 32
POLARISATIONS = ("mean", "tracked")


class Trace(NamedTuple):
    """Force (3,) in N of all light, temperature in K of the hottest triangle, CPU seconds of tracing all rays once."""

    force: np.ndarray
    hottest: float
    seconds: float


class Row(NamedTuple):
    """One measurement; see the module."""

    polarisation: str
    knob: str
    setting: int
    error_along: float
    error_across: float
    hottest_K: float
    error_K: float
    seconds: float


def changed(scene: Scene, rings: int, rays: int, polarisation: str) -> Scene:
    """The scene on another mesh, with other rays."""
    bounced = {"rays_a_side": rays, "polarisation": polarisation}
    return scene.model_copy(
        update={
            "sail": scene.sail.model_copy(update={"rings": rings}),
            "reflections": scene.reflections.model_copy(update=bounced),
            "flight": scene.flight.model_copy(update={"optics_every": 1, "series_every": 1}),
        }
    )


def trace(scene: Scene, tables: dict[str, PressureTable]) -> Trace:
    """Light the sail as it is released, at full ramp."""
    with tempfile.TemporaryDirectory() as folder:
        flight = Flight(scene, tables, Path(folder))
    model, work, state = flight.model, flight.work, flight.state
    state.x[:2] += np.array(scene.release.offset_m)[:, None]
    lit, found = model.end + int(scene.beam.rise_s / model.dt) + 1, np.empty((3, record.WIDTH))
    step.run(model, state, work, lit, lit, True, found)
    at = record.COLUMNS["force"]
    force = found[0, at : at + 3].copy()
    hottest = balance(flight).max()
    seconds, own, now = [], model.effects, work.effects
    for _ in range(3):
        # The patch was worked in since: a row takes it, too
        threads.respond_all(own.light, now.light, state.x, now.tearing.gone, model.stencil, work.stencil)
        begin = time.process_time()
        reflections.bounce(
            own.reflections,
            now.reflections,
            own.light,
            now.light,
            patch(work.stencil.scratch, 0),
            state.x,
            now.tearing.gone,
            0.0,
        )
        seconds.append(time.process_time() - begin)
    return Trace(force, float(hottest), min(seconds))


def balance(flight: Flight) -> np.ndarray:
    """Temperature (t,) in K of the triangles where each node emits what it absorbs."""
    mesh, emission = flight.membrane.mesh, flight.model.effects.heat.emission
    corners = mesh.triangles.ravel()
    absorbed, emitted = (
        np.bincount(corners, np.repeat(x, 3)) for x in (flight.work.effects.light.absorbed, 3.0 * emission * mesh.areas)
    )
    return np.asarray(((absorbed / emitted) ** 0.25)[mesh.triangles].mean(axis=1))


def row(polarisation: str, knob: str, setting: int, found: Trace, best: Trace) -> Row:
    """The errors against the best trace."""
    apart = np.abs(found.force - best.force) / best.force[2]
    return Row(
        polarisation,
        knob,
        setting,
        float(apart[2]),
        float(np.hypot(*apart[:2])),
        found.hottest,
        found.hottest - best.hottest,
        found.seconds,
    )


def rows(scene: Scene, tables: dict[str, PressureTable]) -> Iterator[Row]:
    """Every setting of both knobs, for both polarisations."""
    trace(changed(scene, 2, 1, "mean"), tables)  # compiles
    for polarisation in POLARISATIONS:

        def at(rings: int, rays: int, kind: str = polarisation) -> Trace:
            return trace(changed(scene, rings, rays, kind), tables)

        best = at(RINGS, MOST)
        for rays in progress(SIDES, f"rays, {polarisation}"):
            yield row(polarisation, "rays a side", rays, at(RINGS, rays), best)
        best = at(FINEST, RAYS)
        for rings in progress(MESHES, f"rings, {polarisation}"):
            yield row(polarisation, "rings", rings, at(rings, RAYS), best)
        yield row(polarisation, "rings", FINEST, best, best)


def write(path: Path, found: list[Row]) -> None:
    """Write rows as CSV, atomically."""
    with atomic(path) as temporary, Path(temporary).open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(Row._fields)
        table.writerows([*line[:3], *(f"{x:.4e}" for x in line[3:])] for line in found)


def markdown(path: Path, found: list[Row]) -> None:
    """Write rows as a table for the README."""
    head = "| polarisation | knob | setting | force along, % | across, % | hottest, K | its error, K | ms a trace |"
    lines = [head, "|" + "---|" * 8]
    for line in found:
        errors: list[Any] = [line.error_along * 100, line.error_across * 100]
        cells = ["–" if x == 0.0 else f"{x:.2g}" for x in errors]
        off = "–" if line.error_K == 0.0 else f"{line.error_K:+.1f}"
        head = f"| {line.polarisation} | {line.knob} | {line.setting} | {' | '.join(cells)} "
        lines.append(f"{head}| {line.hottest_K:.0f} | {off} | {line.seconds * 1e3:.3g} |")
    with atomic(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", required=True, type=Path)
    parser.add_argument("--tables", required=True, nargs="*", help="pressure tables of the scene's designs")
    parser.add_argument("--out", required=True, type=Path, help="CSV to write")
    parser.add_argument("--markdown", required=True, type=Path, help="table to write")
    arguments = parser.parse_args()
    scene = read_scene(arguments.scene)
    found = list(rows(scene, load_tables(arguments.tables, scene)))
    write(arguments.out, found)
    markdown(arguments.markdown, found)


if __name__ == "__main__":
    run_stage(main)
