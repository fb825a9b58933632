"""What accuracy costs: error against time of every solver and setting, as a picture, one CSV file and a short table."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.io.files import atomic, run_stage
from workflow.benchmarks.rows import Row, read, write
from workflow.figures.drawing import COLOURS, parser, save

GOALS = (1e-2, 1e-3, 1e-4)
MARKERS = "osD^vP*Xh"
STYLES = (*COLOURS, "grey", "brown")


def pareto(rows: Iterable[Row]) -> list[Row]:
    """Rows that nothing quicker beats, from the quickest to the most accurate."""
    front: list[Row] = []
    for row in sorted(rows, key=lambda row: (row.seconds, row.error)):
        if not front or row.error < front[-1].error:
            front.append(row)
    return front


def panels(rows: list[Row]) -> list[tuple[str, str]]:
    """(cell, direction) of each panel, in order of appearance."""
    return list(dict.fromkeys((row.cell, row.direction) for row in rows))


def _panel(axes: Axes, rows: list[Row], solvers: list[str]) -> None:
    for k, solver in enumerate(solvers):
        mine = [row for row in rows if row.solver == solver]
        if not mine:
            continue
        style = {"color": STYLES[k % len(STYLES)], "marker": MARKERS[k % len(MARKERS)], "markersize": 4}
        axes.loglog([r.seconds for r in mine], [r.error for r in mine], linestyle="", alpha=0.6, **style)
        front = pareto(mine)
        axes.loglog([r.seconds for r in front], [r.error for r in front], label=solver, linewidth=1, **style)
        for row in (front[0], front[-1]):
            axes.annotate(row.setting, (row.seconds, row.error), fontsize=6, xytext=(3, 3), textcoords="offset points")


def draw(rows: list[Row]) -> Figure:
    """One panel a cell and direction."""
    places = panels(rows)
    solvers = list(dict.fromkeys(row.solver for row in rows))
    columns = min(2, len(places))
    lines = -(-len(places) // columns)
    figure, grid = plt.subplots(lines, columns, figsize=(4.6 * columns, 3.0 * lines), squeeze=False)
    for axes, place in zip(grid.flat, places, strict=False):
        _panel(axes, [row for row in rows if (row.cell, row.direction) == place], solvers)
        axes.set_title(" · ".join(place))
        axes.set_xlabel("CPU time / s")
        axes.set_ylabel("error")
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, high / 30), 3.0 * high)  # more than a decade, with room for the labels
    for axes in grid.flat[len(places) :]:
        axes.set_axis_off()
    entries = dict(entry for axes in grid.flat for entry in zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=4)
    return figure


def cheapest(rows: list[Row], solver: str, goal: float) -> str:
    """Setting and time of the cheapest row of a solver that meets the goal, or a dash."""
    good = [row for row in rows if row.solver == solver and row.error <= goal]
    if not good:
        return "–"
    best = min(good, key=lambda row: row.seconds)
    return f"{best.seconds:.2g} s ({best.setting})"


def markdown(rows: list[Row]) -> str:
    """The cheapest setting of every solver that meets each goal, by cell and direction."""
    lines = ["| cell, direction | solver | " + " | ".join(f"error ≤ {goal:g}" for goal in GOALS) + " |"]
    lines.append("|---" * (2 + len(GOALS)) + "|")
    for cell, where in panels(rows):
        here = [row for row in rows if (row.cell, row.direction) == (cell, where)]
        for solver in dict.fromkeys(row.solver for row in here):
            cells = " | ".join(cheapest(here, solver, goal) for goal in GOALS)
            lines.append(f"| {cell}, {where} | {solver} | {cells} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Join rows, draw them, write the table."""
    arguments: argparse.ArgumentParser = parser(main.__doc__)
    arguments.add_argument("--rows", required=True, nargs="+", type=Path, help="CSV files of the benchmarks")
    arguments.add_argument("--csv", required=True, type=Path, help="CSV to write")
    arguments.add_argument("--markdown", required=True, type=Path, help="table to write")
    given = arguments.parse_args()
    rows = [row for path in given.rows for row in read(path)]
    write(given.csv, rows)
    with atomic(given.markdown) as temporary:
        Path(temporary).write_text(markdown(rows), encoding="utf-8")
    save(draw(rows), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
