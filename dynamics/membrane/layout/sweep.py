"""Sweeps over the rows of a stencil: forces of the elements, and what they do to the nodes.

A sweep takes row after row: forces of the triangles that begin in it, then, with those of the row before, the nodes.
What lies between stays in a cache.

A sweep may take several steps at once, or `levels`: a row goes through a level as soon as the row after it is through
the level before, so that rows in work stay in the second cache (a wavefront: Wellein et al., IEEE COMPSAC 2009, 579).
Two copies of the nodes are enough, as each level writes over what the one before it has read. Threads begin with the
rows that need nothing of each other's, one less at each level; what is left at the seams between them comes after. The
bits of a number depend neither on levels nor on threads.
"""

from __future__ import annotations

import numba

from beamrider.arrays import Floats
from beamrider.machine_code.standalone import standalone
from beamrider.machine_code.streams import uncounted
from dynamics.membrane.layout import elements
from dynamics.membrane.layout.elements import GUARD, apart
from dynamics.membrane.layout.rows import Stencil, StencilWork, StepTimes


@uncounted(forceinline=True)
def _strain_row(stencil: Stencil, work: StencilWork, x: Floats, r: int, thread: int, level: int, share: float) -> int:
    """Forces on the corners of the triangles that begin on row r; how many may have failed."""
    o, n, bad, ahead, below = stencil.start[r], stencil.width[r], 0, stencil.triangles.ahead, stencil.triangles.below
    nodes, sums, corners = apart(x), apart(work.scratch.push[thread]), work.scratch.corners[thread]
    for f in range(ahead.shape[1]):
        free, scale = apart(work.free[f]), apart(work.scale[f])
        one = apart(corners[0, r % 2, f, 0])
        two = apart(corners[level * below[f, 0], r % 2, f, 1])
        three = apart(corners[level * below[f, 1], r % 2, f, 2])
        if share > 0.0:
            bad += elements.strain(
                True,
                o,
                n,
                ahead[r, f, 0],
                ahead[r, f, 1],
                nodes,
                free,
                scale,
                work.shear[f],
                work.bound[f],
                share,
                apart(work.held[f]),
                one,
                two,
                three,
                sums,
            )
        else:
            bad += elements.strain(
                False,
                o,
                n,
                ahead[r, f, 0],
                ahead[r, f, 1],
                nodes,
                free,
                scale,
                work.shear[f],
                work.bound[f],
                share,
                nodes,
                one,
                two,
                three,
                sums,
            )
    return bad


@uncounted(forceinline=True)
def _stretch_row(stencil: Stencil, work: StencilWork, x: Floats, r: int, thread: int, level: int, share: float) -> int:
    """The same of springs, and the light's force on the corners of the triangles."""
    o, n, bad, ahead, below = stencil.start[r], stencil.width[r], 0, stencil.edges.ahead, stencil.edges.below
    nodes, sums = apart(x), apart(work.scratch.push[thread])
    for f in range(ahead.shape[1]):
        out = apart(work.scratch.ends[thread, level * below[f, 0], r % 2, f])
        bad += elements.stretch(
            o, n, ahead[r, f, 0], nodes, stencil.stiffness[f], work.lengths[f], stencil.stretch[f], out
        )
    ahead = stencil.triangles.ahead
    for f in range(ahead.shape[1] if share > 0.0 else 0):
        out = apart(work.scratch.corners[thread, level, r % 2, f, 0])
        elements.push(o, n, ahead[r, f, 0], ahead[r, f, 1], nodes, share, apart(work.held[f]), out, sums)
    return bad


@uncounted(forceinline=True)
def _act(stencil: Stencil, work: StencilWork, x: Floats, r: int, thread: int, level: int, share: float) -> int:
    """What all elements that begin on row r do; how many may have failed."""
    if share > 0.0:
        work.scratch.push[thread] = 0.0
    if stencil.stiffness.size > 0:
        return _stretch_row(stencil, work, x, r, thread, level, share)
    return _strain_row(stencil, work, x, r, thread, level, share)


@uncounted(forceinline=True)
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


@uncounted(forceinline=True)
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


@uncounted(forceinline=True)
def _move(stencil: Stencil, work: StencilWork, r: int, thread: int, source: int, times: StepTimes) -> None:
    """What the forces do to the nodes of row r."""
    o, n, target, scratch = stencil.start[r], stencil.width[r], 1 - source, work.scratch
    force, per_mass, v, x = scratch.force[thread], stencil.per_mass, scratch.v, scratch.x
    for c in range(3):
        if times.moves:
            elements.advance(
                o,
                n,
                force[c],
                per_mass,
                times.close,
                times.open,
                times.dt,
                v[source, c],
                x[source, c],
                v[target, c],
                x[target, c],
            )
        else:
            elements.accelerate(o, n, force[c], per_mass, v[target, c])


@uncounted(forceinline=True)
def _add_light(stencil: Stencil, work: StencilWork, r: int, thread: int, level: int) -> None:
    """The light's force on row r: three times its shares."""
    for c in range(3):
        lanes = work.scratch.lanes[thread, c]
        elements.add_lanes(stencil.width[r], work.scratch.push[thread, c], lanes)
        half, rest = (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]), (lanes[4] + lanes[5]) + (lanes[6] + lanes[7])
        work.scratch.sums[level, r, c] = 3.0 * (half + rest)


@uncounted(forceinline=True)
def _pass(
    stencil: Stencil, work: StencilWork, source: int, times: StepTimes, thread: int, level: int, r: int, ahead: int
) -> int:
    """Forces on nodes x[source] of row r, and what follows for them; how many elements may have failed.

    ahead: 1 if the elements of the row before are needed, too, else 0.
    """
    found = 0
    for k in range(r - ahead, r + 1):
        found = _act(stencil, work, work.scratch.x[source], k, thread, level, times.share)
    _collect(stencil, work, r, thread, level, times.share > 0.0)
    _move(stencil, work, r, thread, source, times)
    if times.share > 0.0:
        _add_light(stencil, work, r, thread, level)
    return found


@standalone(_nrt=False)
def sweep(
    stencil: Stencil, work: StencilWork, source: int, times: StepTimes, thread: int, levels: int, seam: bool
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
                bad += _pass(stencil, work, here, times, thread, level, r, 1 if r == top and r > 0 else 0)
    work.scratch.bad[thread] = bad


@numba.njit(cache=True, error_model="numpy")
def add_up(sums: Floats, total: Floats) -> None:
    """Total (3,) of the forces (r, 3) on rows."""
    for c in range(3):
        total[c] = 0.0
        for r in range(sums.shape[0]):
            total[c] += sums[r, c]
