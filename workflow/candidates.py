"""The best members of a screened family as designs and scenes of their own, for FDTD, tables and flights."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from beamrider.io.checksum import with_checksum
from beamrider.io.files import atomic, read_lines, reading, run_stage
from beamrider.io.parquet import read_parquet
from dynamics.scene.materials import Material
from dynamics.scene.schema import Scene, read_scene
from workflow.family import Family, read_family

HEADER = "# Made by the workflow: member {number} of family {family}, rank {rank}.\n"


def best_members(family: Family, screened: pd.DataFrame) -> pd.DataFrame:
    """The members that go on, best first: eligible ones, without the base sail itself."""
    eligible = screened[screened["eligible"] & (screened.index > 0)]
    return eligible.sort_values("rank").head(family.best.count)


def scene_of(base: Scene, member: pd.Series, designs: dict[str, str]) -> dict[str, Any]:
    """The base scene with a member's cells, sectors, spin and beam; `designs` by those of the base."""
    data = base.model_dump(exclude_none=True)
    half = float(member["sail.sector_deg"]) / 2.0
    starts = (half, 180.0 - half, 180.0 + half, 360.0 - half)
    for sector, described, start in zip(data["sail"]["sectors"], base.sail.sectors, starts, strict=True):
        sector["from_deg"], sector["design"] = start, designs[str(described.design)]
        sector.pop("thickness_m", None)  # and that of the material: the member's cell has its own
        if isinstance(described.material, Material):
            sector["material"] = described.material.model_copy(update={"thickness_m": None}).model_dump()
    data["beam"]["radius_m"] = float(member["sail.beam_radius_m"])
    data["release"]["spin_Hz"] = float(member["sail.spin_Hz"])
    return data | {"name": "sail", "description": f"{base.description}; candidate of a screened family"}


def write(folder: Path, family: Family, base: Scene, screened: pd.DataFrame, cells: list[dict[str, Any]]) -> None:
    """Write te.yaml, tm.yaml and sail.yaml of every candidate to folder/1, folder/2 …"""
    designs = {str(base.sail.sectors[-1].design): "te"}
    designs |= {d: "tm" for d in base.sail.designs if d not in designs}
    folder.mkdir(parents=True, exist_ok=True)
    for place, (number, member) in enumerate(best_members(family, screened).iterrows(), start=1):
        files: dict[str, dict[str, Any]] = {}
        for group in ("te", "tm"):
            cell = cells[int(member[f"{group}_cell"])] | {"name": group}
            files[group] = cell
        files["sail"] = scene_of(base, member, designs)
        for name, data in files.items():
            with atomic(folder / str(place) / f"{name}.yaml") as temporary:
                head = HEADER.format(number=number, family=family.name, rank=int(member["rank"]))
                text = head + yaml.safe_dump(data, sort_keys=False)
                temporary.write_bytes(with_checksum(text.encode(), 0, b"# "))


def main() -> None:
    """Write the best members of a family."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--family", required=True, help="YAML file of the family")
    parser.add_argument("--scene", required=True, help="YAML file of its base scene")
    parser.add_argument("--screened", required=True, help="Parquet file of dynamics.screening")
    parser.add_argument("--cells", required=True, type=Path, help="cells of the family, one JSON a line")
    parser.add_argument("--out", required=True, type=Path, help="folder to write to")
    given = parser.parse_args()
    with reading(given.cells, "cells, one JSON a line"):
        cells = [json.loads(line) for line in read_lines(given.cells)]
    write(given.out, read_family(given.family), read_scene(given.scene), read_parquet(given.screened), cells)


if __name__ == "__main__":
    run_stage(main)
