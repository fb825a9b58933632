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

from beamrider.arrays import Floats, Indices, Integers
from beamrider.machine_code.standalone import standalone
from beamrider.machine_code.streams import streams
from dynamics.light.aim import Wander
from dynamics.light.compiled import Profile, shine
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.light.spots import pack
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, only_if, own, starts, unsigned
from dynamics.membrane.effects.tables import Tables, concatenated, table
from dynamics.membrane.lattice import per_triangle
from dynamics.membrane.layout import rows
from dynamics.membrane.layout.elements import turned
from dynamics.membrane.layout.rows import Stencil
from dynamics.membrane.layout.triangles import Patch, sides, total
from dynamics.membrane.state import State
from dynamics.sail.mesh import Mesh
from dynamics.sail.regions import directions
from dynamics.scene.schema import Scene
from optics.table.pressure_table import lookup_many

NAME = "light"
COST = "a pass over all triangles every flight.optics_every steps, and a force on each triangle in every step"
#: Force and torque, about the centre of mass, are those of the held light.
COLUMNS = {
    "power_incident": (1, "W"),
    "power_absorbed": (1, "W"),
    "force": (3, "N"),
    "torque": (3, "N m"),
    "outside_table": (1, "1"),
}
_INCIDENT, _ABSORBED, _FORCE, _TORQUE, _OUTSIDE = starts(COLUMNS)


def _light(scene: Scene, so_far: Plan) -> Decision:
    return Decision(on=scene.beam.intensity_W_m2 > 0, reason=f"intensity {scene.beam.intensity_W_m2:g} W/m²")


PLAN = {"light": _light}

#: Rows of what is found about directions: outside their table, or of light from behind.
OUTSIDE, BEHIND = range(2)


class LightPressure(NamedTuple):
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


class HeldLight(NamedTuple):
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


def _ranges(scene: Scene, mesh: Mesh) -> Integers:
    """Table (−1: constant reflectance), first and end triangle of each region (s, 3)."""
    designs, regions = scene.sail.designs, scene.sail.regions
    ends = np.searchsorted(mesh.sector, np.arange(len(regions) + 1))
    which = [designs.index(r.design) if r.design else -1 for r in regions]
    return np.stack([which, ends[:-1], ends[1:]], axis=1)


def build(setup: Setup) -> LightPressure:
    """Beam and response of the triangles; no triangles where it is off."""
    scene, mesh = setup.scene, setup.mesh
    on = setup.on("light")
    regions, nearest = scene.sail.regions, scene.lookup == "nearest"
    absorptance = per_triangle(scene.sail, mesh, "absorptance")
    absorptance = np.where(np.array([scene.tabled(r) for r in regions])[mesh.sector], -1.0, absorptance)
    g = directions(mesh.nodes[mesh.triangles].mean(axis=1), mesh.sector, scene.sail).T[:2]
    return LightPressure(
        corners=unsigned(mesh.triangles.T) if on else np.empty((3, 0), np.uint32),
        cos_across=only_if(on, mesh.cos_across),
        sin_across=only_if(on, mesh.sin_across),
        rest_g=np.array(g if scene.incidence == "yaw_blind" else g[:, :0], order="C"),
        absorptance=only_if(on, absorptance),
        reflectance=only_if(on, np.array([r.reflectance or 0.0 for r in regions])[mesh.sector]),
        tables=concatenated(
            [setup.tables[design].arrays(nearest) for design in scene.sail.designs] if on else [], nearest
        ),
        ranges=_ranges(scene, mesh),
        intensity=scene.beam.intensity_W_m2,
        profile=pack(scene.beam.spots, 3.0),
        wander=scene.beam.wander,
        delay=scene.beam.delay_s,
        rise=scene.beam.rise_s,
        on=scene.beam.on_s,
        yaw_blind=scene.incidence == "yaw_blind",
        clamp=scene.outside_table == "clamp",
    )


def work(model: Model) -> HeldLight:
    """No light yet."""
    light = model.effects.light
    t, changes = light.absorptance.size, model.effects.properties.absorption.region.size > 0
    return HeldLight(
        incident=np.zeros(t),
        absorbed=np.zeros(t),
        outside=np.zeros(3, np.int64),
        direction=np.zeros(2),
        total=np.zeros(3),
        absorptance=own(light.absorptance, changes),
    )


@hook
def write(model: Model, work: WorkSpace, state: State, centre: Floats, row: Floats) -> None:
    """Incident and absorbed power, force and torque of the held light, all directions that lay outside so far."""
    if work.gain[0] > 0.0:
        size = model.effects.light.corners.shape[1]
        row[_INCIDENT] = work.gain[0] * total(work.effects.light.incident, size)
        row[_ABSORBED] = work.gain[0] * total(work.effects.light.absorbed, size)
        _add_forces(model.effects.light, model.stencil, work.stencil.held, state.x, work.gain[0], centre, row)
    row[_OUTSIDE] = work.effects.light.outside[0]


