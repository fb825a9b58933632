"""The cross-section of a grating: as polygons, for solvers on a grid, and as a staircase, for the modal method.

Here g runs across the ridges and n along the light from the plane that it reaches first, both in nm.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TypeGuard

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from optics.cells.schema import Index, LamellarLayer, LamellarStack, Metagrating, Profile, Ridge, ThinFilm, read_cell

Grating = Metagrating | LamellarStack | Profile
Piece = tuple[Floats, Index]

# Straight pieces of a rounded corner: the polygon stays within 1.2e-3 of the radius of the arc (1 − cos(π/64)).
_ARC = 16
# Enough of 20 nm corners for 5e-5 of q (measured on the paper's cells, one resonant direction among them).
SLICES = 8


def read_grating(path: str | Path, wavelength_nm: float | None = None) -> Grating:
    """The cell of a YAML file, at another wavelength if one is given; InputError where it is a film."""
    cell = read_cell(path, wavelength_nm)
    if isinstance(cell, ThinFilm):
        raise InputError(f"{path}: kind = {cell.kind!r}: must be a grating; use optics.thin_film for films")
    return cell


def is_upright(cell: Grating) -> TypeGuard[Metagrating | LamellarStack]:
    """Whether all walls are upright, so that no slices are needed."""
    return not (isinstance(cell, Profile) or (isinstance(cell, Metagrating) and cell.corner_radius_nm > 0))


def upright(cell: Grating, slices: int = SLICES) -> Metagrating | LamellarStack:
    """The cell as the modal method takes it: itself, or where its walls aren't upright its staircase."""
    return cell if is_upright(cell) else staircase(cell, slices)


def depth_nm(cell: Grating) -> float:
    """Thickness of the patterned region, from the first plane of the cell to the last."""
    if isinstance(cell, Profile):
        return cell.depth_nm
    if isinstance(cell, LamellarStack):
        return sum(layer.thickness_nm for layer in cell.layers)
    return cell.ridge_height_nm + cell.membrane_nm


def polygons(cell: Grating) -> list[tuple[Floats, complex]]:
    """Vertices (k, 2) of [g, n] in nm and relative permittivity of each piece; later ones lie over earlier ones.

    What none covers is as in front of the cell.
    """
    return [(vertices, index.permittivity) for vertices, index in pieces_of(cell)]


def pieces_of(cell: Grating) -> list[Piece]:
    """Vertices (k, 2) of [g, n] in nm and index of each piece; later ones lie over earlier ones."""
    if isinstance(cell, Profile):
        return [(np.array(polygon.vertices_nm), polygon.index) for polygon in cell.polygons]
    if isinstance(cell, LamellarStack):
        return _stack(cell)
    foot = cell.ridge_height_nm
    membrane = [(_rectangle(0, cell.period_nm, foot, foot + cell.membrane_nm), cell.index)] if cell.membrane_nm else []
    # Ridges reach into the membrane, so that there is no seam.
    root = foot + cell.membrane_nm / 2
    ridges = [_rounded(start, start + width, root, cell.corner_radius_nm) for start, width in cell.ridges_nm]
    return [*membrane, *((vertices, cell.index) for vertices in ridges)]


def _stack(cell: LamellarStack) -> list[Piece]:
    pieces, top, front = [], 0.0, Index(n=cell.surroundings.front)
    for layer in cell.layers:
        bottom = top + layer.thickness_nm
        if layer.index != front:
            pieces.append((_rectangle(0, cell.period_nm, top, bottom), layer.index))
        for ridge in layer.ridges:
            end = ridge.start_nm + ridge.width_nm
            pieces.append((_rectangle(ridge.start_nm, end, top, bottom), ridge.index))
        top = bottom
    return pieces


def _rectangle(left: float, right: float, top: float, bottom: float) -> Floats:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)


def _rounded(left: float, right: float, bottom: float, radius: float) -> Floats:
    """A ridge whose two corners at n = 0 are quarter circles."""
    if radius == 0:
        return _rectangle(left, right, 0, bottom)
    turn = np.linspace(0, np.pi / 2, _ARC + 1)
    inset, depth = radius * (1 - np.sin(turn)), radius * (1 - np.cos(turn))
    one, other = np.stack([right - inset, depth], -1), np.stack([left + inset, depth], -1)[::-1]
    return np.concatenate([other, one, [[right, bottom], [left, bottom]]])


