"""What flights neglect, and when in a flight it begins to matter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.light.spots import finest
from dynamics.sail.sectors import wavelength
from dynamics.sail.shapes import rim_slope
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable

#: Speed in units of that of light from which on force, colour and direction of the light change by 0.1 to 0.2 %.
FAST = 1e-3


def rayleigh_range(scene: Scene, tables: dict[str, PressureTable]) -> float:
    """Distance π w²/λ in m at which the beam is √2 times as wide (Saleh & Teich, §3.1); inf without a wavelength.

    w: the length over which the beam changes, of a Gaussian one its radius.
    """
    known = [wavelength(table) for table in tables.values() if wavelength(table) is not None]
    return math.pi * finest(scene.beam.spots) ** 2 / float(known[0]) if known else math.inf


def thrown_back(scene: Scene, tables: dict[str, PressureTable]) -> bool:
    """May orders of gratings meet a curved sail again, which flights do not follow; the light comes along its axis.

    Of a slope s the order m leaves at sin θ = sin s + m λ/p from the normal, at s + θ from the axis; the rest of the
    sail lies at most by the steepest slope S above the horizon, so that s + θ > 90° − S is needed.
    """
    steep = rim_slope(scene.sail)
    steep += math.radians(math.hypot(scene.release.pitch_deg, scene.release.roll_deg)) if steep else 0.0
    cells = [tables[name].attrs.get("cell", {}) for name in scene.sail.designs if name in tables]
    steps = [cell["wavelength_nm"] / cell["period_nm"] for cell in cells if "period_nm" in cell]
    sines = [min(math.sin(steep) + math.floor(1.0 / step) * step, 1.0) for step in steps if step <= 1.0]
    return steep > 0.0 and any(2.0 * steep + math.asin(sine) > 0.5 * math.pi for sine in sines)


def neglected(
    scene: Scene,
    tables: dict[str, PressureTable],
    time: Floats,
    position: Floats,
    velocity: Floats,
    behind: float | None,
) -> str:
    """What a flight neglects and from when on, '' for nothing.

    time (n,) in s, position and velocity (n, 3) of the centre of mass in SI; behind: time in s at which the light first
    met a face that turns away from it, None if it never did.
    """
    if scene.beam.intensity_W_m2 == 0.0:
        return ""
    range_m = rayleigh_range(scene, tables)
    found = [
        (
            _first(time, np.linalg.norm(velocity, axis=1) > FAST * LIGHT_SPEED),
            f"relativity, at more than {FAST:g} of the speed of light",
        ),
        (_first(time, np.abs(position[:, 2]) > range_m), f"the spread of the beam, beyond its {range_m:.3g} m"),
        (0.0 if thrown_back(scene, tables) else None, "orders of gratings that meet the sail again"),
        (behind, "shade, and that the far face differs from the near one, lit from behind"),
    ]
    return "; ".join(f"{what} from {since:.3g} s on" for since, what in found if since is not None)


def said(text: str) -> str:
    """What was neglected, for the line that a stage ends with; '' for nothing."""
    return f"neglected: {text}" if text else ""


def _first(time: Floats, true: NDArray[np.bool_]) -> float | None:
    """The first time at which something is true."""
    return float(time[np.argmax(true)]) if np.any(true) else None
