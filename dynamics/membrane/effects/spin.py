"""Rotation about the z axis: spin-up before the light is switched on, and where a turning sail will be."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from beamrider.arrays import Floats


class SpinUp(NamedTuple):
    """rate: nominal spin in rad/s, signed. steps: length of the spin-up in steps, the last of which ends at t = 0.

    acceleration: uniform angular acceleration in rad/s², or NaN to follow the nominal rate of the stretching sail.
    """

    rate: float
    steps: int
    acceleration: float


@numba.njit(cache=True, error_model="numpy")
def angular_acceleration(spin: SpinUp, step: int, dt: float, masses: Floats, x: Floats, v: Floats) -> float:
    """Acceleration α in rad/s² for one step of the force m α ẑ × x.

    With α left open it is the one after which L_z equals I_z Ω_nominal(t + Δt): rotation slows as the sail stretches,
    and a uniform α would end below the nominal rate.
    """
    if spin.acceleration == spin.acceleration:
        return spin.acceleration
    momentum = 0.0
    inertia = 0.0
    for i in range(masses.size):
        momentum += masses[i] * (x[0, i] * v[1, i] - x[1, i] * v[0, i])
        inertia += masses[i] * (x[0, i] * x[0, i] + x[1, i] * x[1, i])
    return (spin.rate * (step + 1) / spin.steps - momentum / inertia) / dt


@numba.njit(cache=True, error_model="numpy")
def kick(spin: SpinUp, step: int, dt: float, masses: Floats, x: Floats, v: Floats) -> float:
    """Add the impulse of m α ẑ × x over the time dt in s to velocities v (3, n) of nodes x (3, n); α dt in rad/s."""
    turn = dt * angular_acceleration(spin, step, dt, masses, x, v)
    for i in range(masses.size):
        v[0, i] -= turn * x[1, i]
        v[1, i] += turn * x[0, i]
    return turn


@numba.njit(cache=True, error_model="numpy")
def foresee(masses: Floats, x: Floats, v: Floats, time: float, out: Floats) -> None:
    """Where nodes x (3, n) with velocities v will be after a short `time` in s, into out (3, n).

    They turn about the z axis through the centre of mass at the sail's mean rate L_z/I_z; what is left of the velocity
    goes straight on. Straight on alone would make a turning sail larger, by half the square of the angle.
    """
    mass, x0, x1, v0, v1 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(masses.size):
        mass += masses[i]
        x0 += masses[i] * x[0, i]
        x1 += masses[i] * x[1, i]
        v0 += masses[i] * v[0, i]
        v1 += masses[i] * v[1, i]
    x0, x1, v0, v1 = x0 / mass, x1 / mass, v0 / mass, v1 / mass
    momentum, inertia = 0.0, 0.0
    for i in range(masses.size):
        a, b = x[0, i] - x0, x[1, i] - x1
        momentum += masses[i] * (a * (v[1, i] - v1) - b * (v[0, i] - v0))
        inertia += masses[i] * (a * a + b * b)
    rate = momentum / inertia if inertia > 0.0 else 0.0
    angle = rate * time
    across, along = math.sin(angle), math.cos(angle) - 1.0
    for i in range(masses.size):
        a, b = x[0, i] - x0, x[1, i] - x1
        out[0, i] = x[0, i] + along * a - across * b + time * (v[0, i] + rate * b)
        out[1, i] = x[1, i] + along * b + across * a + time * (v[1, i] - rate * a)
        out[2, i] = x[2, i] + time * v[2, i]
