"""Where the beam points as time goes on, and how its power fluctuates: given paths and random records.

A record is a sum of cosines of random phases whose powers are those of its spectrum (Shinozuka & Deodatis, Appl. Mech.
Rev. 44 (1991) 191), by FFT; between its points, several to the shortest period, it is a cubic spline. It is the same in
every flight of the same seed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

from beamrider.io.files import DIMENSIONLESS, NonNegative, Positive, Strict
from dynamics.light.aim import Wander, aim, axes, where
from dynamics.light.profile import Floats

#: Points of a record to its shortest period: the spline then errs by less than 1e-4; points that a record may have.
POINTS, MOST = 16, 1_000_000
#: Rows of a path, and its largest tilt in degrees: far less than tables cover.
MOST_ROWS, MOST_TILT = 100_000, 30.0
#: What wanders: shift along x and y, tilt of the axis towards x and y, power.
CHANNELS = 5

Row = Annotated[list[Annotated[float, Field(ge=-1e9, le=1e9)]], Field(min_length=3, max_length=5)]
Density = Annotated[list[Annotated[float, Field(ge=0, le=1e30)]], Field(min_length=2, max_length=2)]


class Noise(Strict):
    """A random record: either `rms`, white up to `cutoff_Hz`, or a one-sided `spectrum`. Units: what it is noise of."""

    rms: Annotated[
        NonNegative | None,
        Field(
            description="Root mean square.",
            json_schema_extra={"unit": "m, ° or share"},
        ),
    ] = None
    cutoff_Hz: Annotated[Positive | None, Field(description="Highest frequency in Hz of a white spectrum.")] = None
    spectrum: Annotated[
        list[Density] | None,
        Field(
            json_schema_extra={"unit": "Hz, (m, ° or share)²/Hz"},
            min_length=2,
            max_length=10_000,
            description="Rows of frequency in Hz and one-sided power density in unit²/Hz, straight between; 0 outside.",
        ),
    ] = None
    seed: Annotated[
        int,
        Field(
            ge=0,
            le=2**63 - 1,
            description="Of the random phases: the same seed, the same record.",
            json_schema_extra=DIMENSIONLESS,
        ),
    ]
    record_s: Annotated[Positive, Field(le=1e6, description="Length in s of the record, which then repeats.")] = 10.0

    @model_validator(mode="after")
    def _one_spectrum(self) -> Noise:
        if (self.spectrum is None) == (self.rms is None or self.cutoff_Hz is None) or (
            self.spectrum is not None and (self.rms is not None or self.cutoff_Hz is not None)
        ):
            raise ValueError("give either rms and cutoff_Hz (white), or spectrum")
        if self.spectrum and np.any(np.diff([row[0] for row in self.spectrum]) <= 0.0):
            raise ValueError("spectrum: frequencies must ascend")
        if self.highest * self.record_s * POINTS > MOST:
            raise ValueError(
                f"record_s = {self.record_s:g}: a record of frequencies up to {self.highest:g} Hz must be shorter than "
                f"{MOST / POINTS / self.highest:.3g} s"
            )
        if self.highest * self.record_s < 1.0:
            raise ValueError(f"record_s = {self.record_s:g}: must be at least a period of {self.highest:g} Hz")
        return self

    @property
    def highest(self) -> float:
        """Highest frequency in Hz."""
        return self.spectrum[-1][0] if self.spectrum else float(self.cutoff_Hz or 0.0)

    def record(self, channel: int) -> tuple[Floats, Floats]:
        """Times (n + 1,) in s and values of one period."""
        lines = np.arange(1, math.floor(self.highest * self.record_s * (1.0 + 1e-12)) + 1)
        if self.spectrum is None:  # the whole, whatever share of a line the cut-off leaves
            powers = np.full(lines.size, float(self.rms or 0.0) ** 2 / lines.size)
        else:
            known, values = np.array(self.spectrum).T
            powers = np.interp(lines / self.record_s, known, values, left=0.0, right=0.0) / self.record_s
        phases = np.random.default_rng([self.seed, channel]).uniform(0.0, 2.0 * np.pi, lines.size)
        n = POINTS * (lines.size + 1)
        modes = np.zeros(n // 2 + 1, complex)
        modes[lines] = np.sqrt(0.5 * powers) * np.exp(1j * phases) * n
        values = np.fft.irfft(modes, n)
        return self.record_s * np.arange(n + 1) / n, np.append(values, values[0])


class Pointing(Strict):
    """The beam's axis: it passes through (x, y) in the plane z = 0, tilted towards x and y; a path and jitter add up.

    The path is followed by monotone cubics between its rows (Fritsch & Carlson, SIAM J. Numer. Anal. 17 (1980) 238),
    and stays where it is before the first and after the last. Time is that of flight: the release is at 0.
    """

    path: Annotated[
        list[Row] | None,
        Field(
            json_schema_extra={"unit": "s, m, m, °, °"},
            min_length=2,
            max_length=MOST_ROWS,
            description="Rows of time in s, x and y in m and, if it tilts, tilt towards x and y in degrees.",
        ),
    ] = None
    path_file: Annotated[
        str | None,
        Field(
            max_length=200,
            description="CSV file with columns t_s, x_m, y_m and, if it tilts, tilt_x_deg, tilt_y_deg.",
        ),
    ] = None
    jitter_m: Annotated[Noise | None, Field(description="Jitter of x and of y, each of this size, in m.")] = None
    jitter_deg: Annotated[Noise | None, Field(description="Jitter of both tilts, each of this size, in °.")] = None

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        """The rows of path_file, so that results hold what was flown."""
        if not (isinstance(data, dict) and isinstance(data.get("path_file"), str)):
            return data
        path = PurePosixPath(data["path_file"])
        if path.is_absolute() or ".." in path.parts:
            raise ValueError(f"path_file = {path}: must be a path below this folder")
        if data.get("path") is not None:  # read before
            return data
        try:
            table = pd.read_csv(Path(path), comment="#")
        except (OSError, ValueError) as error:
            raise ValueError(f"path_file = {path}: cannot be read ({' '.join(str(error).split())[:80]})") from None
        names = ["t_s", "x_m", "y_m", "tilt_x_deg", "tilt_y_deg"]
        if list(table.columns) not in (names, names[:3]):
            raise ValueError(f"path_file = {path}: columns must be {', '.join(names)} (the tilts may be left out)")
        return {**data, "path": table.to_numpy(float).tolist()}

    @model_validator(mode="after")
    def _ascending(self) -> Pointing:
        rows = self.path or []
        if len({len(row) for row in rows}) > 1 or any(len(row) == 4 for row in rows):
            raise ValueError("path: every row must be of 3 numbers, or every one of 5")
        if any(later[0] <= row[0] for row, later in pairwise(rows)):
            raise ValueError("path: times must ascend")
        if any(abs(tilt) > MOST_TILT for row in rows for tilt in row[3:]):
            raise ValueError(f"path: tilts must be from -{MOST_TILT:g} to {MOST_TILT:g} degrees")
        return self

    @property
    def steady(self) -> bool:
        """Does it stay on the axis."""
        return self.path is None and self.jitter_m is None and self.jitter_deg is None

    @property
    def tilts(self) -> bool:
        """May the axis tilt."""
        return self.jitter_deg is not None or any(any(row[3:]) for row in self.path or [])


def _tracks(pointing: Pointing, power: Noise | None) -> list[tuple[PPoly, float, list[int]]]:
    """What adds up: a piecewise cubic of some channels in SI, its period in s (0: it stays where it is), these."""
    found: list[tuple[PPoly, float, list[int]]] = []
    if pointing.path is not None:
        rows = np.array(pointing.path)
        columns = rows[:, 1:]
        columns[:, 2:] = np.radians(columns[:, 2:])
        found.append((PchipInterpolator(rows[:, 0], columns), 0.0, list(range(columns.shape[1]))))
    for noise, channels, unit in (
        (pointing.jitter_m, [0, 1], 1.0),
        (pointing.jitter_deg, [2, 3], math.pi / 180.0),
        (power, [4], 1.0),
    ):
        if noise is not None:
            times = noise.record(0)[0]
            values = unit * np.stack([noise.record(c)[1] for c in channels], axis=1)
            found.append((CubicSpline(times, values, bc_type="periodic"), noise.record_s, channels))
    return found


def wander(pointing: Pointing, power: Noise | None, length: float = 1.0, time: float = 1.0) -> Wander:
    """What the kernels follow, in units of `length` in m and `time` in s; nothing at all for a steady beam."""
    tracks = _tracks(pointing, power)
    scale = np.array([1.0 / length] * 2 + [1.0] * 3)
    pieces = [np.zeros((0, CHANNELS, 4))]
    for cubic, _, channels in tracks:
        piece = np.zeros((cubic.x.size, CHANNELS, 4))  # one more than there are intervals, never read
        powers = time ** np.arange(3, -1, -1.0)
        piece[:-1, channels] = np.moveaxis(cubic.c, 0, -1) * powers
        pieces.append(piece * scale[:, None])
    starts: NDArray[np.int64] = np.cumsum([0, *(cubic.x.size for cubic, _, _ in tracks)]).astype(np.int64)
    return Wander(
        starts,
        np.concatenate([np.empty(0), *(cubic.x / time for cubic, _, _ in tracks)]),
        np.concatenate(pieces),
        np.array([period / time for _, period, _ in tracks]),
    )


def knots(pointing: Pointing, power: Noise | None, end: float) -> Floats:
    """Times (n,) in s up to `end` where they are not smooth: ends of the pieces of cubics."""
    found: list[Floats] = [np.empty(0)]
    for cubic, period, _ in _tracks(pointing, power):
        count = math.ceil(end / period) if period else 1
        found += [cubic.x + k * period for k in range(count)]
    every = np.unique(np.concatenate(found))
    return np.asarray(every[(every > 0.0) & (every < end)])


def seen(wander: Wander, times: Floats, position: Floats, turn: Floats) -> tuple[Floats, Floats]:
    """Positions (n, 3) and rotations (n, 3, 3) at times (n,) from the frame of a beam, whose light goes along its z."""
    if wander.periods.size == 0:
        return position, turn
    places, turns, now, frame = np.array(position), np.empty_like(turn), np.empty(CHANNELS), np.empty((3, 3))
    for i, t in enumerate(times):
        place = places[i][:, None].copy()
        aim(wander, t, place)
        where(wander, t, now)
        axes(now, frame)
        places[i], turns[i] = place[:, 0], frame @ turn[i]
    return places, turns


def from_beam(wander: Wander, t: float, points: Floats) -> Floats:
    """Points (n, 3) in the frame of the beam at time t."""
    x = np.ascontiguousarray(points.T)
    aim(wander, t, x)
    return x.T


def extremes(pointing: Pointing, power: Noise | None) -> Floats:
    """Largest |value| (5,) of each channel at the ends of the pieces, in SI."""
    most = np.zeros(CHANNELS)
    for cubic, _, channels in _tracks(pointing, power):
        most[channels] += np.abs(cubic(cubic.x)).max(axis=0)
    return most


def at(pointing: Pointing, power: Noise | None, times: Sequence[float] | Floats) -> Floats:
    """Values (n, 5) at times (n,) in s: x, y in m, tilts in rad, power as a share more than 1."""
    t = np.asarray(times, float)
    out = np.zeros((t.size, CHANNELS))
    for cubic, period, channels in _tracks(pointing, power):
        out[:, channels] += cubic(np.mod(t, period) if period else np.clip(t, cubic.x[0], cubic.x[-1]))
    return out
