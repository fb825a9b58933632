"""What a flexible flight came to: events (it leaves the beam, collapses, tears, tips over) and numbers to compare."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import reading
from beamrider.io.hdf5 import read_hdf5
from dynamics.scene.schema import Scene
from workflow.figures.drawing import read_series

#: Share of its first breadth below which a sail counts as collapsed.
NARROW = 0.5
#: How many times as far as in each earlier quarter of the flight a sail that swings wider and wider gets from the axis
#: in the last one, and the share of the beam's radius that it then gets at least.
WIDER, FAR = 2.0, 1e-2
#: End reasons that have an event of their own, or none.
_KNOWN = ("finished", "fly_away", "tensile_failure", "thermal_failure", "left_table", "broken")


@dataclass(frozen=True)
class FlightResult:
    """A flight: series since the start, attributes of the end, the scene, breadth (k,) at the times (k,) of frames.

    breadth: the second of the three singular values of the nodes about their mean, relative to that at release. A sail
    that folds up or is drawn out loses it; turning and bending change it little.
    """

    series: dict[str, Floats]
    end: dict[str, Any]
    scene: Scene
    frame_times: Floats
    breadth: Floats

    @property
    def released(self) -> dict[str, Floats]:
        """Series since the release; all there is where it never came."""
        chosen = self.series["time"] >= 0
        return {name: values[chosen] for name, values in self.series.items()} if chosen.any() else self.series


def read(path: Path) -> FlightResult:
    """A flight file."""
    series = read_series(path)
    with reading(path, "a readable flight"), read_hdf5(path) as file:
        end, grid = dict(file["series"].attrs), file["VTKHDF"]
        times, starts = grid["Steps/Values"][()], grid["Steps/PointOffsets"][()]
        n = int(grid["NumberOfPoints"][0])
        chosen = np.flatnonzero(times >= 0) if times[-1] >= 0 else np.arange(times.size)
        chosen = chosen[:: max(1, chosen.size // 250)]
        breadth = np.array([_breadth(grid["Points"][starts[i] : starts[i] + n]) for i in chosen])
    scene = Scene.model_validate(json.loads(end["scene"]))
    return FlightResult(series, end, scene, times[chosen], breadth / breadth[0])


def _breadth(points: Floats) -> float:
    centred = points - points.mean(axis=0)
    return float(np.sqrt(max(np.linalg.eigvalsh(centred.T @ centred)[1], 0.0)))


def events(flown: FlightResult) -> dict[str, float]:
    """Outcomes with their times in s, in order of time; empty for a sail that rides the beam to the end."""
    found, series, reason = {}, flown.released, str(flown.end["end_reason"])
    away = np.flatnonzero(np.hypot(*series["position"][:, :2].T) > flown.scene.beam.reach_m)
    if away.size or reason == "fly_away":
        found["leaves the beam"] = float(series["time"][away[0]]) if away.size else float(flown.end["end_time"])
    start = _widening(np.hypot(*series["position"][:, :2].T), flown.scene.beam.reach_m)
    if start is not None and not found:
        found["swings wider and wider"] = float(series["time"][start])
    narrow = np.flatnonzero(flown.breadth < NARROW)
    if narrow.size:
        found["collapses"] = float(flown.frame_times[narrow[0]])
    if "first_failure_time" in flown.end:
        found["tears"] = float(flown.end["first_failure_time"])
    elif reason in ("tensile_failure", "thermal_failure"):
        found["tears"] = float(flown.end["end_time"])
    if reason == "left_table":
        found["tips over"] = float(flown.end["end_time"])
    if reason == "broken":
        found["falls to pieces"] = float(flown.end["end_time"])
    if reason not in _KNOWN:
        found[f"ends ({reason})"] = float(flown.end["end_time"])
    return dict(sorted(found.items(), key=lambda item: item[1]))


def _widening(distance: Floats, radius: float) -> int | None:
    """Where a sail that swings wider and wider first gets WIDER times as far as in the first quarter; None if not."""
    if distance.size < 4:
        return None
    most = np.array([part.max() for part in np.array_split(distance, 4)])
    if most[3] < FAR * radius or np.any(most[3] < WIDER * most[:3]):
        return None
    return int(np.flatnonzero(distance > WIDER * most[0])[0])


def outcome(flown: FlightResult) -> str:
    """The events in words, with times."""
    found = events(flown)
    last = f"{flown.series['time'][-1]:.3g} s"
    if not found:
        return f"rides the beam for {last}"
    return ", ".join(f"{name} at {time:.3g} s" for name, time in found.items())


def tilt(flown: FlightResult) -> Floats:
    """The larger of |pitch| and |roll| in degrees since release."""
    series = flown.released
    return np.degrees(np.maximum(np.abs(series["pitch"]), np.abs(series["roll"])))


def number(flown: FlightResult, quantity: str, at: float | None) -> float:
    """A quantity of workflow/published.yaml, NaN where the flight does not have it."""
    series = flown.released
    if at is not None:
        columns = {**flown.series, **{axis: flown.series["position"][:, i] for i, axis in enumerate("xyz")}}
        reached = flown.series["time"][0] <= at <= flown.series["time"][-1]
        return float(np.interp(at, flown.series["time"], columns[quantity])) if reached else np.nan
    whole = {
        "leaves the beam": lambda: events(flown).get("leaves the beam", np.nan),
        "largest distance from the axis": lambda: np.hypot(*series["position"][:, :2].T).max(),
        "largest tilt": lambda: tilt(flown).max(),
        "peak temperature": lambda: series["temperature_max"].max(),
        "highest temperature of the coldest point": lambda: series["temperature_min"].max(),
        "largest strain": lambda: series["strain_max"].max(),
        "speed at the end": lambda: series["velocity"][-1, 2],
    }
    return float(whole[quantity]())
