"""Ring meshes on the points of a lattice, row by row, for the kernels of `dynamics.membrane.layout.rows`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers
from dynamics.membrane.effects.sheet import Sheet
from dynamics.membrane.effects.springs import Springs
from dynamics.membrane.layout.board import BOARD, ORDERS
from dynamics.membrane.layout.elements import GUARD
from dynamics.membrane.layout.rows import Families, Scratch, Stencil, StencilWork, clear
from dynamics.sail.mesh import Mesh
from dynamics.sail.shapes import lattice_points

#: ℓ/L of springs that never tear.
NEVER = 1e300
#: Steps at once by one thread, and rows for each of them by several, which lose time at their seams.
LEVELS, ROWS_A_LEVEL = 8, 8
_LINE = int(GUARD)


def aligned(*shape: int) -> Floats:
    """Zeros (...) that begin at a line of the cache: vectors that cross lines cost twice."""
    size = int(np.prod(shape))
    raw = np.zeros(size + _LINE)
    skip = -(raw.ctypes.data // 8) % _LINE
    return raw[skip : skip + size].reshape(shape)


def _unsigned(values: Any, kind: Any = np.uint32) -> Any:
    return np.ascontiguousarray(values, dtype=kind)


def _fill(slots: NDArray[np.uint32], values: Floats, shape: tuple[int, ...], dead: float = 0.0) -> Floats:
    """An array of `dead` with values (m,) in their slots (m,); an empty one where there are no values."""
    out = aligned(*(shape if values.size else (0,) * len(shape)))
    out[...] = dead
    out.reshape(-1)[slots[: values.size]] = values
    return out


def _families(steps: Integers, first: Integers, start: Integers) -> Families:
    """Of families whose other corners are `steps` (f, c, 2) rows and columns away from their first one.

    first (r,): the column of the first place of each row; start (r,): that place. Where there is no row beyond, a place
    that is not the same one stands for that of the corner, and zeros for the forces.
    """
    rows = len(first)
    ahead, slot, begin = np.empty((3, rows, *steps.shape[:2]), np.int64)
    ahead[...], slot[...], begin[...] = 1, 2, _LINE
    for r in range(rows):
        for place in np.ndindex(*steps.shape[:2]):
            down, across = steps[place]
            if r + down < rows:
                ahead[r, *place] = start[r + down] - start[r] + across + first[r] - first[r + down]
                slot[r + down, *place] = r % 2
                begin[r + down, *place] = _LINE + first[r + down] - first[r] - across
    return Families(_unsigned(ahead, np.uint64), slot, _unsigned(begin, np.uint64), steps[..., 0].copy())


def layout(mesh: Mesh, outline: str, rings: int, masses: Floats) -> Stencil:
    """The layout, without springs, of a mesh whose triangles are those of `shapes.shape_triangles` in any order.

    masses (n,) in kg.
    """
    points = lattice_points(outline, rings) + rings
    rows = 2 * rings + 1
    first, last = np.full(rows, rows), np.zeros(rows, np.int64)
    np.minimum.at(first, points[:, 0], points[:, 1])
    np.maximum.at(last, points[:, 0], points[:, 1])
    # One more place than nodes: what the row above looks for beyond the last triangle is there
    width = -(-(last - first + 2) // _LINE) * _LINE
    start = _LINE + np.cumsum(width) - width
    size = int(width.sum() + width.max()) + 2 * _LINE
    place = start[points[:, 0]] + points[:, 1] - first[points[:, 0]]
    corner = place[mesh.triangles].argmin(axis=1)[:, None]
    corners = np.take_along_axis(mesh.triangles, (corner + np.arange(3)) % 3, axis=1)
    steps = points[corners[:, 1:]] - points[corners[:, :1]]
    shapes, which = np.unique(steps.reshape(-1, 4), axis=0, return_inverse=True)
    low, high = np.sort(place[mesh.edges], axis=1).T
    node = np.argsort(place)
    apart = points[node[np.searchsorted(place[node], high)]] - points[node[np.searchsorted(place[node], low)]]
    ways, family = np.unique(apart, axis=0, return_inverse=True)
    cells = which.ravel() * size + place[corners[:, 0]]
    sides = (3 * which.reshape(-1, 1) + (np.arange(3) - corner) % 3) * size + place[corners[:, :1]]
    per_mass = aligned(size)
    per_mass[place] = 1.0 / masses
    return Stencil(
        start=_unsigned(start, np.uint64),
        width=_unsigned(width, np.uint64),
        place=_unsigned(place),
        triangles=_families(shapes.reshape(-1, 2, 2), first, start),
        edges=_families(ways[:, None], first, start),
        turns=_unsigned(corner.ravel()),
        cells=_unsigned(cells),
        slots=_unsigned(sides.T.ravel()),
        joins=_unsigned(family.ravel() * size + low),
        per_mass=per_mass,
        stiffness=np.empty((0, 0)),
        stretch=np.empty((0, 0)),
    )


def with_springs(stencil: Stencil, springs: Springs) -> Stencil:
    """A layout with its springs, if there are any."""
    if springs.stiffness.size == 0:
        return stencil._replace(joins=np.empty(0, np.uint32))
    shape = (stencil.edges.ahead.shape[1], stencil.per_mass.size)
    stretch = springs.stretch if springs.stretch.size else np.full(springs.stiffness.size, NEVER)
    return stencil._replace(
        stiffness=_fill(stencil.joins, springs.stiffness, shape), stretch=_fill(stencil.joins, stretch, shape, NEVER)
    )


def _shares(width: NDArray[np.uint64], threads: int) -> Integers:
    """First row of each thread, and the end (threads + 1,): about as many places each.

    A thread looks at the row before its own: on sails of few rows it is the first threads that have none.
    """
    done, rows = np.cumsum(width.astype(float)), len(width)
    ends = [int(np.argmin(np.abs(done - done[-1] * j / threads))) + 1 for j in range(1, threads)]
    return np.array([0, *(min(end, rows - 1) for end in ends), rows])


def scratch_space(stencil: Stencil, lit: bool, patch: int, patches: int, threads: int, levels: int = LEVELS) -> Scratch:
    """What lies between the passes over a row, for so many threads, and patches of so many triangles.

    levels: steps that a sweep may take at once, where all threads have rows enough.
    """
    across, p, rows = int(stencil.width.max()) + 2 * _LINE, stencil.per_mass.size, stencil.start.size
    springs, shares = stencil.stiffness.size > 0, _shares(stencil.width, threads)
    f, k = stencil.triangles.ahead.shape[1], stencil.edges.ahead.shape[1]
    if threads > 1:
        levels = max(1, min(levels, int(np.diff(shares).min()) // ROWS_A_LEVEL))
    scratch = Scratch(
        x=aligned(2, 3, p),
        v=aligned(2, 3, p),
        corners=aligned(*((threads, levels, 3, f, 3, 3, across) if lit or not springs else (0,) * 7)),
        ends=aligned(*((threads, levels, 3, k, 3, across) if springs else (0,) * 6)),
        push=aligned(threads, 3, across if lit else 0),
        force=aligned(threads, 3, across),
        lanes=aligned(threads, 3, 8),
        sums=aligned(levels, rows, 3),
        bad=np.zeros(threads, np.int64),
        shares=shares,
        found=np.zeros((threads, 2, 2), np.int64),
        seen=np.zeros((threads, 2, 2)),
        sides=aligned(patches, 6, patch),
        frame=aligned(patches, 10, patch),
        response=aligned(patches, patch, 4),
        board=np.zeros(BOARD, np.int64),
        orders=np.zeros(ORDERS),
    )
    for copy in range(2):
        clear(scratch, copy)
    return scratch


def free_sides(stencil: Stencil, sheet: Sheet) -> Floats:
    """Squared free lengths (f, 3, p) in m² of cold triangles; empty where springs carry the load."""
    return _fill(stencil.slots, sheet.free, (stencil.triangles.ahead.shape[1], 3, stencil.per_mass.size))


def stencil_work(stencil: Stencil, springs: Springs, sheet: Sheet, lit: bool, scratch: Scratch) -> StencilWork:
    """Work space, with all elements as they are at rest but for what triangles carry."""
    k, f, p = stencil.edges.ahead.shape[1], stencil.triangles.ahead.shape[1], stencil.per_mass.size
    elastic = sheet.modulus.size > 0
    return StencilWork(
        lengths=_fill(stencil.joins, springs.rest[: springs.stiffness.size], (k, p), 1.0),
        free=free_sides(stencil, sheet),
        scale=aligned(*((f, 3, p) if elastic else (0, 0, 0))),
        shear=aligned(*((f, p) if elastic else (0, 0))),
        bound=_fill(stencil.cells, sheet.modulus, (f, p), NEVER),
        held=aligned(*((f, 3, p) if lit else (0, 0, 0))),
        scratch=scratch,
    )


def kept(work: StencilWork) -> StencilWork:
    """The part of the work space that a later run needs, whatever its number of threads."""
    none = {name: np.zeros((0,) * value.ndim, value.dtype) for name, value in work.scratch._asdict().items()}
    return work._replace(scratch=Scratch(**none))
