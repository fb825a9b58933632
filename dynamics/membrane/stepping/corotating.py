"""Semi-implicit steps of a spinning flat sail in the frame that turns with it, at the slow scale of the membrane.

With y the places of the nodes in that frame, the scheme is velocity Verlet with another mass before ÿ only:

    (M + ½ Δt² K) ÿ = F − M (ω × (ω × r) + 2 ω × ẏ) − τ K (ẏ + ½ Δt ÿ),

K the stiffness of the flat sail, and across it (M + Δt⁴/64 S M⁻¹ S) ÿ, S that of a membrane under a tension that the
sail never reaches. It differs from M ÿ by terms of second and fourth order and is stable as long as K and S are stiffer
than the sail (`beyond`); where they are not, a larger S goes on. The matrices are constant, and so are their factors.
It is operator splitting (Combescure & Pegon, Soil Dyn. Earthq. Eng. 16 (1997) 427, α = 0) seen at the predicted places.

In-plane waves are much faster than the steps. The mass makes them slow while their forces stay true, and then as slow
as those across the sail, with which they exchange energy as true ones do not: slopes at the rim grow
(docs/flight_schemes.md). So they are damped as in a viscous film with τ = Δt, and what is much faster than the steps is
at rest after one. The forces of what steps resolve change by τ times its rate of strain; rigid motion is not damped.
As K is what the factorised matrix A and the mass leave, τ K ẏ = τ/γ (A ẏ − M ẏ) asks for no product with K. Across the
sail waves as short as the mesh lose a small part of their velocity in a step.

Total force and torque about the centre of mass, the latter times 1 − (Ω Δt)²/6 or /2 as turning along chords asks for,
stay as they are, so momentum and angular momentum are kept to rounding where there is no light.
A sail that turns steadily is an exact solution of the steps, along chords: velocities of spin ω take it on by
asin(ω Δt) in a step, so the release makes ω somewhat smaller than the spin asked for.
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

    plane, across: factors of the matrices A before ÿ in the sail's plane (with the Coriolis term), two unknowns a node,
    and across it. calm, calm_across: τ/γ of each in 1/s. sides (e,): for each edge the place, in the 3t sides of the
    triangles, of one of its sides. most: elastic strain of an edge, with twice the square of its slope, up to which the
    matrices are stiffer than the sail. substeps: explicit steps to each step of the spin-up.
    """

    plane: Factor
    across: Factor
    calm: float
    calm_across: float
    sides: Indices
    most: float
    substeps: int


class CorotatingWork(NamedTuple):
    """Work space, all (3, n): positions r and velocities u about the centre of mass, velocities without rotation later.

    field: acceleration without its rigid part; transport: in the frame's axes, of nodes that stay where they are there;
    late: τ/γ ẏ, in its axes too. plane (2n,), across (n,): right-hand sides and solutions. frame (3, 3): its axes as
    rows. motion (8, 3): centre, its velocity and acceleration, ω, its rate, and sums. rate (n,): heating rate of the
    step before in K/s. stiffer (1,): how many times as stiff as at first the sail is taken for across its plane.
    """

    positions: Floats
    drift: Floats
    field: Floats
    transport: Floats
    late: Floats
    plane: Floats
    across: Floats
    frame: Floats
    motion: Floats
    rate: Floats
    stiffer: Floats
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
def _into_frame(e: Floats, values: Floats, i: int) -> tuple[float, float, float]:
    """Column i of values (3, n) along the axes e (3, 3)."""
    a, b, c = values[0, i], values[1, i], values[2, i]
    return (
        e[0, 0] * a + e[0, 1] * b + e[0, 2] * c,
        e[1, 0] * a + e[1, 1] * b + e[1, 2] * c,
        e[2, 0] * a + e[2, 1] * b + e[2, 2] * c,
    )


@numba.njit(cache=True, error_model="numpy")
def _centripetal(own: CorotatingWork, chord: float) -> None:
    """To transport (3, n), in the lab: chord times ω × (ω × r)."""
    r, out, omega = own.positions, own.transport, own.motion[OMEGA]
    w0, w1, w2 = omega[0], omega[1], omega[2]
    square = w0 * w0 + w1 * w1 + w2 * w2
    for i in range(r.shape[1]):
        along = w0 * r[0, i] + w1 * r[1, i] + w2 * r[2, i]
        out[0, i] = chord * (along * w0 - square * r[0, i])
        out[1, i] = chord * (along * w1 - square * r[1, i])
        out[2, i] = chord * (along * w2 - square * r[2, i])


