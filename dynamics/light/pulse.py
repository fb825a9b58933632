"""The light's power in time: the ramp on and off. `dynamics.light.intensity` is the layer below. SI units."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynamics.light import intensity as kernel
from dynamics.light.beam import Beam
from dynamics.light.profile import Floats


def ramp(beam: Beam, t: Any) -> Floats:
    """Share (...) of the full intensity at time t in s: raised cosines before and after the time at full power."""
    return np.asarray(np.vectorize(kernel.ramp, otypes=[float])(t, beam.delay_s, beam.rise_s, beam.on_s))


def knots(beam: Beam) -> tuple[float, ...]:
    """Times in s where the ramp is not smooth. An integrator must stop there, or it may step over a short pulse."""
    up = beam.delay_s + beam.rise_s
    return beam.delay_s, up, up + beam.on_s, up + beam.on_s + beam.rise_s
