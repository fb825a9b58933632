"""Error of modal tables made for 1e-3, at 10,000 random directions within ±25°: of interpolation, and in all.

Interpolation: against the solver with the table's own number of orders at every direction. In all: against ±60 orders
at a tenth of them. The table's own error estimate is taken at the nearest node.

    python -m workflow.benchmarks.table_error [--cells mark1e_te mark1e_tm wide_gap_te wide_gap_tm]
"""

from __future__ import annotations

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.io.files import run_stage
from optics.cells.schema import Metagrating, read_metagrating
from optics.modal.stage import make_table, solve
from optics.table.pressure_table import PressureTable
from workflow.benchmarks.rows import DESIGNS, seconds

RANGE, TOLERANCE, TRUTH = 0.4227, 1e-3, 60
ROWS, LINES = 2000, 5


def errors(table: PressureTable, cell: Metagrating, u: np.ndarray, v: np.ndarray, order: int) -> np.ndarray:
    """Largest error of q's components (n, m) at directions u (n), v (n, m)."""
    exact = np.array([solve(cell, u[i : i + 1], line, order).q[0] for i, line in enumerate(v)])
    return np.asarray(np.abs(table.q(u[:, None], v) - exact).max(axis=-1))


def report(name: str) -> str:
    """One cell's lines."""
    cell, made = read_metagrating(DESIGNS / f"{name}.yaml"), []
    spent = seconds(lambda: made.append(make_table(cell, RANGE, RANGE, TOLERANCE)), 1)
    table = made[0]
    rng = np.random.default_rng(11)
    u, v = rng.uniform(-RANGE, RANGE, ROWS), np.sort(rng.uniform(-RANGE, RANGE, (ROWS, LINES)))
    own = errors(table, cell, u, v, table.attrs["settings"]["orders"])
    some = slice(0, ROWS // 10)
    every = errors(table, cell, u[some], v[some], TRUTH)
    row = np.abs(table.u - u[some, None]).argmin(axis=1)[:, None]
    line = np.abs(table.v - np.abs(v[some])[..., None]).argmin(axis=-1)
    order = table.attrs["settings"]["orders"]
    lines = [f"{name}: ±{order} orders, {table.u.size} × {table.v.size} nodes, {spent:.0f} s CPU"]
    for what, error in (("interpolation", own), ("in all", every)):
        levels = " ".join(f"{100 * p:g} % {np.quantile(error, p):.1e}" for p in (0.5, 0.95, 0.99, 0.999))
        lines.append(
            f"  {what:13s} {error.size:5d} directions: {levels} largest {error.max():.1e}; "
            f"{np.mean(error > 3 * TOLERANCE):.2%} above {3 * TOLERANCE:g}"
        )
    ratio = table.error[row, line] / every
    lines.append(f"  own estimate covers {np.mean(ratio >= 1):.1%}, exceeds tenfold {np.mean(ratio > 10):.1%}")
    return "\n".join(lines)


def main() -> None:
    """Print the errors of every cell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", default=["mark1e_te", "mark1e_tm", "wide_gap_te", "wide_gap_tm"])
    with threadpool_limits(1):
        for name in parser.parse_args().cells:
            print(report(name), flush=True)


if __name__ == "__main__":
    run_stage(main)
