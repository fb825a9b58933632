"""`meent` (NumPy), an independent Fourier modal code, on our cells."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import meent
import numpy as np

from optics.cells.schema import LamellarStack, Metagrating, as_stack

PIXEL_NM = 10.0


def raster(stack: LamellarStack, pixel: float = PIXEL_NM) -> np.ndarray:
    """Refractive index (n_layers, 1, n_pixels) as `meent` takes it, with edges on pixel boundaries."""
    places = (np.arange(round(stack.period_nm / pixel)) + 0.5) * pixel
    rows = []
    for layer in stack.layers:
        row = np.full(places.size, complex(layer.index.n, -layer.index.k))  # its time factor is exp(+iωt)
        for ridge in layer.ridges:
            inside = (places > ridge.start_nm) & (places < ridge.start_nm + ridge.width_nm)
            row[inside] = complex(ridge.index.n, -ridge.index.k)
        rows.append([row])
    return np.array(rows)


def solve(cell: Metagrating, directions: Iterable[tuple[float, float]], order: int) -> list[Any]:
    """Its results for directions (u, v), one after the other, s and p both, with its continuous Fourier series."""
    stack = as_stack(cell)
    index, thickness = raster(stack), [layer.thickness_nm for layer in stack.layers]
    return [
        meent.call_mee(
            backend=0,
            pol=1,
            n_top=1,
            n_bot=1,
            theta=np.arcsin(np.hypot(u, v)),
            phi=np.arctan2(v, u),
            fto=[order, 0],
            wavelength=cell.wavelength_nm,
            period=[cell.period_nm],
            ucell=index,
            thickness=thickness,
            fourier_type=1,
            enhanced_dfs=True,
        ).conv_solve()
        for u, v in directions
    ]
