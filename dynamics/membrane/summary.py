"""What a flight file says of the whole flight: end, first failure, errors of the tables, what was neglected."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from dynamics.light.pointing import from_beam
from dynamics.membrane.effects import tearing
from dynamics.membrane.flight import End, Flight
from dynamics.sail.neglected import neglected
from dynamics.sail.sectors import provenance
from dynamics.sail.table_error import TableErrors, membrane_errors
from optics.table.pressure_table import PressureTable


def first_failure(flight: Flight) -> dict[str, Any]:
    """When, where and how the first triangle failed of a flight that goes on after it; nothing if none did."""
    broken = flight.work.effects.tearing
    if tearing.failures(broken) == 0:
        return {}
    kind = "tensile_failure" if broken.tally[tearing.KIND] == tearing.BY_STRESS else "thermal_failure"
    place = {"first_failure_time": float(broken.first[0]), "first_failure_position": broken.first[1:].copy()}
    return {"first_failure": kind, "first_failure_triangle": int(broken.tally[tearing.FIRST]), **place}


def errors_met(flight: Flight, tables: dict[str, PressureTable]) -> TableErrors:
    """What the tables' stated errors come to on the way of a flight, in its snapshots from the release on."""
    n, mesh = flight.model.masses.size, flight.membrane.mesh
    points = [numbers[1 : 1 + 3 * n].reshape(n, 3) for numbers in flight.journal.frames if numbers[0] >= 0.0]
    if flight.model.effects.light.wander.periods.size > 0:
        times = [float(numbers[0]) for numbers in flight.journal.frames if numbers[0] >= 0.0]
        points = [from_beam(flight.model.effects.light.wander, t, one) for t, one in zip(times, points, strict=True)]
    return membrane_errors(flight.membrane.scene, tables, mesh, points)


def lit_from_behind(flight: Flight) -> float | None:
    """Time in s of the first snapshot in which a part of the lit sail turns away from the light, None if none does."""
    n, triangles = flight.model.masses.size, flight.membrane.mesh.triangles
    for numbers in flight.journal.frames:
        x, failed = numbers[1 : 3 * n + 1].reshape(n, 3), numbers[7 * n + 1 :]
        a, b, c = (x[triangles[:, i], :2] for i in range(3))
        facing = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        there = failed == 0.0 if flight.work.effects.tearing.gone.size else np.ones(facing.size, bool)
        if numbers[0] >= 0.0 and np.any(facing[there] <= 0.0):
            return float(numbers[0])
    return None


def attributes(flight: Flight, end: End, tables: dict[str, PressureTable]) -> dict[str, Any]:
    """What /series says about the whole flight."""
    model, scene, columns = flight.model, flight.membrane.scene, flight.columns()
    time, position, velocity = (columns[name][0] for name in ("time", "position", "velocity"))
    return {
        "neglected": neglected(scene, tables, time, position, velocity, lit_from_behind(flight)),
        "end_reason": end.reason,
        "end_time": end.time,
        "end_position": end.position,
        "end_detail": end.detail,
        "steps": end.step,
        "time_step": model.dt,
        "mass_kg": float(model.masses.sum()),
        "scene": scene.model_dump_json(),
        "tables": json.dumps(provenance(tables)),
        "effects": json.dumps({name: effect.on for name, effect in flight.membrane.plan.items()}),
        "wall_seconds": flight.wall_seconds,
        "outside_table": int(flight.work.effects.light.outside[0]),
        **first_failure(flight),
    }
