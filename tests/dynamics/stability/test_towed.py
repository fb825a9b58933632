"""The linear model of sails with point masses on tethers, against flights."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from beamrider.io.files import InputError
from dynamics.rigid.body import rigid_body
from dynamics.rigid.stage import fly
from dynamics.scene.schema import Scene
from dynamics.stability import floquet
from dynamics.stability.derivatives import linearise
from dynamics.stability.towed import TowedModel, rig, towed
from tests.membranes import FIG6, altered
from tests.payloads import STILL, behind, ring
from tests.synthetic import smooth_table, smooth_tables

TABLES = smooth_tables()
#: Cells whose sail is marginally stable without spin: a tilt hardly pushes it aside.
CALM = {
    "mark1e_te": smooth_table("mark1e_te", (0.152, 1.0, -1.0, -0.2), (0.714, -2.7, 4.0, -1.5), 0.4, 9.448e-6),
    "mark1e_tm": smooth_table("mark1e_tm", (0.142, 0.3, -1.0, 0.2), (0.233, -0.8, 2.0, 0.4), 0.4, 9.763e-6),
}


def model_of(scene: Scene, tables: dict[str, Any]) -> TowedModel:
    """The linear model of a scene with a payload."""
    body = rigid_body(scene, tables, lookup="smooth", quadrature=None)
    jacobian, thrust = linearise(scene, tables, body)
    return towed(body, jacobian, thrust, 2.0 * np.pi * scene.release.spin_Hz * body.units.time, scene)


def swung(scene: Scene, tables: dict[str, Any], aside: float) -> tuple[np.ndarray, np.ndarray]:
    """Lateral (sail, payload) positions (n, 4) of a flight, and of the linear model from the same start, in the lab."""
    body, model = rigid_body(scene, tables), model_of(scene, tables)
    settled = rig(body.sail.towing, model.start, float(model.thrust))
    depth = float(settled.depth[0]) * body.units.length
    payload = [{**scene.model_dump()["payload"][0], "position_m": [0.0, 0.0, depth]}]
    lengths = body.sail.towing.length * body.units.length
    for line, length in zip(payload[0]["tethers"], lengths, strict=True):
        line["length_m"] = float(length)
    start = np.zeros(13)
    start[6], start[0], start[12] = 1.0, aside, 2.0 * np.pi * scene.release.spin_Hz
    flight = fly(altered(scene, payload=payload), tables, start)
    assert flight.payload is not None
    found = np.column_stack([flight.position[:, :2], flight.payload.position[:, 0, :2]])
    # All starts aside as a whole, the masses' velocity that of the turning axis: none
    state = np.zeros(model.size)
    state[0] = state[8] = aside
    generator = model.lab(0.0)
    want = []
    for time in flight.time / body.units.time:
        angle = model.spin * time
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        here = expm(model.corotating() * time) @ state
        want.append(np.concatenate([turn @ here[:2], turn @ here[8:10]]))
    assert generator.shape == (model.size, model.size)
    return found, np.array(want)


@pytest.mark.parametrize("spin", [0.0, -120.0])
@pytest.mark.parametrize("damping", [0.0, 2e-4])
def test_small_motions_fly_as_the_linear_model_says(spin: float, damping: float):
    """Damped or not, turning or not: to a thousandth of the swing over many of its periods."""
    payload = [behind(1e-4, 0.2, ring(4, 0.3, 300.0, damping_s=damping))]
    scene = altered(
        FIG6,
        payload=payload,
        beam={"rise_s": 0.0},
        release={**STILL, "spin_Hz": spin},
        rigid={"duration_s": 0.1, "tolerance": 1e-11, "output_Hz": 500.0},
    )
    found, want = swung(scene, CALM, 1e-6)
    assert np.abs(found - want).max() < 2e-3 * np.abs(want).max()


def test_both_routes_agree_with_a_payload():
    scene = altered(FIG6, payload=[behind(1e-4, 0.3, ring(3, 0.3, 300.0, damping_s=1e-4))])
    found = floquet.assess(model_of(scene, TABLES), [])
    assert found.route_difference is not None
    assert found.route_difference < 1e-9
    assert found.corotating is not None
    assert found.corotating.shape == (12,)


def strutted(damping: float) -> Scene:
    """A sail without spin that is marginally stable, with a mass on damped struts, which take up its swings."""
    lines = ring(6, 0.2, 0.2, damping_s=damping, pushes=True)
    return altered(FIG6, release=STILL, beam={"rise_s": 0.0, "on_s": 20.0}, payload=[behind(3e-4, 0.3, lines)])


def test_damping_within_makes_a_sail_asymptotically_stable():
    """Without damping it stays marginal.

    The means are those of Rafat et al., Phys. Rev. Applied 17, 024016 (2022); the sail is another.
    """
    unit = rigid_body(strutted(0.0), CALM, quadrature=None).units.time
    found = {damping: floquet.assess(model_of(strutted(damping), CALM), [], unit) for damping in (0.0, 0.03)}
    assert found[0.0].max_modulus == pytest.approx(1.0, abs=1e-9)
    assert found[0.0].verdict != "asymptotically_stable"
    assert found[0.03].verdict == "asymptotically_stable"
    assert found[0.03].margin > 0.1


def test_swings_die_away_in_flight_as_in_the_linear_model():
    """The flight is the model's for 16 s, in which its slowest motion dies away: late swings, too, to a hundredth."""
    scene = altered(
        strutted(0.03), rigid={"duration_s": 16.0, "tolerance": 1e-11, "output_Hz": 50.0}, flight={"fly_away_m": 1e9}
    )
    found, want = swung(scene, CALM, 1e-5)
    assert np.abs(found - want).max() < 2e-3 * np.abs(want).max()
    late = slice(-200, None)
    assert np.abs(found[late] - want[late]).max() < 1e-2 * np.abs(want[late]).max()
    assert np.abs(found[late]).max() < 0.2 * np.abs(found).max()


def test_damping_in_a_turning_sail_feeds_swings_that_are_slower_than_the_turn():
    """As friction in a shaft does beyond its critical speed (Kimball, 1924; Genta, Dynamics of Rotating Systems)."""
    lines = ring(6, 0.2, 1e3, damping_s=1e-3)
    scene = altered(FIG6, payload=[behind(1e-4, 0.3, lines)])
    still = floquet.assess(model_of(altered(FIG6, payload=[behind(1e-4, 0.3, ring(6, 0.2, 1e3))]), TABLES), [])
    turning = floquet.assess(model_of(scene, TABLES), [])
    assert still.max_modulus == pytest.approx(1.0, abs=1e-9)
    assert turning.max_modulus > 1.0 + 1e-9


@pytest.mark.parametrize(
    ("payload", "said"),
    [
        (
            [{"mass_kg": 1e-4, "position_m": [0.1, 0.0, -0.2], "tethers": ring(3, 0.2, 10.0)}],
            "must be on the sail's axis",
        ),
        ([{"mass_kg": 1e-4, "position_m": [0.0, 0.0, 0.2], "tethers": ring(3, 0.2, 10.0)}], "do not hold it there"),
        ([behind(1e-4, 0.2, ring(1, 0.2, 10.0))], "pull the sail aside"),
    ],
)
def test_what_has_no_equilibrium_is_refused(payload: list[dict[str, Any]], said: str):
    with pytest.raises(InputError, match=said):
        model_of(altered(FIG6, payload=payload), TABLES)
