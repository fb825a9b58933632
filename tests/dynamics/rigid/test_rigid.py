"""Rigid flight: free rotation, conservation, symmetry, closed forms of light pressure, reasons to end."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from beamrider.io.files import InputError, run_stage
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.rigid import stage as rigid
from dynamics.rigid.body import rigid_body
from dynamics.sail.attitude import rotation_from_angles, rotation_from_quaternion
from dynamics.sail.sectors import sail_shape
from dynamics.scene import schema as scene
from optics.table.pressure_table import PressureTable
from tests.synthetic import smooth_tables

ROOT = Path(__file__).parents[3]
FIG6 = scene.read_scene(ROOT / "workflow" / "scenes" / "fig6.yaml")
TABLES = smooth_tables()
MIRROR = [{"from_deg": 0.0, "material": "nitride_te", "reflectance": 0.6}]


def altered(base: scene.Scene, **groups: Any) -> scene.Scene:
    """A scene with some keys of its groups (or whole entries) replaced."""
    data = base.model_dump()
    for name, value in groups.items():
        data[name] = {**data[name], **value} if isinstance(value, dict) else value
    return scene.Scene.model_validate(data)


def started(spin_rad_s: float, wobble: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """State at rest at the origin, level, turning about its normal and wobbling."""
    return np.array([0.0] * 6 + [1.0, 0.0, 0.0, 0.0] + [*wobble, spin_rad_s])


DARK = altered(FIG6, beam={"intensity_W_m2": 0.0}, rigid={"duration_s": 0.25, "tolerance": 1e-12})
DISC = altered(DARK, sail={"sectors": MIRROR})


# Without light


def test_free_disc_precesses_as_the_closed_form_says():
    """Symmetric top: Q(t) = exp(L t/I₁) exp(ω_z (1 − I₃/I₁) t ẑ); a disc has I₃ = 2 I₁."""
    omega = np.array([30.0, -12.0, 754.0])
    flight = rigid.fly(DISC, {}, started(omega[2], (omega[0], omega[1])))
    turn = rotation_from_quaternion(flight.quaternion)
    momentum = omega * [1.0, 1.0, 2.0]
    for t, got in zip(flight.time[::50], turn[::50], strict=True):
        want = about(momentum, t) @ about(np.array([0.0, 0.0, -omega[2]]), t)
        assert np.allclose(got, want, atol=1e-8)


def about(vector: np.ndarray, t: float) -> np.ndarray:
    """Rotation by |vector| t about a vector (Rodrigues)."""
    angle = np.linalg.norm(vector) * t
    x, y, z = vector / np.linalg.norm(vector)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def test_free_lamina_nutates_at_twice_its_spin():
    case = altered(DARK, rigid={"duration_s": 0.5, "output_Hz": 4096.0})
    flight = rigid.fly(case, TABLES, started(754.0, (1.0, 0.0)))
    normal = rotation_from_quaternion(flight.quaternion)[:, :, 2]
    path = (normal[:, 0] + 1j * normal[:, 1])[:-1]
    spectrum = np.abs(np.fft.fft((path - path.mean()) * np.hanning(path.size), 1 << 16))
    frequency = np.fft.fftfreq(1 << 16, 1 / 4096.0)[spectrum.argmax()]
    assert frequency == pytest.approx(2 * 754.0 / (2 * np.pi), rel=1e-3)


def test_free_flight_conserves_energy_and_momentum_about_all_three_axes():
    flight = rigid.fly(DARK, TABLES, started(300.0, (200.0, -350.0)))
    momentum = flight.angular_momentum
    assert np.abs(momentum - momentum[0]).max() < 1e-10 * np.linalg.norm(momentum[0])
    assert np.abs(flight.energy_kinetic / flight.energy_kinetic[0] - 1).max() < 1e-10
    assert not flight.work.any()
    assert not flight.angular_impulse.any()


def test_dark_sail_drifts_straight_on():
    start = started(754.0)
    start[:6] = [0.1, -0.2, 0.0, 0.3, 0.4, 5.0]
    flight = rigid.fly(DARK, TABLES, start)
    assert np.allclose(flight.velocity, start[3:6], atol=1e-12)
    assert np.allclose(flight.position, start[:3] + flight.time[:, None] * start[3:6], atol=1e-10)


def test_quaternion_stays_a_unit():
    flight = rigid.fly(altered(FIG6, rigid={"duration_s": 0.05}), TABLES)
    assert np.allclose(np.linalg.norm(flight.quaternion, axis=1), 1.0, atol=1e-15)


# Light on a mirror: closed forms


def test_wide_beam_drives_a_disc_by_its_reflectance_and_absorptance():
    """F = (I A/c)(2R + a) along the beam; the ramp costs half its length."""
    level = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0}
    wide = {"intensity_W_m2": 1e9, "radius_m": 1e6}
    lit = altered(DISC, beam=wide, release=level, rigid={"duration_s": 0.01})
    flight = rigid.fly(lit, {})
    push = 1e9 / LIGHT_SPEED * np.pi * 0.25 * (2 * 0.6 + 9.448e-6) / sail_shape(lit.sail).mass
    assert flight.velocity[-1] == pytest.approx([0.0, 0.0, push * (0.01 - 0.5e-6)], rel=1e-9, abs=1e-12)
    assert flight.end_reason == "finished"


def test_tilted_mirror_is_pushed_along_its_normal_by_the_square_of_the_cosine():
    lit = altered(DISC, beam={"intensity_W_m2": 1e9, "radius_m": 1e6})
    turn = rotation_from_angles(0.2, 0.5, 1.0)
    force, torque, _ = rigid_body(lit, {}).load(np.zeros(3), turn)
    n = turn[:, 2]
    want = 1e9 / LIGHT_SPEED * np.pi * 0.25 * n[2] * (2 * 0.6 * n[2] * n + 9.448e-6 * np.array([0, 0, 1]))
    assert np.allclose(force, want, rtol=1e-10, atol=1e-12)
    assert np.abs(torque).max() < 1e-9


def test_light_from_behind_pushes_a_mirror_on_too():
    lit = altered(DISC, beam={"intensity_W_m2": 1e9, "radius_m": 1e6})
    body = rigid_body(lit, {})
    front, back = (body.load(np.zeros(3), rotation_from_angles(roll, 0.0, 0.0))[0] for roll in (0.3, np.pi + 0.3))
    assert np.allclose(front, back, rtol=1e-12)


def test_short_pulse_late_in_the_flight_is_not_stepped_over():
    pulse = {"intensity_W_m2": 1e9, "radius_m": 1e6, "delay_s": 0.2, "rise_s": 1e-6, "on_s": 1e-6}
    level = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0, "spin_Hz": 0.0}
    flight = rigid.fly(altered(DISC, beam=pulse, release=level), {})
    push = 1e9 / LIGHT_SPEED * np.pi * 0.25 * (2 * 0.6 + 9.448e-6) / sail_shape(DISC.sail).mass
    assert flight.velocity[-1, 2] == pytest.approx(push * 2e-6, rel=1e-9)


# Symmetry of the four-sector sail


def load(body: Any, x: float, y: float, roll: float, pitch: float, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Force in the lab and torque in the lab."""
    turn = rotation_from_angles(roll, pitch, yaw)
    force, torque, _ = body.load(np.array([x, y, 0.0]), turn)
    return force, turn @ torque


