"""Force, torque and equations of motion of a flat rigid sail, on plain numbers in normalised units.

Units: length D (diameter), mass m, time t₀ = √(m c/(I₀ D)); force I₀D²/c, torque I₀D³/c, inertia mD². The light travels
along +z. Rotation Q maps body to lab components; quaternions are (w, x, y, z). Goldstein
is Goldstein, Poole & Safko, Classical Mechanics.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from beamrider.machine_code.standalone import standalone
from dynamics.light.aim import Wander, aim, axes, brightness, where
from dynamics.light.compiled import Profile
from dynamics.light.intensity import ramp
from dynamics.light.sectors import Rules, moments
from dynamics.rigid.towing import NOTHING, Towing, tow
from optics.table.lookup import lookup_many
from optics.table.pressure_table import TableArrays, lookup

INSIDE, OUTSIDE_TABLE, LIT_FROM_BEHIND = 0, 1, 2
MOTION = 13  # position 3, velocity 3, quaternion 4, angular velocity 3
STATE = MOTION + 4  # and what the light has done: work 1, angular impulse 3


class RigidSail(NamedTuple):
    """A flat sail of n_s sectors, all lengths in diameters.

    g (n_s, 2): direction across the ridges in body x, y. rules: quadrature. centre (2,): of mass, from the middle.
    table (n_s,): index of the pressure table, −1 for constant `reflectance`, `absorptance` (n_s,).
    inertia, inverse (3, 3): inertia tensor about the centre of mass and its inverse. towing: its payload.
    """

    g: Floats
    rules: Rules
    centre: Floats
    table: NDArray[np.int64]
    reflectance: Floats
    absorptance: Floats
    inertia: Floats
    inverse: Floats
    towing: Towing = NOTHING


class Light(NamedTuple):
    """The beam in normalised units, and how the sail sees it.

    power: 1, or 0 without light. profile: across the beam. wander: of its axis and power. delay, rise, on: of the ramp.
    yaw_blind: incidence from the lab pitch and roll whatever the yaw. axial: add the axial coordinate of the point to
    its distance from the beam. polarised: the electric field has its own direction in the lab, at `angle` from x at
    t = 0 and turning at `rate` (rad per unit time); tables then hold the response to each Stokes component. Otherwise
    it turns with the sail.
    """

    power: float
    profile: Profile
    wander: Wander
    delay: float
    rise: float
    on: float
    yaw_blind: bool
    axial: bool
    polarised: bool
    angle: float
    rate: float


@numba.njit(cache=True, error_model="numpy")
def rotation(q: Floats, out: Floats) -> None:
    """Write the rotation matrix (3, 3) of a quaternion (4,) of any length > 0 (Goldstein, §4.5)."""
    s = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    w, x, y, z = q[0], q[1], q[2], q[3]
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)


@numba.njit(cache=True, error_model="numpy")
def incidence(turn: Floats, g: Floats, yaw_blind: bool) -> tuple[float, float]:
    """(u, v) of the light in a sector with rest direction g (2,), r = n × g.

    The true ones are those of k in body components, the last row of the rotation. The yaw-blind rule takes pitch
    θ = asin n_x and roll φ = −atan2(n_y, n_z) of the normal in the lab for the tilt of a sail that never turned, so
    that k = (−sinθ cosφ, sinφ, cosθ cosφ).
    """
    if yaw_blind:
        slant = math.hypot(turn[1, 2], turn[2, 2])
        kx, ky = -turn[0, 2] * turn[2, 2] / slant, -turn[1, 2] / slant
    else:
        kx, ky = turn[2, 0], turn[2, 1]
    return kx * g[0] + ky * g[1], -kx * g[1] + ky * g[0]


@numba.njit(cache=True, error_model="numpy")
def stokes(turn: Floats, g: Floats, angle: float) -> tuple[float, float]:
    """(s₁, s₂) in a sector's axes of light along +z that is polarised linearly at `angle` from x in the lab.

    turn (3, 3), g (2,). e₁ is the sector's r = n × g projected perpendicular to k, e₂ = k × e₁; s₁ = cos 2χ,
    s₂ = sin 2χ with χ the angle from e₁ towards e₂ (Born & Wolf, Principles of Optics, §1.4.2).
    """
    x = -turn[0, 0] * g[1] + turn[0, 1] * g[0]
    y = -turn[1, 0] * g[1] + turn[1, 1] * g[0]
    twice = 2.0 * (angle - math.atan2(y, x))
    return math.cos(twice), math.sin(twice)


@numba.njit(cache=True, error_model="numpy")
def polarised(table: TableArrays, u: float, v: float, s: tuple[float, float]) -> tuple[float, float, float, bool]:
    """(q_g, q_r, q_n, inside) as the sum over the Stokes components (1, s₁, s₂, 0)."""
    direction, q = np.array([[u], [v]]), np.empty((1, 16))
    outside, _ = lookup_many(table, direction[0], direction[1], q)
    total = q[0, 0:4] + s[0] * q[0, 4:8] + s[1] * q[0, 8:12]
    return total[0], total[1], total[2], outside == 0


@numba.njit(cache=True, error_model="numpy")
def response(
    sail: RigidSail, tables: tuple[TableArrays, ...], light: Light, s: int, t: float, turn: Floats, out: Floats
) -> int:
    """Write q (3,) of sector s, force × c per incident power in body components; a flag says where light came from."""
    if sail.table[s] < 0:
        # F = (P/c)(2R (k·n) n + a k): mirror reflection, light that passes carries its momentum on
        for i in range(3):
            out[i] = sail.absorptance[s] * turn[2, i]
        out[2] += 2.0 * sail.reflectance[s] * turn[2, 2]
        return INSIDE
    g = sail.g[s]
    u, v = incidence(turn, g, light.yaw_blind)
    if light.polarised:
        q_g, q_r, q_n, inside = polarised(tables[sail.table[s]], u, v, stokes(turn, g, light.angle + light.rate * t))
    else:
        q_g, q_r, q_n, _, inside = lookup(tables[sail.table[s]], u, v)
    out[0] = q_g * g[0] - q_r * g[1]
    out[1] = q_g * g[1] + q_r * g[0]
    out[2] = q_n
    if turn[2, 2] <= 0.0:
        if not tables[sail.table[s]].axisymmetric:
            return LIT_FROM_BEHIND
        out[2] = -q_n  # a film is the same from behind
    return INSIDE if inside else OUTSIDE_TABLE


@numba.njit(cache=True, error_model="numpy")
def load(
    sail: RigidSail,
    tables: tuple[TableArrays, ...],
    light: Light,
    t: float,
    turn: Floats,
    x: float,
    y: float,
    out: Floats,
) -> int:
    """Write force and torque about the centre of mass (6,), body components, at full intensity; worst flag of a sector.

    The light goes along z of the frame that `turn` leads to, the beam's.

    F = Σ |w| ∫ e q dA, τ = Σ |w| ∫ e b × q dA over the sectors, q constant in each; b = (X, Y, 0) from the centre of
    mass, which lies at (x, y) from the beam's middle.
    """
    out[:] = 0.0
    q, lit = np.empty(3), np.empty((sail.table.size, 3))
    flag = INSIDE
    moments(light.profile, sail.rules, sail.centre, light.axial, turn, x, y, lit)
    for s in range(sail.table.size):
        flag = max(flag, response(sail, tables, light, s, t, turn, q))
        total, first_x, first_y = lit[s, 0], lit[s, 1], lit[s, 2]
        for i in range(3):
            out[i] += total * q[i]
        out[3] += first_y * q[2]
        out[4] -= first_x * q[2]
        out[5] += first_x * q[1] - first_y * q[0]
    for i in range(6):
        out[i] *= abs(turn[2, 2])
    return flag


@numba.njit(cache=True, error_model="numpy")
def _see(light: Light, t: float, position: Floats, turn: Floats) -> tuple[float, float]:
    """Turn the rotation of a body at `position` to the frame of a beam that wanders; the place across it there."""
    lab, frame, now, place = turn.copy(), np.empty((3, 3)), np.empty(5), np.empty((3, 1))
    place[:, 0] = position
    aim(light.wander, t, place)
    where(light.wander, t, now)
    axes(now, frame)
    for i in range(3):
        for j in range(3):
            turn[i, j] = frame[i, 0] * lab[0, j] + frame[i, 1] * lab[1, j] + frame[i, 2] * lab[2, j]
    return place[0, 0], place[1, 0]


@standalone()
def derivative(
    sail: RigidSail, tables: tuple[TableArrays, ...], light: Light, t: float, state: Floats, out: Floats
) -> int:
    """Write d(state)/dt (17, or more with a payload: see `towing`); flag of `load`.

    The state: position, velocity (lab), quaternion, angular velocity (body); work, angular impulse (lab) of the light.
    Newton's and Euler's equations (Goldstein, §5.5), q̇ = ½ q ⊗ (0, ω), the power F·v + τ·ω and the torque Qτ.
    """
    turn, body = np.empty((3, 3)), np.zeros(6)
    rotation(state[6:10], turn)
    share = light.power * ramp(t, light.delay, light.rise, light.on)
    flag = INSIDE
    if share > 0.0:
        across, along = state[0], state[1]
        if light.wander.periods.size > 0:
            across, along = _see(light, t, state[:3], turn)
            share *= brightness(light.wander, t)
        flag = load(sail, tables, light, t, turn, across, along, body)
        body *= share
        if light.wander.periods.size > 0:
            rotation(state[6:10], turn)
    w, x, y, z = state[6], state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    out[6] = -0.5 * (x * p + y * q + z * r)
    out[7] = 0.5 * (w * p + y * r - z * q)
    out[8] = 0.5 * (w * q + z * p - x * r)
    out[9] = 0.5 * (w * r + x * q - y * p)
    power = body[3] * p + body[4] * q + body[5] * r
    for i in range(3):
        out[i] = state[3 + i]
        out[3 + i] = turn[i, 0] * body[0] + turn[i, 1] * body[1] + turn[i, 2] * body[2]
        out[14 + i] = turn[i, 0] * body[3] + turn[i, 1] * body[4] + turn[i, 2] * body[5]
        power += out[3 + i] * state[3 + i]
    out[13] = power
    if sail.towing.mass.size > 0:
        pull = np.empty(6)
        tow(sail.towing, STATE, turn, state, out, pull)
        for i in range(3):
            out[3 + i] += pull[i]
            body[3 + i] += pull[3 + i]
    _turning(sail, state[10:13], body[3:6], out[10:13])
    return flag


@numba.njit(cache=True, error_model="numpy")
def _turning(sail: RigidSail, omega: Floats, torque: Floats, out: Floats) -> None:
    """Euler's equations I ω̇ = τ − ω × Iω; writes ω̇ (3,)."""
    spin = np.zeros(3)
    for i in range(3):
        for j in range(3):
            spin[i] += sail.inertia[i, j] * omega[j]
    x = torque[0] - (omega[1] * spin[2] - omega[2] * spin[1])
    y = torque[1] - (omega[2] * spin[0] - omega[0] * spin[2])
    z = torque[2] - (omega[0] * spin[1] - omega[1] * spin[0])
    for i in range(3):
        out[i] = sail.inverse[i, 0] * x + sail.inverse[i, 1] * y + sail.inverse[i, 2] * z
