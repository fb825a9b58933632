"""Spin-up about the z axis before the light is switched on."""

from __future__ import annotations

from typing import NamedTuple

import numba

from dynamics.kernels.elastic import Floats


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
def kick(spin: SpinUp, step: int, dt: float, masses: Floats, x: Floats, v: Floats) -> None:
    """Add the impulse of m α ẑ × x over the time dt in s to velocities v (3, n) of nodes x (3, n)."""
    turn = dt * angular_acceleration(spin, step, dt, masses, x, v)
    for i in range(masses.size):
        v[0, i] -= turn * x[1, i]
        v[1, i] += turn * x[0, i]