def staircase(cell: Grating, slices: int) -> LamellarStack:
    """The cell in horizontal layers with upright walls; error of second order in 1/`slices`.

    Where walls are upright already, the layers are the cell's own. A rounded corner is cut at even steps of its angle,
    a slanted wall at even heights, between the corners of the outline; each wall stands where the outline passes the
    middle of its slice (for a straight one the area is kept).
    """
    levels = _levels(cell, slices)
    pieces = pieces_of(cell)
    layers = [layer_at(cell, pieces, top, bottom) for top, bottom in pairwise(levels)]
    return LamellarStack(
        kind="lamellar",
        name=cell.name,
        wavelength_nm=cell.wavelength_nm,
        electric_axis=cell.electric_axis,
        period_nm=cell.period_nm,
        layers=_joined(layers),
        surroundings=cell.surroundings,
    )


def _levels(cell: Grating, slices: int) -> Floats:
    """Depths in nm, ascending from 0, at which the staircase is cut."""
    depth = depth_nm(cell)
    if isinstance(cell, Metagrating):
        turn = np.linspace(0, np.pi / 2, slices + 1)
        corner = cell.corner_radius_nm * (1 - np.cos(turn))
        return np.unique([*corner, cell.ridge_height_nm, depth])
    levels = corners(cell)
    if isinstance(cell, LamellarStack):
        return levels
    parts = [
        np.linspace(a, b, 1 + (int(np.ceil(slices * (b - a) / depth)) if is_slanted(cell, (a + b) / 2) else 1))[:-1]
        for a, b in pairwise(levels)
    ]
    return np.concatenate([*parts, [depth]])


def corners(cell: Grating) -> Floats:
    """Depths (n,) in nm of all corners, ascending from 0."""
    return np.unique(np.concatenate([[0.0, depth_nm(cell)], *(vertices[:, 1] for vertices, _ in pieces_of(cell))]))


def is_slanted(cell: Grating, n: float) -> bool:
    """Whether an edge that is not upright passes depth n."""
    for vertices, _ in pieces_of(cell):
        after = np.roll(vertices, -1, axis=0)
        passes = (vertices[:, 1] < n) != (after[:, 1] < n)
        if np.any(vertices[passes, 0] != after[passes, 0]):
            return True
    return False


def _crossings(vertices: Floats, n: float) -> list[tuple[float, float]]:
    """Intervals of g inside a polygon at depth n."""
    after = np.roll(vertices, -1, axis=0)
    passes = (vertices[:, 1] < n) != (after[:, 1] < n)
    (g0, n0), (g1, n1) = vertices[passes].T, after[passes].T
    g = np.sort(g0 + (g1 - g0) * (n - n0) / (n1 - n0))
    return list(zip(g[::2].tolist(), g[1::2].tolist(), strict=True))


def layer_at(cell: Grating, pieces: Sequence[Piece], top: float, bottom: float) -> LamellarLayer:
    """The layer between two depths, as the outline is at the middle of them."""
    front, n = Index(n=cell.surroundings.front), (top + bottom) / 2
    spans = [(a, b, index) for vertices, index in pieces for a, b in _crossings(vertices, n)]
    cuts = np.unique([0.0, cell.period_nm, *(x for a, b, _ in spans for x in (a, b))])
    runs: list[tuple[float, float, Index]] = []
    for a, b in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        middle = (a + b) / 2
        index = next((index for left, right, index in reversed(spans) if left < middle < right), front)
        if runs and runs[-1][2] == index:
            runs[-1] = (runs[-1][0], b, index)
        else:
            runs.append((a, b, index))
    if len(runs) == 1:
        return LamellarLayer(thickness_nm=bottom - top, index=runs[0][2])
    ridges = [Ridge(start_nm=a, width_nm=b - a, index=index) for a, b, index in runs if index != front]
    return LamellarLayer(thickness_nm=bottom - top, index=front, ridges=ridges)


def _joined(layers: Sequence[LamellarLayer]) -> list[LamellarLayer]:
    """Neighbouring layers of the same pattern as one."""
    out: list[LamellarLayer] = []
    for layer in layers:
        if out and (out[-1].index, out[-1].ridges) == (layer.index, layer.ridges):
            thickness = out[-1].thickness_nm + layer.thickness_nm
            out[-1] = LamellarLayer(thickness_nm=thickness, index=layer.index, ridges=layer.ridges)
        else:
            out.append(layer)
    return out
