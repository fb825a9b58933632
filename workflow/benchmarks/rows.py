"""What the accuracy benchmarks share: the columns of their CSV files, the directions they look at, CPU time."""

from __future__ import annotations

import argparse
import csv
import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.io.files import atomic

DESIGNS = Path(__file__).parents[1] / "designs"
CELLS = ("mark1e_te", "mark1e_tm")
# Within ±10°: far from and on the steepest flank of a resonance of each cell.
EASY = (0.05, 0.02)
RESONANT = {"mark1e_te": (-0.153, 0.02), "mark1e_tm": (0.128, 0.02)}


class Row(NamedTuple):
    """One measurement: error of q and CPU seconds of one solver at one setting, for a direction or a whole table."""

    solver: str
    cell: str
    direction: str
    setting: str
    error: float
    seconds: float


def directions(cell: str) -> list[tuple[str, float, float]]:
    """(name, u, v) of the directions that a cell is solved in."""
    return [("easy", *EASY), ("resonant", *RESONANT[cell])]


def seconds(work: Callable[[], object], repeats: int = 3) -> float:
    """CPU seconds of a piece of work, the best of several."""
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return best


def write_measured(description: str | None, rows: Iterable[Row]) -> None:
    """Command line of a benchmark, `--out FILE`: measure the rows on one thread and write them."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=Path)
    arguments = parser.parse_args()
    with threadpool_limits(1):
        write(arguments.out, rows)


def _text(value: Any) -> str:
    """A cell of a CSV file: numbers to five digits, nothing for NaN."""
    if not isinstance(value, float):
        return str(value)
    return "" if math.isnan(value) else f"{value:.4e}"


def write(path: Path, rows: Iterable[NamedTuple]) -> None:
    """Write rows of one kind, at least one, as CSV, atomically; what has no value stays empty."""
    found = list(rows)
    with atomic(path) as temporary, Path(temporary).open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(found[0]._fields)
        table.writerows(map(_text, row) for row in found)


def read(path: Path) -> list[Row]:
    """Rows of a CSV file that `write` made."""
    with path.open(newline="", encoding="utf-8") as file:
        texts = [[row[name] for name in Row._fields] for row in csv.DictReader(file)]
    return [Row(a, b, c, d, float(error), float(spent)) for a, b, c, d, error, spent in texts]