def test_turning_everything_turns_the_force_with_true_incidence():
    """The beam is round: a sail displaced, tilted and yawed by the same turn about the axis feels the turned force."""
    body, blind = rigid_body(FIG6, TABLES), rigid_body(altered(FIG6, incidence="yaw_blind"), TABLES)
    turn = rotation_from_angles(0.1, -0.05, 0.3)
    about_z = rotation_from_angles(0.0, 0.0, 0.7)
    position = np.array([0.06, -0.02, 0.0])
    force, torque, _ = body.load(position, turn)
    turned, same, _ = body.load(about_z @ position, about_z @ turn)
    assert np.allclose(turned, about_z @ force, atol=1e-12 * abs(force[2]))
    assert np.allclose(same, torque, atol=1e-12)
    wrong = blind.load(about_z @ position, about_z @ turn)[0]
    assert np.abs(wrong - about_z @ blind.load(position, turn)[0]).max() > 1e-3 * abs(force[2])


def test_incidence_models_agree_while_the_yaw_is_zero_and_differ_otherwise():
    body, blind = rigid_body(FIG6, TABLES), rigid_body(altered(FIG6, incidence="yaw_blind"), TABLES)
    for yaw, least in ((0.0, 0.0), (0.8, 1e-3)):
        a, b = (load(which, 0.05, 0.02, 0.04, -0.06, yaw)[0] for which in (body, blind))
        gap = np.abs(a - b).max() / a[2]
        assert gap < 1e-13 if least == 0.0 else gap > least


