"""Linear stability: the linear model against the flight, the two routes, and a verdict that knows its tolerance."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.rigid import stage as rigid
from dynamics.rigid.body import rigid_body
from dynamics.sail.attitude import rotation_from_angles
from dynamics.scene import schema as scene
from dynamics.scene.materials import MATERIALS
from dynamics.stability import floquet
from dynamics.stability.derivatives import error_modes, linearise
from dynamics.stability.linear import LinearModel
from optics.table.normal_incidence import ERROR_SCALE
from optics.table.pressure_table import PressureTable
from tests.synthetic import smooth_tables

FIG6 = scene.read_scene(Path(__file__).parents[3] / "workflow" / "scenes" / "fig6.yaml")
TABLES = smooth_tables()


def case(**changes: Any) -> scene.Scene:
    """The scene fig6 with some of its entries replaced; groups merge."""
    data = FIG6.model_dump()
    for name, value in changes.items():
        data[name] = {**data[name], **value} if isinstance(value, dict) else value
    return scene.Scene.model_validate(data)


def model_of(which: scene.Scene) -> LinearModel:
    """The linear model of a scene with the synthetic tables."""
    return floquet.analyse(which, TABLES).model


def lone(jacobian: dict[tuple[int, int], float], spin: float = 7.0) -> LinearModel:
    """A model with a few derivatives only."""
    full = np.zeros((4, 4))
    for place, value in jacobian.items():
        full[place] = value
    return LinearModel(full, np.array(0.0), np.diag([0.063, 0.062]), spin, False)


# The linear model


@pytest.mark.parametrize("incidence", ["sail_frame", "yaw_blind"])
def test_small_motions_fly_as_the_monodromy_matrix_says(incidence: str):
    which = case(incidence=incidence, beam={"rise_s": 0.0}, rigid={"duration_s": 1 / 120, "tolerance": 1e-12})
    model, units = model_of(which), rigid_body(which, TABLES).units
    small = 1e-6 * np.array([1.0, -0.5, 2.0, 1.0, 0.7, -0.4, 3.0, 1.5])
    flight = rigid.fly(which, TABLES, lifted(small, model.spin) * units.state[:13])
    assert np.allclose(lowered(flight, units), model.monodromy() @ small, atol=2e-4 * 1e-6)


def lifted(small: np.ndarray, spin: float) -> np.ndarray:
    """Normalised state of motion (13,) of a small motion (8,)."""
    x, y, vx, vy, roll, pitch, p, q = small
    return np.array([x, y, 0, vx, vy, 0, 1, roll / 2, pitch / 2, 0, p, q, spin])


def lowered(flight: rigid.RigidFlight, units: Any) -> np.ndarray:
    """Small motion (8,) at the end of a flight."""
    roll, pitch, _ = (angle[-1] for angle in flight.angles)
    x, y, _ = flight.position[-1] / units.length
    vx, vy, _ = flight.velocity[-1] * units.time / units.length
    return np.array([x, y, vx, vy, roll, pitch, *flight.angular_velocity[-1, :2] * units.time])


def test_both_routes_agree_for_true_incidence():
    stability = floquet.analyse(FIG6, TABLES)
    assert stability.route_difference < 1e-9
    full = replace(stability.model, jacobian=np.random.default_rng(3).normal(size=(4, 4)) * 0.1)
    routes = [floquet.eigenvalues(m) for m in (full.monodromy(), full.turn_matrix())]
    assert floquet.distance(*routes) < 1e-9


@pytest.mark.parametrize("seed", range(12))
def test_both_routes_agree_for_any_derivatives_and_spin(seed: int):
    """Stable or not, up to multipliers of a million: the same to 1e-9 of the largest."""
    random = np.random.default_rng(seed)
    model = LinearModel(
        random.normal(size=(4, 4)) * 10 ** random.uniform(-2.0, 0.7),
        np.array(0.1),
        np.diag([0.063, 0.062]),
        random.uniform(1.5, 15.0),
        False,
    )
    found = floquet.assess(model, [])
    assert found.route_difference < 1e-9
    if found.max_modulus > 1.001:
        assert (found.verdict, found.margin < 0) == ("unstable", True)
        assert -found.margin * model.period == pytest.approx(np.log(found.max_modulus))


@pytest.mark.parametrize("incidence", ["sail_frame", "yaw_blind"])
def test_derivatives_are_those_of_the_load(incidence: str):
    """Against central differences of force and torque, whose own error goes with the square of the step."""
    which = case(incidence=incidence)
    body = rigid_body(which, TABLES)
    want = np.empty((4, 4))
    for axis in range(4):
        loads = []
        for sign in (1.0, -1.0):
            x, y, roll, pitch = sign * 1e-4 * np.eye(4)[axis]
            force, torque, _ = body.load(np.array([x, y, 0.0]), rotation_from_angles(roll, pitch, 0.0))
            loads.append(np.array([*force[:2] / body.units.force, *torque[:2] / body.units.torque]))
        want[:, axis] = (loads[0] - loads[1]) / 2e-4
    found, thrust = linearise(which, TABLES, body)
    assert np.allclose(found, want, rtol=0, atol=2e-8)
    force = body.load(np.zeros(3), np.eye(3))[0]
    assert thrust == pytest.approx(force[2] / body.units.force, rel=1e-12)


def test_tilt_of_a_lamina_feels_its_spin_as_a_spring():
    """In axes that turn with the sail α̈ = τ/I − Ω²α for each tilt on its own."""
    model = lone({(2, 2): -0.5, (3, 3): -0.8})
    twice = np.linalg.matrix_power(model.corotating(), 2)[4:6]
    want = np.zeros((2, 8))
    want[0, 4], want[1, 5] = -0.5 / 0.063 - 49.0, -0.8 / 0.062 - 49.0
    assert np.allclose(twice, want, atol=1e-12)


def test_free_lamina_comes_back_after_a_turn():
    """Position drifts with its velocity; the tilt nutates at twice the spin, so that a turn brings it back."""
    turn = lone({}).monodromy()
    want = np.eye(8)
    want[0, 2] = want[1, 3] = 2 * np.pi / 7.0
    assert np.allclose(turn, want, atol=1e-11)


def test_direction_of_spin_does_not_matter():
    for incidence in ("sail_frame", "yaw_blind"):
        sets = [
            floquet.analyse(case(incidence=incidence, release={"spin_Hz": spin}), TABLES).multipliers
            for spin in (-120.0, 120.0)
        ]
        assert floquet.distance(*sets) < 1e-9


def test_incidence_models_share_their_derivatives_but_not_their_multipliers():
    true, blind = (floquet.analyse(case(incidence=name), TABLES) for name in ("sail_frame", "yaw_blind"))
    assert np.allclose(true.model.jacobian, blind.model.jacobian, atol=1e-6)
    assert floquet.distance(true.multipliers, blind.multipliers) > 1e-3
    assert blind.corotating is None


def test_multipliers_of_a_lossless_sail_come_in_reciprocal_pairs():
    for sign in (1.0, -1.0):
        multipliers = floquet.analyse(FIG6, smooth_tables(sign)).multipliers
        assert floquet.distance(multipliers, 1.0 / multipliers) < 1e-9


# The verdict


@pytest.mark.parametrize("incidence", ["sail_frame", "yaw_blind"])
def test_restoring_light_is_marginal_and_repelling_light_unstable(incidence: str):
    held, thrown = (floquet.analyse(case(incidence=incidence), smooth_tables(sign)) for sign in (1.0, -1.0))
    assert held.verdict == "marginally_stable"
    assert held.max_modulus == pytest.approx(1.0, abs=1e-9)
    assert thrown.verdict == "unstable"
    assert thrown.max_modulus > 1.0 + 2 * thrown.tolerance


def test_tables_with_large_errors_leave_the_verdict_open():
    vague = {name: replace(table, error=np.full(table.error.shape, 0.3)) for name, table in TABLES.items()}
    stability = floquet.analyse(FIG6, vague)
    assert stability.verdict == "undecided"
    assert stability.spread > 1e-3


def _made(table, tolerance, seconds, error):
    attrs = {"settings": {"tolerance": tolerance}, "cpu_seconds": seconds, "tolerance_met": 1}
    return replace(table, error=np.full(table.error.shape, error), attrs=table.attrs | attrs)


def test_an_undecided_verdict_names_cause_and_cure():
    """The tolerance it names decides, when the errors of the tables are made that much smaller."""
    vague = {name: _made(table, 0.1, 4.0, 0.3) for name, table in TABLES.items()}
    found = floquet.report(FIG6, vague, floquet.analyse(FIG6, vague))
    text = found["undecided_because"]
    share = floquet.doubt(floquet.analyse(FIG6, vague), error_modes(FIG6, vague, rigid_body(FIG6, vague))).share
    assert text == f"table errors; --tolerance {0.1 * share:.1g} would decide, about {8.0 / share:.2g} s"
    better = {name: _made(table, 0.1 * share, 4.0, 0.3 * share) for name, table in TABLES.items()}
    decided = floquet.report(FIG6, better, floquet.analyse(FIG6, better))
    assert decided["verdict"] == "marginally_stable"
    assert decided["undecided_because"] == ""
    assert found["table_errors"]["mark1e_te"]["q_error"] == pytest.approx(0.3)


def test_a_table_that_missed_its_tolerance_is_named():
    te = TABLES["mark1e_te"]
    missed = {**TABLES, "mark1e_te": replace(te, attrs=te.attrs | {"tolerance_met": 0})}
    assert floquet.report(FIG6, missed, floquet.analyse(FIG6, missed))["tables_missed"] == ["mark1e_te"]


def test_error_modes_are_what_a_wrong_table_changes():
    """Add an error to a table: the derivatives move by its mode."""
    te = TABLES["mark1e_te"]
    slope = 1e-6 / ERROR_SCALE
    q = te.q_nodes + np.array([0.0, 0.0, 1.0])[:, None, None] * slope * te.u[None, :, None]
    wrong = {**TABLES, "mark1e_te": replace(te, q_nodes=q)}
    shift = linearise(FIG6, wrong, rigid_body(FIG6, wrong))[0] - linearise(FIG6, TABLES, rigid_body(FIG6, TABLES))[0]
    modes = [mode for mode, _ in error_modes(FIG6, TABLES, rigid_body(FIG6, TABLES))]
    assert min(np.abs(shift - mode).max() for mode in modes) < 1e-11
    assert np.abs(shift).max() > 1e-7


def test_sail_without_spin_has_exponents_instead_of_multipliers():
    still = case(release={"spin_Hz": 0.0})
    stability = floquet.analyse(still, TABLES)
    report = floquet.report(still, TABLES, stability)
    jacobian, inertia = stability.model.jacobian, stability.model.inertia
    blocks = []
    for force, tilt in ((0, 3), (1, 2)):
        rows = np.array([jacobian[force], jacobian[tilt] / inertia[tilt - 2, tilt - 2]])[:, [force, tilt]]
        blocks.extend(np.sqrt(np.linalg.eigvals(rows).astype(complex)))
    want = np.concatenate([blocks, np.negative(blocks)]) / rigid_body(still, TABLES).units.time
    got = np.array([complex(*pair) for pair in report["exponents_1_s"]])
    assert floquet.distance(got, want) < 1e-6 * np.abs(want).max()
    assert report["multipliers"] == []
    assert report["max_modulus"] is None
    assert report["verdict"] in ("marginally_stable", "unstable", "undecided")


def test_tables_may_be_axisymmetric_and_sectors_constant():
    """A film of constant reflectance and sectors of the same reflectance are the same sail."""
    u = np.linspace(0.0, 0.4, 41)
    w = np.sqrt(1.0 - u**2)
    q = np.stack([np.zeros_like(u), np.zeros_like(u), 2 * 0.5 * w])[:, :, None]
    film = PressureTable(
        u, np.zeros(1), q, np.zeros((41, 1)), np.full((41, 1), 1e-5), axisymmetric=True, attrs={"name": "film"}
    )
    plain = MATERIALS["nitride_te"].model_copy(update={"absorptance": 0.0})
    filmed = {"material": plain.model_dump(), "design": "film"}
    mirror = {"material": plain.model_dump(), "reflectance": 0.5}
    sectors = [{**(filmed if k % 2 else mirror), "from_deg": 90.0 * k} for k in range(4)]
    half, whole = (
        floquet.analyse(case(sail={"sectors": s}), tables)
        for s, tables in ((sectors, {"film": film}), ([{**mirror, "from_deg": 0.0}], {}))
    )
    assert np.allclose(half.model.jacobian, whole.model.jacobian, atol=1e-6)
    assert half.verdict == whole.verdict
    assert whole.spread == 0.0


# Refusals and the file


def test_sail_that_is_not_in_equilibrium_is_refused():
    lopsided = case(
        sail={
            "sectors": [
                {"from_deg": 0.0, "material": "nitride_te", "reflectance": 0.5},
                {"from_deg": 180.0, "material": "nitride_te", "reflectance": 0.1},
            ]
        }
    )
    with pytest.raises(InputError, match=r"sail.sectors: force or torque on the centred, level sail is .* must vanish"):
        floquet.analyse(lopsided, {})


def test_darkness_is_refused():
    with pytest.raises(InputError, match=r"beam.intensity_W_m2 = 0: must be above 0"):
        floquet.analyse(case(beam={"intensity_W_m2": 0.0}), TABLES)


def test_file_tells_multipliers_verdict_and_where_they_come_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name, table in TABLES.items():
        table.write(tmp_path / f"{name}.h5")
    (tmp_path / "short.yaml").write_text(json.dumps(case(name="short").model_dump()))
    tables = [str(tmp_path / f"{name}.h5") for name in TABLES]
    out = tmp_path / "floquet.json"
    monkeypatch.setattr(
        sys, "argv", ["floquet", "--scene", str(tmp_path / "short.yaml"), "--out", str(out), "--tables", *tables]
    )
    floquet.main()
    data = json.loads(out.read_text())
    assert np.shape(data["multipliers"]) == (8, 2)
    assert data["max_modulus"] == pytest.approx(np.hypot(*np.transpose(data["multipliers"])).max())
    assert (data["verdict"], data["incidence"]) == ("marginally_stable", "sail_frame")
    assert data["tolerance"] >= data["resolution"] > 0
    assert set(data["routes"]) == {"monodromy", "corotating"}
    assert data["route_difference"] < 1e-9
    assert data["jacobian"]["F_x_x"] < 0 < data["thrust_N"]
    assert data["tables"]["mark1e_te"]["digest"] == TABLES["mark1e_te"].digest
