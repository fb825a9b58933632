"""Gratings on a cone whose cells answer every direction alike: force and torque in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipe

from beamrider.io.files import InputError
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.flight import Flight
from dynamics.membrane.output.record import COLUMNS
from tests.membranes import FILM, dark, steps
from tests.synthetic import smooth_table

DEPTH, RADIUS, INTENSITY, Q_G, Q_N = 0.3, 0.5, 1e9, 0.15, 0.7
TABLES = {"grating": smooth_table("grating", (Q_G, 0.0, 0.0, 0.0), (Q_N, 0.0, 0.0, 0.0), 0.9)}
SINE, COSINE = DEPTH / np.hypot(1.0, DEPTH), 1.0 / np.hypot(1.0, DEPTH)


def coned(g: Any, rings: int, depth: float = DEPTH) -> Any:
    """A cone of gratings across `g` in a beam without an edge."""
    sector = {"from_deg": 0.0, "material": FILM, "design": "grating", "g": g}
    sail = {"profile": "cone", "depth": depth, "rescale": True, "sectors": [sector]}
    return dark(rings, sail=sail, beam={"intensity_W_m2": INTENSITY, "radius_m": 1e4, "on_s": 1.0})


def load(folder: Path, g: Any, rings: int) -> np.ndarray:
    """Force and torque (6,) about the axis' centre of mass, in units of I π R²/c and of that times R."""
    flight = Flight(coned(g, rings), TABLES, folder)
    flight.step = flight.model.release + 8
    row = steps(flight, 0)[0]
    unit = INTENSITY * np.pi * RADIUS**2 / LIGHT_SPEED
    at = COLUMNS["force"]
    return np.concatenate([row[at : at + 3], row[at + 3 : at + 6] / RADIUS]) / unit


@pytest.mark.parametrize(
    ("g", "want"),
    [
        # g points outward and up the light: F_z = q_n cos s − q_g sin s, s the slope
        ("radial", [0.0, 0.0, Q_N * COSINE - Q_G * SINE, 0.0, 0.0, 0.0]),
        ("-radial", [0.0, 0.0, Q_N * COSINE + Q_G * SINE, 0.0, 0.0, 0.0]),
        # g goes round: the mean of r is 2R/3
        ("tangential", [0.0, 0.0, Q_N * COSINE, 0.0, 0.0, 2.0 / 3.0 * Q_G]),
        ("-tangential", [0.0, 0.0, Q_N * COSINE, 0.0, 0.0, -2.0 / 3.0 * Q_G]),
        # g = (x̂ − n n_x)/√(1 − n_x²): its mean along x is that of √(1 − n_x²), n_x = sin s cos φ
        ([1.0, 0.0], [Q_G * 2.0 / np.pi * float(ellipe(SINE**2)), 0.0, Q_N * COSINE, 0.0, None, 0.0]),
    ],
)
def test_force_and_torque_on_a_cone(tmp_path: Path, g: Any, want: list[float | None]):
    """Second order in the mesh, whose rim is a polygon; in the tangent plane each triangle knows its g."""
    coarse, fine = load(tmp_path, g, 6), load(tmp_path, g, 12)
    found = fine + (fine - coarse) / 3.0
    for value, expected in zip(found, want, strict=True):
        assert expected is None or value == pytest.approx(expected, abs=3e-4)


def test_gratings_that_would_light_each_other_are_refused(tmp_path: Path):
    """Slopes above 30° need reflections, which know films only."""
    with pytest.raises(InputError, match="'grating' is a grating; only light from specular films is traced"):
        Flight(coned("radial", 3, depth=1.0), TABLES, tmp_path)
