"""What the elements on one row of a family do, and its nodes: loops that the compiler turns into vector code.

Arrays over places are read from place o on, `ahead` and `beyond` of it for the other corners; what is written lies on
one row of the work space, behind its guard.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from beamrider.arrays import Floats
from beamrider.machine_code.streams import streams

#: Numbers in front of those of each row in the work space, which stay 0; rows begin at multiples of it.
GUARD = np.uint64(8)

#: Three components of vectors, or one number for each side of triangles: rows of an array, side by side.
Three = tuple[Floats, Floats, Floats]


@numba.njit(cache=True, inline="always")
def apart(rows: Floats) -> Three:
    """The rows of an array (3, n)."""
    return rows[0], rows[1], rows[2]


@numba.njit(cache=True, inline="always")
def turned(
    g0: float, g1: float, g2: float, a0: float, a1: float, a2: float, b0: float, b1: float, b2: float
) -> tuple[float, float, float]:
    """The held force g₀ a + g₁ b + g₂ a × b of a triangle with sides a and b from its first corner, as they lie now."""
    return (
        g0 * a0 + g1 * b0 + g2 * (a1 * b2 - a2 * b1),
        g0 * a1 + g1 * b1 + g2 * (a2 * b0 - a0 * b2),
        g0 * a2 + g1 * b2 + g2 * (a0 * b1 - a1 * b0),
    )


@streams()
def strain(
    lit: bool,
    o: int,
    n: int,
    ahead: int,
    beyond: int,
    x: Three,
    free: Three,
    scale: Three,
    shear: Floats,
    bound: Floats,
    share: float,
    held: Three,
    one: Three,
    two: Three,
    three: Three,
    sums: Three,
) -> int:
    """Forces on the three corners of triangles o … o + n, as in `sheet`; how many may have failed.

    x: nodes; free, scale, shear, bound, held: as in `StencilWork`; one, two, three (w,): forces on each corner. lit:
    with a share of the light's force on each of them, which is also added to sums (w,).
    """
    x0, x1, x2 = x
    f0, f1, f2 = free
    k0, k1, k2 = scale
    h0, h1, h2 = held
    a0, a1, a2 = one
    b0, b1, b2 = two
    c0, c1, c2 = three
    sum0, sum1, sum2 = sums
    bad = 0
    for i in range(n):
        j, first, second, third = i + GUARD, o + i, o + i + ahead, o + i + beyond
        p0, p1, p2 = x0[second] - x0[first], x1[second] - x1[first], x2[second] - x2[first]
        q0, q1, q2 = x0[third] - x0[second], x1[third] - x1[second], x2[third] - x2[second]
        r0, r1, r2 = x0[third] - x0[first], x1[third] - x1[first], x2[third] - x2[first]
        d0 = p0 * p0 + p1 * p1 + p2 * p2 - f0[first]
        d1 = q0 * q0 + q1 * q1 + q2 * q2 - f1[first]
        d2 = r0 * r0 + r1 * r1 + r2 * r2 - f2[first]
        trace = k0[first] * d0 + k1[first] * d1 + k2[first] * d2
        half = 0.5 * (d0 + d1 + d2)
        t0 = k0[first] * trace - shear[first] * (half - d0)
        t1 = k1[first] * trace - shear[first] * (half - d1)
        t2 = k2[first] * trace - shear[first] * (half - d2)
        bad += 0 if t0 * d0 + t1 * d1 + t2 * d2 <= bound[first] else 1
        m0, m1, m2 = 0.0, 0.0, 0.0
        if lit:
            m0, m1, m2 = turned(share * h0[first], share * h1[first], share * h2[first], p0, p1, p2, r0, r1, r2)
            sum0[j], sum1[j], sum2[j] = sum0[j] + m0, sum1[j] + m1, sum2[j] + m2
        p0, p1, p2 = t0 * p0, t0 * p1, t0 * p2
        q0, q1, q2 = t1 * q0, t1 * q1, t1 * q2
        r0, r1, r2 = t2 * r0, t2 * r1, t2 * r2
        a0[j], a1[j], a2[j] = p0 + r0, p1 + r1, p2 + r2
        b0[j], b1[j], b2[j] = q0 - p0, q1 - p1, q2 - p2
        c0[j], c1[j], c2[j] = -r0 - q0, -r1 - q1, -r2 - q2
        if lit:
            a0[j], a1[j], a2[j] = a0[j] + m0, a1[j] + m1, a2[j] + m2
            b0[j], b1[j], b2[j] = b0[j] + m0, b1[j] + m1, b2[j] + m2
            c0[j], c1[j], c2[j] = c0[j] + m0, c1[j] + m1, c2[j] + m2
    return bad


@streams()
def push(o: int, n: int, ahead: int, beyond: int, x: Three, share: float, held: Three, out: Three, sums: Three) -> None:
    """A share of the light's force on each corner of triangles o … o + n, to out (w,), also added to sums (w,)."""
    x0, x1, x2 = x
    h0, h1, h2 = held
    a0, a1, a2 = out
    sum0, sum1, sum2 = sums
    for i in range(n):
        j, first, second, third = i + GUARD, o + i, o + i + ahead, o + i + beyond
        m0, m1, m2 = turned(
            share * h0[first],
            share * h1[first],
            share * h2[first],
            x0[second] - x0[first],
            x1[second] - x1[first],
            x2[second] - x2[first],
            x0[third] - x0[first],
            x1[third] - x1[first],
            x2[third] - x2[first],
        )
        a0[j], a1[j], a2[j] = m0, m1, m2
        sum0[j], sum1[j], sum2[j] = sum0[j] + m0, sum1[j] + m1, sum2[j] + m2


