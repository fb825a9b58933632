"""Cases that break integrators of rigid motion: gimbal lock, a million turns, the intermediate axis, extreme spin."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from dynamics.rigid import stage as rigid
from dynamics.sail.attitude import rotation_from_angles
from dynamics.sail.sectors import sail_shape
from dynamics.scene import schema as scene
from dynamics.scene.materials import MATERIALS
from optics.table.pressure_table import PressureTable
from tests.synthetic import smooth_tables

ROOT = Path(__file__).parents[2]
FIG6 = scene.read_scene(ROOT / "workflow" / "scenes" / "fig6.yaml")
TABLES = smooth_tables()
MIRROR = [{"from_deg": 0.0, "material": "nitride_te", "reflectance": 0.6}]
LEVEL = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0}


def altered(base: scene.Scene, **groups: Any) -> scene.Scene:
    """A scene with some keys of its groups (or whole entries) replaced."""
    data = base.model_dump()
    for name, value in groups.items():
        data[name] = {**data[name], **value} if isinstance(value, dict) else value
    return scene.Scene.model_validate(data)


def turning(omega: tuple[float, float, float]) -> np.ndarray:
    """State of motion (13,) at rest at the origin, level, with an angular velocity in rad/s."""
    return np.array([0.0] * 6 + [1.0, 0.0, 0.0, 0.0] + list(omega))


DARK = altered(FIG6, beam={"intensity_W_m2": 0.0}, rigid={"duration_s": 0.25, "tolerance": 1e-12})
DISC = altered(DARK, sail={"sectors": MIRROR})


def test_pitch_goes_through_90_degrees_without_a_jump_in_attitude():
    """A turn about the body's y axis is a turn by ωt; the angles shown fold at 90° and still name the same attitude."""
    flight = rigid.fly(altered(DARK, rigid={"output_Hz": 1000.0}), TABLES, turning((0.0, 50.0 * np.pi, 0.0)))
    angle = 50.0 * np.pi * flight.time
    want = np.array([rotation_from_angles(0.0, a, 0.0) for a in angle])
    assert np.abs(flight.rotation - want).max() < 1e-10
    roll, pitch, yaw = flight.angles
    assert np.abs(pitch).max() == pytest.approx(np.pi / 2, abs=1e-9)  # a row lies on it, at 0.01 s
    assert np.abs(rotation_from_angles(roll, pitch, yaw) - flight.rotation).max() < 1e-9


def test_a_lit_film_tumbles_through_90_degrees_and_closes_its_balances():
    lit = altered(DISC, beam={"intensity_W_m2": 1e9}, rigid={"duration_s": 0.1}, flight={"fly_away_m": 1e3})
    flight = rigid.fly(lit, {}, turning((3.0, 200.0, 100.0)))
    normal = flight.rotation[:, 2, 2]
    assert flight.end_reason == "finished"
    assert (np.diff(np.sign(normal)) != 0).sum() >= 6
    assert np.abs(flight.energy_balance).max() < 1e-10 * flight.energy_kinetic.max()
    assert np.abs(flight.momentum_balance).max() < 1e-10 * np.abs(flight.angular_momentum).max()


@pytest.mark.parametrize("turns", [2e4, pytest.param(1e6, marks=pytest.mark.slow)])
def test_a_million_turns_keep_their_count(turns: float):
    """The phase is late by less than a part in 10⁹, the attitude still a rotation, the spin the same."""
    rigid_part = {"duration_s": turns / 120.0, "tolerance": 1e-9, "output_Hz": 1e-3, "most_steps": 10**8}
    case = altered(DISC, rigid=rigid_part)
    flight = rigid.fly(case, {}, turning((0.0, 0.0, 2.0 * np.pi * 120.0)))
    assert flight.end_reason == "finished"
    whole = np.rint(flight.time * 120.0) - flight.time * 120.0
    late = (flight.angles[2] / (2.0 * np.pi) + whole + 0.5) % 1.0 - 0.5
    assert np.abs(late).max() < 1e-9 * turns
    assert np.abs(np.linalg.det(flight.rotation) - 1.0).max() < 1e-14
    assert flight.spin == pytest.approx(120.0, rel=1e-13)


