"""How fast a flexible flight goes on this machine: timed steps that leave no trace, a coarse mesh for a fine one."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from beamrider.io.files import InputError
from dynamics.sail.forecast import nodes, require_series, say_flexible
from dynamics.scene.schema import Scene

if TYPE_CHECKING:
    from dynamics.membrane.flight import Flight

#: Rings from which on a mesh takes so long to build that a coarse one, of so many rings, tells first what is to come.
FINE, COARSE = 150, 40
#: Most steps that are timed at once, and seconds after which it is enough.
MOST, ENOUGH = 512, 0.1


def paces(flight: Flight) -> tuple[float, float]:
    """Wall time in s of a step of the spin-up and of one in the light, with everything compiled."""
    after = _pace(flight, max(flight.step, flight.model.release))
    return _pace(flight, 0) if flight.step < flight.model.release else after, after


def _pace(flight: Flight, start: int) -> float:
    """Wall time in s of a step from one on, renewals of light and heat shared out."""
    flight.rehearse(start, 1)
    count = min(MOST, max(8, flight.model.optics_every, flight.model.heat.every))
    while True:
        spent = flight.rehearse(start, count)
        if count == MOST or spent * count > ENOUGH:
            return spent
        count = min(MOST, 4 * count)


def _coarse(scene: Scene) -> Scene:
    """The scene on a coarse mesh, whose steps are longer; temperatures are renewed as often as on the fine one."""
    every = max(1, scene.flight.heat_every * COARSE // scene.sail.rings)
    flight = scene.flight.model_copy(update={"time_step_s": None, "heat_every": every})
    sail = scene.sail.model_copy(update={"rings": COARSE})
    return scene.model_copy(update={"flight": flight, "sail": sail})


def foresee(scene: Scene, fly: Callable[[Scene, Path], Flight], folder: Path) -> None:
    """Forecast of a flight on a fine mesh before that is built, from one on a coarse mesh that `fly` sets up.

    Nothing for other meshes, nor where the coarse one cannot fly. InputError as in
    `dynamics.sail.forecast.say_flexible`.
    """
    if scene.sail.rings < FINE:
        return
    with tempfile.TemporaryDirectory() as place:
        try:
            flight = fly(_coarse(scene), Path(place))
        except InputError:
            return
        _, after = paces(flight)
    model, finer = flight.model, scene.sail.rings / COARSE
    same = scene.flight.integrator == "corotating"
    dt = scene.flight.time_step_s or (model.dt if same else model.dt / finer)
    steps = math.ceil((model.release * model.dt + scene.flight.duration_s) / dt)
    require_series(scene, dt, steps, folder)
    say_flexible(scene, dt, steps, steps * after * nodes(scene.sail) / model.masses.size, folder)
