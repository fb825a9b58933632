"""Ring meshes on the points of a lattice, row by row, for the kernels of `dynamics.kernels.stencil`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics.kernels.elastic import Springs
from dynamics.kernels.sheet import Sheet
from dynamics.kernels.stencil import Stencil, StencilWork
from dynamics.mesh import Floats, Mesh
from dynamics.shapes import lattice_points

#: Where dead nodes lie in z, in m, as no sail ever does; and ℓ/L of springs that never tear.
FAR, NEVER = -1e9, 1e300


def _unsigned(values: Any) -> NDArray[np.uint32]:
    return np.ascontiguousarray(values, dtype=np.uint32)


def _fill(slots: NDArray[np.uint32], values: Floats, shape: tuple[int, ...], dead: float = 0.0) -> Floats:
    """An array of `dead` with values (m,) in their slots (m,); an empty one where there are no values."""
    out = np.full(shape if values.size else (0,) * len(shape), dead)
    out.reshape(-1)[slots[: values.size]] = values
    return out


def layout(mesh: Mesh, outline: str, rings: int) -> Stencil:
    """The layout, without elements, of a mesh whose triangles are those of `shapes.shape_triangles` in any order."""
    width = 2 * rings + 1
    margin = width + 2  # all that belongs to a place that may be alive lies within the arrays
    size = width * width + 2 * margin
    place = (lattice_points(outline, rings) + rings) @ [width, 1] + margin
    a, b = place[mesh.edges.T]
    shifts, family = np.unique(np.abs(b - a), return_inverse=True)
    corners = place[mesh.triangles]
    first = corners.argmin(axis=1)[:, None]
    corners = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
    shapes, which = np.unique(corners - corners[:, :1], axis=0, return_inverse=True)
    ends = np.stack([shapes, np.roll(shapes, -1, axis=1)])
    sides = np.stack([np.searchsorted(shifts, np.abs(ends[1] - ends[0])), ends.min(axis=0)], axis=-1)
    slots = (3 * which.reshape(-1, 1) + (np.arange(3) - first) % 3) * size + corners[:, :1]
    none = np.empty((0, 0))
    return Stencil(
        place=_unsigned(place), shifts=shifts, sides=sides, corners=shapes[:, 1:].copy(),
        turns=_unsigned(first.ravel()), slots=_unsigned(slots.T.ravel()),
        cells=_unsigned(which.ravel() * size + corners[:, 0]),
        edges=_unsigned(family.ravel() * size + np.minimum(a, b)), size=size, begin=margin, end=size - margin,
        stiffness=none, stretch=none, cotangent=np.empty((0, 0, 0)), poisson=none,
    )


def with_elements(stencil: Stencil, springs: Springs, sheet: Sheet) -> Stencil:
    """A layout with its springs or triangles."""
    k, f, p = stencil.shifts.size, len(stencil.sides), stencil.size
    stretch = springs.stretch if springs.stretch.size else np.full(springs.stiffness.size, NEVER)
    return stencil._replace(
        stiffness=_fill(stencil.edges, springs.stiffness, (k, p)),
        stretch=_fill(stencil.edges, stretch, (k, p), NEVER),
        cotangent=_fill(stencil.slots, sheet.cotangent, (f, 3, p)),
        poisson=_fill(stencil.cells, sheet.poisson, (f, p)),
    )


def stencil_work(stencil: Stencil, springs: Springs, sheet: Sheet, lit: bool) -> StencilWork:
    """Work space, with all elements as they are at rest."""
    k, f, p = stencil.shifts.size, len(stencil.sides), stencil.size
    limit = sheet.limit if sheet.limit.size else np.full(sheet.modulus.size, np.inf)
    lengths = springs.rest[: springs.stiffness.size]
    light = (f, 3, p) if lit else (0, 0, 0)
    return StencilWork(
        x=np.stack([np.arange(p), np.zeros(p), np.full(p, FAR)]), squares=np.zeros((k, p)), tension=np.zeros((k, p)),
        force=np.zeros((3, p)), lengths=_fill(stencil.edges, lengths, (k, p), 1.0),
        free=_fill(stencil.slots, sheet.rest, (f, 3, p)), modulus=_fill(stencil.cells, sheet.modulus, (f, p)),
        limit=_fill(stencil.cells, limit, (f, p), np.inf), held=np.zeros(light), push=np.zeros(light),
        row=np.zeros(math.isqrt(stencil.end - stencil.begin) if lit else 0),
    )
