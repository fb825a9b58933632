"""The pixel grid of an FDTD run, where the material lies on it, and the settings that decide on both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from optics.cells import Metagrating
from optics.files import Positive, Strict
from optics.incidence import Floats

# Where a face lies exactly on a grid point, rounding decides what Meep's averaging sees, and results jump by 1e-2
# between resolutions. This many pixels off the grid the choice is always the same.
_OFF_GRID = 1e-3


class FdtdSettings(Strict):
    """How FDTD is run. Lengths in wavelengths, unless a name says otherwise; times in periods of the light.

    `resolutions_per_um` are tried in order until the error estimated from the last two is below `tolerance`.
    `symmetries` is refused: with forces or a Bloch vector this Meep gives wrong results.
    """

    resolutions_per_um: list[Positive] = Field(default=[20.0, 40.0, 80.0], min_length=2)
    tolerance: Positive = 1e-2
    courant: float = Field(default=0.65, gt=0, le=0.7)
    absorber: Positive = 0.56
    padding: Positive = 0.1
    pulse_width: float = Field(default=0.2, gt=0, le=0.5)
    decay: Positive = 1e-3
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


def pixels(cell: Metagrating, resolution: float) -> int:
    """Pixels a period at about `resolution` pixels per µm."""
    return max(8, round(resolution * cell.period_nm / 1000))


def layout(cell: Metagrating, resolution: float, settings: FdtdSettings) -> Layout:
    """The grid nearest to `resolution` (pixels per µm) on which the period is a whole number of pixels."""
    period, wavelength = cell.period_nm / 1000, cell.wavelength_nm / 1000
    n_x = pixels(cell, resolution)
    pixel = period / n_x
    absorber = max(6, round(settings.absorber * wavelength / pixel))
    padding = max(4, round(settings.padding * wavelength / pixel))
    structure = int(np.ceil((cell.ridge_height_nm + cell.membrane_nm) / 1000 / pixel - 1e-9))
    n_y = 2 * (absorber + padding + 2) + structure
    n_y += n_y % 2
    bottom = absorber + 1 + padding - n_y // 2
    top = bottom + structure + padding
    return Layout(
        period, n_x, n_y, absorber, (bottom + _OFF_GRID) * pixel,
        (top - 0.5) * pixel, (bottom - padding + 0.5) * pixel, (top + 1) * pixel,
    )


def rectangles(cell: Metagrating, grid: Layout) -> list[tuple[float, float, float, float]]:
    """(x₁, x₂, y₁, y₂) in µm that cover the material in three periods; ridges reach into the membrane, no seams."""
    left = (_OFF_GRID - grid.n_x // 2) * grid.pixel
    membrane, height = cell.membrane_nm / 1000, cell.ridge_height_nm / 1000
    spans: list[list[float]] = []
    for period in (-1, 0, 1):
        for start, width in cell.ridges_nm:
            a = left + period * grid.period + start / 1000
            if spans and a - spans[-1][1] < 1e-9:
                spans[-1][1] = a + width / 1000
            else:
                spans.append([a, a + width / 1000])
    low, top = grid.y_bottom + membrane / 2, grid.y_bottom + membrane + height
    boxes = [(a, b, low, top) for a, b in spans]
    if membrane > 0:
        boxes.append((left - grid.period, left + 2 * grid.period, grid.y_bottom, grid.y_bottom + membrane))
    return boxes


def covered(boxes: list[tuple[float, float, float, float]], x: Floats, y: Floats, pixel: float) -> Floats:
    """Area (n_x, n_y) of each pixel inside the boxes; where boxes overlap, up to the whole pixel."""
    total = np.zeros((x.size, y.size))
    for a, b, c, d in boxes:
        across = np.clip(np.minimum(x + pixel / 2, b) - np.maximum(x - pixel / 2, a), 0, None)
        up = np.clip(np.minimum(y + pixel / 2, d) - np.maximum(y - pixel / 2, c), 0, None)
        total += across[:, None] * up
    return np.minimum(total, pixel**2)
