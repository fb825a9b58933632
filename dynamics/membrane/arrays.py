"""All that compiled code of a flexible flight is given: the model, which stays as it is, and the work space."""

from __future__ import annotations

from typing import Any, NamedTuple

from beamrider.arrays import Floats, Integers
from dynamics.membrane.layout.rows import Stencil, StencilWork
from dynamics.membrane.layout.triangles import Triangles
from dynamics.membrane.state import Stage


class Model(NamedTuple):
    """What flies, unchanging: see the parts.

    rest (3, n): shape in m the attitude is fitted to. lit, warm: are light and heat computed. dt in s; release: the
    step that starts at t = 0; end: the last one. optics_every: steps between updates of the held light; series_every:
    between rows. fly_away: distance in m from the axis at which a run ends. effects: parameters of each effect by its
    name (`dynamics.membrane.effects`).
    """

    stencil: Stencil
    triangles: Triangles
    masses: Floats
    rest: Floats
    lit: bool
    warm: bool
    integrator: int
    dt: float
    release: int
    end: int
    optics_every: int
    series_every: int
    fly_away: float
    effects: Any


class WorkSpace(NamedTuple):
    """Work space: acceleration (3, n) in m/s², and the parts; effects: work arrays of each effect by its name.

    flags: [1 if the held light is valid, failed edge or triangle]. gain (1,): the ramp at the latest evaluation.
    ahead (3, n): nodes in the middle of the time over which light is held. stage: arrays of rk4, empty for the others.
    """

    stencil: StencilWork
    acceleration: Floats
    flags: Integers
    gain: Floats
    ahead: Floats
    stage: Stage
    effects: Any
