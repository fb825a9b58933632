"""Forces on rows: with the nodes of a ring mesh at the points of a lattice, neighbours lie at constant distances.

Rings of six or four sides are a piece of a lattice. Laid out row by row, all edges of one direction join places that
are a constant `shift` apart, and all triangles of one orientation have their corners at constant shifts: a `family`.
Passes then stream through memory without indices, as vector code. Places outside the sail hold dead nodes, far off,
and dead elements of no stiffness. A number is computed by the same operations wherever a pass is split.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from dynamics.kernels.elastic import Floats, Indices, Integers
from dynamics.kernels.sheet import holds


class Stencil(NamedTuple):
    """Layout on `size` places p, of which `begin` to `end` may be alive, and elements; what is off is empty.

    place (n,): of each node. shifts (k,): an edge of family j joins places i and i + shifts[j]. sides (f, 3, 2): for
    the sides 01, 12, 20 of a triangle at place i the family of the edge, and how far behind i that edge lies. corners
    (f, 2): how far behind i its second and third corner lie; turns (t,): which corner of a triangle of the mesh is its
    first one here. slots (3t,): where the sides 01, then 12, then 20 of the mesh's triangles lie in (f, 3, p). cells
    (t,): where its triangles lie in (f, p). edges (e,): where its edges lie in (k, p).
    Springs: stiffness (k, p) in N/m, stretch (k, p): ℓ/L at which an edge tears. Triangles, as in `Sheet`: cotangent
    (f, 3, p), poisson (f, p).
    """

    place: Indices
    shifts: Integers
    sides: Integers
    corners: Integers
    turns: Indices
    slots: Indices
    cells: Indices
    edges: Indices
    size: int
    begin: int
    end: int
    stiffness: Floats
    stretch: Floats
    cotangent: Floats
    poisson: Floats


class StencilWork(NamedTuple):
    """Work space: nodes x and force on them (3, p) in m and N; of the edges, squares (k, p) of their lengths in m².

    tension (k, p): of the edges over length in N/m. lengths (k, p): free lengths of springs in m. free (f, 3, p),
    modulus, limit (f, p): of triangles, as in `SheetWork`, the limit ∞ where nothing tears.
    """

    x: Floats
    squares: Floats
    tension: Floats
    force: Floats
    lengths: Floats
    free: Floats
    modulus: Floats
    limit: Floats
    held: Floats
    push: Floats
    row: Floats


@numba.njit(cache=True, error_model="numpy")
def spread(values: Floats, slots: Indices, out: Floats) -> None:
    """Put values (m,) into their slots (m,) of out."""
    flat = out.reshape(-1)
    for i in range(slots.size):
        flat[slots[i]] = values[i]


@numba.njit(cache=True, error_model="numpy")
def _lay(place: Indices, x: Floats, out: Floats) -> None:
    """Nodes x (3, n) to their places in out (3, p)."""
    x0, x1, x2 = x[0], x[1], x[2]
    y0, y1, y2 = out[0], out[1], out[2]
    for i in range(place.size):
        k = place[i]
        y0[k] = x0[i]
        y1[k] = x1[i]
        y2[k] = x2[i]


@numba.njit(cache=True, error_model="numpy")
def accelerations(stencil: Stencil, work: StencilWork, per_mass: Floats, out: Floats) -> None:
    """Accelerations out (3, n) in m/s² of nodes of 1/mass per_mass (n,) in 1/kg."""
    x0, x1, x2 = work.force[0], work.force[1], work.force[2]
    y0, y1, y2 = out[0], out[1], out[2]
    place = stencil.place
    for i in range(place.size):
        k = place[i]
        y0[i] = x0[k] * per_mass[i]
        y1[i] = x1[k] * per_mass[i]
        y2[i] = x2[k] * per_mass[i]


@numba.njit(cache=True, error_model="numpy")
def _measure(x: Floats, shift: int, begin: int, end: int, squares: Floats, tension: Floats) -> None:
    """Squared lengths (p,) of a family of edges, and no tension yet."""
    a0, a1, a2 = x[0, begin:end], x[1, begin:end], x[2, begin:end]
    b0, b1, b2 = x[0, begin + shift : end + shift], x[1, begin + shift : end + shift], x[2, begin + shift : end + shift]
    q, t = squares[begin:end], tension[begin:end]
    for i in range(q.size):
        d0 = b0[i] - a0[i]
        d1 = b1[i] - a1[i]
        d2 = b2[i] - a2[i]
        q[i] = d0 * d0 + d1 * d1 + d2 * d2
        t[i] = 0.0


@numba.njit(cache=True, error_model="numpy")
def _stretch(squares: Floats, stiffness: Floats, free: Floats, stretch: Floats, tension: Floats) -> int:
    """Tension over length k (ℓ − L)/ℓ of springs; how many are longer than `stretch` allows, or not finite."""
    bad = 0
    for i in range(tension.size):
        length = math.sqrt(squares[i])
        bad += 0 if length <= free[i] * stretch[i] else 1
        tension[i] = stiffness[i] * (1.0 - free[i] / length)
    return bad


@numba.njit(cache=True, error_model="numpy")
def _strain(
    q0: Floats, q1: Floats, q2: Floats, free: Floats, cotangent: Floats, begin: int, end: int, poisson: Floats,
    modulus: Floats, limit: Floats, t0: Floats, t1: Floats, t2: Floats,
) -> int:
    """Add the tensions over length 2 ∂U/∂q of the sides of triangles to t0, t1, t2; how many failed, as in `sheet`."""
    f0, f1, f2 = free[0, begin:end], free[1, begin:end], free[2, begin:end]
    c0, c1, c2 = cotangent[0, begin:end], cotangent[1, begin:end], cotangent[2, begin:end]
    bad = 0
    for i in range(modulus.size):
        d0 = q0[i] - f0[i]
        d1 = q1[i] - f1[i]
        d2 = q2[i] - f2[i]
        trace = c0[i] * d0 + c1[i] * d1 + c2[i] * d2
        total = d0 + d1 + d2
        spread = trace * trace - total * total + 2.0 * (d0 * d0 + d1 * d1 + d2 * d2)
        bad += 0 if holds(trace, spread, poisson[i], limit[i]) else 1
        shear, half = 1.0 - poisson[i], 0.5 * total
        t0[i] += modulus[i] * (c0[i] * trace - shear * (half - d0))
        t1[i] += modulus[i] * (c1[i] * trace - shear * (half - d1))
        t2[i] += modulus[i] * (c2[i] * trace - shear * (half - d2))
    return bad


@numba.njit(cache=True, error_model="numpy")
def _strain_all(stencil: Stencil, work: StencilWork) -> int:
    """Tensions of all triangles; how many failed."""
    begin, end, bad = stencil.begin, stencil.end, 0
    for f in range(stencil.sides.shape[0]):
        (a, p), (b, q), (c, r) = stencil.sides[f, 0], stencil.sides[f, 1], stencil.sides[f, 2]
        bad += _strain(
            work.squares[a, begin + p : end + p], work.squares[b, begin + q : end + q],
            work.squares[c, begin + r : end + r], work.free[f], stencil.cotangent[f], begin, end,
            stencil.poisson[f, begin:end], work.modulus[f, begin:end], work.limit[f, begin:end],
            work.tension[a, begin + p : end + p], work.tension[b, begin + q : end + q],
            work.tension[c, begin + r : end + r],
        )
    return bad


@numba.njit(cache=True, error_model="numpy")
def _pull_three(x: Floats, tension: Floats, shifts: Integers, begin: int, end: int, force: Floats) -> None:
    """One component (p,) of the forces of the first three families, Σ T_i (x_{i+s} − x_i) − T_{i−s} (x_i − x_{i−s})."""
    p, q, s = shifts[0], shifts[1], shifts[2]
    here, out = x[begin:end], force[begin:end]
    a0, a1, a2 = x[begin + p : end + p], x[begin + q : end + q], x[begin + s : end + s]
    b0, b1, b2 = x[begin - p : end - p], x[begin - q : end - q], x[begin - s : end - s]
    t0, t1, t2 = tension[0, begin:end], tension[1, begin:end], tension[2, begin:end]
    u0, u1, u2 = tension[0, begin - p : end - p], tension[1, begin - q : end - q], tension[2, begin - s : end - s]
    for i in range(out.size):
        y = here[i]
        first = t0[i] * (a0[i] - y) - u0[i] * (y - b0[i])
        second = t1[i] * (a1[i] - y) - u1[i] * (y - b1[i])
        third = t2[i] * (a2[i] - y) - u2[i] * (y - b2[i])
        out[i] = first + second + third


@numba.njit(cache=True, error_model="numpy")
def _add_pull(x: Floats, tension: Floats, shift: int, begin: int, end: int, force: Floats) -> None:
    """Add the same of one more family."""
    here, ahead, behind = x[begin:end], x[begin + shift : end + shift], x[begin - shift : end - shift]
    t, u, out = tension[begin:end], tension[begin - shift : end - shift], force[begin:end]
    for i in range(out.size):
        out[i] += t[i] * (ahead[i] - here[i]) - u[i] * (here[i] - behind[i])


@numba.njit(cache=True, error_model="numpy")
def pull(stencil: Stencil, work: StencilWork, x: Floats) -> int:
    """Elastic forces on nodes x (3, n) to work.force; how many elements failed or are not finite."""
    begin, end, shifts = stencil.begin, stencil.end, stencil.shifts
    _lay(stencil.place, x, work.x)
    for j in range(shifts.size):
        _measure(work.x, shifts[j], begin, end, work.squares[j], work.tension[j])
    bad = 0
    if stencil.poisson.size > 0:
        bad = _strain_all(stencil, work)
    else:
        for j in range(shifts.size):
            bad += _stretch(
                work.squares[j, begin:end], stencil.stiffness[j, begin:end], work.lengths[j, begin:end],
                stencil.stretch[j, begin:end], work.tension[j, begin:end],
            )
    for c in range(3):
        _pull_three(work.x[c], work.tension, shifts, begin, end, work.force[c])
        for j in range(3, shifts.size):
            _add_pull(work.x[c], work.tension[j], shifts[j], begin, end, work.force[c])
    return bad


@numba.njit(cache=True, error_model="numpy")
def hold(stencil: Stencil, held: Floats, out: Floats) -> None:
    """Held coefficients (3, t) to their places in out (f, 3, p), along the sides from the first corner here."""
    h0, h1, h2 = held[0], held[1], held[2]
    flat, size = out.reshape(-1), stencil.size
    for i in range(stencil.cells.size):
        # Place i of family f is (f, 0, i) of out
        k = stencil.cells[i] + 2 * size * (stencil.cells[i] // size)
        turn, a, b = stencil.turns[i], h0[i], h1[i]
        flat[k] = a if turn == 0 else (b if turn == 1 else -a - b)
        flat[k + size] = b if turn == 0 else (-a - b if turn == 1 else a)
        flat[k + 2 * size] = h2[i]


@numba.njit(cache=True, error_model="numpy")
def _turn(x: Floats, held: Floats, second: int, third: int, share: float, begin: int, end: int, push: Floats) -> None:
    """A share of the held force c₁ e₁ + c₂ e₂ + c₃ e₁ × e₂ of a family of triangles, as its sides lie now."""
    x0, x1, x2 = x[0, begin:end], x[1, begin:end], x[2, begin:end]
    p, q = begin + second, end + second
    y0, y1, y2 = x[0, p:q], x[1, p:q], x[2, p:q]
    p, q = begin + third, end + third
    z0, z1, z2 = x[0, p:q], x[1, p:q], x[2, p:q]
    h0, h1, h2 = held[0, begin:end], held[1, begin:end], held[2, begin:end]
    f0, f1, f2 = push[0, begin:end], push[1, begin:end], push[2, begin:end]
    for i in range(f0.size):
        a0, a1, a2 = y0[i] - x0[i], y1[i] - x1[i], y2[i] - x2[i]
        b0, b1, b2 = z0[i] - x0[i], z1[i] - x1[i], z2[i] - x2[i]
        g0, g1, g2 = share * h0[i], share * h1[i], share * h2[i]
        f0[i] = g0 * a0 + g1 * b0 + g2 * (a1 * b2 - a2 * b1)
        f1[i] = g0 * a1 + g1 * b1 + g2 * (a2 * b0 - a0 * b2)
        f2[i] = g0 * a2 + g1 * b2 + g2 * (a0 * b1 - a1 * b0)


@numba.njit(cache=True, error_model="numpy")
def _add_push(push: Floats, second: int, third: int, begin: int, end: int, force: Floats) -> None:
    """Add one component (p,) of the push of a family of triangles to their three corners."""
    a, b, c = push[begin:end], push[begin - second : end - second], push[begin - third : end - third]
    out = force[begin:end]
    for i in range(out.size):
        out[i] += a[i] + b[i] + c[i]


@numba.njit(cache=True, error_model="numpy")
def _add_row(push: Floats, row: Floats) -> None:
    """Add to a row (w,), place by place, all rows of a component of the push: no addition waits for the one before."""
    for start in range(0, push.size - row.size + 1, row.size):
        line = push[start : start + row.size]
        for j in range(row.size):
            row[j] += line[j]


@numba.njit(cache=True, error_model="numpy")
def push(stencil: Stencil, work: StencilWork, gain: float, total: Floats) -> None:
    """Add the held force of the light at ramp `gain` to work.force, and write its sum (3,) in N."""
    begin, end = stencil.begin, stencil.end
    for f in range(stencil.corners.shape[0]):
        second, third = stencil.corners[f, 0], stencil.corners[f, 1]
        _turn(work.x, work.held[f], second, third, gain / 3.0, begin, end, work.push[f])
        for c in range(3):
            _add_push(work.push[f, c], second, third, begin, end, work.force[c])
    for c in range(3):
        for j in range(work.row.size):
            work.row[j] = 0.0
        for f in range(stencil.corners.shape[0]):
            _add_row(work.push[f, c, begin:end], work.row)
        total[c] = 0.0
        for j in range(work.row.size):
            total[c] += 3.0 * work.row[j]
