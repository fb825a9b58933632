"""Specular sails lit once: a scene of mirrors, and the row of one evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynamics.membrane.flight import Flight
from dynamics.membrane.output.record import COLUMNS
from tests.membranes import dark, film, steps

WIDE = {"intensity_W_m2": 1e9, "radius_m": 1e4, "on_s": 1.0}
BOWL = {"profile": "paraboloid", "depth": 1.4, "outline": "round"}


def lit(tmp_path: Path, tables: Any = None, shape: Any = None, **groups: Any) -> tuple[Flight, np.ndarray]:
    """A flight of a specular sail, R = 0.6, a = 0.1 if not told otherwise, and the row of one evaluation in `shape`."""
    sail = {"sectors": film(reflectance=0.6, absorptance=0.1), "rotation_deg": 0.0, **groups.pop("sail", {})}
    effects = {"tensile_failure": False, **groups.pop("effects", {})}
    beam = {**WIDE, **groups.pop("beam", {})}
    scene = dark(groups.pop("rings", 6), sail=sail, beam=beam, effects=effects, **groups)
    flight = Flight(scene, tables or {}, tmp_path)
    if shape is not None:
        flight.state.x[...] = shape(flight.state.x)
    flight.step = flight.model.release + 8
    return flight, steps(flight, 0)[0]


def force(row: np.ndarray) -> np.ndarray:
    return row[COLUMNS["force"] : COLUMNS["force"] + 3]
