"""Point masses on tethers to a rigid sail, in the normalised units of `equations`; compiled.

Behind the sail's 17 numbers the state of a flight holds positions and velocities (lab) of b masses, 3b numbers each,
and for each of k tethers 1, or 0 once it has snapped.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Integers


class Towing(NamedTuple):
    """b masses (b,) in masses of the sail, and k tethers, none where there is no payload.

    body (k,): their masses; arm (k, 3): their ends on the sail in body components, from its centre of mass, in
    diameters. Normalised stiffness (k,), length (k,), retardation (k,), strength (k,), ∞ for never; pushes (k,): 1 for
    struts, else 0. snaps: may any of them.
    """

    mass: Floats
    body: Integers
    arm: Floats
    stiffness: Floats
    length: Floats
    retardation: Floats
    strength: Floats
    pushes: Floats
    snaps: bool


_NONE = np.zeros(0)
#: No payload.
NOTHING = Towing(_NONE, np.zeros(0, np.int64), np.zeros((0, 3)), _NONE, _NONE, _NONE, _NONE, _NONE, False)


@numba.njit(cache=True, error_model="numpy")
def moving(towing: Towing, first: int) -> int:
    """How many numbers of a state move: the `first` ones of the sail, and those of the masses."""
    return first + 6 * towing.mass.size


@numba.njit(cache=True, error_model="numpy")
def line(towing: Towing, sail: int, turn: Floats, state: Floats, k: int, arm: Floats, away: Floats) -> float:
    """Tension of tether k; its arm in the lab (3,) and its unit vector from the sail to the mass (3,) are written.

    sail: how many numbers of the state are the sail's; turn (3, 3): its rotation. T = k (ℓ − L + τ dℓ/dt), never
    negative but for struts.
    """
    place, speed = sail + 3 * towing.body[k], sail + 3 * towing.mass.size + 3 * towing.body[k]
    p, q, r = state[10], state[11], state[12]
    a, b, c = towing.arm[k, 0], towing.arm[k, 1], towing.arm[k, 2]
    w0, w1, w2 = q * c - r * b, r * a - p * c, p * b - q * a
    length, rate = 0.0, 0.0
    for i in range(3):
        arm[i] = turn[i, 0] * a + turn[i, 1] * b + turn[i, 2] * c
        away[i] = state[place + i] - state[i] - arm[i]
        length += away[i] * away[i]
        swing = turn[i, 0] * w0 + turn[i, 1] * w1 + turn[i, 2] * w2
        rate += away[i] * (state[speed + i] - state[3 + i] - swing)
    length = math.sqrt(length)
    per_length = 1.0 / length if length > 0.0 else 0.0
    for i in range(3):
        away[i] *= per_length
    tension = towing.stiffness[k] * (length - towing.length[k] + towing.retardation[k] * rate * per_length)
    slack = towing.pushes[k] == 0.0 and (length <= towing.length[k] or tension < 0.0)
    return 0.0 if slack else tension


@numba.njit(cache=True, error_model="numpy")
def tow(towing: Towing, sail: int, turn: Floats, state: Floats, out: Floats, pull: Floats) -> None:
    """Write the masses' part of d(state)/dt into out, force (lab) and torque (body) on the sail (6,)."""
    masses, whole = towing.mass.size, sail + 6 * towing.mass.size
    arm, away = np.empty(3), np.empty(3)
    pull[:] = 0.0
    for i in range(3 * masses):
        out[sail + i] = state[sail + 3 * masses + i]
        out[sail + 3 * masses + i] = 0.0
    for k in range(towing.body.size):
        out[whole + k] = 0.0
        if state[whole + k] == 0.0:
            continue
        tension = line(towing, sail, turn, state, k, arm, away)
        speed, mass = sail + 3 * masses + 3 * towing.body[k], towing.mass[towing.body[k]]
        for i in range(3):
            out[speed + i] -= tension * away[i] / mass
            pull[i] += tension * away[i]
        x = arm[1] * away[2] - arm[2] * away[1]
        y = arm[2] * away[0] - arm[0] * away[2]
        z = arm[0] * away[1] - arm[1] * away[0]
        for i in range(3):
            pull[3 + i] += tension * (turn[0, i] * x + turn[1, i] * y + turn[2, i] * z)


@numba.njit(cache=True, error_model="numpy")
def overload(towing: Towing, sail: int, turn: Floats, state: Floats) -> int:
    """The first tether above its strength in a state (m,) with rotation turn (3, 3), −1 if none is."""
    arm, away, whole = np.empty(3), np.empty(3), sail + 6 * towing.mass.size
    for k in range(towing.body.size):
        if state[whole + k] != 0.0 and line(towing, sail, turn, state, k, arm, away) > towing.strength[k]:
            return k
    return -1
