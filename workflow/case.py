"""One published case with one incidence model: linear stability two ways, and rigid flights of 5 s, as JSON."""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from beamrider.io.files import (
    InputError,
    Name,
    Positive,
    Stopwatch,
    Strict,
    finish,
    load_yaml,
    run_stage,
    take_out,
    validate,
    write_json,
)
from dynamics.rigid import stage as rigid
from dynamics.rigid.basin import Grid, fly_cells
from dynamics.rigid.body import rigid_body
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from dynamics.stability import floquet
from optics.table.pressure_table import PressureTable

NOMINAL = ("mark1e_te", "mark1e_tm")
DURATION = 5.0
SMALL, TURNS = 1e-6, 10
# Offsets to 0.2 m by tilts to ±8°, all towards 45°: a map of its own (`snakemake basins`) is finer.
BASIN = Grid(offsets_m=[0.0, 0.2], n_offsets=5, n_tilts=9, duration_s=DURATION)


class Case(Strict):
    """What differs from the base scene; `designs` are those of the TE and the TM sectors."""

    name: Name
    label: str
    spin_Hz: float = -120.0
    beam_radius_m: Positive = 0.4
    designs: list[Name] = Field(default=list(NOMINAL), min_length=2, max_length=2)
    offset_m: float = 0.05
    tilt_deg: float = 2.0
    paper_verdict: Literal["marginally_stable", "unstable"] | None = None
    paper_flight: Literal["bounded", "lost"] | None = None


class _Cases(Strict):
    cases: list[Case]


def read_cases(path: str | Path) -> dict[str, Case]:
    """The cases of a YAML file by name, in its order."""
    cases = validate({"cases": load_yaml(path)}, _Cases, path).cases
    return {case.name: case for case in cases}


def variant(base: Scene, case: Case, tilted: bool) -> Scene:
    """The base scene with what the case changes."""
    swap = dict(zip(NOMINAL, case.designs, strict=True))
    sectors = [s.model_copy(update={"design": swap[str(s.design)]}) for s in base.sail.sectors]
    tilt = case.tilt_deg if tilted else 0.0
    release = base.release.model_copy(
        update={
            "offset_m": [case.offset_m, case.offset_m],
            "pitch_deg": tilt,
            "roll_deg": tilt,
            "spin_Hz": case.spin_Hz,
        }
    )
    return base.model_copy(
        update={
            "name": f"{case.name}_{base.incidence}",
            "sail": base.sail.model_copy(update={"sectors": sectors}),
            "beam": base.beam.model_copy(update={"radius_m": case.beam_radius_m}),
            "release": release,
            "rigid": base.rigid.model_copy(update={"duration_s": DURATION, "tolerance": 1e-9}),
        }
    )


@dataclass(frozen=True)
class Flight:
    """End of a rigid flight: reason, time in s, largest distance from the beam's axis in m, largest tilt in degrees."""

    end: str
    time_s: float
    distance_m: float
    tilt_deg: float

    @property
    def bounded(self) -> bool:
        """Did it last to the end?"""
        return self.end == "finished"


def fly(scene: Scene, tables: dict[str, PressureTable]) -> Flight:
    """Fly a scene."""
    flight = rigid.fly(scene, tables)
    tilt = np.degrees(np.arccos(np.clip(flight.rotation[:, 2, 2], -1.0, 1.0)))
    distance = np.hypot(*flight.position[:, :2].T)
    return Flight(flight.end_reason, float(flight.time[-1]), float(distance.max()), float(tilt.max()))


def small_flight_difference(scene: Scene, tables: dict[str, PressureTable], model: floquet.LinearModel) -> float:
    """How far a tiny motion of the full equations is, after some turns, from the power of the monodromy matrix."""
    units, turns = rigid_body(scene, tables).units, TURNS
    small = SMALL * np.array([1.0, -0.5, 2.0, 1.0, 0.7, -0.4, 3.0, 1.5])
    x, y, vx, vy, roll, pitch, p, q = small
    start = np.array([x, y, 0, vx, vy, 0, 1, roll / 2, pitch / 2, 0, p, q, model.spin]) * units.state[:13]
    seconds = turns / abs(scene.release.spin_Hz)
    short = scene.model_copy(
        update={
            "beam": scene.beam.model_copy(update={"rise_s": 0.0}),
            "lookup": "smooth",
            "rigid": scene.rigid.model_copy(update={"duration_s": seconds, "tolerance": 1e-12}),
        }
    )
    flight = rigid.fly(short, tables, start)
    tilts = [angle[-1] for angle in flight.angles[:2]]
    speed = units.time / units.length
    end = [
        *flight.position[-1, :2] / units.length,
        *flight.velocity[-1, :2] * speed,
        *tilts,
        *flight.angular_velocity[-1, :2] * units.time,
    ]
    want = np.linalg.matrix_power(model.monodromy(), turns) @ small
    return float(np.linalg.norm(end - want) / np.linalg.norm(want))


def basin_share(scene: Scene, tables: dict[str, PressureTable]) -> float:
    """Share of the releases of a coarse grid that stay within one radius of the beam."""
    basin = fly_cells(scene, tables, BASIN, range(BASIN.n_offsets * BASIN.n_tilts))
    return float((basin.columns["end_time"] >= DURATION * (1.0 - 1e-9)).mean())


def study(base: Scene, case: Case, tables: dict[str, PressureTable]) -> dict[str, Any]:
    """All numbers of one case."""
    displaced, tilted = (variant(base, case, tilt) for tilt in (False, True))
    found = floquet.analyse(displaced, tables)
    flights = {"displaced": fly(displaced, tables), "tilted": fly(tilted, tables)}
    return {
        "case": case.name,
        "label": case.label,
        "incidence": base.incidence,
        "verdict": found.verdict,
        "max_modulus": found.max_modulus,
        "margin_1_s": found.margin,
        "margin_range_1_s": list(found.margin_range),
        "multipliers": floquet.pairs(found.multipliers),
        "route_difference": found.route_difference,
        "small_flight_difference": small_flight_difference(displaced, tables, found.model),
        "jacobian": found.model.jacobian.tolist(),
        "paper_verdict": case.paper_verdict,
        "paper_flight": case.paper_flight,
        "basin_share": basin_share(displaced, tables),
        "offset_m": case.offset_m,
        "release_tilt_deg": case.tilt_deg,
        "flights": {name: {**asdict(flight), "bounded": flight.bounded} for name, flight in flights.items()},
    }


def main() -> None:
    """Analyse and fly one case."""
    watch = Stopwatch()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", required=True, help="YAML list of the cases")
    parser.add_argument("--case", required=True, help="name of the case")
    parser.add_argument("--scene", required=True, help="base scene, with its incidence model")
    parser.add_argument("--tables", nargs="+", required=True, help="pressure tables of the case's designs")
    parser.add_argument("--out", required=True, help="JSON to write")
    given = parser.parse_args()
    take_out(given.out)
    cases = read_cases(given.cases)
    if given.case not in cases:
        raise InputError(f"--case = {given.case!r}: must be one of {', '.join(cases)}")
    base, case = read_scene(given.scene), cases[given.case]
    write_json(given.out, study(base, case, load_tables(given.tables, variant(base, case, False))))
    finish(given.out, watch, f"case {given.case}")


if __name__ == "__main__":
    run_stage(main)
