"""A measured beam: intensity on a grid, between its points by the bicubic spline through them, dark outside.

The spline is the sum of cubic B-splines on the grid (Unser, IEEE Signal Process. Mag. 16 (6), 1999, 22): smooth to the
second derivative, also at the border, where the map must be dark; its integral is the sum of its coefficients.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar, Literal

import h5py
import numba
import numpy as np
import pandas as pd
from numba import carray
from pydantic import Field, model_validator
from scipy.ndimage import spline_filter

from dynamics.light.compiled import OWN, SHARE, UX, UY, VX, VY, X, Y
from dynamics.light.profile import Floats, Profile

#: W/m² of each unit of intensity; '1' is relative.
UNITS = {"W/m2": 1.0, "W/cm2": 1e4, "W/mm2": 1e6, "kW/cm2": 1e7, "MW/m2": 1e6, "GW/m2": 1e9, "1": math.nan}
#: Points along a side, share of the peak that the border may have, and that the spline may fall below zero.
LEAST, MOST, BORDER, BELOW = 5, 1024, 1e-2, 1e-2
#: Cells of darkness around the grid, in which the spline dies away.
_MARGIN = 16


@numba.njit(cache=True, inline="always")
def _line(c: Floats, at: int, b0: float, b1: float, b2: float, b3: float) -> float:
    return c[at] * b0 + c[at + 1] * b1 + c[at + 2] * b2 + c[at + 3] * b3


def _shine(numbers: Any, x: Any, y: Any, n: int, out: Any) -> None:
    head, u, v, total = carray(numbers, OWN + 6), carray(x, n), carray(y, n), carray(out, n)
    columns, rows = int(head[OWN + 4]), int(head[OWN + 5])
    own, first = carray(numbers, OWN + 6 + columns * rows), OWN + 6
    for i in range(n):
        dx, dy = u[i] - head[X], v[i] - head[Y]
        a = (head[UX] * dx + head[UY] * dy - head[OWN]) * head[OWN + 1]
        b = (head[VX] * dx + head[VY] * dy - head[OWN + 2]) * head[OWN + 3]
        if a >= 1.0 and b >= 1.0 and a < columns - 2.0 and b < rows - 2.0:
            j, k = int(a), int(b)
            p, q = a - j, b - k
            b0, b3 = (1.0 - q) * (1.0 - q) * (1.0 - q) / 6.0, q * q * q / 6.0
            b1 = (4.0 - q * q * (6.0 - 3.0 * q)) / 6.0
            b2 = 1.0 - b0 - b1 - b3
            a0, a3 = (1.0 - p) * (1.0 - p) * (1.0 - p) / 6.0, p * p * p / 6.0
            a1 = (4.0 - p * p * (6.0 - 3.0 * p)) / 6.0
            a2 = 1.0 - a0 - a1 - a3
            at = first + (j - 1) * rows + k - 1
            value = a0 * _line(own, at, b0, b1, b2, b3) + a1 * _line(own, at + rows, b0, b1, b2, b3)
            value += a2 * _line(own, at + 2 * rows, b0, b1, b2, b3) + a3 * _line(own, at + 3 * rows, b0, b1, b2, b3)
            total[i] += head[SHARE] * value


@dataclass(frozen=True)
class Grid:
    """A map: x (n,), y (m,) in m, evenly apart; coefficients (n, m) of its spline, 1 at the brightest point.

    peak: intensity of the brightest point in W/m², NaN where the file gives it in no unit.
    """

    x: Floats
    y: Floats
    coefficients: Floats
    peak: float


def _from_csv(path: Path) -> tuple[Floats, Floats, Floats, str]:
    table = pd.read_csv(path, comment="#")
    names = [str(name) for name in table.columns]
    if len(names) != 3 or names[:2] != ["x_m", "y_m"] or not names[2].startswith("intensity_"):
        raise ValueError(f"{path}: columns {', '.join(names)[:60]}: must be x_m, y_m, intensity_UNIT")
    grid = table.pivot(index="x_m", columns="y_m", values=names[2])
    unit = names[2].removeprefix("intensity_").replace("_", "/")
    return grid.index.to_numpy(float), grid.columns.to_numpy(float), grid.to_numpy(float), unit


def _from_hdf5(path: Path) -> tuple[Floats, Floats, Floats, str]:
    with h5py.File(path, "r", locking=False) as file:
        x, y, values = (np.asarray(file[name], float) for name in ("x", "y", "intensity"))
        unit = file["intensity"].attrs.get("units", "")
    return x, y, values, unit.decode() if isinstance(unit, bytes) else str(unit)


def _even(path: Path, name: str, axis: Floats) -> None:
    """ValueError where an axis is not evenly spaced, too short or too long."""
    if not (axis.ndim == 1 and LEAST <= axis.size <= MOST):
        raise ValueError(f"{path}: {name}: must have {LEAST} to {MOST} points")
    step = np.diff(axis)
    if not (np.all(step > 0.0) and np.allclose(step, step.mean(), rtol=1e-4, atol=0.0)):
        raise ValueError(f"{path}: {name}: must ascend in equal steps, in m")


@lru_cache(maxsize=8)
def _read(file: str, digest: str) -> Grid:
    """The map in a file of that digest; ValueError says what is wrong with it."""
    path = Path(file)
    try:
        x, y, values, unit = (_from_csv if path.suffix == ".csv" else _from_hdf5)(path)
    except (OSError, KeyError, TypeError, pd.errors.ParserError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: not a readable map ({' '.join(str(error).split())[:100]})") from None
    _even(path, "x", x)
    _even(path, "y", y)
    if unit not in UNITS:
        raise ValueError(f"{file}: unit of intensity '{unit}': must be one of {', '.join(UNITS)}")
    if values.shape != (x.size, y.size) or not np.isfinite(values).all():
        raise ValueError(f"{file}: intensity: must be finite at all of {x.size} x {y.size} points (x, y)")
    peak = float(values.max())
    if not (peak > 0.0 and values.min() >= -BELOW * peak):
        raise ValueError(f"{file}: intensity: must be positive; its lowest is {values.min():.3g}, highest {peak:.3g}")
    border = float(max(np.abs(part).max() for part in (values[0], values[-1], values[:, 0], values[:, -1])))
    if border > BORDER * peak:
        raise ValueError(f"{file}: intensity: is {border / peak:.3g} of the peak at the border: must be below {BORDER}")
    coefficients = spline_filter(np.pad(values / peak, _MARGIN), order=3, mode="mirror", output=np.float64)
    between = 0.25 * _blur(_blur(coefficients, 0), 1)
    if between.min() < -BELOW:
        raise ValueError(f"{file}: intensity: is too coarse or too noisy for a smooth beam: resample or smooth it")
    return Grid(x, y, coefficients, peak * UNITS[unit])


def _blur(c: Floats, axis: int) -> Floats:
    """Twice the spline of coefficients c midway between the points along an axis."""
    c = np.moveaxis(c, axis, 0)
    return np.moveaxis((c[:-3] + 23.0 * c[1:-2] + 23.0 * c[2:-1] + c[3:]) / 24.0, 0, axis)


class Map(Profile):
    """A measured map. HDF5: x (n), y (m) in m and intensity (n, m) with `units`; CSV: x_m, y_m, intensity_UNIT.

    Its axes are those of the beam, whose middle is x = y = 0. The path is relative to the folder where the command
    runs, and does not leave it. sha256 is found, and must be that of the file.
    """

    round: ClassVar[bool] = False
    error: ClassVar[float] = 1e-7
    kind: Literal["map"] = "map"
    """What the profile is."""
    file: Annotated[str, Field(max_length=200, description="HDF5 or CSV file of the intensity on a grid.")]
    sha256: Annotated[str, Field(max_length=64, description="Digest of the file; found where it is not given.")] = ""

    @model_validator(mode="before")
    @classmethod
    def _found(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and isinstance(data.get("file"), str)):
            return data
        path = PurePosixPath(data["file"])
        if path.is_absolute() or ".." in path.parts or path.suffix not in (".csv", ".h5", ".hdf5"):
            raise ValueError(f"file = {data['file']}: must be a path of a .csv, .h5 or .hdf5 file below this folder")
        try:
            digest = hashlib.sha256(Path(data["file"]).read_bytes()).hexdigest()
        except OSError as error:
            raise ValueError(f"file = {data['file']}: cannot be read ({error.strerror})") from None
        if data.get("sha256", digest) not in ("", digest):
            raise ValueError(f"file = {data['file']}: is not the file of that sha256: its own is {digest}")
        _read(data["file"], digest)
        return {**data, "sha256": digest}

    @property
    def grid(self) -> Grid:
        """The map itself."""
        return _read(self.file, self.sha256)

    @property
    def function(self) -> Callable[..., None]:
        """See `Profile`."""
        return _shine

    @property
    def steps(self) -> tuple[float, float]:
        """Distances of the points along x and y in m."""
        x, y = self.grid.x, self.grid.y
        return float(x[-1] - x[0]) / (x.size - 1), float(y[-1] - y[0]) / (y.size - 1)

    @property
    def numbers(self) -> list[float]:
        """First point, points a metre, along x and y; numbers of coefficients; these."""
        grid, (dx, dy) = self.grid, self.steps
        head = [grid.x[0] - _MARGIN * dx, 1.0 / dx, grid.y[0] - _MARGIN * dy, 1.0 / dy]
        return [*map(float, head), *map(float, grid.coefficients.shape), *grid.coefficients.ravel().tolist()]

    @property
    def finest(self) -> float:
        """Some steps of the grid."""
        return 3.0 * max(self.steps)

    @property
    def extent(self) -> tuple[float, float, float]:
        """Centre x, y, and the mean 1/e² radius √(2(σ_x² + σ_y²)) in m, by moments (ISO 11146-1)."""
        grid = self.grid
        weight = grid.coefficients[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN]
        a, b = weight.sum(axis=1) / weight.sum(), weight.sum(axis=0) / weight.sum()
        x, y = float(a @ grid.x), float(b @ grid.y)
        return x, y, math.sqrt(2.0 * max(0.0, float(a @ (grid.x - x) ** 2 + b @ (grid.y - y) ** 2)))

    @property
    def reach(self) -> float:
        """Radius by moments, from x = y = 0."""
        x, y, radius = self.extent
        return math.hypot(x, y) + radius

    @property
    def dark(self) -> float:
        """Distance of the farthest corner."""
        return float(np.hypot(np.abs(self.grid.x).max(), np.abs(self.grid.y).max())) + 2.0 * max(self.steps)

    @property
    def power(self) -> float:
        """The sum of the coefficients, times the area of a cell."""
        return float(self.grid.coefficients.sum()) * math.prod(self.steps)

    def slope(self, s: Floats) -> Floats:
        """See `gradient`: a map is not round."""
        raise NotImplementedError

    def gradient(self, u: Floats, v: Floats) -> Floats:
        """See `Profile`."""
        c, (dx, dy) = self.grid.coefficients, self.steps
        a, b = (u - self.grid.x[0]) / dx + _MARGIN, (v - self.grid.y[0]) / dy + _MARGIN
        inside = (a >= 1.0) & (b >= 1.0) & (a < c.shape[0] - 2.0) & (b < c.shape[1] - 2.0)
        j, k = (np.where(inside, t, 1.0).astype(int) for t in (a, b))
        (p, p_), (q, q_) = _weights(np.where(inside, a - j, 0.0)), _weights(np.where(inside, b - k, 0.0))
        out = np.zeros((2, *np.shape(u)))
        for m in range(4):
            for n in range(4):
                value = np.where(inside, c[j - 1 + m, k - 1 + n], 0.0)
                out[0] += value * p_[m] * q[n] / dx
                out[1] += value * p[m] * q_[n] / dy
        return out


def _weights(t: Floats) -> tuple[list[Floats], list[Floats]]:
    """The four B-splines that reach a place t (...) within its cell, and their slopes."""
    weights = [(1.0 - t) ** 3 / 6.0, (4.0 - t * t * (6.0 - 3.0 * t)) / 6.0]
    last = t**3 / 6.0
    slopes = [-0.5 * (1.0 - t) ** 2, t * (1.5 * t - 2.0)]
    end = 0.5 * t * t
    return [*weights, 1.0 - weights[0] - weights[1] - last, last], [*slopes, -slopes[0] - slopes[1] - end, end]
