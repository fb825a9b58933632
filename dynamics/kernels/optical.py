"""Force and heat of the light on the triangles, from pressure tables or constant reflectance.

Light travels along +z. For a triangle of current area A with unit vectors g, r, n:

    F = (I/c) A |w| (q_g g + q_r r + q_n n),  heat = a I A |w|,  u = k·g, v = k·r, w = k·n = n_z.

Between two updates the force is held in the frame of the triangle itself, as the coefficients of F along its two sides
and their cross product: F = c₁ e₁ + c₂ e₂ + c₃ e₁ × e₂. It then turns and stretches with the triangle; a force held in
the lab frame would lag behind the rotation and brake the spin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dynamics.kernels.beam import LIGHT_SPEED, intensity
from dynamics.kernels.elastic import Floats, Indices
from optics.table import TableArrays, lookup_many

Integers = NDArray[np.int64]


class Tables(NamedTuple):
    """Pressure tables one after the other, so that compiled code is the same for any number of them.

    numbers, places: as in `TableArrays`, concatenated. starts (k + 1, 2): where each table begins in them. axisymmetric
    (k,); nearest: for all of them.
    """

    numbers: Floats
    places: Integers
    starts: Integers
    axisymmetric: NDArray[np.bool_]
    nearest: bool


class Light(NamedTuple):
    """Beam and optical response of the triangles.

    corners (3, t): node indices. cos_across, sin_across (t,): g against the first side. rest_g (2, t): g of the rest
    layout. absorptance, reflectance (t,): of the material and of sectors without a table; absorptance −1 takes the
    table's. ranges (s, 3): table (or −1), first and end triangle of each
    sector. intensity, radius, delay, rise, on: the beam, in SI. yaw_blind: incidence from the lab tilt alone. clamp:
    count directions outside their table instead of stopping, unless the light comes from behind.
    """

    corners: Indices
    cos_across: Floats
    sin_across: Floats
    rest_g: Floats
    absorptance: Floats
    reflectance: Floats
    tables: Tables
    ranges: Integers
    intensity: float
    radius: float
    delay: float
    rise: float
    on: float
    yaw_blind: bool
    clamp: bool


class LightWork(NamedTuple):
    """Work space: frame (10, t), response q (t, 4), held coefficients (3, t), force (3, t + 1), last column 0.

    incident, absorbed (t + 1,): power in W on and into each triangle at full ramp, last 0. outside: [how many
    directions lay outside their table, first such triangle, 1 if it is lit from behind, which ends a run even where
    directions are clamped], direction: its u, v. total (3,): force in N. absorptance (t,): as it is now.
    """

    frame: Floats
    q: Floats
    held: Floats
    force: Floats
    incident: Floats
    absorbed: Floats
    outside: Integers
    direction: Floats
    total: Floats
    absorptance: Floats


@numba.njit(cache=True, error_model="numpy")
def _frames(e: Floats, frame: Floats) -> None:
    """Frame (10, t): n (3), double area, 1/|e₁|, e₂·ê₁, and z components of ê₁ and n × ê₁ of triangles with sides e."""
    a0, a1, a2, b0, b1, b2 = e[0], e[1], e[2], e[3], e[4], e[5]
    n0, n1, n2, double, inverse, lean, first_z, aside_z = (
        frame[0], frame[1], frame[2], frame[3], frame[4], frame[5], frame[6], frame[7],
    )
    for i in range(a0.size):
        c0 = a1[i] * b2[i] - a2[i] * b1[i]
        c1 = a2[i] * b0[i] - a0[i] * b2[i]
        c2 = a0[i] * b1[i] - a1[i] * b0[i]
        size = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
        length = 1.0 / math.sqrt(a0[i] * a0[i] + a1[i] * a1[i] + a2[i] * a2[i])
        n0[i] = c0 / size
        n1[i] = c1 / size
        n2[i] = c2 / size
        double[i] = size
        inverse[i] = length
        lean[i] = (a0[i] * b0[i] + a1[i] * b1[i] + a2[i] * b2[i]) * length
        first_z[i] = a2[i] * length
        aside_z[i] = (c0 * a1[i] - c1 * a0[i]) * length / size


@numba.njit(cache=True, error_model="numpy")
def _sail_frame(light: Light, frame: Floats) -> None:
    """U = k·g, v = k·r of each triangle's own frame into frame[8:10]."""
    first_z, aside_z, u, v = frame[6], frame[7], frame[8], frame[9]
    cos, sin = light.cos_across, light.sin_across
    for i in range(cos.size):
        u[i] = first_z[i] * cos[i] + aside_z[i] * sin[i]
        v[i] = aside_z[i] * cos[i] - first_z[i] * sin[i]


