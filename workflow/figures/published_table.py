"""The published flights against the paper: every published number beside ours, as CSV, Markdown and HTML."""

from __future__ import annotations

import argparse
import csv
import html
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from beamrider.io.files import atomic, run_stage
from workflow.figures.drawing import named
from workflow.figures.flight_result import FlightResult, events, number, outcome, read
from workflow.published import Expected, PublishedFlight, Quantity, read_published


class Row(NamedTuple):
    """One comparison; `agrees` is empty where the paper gives nothing to compare with."""

    figure: str
    scene: str
    tables: str
    rings: int
    seconds: str
    quantity: str
    ours: str
    paper: str
    agrees: str


#: What is told of every flight, whether the paper gives it or not.
ALWAYS: tuple[Quantity, ...] = (
    "outcome",
    "largest distance from the axis",
    "largest tilt",
    "peak temperature",
    "largest strain",
)


def _within(flown: FlightResult, entry: Expected, value: float, bounded: bool) -> bool:
    """Does it agree; `bounded`: the paper's sail rides the beam, so that a lost one has none of its largest values."""
    found = set(events(flown)) or {"rides the beam"}
    if entry.outcomes:
        return bool(found & set(entry.outcomes)) and found <= {*entry.outcomes, *entry.also}
    if bounded and entry.at_s is None and found != {"rides the beam"}:
        return False
    low, high = (-np.inf if entry.low is None else entry.low), (np.inf if entry.high is None else entry.high)
    return bool(low <= value <= high)


def rows(source: str, flown: FlightResult, published: PublishedFlight) -> Iterator[Row]:
    """All comparisons of a flight, and what else is told of it."""
    plain = [Expected(quantity=q, paper="", outcomes=["rides the beam"] if q == "outcome" else []) for q in ALWAYS]
    given = {entry.quantity for entry in published.expected if entry.at_s is None}
    bounded = any("rides the beam" in entry.outcomes for entry in published.expected)
    end = f"{flown.series['time'][-1]:.4g}"
    for entry in [*published.expected, *(entry for entry in plain if entry.quantity not in given)]:
        value = np.nan if entry.outcomes else number(flown, entry.quantity, entry.at_s)
        at = "" if entry.at_s is None else f" at {entry.at_s:g} s"
        ours = outcome(flown) if entry.outcomes else "–" if np.isnan(value) else f"{value:.6g}"
        agrees = "" if entry.paper == "" else "yes" if _within(flown, entry, value, bounded) else "no"
        paper = entry.paper if isinstance(entry.paper, str) else f"{entry.paper:.7g}"
        where = (published.figure, published.scene, source, flown.scene.sail.rings, end)
        yield Row(*where, entry.quantity + at, ours, paper, agrees)


def _markdown(table: list[Row], remarks: dict[str, str]) -> str:
    lines = [f"| {' | '.join(Row._fields)} |", f"|{'---|' * len(Row._fields)}"]
    lines += [f"| {' | '.join(map(str, row))} |" for row in table]
    return "\n".join([*lines, "", *(f"- **{scene}**: {text}" for scene, text in remarks.items())]) + "\n"


def _html(table: list[Row], remarks: dict[str, str]) -> str:
    style = "table{border-collapse:collapse;font:14px sans-serif}td,th{padding:3px 10px;border-bottom:1px solid #ccc}"
    head = "".join(f"<th>{name}</th>" for name in Row._fields)
    body = "\n".join(f"<tr>{''.join(f'<td>{html.escape(str(cell))}</td>' for cell in row)}</tr>" for row in table)
    notes = "\n".join(f"<p><b>{scene}</b>: {html.escape(text)}</p>" for scene, text in remarks.items())
    return f"<!doctype html><meta charset='utf-8'><style>{style}</style><table><tr>{head}</tr>\n{body}</table>{notes}\n"


def main() -> None:
    """Write the table of the published flights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", required=True, nargs="+", type=named, help="SCENE:TABLES=flight.vtkhdf")
    parser.add_argument("--out", required=True, type=Path, help="CSV to write")
    parser.add_argument("--html", required=True, type=Path)
    parser.add_argument("--markdown", required=True, type=Path)
    given = parser.parse_args()
    published = read_published()
    table: list[Row] = []
    for name, path in given.flights:
        scene, _, source = name.partition(":")
        table += rows(source, read(path), published[scene])
    remarks = {name: flight.remark for name, flight in published.items() if flight.remark}
    with atomic(given.out) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([Row._fields, *table])
    for path, text in ((given.html, _html(table, remarks)), (given.markdown, _markdown(table, remarks))):
        with atomic(path) as temporary:
            temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    run_stage(main)
