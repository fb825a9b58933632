"""Forces and steps, row by row: with the nodes of a ring mesh at the points of a lattice, neighbours lie alike.

Rings of six or four sides are a piece of a lattice. All triangles of one orientation, a `family`, have their corners
the same number of rows and columns away from their first one, and all edges of one direction their ends. So a pass over
one row of a family streams through memory without lists of neighbours, as vector code. A sweep takes row after row:
forces of the triangles that begin in it, then, with those of the row before, the nodes. What lies between stays in a
cache. Rows are filled up to whole vectors with dead nodes, far off, and dead elements of no stiffness.

A sweep may take several steps at once, or `levels`: a row goes through a level as soon as the row after it is through
the level before, so that rows in work stay in the second cache (a wavefront: Wellein et al., IEEE COMPSAC 2009, 579).
Two copies of the nodes are enough, as each level writes over what the one before it has read. Threads begin with the
rows that need nothing of each other's, one less at each level; what is left at the seams between them comes after. The
bits of a number depend neither on levels nor on threads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dynamics.kernels import elements
from dynamics.kernels.elastic import Floats, Indices, Integers
from dynamics.kernels.elements import GUARD
from dynamics.kernels.streams import by_row
from dynamics.kernels.triangles import Patch

Places = NDArray[np.uint64]

#: Where dead nodes lie in z, in m, as no sail ever does.
FAR = -1e9

class Families(NamedTuple):
    """Where the other corners of triangles lie, or the other ends of edges (c = 1), on each row r.

    ahead (r, f, c): how far ahead of the first corner. slot, begin (r, f, c): where the work space holds what elements
    that begin here or on the row before do to the nodes of row r, from its first node on. below (f, c): 1 where that
    corner lies on the next row, else 0.
    """

    ahead: Places
    slot: Integers
    begin: Places
    below: Integers


class Stencil(NamedTuple):
    """Layout on rows of `width` (r,) places, the first of which are at `start` (r,).

    place (n,): of each node. triangles, edges: their families. turns (t,): which corner of a triangle of the mesh is
    its first one here. cells (t,): where the triangles lie in (f, p); slots (3t,): where their sides 01, then 12, then
    20 lie in (f, 3, p). joins (e,): where the edges lie in (k, p). per_mass (p,) in 1/kg, 0 for dead nodes. Springs,
    empty where triangles carry the load: stiffness (k, p) in N/m; stretch (k, p): ℓ/L at which an edge tears.
    """

    start: Places
    width: Places
    place: Indices
    triangles: Families
    edges: Families
    turns: Indices
    cells: Indices
    slots: Indices
    joins: Indices
    per_mass: Floats
    stiffness: Floats
    stretch: Floats


class Scratch(NamedTuple):
    """What nothing is kept in from one call of the kernels to the next, some of it once for every thread.

    x, v (2, 3, p): nodes and velocities, before and after a step in m and m/s. corners (threads, levels, 3, f, 3, 3,
    w): forces on the corners of the triangles of two rows, and zeros; those on the row itself are kept for no level
    but the present one. ends (threads, levels, 3, k, 3, w): of edges, on their first end. push, force
    (threads, 3, w): of the light and on nodes. lanes (threads, 3, 8): partial sums. sums (levels, r, 3): the light's
    force on each row in N. bad (threads,): how many elements failed. shares (threads + 1,): the rows of each thread.
    found, seen (threads, 2, 2): see `optical.respond`. sides (k, 6, c), frame (k, 10, c), response (k, c, 4): patches
    of triangles, see `triangles.Patch`. board, orders: see `crew`.
    """

    x: Floats
    v: Floats
    corners: Floats
    ends: Floats
    push: Floats
    force: Floats
    lanes: Floats
    sums: Floats
    bad: Integers
    shares: Integers
    found: Integers
    seen: Floats
    sides: Floats
    frame: Floats
    response: Floats
    board: Integers
    orders: Floats


class StencilWork(NamedTuple):
    """Work space. lengths (k, p): free lengths of springs in m. free (f, 3, p): squared ones of triangles in m².

    scale (f, 3, p): cotangents times the root of the modulus; shear (f, p): modulus · (1 − ν); bound (f, p) in N m:
    twice the elastic energy below which nothing tears (see `stiffen`). held (f, 3, p): of the light, along the sides
    from the first corner here and across.
    """

    lengths: Floats
    free: Floats
    scale: Floats
    shear: Floats
    bound: Floats
    held: Floats
    scratch: Scratch


class Pace(NamedTuple):
    """A step: velocities change by `close` and then by `open` times the acceleration, nodes move on for dt; all in s.

    moves: False to write accelerations in place of the velocities after it. share: a third of light's
    ramp, 0 in the dark.
    """

    moves: bool
    close: float
    open: float
    dt: float
    share: float


@numba.njit(cache=True, error_model="numpy")
def spread(values: Floats, slots: Indices, out: Floats) -> None:
    """Put values (m,) into their slots (m,) of out."""
    flat = out.reshape(-1)
    for i in range(slots.size):
        flat[slots[i]] = values[i]


@numba.njit(cache=True, error_model="numpy")
def lay(place: Indices, x: Floats, out: Floats) -> None:
    """Nodes x (3, n) to their places in out (3, p)."""
    x0, x1, x2 = x[0], x[1], x[2]
    y0, y1, y2 = out[0], out[1], out[2]
    for i in range(place.size):
        k = place[i]
        y0[k] = x0[i]
        y1[k] = x1[i]
        y2[k] = x2[i]


@numba.njit(cache=True, error_model="numpy")
def pick(place: Indices, x: Floats, out: Floats) -> None:
    """Nodes out (3, n) from their places in x (3, p)."""
    x0, x1, x2 = x[0], x[1], x[2]
    y0, y1, y2 = out[0], out[1], out[2]
    for i in range(place.size):
        k = place[i]
        y0[i] = x0[k]
        y1[i] = x1[k]
        y2[i] = x2[k]


@numba.njit(cache=True, error_model="numpy")
def clear(scratch: Scratch, copy: int) -> None:
    """All nodes of one copy to where dead ones lie, at rest: a step with numbers that are not finite may move them."""
    x, v = scratch.x[copy], scratch.v[copy]
    for i in range(x.shape[1]):
        x[0, i], x[1, i], x[2, i] = i, 0.0, FAR
        v[0, i], v[1, i], v[2, i] = 0.0, 0.0, 0.0


@numba.njit(cache=True, error_model="numpy")
def stiffen(
    stencil: Stencil, cotangent: Floats, modulus: Floats, shear: Floats, limit: Floats, out: StencilWork
) -> None:
    """To the rows what triangles carry: cotangent (3t,), modulus, shear, limit (t,) as in `Sheet`; limit may be empty.

    The larger principal stress is at most √(2Yu/(1 − ν²)) at an energy u per volume, for any smaller one. A millionth
    is left for rounding.
    """
    scale, t = out.scale.reshape(-1), modulus.size
    for i in range(t):
        root, cell = math.sqrt(modulus[i]), stencil.cells[i]
        for c in range(3):
            scale[stencil.slots[c * t + i]] = root * cotangent[c * t + i]
        out.shear.reshape(-1)[cell] = shear[i]
        most = modulus[i] * limit[i] * abs(limit[i]) * (1.0 - 1e-6) if limit.size > 0 else np.inf
        out.bound.reshape(-1)[cell] = most if most < 1e300 else 1e300


@numba.njit(cache=True, error_model="numpy")
def hold(stencil: Stencil, values: Floats, begin: int, at: int, n: int, out: Floats) -> None:
    """Held coefficients of n triangles from `begin` on to their places in out (f, 3, p).

    values (·, ≥ 3), from line `at` on: along the sides from the triangle's first corner and across; out: along those
    from the first corner here.
    """
    flat, size = out.reshape(-1), stencil.per_mass.size
    for i in range(n):
        k, turn = _held_place(stencil, begin + i), stencil.turns[begin + i]
        a, b = values[at + i, 0], values[at + i, 1]
        flat[k] = a if turn == 0 else (b if turn == 1 else -a - b)
        flat[k + size] = b if turn == 0 else (-a - b if turn == 1 else a)
        flat[k + 2 * size] = values[at + i, 2]


@numba.njit(cache=True, inline="always")
def _held_place(stencil: Stencil, i: int) -> int:
    """Where the first coefficient of triangle i lies: place k of family f is (f, 0, k) of (f, 3, p)."""
    size = stencil.per_mass.size
    return int(stencil.cells[i]) + 2 * size * (int(stencil.cells[i]) // size)


@numba.njit(cache=True, error_model="numpy")
def drop(stencil: Stencil, i: int, out: Floats) -> None:
    """No held light on triangle i of out (f, 3, p)."""
    k, flat = _held_place(stencil, i), out.reshape(-1)
    for c in range(3):
        flat[k + c * stencil.per_mass.size] = 0.0


@numba.njit(cache=True, inline="always")
def patch(scratch: Scratch, thread: int) -> Patch:
    """Where a thread looks at triangles; all share one patch where that holds the whole sail."""
    k = min(thread, scratch.sides.shape[0] - 1)
    return Patch(scratch.sides[k], scratch.frame[k], scratch.response[k])


@by_row(forceinline=True)
def _strain_row(
    stencil: Stencil, work: StencilWork, x: Floats, r: int, thread: int, level: int, share: float
) -> int:
    """Forces on the corners of the triangles that begin on row r; how many may have failed."""
    o, n, bad, ahead, below = stencil.start[r], stencil.width[r], 0, stencil.triangles.ahead, stencil.triangles.below
    x0, x1, x2, sums, corners = x[0], x[1], x[2], work.scratch.push[thread], work.scratch.corners[thread]
    for f in range(ahead.shape[1]):
        free, scale = work.free[f], work.scale[f]
        a, b, c = corners[0, r % 2, f, 0], corners[level * below[f, 0], r % 2, f, 1], corners[
            level * below[f, 1], r % 2, f, 2
        ]
        if share > 0.0:
            held = work.held[f]
            bad += elements.strain(
                True, o, n, ahead[r, f, 0], ahead[r, f, 1], x0, x1, x2, free[0], free[1], free[2], scale[0], scale[1],
                scale[2], work.shear[f], work.bound[f], share, held[0], held[1], held[2], a[0], a[1], a[2], b[0], b[1],
                b[2], c[0], c[1], c[2], sums[0], sums[1], sums[2],
            )
        else:
            bad += elements.strain(
                False, o, n, ahead[r, f, 0], ahead[r, f, 1], x0, x1, x2, free[0], free[1], free[2], scale[0], scale[1],
                scale[2], work.shear[f], work.bound[f], share, x0, x1, x2, a[0], a[1], a[2], b[0], b[1], b[2], c[0],
                c[1], c[2], sums[0], sums[1], sums[2],
            )
    return bad


@by_row(forceinline=True)
def _stretch_row(
    stencil: Stencil, work: StencilWork, x: Floats, r: int, thread: int, level: int, share: float
) -> int:
    """The same of springs, and the light's force on the corners of the triangles."""
    o, n, bad, ahead, below = stencil.start[r], stencil.width[r], 0, stencil.edges.ahead, stencil.edges.below
    x0, x1, x2, sums = x[0], x[1], x[2], work.scratch.push[thread]
    for f in range(ahead.shape[1]):
        out = work.scratch.ends[thread, level * below[f, 0], r % 2, f]
        bad += elements.stretch(
            o, n, ahead[r, f, 0], x0, x1, x2, stencil.stiffness[f], work.lengths[f], stencil.stretch[f], out[0],
            out[1], out[2],
        )
    ahead = stencil.triangles.ahead
    for f in range(ahead.shape[1] if share > 0.0 else 0):
        held, out = work.held[f], work.scratch.corners[thread, level, r % 2, f, 0]
        elements.push(
            o, n, ahead[r, f, 0], ahead[r, f, 1], x0, x1, x2, share, held[0], held[1], held[2], out[0], out[1], out[2],
            sums[0], sums[1], sums[2],
        )
    return bad


