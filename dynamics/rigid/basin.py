"""Basin of the beam: the offsets and tilts at release from which a rigid sail stays on it.

    python -m dynamics.basin --scene workflow/scenes/fig6.yaml --tables te.h5 tm.h5 --out basin.h5
    python -m dynamics.basin … --out part1.h5 --block 1/8        one of eight blocks, of equal work
    python -m dynamics.basin … --out basin.h5 --parts part*.h5   the map from all of its blocks

A flight is bounded when it lasts: its centre never goes farther from the axis than the limit (one radius of the beam
unless the grid says otherwise), no incidence leaves a table, no grating turns its back to the light.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from beamrider.arrays import Floats
from beamrider.io.arguments import part_of, stage_arguments
from beamrider.io.files import (
    DIMENSIONLESS,
    InputError,
    Number,
    Positive,
    Strict,
    finish,
    progress,
    read_model,
    reading,
    versions,
)
from beamrider.io.hdf5 import new_hdf5, read_hdf5, real
from beamrider.machine_code.notice import compiling
from dynamics.rigid import integrator as kernel
from dynamics.rigid.body import RigidBody, rigid_body
from dynamics.rigid.stage import REASONS, step_seconds, terms_of
from dynamics.sail.forecast import require_cells, say_basin
from dynamics.sail.sectors import load_tables, provenance
from dynamics.scene import schema as scenes
from optics.table.pressure_table import PressureTable

Tilt = Annotated[float, Field(gt=-90, lt=90)]
Range = Annotated[list[Number], Field(min_length=2, max_length=2)]
Count = Annotated[int, Field(ge=1, le=10_000, json_schema_extra=DIMENSIONLESS)]
TRIALS = 5  # flights whose time is taken
COLUMNS = ("end_time", "end_code", "distance_max", "tilt_max", "steps")
UNITS = {"end_time": "s", "end_code": "1", "distance_max": "m", "tilt_max": "rad", "steps": "1"}


class Grid(Strict):
    """Releases of a map: offsets along one direction from the axis, tilts of the normal towards another.

    Tilt t towards direction γ is pitch = t cos γ, roll = t sin γ; the paper's releases lie on both directions at 45°.
    Negative offsets would repeat what negative tilts show.
    """

    offsets_m: Range | None = None
    """First and last offset; null for up to nine tenths of the radius of the beam."""
    n_offsets: Count = 25
    """Number of offsets."""
    tilts_deg: Range = [-8.0, 8.0]
    """First and last tilt."""
    n_tilts: Count = 41
    """Number of tilts."""
    offset_direction_deg: scenes.Rate = 45.0
    """Direction of the offsets from x towards y."""
    tilt_direction_deg: scenes.Rate = 45.0
    """Direction γ of the tilts."""
    duration_s: scenes.Duration = 5.0
    """Time for which a bounded flight lasts."""
    tolerance: Annotated[float, Field(ge=1e-15, le=1e-2, json_schema_extra=DIMENSIONLESS)] = 1e-9
    """Error of a step, as in `rigid.tolerance` of a scene."""
    limit_m: Positive | None = None
    """Distance from the axis that counts as lost; null for the radius of the beam."""

    def over(self, beam: scenes.Beam) -> Grid:
        """The grid with the offsets that suit a beam, where it leaves them open."""
        return self if self.offsets_m else self.model_copy(update={"offsets_m": [0.0, 9.0 * beam.reach_m / 10.0]})

    @property
    def offsets(self) -> Floats:
        """Offsets (n_offsets,) in m of a grid that has them."""
        first, last = self.offsets_m or (math.nan, math.nan)
        return np.linspace(first, last, self.n_offsets)

    @property
    def tilts(self) -> Floats:
        """Tilts (n_tilts,) in degrees."""
        return np.linspace(self.tilts_deg[0], self.tilts_deg[1], self.n_tilts)

    def release(self, cell: int, spin_Hz: float) -> scenes.Release:
        """Release of one cell of the map, counted along the tilts first."""
        i, j = divmod(cell, self.n_tilts)
        along, towards = np.radians(self.offset_direction_deg), np.radians(self.tilt_direction_deg)
        x, y = self.offsets[i] * np.array([np.cos(along), np.sin(along)])
        pitch, roll = self.tilts[j] * np.array([np.cos(towards), np.sin(towards)])
        return scenes.Release(
            offset_m=[float(x), float(y)], pitch_deg=float(pitch), roll_deg=float(roll), spin_Hz=spin_Hz
        )


@dataclass(frozen=True)
class Basin:
    """Flights of some cells (n,) of a map, or of all in order: columns (n,) by name, SI units; codes as in `REASONS`.

    cpu_seconds: time on a core that the flights took, compilation not counted.
    """

    cells: NDArray[np.int64]
    columns: dict[str, Floats]
    cpu_seconds: float


def limited(scene: scenes.Scene, grid: Grid) -> scenes.Scene:
    """The scene with the grid's duration, tolerance and limit, and no rows but the first."""
    limit = scene.beam.reach_m if grid.limit_m is None else grid.limit_m
    rigid = scene.rigid.model_copy(
        update={
            "duration_s": grid.duration_s,
            "tolerance": grid.tolerance,
            "output_Hz": 1.0 / grid.duration_s,
        }
    )
    flight = scene.flight.model_copy(update={"fly_away_m": limit})
    return scene.model_copy(update={"rigid": rigid, "flight": flight})


