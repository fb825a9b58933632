"""What a flexible flight will take: memory and disk space from its scene before it starts, time from its first steps.

Bytes are what flights were measured to take at most, while they are built (`tests/dynamics/test_forecast`).
"""

from __future__ import annotations

import math
from pathlib import Path

from beamrider.io.files import amount
from beamrider.io.resources import available_memory, free_disk, require_disk, require_memory
from dynamics.sail.forecast import PROCESS, nodes, require_time, say, triangles
from dynamics.scene.schema import Scene

#: Bytes a node of a flexible sail, by what carries the load.
A_NODE = {"triangles": 6700.0, "springs": 5600.0, "corotating": 19400.0}
#: Nodes for which the bytes a node of the factorised matrices hold; they grow as its logarithm (George, SIAM J. Numer.
#: Anal. 10 (1973) 345).
FACTORISED = 11_000.0
#: Bytes a row when the file is written.
A_ROW = 720.0
#: Times of the journal on the disk while a flight's file is written beside it, with its margin.
COPIES = 2.2
#: Time in s that no machine needs less of for a step.
LEAST = 1e-7


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
        needed,
        f"{scene.name}.yaml: sail.rings = {rings}",
        f"take at most {fit} rings, which fit" if fit else "free some memory",
    )


def journal_bytes(scene: Scene, dt: float, steps: int) -> float:
    """Bytes of the rows and frames of a flexible flight of so many steps of dt in s."""
    # Only here: compiled modules take a second to load
    from dynamics.membrane.effects import tethers
    from dynamics.membrane.output.record import WIDTH

    failed = triangles(scene.sail) if scene.flight.on_failure != "stop" else 0
    frames = 2 + steps / max(1.0, scene.flight.snapshot_every_s / dt)
    width = WIDTH + tethers.width(len(scene.carried), sum(len(body.tethers) for body in scene.carried))
    return 8.0 * (width * _rows(scene, steps) + frames * (1 + 7 * nodes(scene.sail) + failed))


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
    require_memory(_rows(scene, steps) * A_ROW, given, fewer)
    require_time(steps * LEAST, given, steps, "fly for a shorter time")


def say_flexible(scene: Scene, dt: float, steps: int, left: float, folder: Path) -> None:
    """The forecast of a flexible flight of steps of dt in s, `left` of which take that many s, as `say_rigid`."""
    given = f"{scene.name}.yaml: flight.duration_s = {scene.flight.duration_s:g}"
    require_time(left, given, steps, f"fly for a shorter time or on fewer than sail.rings = {scene.sail.rings}")
    disk = f"{amount(COPIES * journal_bytes(scene, dt, steps), 'B')} of the disk's {amount(free_disk(folder), 'B')}"
    what = f"{nodes(scene.sail):,} nodes, {steps:,} steps of {dt:.3g} s, {disk}"
    say(scene, what, flexible_memory(scene), left)