def test_tumbling_about_the_intermediate_axis_follows_jacobi_s_functions():
    """Closed form of Landau & Lifshitz, Mechanics, §37, started where the turn is about the intermediate axis x."""
    middle, least, most = np.diag(sail_shape(DARK.sail).inertia)
    omega, wobble = 300.0, 0.3
    case = altered(DARK, rigid={"duration_s": 1.0, "tolerance": 1e-13})
    flight = rigid.fly(case, TABLES, turning((omega, 0.0, wobble)))
    energy, square = middle * omega**2 + most * wobble**2, (middle * omega) ** 2 + (most * wobble) ** 2
    shape = square - energy * least
    rate = np.sqrt((most - middle) * shape / (least * middle * most))
    m = (middle - least) * (energy * most - square) / ((most - middle) * shape)
    sn, cn, dn, _ = ellipj(ellipk(m) + rate * flight.time, m)
    want = np.stack(
        [
            np.sqrt((energy * most - square) / (middle * (most - middle))) * sn,
            np.sqrt((energy * most - square) / (least * (most - least))) * cn,
            np.sqrt(shape / (most * (most - least))) * dn,
        ],
        axis=1,
    )
    if np.sign(flight.angular_velocity[20, 1]) != np.sign(want[20, 1]):
        want[:, 1] *= -1.0  # x, y, z in the order of their moments are left-handed
    assert (np.diff(np.sign(want[:, 0])) != 0).sum() >= 2
    assert np.abs(flight.angular_velocity - want).max() < 1e-6 * omega


def test_a_free_lamina_wobbles_once_a_turn_in_its_own_axes_and_twice_in_the_lab():
    """ω⊥ turns with the spin in body axes because I_z = I_x + I_y, also where I_x ≠ I_y; to first order in wobble."""
    spin, wobble = 754.0, 0.05
    flight = rigid.fly(altered(DARK, rigid={"duration_s": 0.5}), TABLES, turning((wobble, 0.0, spin)))
    lateral = flight.angular_velocity[:, 0] + 1j * flight.angular_velocity[:, 1]
    assert np.abs(lateral - wobble * np.exp(1j * spin * flight.time)).max() < 1e-6 * wobble
    normal = flight.rotation[:, 0, 2] + 1j * flight.rotation[:, 1, 2]
    twice = wobble / (2.0 * spin) * (1.0 - np.exp(2j * spin * flight.time))
    assert np.abs(normal - twice).max() < 1e-6 * np.abs(twice).max()


def test_ten_kilohertz_of_spin_keep_their_phase_under_light():
    """Centred and level the light turns nothing: yaw is ωt, and the sail moves on as without spin."""
    still, fast = (
        rigid.fly(
            altered(FIG6, release={**LEVEL, "spin_Hz": spin}, rigid={"duration_s": 0.02, "tolerance": 1e-12}), TABLES
        )
        for spin in (0.0, 1e4)
    )
    phase = 2.0 * np.pi * 1e4 * fast.time
    assert np.abs(np.sin(0.5 * (fast.angles[2] - phase))).max() < 1e-7
    assert np.abs(fast.position - still.position).max() < 1e-9 * still.position[-1, 2]