def fly_cells(scene: scenes.Scene, tables: dict[str, PressureTable], grid: Grid, cells: Iterable[int]) -> Basin:
    """Fly the given cells of a map."""
    scene, chosen = limited(scene, grid), np.array(list(cells), dtype=np.int64)
    body = rigid_body(scene, tables)
    _outcome(body, scene.model_copy(update={"rigid": scene.rigid.model_copy(update={"most_steps": 1})}), scene.release)
    # In an order without order, so that the first flights are like the rest, and say before how long it will take
    order = np.random.default_rng(0).permutation(chosen.size)
    if chosen.size:
        _foresee(body, scene, grid, chosen[order])
    begin = time.process_time()  # everything is compiled
    rows = np.empty((chosen.size, len(COLUMNS)))
    for place in progress(order, f"basin {scene.name}", total=chosen.size, unit="flight"):
        rows[place] = _outcome(body, scene, grid.release(int(chosen[place]), scene.release.spin_Hz))
    columns = rows.T.copy()
    return Basin(chosen, dict(zip(COLUMNS, columns, strict=True)), time.process_time() - begin)


def _foresee(body: RigidBody, scene: scenes.Scene, grid: Grid, cells: NDArray[np.int64]) -> None:
    """The forecast of a map whose flights go on to the end as the first of them begin; InputError where too long."""
    terms, seconds = terms_of(scene, body.units), []
    for cell in cells[:TRIALS]:
        start = body.start(grid.release(int(cell), scene.release.spin_Hz))
        steps, each = step_seconds(body, terms, kernel.start(start, terms.rows.size))
        seconds.append(each * min(1.0, scene.rigid.most_steps / steps))
    say_basin(scene, cells.size, float(np.mean(seconds)))


def _outcome(body: RigidBody, scene: scenes.Scene, release: scenes.Release) -> list[float]:
    """End of one flight, in the order of COLUMNS."""
    terms = terms_of(scene, body.units)
    work = kernel.start(body.start(release), terms.rows.size)
    kernel.fly(body.sail, body.tables, body.light, terms, work, scene.rigid.most_steps)
    distance, tilt = work.extremes
    return [
        work.clock[kernel.T] * body.units.time,
        work.counts[kernel.REASON],
        distance * body.units.length,
        tilt,
        work.counts[kernel.STEPS],
    ]


def block_cells(grid: Grid, block: tuple[int, int]) -> NDArray[np.int64]:
    """Cells of block (i, n), i from 1: every n-th, so that long flights are shared out evenly."""
    return np.arange(block[0] - 1, grid.n_offsets * grid.n_tilts, block[1])


