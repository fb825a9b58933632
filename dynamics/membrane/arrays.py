"""All that the kernels of a flexible flight are given: the model, which stays as it is, and the work space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from dynamics.membrane.effects.damping import DampingWork
from dynamics.membrane.effects.held import Holder
from dynamics.membrane.effects.light_pressure import Light, LightWork
from dynamics.membrane.effects.properties import Curves
from dynamics.membrane.effects.reflections import Mirror, MirrorWork
from dynamics.membrane.effects.sheet import Sheet, SheetWork
from dynamics.membrane.effects.spin import SpinUp
from dynamics.membrane.effects.springs import Springs
from dynamics.membrane.effects.tearing import Broken
from dynamics.membrane.effects.tethers import Tethers, TetherWork
from dynamics.membrane.effects.thermal import Heat, HeatWork
from dynamics.membrane.layout.rows import Stencil, StencilWork
from dynamics.membrane.layout.triangles import Triangles
from dynamics.membrane.state import Stage


class Model(NamedTuple):
    """What flies, unchanging: see the parts.

    rest (3, n): shape in m the attitude is fitted to. lit, warm: are light and heat computed. dt in s; release: the
    step that starts at t = 0; end: the last one. optics_every: steps between updates of the held light; series_every:
    between rows. fly_away: distance in m from the axis at which a run ends; most_broken: failed triangles it outlives.
    retardation (t,): of the damping, in s, empty where that is off. curves: properties that change with temperature.
    per_mass (n,) in 1/kg: 0 for nodes that are held fast, empty where no effect asks for it.
    """

    springs: Springs
    sheet: Sheet
    stencil: Stencil
    retardation: Floats
    triangles: Triangles
    masses: Floats
    per_mass: Floats
    rest: Floats
    lit: bool
    light: Light
    mirror: Mirror
    warm: bool
    heat: Heat
    curves: Curves
    spin_up: SpinUp
    holder: Holder
    tethers: Tethers
    integrator: int
    dt: float
    release: int
    end: int
    optics_every: int
    series_every: int
    fly_away: float
    most_broken: int


class Work(NamedTuple):
    """Work space: free lengths of springs (e,) in m, acceleration (3, n), and that of the effects.

    sheet: that of elastic triangles. flags: [1 if the held light is valid, failed edge or triangle]. gain (1,): the
    ramp at the latest evaluation. ahead (3, n): nodes in the middle of the time over which light is held.
    stage: arrays of rk4, empty for the others.
    """

    free: Floats
    sheet: SheetWork
    stencil: StencilWork
    damping: DampingWork
    acceleration: Floats
    light: LightWork
    mirror: MirrorWork
    broken: Broken
    heat: HeatWork
    tethers: TetherWork
    flags: NDArray[np.int64]
    gain: Floats
    ahead: Floats
    stage: Stage
