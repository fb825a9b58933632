"""Error against time of whole modal tables, by the tolerance asked for: orders, spacing and interpolation together.

The error is that of the table's look-up at random directions within ±25°, against ±60 orders at each of them.

    python -m workflow.benchmarks.accuracy_tables --out accuracy_tables.csv
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from beamrider.io.files import run_stage
from optics.cells.schema import read_metagrating
from optics.modal.stage import make_table, solve
from workflow.benchmarks.rows import CELLS, DESIGNS, Row, write_measured

TOLERANCES = (1e-2, 3e-3, 1e-3)
RANGE = 0.4227
TRUTH = 60
LEVELS = ((0.5, "table, median"), (0.99, "table, 99 %"))


def tables() -> Iterator[Row]:
    """Each cell at each tolerance."""
    rng = np.random.default_rng(5)
    for name in CELLS:
        cell = read_metagrating(DESIGNS / f"{name}.yaml")
        u, v = rng.uniform(-RANGE, RANGE, 60), rng.uniform(0.0, RANGE, 10)
        truth = solve(cell, u, v, TRUTH).q
        for tolerance in TOLERANCES:
            begin = time.process_time()
            table = make_table(cell, RANGE, RANGE, tolerance)
            spent = time.process_time() - begin
            error = np.abs(table.q(u[:, None], v) - truth).max(axis=-1)
            for level, where in LEVELS:
                yield Row("modal table", name, where, f"{tolerance:g}", float(np.quantile(error, level)), spent)


def main() -> None:
    """Measure and write."""
    write_measured(__doc__, tables())


if __name__ == "__main__":
    run_stage(main)
