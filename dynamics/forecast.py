"""What a flight will take: memory and room on the disk from its scene before it starts, time from its first steps.

Bytes are what flights were measured to take at most, while they are built (`tests/unit/test_forecast`).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from dynamics.scene import Sail, Scene
from dynamics.shapes import SIDES
from optics.files import InputError, amount
from optics.machine import DAY, available_memory, free_disk, in_words, require_disk, require_memory

#: Bytes of a process that has loaded everything, and those a node of a flexible sail, by what carries the load.
PROCESS = 0.22e9
A_NODE = {"triangles": 6700.0, "springs": 5600.0, "corotating": 19400.0}
#: Nodes for which the bytes a node of the factorised matrices hold; they grow as its logarithm (George, SIAM J. Numer.
#: Anal. 10 (1973) 345).
FACTORISED = 11_000.0
#: Bytes a row: of a rigid flight, and of a flexible one when its file is written.
A_ROW, A_FLEXIBLE_ROW = 900.0, 720.0
#: Bytes a cell of a basin's map, and a member of a family that is screened.
A_CELL, A_MEMBER = 200.0, 1000.0
#: Bytes a member whose two cells are made.
A_MADE_MEMBER = 9000.0
#: Times of the journal on the disk while a flight's file is written beside it, with its margin.
COPIES = 2.2
#: No flight is started that would take longer, in s.
LONGEST = 30.0 * DAY
#: Time in s that no machine needs less of for a step.
LEAST = 1e-7


def nodes(sail: Sail) -> int:
    """Nodes of a sail's mesh: its apex, and on ring k the outline's sides times its hops times k."""
    sides, hops = SIDES[sail.outline]
    return 1 + sides * hops * sail.rings * (sail.rings + 1) // 2


def triangles(sail: Sail) -> int:
    """Triangles of a sail's mesh."""
    sides, hops = SIDES[sail.outline]
    return sides * hops * sail.rings**2


def flexible_memory(scene: Scene) -> float:
    """Most bytes of memory that a process takes which flies a scene's flexible sail."""
    n = nodes(scene.sail)
    if scene.flight.integrator == "corotating":
        return PROCESS + n * A_NODE["corotating"] * max(1.0, math.log(n) / math.log(FACTORISED))
    return PROCESS + n * A_NODE["triangles" if scene.flight.stiffness == "triangles" else "springs"]


def require_mesh(scene: Scene) -> None:
    """InputError where the memory of this machine does not hold a scene's flexible sail."""
    needed, rings = flexible_memory(scene), scene.sail.rings
    share = max(0.0, available_memory() / 1.25 - PROCESS) / (needed - PROCESS)
    fit = int(rings * math.sqrt(share))
    require_memory(
        needed, f"{scene.name}.yaml: sail.rings = {rings}",
        f"take at most {fit} rings, which fit" if fit else "free some memory",
    )


def require_rows(scene: Scene) -> int:
    """Rows of a scene's rigid flight; InputError where memory does not hold them."""
    given = scene.rigid
    rows = math.ceil(given.duration_s * given.output_Hz)
    require_memory(
        PROCESS + rows * A_ROW, f"{scene.name}.yaml: rigid.duration_s = {given.duration_s:g}",
        f"fly for a shorter time, or lower rigid.output_Hz = {given.output_Hz:g}",
    )
    return rows


def journal_bytes(scene: Scene, dt: float, steps: int) -> float:
    """Bytes of the rows and frames of a flexible flight of so many steps of dt in s."""
    from dynamics.kernels.record import WIDTH  # only here: compiled modules take a second to load

    failed = triangles(scene.sail) if scene.flight.on_failure != "stop" else 0
    frames = 2 + steps / max(1.0, scene.flight.snapshot_every_s / dt)
    return 8.0 * (WIDTH * _rows(scene, steps) + frames * (1 + 7 * nodes(scene.sail) + failed))


def _rows(scene: Scene, steps: int) -> float:
    return 2 + steps / scene.flight.series_every


