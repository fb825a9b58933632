"""What a rigid flight, a basin or a screening will take: memory from its scene before it starts, time from its start.

`dynamics.membrane.forecast` is about flexible flight. Bytes are what flights were measured to take at most, while they
are built (`tests/dynamics/test_forecast`).
"""

from __future__ import annotations

import math
import sys

from beamrider.io.files import InputError, amount
from beamrider.io.resources import DAY, available_memory, in_words, require_memory
from dynamics.sail.shapes import SIDES
from dynamics.scene.schema import Sail, Scene

#: Bytes of a process that has loaded everything: with Debian 13's Python 3.13 and NumPy 2, or with older ones.
PROCESS = 0.32e9 if sys.version_info >= (3, 13) else 0.22e9
#: Bytes a row of a rigid flight.
A_ROW = 900.0
#: Bytes a cell of a basin's map, and a member of a family that is screened.
A_CELL, A_MEMBER = 200.0, 1000.0
#: Bytes a member whose two cells are made.
A_MADE_MEMBER = 9000.0
#: No flight is started that would take longer, in s.
LONGEST = 30.0 * DAY


def nodes(sail: Sail) -> int:
    """Nodes of a sail's mesh: its apex, and on ring k the outline's sides times its hops times k."""
    sides, hops = SIDES[sail.outline]
    return 1 + sides * hops * sail.rings * (sail.rings + 1) // 2


def triangles(sail: Sail) -> int:
    """Triangles of a sail's mesh."""
    sides, hops = SIDES[sail.outline]
    return sides * hops * sail.rings**2


def require_rows(scene: Scene) -> int:
    """Rows of a scene's rigid flight; InputError where memory does not hold them."""
    given = scene.rigid
    rows = math.ceil(given.duration_s * given.output_Hz)
    require_memory(
        PROCESS + rows * A_ROW,
        f"{scene.name}.yaml: rigid.duration_s = {given.duration_s:g}",
        f"fly for a shorter time, or lower rigid.output_Hz = {given.output_Hz:g}",
    )
    return rows


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
    given = (
        f"{scene.name}.yaml: rigid.most_steps = {most}"
        if beyond
        else (f"{scene.name}.yaml: rigid.duration_s = {scene.rigid.duration_s:g}")
    )
    require_time(share * seconds, given, share * steps, "lower it")
    say(scene, f"about {steps:.3g} steps{beyond}, {rows:,} rows", PROCESS + rows * A_ROW, share * seconds)


def require_cells(cells: int, blocks: int, given: str) -> None:
    """InputError, beginning with the file of the grid, where memory does not hold a map of so many cells, in blocks."""
    require_memory(
        PROCESS + cells * A_CELL / blocks,
        f"{given}: n_offsets · n_tilts = {cells:,}",
        "map fewer releases, or fly them in blocks (--block 1/100)",
    )


def say_basin(scene: Scene, cells: int, each: float) -> None:
    """The forecast of a map of so many flights of `each` s, as `say_rigid`."""
    fewer = "map fewer releases, or fly them in blocks"
    require_time(cells * each, f"{scene.name}: {cells:,} flights", cells, fewer, "flights")
    say(scene, f"{cells:,} flights", PROCESS + cells * A_CELL, cells * each)


def require_members(members: int, given: str, cure: str, each: float = A_MEMBER) -> None:
    """InputError, beginning with the file of the members, where memory does not hold so many of `each` bytes."""
    require_memory(PROCESS + members * each, f"{given}: {members:,} members", cure)


def say_members(scene: Scene, members: int, seconds: float) -> None:
    """The forecast of the screening of so many members, which takes that many s, as `say_rigid`."""
    require_time(seconds, f"{scene.name}: {members:,} members", members, "screen them in parts", "members")
    say(scene, f"{members:,} members", PROCESS + members * A_MEMBER, seconds)


def say(scene: Scene, what: str, memory: float, seconds: float) -> None:
    """One line on standard error: what is begun, with bytes of memory, those free, and the time in s to expect."""
    free = available_memory()
    print(
        f"{scene.name}: {what}, {amount(memory, 'B')} of memory ({amount(free, 'B')} free), about {in_words(seconds)}",
        file=sys.stderr,
        flush=True,
    )
