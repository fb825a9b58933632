"""What the light that its gratings take up does to the paper's sail: flexible flights of one scene, as JSON.

The paper heats it with the absorptance of a plain film, right physics with that of the tables. Either is flown with
both bounds of what carries tension in the plane (`flight.in_plane`); then the brightest beam, and the least emissivity,
with which no more than `TAUT` of the sail is ever slack are found by bisection.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from beamrider.io.files import InputError, progress, run_stage, take_out, write_json
from dynamics.membrane.flight import Flight
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from optics.table.pressure_table import PressureTable

RINGS, DURATION = 12, 0.6
TAUT = 1e-2
HALVINGS = 5
#: Where the search begins: shares of the beam's intensity, and emissivities of a face.
INTENSITY, EMISSIVITY = (0.1, 1.0), (0.1, 0.8)
VARIANTS = [(a, p) for a in ("material", "table") for p in ("mass_equivalent", "membrane")]


def variant(base: Scene, absorptance: str, in_plane: str, share: float = 1.0, emissivity: float | None = None) -> Scene:
    """The scene on `RINGS` rings for `DURATION`, with a share of its beam and another emissivity of both faces."""
    sectors = base.sail.sectors
    if emissivity is not None:
        faces = {"emissivity_front": emissivity, "emissivity_back": emissivity, "thickness_m": None}
        sectors = [s.model_copy(update={"material": s.properties.model_copy(update=faces)}) for s in sectors]
    flight = {
        "duration_s": DURATION,
        "in_plane": in_plane,
        "snapshot_every_s": 1e-3,
        "optics_every": 4,
        "heat_every": 4,
    }
    return base.model_copy(
        update={
            "absorptance": absorptance,
            "flight": base.flight.model_copy(update=flight),
            "sail": base.sail.model_copy(update={"rings": RINGS, "sectors": sectors}),
            "beam": base.beam.model_copy(update={"intensity_W_m2": share * base.beam.intensity_W_m2}),
        }
    )


def fly(scene: Scene, tables: dict[str, PressureTable]) -> dict[str, Any]:
    """A flight's end, peak temperature in K, largest strain and slack share since the release, path in m."""
    with tempfile.TemporaryDirectory() as folder:
        flight = Flight(scene, tables, Path(folder))
        end = flight.fly()
        areas = flight.membrane.mesh.areas / flight.membrane.mesh.areas.sum()
        slack = [f.slack @ areas for f in flight.frames() if f.slack is not None and f.time >= 0.0]
        series = {name: values for name, (values, _) in flight.columns().items()}
    lit = series["time"] >= 0.0
    return {
        "absorptance": scene.absorptance,
        "in_plane": scene.flight.in_plane,
        "intensity_W_m2": scene.beam.intensity_W_m2,
        "emissivity": scene.sail.sectors[0].properties.emissivity_front,
        "end": end.reason,
        "time_s": end.time,
        "temperature_K": float(series["temperature_max"].max()),
        "strain": float(series["strain_max"][lit].max()),
        "slack": float(max(slack)),
        "distance_m": float(np.hypot(*series["position"].T[:2]).max()),
        "height_m": float(series["position"][-1, 2]),
    }


def bisect(flown: Callable[[float], dict[str, Any]], taut: float, slack: float) -> dict[str, Any]:
    """The flight nearest to the edge that is taut, between a value that should be and one that isn't.

    InputError where the first is slack, too: the range in which it is looked for is too small.
    """
    best = flown(taut)
    if best["slack"] > TAUT:
        raise InputError(f"at {taut:g} the sail is still slack over {best['slack']:.2g} of its area")
    for _ in range(HALVINGS):
        middle = 0.5 * (taut + slack)
        found = flown(middle)
        if found["slack"] > TAUT:
            slack = middle
        else:
            taut, best = middle, found
    return best


def study(base: Scene, tables: dict[str, PressureTable]) -> dict[str, Any]:
    """The flights of all variants, and where the sail of equal mass in the plane is taut again."""
    rows = [fly(variant(base, *kind), tables) for kind in progress(VARIANTS, "heat", unit="flight")]
    kind = ("table", "mass_equivalent")
    found: dict[str, Any] = {"scene": base.name, "rings": RINGS, "taut": TAUT, "flights": rows}
    if next(row for row in rows if (row["absorptance"], row["in_plane"]) == kind)["slack"] > TAUT:
        found["intensity"] = bisect(lambda share: fly(variant(base, *kind, share=share), tables), *INTENSITY)
        found["emissivity"] = bisect(
            lambda face: fly(variant(base, *kind, emissivity=face), tables), *reversed(EMISSIVITY)
        )
    return found


def main() -> None:
    """Fly a scene with either absorptance."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", required=True, help="scene of a sail of gratings")
    parser.add_argument("--tables", nargs="+", required=True, help="pressure tables of its designs")
    parser.add_argument("--out", required=True, help="JSON to write")
    given = parser.parse_args()
    take_out(given.out)
    base = read_scene(given.scene)
    write_json(given.out, study(base, load_tables(given.tables, base)))


if __name__ == "__main__":
    run_stage(main)
