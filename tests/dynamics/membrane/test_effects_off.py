"""An effect that is off leaves the flight, to the bit, as if the sail had not what the effect needs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynamics.membrane.flight import Flight
from dynamics.membrane.plan import plan
from dynamics.scene.schema import Scene
from tests.membranes import film, small, steps

LIT = {"beam": {"radius_m": 1.0}, "flight": {"heat_every": 2, "optics_every": 2}}


def bits(scene: Scene, folder: Path) -> list[np.ndarray]:
    """The state after some lit and heated steps of a bent, turning sail."""
    flight = Flight(scene, {}, folder)
    flight.step = flight.model.release
    flight.state.x[2] += 0.01 * flight.state.x[0]
    flight.state.v[0], flight.state.v[1] = -300.0 * flight.state.x[1], 300.0 * flight.state.x[0]
    steps(flight, 200)
    return [*flight.state]


def sail(**material: Any) -> dict[str, Any]:
    return {"sectors": film(**material)}


@pytest.mark.parametrize(
    ("effect", "without"),
    [
        ("conduction", {"sail": sail(conductivity_W_mK=0.0)}),
        ("expansion", {"sail": sail(expansion_1_K=0.0)}),
        ("emission", {"sail": sail(emissivity_front=0.0, emissivity_back=0.0)}),
        ("light", {"sail": sail(), "beam": {"intensity_W_m2": 0.0}}),
        ("reflections", {"sail": sail()}),
        ("tensile_failure", {"sail": sail(strength_Pa=1e30)}),
        ("thermal_failure", {"sail": sail(failure_temperature_K=1e30)}),
        ("damping", {"sail": sail(damping_s=0.0)}),
    ],
)
def test_an_effect_that_is_off_leaves_the_same_bits_as_a_sail_without(
    tmp_path: Path, effect: str, without: dict[str, Any]
):
    assert effect in plan(small())
    off = small(**{**LIT, "sail": sail()}, effects={effect: False})
    groups = {name: {**LIT.get(name, {}), **without.get(name, {})} for name in {*LIT, *without}}
    for one, other in zip(bits(off, tmp_path), bits(small(**groups), tmp_path), strict=True):
        assert np.array_equal(one, other)
