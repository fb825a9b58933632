"""Speed of the modal method: against `meent` on a table of 51 × 51 directions, and how the cost grows.

Both solvers use the same factorisation rules and agree to rounding order by order, so that equal orders mean equal
errors: those that `optics.modal` chooses for 1e-3. `meent` (NumPy, its continuous Fourier series, which is its fastest
exact setting here) is timed on random directions of the table and scaled to all of them. One core, one thread; times
are CPU times, the best of several. Ours has its smooth part found anew each time (`optics.modal.core`); what it takes
with every direction solved by itself is given beside it.

    python -m workflow.benchmarks.modal_speed [--directions 60]
"""

from __future__ import annotations

import argparse
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.io.files import run_stage
from optics.cells.schema import Metagrating, read_metagrating
from optics.modal.response import Response, solve
from optics.modal.truncation import choose
from workflow.benchmarks import meent_solver
from workflow.benchmarks.rows import CELLS, DESIGNS, seconds

RANGE = 0.4227
TOLERANCE = 1e-3
NEGLIGIBLE = 1e-2 * TOLERANCE  # as in `optics.modal`
#: Orders that the growth is measured at, and directions a side of a large table.
ORDERS, LARGE = (10, 15, 22, 33, 50, 75), 201


def against_meent(cell: Metagrating, count: int) -> str:
    """One line: a table of 51 × 51 directions with either."""
    u, v = np.linspace(-RANGE, RANGE, 51), np.linspace(0.0, RANGE, 26)  # v < 0 is the mirror image
    chosen = choose(cell, RANGE, RANGE, TOLERANCE)
    order, some = chosen.order, slice(None, None, 5)

    def table() -> Response:
        return chosen.within((RANGE, RANGE), TOLERANCE, lambda: None).solve(u, v)

    error = np.quantile(np.abs(table().q[some, some] - solve(cell, u[some], v[some], 60).q).max(axis=-1), 0.95)
    ours, singly = seconds(table, 6), seconds(lambda: solve(cell, u, v, order, NEGLIGIBLE), 2)
    rng = np.random.default_rng(0)
    directions = rng.uniform([-RANGE, 0.0], RANGE, (count, 2))
    theirs = seconds(lambda: meent_solver.solve(cell, directions, order), 2) / count
    half = theirs * u.size * v.size
    return (
        f"{cell.name}: ±{order} orders, error {error:.1e} (95 %): ours {ours:.2f} s ({singly:.2f} s with every "
        f"direction solved); meent {1e3 * theirs:.1f} ms a direction, {2 * half:.1f} s for 51 × 51 ({half:.1f} s using "
        f"the mirror): {2 * half / ours:.0f} times ours ({half / ours:.0f} times with the mirror)"
    )


def growth(cell: Metagrating) -> list[str]:
    """How the cost grows with orders and with directions, and a large table."""
    v = np.linspace(0.0, RANGE, 26)
    lines = ["orders   ms for one u and 26 v   ms for one u and one v"]
    for order in ORDERS:
        row, one = (seconds(partial(solve, cell, np.array([0.1]), x, order)) for x in (v, v[3:4]))
        lines.append(f"{order:6d} {1e3 * row:22.1f} {1e3 * one:24.1f}")
    u, v = np.linspace(-RANGE, RANGE, LARGE), np.linspace(0.0, RANGE, LARGE // 2 + 1)
    order = choose(cell, RANGE, RANGE, TOLERANCE).order
    large = seconds(lambda: solve(cell, u, v, order, NEGLIGIBLE), 1)
    lines.append(f"{LARGE} × {LARGE} directions at ±{order} orders: {large:.1f} s")
    return lines


def main() -> None:
    """Print the comparison and the growth for the paper's two cells."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--directions", type=int, default=60)
    arguments = parser.parse_args()
    with threadpool_limits(1):
        for name in CELLS:
            cell = read_metagrating(DESIGNS / f"{name}.yaml")
            print(against_meent(cell, arguments.directions), flush=True)
            print(*growth(cell), sep="\n", flush=True)


if __name__ == "__main__":
    run_stage(main)