@numba.njit(cache=True, error_model="numpy")
def _frames(patch: Patch, at: int, n: int) -> None:
    """First eight rows of the frame of n triangles from place `at` of the patch on."""
    e, frame, end = patch.sides, patch.frame, at + n
    a0, a1, a2, b0, b1, b2 = (
        e[0, at:end],
        e[1, at:end],
        e[2, at:end],
        e[3, at:end],
        e[4, at:end],
        e[5, at:end],
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
def _sail_frame(light: LightPressure, patch: Patch, begin: int, at: int, n: int) -> None:
    """U = k·g, v = k·r in each triangle's own frame, of n triangles from `begin` on."""
    frame, end = patch.frame, at + n
    first_z, aside_z, u, v = frame[6, at:end], frame[7, at:end], frame[8, at:end], frame[9, at:end]
    cos, sin = light.cos_across[begin : begin + n], light.sin_across[begin : begin + n]
    for i in range(n):
        u[i] = first_z[i] * cos[i] + aside_z[i] * sin[i]
        v[i] = aside_z[i] * cos[i] - first_z[i] * sin[i]


@numba.njit(cache=True, error_model="numpy")
def _yaw_blind(light: LightPressure, patch: Patch, begin: int, at: int, n: int) -> None:
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
def _constant(light: LightPressure, patch: Patch, absorptance: Floats, begin: int, at: int, n: int) -> None:
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
    light: LightPressure, patch: Patch, k: int, begin: int, at: int, n: int, found: Integers, seen: Floats
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
def _shine(light: LightPressure, x: Floats, patch: Patch, incident: Floats, begin: int, at: int, n: int) -> None:
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
def _hold(light: LightPressure, work: HeldLight, patch: Patch, begin: int, at: int, n: int) -> None:
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


@standalone()
def respond(
    light: LightPressure,
    work: HeldLight,
    patch: Patch,
    layout: Stencil,
    x: Floats,
    gone: Integers,
    first: int,
    last: int,
    found: Integers,
    seen: Floats,
    held: Floats,
) -> None:
    """Light on the triangles first … last at nodes x (3, n): power, and coefficients into held (f, 3, p).

    gone (t,): not 0 for removed triangles, which get light all the same (see `tearing.remove_light`), or empty.
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
            rows.hold(layout, patch.response, begin, at, n, held)
            begin += n


@numba.njit(cache=True, error_model="numpy")
def note(work: HeldLight, found: Integers, seen: Floats) -> None:
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
def force(light: LightPressure, layout: Stencil, held: Floats, x: Floats, i: int) -> tuple[float, float, float]:
    """Held force in N at full ramp on triangle i of nodes x (3, n), turned with its sides."""
    turn, size = layout.turns[i], layout.per_mass.size
    k, f = layout.cells[i] % size, layout.cells[i] // size
    p, q, s = light.corners[turn, i], light.corners[(turn + 1) % 3, i], light.corners[(turn + 2) % 3, i]
    return turned(
        held[f, 0, k],
        held[f, 1, k],
        held[f, 2, k],
        x[0, q] - x[0, p],
        x[1, q] - x[1, p],
        x[2, q] - x[2, p],
        x[0, s] - x[0, p],
        x[1, s] - x[1, p],
        x[2, s] - x[2, p],
    )


@streams()
def _add_forces(
    light: LightPressure, layout: Stencil, held: Floats, x: Floats, gain: float, centre: Floats, row: Floats
) -> None:
    """Optical force in N and its torque about the centre (3,) of mass in N m, a third at each corner."""
    corners, third = light.corners, gain / 3.0
    for i in range(corners.shape[1]):
        p, q, s = corners[0, i], corners[1, i], corners[2, i]
        f0, f1, f2 = force(light, layout, held, x, i)
        f0, f1, f2 = third * f0, third * f1, third * f2
        d0 = x[0, p] + x[0, q] + x[0, s] - 3.0 * centre[0]
        d1 = x[1, p] + x[1, q] + x[1, s] - 3.0 * centre[1]
        d2 = x[2, p] + x[2, q] + x[2, s] - 3.0 * centre[2]
        row[_FORCE] += 3.0 * f0
        row[_FORCE + 1] += 3.0 * f1
        row[_FORCE + 2] += 3.0 * f2
        row[_TORQUE] += d1 * f2 - d2 * f1
        row[_TORQUE + 1] += d2 * f0 - d0 * f2
        row[_TORQUE + 2] += d0 * f1 - d1 * f0
