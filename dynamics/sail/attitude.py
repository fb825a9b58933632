"""Attitude: rotation matrices, unit quaternions and the angles shown to people.

A rotation Q maps body to lab components. The angles (roll φ, pitch θ, yaw ψ) are those of the intrinsic sequence
x, y′, z″ with right-handed rotations, Q = A_x(φ) A_y(θ) A_z(ψ) (Goldstein, Classical Mechanics, app. A), so that the
normal of the sail is Q ẑ = (sinθ, −cosθ sinφ, cosθ cosφ). Quaternions are (w, x, y, z).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from beamrider.arrays import Floats


def rotation_from_angles(roll: Any, pitch: Any, yaw: Any) -> Floats:
    """Rotation matrices (..., 3, 3) of angles (...) in rad."""
    return rotation_from_quaternion(quaternion_from_angles(roll, pitch, yaw))


def quaternion_from_angles(roll: Any, pitch: Any, yaw: Any) -> Floats:
    """Unit quaternions (..., 4) of angles (...) in rad."""
    zero = np.zeros(np.broadcast(roll, pitch, yaw).shape)
    turns = []
    for axis, angle in enumerate((roll, pitch, yaw)):
        parts = [np.cos(np.asarray(angle) / 2) + zero, zero, zero, zero]
        parts[1 + axis] = np.sin(np.asarray(angle) / 2) + zero
        turns.append(np.stack(parts, axis=-1))
    return product(product(turns[0], turns[1]), turns[2])


def product(a: Floats, b: Floats) -> Floats:
    """Quaternion products a ⊗ b (..., 4): first b, then a."""
    w, x, y, z = np.moveaxis(a, -1, 0)
    p, i, j, k = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            w * p - x * i - y * j - z * k,
            w * i + x * p + y * k - z * j,
            w * j + y * p + z * i - x * k,
            w * k + z * p + x * j - y * i,
        ],
        axis=-1,
    )


def rotation_from_quaternion(quaternion: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) of any length > 0."""
    w, x, y, z = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def arctan2(y: Any, x: Any) -> Floats:
    """Angles (...) in rad of points (x, y), one by one with the C library's function.

    NumPy's rounds the last bit differently from one run to the next, by where its arrays happen to lie in memory.
    """
    return np.asarray(np.frompyfunc(math.atan2, 2, 1)(y, x), float)


def angles_from_rotation(turn: Floats) -> tuple[Floats, Floats, Floats]:
    """(roll, pitch, yaw) (...) in rad of rotations (..., 3, 3); roll and yaw in (−π, π], pitch in [−π/2, π/2].

    At pitch = ±π/2 only roll ± yaw is defined: the whole turn is given to roll, yaw is 0.
    """
    cosine = np.hypot(turn[..., 0, 0], turn[..., 0, 1])
    locked = cosine < 1e-12
    pitch = arctan2(turn[..., 0, 2], cosine)
    roll = np.where(locked, arctan2(turn[..., 2, 1], turn[..., 1, 1]), arctan2(-turn[..., 1, 2], turn[..., 2, 2]))
    yaw = np.where(locked, 0.0, arctan2(-turn[..., 0, 1], turn[..., 0, 0]))
    return roll, pitch, yaw
