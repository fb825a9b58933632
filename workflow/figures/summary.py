"""The key numbers of a whole run as one table, for spreadsheets (CSV) and for the report (HTML).

Columns: what (table, difference, stability, flight, wall time), of (design or scene), quantity, value, unit.
"""

from __future__ import annotations

import argparse
import csv
import html
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from beamrider.io.files import Stopwatch, atomic, finish, read_json, run_stage
from beamrider.io.hdf5 import read_hdf5
from optics.table.pressure_table import PressureTable
from optics.table.promise import read_promise
from workflow.figures.drawing import read_series, solver

Row = tuple[str, str, str, str, str]
COLUMNS = ("what", "of", "quantity", "value", "unit")


def _number(value: float) -> str:
    return f"{value:.6g}"


def table_rows(path: Path) -> Iterator[Row]:
    """Size, error and cost of a pressure table at results/tables/DESIGN/SOLVER.h5."""
    table = PressureTable.read(path)
    of = f"{path.parent.name}, {path.stem}"
    yield "table", of, "directions", f"{table.u.size} × {table.v.size}", ""
    yield "table", of, "error of q, median", _number(float(np.median(table.error))), ""
    kept = read_promise(table)
    yield "table", of, "error of q, at 99 % of the directions", _number(kept.error_99), ""
    place = f"{_number(kept.largest)} at u = {kept.at[0]:.4g}, v = {kept.at[1]:.4g}"
    yield "table", of, "error of q, largest", place, ""
    yield "table", of, f"tolerance {kept.tolerance:g}", "met" if kept.met else f"MISSED ({kept.why})", ""
    for key, unit in (("energy_imbalance", ""), ("cpu_seconds", "s")):
        if key in table.attrs:
            yield "table", of, key.replace("_", " "), _number(float(table.attrs[key])), unit


def difference_rows(modal: Path, fdtd: Path) -> Iterator[Row]:
    """|FDTD − modal| of q_g and q_n over the directions of the FDTD table."""
    rough, fine = PressureTable.read(fdtd), PressureTable.read(modal)
    q = fine.q(rough.u[:, None], rough.v)[..., [0, 2]]
    difference = np.abs(np.moveaxis(rough.q_nodes[[0, 2]], 0, -1) - q).max(axis=-1)
    for name, value in (("largest", difference.max()), ("95 % below", np.quantile(difference, 0.95))):
        yield "FDTD − modal", fdtd.parent.name, f"|Δq|, {name}", _number(float(value)), ""


def stability_rows(path: Path) -> Iterator[Row]:
    """Verdict and multipliers (without spin: exponents) of a stability analysis; of conjugate pairs the upper one."""
    data = read_json(path)
    of = f"{path.parent.name}, {solver(data)} tables"
    yield "stability", of, "verdict", data["verdict"].replace("_", " "), ""
    if data["undecided_because"]:
        yield "stability", of, "undecided because of", data["undecided_because"], ""
    if data["tables_missed"]:
        yield "stability", of, "tables that MISSED their tolerance", ", ".join(data["tables_missed"]), ""
    if data["max_modulus"] is None:
        rates = data["exponents_1_s"]
        yield "stability", of, "largest growth rate", _number(max(re for re, _ in rates)), "1/s"
        upper = [f"{re:.4g}{im:+.4g}i" for re, im in sorted(rates) if im >= 0]
        yield "stability", of, "exponents, Im ≥ 0", ", ".join(upper), "1/s"
        return
    yield "stability", of, "largest |λ|", f"{data['max_modulus']:.7g}", ""
    upper = [f"{re:.5f}{im:+.5f}i" for re, im in sorted(data["multipliers"]) if im >= 0]
    yield "stability", of, "multipliers, Im λ ≥ 0", ", ".join(upper), ""


