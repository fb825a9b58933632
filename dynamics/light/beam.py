"""The laser beam: Gaussian profile about the z axis without divergence, and the temporal ramp. SI units."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamrider.arrays import Floats
from dynamics.light import intensity as kernel
from dynamics.scene import schema as scenes


def intensity(beam: scenes.Beam, x: Any, y: Any, t: Any = None) -> Floats:
    """Intensity (...) in W/m² at lateral position x, y in m (broadcast) and time t in s; without t at full power."""
    share = 1.0 if t is None else ramp(beam, t)
    return np.asarray(np.vectorize(kernel.intensity)(x, y, beam.intensity_W_m2, beam.radius_m) * share)


def ramp(beam: scenes.Beam, t: Any) -> Floats:
    """Share (...) of the full intensity at time t in s: raised cosines before and after the time at full power."""
    return np.asarray(np.vectorize(kernel.ramp, otypes=[float])(t, beam.delay_s, beam.rise_s, beam.on_s))


def power(beam: scenes.Beam) -> float:
    """Power of the whole beam in W, π w² I₀/2 (Saleh & Teich, Fundamentals of Photonics, §3.1)."""
    return 0.5 * np.pi * beam.radius_m**2 * beam.intensity_W_m2


def knots(beam: scenes.Beam) -> tuple[float, ...]:
    """Times in s where the ramp is not smooth. An integrator must stop there, or it may step over a short pulse."""
    up = beam.delay_s + beam.rise_s
    return beam.delay_s, up, up + beam.on_s, up + beam.on_s + beam.rise_s
