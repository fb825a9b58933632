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

from beamrider.arrays import Floats, Indices, Integers
from dynamics.light.aim import Wander
from dynamics.light.compiled import Profile, shine
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.layout import rows as stencil
from dynamics.membrane.layout.elements import turned
from dynamics.membrane.layout.rows import Stencil
from dynamics.membrane.layout.triangles import Patch, sides
from optics.table.pressure_table import TableArrays, lookup_many

#: Rows of what is found about directions: outside their table, or of light from behind.
OUTSIDE, BEHIND = range(2)


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
    layout. absorptance, reflectance (t,): of the material and of sectors without a table; absorptance −f takes f
    times the table's. ranges (s, 3): table (or −1), first and end triangle of each sector. intensity, delay, rise, on:
    the beam, in SI; profile: across it, packed for thirds of a metre; wander: of its axis and power. yaw_blind:
    incidence from the lab tilt alone. clamp: count directions outside their table instead of stopping, unless the light
    comes from behind.
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
    profile: Profile
    wander: Wander
    delay: float
    rise: float
    on: float
    yaw_blind: bool
    clamp: bool


class LightWork(NamedTuple):
    """What is held, and what is known of it.

    incident, absorbed (t,): power in W on and into each triangle at full ramp. outside: [how many directions lay
    outside their table, first such triangle, 1 if it is lit from behind, which ends a run even where directions are
    clamped], direction: its u, v. total (3,): force in N. absorptance (t,): as it is now.
    """

    incident: Floats
    absorbed: Floats
    outside: Integers
    direction: Floats
    total: Floats
    absorptance: Floats


@numba.njit(cache=True, error_model="numpy")
def _frames(patch: Patch, at: int, n: int) -> None:
    """First eight rows of the frame of n triangles from place `at` of the patch on."""
    e, frame, end = patch.sides, patch.frame, at + n
    a0, a1, a2, b0, b1, b2 = (
        e[0, at:end], e[1, at:end], e[2, at:end], e[3, at:end], e[4, at:end], e[5, at:end],
    )
    n0, n1, n2, double = frame[0, at:end], frame[1, at:end], frame[2, at:end], frame[3, at:end]
    inverse, lean, first_z, aside_z = frame[4, at:end], frame[5, at:end], frame[6, at:end], frame[7, at:end]
    for i in range(n):
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
def _sail_frame(light: Light, patch: Patch, begin: int, at: int, n: int) -> None:
    """U = k·g, v = k·r in each triangle's own frame, of n triangles from `begin` on."""
    frame, end = patch.frame, at + n
    first_z, aside_z, u, v = frame[6, at:end], frame[7, at:end], frame[8, at:end], frame[9, at:end]
    cos, sin = light.cos_across[begin : begin + n], light.sin_across[begin : begin + n]
    for i in range(n):
        u[i] = first_z[i] * cos[i] + aside_z[i] * sin[i]
        v[i] = aside_z[i] * cos[i] - first_z[i] * sin[i]


@numba.njit(cache=True, error_model="numpy")
def _yaw_blind(light: Light, patch: Patch, begin: int, at: int, n: int) -> None:
    """u, v from the lab-frame pitch and roll of the normal and g of the rest layout (Gao et al.'s runs).

    With sin θ = n_x and tan φ = −n_y/n_z the light's direction is (−sin θ cos φ, sin φ, cos θ cos φ).
    """
    frame, end = patch.frame, at + n
    n0, n1, n2, u, v = frame[0, at:end], frame[1, at:end], frame[2, at:end], frame[8, at:end], frame[9, at:end]
    g0, g1 = light.rest_g[0, begin : begin + n], light.rest_g[1, begin : begin + n]
    for i in range(n):
        hypotenuse = math.sqrt(n1[i] * n1[i] + n2[i] * n2[i])
        k0 = -n0[i] * n2[i] / hypotenuse
        k1 = -n1[i] / hypotenuse
        u[i] = k0 * g0[i] + k1 * g1[i]
        v[i] = k1 * g0[i] - k0 * g1[i]