def require_series(scene: Scene, dt: float, steps: int, folder: Path) -> None:
    """InputError where neither the disk of a folder nor memory holds what a flexible flight of steps of dt writes."""
    given = f"{scene.name}.yaml: flight.duration_s = {scene.flight.duration_s:g}"
    fewer = (
        f"fly for a shorter time, or raise flight.snapshot_every_s = {scene.flight.snapshot_every_s:g} and "
        f"flight.series_every = {scene.flight.series_every}"
    )
    written = sum(file.stat().st_size for file in folder.glob("*")) if folder.is_dir() else 0  # by an earlier run
    require_disk(COPIES * journal_bytes(scene, dt, steps) - written, folder, given, fewer)
    require_memory(_rows(scene, steps) * A_FLEXIBLE_ROW, given, fewer)
    require_time(steps * LEAST, given, steps, "fly for a shorter time")


def require_time(seconds: float, given: str, steps: float, cure: str, what: str = "steps") -> None:
    """InputError, beginning with the key and its value, where a flight would take longer than any that is started."""
    if seconds > LONGEST:
        raise InputError(
            f"{given}: would take {in_words(seconds)} on this machine ({steps:.3g} {what}), more than the "
            f"{in_words(LONGEST)} allowed; {cure}"
        )


def say_rigid(scene: Scene, rows: int, steps: float, seconds: float) -> None:
    """The forecast of a rigid flight of so many steps and s, in one line on standard error.

    InputError where it would take too long.
    """
    most = scene.rigid.most_steps
    beyond = f", more than rigid.most_steps = {most}, which end it first" if steps > most else ""
    share = min(1.0, most / steps)
    given = f"{scene.name}.yaml: rigid.most_steps = {most}" if beyond else (
        f"{scene.name}.yaml: rigid.duration_s = {scene.rigid.duration_s:g}"
    )
    require_time(share * seconds, given, share * steps, "lower it")
    _say(scene, f"about {steps:.3g} steps{beyond}, {rows:,} rows", PROCESS + rows * A_ROW, share * seconds)


def require_cells(cells: int, blocks: int, given: str) -> None:
    """InputError, beginning with the file of the grid, where memory does not hold a map of so many cells, in blocks."""
    require_memory(
        PROCESS + cells * A_CELL / blocks, f"{given}: n_offsets · n_tilts = {cells:,}",
        "map fewer releases, or fly them in blocks (--block 1/100)",
    )


def say_basin(scene: Scene, cells: int, each: float) -> None:
    """The forecast of a map of so many flights of `each` s, as `say_rigid`."""
    fewer = "map fewer releases, or fly them in blocks"
    require_time(cells * each, f"{scene.name}: {cells:,} flights", cells, fewer, "flights")
    _say(scene, f"{cells:,} flights", PROCESS + cells * A_CELL, cells * each)


def require_members(members: int, given: str, cure: str, each: float = A_MEMBER) -> None:
    """InputError, beginning with the file of the members, where memory does not hold so many of `each` bytes."""
    require_memory(PROCESS + members * each, f"{given}: {members:,} members", cure)


def say_members(scene: Scene, members: int, seconds: float) -> None:
    """The forecast of the screening of so many members, which takes that many s, as `say_rigid`."""
    require_time(seconds, f"{scene.name}: {members:,} members", members, "screen them in parts", "members")
    _say(scene, f"{members:,} members", PROCESS + members * A_MEMBER, seconds)


def say_flexible(scene: Scene, dt: float, steps: int, left: float, folder: Path) -> None:
    """The forecast of a flexible flight of steps of dt in s, `left` of which take that many s, as `say_rigid`."""
    given = f"{scene.name}.yaml: flight.duration_s = {scene.flight.duration_s:g}"
    require_time(left, given, steps, f"fly for a shorter time or on fewer than sail.rings = {scene.sail.rings}")
    disk = f"{amount(COPIES * journal_bytes(scene, dt, steps), 'B')} of the disk's {amount(free_disk(folder), 'B')}"
    what = f"{nodes(scene.sail):,} nodes, {steps:,} steps of {dt:.3g} s, {disk}"
    _say(scene, what, flexible_memory(scene), left)


def _say(scene: Scene, what: str, memory: float, seconds: float) -> None:
    free = available_memory()
    print(
        f"{scene.name}: {what}, {amount(memory, 'B')} of memory ({amount(free, 'B')} free), about {in_words(seconds)}",
        file=sys.stderr, flush=True,
    )