@by_row(forceinline=True)
def _act(stencil: Stencil, work: StencilWork, x: Floats, r: int, thread: int, level: int, share: float) -> int:
    """What all elements that begin on row r do; how many may have failed."""
    if share > 0.0:
        work.scratch.push[thread] = 0.0
    if stencil.stiffness.size > 0:
        return _stretch_row(stencil, work, x, r, thread, level, share)
    return _strain_row(stencil, work, x, r, thread, level, share)


@by_row(forceinline=True)
def _collect_corners(stencil: Stencil, work: StencilWork, r: int, thread: int, level: int, apart: int) -> None:
    """Force on the nodes of row r from their triangles; apart: 1 if corners carry forces of their own, else 0."""
    n, table = stencil.width[r], stencil.triangles
    corners, force = work.scratch.corners[thread], work.scratch.force[thread]
    for f in range(table.ahead.shape[1]):
        i, j = table.begin[r, f, 0], table.begin[r, f, 1]
        at, first, second = level * (1 - apart), level, level
        if apart == 1:
            first, second = level * table.below[f, 0], level * table.below[f, 1]
        here = corners[at, r % 2, f, 0]
        one, two = corners[first, table.slot[r, f, 0], f, apart], corners[second, table.slot[r, f, 1], f, 2 * apart]
        for c in range(3):
            if f == 0:
                elements.put_corners(n, GUARD, here[c], i, one[c], j, two[c], force[c])
            else:
                elements.add_corners(n, GUARD, here[c], i, one[c], j, two[c], force[c])


