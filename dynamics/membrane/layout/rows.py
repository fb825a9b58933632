"""Elements row by row: with the nodes of a ring mesh at the points of a lattice, neighbours lie alike.

Rings of six or four sides are a piece of a lattice. All triangles of one orientation, a `family`, have their corners
the same number of rows and columns away from their first one, and all edges of one direction their ends. So a pass over
one row of a family streams through memory without lists of neighbours, as vector code (`sweep`). Rows are filled up to
whole vectors with dead nodes, far off, and dead elements of no stiffness.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices, Integers, Places
from dynamics.membrane.layout.triangles import Patch

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
    found, seen (threads, 2, 2): see `respond`. sides (k, 6, c), frame (k, 10, c), response (k, c, 4): patches
    of triangles, see `triangles.Patch`. board, orders: see `board`.
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


class StepTimes(NamedTuple):
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
def put(values: Floats, slots: Indices, out: Floats) -> None:
    """Put values (m,) into their slots (m,) of out."""
    flat = out.reshape(-1)
    for i in range(slots.size):
        flat[slots[i]] = values[i]


@numba.njit(cache=True, error_model="numpy")
def scatter(place: Indices, x: Floats, out: Floats) -> None:
    """Nodes x (3, n) to their places in out (3, p)."""
    x0, x1, x2 = x[0], x[1], x[2]
    y0, y1, y2 = out[0], out[1], out[2]
    for i in range(place.size):
        k = place[i]
        y0[k] = x0[i]
        y1[k] = x1[i]
        y2[k] = x2[i]


@numba.njit(cache=True, error_model="numpy")
def gather(place: Indices, x: Floats, out: Floats) -> None:
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
