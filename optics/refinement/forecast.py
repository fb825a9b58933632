"""What a table will cost, from the directions that it begins with and the time that a few of them take."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from beamrider.arrays import Floats
from beamrider.io.files import InputError

MOST_MINUTES = 30.0
# Refinement, its tests and the coarser solutions for the error cost as much again as the first directions this often.
_GROWTH = 6.0
_SAID_FROM = 60.0  # seconds
_BYTES = 16.0


@dataclass(frozen=True)
class Forecast:
    """Directions that a table begins with (rows × lines, and those beside cut-offs), CPU seconds, bytes."""

    rows: int
    lines: int
    beside: int
    seconds: float
    bytes: float

    @property
    def text(self) -> str:
        """In words."""
        minutes, memory = math.ceil(self.seconds / 60), self.bytes / 2**30
        return (
            f"{self.rows} × {self.lines} directions and {self.beside} beside cut-offs to begin with, about {minutes} "
            f"CPU minutes and {memory:.1f} GB"
        )


def forecast(
    solve: Callable[[Floats, Floats], Any], u: Floats, v: Floats, curves: int, order: int, layers: int
) -> Forecast:
    """Cost of a table of rows u (n,) and lines v (m,) with three lines of nodes at each of the cut-offs `curves`."""
    middle = u.size // 3
    one = _seconds(lambda: solve(u[middle : middle + 1], v[:1]))
    four = _seconds(lambda: solve(u[middle : middle + 1], v[:4]))
    each = max(four - one, 0.0) / max(min(4, v.size) - 1, 1)
    of_row = max(one - each, 0.0)
    beside = 3 * curves * v.size
    seconds = u.size * (of_row + v.size * each) + beside * (of_row + each)
    n = 2 * order + 1
    # twenty quantities a direction; f± and modes of every layer
    memory = _GROWTH * 20 * 8 * (u.size * v.size + beside) + layers * n * n * _BYTES * (5 + 3 * 4)
    return Forecast(u.size, v.size, beside, _GROWTH * seconds, memory)


def require_time(spent: float, name: str, most_minutes: float) -> None:
    """InputError where a table has taken more than `most_minutes`, whatever was forecast; spent in CPU seconds."""
    if spent > 60.0 * most_minutes:
        raise InputError(
            f"--most-minutes = {most_minutes:g}: the table of {name} has taken that long, longer than foreseen; raise "
            "it, or choose a larger --tolerance or smaller --u-max and --v-max"
        )


def _seconds(work: Callable[[], Any]) -> float:
    """CPU seconds that some work takes, the second time."""
    work()
    start = time.process_time()
    work()
    return time.process_time() - start


def announce(found: Forecast, name: str, most_minutes: float) -> None:
    """Say what a table will cost if it is a minute or more; InputError beyond `most_minutes`."""
    if found.seconds > 60.0 * most_minutes:
        raise InputError(
            f"--most-minutes = {most_minutes:g}: the table of {name} would take longer: {found.text}; raise it, or "
            "choose a larger --tolerance or smaller --u-max and --v-max"
        )
    if found.seconds >= _SAID_FROM:
        print(f"{name}: {found.text}", flush=True)
