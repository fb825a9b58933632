"""Semi-implicit steps of a spinning flat sail in the frame that turns with it, at the slow scale of the membrane.

With y the places of the nodes in that frame, the scheme is velocity Verlet with another mass before ÿ only:

    (M + ½ Δt² K) ÿ = F − M (ω × (ω × r) + 2 ω × ẏ),

K the stiffness of the flat sail in its plane, and ½ of that of a membrane under a tension never reached across it. It
differs from M ÿ by terms of second order and is stable as long as K is stiffer than the sail (`beyond`). In-plane
waves, which are much faster than the steps, become slow while their forces stay true. The matrix is constant, and so
is its factor. It is operator splitting (Combescure & Pegon, Soil Dyn. Earthq. Eng. 16 (1997) 427, α = 0) seen at the
predicted places. Total force and torque about the centre of mass stay as they are, so momentum and angular momentum
are kept to rounding. A sail that turns steadily is an exact solution of the steps, along chords: velocities of spin ω
take it on by asin(ω Δt) in a step, so the release makes ω somewhat smaller than the spin asked for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model
from dynamics.membrane.effects.springs import Springs
from dynamics.membrane.output.record import centre
from dynamics.membrane.stepping.dissection import Factor, Solution, solve_factorised
from dynamics.membrane.stepping.integrators import copy

#: Passes that find the velocity half a step before a release: each errs by the one before times the angle of turn.
PASSES = 8


class Corotating(NamedTuple):
    """What the scheme adds to a model.

    plane, across: factors of M + ½ Δt² K (and the Coriolis term) in the sail's plane, two unknowns a node, and across
    it. sides (e,): for each edge the place, in the 3t sides of the triangles, of one of its sides. most: elastic strain
    of an edge, with twice the square of its slope, up to which K is stiffer than the sail. substeps: explicit steps to
    each step of the spin-up.
    """

    plane: Factor
    across: Factor
    sides: Indices
    most: float
    substeps: int


class CorotatingWork(NamedTuple):
    """Work space, all (3, n): positions r and velocities u about the centre of mass, velocities without rotation later.

    field: acceleration without its rigid part; transport: in the frame's axes, of nodes that stay where they are there.
    plane (2n,), across (n,): right-hand sides and solutions. frame (3, 3): its axes as rows. motion (8, 3): centre,
    its velocity and acceleration, ω, its rate, and sums. rate (n,): heating rate of the step before in K/s.
    """

    positions: Floats
    drift: Floats
    field: Floats
    transport: Floats
    plane: Floats
    across: Floats
    frame: Floats
    motion: Floats
    rate: Floats
    in_plane: Solution
    out_of_plane: Solution


CENTRE, VELOCITY, ACCELERATION, OMEGA, ALPHA, SUM, TURN, MOMENT = range(8)


@numba.njit(cache=True, error_model="numpy")
def _cross(a: Floats, b: Floats, out: Floats) -> None:
    """Out = a × b, all (3,)."""
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, error_model="numpy")
def _inertia(masses: Floats, r: Floats, tensor: Floats) -> None:
    """Inertia tensor (3, 3) of nodes r (3, n) about the origin in kg m²."""
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(masses.size):
        m, x, y, z = masses[i], r[0, i], r[1, i], r[2, i]
        xx += m * x * x
        yy += m * y * y
        zz += m * z * z
        xy += m * x * y
        xz += m * x * z
        yz += m * y * z
    tensor[0, 0], tensor[1, 1], tensor[2, 2] = yy + zz, xx + zz, xx + yy
    tensor[0, 1], tensor[0, 2], tensor[1, 2] = -xy, -xz, -yz
    tensor[1, 0], tensor[2, 0], tensor[2, 1] = -xy, -xz, -yz


@numba.njit(cache=True, error_model="numpy")
def _turning(masses: Floats, r: Floats, field: Floats, tensor: Floats, moment: Floats, out: Floats) -> None:
    """Out (3,) = I⁻¹ Σ m r × field: the rotation in a field (3, n) of velocities or accelerations. By Cramer's rule."""
    m0, m1, m2 = 0.0, 0.0, 0.0
    for i in range(masses.size):
        m, x, y, z = masses[i], r[0, i], r[1, i], r[2, i]
        m0 += m * (y * field[2, i] - z * field[1, i])
        m1 += m * (z * field[0, i] - x * field[2, i])
        m2 += m * (x * field[1, i] - y * field[0, i])
    moment[0], moment[1], moment[2] = m0, m1, m2
    a, b, c = tensor[0], tensor[1], tensor[2]
    _cross(b, c, out)
    whole = a[0] * out[0] + a[1] * out[1] + a[2] * out[2]
    x = (m0 * out[0] + m1 * out[1] + m2 * out[2]) / whole
    _cross(c, a, out)
    y = (m0 * out[0] + m1 * out[1] + m2 * out[2]) / whole
    _cross(a, b, out)
    z = (m0 * out[0] + m1 * out[1] + m2 * out[2]) / whole
    out[0], out[1], out[2] = x, y, z


