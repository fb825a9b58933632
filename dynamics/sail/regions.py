"""Which region of the sail a triangle belongs to, by its centroid at rest, and the direction across its ridges."""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Floats, Integers
from dynamics.scene.sail_schema import Grid, Sail, Sector


def polar_sector(points: Floats, sectors: list[Sector]) -> Integers:
    """Sector (t,) of points (t, 3) by polar angle: the last start not above it; below the first start, the last one."""
    angle = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360.0
    starts = [sector.from_deg for sector in sectors]
    return np.asarray((np.searchsorted(starts, angle, side="right") - 1) % len(starts))


def _grid_regions(points: Floats, grid: Grid, first: int) -> Integers:
    """Region (t,) of points (t, 3) by their cell in the grid, numbered from `first`; −1 in cells without one."""
    numbers, k = np.full((len(grid.y_m) + 1, len(grid.x_m) + 1), -1), first
    for row, regions in enumerate(grid.regions):
        for column, region in enumerate(regions):
            if region is not None:
                numbers[row, column], k = k, k + 1
    rows = np.searchsorted(grid.y_m, points[:, 1], side="right")
    columns = np.searchsorted(grid.x_m, points[:, 0], side="right")
    return np.asarray(numbers[rows, columns])


def region_of(points: Floats, sail: Sail) -> Integers:
    """Index (t,) in `sail.regions` of points (t, 3) in m: the sectors, over them the rim, over both the grid."""
    result = polar_sector(points, sail.sectors)
    first = len(sail.sectors)
    if sail.rim is not None:
        outside = np.hypot(points[:, 0], points[:, 1]) >= sail.rim.from_m
        result = np.where(outside, first + polar_sector(points, sail.rim.sectors), result)
        first += len(sail.rim.sectors)
    if sail.grid is not None:
        over = _grid_regions(points, sail.grid, first)
        result = np.where(over >= 0, over, result)
    return np.asarray(result)


def directions(points: Floats, region: Integers, sail: Sail) -> Floats:
    """Direction g (t, 3) across the ridges at points (t, 3) in their regions (t,), before projection into the sail."""
    r = np.maximum(np.hypot(points[:, 0], points[:, 1]), 1e-300)
    out = np.stack([points[:, 0] / r, points[:, 1] / r, 0.0 * r], axis=1)
    around = np.stack([-out[:, 1], out[:, 0], 0.0 * r], axis=1)
    special = {"radial": out, "-radial": -out, "tangential": around, "-tangential": -around}
    result = np.zeros_like(points)
    for k, given in enumerate(sail.regions):
        here = region == k
        result[here] = special[given.g][here] if isinstance(given.g, str) else [*given.g, 0.0]
    return result
