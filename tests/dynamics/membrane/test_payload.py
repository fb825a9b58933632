"""Point masses on tethers to flexible sails."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.membrane.flight import Flight, fly
from tests.membranes import dark, film, small, steps
from tests.payloads import behind, ring


def test_a_pendulum_on_a_held_node_swings_and_pulls_as_it_should():
    """ω = √(g/ℓ) and T = m g (1 + θ₀² …) of a small swing from 2° (Landau & Lifshitz, Mechanics, §11)."""
    length, gravity, mass, angle = 0.1, 1000.0, 1e-4, np.radians(2.0)
    place = [length * float(np.sin(angle)), 0.0, -length * float(np.cos(angle))]
    tether = {"to_m": [0.0, 0.0], "stiffness_N_m": 1e4, "length_m": length}
    scene = dark(
        rings=2,
        held={"rim": "clamped", "parts": [{"at_m": [0.0, 0.0]}], "gravity_m_s2": [0.0, 0.0, -gravity]},
        payload=[{"mass_kg": mass, "position_m": place, "tethers": [tether]}],
        flight={"duration_s": 0.13, "series_every": 4},
    )
    _, _, columns = fly(scene, {})
    t, x, tension = columns["time"], columns["payload_position"][:, 0], columns["tether_tension"][:, 0]
    zero = np.flatnonzero(x[:-1] * x[1:] < 0.0)
    crossing = t[zero] - x[zero] * (t[zero + 1] - t[zero]) / (x[zero + 1] - x[zero])
    period = 2.0 * np.pi * np.sqrt(length / gravity) * (1.0 + angle**2 / 16.0)
    assert 2.0 * np.diff(crossing) == pytest.approx(period, rel=1e-3)
    # Taut from slack: it bobs about m g (3 cos θ − 2 cos θ₀) with the amplitude of its own stretch
    assert tension.mean() == pytest.approx(mass * gravity * (1.0 + angle**2 / 4.0), rel=1e-2)


def test_a_mass_on_damped_struts_within_its_sail_dies_down():
    """s̈ + (K τ/μ) ṡ + (K/μ) s = 0 of its way s from the sail's middle: K = Σ k cos², μ the reduced mass.

    The film is 2e4 times as stiff as the struts, which turn by (s/ℓ)² of their force.
    """
    mass, each, delay, aside = 1e-4, 5.0, 2e-3, 1e-3
    struts = ring(4, 0.3, each, damping_s=delay, length_m=0.3, pushes=True)
    scene = dark(
        rings=3,
        payload=[{"mass_kg": mass, "position_m": [aside, 0.0, 0.0], "tethers": struts}],
        flight={"duration_s": 3e-2, "series_every": 16},
    )
    flight, _, columns = fly(scene, {})
    found = columns["payload_position"][:, 0] - columns["position"][:, 0]
    sail = float(flight.model.masses.sum())
    stiffness, reduced = 2.0 * each, sail * mass / (sail + mass)
    rate, lasted = 0.5 * stiffness * delay / reduced, columns["time"] + flight.model.release * flight.model.dt
    omega = np.sqrt(stiffness / reduced - rate**2)
    want = aside * np.exp(-rate * lasted) * (np.cos(omega * lasted) + rate / omega * np.sin(omega * lasted))
    assert np.abs(found - want).max() < 1e-3 * aside
    assert np.abs(want[-1]) < 0.1 * aside


def towed_flight(folder: Path, **more: float) -> Flight:
    """A turning, lit sail that tows two masses on tethers, one of them slack at first, after some hundred steps."""
    payload = [
        behind(1e-4, 0.3, ring(3, 0.31, 2e3, damping_s=1e-6, **more)),
        {
            "mass_kg": 5e-5,
            "position_m": [0.1, -0.05, -0.2],
            "tethers": [
                {"to_m": [0.13, 0.02], "stiffness_N_m": 500.0, "length_m": 0.2002},
                {"to_m": [-0.2, 0.11], "stiffness_N_m": 800.0, "pushes": True},
            ],
        },
    ]
    sail = {"sectors": film(emissivity_front=0.0, emissivity_back=0.0, absorptance=0.0)}
    flight = Flight(small(rings=4, sail=sail, payload=payload, beam={"radius_m": 0.5}), {}, folder)
    flight.step = flight.model.release
    flight.state.v[0], flight.state.v[1] = -300.0 * flight.state.x[1], 300.0 * flight.state.x[0]
    flight.work.effects.tethers.v[2] = -30.0
    return flight


def totals(flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Momentum and angular momentum (3,) about the origin of sail and payload."""
    mass = np.concatenate([flight.model.masses, flight.model.effects.tethers.mass])
    x = np.concatenate([flight.state.x, flight.work.effects.tethers.x], axis=1)
    v = np.concatenate([flight.state.v, flight.work.effects.tethers.v], axis=1)
    return v @ mass, np.cross(x, v, axis=0) @ mass