def test_ten_kilohertz_of_spin_hold_a_displaced_sail_level():
    """The faster the top, the less it yields: tilt falls at least as 1/spin from 1 to 10 kHz; balances close."""
    tilts = []
    for spin in (1e3, 1e4):
        case = altered(
            FIG6,
            release={"offset_m": [0.05, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0, "spin_Hz": spin},
            rigid={"duration_s": 0.01, "output_Hz": 2e4},
        )
        flight = rigid.fly(case, TABLES)
        assert np.abs(flight.energy_balance).max() < 1e-8 * flight.energy_kinetic.max()
        tilts.append(np.hypot(*flight.rotation[:, :2, 2].T).max())
    assert 0.0 < tilts[1] < tilts[0] / 10.0


def test_a_hundredth_of_a_hertz_is_next_to_no_spin():
    """Mirror images ± f differ at first order in f, their mean from no spin at second order."""
    level = {"offset_m": [0.05, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0}
    ahead, still, back = (
        rigid.fly(altered(FIG6, release={**level, "spin_Hz": f}, rigid={"duration_s": 0.1, "tolerance": 1e-12}), TABLES)
        for f in (0.01, 0.0, -0.01)
    )
    first = np.abs(ahead.position[-1] - back.position[-1]).max()
    second = np.abs(ahead.position[-1] + back.position[-1] - 2.0 * still.position[-1]).max()
    assert 1e-8 < first < 1e-3
    assert second < 1e-2 * first


@pytest.mark.parametrize("excess", [0.0, 1e-14, 1e-9])
def test_equal_and_nearly_equal_moments_fly_as_a_symmetric_top(excess: float):
    """Nearly equal moments part from the closed form of equal ones by no more than their difference allows."""
    heavier = {**MATERIALS["nitride_te"].model_dump(), "density_kg_m3": 2700.0 * (1.0 + excess)}
    halves = [
        {"from_deg": start, "material": material, "reflectance": 0.6}
        for start, material in ((45.0, heavier), (135.0, "nitride_te"), (225.0, heavier), (315.0, "nitride_te"))
    ]
    omega = np.array([300.0, -120.0, 754.0])
    flight = rigid.fly(altered(DARK, sail={"sectors": halves}), {}, turning(tuple(omega)))
    inertia = np.diag(flight.inertia)
    assert abs(inertia[0] / inertia[1] - 1.0) < 2.0 * excess + 1e-15
    free = (inertia[2] / inertia[0] - 1.0) * omega[2] * flight.time
    want = (omega[0] + 1j * omega[1]) * np.exp(1j * free)
    got = flight.angular_velocity[:, 0] + 1j * flight.angular_velocity[:, 1]
    assert np.abs(got - want).max() < (1e-9 + 200.0 * excess) * np.abs(omega).max()


def test_no_light_at_all_does_no_work():
    case = altered(DARK, release={"offset_m": [0.3, -0.2], "pitch_deg": 80.0, "roll_deg": -60.0, "spin_Hz": -120.0})
    flight = rigid.fly(case, TABLES)
    assert flight.end_reason == "finished"
    assert not flight.work.any()
    assert not flight.angular_impulse.any()
    assert np.abs(flight.position - flight.position[0]).max() == 0.0
    momentum = flight.angular_momentum
    assert np.abs(momentum - momentum[0]).max() < 1e-11 * np.linalg.norm(momentum[0])


def kinked_tables() -> dict[str, PressureTable]:
    """The synthetic tables with |u| added to q, its kink as sharp as a billionth, on the equilibrium itself."""
    tables = {}
    for name, table in TABLES.items():
        u = np.sort(np.concatenate([table.u[table.u != 0.0], [-1e-9, 0.0, 1e-9]]))
        uu, vv = np.meshgrid(u, table.v, indexing="ij")
        q = np.moveaxis(table.q(uu, vv), -1, 0)
        q[[0, 2]] += 0.3 * np.abs(uu)
        flat = np.zeros_like(uu)
        tables[name] = PressureTable(u, table.v, q, flat, flat + 1e-6, mirror_v=True, attrs=table.attrs)
    return tables


def test_a_kink_at_the_equilibrium_is_flown_to_the_tolerance():
    """Twice a turn the sail crosses the kink, each time at a cost of about the tolerance; the path converges."""
    tables = kinked_tables()
    release = {"offset_m": [0.01, 0.01], "pitch_deg": 0.2, "roll_deg": 0.2}
    case = altered(FIG6, release=release, rigid={"duration_s": 0.1})
    flights = {
        tolerance: rigid.fly(altered(case, rigid={"tolerance": tolerance}), tables)
        for tolerance in (1e-8, 1e-9, 1e-10, 1e-11, 1e-13)
    }
    best = flights.pop(1e-13)
    assert (np.diff(np.sign(best.rotation[:, 2, 0])) != 0).sum() > 10
    for tolerance, flight in flights.items():
        assert flight.end_reason == "finished"
        assert np.abs(flight.energy_balance).max() < 10.0 * tolerance * flight.energy_kinetic.max()
        assert np.abs(flight.position - best.position).max() < 2e4 * tolerance