@pytest.mark.parametrize("incidence", ["sail_frame", "yaw_blind"])
def test_force_is_odd_in_displacement_and_tilt_together(incidence: str):
    body = rigid_body(altered(FIG6, incidence=incidence), TABLES)
    (fx, fy, fz), torque = load(body, 0.05, 0.03, 0.02, 0.04, 0.0)
    (gx, gy, gz), opposite = load(body, -0.05, -0.03, -0.02, -0.04, 0.0)
    assert np.allclose([gx, gy, gz], [-fx, -fy, fz], atol=1e-12)
    assert np.allclose(opposite, [-torque[0], -torque[1], torque[2]], atol=1e-12)


def test_displaced_sail_is_pushed_back_and_only_back():
    body = rigid_body(FIG6, TABLES)
    force, torque = load(body, 0.05, 0.0, 0.0, 0.0, 0.0)
    assert force[0] < 0
    assert abs(force[1]) < 1e-14
    assert np.abs(torque[[0, 2]]).max() < 1e-14


@pytest.mark.parametrize("incidence", ["sail_frame", "yaw_blind"])
def test_opposite_spin_flies_the_mirror_image(incidence: str):
    """The sail is its own mirror image in the xz plane; the mirror turns y, roll, yaw and spin round."""
    flights = []
    for sign in (1.0, -1.0):
        release = {"offset_m": [0.05, sign * 0.03], "pitch_deg": 2.0, "roll_deg": sign * 1.0, "spin_Hz": sign * -120.0}
        case = altered(FIG6, incidence=incidence, release=release, rigid={"duration_s": 0.05, "tolerance": 1e-11})
        flights.append(rigid.fly(case, TABLES))
    one, two = flights
    assert np.allclose(one.position, two.position * [1, -1, 1], atol=1e-9)
    assert np.allclose(np.sin(one.angles), np.sin(two.angles) * np.array([[-1], [1], [-1]]), atol=1e-8)
    assert np.allclose(one.angular_velocity, two.angular_velocity * [-1, 1, -1], atol=1e-6)


# Polarisation of the beam


def stokes_tables() -> dict[str, PressureTable]:
    """The synthetic tables with a response to all polarisations whose value for the cell's own is theirs."""
    tables = {}
    for (name, table), sign in zip(TABLES.items(), (1.0, -1.0), strict=True):
        q = np.zeros((4, *table.q_nodes.shape))
        q[0], q[1], q[2, 1] = 0.8 * table.q_nodes, 0.2 * sign * table.q_nodes, 0.05
        tables[name] = replace(table, q_stokes=q, absorptance_stokes=np.zeros((4, *q.shape[2:])))
    return tables


def polarised(kind: str, degrees: float, rate: float = 0.0) -> scene.Scene:
    return altered(FIG6, beam={"polarisation": kind, "polarisation_deg": degrees, "polarisation_Hz": rate})


@pytest.mark.parametrize("yaw", [0.0, 0.4, 2.9])
def test_polarisation_along_the_sail_s_own_is_that_locked_to_it(yaw: float):
    """TE cells have E along r, TM cells along g: body y in all sectors. Half a turn of the polarisation is none."""
    turn, place, tables = rotation_from_angles(0.0, 0.0, yaw), np.array([0.05, 0.02, 0.0]), stokes_tables()
    want = np.concatenate(rigid_body(FIG6, TABLES).load(place, turn)[:2])
    for degrees in (90.0 + np.degrees(yaw), np.degrees(yaw) - 90.0):
        got = np.concatenate(rigid_body(polarised("lab", degrees), tables).load(place, turn)[:2])
        assert np.allclose(got, want, atol=1e-12)
    turned = rigid_body(polarised("turning", 90.0, 10.0), tables)
    got = np.concatenate(turned.load(place, turn, time=yaw / (20.0 * np.pi))[:2])
    assert np.allclose(got, want, atol=1e-12)


