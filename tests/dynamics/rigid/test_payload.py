"""Point masses on tethers to rigid sails: closed forms and conserved quantities."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.rigid.body import rigid_body
from dynamics.rigid.stage import RigidFlight, fly
from dynamics.scene.schema import Scene
from tests.membranes import FIG6, altered, film
from tests.payloads import STILL, behind, ring
from tests.synthetic import smooth_tables

TABLES = smooth_tables()
CROWD = [
    behind(1e-4, 0.3, ring(3, 0.31, 400.0)),
    {
        "mass_kg": 5e-5,
        "position_m": [0.1, -0.05, -0.2],
        "tethers": [
            {"to_m": [0.13, 0.02], "stiffness_N_m": 50.0, "length_m": 0.202},
            {"to_m": [-0.2, 0.11], "stiffness_N_m": 80.0, "pushes": True},
        ],
    },
]


def black(payload: list[dict[str, Any]], **groups: Any) -> Scene:
    """An absorbing disc in light that is the same everywhere: pushed along the beam, whatever its tilt."""
    sail = {"sectors": film(absorptance=1.0, reflectance=0.0)}
    beam = {"intensity_W_m2": 1e8, "radius_m": 1e4, "rise_s": 0.0, "on_s": 10.0}
    return altered(FIG6, **{"sail": sail, "beam": beam, "release": STILL, "payload": payload, **groups})


def momentum(flight: RigidFlight) -> np.ndarray:
    """Momentum (n, 3) of sail and payload."""
    assert flight.payload is not None
    return flight.mass * flight.velocity + np.einsum("b,nbi->ni", flight.payload.mass, flight.payload.velocity)


def test_two_bodies_turn_about_each_other_on_their_tether():
    """T = μ ω² ℓ with the reduced mass μ: a constant tension on a circle (Landau & Lifshitz, Mechanics, §13)."""
    mass, length, stiffness, omega = 2e-4, 0.4, 1e3, 50.0
    plain = altered(FIG6, beam={"intensity_W_m2": 0.0}, release=STILL)
    sail = rigid_body(plain, TABLES, quadrature=None).shape.mass
    want = sail * mass / (sail + mass) * omega**2 * length
    tether = [{"to_m": [0.0, 0.0], "stiffness_N_m": stiffness, "length_m": length - want / stiffness}]
    scene = altered(plain, payload=[behind(mass, length, tether)], rigid={"duration_s": 0.2, "tolerance": 1e-12})
    start = np.zeros(13)
    start[6], start[10] = 1.0, omega
    flight = fly(scene, TABLES, start)
    assert flight.payload is not None
    assert flight.payload.tension[:, 0] == pytest.approx(want, rel=1e-8)
    assert flight.payload.position[:, 0, 1] - flight.position[:, 1] == pytest.approx(
        length * np.sin(omega * flight.time), abs=1e-8
    )


def test_a_towed_mass_swings_as_a_pendulum_behind_its_sail():
    """ω² = F/(M ℓ) and T = m F/(M + m), of a sail of mass M under a force F with a mass m on a line of length ℓ."""
    mass, length, aside = 1e-4, 0.5, 1e-4
    tether = [{"to_m": [0.0, 0.0], "stiffness_N_m": 2e3, "damping_s": 2e-4}]
    payload = [{**behind(mass, length, tether), "position_m": [aside, 0.0, -length]}]
    scene = black(payload, rigid={"duration_s": 0.5, "tolerance": 1e-12}, flight={"fly_away_m": 1e9})
    flight = fly(scene, {})
    assert flight.payload is not None
    force = 1e8 * np.pi * 0.25 / LIGHT_SPEED
    tension = mass * force / (flight.mass + mass)
    late = flight.time > 0.1
    # The steps resolve the stiff, damped line; longer ones, at a looser tolerance, leave it at the edge of stability
    assert flight.payload.tension[late, 0] == pytest.approx(tension, rel=1e-6)
    x, t = flight.payload.position[:, 0, 0] - flight.position[:, 0], flight.time
    zero = np.flatnonzero((x[:-1] * x[1:] < 0.0) & late[1:])
    crossing = t[zero] - x[zero] * (t[zero + 1] - t[zero]) / (x[zero + 1] - x[zero])
    stretched = length + tension / 2e3
    assert np.pi / np.diff(crossing) == pytest.approx(np.sqrt(force / (flight.mass * stretched)), rel=1e-6)


def test_momentum_and_energy_of_sail_and_payload_are_kept():
    """In the dark momentum to 1e-12, energy as the tolerance allows; the light's work is what both gain."""
    scene = altered(FIG6, payload=CROWD, beam={"intensity_W_m2": 0.0}, rigid={"duration_s": 0.05, "tolerance": 1e-12})
    start = np.zeros(13)
    start[6], start[3:6], start[10:13] = 1.0, [0.3, -0.1, 0.5], [3.0, -2.0, 60.0]
    flight = fly(scene, TABLES, start)
    assert flight.payload is not None
    scale = np.abs(flight.payload.mass @ np.linalg.norm(flight.payload.velocity, axis=2).T).max()
    assert np.abs(momentum(flight) - momentum(flight)[0]).max() < 1e-12 * scale
    for lit in (flight, fly(altered(scene, beam={"intensity_W_m2": 1e8}), TABLES, start)):
        assert lit.payload is not None
        energy = lit.energy_kinetic + lit.payload.energy_kinetic + lit.payload.energy_elastic
        assert np.abs(energy - energy[0] - lit.work).max() < 1e-8 * energy.max()


def test_a_tether_snaps_where_it_reaches_its_strength():
    """Then the mass flies on straight, and nothing pulls the sail aside any more."""
    tether = [{"to_m": [0.0, 0.0], "stiffness_N_m": 100.0, "strength_N": 0.02}]
    scene = black([behind(1e-4, 0.5, tether)], rigid={"duration_s": 0.05, "output_Hz": 1e5, "tolerance": 1e-11})
    flight = fly(scene, {})
    assert flight.payload is not None
    gone = flight.payload.snapped[:, 0] == 1.0
    first = int(np.argmax(gone))
    assert 0 < first < len(gone) - 10
    assert np.all(gone[first:])
    assert np.all(flight.payload.tension[gone] == 0.0)
    assert 0.0199 < flight.payload.tension.max() <= 0.02 * (1.0 + 1e-9)
    assert np.ptp(flight.payload.velocity[gone], axis=0).max() < 1e-15
    force = 1e8 * np.pi * 0.25 / LIGHT_SPEED
    rate = np.diff(flight.velocity[gone, 2]) / np.diff(flight.time[gone])
    assert rate == pytest.approx(force / flight.mass, rel=1e-6)


def test_what_a_rigid_sail_cannot_be_is_refused():
    with pytest.raises(InputError, match="held: must be left out"):
        rigid_body(altered(FIG6, release=STILL, held={"rim": "clamped"}), TABLES, quadrature=None)
    line = [{"to_m": [0.0, 0.6], "stiffness_N_m": 1.0}]
    with pytest.raises(InputError, match=r"to_m = \[0.0, 0.6\]: must be at most 0.5 m away"):
        rigid_body(altered(FIG6, payload=[behind(1e-4, 0.1, line)]), TABLES, quadrature=None)


def test_a_payload_that_is_off_changes_no_bit():
    plain = altered(FIG6, rigid={"duration_s": 0.02})
    off = altered(plain, payload=CROWD, effects={"payload": False})
    one, other = fly(off, TABLES), fly(plain, TABLES)
    for name in ("position", "velocity", "quaternion", "angular_velocity", "work", "angular_impulse"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    assert one.payload is None