def write(path: str | Path, basin: Basin, scene: scenes.Scene, tables: dict[str, PressureTable], grid: Grid) -> None:
    """Write a block as columns, a whole map as arrays (n_offsets, n_tilts), atomically."""
    whole = basin.cells.size == grid.n_offsets * grid.n_tilts
    shape = (grid.n_offsets, grid.n_tilts) if whole else (-1,)
    with new_hdf5(path) as file:
        for name, values in {"offset": grid.offsets, "tilt": np.radians(grid.tilts), "cell": basin.cells}.items():
            file.create_dataset(name, data=values).attrs["units"] = {"offset": "m", "tilt": "rad", "cell": "1"}[name]
        for name, values in basin.columns.items():
            file.create_dataset(name, data=values.reshape(shape)).attrs["units"] = UNITS[name]
        file.attrs.update(
            {
                "scene": scene.model_dump_json(),
                "grid": grid.model_dump_json(),
                "key": _key(scene, tables, grid),
                "tables": json.dumps(provenance(tables)),
                "reasons": json.dumps(REASONS),
                "versions": json.dumps(versions("numpy", "scipy", "numba")),
                "cpu_seconds": basin.cpu_seconds,
            }
        )


def _key(scene: scenes.Scene, tables: dict[str, PressureTable], grid: Grid) -> str:
    """Digest of all that the numbers depend on: blocks of one map share it."""
    text = json.dumps([scene.model_dump_json(), grid.model_dump_json(), provenance(tables)])
    return hashlib.sha256(text.encode()).hexdigest()


def merge(paths: Iterable[str | Path], scene: scenes.Scene, tables: dict[str, PressureTable], grid: Grid) -> Basin:
    """The whole map from the files of its blocks; InputError where one is foreign, missing or given twice."""
    cells, columns, seconds = [], [], 0.0
    for path in paths:
        block = _read_block(path, _key(scene, tables, grid))
        cells.append(block.cells)
        columns.append(np.array([block.columns[name] for name in COLUMNS]))
        seconds += block.cpu_seconds
    every = np.concatenate(cells) if cells else np.zeros(0, np.int64)
    if not np.array_equal(np.sort(every), np.arange(grid.n_offsets * grid.n_tilts)):
        raise InputError(f"--parts: {every.size} flights of {grid.n_offsets * grid.n_tilts}: give every block once")
    order = np.argsort(every)
    return Basin(every[order], dict(zip(COLUMNS, np.concatenate(columns, axis=1)[:, order], strict=True)), seconds)


def _read_block(path: str | Path, key: str) -> Basin:
    with reading(path, "a readable block of a basin map"), read_hdf5(path) as file:
        if file.attrs.get("key") != key:
            raise InputError(f"{path}: belongs to another scene, grid or tables; make it again")
        columns, cells = {name: real(file[name]).ravel() for name in COLUMNS}, real(file["cell"]).astype(np.int64)
        if any(values.shape != cells.shape for values in columns.values()):
            raise ValueError("columns of other lengths than the cells")
        return Basin(cells, columns, float(file.attrs["cpu_seconds"]))


OPTIONS: dict[str, dict[str, Any]] = {
    "--grid": {"help": "YAML file of the releases (default: 25 offsets by 41 tilts, 5 s)"},
    "--incidence": {"help": "instead of the scene's own", "choices": ["sail_frame", "yaw_blind"]},
    "--block": {"default": "1/1", "metavar": "I/N", "help": "fly only block i of n, as in 2/8"},
    "--parts": {"help": "files of all blocks, to be put together instead of flown", "nargs": "+"},
}


def main() -> None:
    """Map the releases from which a scene's rigid sail stays on its beam."""
    arguments = stage_arguments("dynamics.basin", main.__doc__, "HDF5 file to write", options=OPTIONS)
    scene = scenes.read_scene(arguments.scene)
    if arguments.incidence:
        scene = scene.model_copy(update={"incidence": arguments.incidence})
    grid = (read_model(arguments.grid, Grid) if arguments.grid else Grid()).over(scene.beam)
    tables = load_tables(arguments.tables, scene)
    if arguments.parts:
        basin = merge(arguments.parts, scene, tables, grid)
    else:
        block = part_of("--block", arguments.block)
        require_cells(grid.n_offsets * grid.n_tilts, block[1], arguments.grid or "--grid")
        with compiling("30 s"):
            basin = fly_cells(scene, tables, grid, block_cells(grid, block))
    write(arguments.out, basin, scene, tables, grid)
    bounded = int((basin.columns["end_code"] == kernel.FINISHED).sum())
    finish(
        arguments.out,
        arguments.watch,
        f"{bounded} of {basin.cells.size} flights bounded, flown in {basin.cpu_seconds:.3g} s of one core",
    )
