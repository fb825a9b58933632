"""Attitude: angles, quaternions and rotation matrices are one and the same turn."""

import numpy as np
import pytest

from dynamics.rigid.equations import rotation
from dynamics.sail import attitude

RANDOM = np.random.default_rng(1)
ROLL, PITCH, YAW = (RANDOM.uniform(-h, h, 200) for h in (np.pi, np.pi / 2, np.pi))


def turn_about(axis: int, angle: float) -> np.ndarray:
    """Right-handed rotation by `angle` about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def test_angles_are_the_intrinsic_sequence_x_y_z():
    for roll, pitch, yaw in zip(ROLL, PITCH, YAW, strict=True):
        want = turn_about(0, roll) @ turn_about(1, pitch) @ turn_about(2, yaw)
        assert np.allclose(attitude.rotation_from_angles(roll, pitch, yaw), want, atol=1e-14)


def test_normal_and_beam_direction_follow_the_closed_forms():
    turn = attitude.rotation_from_angles(ROLL, PITCH, YAW)
    sp, cp, st, ct, sy, cy = (f(a) for a in (ROLL, PITCH, YAW) for f in (np.sin, np.cos))
    assert np.allclose(turn[:, :, 2].T, [st, -ct * sp, ct * cp], atol=1e-14)
    assert np.allclose(turn[:, 2].T, [-st * cp * cy + sp * sy, st * cp * sy + sp * cy, ct * cp], atol=1e-14)


def test_angles_survive_the_round_trip():
    back = attitude.angles_from_rotation(attitude.rotation_from_angles(ROLL, PITCH, YAW))
    assert np.allclose(back, [ROLL, PITCH, YAW], atol=1e-12)


def test_pitch_stays_exact_next_to_a_right_angle():
    pitch = np.pi / 2 - 1e-6
    turn = attitude.rotation_from_angles(0.3, pitch, 0.2)
    assert attitude.angles_from_rotation(turn)[1] == pytest.approx(pitch, abs=1e-14)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_gimbal_lock_still_names_the_turn(pitch: float):
    turn = attitude.rotation_from_angles(0.3, pitch, 0.2)
    assert np.allclose(attitude.rotation_from_angles(*attitude.angles_from_rotation(turn)), turn, atol=1e-12)


def test_product_of_quaternions_is_the_product_of_rotations():
    a, b = attitude.quaternion_from_angles(ROLL, PITCH, YAW), attitude.quaternion_from_angles(YAW, PITCH, ROLL)
    want = attitude.rotation_from_quaternion(a) @ attitude.rotation_from_quaternion(b)
    assert np.allclose(attitude.rotation_from_quaternion(attitude.product(a, b)), want, atol=1e-14)


def test_length_of_a_quaternion_does_not_matter():
    quaternion = attitude.quaternion_from_angles(ROLL, PITCH, YAW)
    want = attitude.rotation_from_quaternion(quaternion)
    assert np.allclose(attitude.rotation_from_quaternion(3.0 * quaternion), want, atol=1e-14)
    out = np.empty((3, 3))
    for q, matrix in zip(quaternion, want, strict=True):
        rotation(3.0 * q, out)
        assert np.allclose(out, matrix, atol=1e-14)
        assert np.allclose(out @ out.T, np.eye(3), atol=1e-14)
