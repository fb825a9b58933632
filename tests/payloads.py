"""Payloads for tests: point masses on even rings of tethers."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Released at rest, in the middle of the beam.
STILL = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0, "spin_Hz": 0.0}


def ring(lines: int, radius: float, stiffness: float, from_deg: float = 0.0, **more: Any) -> list[dict[str, Any]]:
    """So many tethers to places at a radius in m, evenly from a polar angle on."""
    angles = np.radians(from_deg) + 2.0 * np.pi * np.arange(lines) / lines
    places = [[float(radius * np.cos(angle)), float(radius * np.sin(angle))] for angle in angles]
    return [{"to_m": place, "stiffness_N_m": stiffness, **more} for place in places]


def behind(mass: float, depth: float, tethers: list[dict[str, Any]]) -> dict[str, Any]:
    """A mass in kg on the axis, so many m behind the sail."""
    return {"mass_kg": mass, "position_m": [0.0, 0.0, -depth], "tethers": tethers}
