"""What jobs ask a cluster for: blocks of minutes, memory by mesh, table and cell; a job that failed asks for more.

Times and memory are what the stages were measured to take on a server. They decide how work is cut and booked, never
what is computed.
"""

from __future__ import annotations

import contextlib
import heapq
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from beamrider.io.files import InputError
from dynamics.scene.schema import Scene, read_scene
from optics.cells.outline import Grating, read_grating
from optics.fdtd.grid import TABLE, FdtdSettings, memory, work

PROGRAM = re.compile(r"\bpython -m ((?:optics|dynamics)\.[\w.]+)")
#: Programs whose kernels `workflow.machine_code` compiles before.
COMPILED = ("dynamics.membrane", "dynamics.rigid", "dynamics.basin", "dynamics.floquet", "dynamics.maps")

#: Bytes of a process that has loaded everything (`dynamics.sail.forecast`).
PROCESS = 0.22e9
#: MB that Snakemake itself takes in a job: one that Slurm starts and one within that, 160 MB each.
SNAKEMAKE = 350.0
#: Share that is asked for beyond what is forecast.
MARGIN = 0.3
#: Bytes in memory for a byte of a pressure table's file, which is packed.
UNPACKED = 40.0
#: Directions of an FDTD table, 33 and 88 of the paper's cells, and s of a pixel and step of one.
DIRECTIONS, A_PIXEL_STEP = 60, 3.5e-6
#: s of a turn of a rigid sail in flight.
A_TURN = 4e-4
#: s of a cell at one number of orders, and its growth with them: eigenvalues of matrices, three numbers a cell.
A_LOCAL, ORDERS = 0.03, 15
#: s that a job takes beside its work: two Snakemakes that read the workflow, and the start of Python with its modules.
START = 8.0


def blocks(seconds: float, minutes: float) -> int:
    """Jobs that work of so many s is cut into, each of about `minutes`."""
    return max(1, round(seconds / (60.0 * minutes)))


def makespan(work: Sequence[float], cores: int, start: float = 0.0, a_second: float = math.inf) -> float:
    """s until jobs of such work are done: submitted one after the other, so many a second, to the first free core."""
    free = [0.0] * cores
    for i, seconds in enumerate(sorted(work, reverse=True)):
        begin = max(heapq.heappop(free), (i + 1) / a_second)
        heapq.heappush(free, begin + start + seconds)
    return max(free)


def overhead(work: Sequence[float], cores: int, a_second: float = 1.0) -> tuple[float, float]:
    """What a cluster spends beside jobs of such work in s: starts as a share of the work, and the time they are late.

    The latter is a share of the time that the same jobs take without start and submission.
    """
    ideal = makespan(work, cores)
    return START * len(work) / sum(work), makespan(work, cores, START, a_second) / ideal - 1.0


def fdtd_seconds(cell: Grating, tolerance: float) -> float:
    """s that an FDTD table of a cell takes."""
    settings = FdtdSettings(tolerance=tolerance / TABLE)
    return 2.0 * DIRECTIONS * A_PIXEL_STEP * float(work(cell, settings)[:3].sum())


def basin_seconds(scene: Scene) -> float:
    """s that the flights of a scene's basin take: steps follow the spin."""
    from dynamics.rigid.basin import Grid  # only here, as below: compiled modules take a while

    grid = Grid()
    turns = max(1.0, abs(scene.release.spin_Hz)) * grid.duration_s
    return grid.n_offsets * grid.n_tilts * turns * A_TURN


def cells_seconds(cells: int, orders: int) -> float:
    """s that so many cells take: the time of a cell grows as the third power of its orders."""
    return cells * A_LOCAL * (orders / ORDERS) ** 3


def _asked(needed: float) -> float:
    """MB to ask for, of a process that needs so many bytes."""
    return SNAKEMAKE + (1.0 + MARGIN) * needed / 1e6


def _unpacked(files: Any) -> float:
    """Bytes in memory of tables, those that are there."""
    return UNPACKED * sum(path.stat().st_size for path in map(Path, files) if path.is_file())


def _scene(files: Any) -> Scene:
    """The scene among a job's files: as it was read before, or read now."""
    return read_scene(files["scene"]) if isinstance(files["scene"], str) else files["scene"]


def flight_mb(files: Any) -> float:
    """MB of a flexible flight, by its mesh and its tables."""
    from dynamics.membrane.forecast import flexible_memory

    return _asked(flexible_memory(_scene(files)) + _unpacked(files["tables"]))


def rigid_mb(files: Any) -> float:
    """MB of a rigid flight, by its rows and its tables."""
    from dynamics.sail.forecast import A_ROW

    rigid = _scene(files).rigid
    return _asked(PROCESS + A_ROW * rigid.duration_s * rigid.output_Hz + _unpacked(files["tables"]))


def table_mb(files: Any) -> float:
    """MB of what reads tables and little else."""
    return _asked(PROCESS + _unpacked(files["tables"]))


def screening_mb(files: Any) -> float:
    """MB of the screening of a family, by its members."""
    from dynamics.sail.forecast import A_MEMBER

    return _asked(PROCESS + A_MEMBER * pq.read_metadata(files["members"]).num_rows)


def fdtd_mb(files: Any) -> float:
    """MB of FDTD on a cell, by the grid of the resolutions that every direction takes."""
    cell = read_grating(files["cell"]) if isinstance(files["cell"], str) else files["cell"]
    return _asked(1.5 * PROCESS + memory(cell, FdtdSettings()))


#: What programs take, of the files that their jobs read.
MEMORY = {
    "dynamics.membrane": flight_mb,
    "dynamics.rigid": rigid_mb,
    "dynamics.basin": table_mb,
    "dynamics.floquet": table_mb,
    "dynamics.maps": table_mb,
    "dynamics.screening": screening_mb,
    "optics.fdtd": fdtd_mb,
}


def _files(given: Any, read: Mapping[str, Any]) -> dict[str, Any]:
    """A job's input files by name: one file, what was read of it before, or a list."""
    named = {name: given[name] for name in given.keys()}  # noqa: SIM118
    return {name: read.get(file, file) if isinstance(file, str) else list(file) for name, file in named.items()}


def request(rule: Any, name: str, read: Mapping[str, Any]) -> Callable[..., int]:
    """A rule's resource as a function that Snakemake asks for each attempt: twice as much for the second, and so on.

    Memory follows the files where all are there and can be read, else it is what the rule states. read: scenes and
    cells that were read before, by file.
    """
    stated = rule.resources[name].value
    program = PROGRAM.search(rule.shellcmd or "")
    of_files = MEMORY.get(program[1]) if program and name == "mem_mb" else None

    def asked(wildcards: Any, input: Any, attempt: int) -> int:
        needed = float(stated)
        if of_files:
            with contextlib.suppress(InputError, OSError, KeyError, AttributeError, pa.ArrowInvalid):
                needed = of_files(_files(input, read))
        return math.ceil(needed) * attempt

    return asked


def attach(rules: Any, machine_code: Any | None, read: Mapping[str, Any]) -> None:
    """Let all rules ask for what their jobs take, and those that fly for machine code first, if there is to be any.

    read: as in `request`.
    """
    for rule in rules:
        for name in ("mem_mb", "runtime"):
            if name in rule.resources and not rule.resources[name].is_evaluable():  # not Snakemake's own defaults
                rule.resources[name] = request(rule, name, read)
        program = PROGRAM.search(rule.shellcmd or "")
        if machine_code and program and program[1] in COMPILED:
            rule.set_input(machine_code)
