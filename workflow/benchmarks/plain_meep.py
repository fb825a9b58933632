"""Meep as one would use it without further ado: blocks of material, its own averaging, one resolution."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any
from unittest.mock import patch

import numpy as np

from optics.cells.schema import Metagrating
from optics.fdtd import efficiencies as fdtd_efficiencies
from optics.fdtd.direction import values
from optics.fdtd.grid import FdtdSettings, pixels
from optics.fdtd.medium import Media
from optics.fdtd.run import Run

SETTINGS = FdtdSettings()


class PlainRun(Run):
    """A run whose material is given to Meep as blocks."""

    def _simulation(self) -> Any:
        simulation = super()._simulation()
        simulation.eps_averaging = True
        return simulation

    def _geometry(self, media: Media) -> list[Any]:
        mp, cell, grid = self.mp, self.cell, self.grid
        if not isinstance(cell, Metagrating):
            raise TypeError(f"{cell.name}: only metagratings are given as blocks")
        medium = mp.Medium(epsilon=cell.index.permittivity.real)
        membrane, height = cell.membrane_nm / 1000, cell.ridge_height_nm / 1000
        low = grid.y_bottom + 1e-3 * grid.pixel  # a face exactly on a grid point is averaged by chance
        middle = mp.Vector3(0, low + membrane / 2)
        blocks = [mp.Block(mp.Vector3(mp.inf, membrane, mp.inf), center=middle, material=medium)]
        for start, width in cell.ridges_nm:
            centre = mp.Vector3((start + width / 2) / 1000 - grid.period / 2, low + membrane + height / 2)
            blocks.append(mp.Block(mp.Vector3(width / 1000, height, mp.inf), center=centre, material=medium))
        return blocks


def plain() -> AbstractContextManager[Any]:
    """Within it, `efficiencies` are those of plain Meep."""
    return patch.object(fdtd_efficiencies, "Run", PlainRun)


def pressure(cell: Any, u: float, v: float, resolution: float) -> np.ndarray:
    """q_g and q_n (2,) of one direction at one resolution (pixels per wavelength)."""
    found = fdtd_efficiencies.efficiencies(cell, u, v, pixels(cell, resolution), SETTINGS)
    return values(cell, u, v, found)[:2]
