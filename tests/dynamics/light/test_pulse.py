"""The light's power in time: the ramp."""

from itertools import pairwise

import numpy as np
import pytest

from dynamics.light import pulse as beam
from dynamics.light.beam import Beam
from dynamics.light.intensity import mean_ramp, ramp, ramp_integral

LASER = Beam(intensity_W_m2=1e9, radius_m=0.4, delay_s=0.1, rise_s=0.02, on_s=0.5)


def test_ramp_is_dark_before_and_after_and_full_between():
    t = np.array([0.0, 0.1, 0.12, 0.3, 0.62, 0.64, 1.0])
    assert np.allclose(beam.ramp(LASER, t), [0, 0, 1, 1, 1, 0, 0], atol=1e-12)


def test_ramp_rises_and_falls_alike_and_evenly_about_its_middle():
    s = np.linspace(0.0, 0.02, 11)
    rise, fall = beam.ramp(LASER, 0.1 + s), beam.ramp(LASER, 0.62 + s)
    assert np.allclose(rise + fall, 1.0, atol=1e-12)
    assert np.allclose(rise + rise[::-1], 1.0, atol=1e-12)


def test_ramp_without_rise_switches():
    laser = Beam(intensity_W_m2=1.0, radius_m=1.0, rise_s=0.0, on_s=1.0)
    assert beam.ramp(laser, [0.0, 1e-9, 0.999, 1.001]).tolist() == [0.0, 1.0, 1.0, 0.0]


def test_ramp_is_smooth_between_its_knots():
    knots = beam.knots(LASER)
    assert np.allclose(knots, [0.1, 0.12, 0.62, 0.64])
    for a, b in pairwise(knots):
        t = np.linspace(a, b, 2001)[1:-1]
        second = np.diff(beam.ramp(LASER, t), 2) / (t[1] - t[0]) ** 2
        assert np.abs(second).max() <= 0.5 * (np.pi / 0.02) ** 2 * 1.001


def test_light_let_through_is_the_integral_of_the_ramp():
    delay, rise, on = 0.1, 0.02, 0.5
    t = np.linspace(0.0, 0.8, 80001)
    shares = np.array([ramp(x, delay, rise, on) for x in t])
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (shares[1:] + shares[:-1]) * np.diff(t))])
    assert np.abs([ramp_integral(x, delay, rise, on) for x in t] - sums).max() < 1e-8


def test_the_mean_of_a_ramp_is_exact_where_it_does_not_change_or_jumps():
    for rise in (0.0, 1e-15, 0.02):
        assert [mean_ramp(a, a + 1e-4, 0.1, rise, 0.5) for a in (0.0, 0.0999, 0.7)] == [0.0, 0.0, 0.0]
        assert mean_ramp(0.3, 0.3001, 0.1, rise, 0.5) == pytest.approx(1.0, abs=1e-11)
    assert mean_ramp(0.0, 0.4, 0.1, 0.0, 0.5) == pytest.approx(0.75, rel=1e-14)
    assert mean_ramp(0.5, 0.7, 0.1, 0.0, 0.5) == pytest.approx(0.5, rel=1e-14)
