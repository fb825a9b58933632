"""What holds a sail and what it carries cost nothing where they are off: same bits, no arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynamics.membrane.flight import Flight
from dynamics.membrane.output.journal import leaves
from dynamics.scene.schema import Scene
from tests.membranes import film, small, steps
from tests.payloads import behind, ring

GIVEN: dict[str, Any] = {
    "held": {"rim": "springs", "rim_stiffness_N_m2": 10.0, "tension_N_m": 1.0, "gravity_m_s2": [0.0, 0.0, 5.0]},
    "payload": [behind(1e-4, 0.2, ring(3, 0.2, 100.0, damping_s=1e-4))],
}
LIT = {"sail": {"sectors": film()}, "beam": {"radius_m": 1.0}, "flight": {"heat_every": 2, "optics_every": 2}}
STILL = {"spin_Hz": 0.0, "pitch_deg": 1.0}


def flown(scene: Scene, folder: Path) -> tuple[list[np.ndarray], int]:
    """State after some lit steps of a bent sail, and the numbers in the model's holder and tethers."""
    flight = Flight(scene, {}, folder)
    flight.step = flight.model.release
    flight.state.x[2] += 0.01 * flight.state.x[0]
    steps(flight, 200)
    parts = [flight.model.effects.tethers, flight.work.effects.tethers]
    size = sum(array.size for part in parts for _, array in leaves(part))
    return [*flight.state], size + flight.model.effects.held.nodes.size


@pytest.mark.parametrize("effect", ["held", "payload"])
def test_flexible_flight_has_the_same_bits_without(tmp_path: Path, effect: str):
    off = small(**LIT, release=STILL, **{effect: GIVEN[effect]}, effects={effect: False})
    one, size = flown(off, tmp_path)
    other, _ = flown(small(**LIT, release=STILL), tmp_path)
    assert size == 0
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("effect", ["held", "payload"])
def test_an_effect_that_is_asked_for_needs_its_key(effect: str):
    with pytest.raises(ValueError, match=f"effects.{effect} = true: needs {effect}"):
        small(**LIT, effects={effect: True})