@streams()
def stretch(o: int, n: int, ahead: int, x: Three, stiffness: Floats, free: Floats, stretch: Floats, out: Three) -> int:
    """Force k (ℓ − L) d/ℓ (n,) of springs from o on, on their first end; how many are too long, or not finite."""
    x0, x1, x2 = x
    a0, a1, a2 = out
    bad = 0
    for i in range(n):
        j, first, second = i + GUARD, o + i, o + i + ahead
        d0, d1, d2 = x0[second] - x0[first], x1[second] - x1[first], x2[second] - x2[first]
        length = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        bad += 0 if length <= free[first] * stretch[first] else 1
        tension = stiffness[first] * (1.0 - free[first] / length)
        a0[j], a1[j], a2[j] = tension * d0, tension * d1, tension * d2
    return bad


@streams()
def put_corners(n: int, i: int, a: Floats, j: int, b: Floats, k: int, c: Floats, out: Floats) -> None:
    """One component of the forces (n,) of a family on its three corners."""
    for m in range(n):
        out[m] = a[i + m] + b[j + m] + c[k + m]


@streams()
def add_corners(n: int, i: int, a: Floats, j: int, b: Floats, k: int, c: Floats, out: Floats) -> None:
    """Add the same of one more family: values (m,) each, from place i, j, k on."""
    for m in range(n):
        out[m] += a[i + m] + b[j + m] + c[k + m]


@streams()
def add_ends(n: int, a: Floats, j: int, b: Floats, out: Floats) -> None:
    """Add one component of the forces (n,) of a family of springs on their two ends."""
    for m in range(n):
        out[m] += a[m + GUARD] - b[j + m]


@streams()
def advance(
    o: int,
    n: int,
    force: Floats,
    per_mass: Floats,
    close: float,
    start: float,
    dt: float,
    v: Floats,
    x: Floats,
    new_v: Floats,
    new_x: Floats,
) -> None:
    """One component of a step, from forces (n,): see `StepTimes`."""
    for m in range(n):
        i = o + m
        acceleration = force[m] * per_mass[i]
        new_v[i] = (v[i] + close * acceleration) + start * acceleration
        new_x[i] = x[i] + dt * new_v[i]


@streams()
def accelerate(o: int, n: int, force: Floats, per_mass: Floats, out: Floats) -> None:
    """One component of the accelerations, from forces (n,)."""
    for m in range(n):
        out[o + m] = force[m] * per_mass[o + m]


@streams()
def add_lanes(n: int, values: Floats, lanes: Floats) -> None:
    """Sums (8,) of every eighth of the values (n,) behind the guard: a vector of them at a time."""
    for k in range(8):
        lanes[k] = 0.0
    for m in range(n // 8):
        for k in range(8):
            lanes[k] += values[8 * m + k + GUARD]
