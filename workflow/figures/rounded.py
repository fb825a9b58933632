"""What rounding the corners changes, and how far FDTD, which takes a curve as it is, and the modal staircase agree.

For each cell three responses: of the sharp cell and of the staircase by the modal method, solved here at every third u
and v of an FDTD table, and that table. Drawn along u, largest over v; the CSV holds the numbers over all of them.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

from beamrider.arrays import Floats
from beamrider.io.files import atomic, run_stage
from optics.cells.outline import read_grating, upright
from optics.modal.stage import solve
from optics.table.pressure_table import PressureTable
from workflow.figures.drawing import BLUE, ORANGE, RED, parser, save

ORDERS = 27  # within 3e-4 of the paper's cells here
SLICES = 12
STEP = 3
CURVES = (("sharp, modal", ORANGE, "-"), ("rounded, modal staircase", BLUE, "-"), ("rounded, FDTD", RED, ":"))


class Comparison(NamedTuple):
    """Of one cell: the FDTD table, and at u (n_u) and some v (n_v) of it the larger differences of q_g and q_n.

    error: what FDTD states; away: FDTD from the staircase; changed: the staircase from the sharp cell; in_plane
    (3, n_u): q_n at v = 0 of the sharp cell, the staircase and FDTD.
    """

    table: PressureTable
    u: Floats
    error: Floats
    away: Floats
    changed: Floats
    in_plane: Floats


def compare(table: PressureTable, rounded: Path, sharp: Path) -> Comparison:
    """Solve the staircase and the sharp cell at some directions of a table, those at its edges among them."""
    some_u, some_v = (np.append(np.arange(0, nodes.size - 1, STEP), nodes.size - 1) for nodes in (table.u, table.v))
    some = np.ix_(some_u, some_v)
    found, u = np.moveaxis(table.q_nodes, 0, -1)[some], table.u[some_u]
    stairs, edges = (
        solve(upright(read_grating(path), SLICES), u, table.v[some_v], ORDERS).q for path in (rounded, sharp)
    )
    away, changed = (np.abs(a - b)[..., [0, 2]].max(axis=-1) for a, b in ((found, stairs), (stairs, edges)))
    in_plane = np.stack([q[:, 0, 2] for q in (edges, stairs, found)])
    return Comparison(table, u, table.error[some], away, changed, in_plane)


def numbers(one: Comparison) -> Iterator[tuple[str, float]]:
    """Name and value of each number of the CSV."""
    for name, values in (("FDTD − staircase", one.away), ("staircase − sharp", one.changed)):
        yield f"|{name}|, largest", float(values.max())
        yield f"|{name}|, 95 % below", float(np.quantile(values, 0.95))
    yield "share of directions within the error that FDTD states", float((one.away <= one.error).mean())
    yield "stated error, median", float(np.median(one.error))
    yield "stated error by true, median", float(np.median(one.error / one.away))
    yield "directions solved", len(one.table.attrs["nodes_u"]) * len(one.table.attrs["nodes_v"])
    yield "CPU time of FDTD (s)", float(one.table.attrs["cpu_seconds"])


def draw(comparisons: list[Comparison]) -> Figure:
    """q_n along u above, differences below; a column a cell."""
    figure, axes = plt.subplots(2, len(comparisons), figsize=(5 * len(comparisons), 6.5), sharex="col", squeeze=False)
    for one, (above, below) in zip(comparisons, axes.T, strict=True):
        u = one.u
        for values, (label, colour, line) in zip(one.in_plane, CURVES, strict=True):
            above.plot(u, values, color=colour, ls=line, label=label)
        above.legend()
        above.set(title=one.table.name, ylabel="$q_n$ at v = 0")
        below.semilogy(u, one.changed.max(axis=1), color=ORANGE, label="|staircase − sharp|: what rounding changes")
        below.semilogy(u, one.away.max(axis=1), color=BLUE, label="|FDTD − staircase|")
        below.semilogy(u, one.error.max(axis=1), color="0.5", ls="--", label="error that FDTD states")
        below.set(xlabel="u", ylabel="largest over v, of $q_g$ and $q_n$")
        below.legend()
    return figure


def main() -> None:
    """Draw the cells, write and print the numbers."""
    arguments = parser(__doc__)
    arguments.add_argument("--tables", required=True, nargs="+", type=Path, help="FDTD table of each rounded cell")
    arguments.add_argument("--rounded", required=True, nargs="+", type=Path, help="its YAML file")
    arguments.add_argument("--sharp", required=True, nargs="+", type=Path, help="YAML of the cell with sharp corners")
    arguments.add_argument("--csv", required=True, type=Path, help="CSV of the numbers to write")
    given = arguments.parse_args()
    with threadpool_limits(1):
        comparisons = [
            compare(PressureTable.read(table), rounded, sharp)
            for table, rounded, sharp in zip(given.tables, given.rounded, given.sharp, strict=True)
        ]
    rows = [(one.table.name, name, f"{value:.4g}") for one in comparisons for name, value in numbers(one)]
    with atomic(given.csv) as temporary, Path(temporary).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("cell", "quantity", "value"), *rows])
    for row in rows:
        print(": ".join(row))
    save(draw(comparisons), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
