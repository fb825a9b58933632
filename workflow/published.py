"""The published flights: which scenes, for how long, on how fine a mesh, and what the paper says of each.

    python -m workflow.published --scene workflow/scenes/fig6.yaml --out results/published/fig6/fig6.yaml

writes the scene as it is flown: its own, with the duration and the rings of workflow/published.yaml.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from beamrider.io.checksum import with_checksum
from beamrider.io.files import (
    InputError,
    Name,
    Positive,
    Stopwatch,
    Strict,
    atomic,
    finish,
    load_yaml,
    run_stage,
    validate,
)
from dynamics.scene.schema import Scene, read_scene

SOURCE = Path("workflow/published.yaml")
SNAPSHOTS = 500

Quantity = Literal[
    "outcome",
    "leaves the beam",
    "largest distance from the axis",
    "largest tilt",
    "peak temperature",
    "highest temperature of the coldest point",
    "largest strain",
    "speed at the end",
    "x",
    "y",
    "z",
    "temperature_max_triangles",
    "temperature_mean",
    "strain_max",
]
Outcome = Literal[
    "rides the beam",
    "leaves the beam",
    "swings wider and wider",
    "tips over",
    "collapses",
    "tears",
    "falls to pieces",
]


class Expected(Strict):
    """One published number or outcome: as printed, and from `low` to `high` what agrees with it; `at_s`: at that time.

    outcomes: one of these must happen; also: what may come with it. Nothing else may.
    Units are those of the table of results: s, m, °, K, m/s; strain as a fraction.
    """

    quantity: Quantity
    paper: str | float
    low: float | None = None
    high: float | None = None
    at_s: float | None = None
    outcomes: list[Outcome] = []
    also: list[Outcome] = []

    @model_validator(mode="after")
    def _consistent(self) -> Expected:
        if bool(self.outcomes) != (self.quantity == "outcome"):
            raise ValueError(f"outcomes: must be given for the outcome, and for it only, not for '{self.quantity}'")
        return self


class PublishedFlight(Strict):
    """A scene of workflow/scenes as published.

    figure: where; rings, duration_s: instead of the scene's; tables: the sources flown on; remark: who is right, and
    why, where ours differs.
    """

    scene: Name
    figure: str
    rings: Annotated[int, Field(ge=2)] | None = None
    duration_s: Positive | None = None
    tables: Annotated[list[Literal["modal", "published"]], Field(min_length=1)] = ["modal"]
    expected: list[Expected] = []
    remark: str = ""


class _Flights(Strict):
    flights: list[PublishedFlight]


def read_published(path: str | Path = SOURCE) -> dict[str, PublishedFlight]:
    """The published flights by scene, in the order of the file; InputError names what is wrong in it."""
    flights = validate({"flights": load_yaml(path)}, _Flights, path).flights
    return {flight.scene: flight for flight in flights}


def as_flown(scene: Scene, flight: PublishedFlight) -> Scene:
    """The scene with the rings and the duration of the published flight, and at most SNAPSHOTS snapshots.

    A given time step goes with the width of the mesh.
    """
    duration, rings = flight.duration_s or scene.flight.duration_s, flight.rings or scene.sail.rings
    changes = {"duration_s": duration, "snapshot_every_s": max(scene.flight.snapshot_every_s, duration / SNAPSHOTS)}
    if scene.flight.time_step_s is not None:
        changes["time_step_s"] = scene.flight.time_step_s * scene.sail.rings / rings
    return scene.model_copy(
        update={
            "sail": scene.sail.model_copy(update={"rings": rings}),
            "flight": scene.flight.model_copy(update=changes),
        }
    )


def main() -> None:
    """Write a published scene as it is flown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", required=True, type=Path, help="scene to fly")
    parser.add_argument("--out", required=True, type=Path, help="YAML file to write, named as the scene")
    given = parser.parse_args()
    watch, flights, scene = Stopwatch(), read_published(), read_scene(given.scene)
    if scene.name not in flights:
        raise InputError(f"--scene {given.scene}: must be one of {SOURCE}: {', '.join(flights)}")
    with atomic(given.out) as temporary:
        # JSON is YAML
        data = as_flown(scene, flights[scene.name]).model_dump(exclude_none=True)
        temporary.write_bytes(with_checksum(f"{json.dumps(data, indent=1)}\n".encode(), 0, b"# "))
    finish(given.out, watch, f"scene {scene.name} as it is flown")


if __name__ == "__main__":
    run_stage(main)
