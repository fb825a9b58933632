"""Error against time of rigid flights: integration tolerance, quadrature, spacing and source of the tables, one by one.

    python -m workflow.benchmarks.accuracy_rigid --scene workflow/scenes/fig6.yaml --tables "modal 1e-3=te.h5,tm.h5" \
        "modal 1e-2=te2.h5,tm2.h5" --out rigid.csv --markdown rigid.md --png rigid.png

The error of a trajectory is the distance, at 1 s, across the beam from the best flight: tolerance 1e-13,
quadrature 1e-13, first of the tables. That of the multipliers is the largest distance to those of the first tables;
they come from closed integrals and need neither tolerance nor quadrature. `spacing` takes the first tables' values on
plain grids of so many direction cosines a step. All seconds are CPU time: of a flight without compilation, of tables
what making them took, where the file says so.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from beamrider.io.files import atomic, run_stage
from dynamics.rigid import stage as rigid
from dynamics.scene.schema import Scene
from dynamics.stability import floquet
from optics.table.pressure_table import PressureTable
from workflow.benchmarks.flight_rows import Tables, write_rows

mpl.use("Agg")

TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
QUADRATURES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-11)
SPACINGS = (0.04, 0.02, 0.01, 0.005, 0.0025)
BEST = 1e-13
REPEATS = 3
GOALS = (1e-2, 1e-3, 1e-4, 1e-6)


class Row(NamedTuple):
    """One measurement; an error that the knob cannot have is NaN."""

    knob: str
    setting: str
    error_multiplier: float
    error_trajectory_1s: float
    seconds: float
    directions: float
    table_seconds: float


def _flown(scene: Scene, tables: Tables, tolerance: float, quadrature: float) -> tuple[np.ndarray, float]:
    """(x, y) at 1 s, and CPU seconds, the best of several flights."""
    settings = scene.rigid.model_copy(update={"duration_s": 1.0, "tolerance": tolerance})
    case = scene.model_copy(update={"rigid": settings})
    best = math.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        flight = rigid.fly(case, tables, quadrature=quadrature)
        best = min(best, time.process_time() - begin)
    if flight.end_reason != "finished":
        return np.full(2, math.nan), best
    return flight.position[-1, :2], best


def _plain(tables: Tables, step: float) -> Tables:
    """The same response on uniform grids, interpolated like any table without cut-offs."""
    out = {}
    for name, table in tables.items():
        n, m = (int(np.floor(axis[-1] / step)) for axis in (table.u, table.v))
        u, v = step * np.arange(-n, n + 1.0), step * np.arange(m + 1.0)
        q = np.moveaxis(table.q(u[:, None], v), -1, 0)
        absorptance = table.absorptance(u[:, None], v)
        attrs = {"name": name, "wavelength_m": table.attrs["wavelength_m"]}
        error = np.full((u.size, v.size), 1e-3)
        out[name] = PressureTable(u, v, q, absorptance, error, mirror_v=True, attrs=attrs)
    return out


def rows(scene: Scene, sets: dict[str, Tables]) -> Iterator[Row]:
    """Every knob at every setting."""
    first = next(iter(sets.values()))
    best, _ = _flown(scene, first, BEST, BEST)
    for knob, settings in (("tolerance", TOLERANCES), ("quadrature", QUADRATURES)):
        for value in settings:
            chosen = (value, BEST) if knob == "tolerance" else (1e-11, value)
            place, seconds = _flown(scene, first, *chosen)
            yield Row(knob, f"{value:g}", math.nan, math.dist(place, best), seconds, math.nan, math.nan)
    multipliers = floquet.analyse(scene, first).multipliers
    spaced = {f"{step:g}": _plain(first, step) for step in SPACINGS}
    for knob, group in (("spacing", spaced), ("tables", sets)):
        for name, tables in group.items():
            place, seconds = _flown(scene, tables, 1e-11, BEST)
            error = floquet.distance(floquet.analyse(scene, tables).multipliers, multipliers)
            directions = sum(table.error.size for table in tables.values())
            made = sum(float(table.attrs.get("cpu_seconds", math.nan)) for table in tables.values())
            yield Row(knob, name, error, math.dist(place, best), seconds, directions, made)


def _cheapest(found: list[Row], goal: float) -> str:
    """Setting and flight time of the cheapest row that meets a goal in the trajectory, or a dash."""
    good = [row for row in found if row.error_trajectory_1s <= goal]
    if not good:
        return "–"
    best = min(good, key=lambda row: row.seconds)
    return f"{best.seconds:.2g} s ({best.setting})"


def markdown(found: list[Row]) -> str:
    """The cheapest setting of each knob for each error at 1 s; then every table: both errors and what it costs."""
    lines = ["| knob | " + " | ".join(f"path at 1 s within {goal:g} m" for goal in GOALS) + " |"]
    lines.append("|---" * (1 + len(GOALS)) + "|")
    for knob in ("tolerance", "quadrature"):
        mine = [row for row in found if row.knob == knob]
        lines.append(f"| {knob} | " + " | ".join(_cheapest(mine, goal) for goal in GOALS) + " |")
    lines += ["", "| tables | directions | path at 1 s (m) | multipliers | flight | making them |", "|---" * 6 + "|"]
    reference = next(row for row in found if row.knob == "tables")
    for row in found:
        if row.knob in ("spacing", "tables"):
            name = f"plain grid, step {row.setting}" if row.knob == "spacing" else row.setting
            made = "" if math.isnan(row.table_seconds) else f"{row.table_seconds:.0f} s"
            errors = (f"{row.error_trajectory_1s:.1e}", f"{row.error_multiplier:.1e}")
            errors = ("reference", "reference") if row is reference else errors
            lines.append(f"| {name} | {row.directions:.0f} | {' | '.join(errors)} | {row.seconds:.2g} s | {made} |")
    return "\n".join(lines) + "\n"


def draw(path: Path, found: list[Row], title: str) -> None:
    """Error against time for tolerance and quadrature, against directions for the spacing, and of each table."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4.5), constrained_layout=True)
    for knob, mark in (("tolerance", "o-"), ("quadrature", "s-")):
        chosen = [row for row in found if row.knob == knob and row.error_trajectory_1s > 0]
        left.semilogy([row.seconds for row in chosen], [row.error_trajectory_1s for row in chosen], mark, label=knob)
        for k, row in enumerate(chosen):
            place = (row.seconds, row.error_trajectory_1s)
            left.annotate(row.setting, place, fontsize=6, xytext=(4, 4 - 11 * (k % 2)), textcoords="offset points")
    left.set(xlabel="CPU time of 1 s of flight (s)", ylabel="error across the beam at 1 s (m)", title=title)
    left.legend()
    spaced = [row for row in found if row.knob == "spacing"]
    steps = [float(row.setting) for row in spaced]
    middle.loglog(steps, [row.error_trajectory_1s for row in spaced], "o-", label="path at 1 s (m)")
    middle.loglog(steps, [row.error_multiplier for row in spaced], "s-", label="multipliers")
    middle.set_xticks(steps, [row.setting for row in spaced])
    middle.minorticks_off()
    middle.set(xlabel="step of a plain grid of direction cosines", title="spacing of the tables")
    middle.legend()
    tables = [row for row in found if row.knob == "tables"][1:]
    at = np.arange(len(tables))
    right.bar(at - 0.2, [row.error_trajectory_1s for row in tables], 0.4, label="path at 1 s (m)")
    right.bar(at + 0.2, [row.error_multiplier for row in tables], 0.4, label="multipliers")
    right.set_xticks(at, [row.setting for row in tables], rotation=20)
    right.set(yscale="log", title="difference from the first tables")
    right.set_ylim(top=6.0 * right.get_ylim()[1])
    right.legend(loc="upper left")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)
    plt.close(figure)


def main() -> None:
    """Measure and write."""
    write_rows(__doc__, rows, markdown, draw)


if __name__ == "__main__":
    run_stage(main)