def flight_rows(path: Path) -> Iterator[Row]:
    """End of results/scenes/SCENE/{rigid.h5,flight.vtkhdf}, and extremes of the flight."""
    series = read_series(path)
    of = f"{path.parent.name}, {'rigid' if path.suffix == '.h5' else 'flexible'}"
    with read_hdf5(path) as file:
        said = {**file.attrs, **(file["series"].attrs if "series" in file else {})}
    yield "flight", of, "end reason", str(said["end_reason"]), ""
    if said["table_error_design"]:
        yield "flight", of, "largest table error on the way", _number(float(said["table_error_largest"])), ""
        yield "flight", of, "force error over thrust, at most", _number(float(said["force_error_over_thrust"])), ""
    if said["tables_missed"]:
        yield "flight", of, "tables that MISSED their tolerance", str(said["tables_missed"]), ""
    yield "flight", of, "end", _number(series["time"][-1]), "s"
    yield "flight", of, "final position", ", ".join(_number(x) for x in series["position"][-1]), "m"
    yield "flight", of, "largest distance from the axis", _number(np.hypot(*series["position"][:, :2].T).max()), "m"
    for angle in ("pitch", "roll"):
        yield "flight", of, f"largest |{angle}|", _number(np.degrees(np.abs(series[angle]).max())), "°"
    for name, unit in (("temperature_max", "K"), ("strain_max", "")):
        if name in series:
            yield "flight", of, f"largest {name.removesuffix('_max')}", _number(series[name].max()), unit


def _stage(path: Path) -> tuple[str, str]:
    """Scene or design, and stage, of a benchmark file; the parts of one FDTD table are one stage."""
    if path.parent.name == "fdtd":
        return path.parent.parent.name, "fdtd, all parts" if path.stem.startswith("part") else f"fdtd {path.stem}"
    return path.parent.name, "fdtd merge" if path.stem == "fdtd" else path.stem


def wall_rows(paths: list[Path]) -> Iterator[Row]:
    """Wall time of every stage from Snakemake's benchmark files."""
    seconds: dict[tuple[str, str], list[float]] = {}
    for path in paths:
        with open(path, encoding="utf-8") as stream:
            first = next(csv.DictReader(stream, delimiter="\t"))
        seconds.setdefault(_stage(path), []).append(float(first["s"]))
    for (of, stage), times in seconds.items():
        yield "wall time", of, stage, _number(sum(times)), "s"
    yield "wall time", "all stages", "sum over jobs", _number(sum(map(sum, seconds.values()))), "s"


def rows(given: argparse.Namespace) -> Iterator[Row]:
    """All rows, in the order of the workflow."""
    for path in given.tables:
        yield from table_rows(path)
    for path in given.tables:
        if path.name == "fdtd.h5":
            yield from difference_rows(path.with_name("modal.h5"), path)
    for path in given.floquet:
        yield from stability_rows(path)
    for path in given.flights:
        yield from flight_rows(path)
    yield from wall_rows(given.benchmarks)


def _html(table: list[Row]) -> str:
    lines = ["".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in table]
    head = "".join(f"<th>{name}</th>" for name in COLUMNS)
    style = "table{border-collapse:collapse;font:14px sans-serif}td,th{padding:3px 10px;border-bottom:1px solid #ccc}"
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return f"<!doctype html><meta charset='utf-8'><style>{style}</style><table><tr>{head}</tr>\n{body}</table>\n"


def main() -> None:
    """Write the summary of a run."""
    watch = Stopwatch()
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("tables", "floquet", "flights", "benchmarks"):
        parser.add_argument(f"--{name}", nargs="*", default=[], type=Path)
    parser.add_argument("--out", required=True, type=Path, help="CSV to write")
    parser.add_argument("--html", required=True, type=Path, help="HTML to write")
    given = parser.parse_args()
    table = list(rows(given))
    with atomic(given.out) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([COLUMNS, *table])
    with atomic(given.html) as temporary:
        temporary.write_text(_html(table), encoding="utf-8")
    finish(given.out, watch, f"{len(table)} key numbers, as HTML beside it")


if __name__ == "__main__":
    run_stage(main)
