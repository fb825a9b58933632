"""Error against CPU time of FDTD: plain Meep, this project's runs at one resolution, and their pairs.

Error of q_g and q_n against the modal method with ±120 orders; the time of a pair is that of both of its runs.

    python -m workflow.benchmarks.accuracy_fdtd --out accuracy_fdtd.csv
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import nullcontext

import numpy as np

from beamrider.io.files import progress, run_stage
from optics.cells.schema import Metagrating, read_metagrating
from optics.fdtd.direction import extrapolate
from optics.fdtd.grid import pixels
from optics.fdtd.run import import_meep
from optics.modal.response import solve
from workflow.benchmarks.plain_meep import plain, pressure
from workflow.benchmarks.rows import CELLS, DESIGNS, Row, directions, write_measured

RESOLUTIONS = (7.45, 10.65, 14.9, 21.3, 29.8)  # pixels per wavelength in the material
TRUTH = 120


def ladder(cell: Metagrating, u: float, v: float, way: str) -> Iterator[tuple[str, str, np.ndarray, float]]:
    """(solver, setting, q (2,), CPU seconds) of every resolution, and of pairs of neighbours."""
    before = None
    for resolution in RESOLUTIONS:
        start = time.process_time()
        with plain() if way == "Meep, plain" else nullcontext():
            q = pressure(cell, u, v, resolution)
        spent = time.process_time() - start
        yield way, f"{resolution:g}/λ", q, spent
        now = pixels(cell, resolution), q
        if before is not None and way == "Meep":
            pair, earlier = before
            yield "Meep, pair", f"to {resolution:g}/λ", extrapolate(pair, now)[0], earlier + spent
        before = now, spent


def rows() -> Iterator[Row]:
    """Every cell, direction and setting."""
    import_meep()  # takes a second, which belongs to no direction
    cases = [(name, *where, way) for name in CELLS for where in directions(name) for way in ("Meep", "Meep, plain")]
    for name, where, u, v, way in progress(cases, "FDTD", unit="direction"):
        cell = read_metagrating(DESIGNS / f"{name}.yaml")
        truth = solve(cell, np.array([u]), np.array([v]), TRUTH).q[0, 0, [0, 2]]
        for solver, setting, q, spent in ladder(cell, u, v, way):
            yield Row(solver, name, where, setting, float(np.abs(q - truth).max()), spent)


def main() -> None:
    """Measure and write."""
    write_measured(__doc__, rows())


if __name__ == "__main__":
    run_stage(main)