def test_a_lamellar_sail_level_on_the_axis_has_no_spin_torque_whatever_the_polarisation():
    """Ridges alike all along take no momentum along themselves (q_r = v a); the push along g goes through the axis."""
    tables = {
        name: replace(table, q_stokes=table.q_stokes * np.array([1.0, 0.0, 1.0])[:, None, None])
        for name, table in stokes_tables().items()
    }
    for degrees in (0.0, 20.0, 45.0, 77.0):
        force, torque, _ = rigid_body(polarised("lab", degrees), tables).load(np.zeros(3), np.eye(3))
        assert abs(torque[2]) < 1e-13 * force[2]


def test_a_polarisation_of_its_own_needs_tables_that_know_it():
    with pytest.raises(InputError, match=r"beam.polarisation = 'lab': table 'mark1e_te' lacks the Stokes response"):
        rigid.fly(polarised("lab", 0.0), TABLES)
    with pytest.raises(ValueError, match="needs polarisation: turning"):
        polarised("lab", 0.0, 3.0)


# Accuracy and bookkeeping


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9, 1e-12])
def test_energy_and_angular_momentum_gained_are_what_the_light_gave(tolerance: float):
    """Both balances, integrated independently of the motion, close as well as the tolerance asks."""
    flight = rigid.fly(altered(FIG6, rigid={"duration_s": 0.2, "tolerance": tolerance}), TABLES)
    assert np.abs(flight.energy_balance).max() < 30 * tolerance * flight.energy_kinetic[-1]
    assert np.abs(flight.momentum_balance).max() < 30 * tolerance * np.abs(flight.angular_momentum).max()
    assert flight.work[-1] > 0.05 * flight.energy_kinetic[-1]
    assert np.abs(flight.angular_impulse[-1]).max() > 1e-4 * np.abs(flight.angular_momentum).max()


def test_error_follows_the_tolerance():
    ends = {
        tolerance: rigid.fly(altered(FIG6, rigid={"duration_s": 0.1, "tolerance": tolerance}), TABLES).position[-1]
        for tolerance in (1e-6, 1e-9, 1e-12)
    }
    coarse, fine = (np.abs(ends[tolerance] - ends[1e-12]).max() for tolerance in (1e-6, 1e-9))
    assert fine < 1e-7
    assert fine < 1e-2 * coarse < 1e-4


def test_rows_do_not_depend_on_how_many_are_asked_for():
    few, many = (
        rigid.fly(altered(FIG6, rigid={"duration_s": 0.02, "output_Hz": rate}), TABLES) for rate in (100.0, 3000.0)
    )
    assert few.time.tolist() == pytest.approx([0.0, 0.01, 0.02])
    assert many.time.size == 61
    assert np.array_equal(few.position[-1], many.position[-1])
    assert np.allclose(few.position[1], many.position[30], atol=1e-15)


def test_duration_between_two_rows_is_flown_to_its_end():
    flight = rigid.fly(altered(FIG6, rigid={"duration_s": 0.0205, "output_Hz": 100.0}), TABLES)
    assert flight.time.tolist() == pytest.approx([0.0, 0.01, 0.02, 0.0205])


# Reasons to end


def test_flight_ends_at_the_edge_of_the_table_or_clamps_and_counts():
    narrow = smooth_tables(u_max=0.04)
    case = altered(FIG6, rigid={"duration_s": 0.05})
    stopped = rigid.fly(case, narrow)
    clamped = rigid.fly(altered(case, outside_table="clamp"), narrow)
    k = rotation_from_quaternion(stopped.quaternion)[-1, 2]
    assert stopped.end_reason == "left_table"
    assert 0 < stopped.time[-1] < 0.05
    assert np.abs(k[:2]).max() == pytest.approx(0.04, abs=1e-9)
    assert clamped.end_reason == "finished"
    assert clamped.clamped_steps > 0
    assert stopped.clamped_steps <= 1


def test_tilt_outside_the_table_at_release_ends_at_once():
    flight = rigid.fly(altered(FIG6, release={"pitch_deg": 10.0}), smooth_tables(u_max=0.1))
    assert flight.end_reason == "left_table"
    assert flight.time[-1] < 1e-12


def test_fly_away_ends_at_its_limit():
    flight = rigid.fly(altered(FIG6, flight={"fly_away_m": 0.5}, rigid={"duration_s": 1.0}), smooth_tables(sign=-1.0))
    assert flight.end_reason == "fly_away"
    assert np.hypot(*flight.position[-1, :2]) == pytest.approx(0.5, abs=1e-9)


