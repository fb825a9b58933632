"""The best members of a screened family beside the sail they vary: stability from both solvers, basin and flights.

One row a sail, the base first. FDTD's columns are empty where FDTD was not run.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beamrider.io.files import InputError, atomic, read_json, reading, run_stage
from beamrider.io.hdf5 import read_hdf5
from beamrider.io.parquet import read_parquet
from workflow.candidates import best_members
from workflow.family import read_family

COLUMNS = {
    "sail": "",
    "what_differs": "",
    "thrust_N": "N",
    "acceleration_m_s2": "m/s²",
    "margin_1_s": "1/s",
    "margin_low_1_s": "1/s",
    "margin_high_1_s": "1/s",
    "verdict": "",
    "margin_fdtd_1_s": "1/s",
    "margin_fdtd_low_1_s": "1/s",
    "margin_fdtd_high_1_s": "1/s",
    "verdict_fdtd": "",
    "thrust_fdtd_N": "N",
    "basin_bounded": "",
    "basin_flights": "",
    "rigid_end": "",
    "rigid_distance_m": "m",
    "flexible_end": "",
    "flexible_time_s": "s",
    "flexible_distance_m": "m",
    "temperature_max": "K",
    "strain_max": "",
}


def stability(path: Path, suffix: str = "") -> dict[str, Any]:
    """Verdict, margin with its range, and thrust of a stability analysis; nothing where there is none."""
    if not path.exists():
        return {}
    found = read_json(path)
    low, high = found["margin_range_1_s"]
    return {
        f"verdict{suffix}": found["verdict"].replace("_", " "),
        f"margin{suffix}_1_s": found["margin_1_s"],
        f"margin{suffix}_low_1_s": low,
        f"margin{suffix}_high_1_s": high,
        f"thrust{suffix}_N": found["thrust_N"],
    }


def flights(folder: Path) -> dict[str, Any]:
    """How the rigid and the flexible flight ended, and their extremes."""
    with (
        reading(folder, "a folder of readable flights"),
        read_hdf5(folder / "rigid.h5") as rigid,
        read_hdf5(folder / "flight.vtkhdf") as flexible,
    ):
        series = flexible["series"]
        distance = {
            name: np.hypot(*data["position"][:, :2].T).max() for name, data in (("rigid", rigid), ("flexible", series))
        }
        return {
            "rigid_end": str(rigid.attrs["end_reason"]),
            "rigid_distance_m": float(distance["rigid"]),
            "flexible_end": str(series.attrs["end_reason"]),
            "flexible_distance_m": float(distance["flexible"]),
            "flexible_time_s": float(series["time"][-1]),
            **{name: float(series[name][()].max()) for name in ("temperature_max", "strain_max")},
        }


def basin(path: Path) -> dict[str, int]:
    """Bounded flights of a basin map, and all of them."""
    with reading(path, "a readable basin map"), read_hdf5(path) as file:
        code = json.loads(file.attrs["reasons"]).index("finished")
        return {"basin_bounded": int((file["end_code"][()] == code).sum()), "basin_flights": file["end_code"].size}


def differences(member: pd.Series, base: pd.Series) -> str:
    """The parameters of a member that differ from the base's, as text."""
    names = [str(key) for key in member.index if str(key).split(".")[0] in ("te", "tm", "sail") and "." in str(key)]
    return ", ".join(f"{name} {member[name]:g}" for name in names if member[name] != base[name])


def row(name: str, folder: Path, member: pd.Series, base: pd.Series) -> dict[str, Any]:
    """One line of the table."""
    found = {
        **stability(folder / "floquet.json"),
        **stability(folder / "floquet_fdtd.json", "_fdtd"),
        **flights(folder),
        **basin(folder / "basin" / "sail_frame.h5"),
    }
    return {
        "sail": name,
        "what_differs": differences(member, base),
        "acceleration_m_s2": member["acceleration_m_s2"],
        **found,
    }


def text(value: Any) -> str:
    """A value as it stands in the CSV; empty where there is none."""
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def markdown(rows: list[dict[str, Any]]) -> str:
    """The table turned on its side, one column a sail."""
    lines = [f"| | {' | '.join(r['sail'] for r in rows)} |", "|---" * (len(rows) + 1) + "|"]
    for key, unit in list(COLUMNS.items())[1:]:
        cells = [text(r.get(key)).replace("|", "/") for r in rows]
        label = key.removesuffix(f"_{unit.replace('/', '_').replace('²', '2')}") if unit else key
        if any(cells):
            lines.append(f"| {label.replace('_', ' ')}{f' ({unit})' if unit else ''} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Gather what was found out about the best members of a family."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--family", required=True, help="YAML file of the family")
    parser.add_argument("--screened", required=True, help="Parquet file of dynamics.screening")
    parser.add_argument("--base", required=True, type=Path, help="results of the base scene")
    parser.add_argument("--candidates", nargs="*", default=[], type=Path, help="results of each candidate, best first")
    parser.add_argument("--csv", required=True, type=Path, help="table to write")
    parser.add_argument("--markdown", required=True, type=Path, help="the same, one column a sail, to write")
    given = parser.parse_args()
    screened = read_parquet(given.screened)
    base, best = screened.iloc[0], best_members(read_family(given.family), screened)
    if len(best) != len(given.candidates):
        raise InputError(f"--candidates: {len(given.candidates)} folders; must be {len(best)}, one a member")
    rows = [row("base", given.base, base, base)]
    rows += [
        row(f"member {number}", folder, member, base)
        for folder, (number, member) in zip(given.candidates, best.iterrows(), strict=True)
    ]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([list(COLUMNS), *([text(r.get(key)) for key in COLUMNS] for r in rows)])
    for path, content in ((given.csv, stream.getvalue()), (given.markdown, markdown(rows))):
        with atomic(path) as temporary:
            temporary.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    run_stage(main)