@numba.njit(cache=True, error_model="numpy")
def _yaw_blind(light: Light, frame: Floats) -> None:
    """u, v from the lab-frame pitch and roll of the normal and g of the rest layout (Gao et al.'s runs), frame[8:10].

    With sin θ = n_x and tan φ = −n_y/n_z the light's direction is (−sin θ cos φ, sin φ, cos θ cos φ).
    """
    n0, n1, n2, u, v = frame[0], frame[1], frame[2], frame[8], frame[9]
    g0, g1 = light.rest_g[0], light.rest_g[1]
    for i in range(n0.size):
        hypotenuse = math.sqrt(n1[i] * n1[i] + n2[i] * n2[i])
        k0 = -n0[i] * n2[i] / hypotenuse
        k1 = -n1[i] / hypotenuse
        u[i] = k0 * g0[i] + k1 * g1[i]
        v[i] = k1 * g0[i] - k0 * g1[i]


@numba.njit(cache=True, error_model="numpy")
def _constant(light: Light, frame: Floats, absorptance: Floats, q: Floats, begin: int, end: int) -> None:
    """Response q (t, 4) of triangles begin … end with constant reflectance: F = (P/c)(2R (k·n) n + a k)."""
    for i in range(begin, end):
        first_z, aside_z, w = frame[6, i], frame[7, i], frame[2, i]
        cos, sin, a = light.cos_across[i], light.sin_across[i], absorptance[i]
        q[i, 0] = a * (first_z * cos + aside_z * sin)
        q[i, 1] = a * (aside_z * cos - first_z * sin)
        q[i, 2] = (2.0 * light.reflectance[i] + a) * w
        q[i, 3] = a


@numba.njit(cache=True, error_model="numpy")
def _note_outside(work: LightWork, count: int, triangle: int, behind: bool) -> None:
    """Count directions outside their table and keep the first such triangle; one lit from behind takes its place."""
    if count > 0 and (work.outside[0] == 0 or (behind and work.outside[2] == 0)):
        work.outside[1] = triangle
        work.direction[0] = work.frame[8, triangle]
        work.direction[1] = work.frame[9, triangle]
    if count > 0 and behind:
        work.outside[2] = 1
    work.outside[0] += count


@numba.njit(cache=True, error_model="numpy")
def _turn_over(work: LightWork, begin: int, end: int) -> None:
    """A film is the same from behind: the force across it points the other way."""
    for i in range(begin, end):
        if work.frame[2, i] < 0.0:
            work.q[i, 2] = -work.q[i, 2]


@numba.njit(cache=True, error_model="numpy")
def table(tables: Tables, k: int) -> TableArrays:
    """Table k of the concatenation."""
    a, b = tables.starts[k], tables.starts[k + 1]
    return TableArrays(
        tables.numbers[a[0] : b[0]], tables.places[a[1] : b[1]], tables.axisymmetric[k], tables.nearest,
    )


@numba.njit(cache=True, error_model="numpy")
def _count_behind(work: LightWork, begin: int, end: int) -> tuple[int, int]:
    """How many triangles of a grating are lit from behind, for which its table holds no answer, and the first."""
    count, first = 0, -1
    for i in range(begin, end):
        if not work.frame[2, i] > 0.0:
            count += 1
            first = i if first < 0 else first
    return count, first