@by_row(forceinline=True)
def _collect(stencil: Stencil, work: StencilWork, r: int, thread: int, level: int, lit: bool) -> None:
    """Force on the nodes of row r, from what begins there and on the row before."""
    if stencil.stiffness.size == 0:
        _collect_corners(stencil, work, r, thread, level, 1)
        return
    n, table, force = stencil.width[r], stencil.edges, work.scratch.force[thread]
    if lit:
        _collect_corners(stencil, work, r, thread, level, 0)
    else:
        force[:] = 0.0
    for f in range(table.ahead.shape[1]):
        ends = work.scratch.ends[thread, level * table.below[f, 0]]
        here, there = ends[r % 2, f], ends[table.slot[r, f, 0], f]
        for c in range(3):
            elements.add_ends(n, here[c], table.begin[r, f, 0], there[c], force[c])


@by_row(forceinline=True)
def _move(stencil: Stencil, work: StencilWork, r: int, thread: int, source: int, pace: Pace) -> None:
    """What the forces do to the nodes of row r."""
    o, n, target, scratch = stencil.start[r], stencil.width[r], 1 - source, work.scratch
    force, per_mass, v, x = scratch.force[thread], stencil.per_mass, scratch.v, scratch.x
    for c in range(3):
        if pace.moves:
            elements.advance(
                o, n, force[c], per_mass, pace.close, pace.open, pace.dt, v[source, c], x[source, c], v[target, c],
                x[target, c],
            )
        else:
            elements.accelerate(o, n, force[c], per_mass, v[target, c])