@numba.njit(cache=True, error_model="numpy")
def _constant(light: Light, patch: Patch, absorptance: Floats, begin: int, at: int, n: int) -> None:
    """Response of n triangles from `begin` on with constant reflectance: F = (P/c)(2R (k·n) n + a k)."""
    for i in range(n):
        k, j = begin + i, at + i
        first_z, aside_z, w = patch.frame[6, j], patch.frame[7, j], patch.frame[2, j]
        cos, sin, a = light.cos_across[k], light.sin_across[k], absorptance[k]
        patch.response[j, 0] = a * (first_z * cos + aside_z * sin)
        patch.response[j, 1] = a * (aside_z * cos - first_z * sin)
        patch.response[j, 2] = (2.0 * light.reflectance[k] + a) * w
        patch.response[j, 3] = a


@numba.njit(cache=True, error_model="numpy")
def _turn_over(patch: Patch, at: int, n: int) -> None:
    """A film is the same from behind: the force across it points the other way."""
    for j in range(at, at + n):
        if patch.frame[2, j] < 0.0:
            patch.response[j, 2] = -patch.response[j, 2]


@numba.njit(cache=True, error_model="numpy")
def _count_behind(patch: Patch, at: int, n: int) -> tuple[int, int]:
    """How many triangles of a grating are lit from behind, for which its table holds no answer, and the first."""
    count, first = 0, -1
    for i in range(n):
        if not patch.frame[2, at + i] > 0.0:
            count += 1
            first = i if first < 0 else first
    return count, first


@numba.njit(cache=True, error_model="numpy")
def table(tables: Tables, k: int) -> TableArrays:
    """Table k of the concatenation."""
    a, b = tables.starts[k], tables.starts[k + 1]
    return TableArrays(
        tables.numbers[a[0] : b[0]], tables.places[a[1] : b[1]], tables.axisymmetric[k], tables.nearest,
    )


@numba.njit(cache=True, error_model="numpy")
def _spot(found: Integers, seen: Floats, count: int, triangle: int, patch: Patch, place: int) -> None:
    """Add triangles to found (2,), how many and the first, of which seen (2,) keeps the direction."""
    if count > 0 and found[0] == 0:
        found[1] = triangle
        seen[0], seen[1] = patch.frame[8, place], patch.frame[9, place]
    found[0] += count


@numba.njit(cache=True, error_model="numpy")
def _face(gone: Integers, patch: Patch, begin: int, at: int, n: int) -> None:
    """Let triangles that are gone face the light: wherever their nodes fly, none of them leaves its table."""
    for i in range(n if gone.size > 0 else 0):
        if gone[begin + i] != 0:
            patch.frame[2, at + i], patch.frame[8, at + i], patch.frame[9, at + i] = 1.0, 0.0, 0.0


@numba.njit(cache=True, error_model="numpy")
def _look_up(
    light: Light, patch: Patch, k: int, begin: int, at: int, n: int, found: Integers, seen: Floats
) -> None:
    """Response of n triangles from `begin` on, those of table k."""
    end = at + n
    count, place = lookup_many(
        table(light.tables, k), patch.frame[8, at:end], patch.frame[9, at:end], patch.response[at:end]
    )
    _spot(found[OUTSIDE], seen[OUTSIDE], count, begin + place, patch, at + place)
    if light.tables.axisymmetric[k]:
        _turn_over(patch, at, n)
    else:
        count, place = _count_behind(patch, at, n)
        _spot(found[BEHIND], seen[BEHIND], count, begin + place, patch, at + place)


@numba.njit(cache=True, error_model="numpy")
def _shine(light: Light, x: Floats, patch: Patch, incident: Floats, begin: int, at: int, n: int) -> None:
    """Power I A |w| in W on each triangle at full ramp, with the intensity at its centroid; u, v are not kept."""
    x0, x1 = x[0], x[1]
    c0, c1, c2 = light.corners[0], light.corners[1], light.corners[2]
    a, b = patch.frame[8], patch.frame[9]
    for i in range(n):
        p, q, s = c0[begin + i], c1[begin + i], c2[begin + i]
        a[at + i], b[at + i] = x0[p] + x0[q] + x0[s], x1[p] + x1[q] + x1[s]
    shine(light.profile, a, b, at, n, incident, begin)
    out, w, double = incident[begin : begin + n], patch.frame[2, at : at + n], patch.frame[3, at : at + n]
    for i in range(n):
        out[i] = light.intensity * out[i] * 0.5 * double[i] * abs(w[i])


