"""Rotation about the z axis: spin-up before the light is switched on, and where a turning sail will be."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from beamrider.arrays import Floats
from dynamics.membrane.effects.interface import Decision, Plan, Setup
from dynamics.scene.schema import Scene

NAME = "spin_up"
COST = "a pass over all nodes in each step before the release"


class SpinUp(NamedTuple):
    """rate: nominal spin in rad/s, signed. steps: length of the spin-up in steps, the last of which ends at t = 0.

    acceleration: uniform angular acceleration in rad/s², or NaN to follow the nominal rate of the stretching sail.
    """

    rate: float
    steps: int
    acceleration: float


def _spin_up(scene: Scene, so_far: Plan) -> Decision:
    return Decision(on=scene.release.spin_Hz != 0, reason=f"spin {scene.release.spin_Hz:g} Hz")


PLAN = {"spin_up": _spin_up}


def spin_up_time(scene: Scene) -> float:
    """Length of the spin-up in s; if not given Gao et al.'s |f|/(1801.8 max(|f|/100 Hz, Γ)), Γ = 10, curved sails 2.

    That is for sails of 0.5 m; larger ones, which elastic waves take as much longer to cross, get more.
    """
    if scene.flight.spin_up_s is not None:
        return scene.flight.spin_up_s
    f = abs(scene.release.spin_Hz)
    larger = max(1.0, scene.sail.radius_m / 0.5)
    return f / (1801.8 * max(f / 100.0, 10.0 if scene.sail.profile == "flat" else 2.0)) * larger


def build(setup: Setup) -> SpinUp:
    """Rate, length and acceleration; no steps where it is off."""
    if not setup.on("spin_up"):
        return SpinUp(0.0, 0, 0.0)
    scene = setup.scene
    rate, duration, gain = 2.0 * math.pi * scene.release.spin_Hz, spin_up_time(scene), scene.flight.spin_up_gain
    return SpinUp(rate, math.ceil(duration / setup.dt), math.nan if gain is None else gain * rate / duration)


@numba.njit(cache=True, error_model="numpy")
def angular_acceleration(spin: SpinUp, step: int, dt: float, masses: Floats, x: Floats, v: Floats) -> float:
    """Acceleration α in rad/s² for one step of the force m α ẑ × x; masses (n,), x and v (3, n).

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
def extrapolate(masses: Floats, x: Floats, v: Floats, time: float, out: Floats) -> None:
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
