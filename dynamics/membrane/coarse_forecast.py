"""How fast a flexible flight goes on this machine: timed steps that leave no trace, a coarse mesh for a fine one."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path

from beamrider.io.files import InputError
from dynamics.membrane.flight import Flight, step_seconds
from dynamics.membrane.forecast import require_series, say_flexible
from dynamics.sail.forecast import nodes
from dynamics.scene.schema import Scene

#: Rings from which on a mesh takes so long to build that a coarse one, of so many rings, tells first what is to come.
FINE, COARSE = 150, 40


def _coarse(scene: Scene) -> Scene:
    """The scene on a coarse mesh, whose steps are longer; temperatures are renewed as often as on the fine one."""
    every = max(1, scene.flight.heat_every * COARSE // scene.sail.rings)
    flight = scene.flight.model_copy(update={"time_step_s": None, "heat_every": every})
    sail = scene.sail.model_copy(update={"rings": COARSE})
    return scene.model_copy(update={"flight": flight, "sail": sail})


def forecast_fine(scene: Scene, fly: Callable[[Scene, Path], Flight], folder: Path) -> None:
    """Forecast of a flight on a fine mesh before that is built, from one on a coarse mesh that `fly` sets up.

    Nothing for other meshes, nor where the coarse one cannot fly. InputError as in
    `forecast.say_flexible`.
    """
    if scene.sail.rings < FINE:
        return
    with tempfile.TemporaryDirectory() as place:
        try:
            flight = fly(_coarse(scene), Path(place))
        except InputError:
            return
        _, after = step_seconds(flight)
    model, finer = flight.model, scene.sail.rings / COARSE
    same = scene.flight.integrator == "corotating"
    dt = scene.flight.time_step_s or (model.dt if same else model.dt / finer)
    steps = math.ceil((model.release * model.dt + scene.flight.duration_s) / dt)
    require_series(scene, dt, steps, folder)
    say_flexible(scene, dt, steps, steps * after * nodes(scene.sail) / model.masses.size, folder)