@numba.njit(cache=True, error_model="numpy")
def _axes(masses: Floats, rest: Floats, r: Floats, frame: Floats) -> None:
    """Axes (3, 3), as rows, of the flat shape rest (3, n) where it fits the nodes r (3, n) best."""
    frame[:] = 0.0
    first, second, normal = frame[0], frame[1], frame[2]
    for i in range(masses.size):
        a, b = masses[i] * rest[0, i], masses[i] * rest[1, i]
        for c in range(3):
            first[c] += a * r[c, i]
            second[c] += b * r[c, i]
    _cross(first, second, normal)
    _normalise(normal)
    # The rotation of the polar decomposition within the plane: first + second × normal points along the first axis
    x = first[0] + second[1] * normal[2] - second[2] * normal[1]
    y = first[1] + second[2] * normal[0] - second[0] * normal[2]
    z = first[2] + second[0] * normal[1] - second[1] * normal[0]
    first[0], first[1], first[2] = x, y, z
    _normalise(first)
    _cross(normal, first, second)


@numba.njit(cache=True, error_model="numpy")
def _normalise(a: Floats) -> None:
    size = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    for c in range(3):
        a[c] /= size


@numba.njit(cache=True, error_model="numpy")
def _subtract_rigid(r: Floats, field: Floats, mean: Floats, turn: Floats, out: Floats) -> None:
    """Out (3, n) = field − mean − turn × r."""
    for i in range(r.shape[1]):
        x, y, z = r[0, i], r[1, i], r[2, i]
        out[0, i] = field[0, i] - mean[0] - (turn[1] * z - turn[2] * y)
        out[1, i] = field[1, i] - mean[1] - (turn[2] * x - turn[0] * z)
        out[2, i] = field[2, i] - mean[2] - (turn[0] * y - turn[1] * x)


@numba.njit(cache=True, error_model="numpy")
def _decompose(model: Model, own: CorotatingWork, tensor: Floats, x: Floats, v: Floats, acceleration: Floats) -> None:
    """Frame and rigid motion of nodes x (3, n), velocities v half a step ago and accelerations; what they leave."""
    masses, motion, still = model.masses, own.motion, np.zeros(3)
    centre(masses, x, motion[CENTRE])
    centre(masses, v, motion[VELOCITY])
    centre(masses, acceleration, motion[ACCELERATION])
    _subtract_rigid(x, x, motion[CENTRE], still, own.positions)
    _subtract_rigid(x, v, motion[VELOCITY], still, own.drift)
    _inertia(masses, own.positions, tensor)
    _turning(masses, own.positions, own.drift, tensor, motion[MOMENT], motion[OMEGA])
    _turning(masses, own.positions, acceleration, tensor, motion[MOMENT], motion[ALPHA])
    _subtract_rigid(own.positions, own.drift, still, motion[OMEGA], own.drift)
    _subtract_rigid(own.positions, acceleration, motion[ACCELERATION], motion[ALPHA], own.field)
    _axes(masses, model.rest, own.positions, own.frame)


@numba.njit(cache=True, error_model="numpy")
def _residual(model: Model, own: CorotatingWork, dt: float) -> float:
    """Right-hand sides of the step, M times what is left of the acceleration; returns the spin ω·n in rad/s.

    The centripetal acceleration is the one with which nodes that move along chords stay on their circle. The velocity
    of now follows from that half a step ago, u, with ÿ = 0: (1 − Δt ω J) ẏ = u + ½ Δt a, J a quarter turn.
    """
    r, u, b, motion, e = own.positions, own.drift, own.field, own.motion, own.frame
    w0, w1, w2 = motion[OMEGA, 0], motion[OMEGA, 1], motion[OMEGA, 2]
    spin = w0 * e[2, 0] + w1 * e[2, 1] + w2 * e[2, 2]
    angle = dt * spin
    chord = 2.0 / (1.0 + math.sqrt(max(1.0 - angle * angle, 0.0)))
    share = 1.0 / (1.0 + angle * angle)
    square = w0 * w0 + w1 * w1 + w2 * w2
    for i in range(model.masses.size):
        along = w0 * r[0, i] + w1 * r[1, i] + w2 * r[2, i]
        c0 = chord * (along * w0 - square * r[0, i])
        c1 = chord * (along * w1 - square * r[1, i])
        c2 = chord * (along * w2 - square * r[2, i])
        cx, cy = e[0, 0] * c0 + e[0, 1] * c1 + e[0, 2] * c2, e[1, 0] * c0 + e[1, 1] * c1 + e[1, 2] * c2
        ux = e[0, 0] * u[0, i] + e[0, 1] * u[1, i] + e[0, 2] * u[2, i] + 0.5 * dt * cx
        uy = e[1, 0] * u[0, i] + e[1, 1] * u[1, i] + e[1, 2] * u[2, i] + 0.5 * dt * cy
        x, y = cx - 2.0 * spin * share * (uy + angle * ux), cy + 2.0 * spin * share * (ux - angle * uy)
        m = model.masses[i]
        own.transport[0, i], own.transport[1, i] = x, y
        own.plane[2 * i] = m * (e[0, 0] * b[0, i] + e[0, 1] * b[1, i] + e[0, 2] * b[2, i] - x)
        own.plane[2 * i + 1] = m * (e[1, 0] * b[0, i] + e[1, 1] * b[1, i] + e[1, 2] * b[2, i] - y)
        own.across[i] = m * (e[2, 0] * b[0, i] + e[2, 1] * b[1, i] + e[2, 2] * b[2, i])
    return spin


