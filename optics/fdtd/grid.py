"""The pixel grid of an FDTD run, and the settings that decide on it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from pydantic import Field, model_validator

from beamrider.arrays import Floats
from beamrider.io.files import Positive, Strict
from optics.cells.outline import Grating, depth_nm, polygons

_FEWEST = 8  # pixels a period
_BYTES = 1500  # a pixel of Meep's needs, with poles and complex fields of all components, and what Python holds of it
_SET_UP = 1e5
FEWEST_RUNS = 3  # resolutions that every direction is solved at
# A table's tolerance in those of its directions: the rest is for what lies between them.
TABLE = 3.0


class FdtdSettings(Strict):
    """How FDTD is run. Lengths in wavelengths, unless a name says otherwise; times in periods of the light.

    `pixels_per_wavelength`, in the densest material, are tried in order until the error estimated is below `tolerance`,
    that of a direction; see `rungs`. A table's own is `TABLE` times that.
    `symmetries` is refused: with forces or a Bloch vector this Meep gives wrong results.
    """

    pixels_per_wavelength: list[Positive] = Field(default=[7.45, 10.65, 14.9, 21.3, 29.8, 42.55], min_length=2)
    tolerance: Positive = 1e-2
    courant: float = Field(default=0.65, gt=0, le=0.7)
    absorber: Positive = 0.56
    padding: Positive = 0.1
    pulse_width: float = Field(default=0.2, gt=0, le=0.5)
    decay: Positive = 3e-4
    longest: Positive = 600.0
    symmetries: None = None

    @model_validator(mode="after")
    def _ascending(self) -> FdtdSettings:
        if any(b <= a for a, b in pairwise(self.pixels_per_wavelength)):
            raise ValueError(f"pixels_per_wavelength = {self.pixels_per_wavelength}: must ascend")
        return self


@dataclass(frozen=True)
class Layout:
    """The pixel grid, lengths in µm. `n_x` pixels a period, `n_y` in height (even: the centre is a grid point)."""

    period: float
    n_x: int
    n_y: int
    n_absorber: int
    y_bottom: float
    y_front: float
    y_back: float
    y_source: float

    @property
    def pixel(self) -> float:
        """Side of a pixel in µm."""
        return self.period / self.n_x


def half_spaces(cell: Grating) -> tuple[complex, complex]:
    """Permittivities in front of the cell and behind it."""
    around = cell.surroundings
    return complex(around.front) ** 2, complex(around.back, around.back_k) ** 2


def periods(cell: Grating) -> float:
    """Wavelengths in the densest material that a period is long; of a metal 2π skin depths, |√ε| in place of n."""
    densest = max([1.0, *(abs(e) ** 0.5 for e in (*half_spaces(cell), *(e for _, e in polygons(cell))))])
    return float(densest * cell.period_nm / cell.wavelength_nm)


def pixels(cell: Grating, resolution: float) -> int:
    """Pixels a period at about `resolution` pixels per wavelength in the densest material."""
    return max(_FEWEST, round(resolution * periods(cell)))


def narrowest(cell: Grating) -> float:
    """Smallest width or height of a piece of the cell, in periods."""
    sides = [side for vertices, _ in polygons(cell) for side in np.ptp(vertices, axis=0).tolist() if side > 0]
    return float(min(sides, default=np.inf) / cell.period_nm)


def rungs(cell: Grating, settings: FdtdSettings) -> tuple[int, ...]:
    """Pixels a period of each resolution: strictly ascending, so that any two of them tell an error.

    A period must be a whole number of pixels, `_FEWEST` or more. One short against the wavelength starts there, and
    goes on in the ratios of the settings.
    """
    waves, found = max(periods(cell), _FEWEST / settings.pixels_per_wavelength[0]), [0]
    for resolution in settings.pixels_per_wavelength:
        found.append(max(round(resolution * waves), found[-1] + 1))
    return tuple(found[1:])


def step_of_time(cell: Grating, settings: FdtdSettings) -> float:
    """ωΔt of the first, coarsest resolution."""
    pixel_nm = cell.period_nm / rungs(cell, settings)[0]
    return float(2 * np.pi * settings.courant * pixel_nm / cell.wavelength_nm)


def layout(cell: Grating, n_x: int, settings: FdtdSettings, thicker: float = 1.0) -> Layout:
    """The grid of square pixels with `n_x` of them a period.

    The absorbers are `thicker` times as thick as the settings say.
    """
    period, wavelength = cell.period_nm / 1000, cell.wavelength_nm / 1000
    pixel = period / n_x
    absorber = max(6, round(thicker * settings.absorber * wavelength / pixel))
    padding = max(4, round(settings.padding * wavelength / pixel))
    structure = int(np.ceil(depth_nm(cell) / 1000 / pixel - 1e-9))
    n_y = 2 * (absorber + padding + 2) + structure
    n_y += n_y % 2
    bottom = absorber + 1 + padding - n_y // 2
    top = bottom + structure + padding
    return Layout(
        period,
        n_x,
        n_y,
        absorber,
        bottom * pixel,
        (top - 0.5) * pixel,
        (bottom - padding + 0.5) * pixel,
        (top + 1) * pixel,
    )


def work(cell: Grating, settings: FdtdSettings) -> Floats:
    """Pixels × steps per period of the light (n_rungs,), whole numbers, of one direction in the plane of incidence.

    To set up a run takes as long as some of them.
    """
    grids = [layout(cell, n, settings) for n in rungs(cell, settings)]
    wavelength = cell.wavelength_nm / 1000
    steps = [g.n_x * g.n_y * wavelength / (settings.courant * g.pixel) for g in grids]
    return np.round(np.array(steps) + _SET_UP)


def finest(cell: Grating, settings: FdtdSettings) -> int:
    """Pixels a period of the finest resolution that every direction takes."""
    return rungs(cell, settings)[: min(FEWEST_RUNS, len(settings.pixels_per_wavelength))][-1]


def memory(cell: Grating, settings: FdtdSettings) -> float:
    """Bytes of the grid of the resolutions that every direction takes."""
    n = finest(cell, settings)
    return float(_BYTES * n * layout(cell, n, settings).n_y)