@by_row(forceinline=True)
def _add_light(stencil: Stencil, work: StencilWork, r: int, thread: int, level: int) -> None:
    """The light's force on row r: three times its shares."""
    for c in range(3):
        lanes = work.scratch.lanes[thread, c]
        elements.add_lanes(stencil.width[r], work.scratch.push[thread, c], lanes)
        half, rest = (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]), (lanes[4] + lanes[5]) + (lanes[6] + lanes[7])
        work.scratch.sums[level, r, c] = 3.0 * (half + rest)


@by_row(forceinline=True)
def _pass(
    stencil: Stencil, work: StencilWork, source: int, pace: Pace, thread: int, level: int, r: int, ahead: int
) -> int:
    """Forces on nodes x[source] of row r, and what follows for them; how many elements may have failed.

    ahead: 1 if the elements of the row before are needed, too, else 0.
    """
    found = 0
    for k in range(r - ahead, r + 1):
        found = _act(stencil, work, work.scratch.x[source], k, thread, level, pace.share)
    _collect(stencil, work, r, thread, level, pace.share > 0.0)
    _move(stencil, work, r, thread, source, pace)
    if pace.share > 0.0:
        _add_light(stencil, work, r, thread, level)
    return found


@by_row()
def sweep(
    stencil: Stencil, work: StencilWork, source: int, pace: Pace, thread: int, levels: int, seam: bool
) -> None:
    """So many steps from nodes x[source], if they move, of the rows of a thread; failures to bad[thread].

    At each level a thread has one row less at each seam with another. seam: those rows, at its first end.
    """
    shares, bad = work.scratch.shares, 0
    first, end = shares[thread], shares[thread if seam else thread + 1]
    # By how much each end lies further down at each level
    lean, slant = 1 if thread > 0 else 0, -1 if thread < shares.size - 2 else 0
    if seam:
        lean, slant = -1, 1
    for wave in range(first, end + (slant + 1) * (levels - 1)):
        for level in range(levels):
            r, top = wave - level, first + lean * level
            if top <= r < end + slant * level:
                here = source if level % 2 == 0 else 1 - source
                bad += _pass(stencil, work, here, pace, thread, level, r, 1 if r == top and r > 0 else 0)
    work.scratch.bad[thread] = bad


@numba.njit(cache=True, error_model="numpy")
def add_up(sums: Floats, total: Floats) -> None:
    """Total (3,) of the forces (r, 3) on rows."""
    for c in range(3):
        total[c] = 0.0
        for r in range(sums.shape[0]):
            total[c] += sums[r, c]
