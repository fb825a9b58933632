"""The pixel grid of an FDTD run, and the settings that decide on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from optics.files import Positive, Strict
from optics.outline import Grating, depth_nm, polygons


class FdtdSettings(Strict):
    """How FDTD is run. Lengths in wavelengths, unless a name says otherwise; times in periods of the light.

    `pixels_per_wavelength`, in the densest material, are tried in order until the error estimated is below `tolerance`.
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


def periods(cell: Grating) -> float:
    """Wavelengths in the densest material (vacuum where none is denser) that a period is long."""
    densest = max([1.0, *(float(np.sqrt(epsilon).real) for _, epsilon in polygons(cell))])
    return densest * cell.period_nm / cell.wavelength_nm


def pixels(cell: Grating, resolution: float) -> int:
    """Pixels a period at about `resolution` pixels per wavelength in the densest material."""
    return max(8, round(resolution * periods(cell)))


def layout(cell: Grating, resolution: float, settings: FdtdSettings, thicker: float = 1.0) -> Layout:
    """The grid nearest to `resolution` (see `pixels`) on which the period is a whole number of pixels.

    The absorbers are `thicker` times as thick as the settings say.
    """
    period, wavelength = cell.period_nm / 1000, cell.wavelength_nm / 1000
    n_x = pixels(cell, resolution)
    pixel = period / n_x
    absorber = max(6, round(thicker * settings.absorber * wavelength / pixel))
    padding = max(4, round(settings.padding * wavelength / pixel))
    structure = int(np.ceil(depth_nm(cell) / 1000 / pixel - 1e-9))
    n_y = 2 * (absorber + padding + 2) + structure
    n_y += n_y % 2
    bottom = absorber + 1 + padding - n_y // 2
    top = bottom + structure + padding
    return Layout(
        period, n_x, n_y, absorber, bottom * pixel,
        (top - 0.5) * pixel, (bottom - padding + 0.5) * pixel, (top + 1) * pixel,
    )
