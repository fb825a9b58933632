"""The cross-section of a cell: how much solid lies behind a unit of its surface, and how much of that is continuous.

Works on the cell as a table holds it (`attrs["cell"]`), so that whoever has a table knows its mass. Solid is what has
neither the index in front of the cell nor that of vacuum; the half-spaces do not belong to the cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np

from beamrider.arrays import Floats

Cell = dict[str, Any]
Slab = tuple[float, float]
# Starts and widths are decimals: a covered length may miss the period by this share.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Section:
    """Solid of a cell per area of surface.

    mean_m: volume per area, the thickness in m of the plain film of equal mass. membrane_m: thickness in m of all that
    is solid over the whole period, 0 for a grating that stands free. materials: how many different indices it has.
    """

    mean_m: float
    membrane_m: float
    materials: int


def cross_section(cell: Cell) -> Section:
    """The section of a cell of any kind, as its model dumps it; ValueError where nothing of it is solid."""
    period, slabs, removed = _SLABS[cell["kind"]](cell)
    area = sum(thickness * covered for thickness, covered in slabs) - removed
    whole = sum(thickness for thickness, covered in slabs if covered >= period * (1.0 - _ROUNDING))
    found = {_key(index) for index in _indices(cell) if _solid(cell, index)}
    if not found or area <= 0:
        raise ValueError(f"cell '{cell.get('name')}' holds no solid: every index is that of its surroundings")
    return Section(area / period / 1e9, whole / 1e9, len(found))


def _key(index: Cell) -> tuple[float, float]:
    return float(index["n"]), float(index.get("k", 0.0))


def _solid(cell: Cell, index: Cell) -> bool:
    return _key(index) not in ((1.0, 0.0), (float(cell["surroundings"]["front"]), 0.0))


def _indices(cell: Cell) -> list[Cell]:
    """Every index of a cell that fills some of it."""
    if cell["kind"] == "metagrating":
        return [cell["index"]]
    if "polygons" in cell:
        return [polygon["index"] for polygon in cell["polygons"]]
    filled = [layer for layer in cell["layers"] if layer["thickness_nm"] > 0]
    return [index for layer in filled for index in (layer["index"], *(r["index"] for r in layer.get("ridges", [])))]


def _metagrating(cell: Cell) -> tuple[float, list[Slab], float]:
    """Period, slabs (thickness, covered length) in nm, and area in nm² that rounded corners take away."""
    widths = [width for _, width in cell["ridges_nm"]]
    corners = 2 * len(widths) * (1.0 - pi / 4.0) * cell.get("corner_radius_nm", 0.0) ** 2
    slabs = [(cell["ridge_height_nm"], sum(widths)), (cell["membrane_nm"], cell["period_nm"])]
    return cell["period_nm"], slabs, corners


def _film(cell: Cell) -> tuple[float, list[Slab], float]:
    return 1.0, [(layer["thickness_nm"], float(_solid(cell, layer["index"]))) for layer in cell["layers"]], 0.0


def _lamellar(cell: Cell) -> tuple[float, list[Slab], float]:
    return cell["period_nm"], [(layer["thickness_nm"], _covered(cell, layer)) for layer in cell["layers"]], 0.0


def _covered(cell: Cell, layer: Cell) -> float:
    """Length in nm of a lamellar layer that is solid."""
    ridges = layer.get("ridges", [])
    solid = sum(ridge["width_nm"] for ridge in ridges if _solid(cell, ridge["index"]))
    between = cell["period_nm"] - sum(ridge["width_nm"] for ridge in ridges)
    return solid + (between if _solid(cell, layer["index"]) else 0.0)


def _profile(cell: Cell) -> tuple[float, list[Slab], float]:
    """Slabs between the depths of all corners and crossings: the covered length is linear within each."""
    pieces = [(np.array(p["vertices_nm"], float), _solid(cell, p["index"])) for p in cell["polygons"]]
    levels = np.unique(np.concatenate([_crossing_depths(pieces), *(vertices[:, 1] for vertices, _ in pieces)]))
    return cell["period_nm"], [(b - a, _filled(pieces, (a + b) / 2)) for a, b in pairwise(levels.tolist())], 0.0


def _filled(pieces: list[tuple[Floats, bool]], depth: float) -> float:
    """Length in nm at a depth where the last polygon over it is solid."""
    spans = [(a, b, solid) for vertices, solid in pieces for a, b in _inside(vertices, depth)]
    cuts = np.unique([x for a, b, _ in spans for x in (a, b)])
    middles = (cuts[:-1] + cuts[1:]) / 2
    solid = np.zeros(middles.size, bool)
    for a, b, filled in spans:
        solid[(a < middles) & (middles < b)] = filled
    return float(np.diff(cuts) @ solid)


def _inside(vertices: Floats, depth: float) -> list[tuple[float, float]]:
    """Intervals of g inside a polygon at a depth, by even and odd crossings."""
    (g0, n0), (g1, n1) = vertices.T, np.roll(vertices, -1, axis=0).T
    passes = (n0 < depth) != (n1 < depth)
    g = np.sort(g0[passes] + (g1 - g0)[passes] * (depth - n0[passes]) / (n1 - n0)[passes])
    return list(zip(g[::2].tolist(), g[1::2].tolist(), strict=True))


def _crossing_depths(pieces: list[tuple[Floats, bool]]) -> Floats:
    """Depths in nm at which two edges cross: a + s d = b + t e with 0 < s, t < 1."""
    a = np.concatenate([vertices for vertices, _ in pieces])
    d = np.concatenate([np.roll(vertices, -1, axis=0) - vertices for vertices, _ in pieces])
    apart = a[None] - a[:, None]
    across = d[:, None, 0] * d[None, :, 1] - d[:, None, 1] * d[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (apart[..., 0] * d[None, :, 1] - apart[..., 1] * d[None, :, 0]) / across
        t = (apart[..., 0] * d[:, None, 1] - apart[..., 1] * d[:, None, 0]) / across
    first, _ = np.nonzero((s > 0) & (s < 1) & (t > 0) & (t < 1))
    return np.asarray(a[first, 1] + s[(s > 0) & (s < 1) & (t > 0) & (t < 1)] * d[first, 1])


_SLABS = {"metagrating": _metagrating, "thin_film": _film, "lamellar": _lamellar, "profile": _profile}