@numba.njit(cache=True, error_model="numpy")
def respond(light: Light, work: LightWork, x: Floats, first: int, last: int, found: Integers) -> None:
    """Response work.q (t, 4) (q_g, q_r, q_n, absorptance) and incident power of the triangles first … last.

    found (s, 4): for each region how many of them lie outside their table and the first, how many are lit from behind
    and the first.
    """
    u, v = work.frame[8], work.frame[9]
    for s in range(light.ranges.shape[0]):
        k, begin, end = light.ranges[s, 0], max(light.ranges[s, 1], first), min(light.ranges[s, 2], last)
        found[s, 0], found[s, 2] = 0, 0
        if begin < end and k < 0:
            _constant(light, work.frame, work.absorptance, work.q, begin, end)
        elif begin < end:
            count, place = lookup_many(table(light.tables, k), u[begin:end], v[begin:end], work.q[begin:end])
            found[s, 0], found[s, 1] = count, begin + place
            if light.tables.axisymmetric[k]:
                _turn_over(work, begin, end)
            else:
                found[s, 2], found[s, 3] = _count_behind(work, begin, end)
    _shine(light, x, work.frame, work.incident, first, last)


@numba.njit(cache=True, error_model="numpy")
def note(light: Light, work: LightWork, found: Integers) -> None:
    """Note what `respond` found (threads, s, 4), as if one thread had."""
    for s in range(light.ranges.shape[0]):
        for thread in range(found.shape[0]):
            _note_outside(work, found[thread, s, 0], found[thread, s, 1], False)
        for thread in range(found.shape[0]):
            _note_outside(work, found[thread, s, 2], found[thread, s, 3], True)


@numba.njit(cache=True, error_model="numpy")
def _shine(light: Light, x: Floats, frame: Floats, incident: Floats, begin: int, end: int) -> None:
    """Power I A |w| in W on each triangle at full ramp, with the intensity at its centroid."""
    x0, x1 = x[0], x[1]
    c0, c1, c2 = light.corners[0], light.corners[1], light.corners[2]
    w, double = frame[2], frame[3]
    for i in range(begin, end):
        p, q, s = c0[i], c1[i], c2[i]
        cx = (x0[p] + x0[q] + x0[s]) / 3.0
        cy = (x1[p] + x1[q] + x1[s]) / 3.0
        incident[i] = intensity(cx, cy, light.intensity, light.radius) * 0.5 * double[i] * abs(w[i])


@numba.njit(cache=True, error_model="numpy")
def finish(light: Light, work: LightWork) -> None:
    """Coefficients of F = (P/c)(q_g g + q_r r + q_n n) along e₁, e₂ and e₁ × e₂, and the absorbed power."""
    h0, h1, h2 = work.held[0], work.held[1], work.held[2]
    double, inverse, lean = work.frame[3], work.frame[4], work.frame[5]
    q, material = work.q, work.absorptance
    for i in range(double.size):
        cos, sin = light.cos_across[i], light.sin_across[i]
        power = work.incident[i]
        scale = power / LIGHT_SPEED
        along = scale * (q[i, 0] * cos - q[i, 1] * sin)
        aside = scale * (q[i, 0] * sin + q[i, 1] * cos)
        second = aside / (double[i] * inverse[i])
        h0[i] = (along - second * lean[i]) * inverse[i]
        h1[i] = second
        h2[i] = scale * q[i, 2] / double[i]
        work.absorbed[i] = power * (material[i] if material[i] >= 0.0 else q[i, 3])


@numba.njit(cache=True, error_model="numpy")
def prepare(light: Light, work: LightWork, sides: Floats) -> None:
    """Frames of triangles with sides (6, t), and the directions of the light in them."""
    _frames(sides, work.frame)
    if light.yaw_blind:
        _yaw_blind(light, work.frame)
    else:
        _sail_frame(light, work.frame)


@numba.njit(cache=True, error_model="numpy")
def turn(work: LightWork, e: Floats, gain: float) -> None:
    """Write a third of the held force at ramp `gain`, turned with sides e (6, t), to work.force."""
    held, force = work.held, work.force
    a0, a1, a2, b0, b1, b2 = e[0], e[1], e[2], e[3], e[4], e[5]
    h0, h1, h2 = held[0], held[1], held[2]
    f0, f1, f2 = force[0], force[1], force[2]
    third = gain / 3.0
    for i in range(a0.size):
        p, q, s = h0[i] * third, h1[i] * third, h2[i] * third
        f0[i] = p * a0[i] + q * b0[i] + s * (a1[i] * b2[i] - a2[i] * b1[i])
        f1[i] = p * a1[i] + q * b1[i] + s * (a2[i] * b0[i] - a0[i] * b2[i])
        f2[i] = p * a2[i] + q * b2[i] + s * (a0[i] * b1[i] - a1[i] * b0[i])