@numba.njit(cache=True, error_model="numpy")
def _hold(light: Light, work: LightWork, patch: Patch, begin: int, at: int, n: int) -> None:
    """Coefficients of F = (P/c)(q_g g + q_r r + q_n n) along e₁, e₂ and e₁ × e₂, and the absorbed power."""
    q, frame = patch.response, patch.frame
    for i in range(n):
        k, j = begin + i, at + i
        cos, sin, power = light.cos_across[k], light.sin_across[k], work.incident[k]
        scale, double, inverse = power / LIGHT_SPEED, frame[3, j], frame[4, j]
        along = scale * (q[j, 0] * cos - q[j, 1] * sin)
        aside = scale * (q[j, 0] * sin + q[j, 1] * cos)
        second = aside / (double * inverse)
        share = work.absorptance[k]
        work.absorbed[k] = power * (share if share >= 0.0 else -share * q[j, 3])
        patch.response[j, 0] = (along - second * frame[5, j]) * inverse
        patch.response[j, 1] = second
        patch.response[j, 2] = scale * q[j, 2] / double


@numba.njit(cache=True, error_model="numpy")
def respond(
    light: Light, work: LightWork, patch: Patch, layout: Stencil, x: Floats, gone: Integers, first: int, last: int,
    found: Integers, seen: Floats, held: Floats,
) -> None:
    """Light on the triangles first … last at nodes x (3, n): power, and coefficients into held (f, 3, p).

    gone (t,): not 0 for removed triangles, which get light all the same (see `tearing.darken`), or empty.
    found (2, 2): how many of them lie outside their table and the first; how many are lit from behind and the first.
    seen (2, 2): the direction of these two. A patch for all triangles keeps each of them at its own place.
    """
    most, whole = patch.response.shape[0], patch.response.shape[0] == light.corners.shape[1]
    found[:, 0] = 0
    for s in range(light.ranges.shape[0]):
        k, begin, end = light.ranges[s, 0], max(light.ranges[s, 1], first), min(light.ranges[s, 2], last)
        while begin < end:
            n, at = min(most, end - begin), begin if whole else 0
            sides(x, light.corners, begin, n, at, patch.sides)
            _frames(patch, at, n)
            if light.yaw_blind:
                _yaw_blind(light, patch, begin, at, n)
            else:
                _sail_frame(light, patch, begin, at, n)
            _face(gone, patch, begin, at, n)
            if k < 0:
                _constant(light, patch, work.absorptance, begin, at, n)
            else:
                _look_up(light, patch, k, begin, at, n, found, seen)
            _shine(light, x, patch, work.incident, begin, at, n)
            _hold(light, work, patch, begin, at, n)
            stencil.hold(layout, patch.response, begin, at, n, held)
            begin += n


@numba.njit(cache=True, error_model="numpy")
def note(work: LightWork, found: Integers, seen: Floats) -> None:
    """Note what `respond` found, (threads, 2, 2) each, as if one thread had."""
    for kind in range(2):
        for thread in range(found.shape[0]):
            count, behind = found[thread, kind, 0], kind == BEHIND
            if count > 0 and (work.outside[0] == 0 or (behind and work.outside[2] == 0)):
                work.outside[1] = found[thread, kind, 1]
                work.direction[0], work.direction[1] = seen[thread, kind, 0], seen[thread, kind, 1]
            if count > 0 and behind:
                work.outside[2] = 1
            work.outside[0] += count


@numba.njit(cache=True, inline="always")
def force(light: Light, layout: Stencil, held: Floats, x: Floats, i: int) -> tuple[float, float, float]:
    """Held force in N at full ramp on triangle i of nodes x (3, n), turned with its sides."""
    turn, size = layout.turns[i], layout.per_mass.size
    k, f = layout.cells[i] % size, layout.cells[i] // size
    p, q, s = light.corners[turn, i], light.corners[(turn + 1) % 3, i], light.corners[(turn + 2) % 3, i]
    return turned(
        held[f, 0, k], held[f, 1, k], held[f, 2, k], x[0, q] - x[0, p], x[1, q] - x[1, p], x[2, q] - x[2, p],
        x[0, s] - x[0, p], x[1, s] - x[1, p], x[2, s] - x[2, p],
    )