def test_momentum_of_sail_and_payload_is_that_of_the_light(tmp_path: Path):
    flight = towed_flight(tmp_path)
    before = totals(flight)[0]
    steps(flight, 400)
    scale = np.abs(flight.state.v) @ flight.model.masses
    gained = totals(flight)[0] - before
    assert np.abs(gained - flight.state.impulse).max() < 1e-12 * scale.max()
    assert np.abs(flight.work.effects.tethers.tension).max() > 0.1


def test_tethers_turn_nothing_as_a_whole(tmp_path: Path):
    """In the dark angular momentum stays, with damping, slack and a strut."""
    flight = towed_flight(tmp_path)
    flight.model = flight.model._replace(lit=False)
    before = totals(flight)
    steps(flight, 400)
    after = totals(flight)
    scale = np.abs(np.cross(flight.state.x, flight.state.v, axis=0)) @ flight.model.masses
    assert np.abs(after[1] - before[1]).max() < 1e-12 * scale.max()
    assert np.abs(after[0] - before[0]).max() < 1e-12 * (np.abs(flight.state.v) @ flight.model.masses).max()


def test_a_tether_snaps_at_its_strength_and_for_ever(tmp_path: Path):
    flight = towed_flight(tmp_path, strength_N=0.05)
    steps(flight, 400)
    assert flight.work.effects.tethers.snapped.tolist() == [1, 1, 1, 0, 0]
    assert np.all(flight.work.effects.tethers.tension[:3] == 0.0)


def test_a_flight_with_payload_goes_on_to_the_same_bits(tmp_path: Path):
    """Its masses are part of the checkpoint, and of the file's columns."""
    scene = small(
        rings=3,
        sail={"sectors": film()},
        payload=[behind(1e-4, 0.2, ring(2, 0.2, 100.0))],
        flight={"duration_s": 5e-4, "snapshot_every_s": 1e-4},
    )
    flight, end, columns = fly(scene, {})
    assert end.reason == "finished"
    assert columns["payload_position"].shape[1] == 3
    assert columns["tether_tension"].shape[1] == columns["tethers_snapped"].shape[1] == 2
    first = Flight(scene, {}, tmp_path)
    for _ in range(6):
        first.advance()
    first.checkpoint()
    again = Flight(scene, {}, tmp_path)
    assert again.resume()
    assert again.step == first.step > 0
    again.fly()
    assert np.array_equal(again.work.effects.tethers.x, flight.work.effects.tethers.x)
    assert np.array_equal(again.state.x, flight.state.x)


def test_a_payload_spins_up_and_is_released_with_its_sail(tmp_path: Path):
    """On a strut within the plane, as if it were a part of the sail."""
    scene = small(
        rings=4,
        sail={"sectors": film()},
        flight={"duration_s": 1e-5, "spin_up_s": 2e-3},
        release={"offset_m": [0.1, 0.0], "pitch_deg": 5.0, "roll_deg": 0.0, "spin_Hz": 20.0},
        payload=[{"mass_kg": 1e-6, "position_m": [0.2, 0.1, 0.0], "tethers": ring(3, 0.3, 500.0, pushes=True)}],
    )
    flight, _, _ = fly(scene, {})
    pitch = np.radians(5.0)
    want = [0.1 + 0.2 * np.cos(pitch), 0.1, -0.2 * np.sin(pitch)]
    assert flight.work.effects.tethers.x[:, 0] == pytest.approx(want, abs=2e-3)
    omega = 2.0 * np.pi * 20.0 * np.array([np.sin(pitch), 0.0, np.cos(pitch)])
    arm = flight.work.effects.tethers.x[:, 0] - [0.1, 0.0, 0.0]
    assert flight.work.effects.tethers.v[:, 0] == pytest.approx(np.cross(omega, arm), abs=0.3)


def test_what_cannot_fly_is_refused(tmp_path: Path):
    beside = [behind(1e-4, 0.2, [{"to_m": [0.6, 0.0], "stiffness_N_m": 1.0}])]
    with pytest.raises(InputError, match=r"tether to_m = \[0.6, 0.0\]: must be on the sail's mesh"):
        Flight(dark(rings=3, payload=beside), {}, tmp_path)
    line = [behind(1e-4, 0.2, ring(1, 0.0, 1.0))]
    with pytest.raises(InputError, match="must be verlet or semi_implicit_euler with payload"):
        Flight(dark(rings=3, payload=line, flight={"integrator": "rk4"}), {}, tmp_path)


def test_stiff_tethers_shorten_the_time_step(tmp_path: Path):
    plain = Flight(dark(rings=3), {}, tmp_path).model.dt
    tied = Flight(dark(rings=3, payload=[behind(1e-9, 0.2, ring(1, 0.0, 1e6))]), {}, tmp_path).model.dt
    assert tied == pytest.approx(1.6 / np.sqrt(1e6 / 1e-9), rel=0.02)
    assert tied < 0.1 * plain