@numba.njit(cache=True, error_model="numpy")
def _residual(model: Model, scheme: Corotating, own: CorotatingWork, dt: float) -> float:
    """Right-hand sides of the step, M times what is left of the acceleration and A late; returns the spin ω·n in rad/s.

    The centripetal acceleration is the one with which nodes that move along chords stay on their circle. The velocity
    of now follows from that half a step ago, u, with ÿ = 0: (1 − Δt ω J) ẏ = u + ½ Δt a, J a quarter turn.
    """
    e, omega = own.frame, own.motion[OMEGA]
    spin = omega[0] * e[2, 0] + omega[1] * e[2, 1] + omega[2] * e[2, 2]
    angle = dt * spin
    share = 1.0 / (1.0 + angle * angle)
    _centripetal(own, 2.0 / (1.0 + math.sqrt(max(1.0 - angle * angle, 0.0))))
    for i in range(model.masses.size):
        cx, cy, _ = _into_frame(e, own.transport, i)
        ux, uy, uz = _into_frame(e, own.drift, i)
        bx, by, bz = _into_frame(e, own.field, i)
        ux, uy = ux + 0.5 * dt * cx, uy + 0.5 * dt * cy
        ux, uy = share * (ux - angle * uy), share * (uy + angle * ux)
        x, y, m = cx - 2.0 * spin * uy, cy + 2.0 * spin * ux, model.masses[i]
        ux, uy, uz = scheme.calm * ux, scheme.calm * uy, scheme.calm_across * uz
        own.transport[0, i], own.transport[1, i] = x, y
        own.late[0, i], own.late[1, i], own.late[2, i] = ux, uy, uz
        own.plane[2 * i] = m * (bx - x + share * (ux - angle * uy))
        own.plane[2 * i + 1] = m * (by - y + share * (uy + angle * ux))
        own.across[i] = m * (bz + uz)
    return spin


@numba.njit(cache=True, error_model="numpy")
def _assemble(own: CorotatingWork, dt: float, spin: float) -> None:
    """Field (3, n) of accelerations in the lab: transport, ÿ of the solutions, and the Coriolis term of ½ Δt ÿ."""
    e, late, angle = own.frame, own.late, dt * spin
    share = angle / (1.0 + angle * angle)
    for i in range(own.across.size):
        px, py, z = own.plane[2 * i] - late[0, i], own.plane[2 * i + 1] - late[1, i], own.across[i] - late[2, i]
        x = own.transport[0, i] + px - share * (py + angle * px)
        y = own.transport[1, i] + py + share * (px - angle * py)
        own.field[0, i] = e[0, 0] * x + e[1, 0] * y + e[2, 0] * z
        own.field[1, i] = e[0, 1] * x + e[1, 1] * y + e[2, 1] * z
        own.field[2, i] = e[0, 2] * x + e[1, 2] * y + e[2, 2] * z


@numba.njit(cache=True, error_model="numpy")
def _share_turning(own: CorotatingWork, angle: float) -> None:
    """The angular acceleration with which nodes on chords turn as the sail does; angle: Δt times their spin.

    They turn by θ = asin(angle) in a step. What tilts the spin axis moves a node by z = B t sin(Ωt) under c cos(Ωt):
    steps of z make that B = c Δt/(2 sin θ), true is c/(2Ω). What changes the spin changes θ by Δt/cos θ times ω.
    """
    alpha, normal = own.motion[ALPHA], own.frame[2]
    tilting = angle / math.asin(angle) if abs(angle) > 1e-6 else 1.0
    along = alpha[0] * normal[0] + alpha[1] * normal[1] + alpha[2] * normal[2]
    along *= math.sqrt(1.0 - angle * angle) - tilting
    for c in range(3):
        alpha[c] = tilting * alpha[c] + along * normal[c]


@standalone()
def replace_accelerations(
    model: Model, scheme: Corotating, own: CorotatingWork, x: Floats, v: Floats, acceleration: Floats
) -> None:
    """Replace accelerations (3, n) of nodes x, velocities v half a step ago, by those of the scheme.

    Their mean stays, and their torque but for what goes on along chords (`_share_turning`).
    """
    tensor = np.empty((3, 3))
    _decompose(model, own, tensor, x, v, acceleration)
    spin = _residual(model, scheme, own, model.dt)
    solve_factorised(scheme.plane, own.in_plane, own.plane)
    solve_factorised(scheme.across, own.out_of_plane, own.across)
    _assemble(own, model.dt, spin)
    _share_turning(own, model.dt * spin)
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