def test_grating_that_turns_its_back_to_the_light_ends_its_flight():
    case = altered(FIG6, outside_table="clamp", release={"spin_Hz": 0.0}, rigid={"duration_s": 1.0})
    flight = rigid.fly(case, TABLES, started(0.0, (20.0, 0.0)))
    roll = flight.angles[0]
    assert flight.end_reason == "turned_over"
    assert abs(roll[-1]) == pytest.approx(np.pi / 2, abs=1e-12)


def test_the_edge_of_a_table_is_met_to_rounding():
    flight = rigid.fly(altered(FIG6, rigid={"duration_s": 0.05}), smooth_tables(u_max=0.04))
    assert flight.end_reason == "left_table"
    assert np.abs(flight.rotation[-1, 2, :2]).max() == pytest.approx(0.04, abs=1e-13)


def test_numbers_that_are_not_finite_end_the_flight_and_say_where():
    start = started(754.0)
    start[3] = np.inf
    flight = rigid.fly(FIG6, TABLES, start)
    assert flight.end_reason == "non_finite"
    assert flight.end_place.startswith("rate of position x not finite, t = 0 s")


def test_numbers_that_turn_bad_in_flight_end_it_with_the_last_good_state():
    """A table too large for its interpolation, on which the light falls from 0.02 s on."""
    bad = {name: replace(table, q_nodes=1e307 * table.q_nodes) for name, table in TABLES.items()}
    flight = rigid.fly(altered(FIG6, beam={"delay_s": 0.02}, rigid={"duration_s": 0.1}), bad)
    assert flight.end_reason == "non_finite"
    assert flight.end_place.startswith("rate of velocity x not finite, t = 0.02")
    assert flight.time[-1] == pytest.approx(0.02, abs=1e-12)
    assert np.isfinite(flight.position).all()


def test_a_flight_is_given_up_at_its_cap_of_steps():
    flight = rigid.fly(altered(FIG6, rigid={"most_steps": 7}), TABLES)
    assert (flight.end_reason, flight.steps) == ("too_many_steps", 7)


def test_the_same_flight_gives_the_same_bits_however_it_is_cut(monkeypatch: pytest.MonkeyPatch):
    case = altered(FIG6, rigid={"duration_s": 0.05})
    whole = rigid.fly(case, TABLES)
    monkeypatch.setattr(rigid, "PORTION", 1)
    cut = rigid.fly(case, TABLES)
    for name in ("time", "position", "velocity", "quaternion", "angular_velocity", "work"):
        assert np.array_equal(getattr(whole, name), getattr(cut, name))


# The stage


@pytest.fixture
def arguments(tmp_path: Path) -> list[str]:
    """Command line of the stage for a short flight, with tables in files."""
    for name, table in TABLES.items():
        table.write(tmp_path / f"{name}.h5")
    case = altered(FIG6, name="short", rigid={"duration_s": 0.01}, incidence="yaw_blind")
    (tmp_path / "short.yaml").write_text(json.dumps(case.model_dump()))
    tables = [str(tmp_path / f"{name}.h5") for name in TABLES]
    return ["rigid", "--scene", str(tmp_path / "short.yaml"), "--out", str(tmp_path / "out.h5"), "--tables", *tables]


def test_file_holds_every_series_with_its_unit(arguments: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(sys, "argv", arguments)
    rigid.main()
    with h5py.File(tmp_path / "out.h5") as file:
        units = {name: data.attrs["units"] for name, data in file.items()}
        assert units["time"] == "s"
        assert units["position"] == "m"
        assert {units[name] for name in ("pitch", "roll", "yaw")} == {"rad"}
        assert file["position"].shape == file["velocity"].shape == (21, 3)
        assert file["spin"][0] == pytest.approx(-120.0)
        assert np.degrees([file["pitch"][0], file["roll"][0]]) == pytest.approx([2.0, 2.0])
        assert scene.Scene.model_validate_json(file.attrs["scene"]).name == "short"
        assert file.attrs["end_reason"] == "finished"
        assert json.loads(file.attrs["tables"])["mark1e_te"]["digest"] == TABLES["mark1e_te"].digest


def test_missing_table_is_one_line_and_leaves_nothing(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(sys, "argv", arguments[:-1])
    before = sorted(tmp_path.iterdir())
    with pytest.raises(SystemExit) as caught:
        run_stage(rigid.main)
    assert caught.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before