@numba.njit(cache=True, error_model="numpy")
def _assemble(own: CorotatingWork, dt: float, spin: float) -> None:
    """Field (3, n) of accelerations in the lab: transport, ÿ of the solutions, and the Coriolis term of ½ Δt ÿ."""
    e, angle = own.frame, dt * spin
    share = angle / (1.0 + angle * angle)
    for i in range(own.across.size):
        px, py, z = own.plane[2 * i], own.plane[2 * i + 1], own.across[i]
        x = own.transport[0, i] + px - share * (py + angle * px)
        y = own.transport[1, i] + py + share * (px - angle * py)
        for c in range(3):
            own.field[c, i] = e[0, c] * x + e[1, c] * y + e[2, c] * z


@standalone()
def replace_accelerations(
    model: Model, scheme: Corotating, own: CorotatingWork, x: Floats, v: Floats, acceleration: Floats
) -> None:
    """Replace accelerations (3, n) of nodes x, velocities v half a step ago, by those of the scheme.

    Their mean and their torque stay.
    """
    tensor = np.empty((3, 3))
    _decompose(model, own, tensor, x, v, acceleration)
    spin = _residual(model, own, model.dt)
    solve_factorised(scheme.plane, own.in_plane, own.plane)
    solve_factorised(scheme.across, own.out_of_plane, own.across)
    _assemble(own, model.dt, spin)
    motion = own.motion
    centre(model.masses, own.field, motion[SUM])
    _turning(model.masses, own.positions, own.field, tensor, motion[MOMENT], motion[TURN])
    for c in range(3):
        motion[SUM, c] -= motion[ACCELERATION, c]
        motion[TURN, c] -= motion[ALPHA, c]
    _subtract_rigid(own.positions, own.field, motion[SUM], motion[TURN], acceleration)


@numba.njit(cache=True, error_model="numpy")
def replace_at_release(
    model: Model, scheme: Corotating, own: CorotatingWork, x: Floats, v: Floats, acceleration: Floats
) -> None:
    """The same where v (3, n) are velocities of now: those half a step ago follow from the result, pass by pass."""
    true, before = acceleration.copy(), v.copy()
    for _ in range(PASSES):
        copy(true, acceleration)
        replace_accelerations(model, scheme, own, x, before, acceleration)
        for c in range(3):
            for i in range(model.masses.size):
                before[c, i] = v[c, i] - 0.5 * model.dt * acceleration[c, i]


@numba.njit(cache=True, error_model="numpy")
def beyond(springs: Springs, scheme: Corotating, slots: Indices, lengths: Floats, own: CorotatingWork) -> int:
    """A triangle of the first edge of more strain and slope than the scheme bears, or not finite; −1 if there is none.

    lengths (f, 3, p): squared free lengths in m², in which slots (3t,) are the places of the sides of the triangles.
    """
    free = lengths.reshape(-1)
    r, e, height = own.positions, own.frame, own.across
    for i in range(height.size):
        height[i] = e[2, 0] * r[0, i] + e[2, 1] * r[1, i] + e[2, 2] * r[2, i]
    for k in range(springs.start.size):
        a, b = springs.start[k], springs.end[k]
        d0, d1, d2, rise = r[0, b] - r[0, a], r[1, b] - r[1, a], r[2, b] - r[2, a], height[b] - height[a]
        square = free[slots[scheme.sides[k]]]
        if not 0.5 * (d0 * d0 + d1 * d1 + d2 * d2 - square) + 2.0 * rise * rise <= scheme.most * square:
            return scheme.sides[k] % (slots.size // 3)
    return -1
