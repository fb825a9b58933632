"""State of a flying membrane, and the stages between two states."""

from __future__ import annotations

from typing import NamedTuple

from beamrider.arrays import Floats


class State(NamedTuple):
    """x, v (3, n) in m and m/s; temperature (n,) in K, empty where heat is off; impulse (3,) of the light in N s."""

    x: Floats
    v: Floats
    temperature: Floats
    impulse: Floats


class Stage(NamedTuple):
    """Work space of rk4: positions and velocities of a stage, and their weighted sums (3, n); temperatures alike."""

    x: Floats
    v: Floats
    sum_x: Floats
    sum_v: Floats
    temperature: Floats
    sum_rate: Floats
