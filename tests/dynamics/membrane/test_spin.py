"""Where a turning sail will be."""

import numpy as np
import pytest

from dynamics.membrane.effects.spin import extrapolate


@pytest.mark.parametrize("time", [1e-6, 1e-3, 1.0])
def test_a_sail_that_turns_and_flies_like_a_rigid_one_is_extrapolated_to_rounding(time: float):
    """Turning about z through the centre of mass while that flies straight on, any masses, any angle."""
    rng = np.random.default_rng(0)
    masses, x = rng.uniform(0.1, 1.0, 50), rng.standard_normal((3, 50))
    velocity, rate = np.array([3.0, -2.0, 9.0]), -754.0
    centre = (x @ masses / masses.sum())[:, None]
    across = np.array([[0.0, -rate, 0.0], [rate, 0.0, 0.0], [0.0, 0.0, 0.0]])
    v = velocity[:, None] + across @ (x - centre)
    found = np.empty_like(x)
    extrapolate(masses, x, v, time, found)
    c, s = np.cos(rate * time), np.sin(rate * time)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ (x - centre)
    # The rate comes from sums: an angle of hundreds of turns is as uncertain as its rounding
    assert np.abs(found - centre - time * velocity[:, None] - turned).max() < 1e-14 * (10.0 + abs(rate * time))
