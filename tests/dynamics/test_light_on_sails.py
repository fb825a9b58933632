"""Light on both sail models: a specular film written as a table, light from behind, and the less common choices."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.output.record import COLUMNS
from dynamics.membrane.stepping.step import lay_out
from dynamics.rigid.body import rigid_body
from dynamics.rigid.equations import INSIDE
from dynamics.sail.attitude import rotation_from_angles
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable
from tests.membranes import FILM, altered, dark, film, normals, small, steps
from tests.synthetic import smooth_tables

LIGHT = {"intensity_W_m2": 1e9, "on_s": 1.0, "radius_m": 0.4}
POSES = [(0.0, 0.0, 0.0), (0.21, -0.14, 0.0), (-0.17, 0.09, 1.1), (0.05, 0.26, -2.4)]
DIRECTIONS = [(1.0, 0.0), (0.6, 0.8), (-0.28, 0.96), (0.0, -1.0)]
REFLECTANCE, ABSORPTANCE = 0.45, 0.3


def specular(absorptance_slope: float = 0.0) -> dict[str, PressureTable]:
    """A specular film of reflectance R and absorptance a as a grating table, q = (a u, a v, (2R + a) w).

    The absorptance that heats is a + `absorptance_slope` u², to be told from the material's.
    """
    u, v = np.linspace(-0.4, 0.4, 81), np.linspace(0.0, 0.4, 41)
    uu, vv = np.meshgrid(u, v, indexing="ij")
    w = np.sqrt(1.0 - uu**2 - vv**2)
    a = ABSORPTANCE
    q = np.stack([a * uu, a * vv, (2.0 * REFLECTANCE + a) * w])
    absorptance = a + absorptance_slope * uu**2
    error = np.full(uu.shape, 1e-6)
    return {"specular": PressureTable(u, v, q, absorptance, error, mirror_v=True, attrs={"name": "specular"})}


def sectors(**response: Any) -> list[dict[str, Any]]:
    """Four sectors with their own directions across the ridges, of one absorbing material."""
    material = {**FILM, "absorptance": ABSORPTANCE}
    starts = (0.0, 70.0, 160.0, 290.0)
    return [
        {"from_deg": start, "material": material, "g": list(g), **response}
        for start, g in zip(starts, DIRECTIONS, strict=True)
    ]


CONSTANT = dark(beam=LIGHT, sail={"sectors": sectors(reflectance=REFLECTANCE)})
TABLED = altered(CONSTANT, sail={"sectors": sectors(design="specular")})


def light_row(scene: Scene, tables: dict[str, PressureTable], folder: Path, turn: np.ndarray) -> np.ndarray:
    """The row of one evaluation of the flexible sail, flat and turned, off the beam's axis."""
    flight = Flight(scene, tables, folder)
    flight.state.x[...] = turn @ flight.state.x + np.array([[0.05], [-0.03], [0.0]])
    flight.step = flight.model.release + 8
    return steps(flight, 0)[0]


def column(row: np.ndarray, name: str) -> np.ndarray:
    return row[COLUMNS[name] : COLUMNS[name] + 3]


# A film as a grating: q_g, q_r and q_n each have their direction and sign


@pytest.mark.parametrize("pose", POSES)
def test_a_rigid_specular_film_as_a_grating_is_the_film_of_constant_reflectance(pose: tuple[float, float, float]):
    turn, place = rotation_from_angles(*pose), np.array([0.05, -0.03, 0.2])
    force, torque, _ = rigid_body(TABLED, specular()).load(place, turn)
    want, wanted, _ = rigid_body(CONSTANT, {}).load(place, turn)
    assert np.abs(force - want).max() < 1e-6 * np.linalg.norm(want)
    assert np.abs(torque - wanted).max() < 1e-6 * np.linalg.norm(want)


@pytest.mark.parametrize("pose", POSES)
def test_a_flexible_specular_film_as_a_grating_is_the_film_of_constant_reflectance(
    tmp_path: Path, pose: tuple[float, float, float]
):
    turn = rotation_from_angles(*pose)
    got = light_row(TABLED, specular(), tmp_path / "table", turn)
    want = light_row(CONSTANT, {}, tmp_path / "film", turn)
    size = np.linalg.norm(column(want, "force"))
    for name in ("force", "torque"):
        assert np.abs(column(got, name) - column(want, name)).max() < 1e-6 * size
    normal = turn[:, 2]
    push = 2.0 * REFLECTANCE * normal[2] * normal + ABSORPTANCE * np.array([0.0, 0.0, 1.0])
    closed = want[COLUMNS["power_incident"]] / LIGHT_SPEED * push
    assert np.abs(column(want, "force") - closed).max() < 1e-12 * size


# Light from behind


def plain_film_table() -> dict[str, PressureTable]:
    """The same film as an axisymmetric table over the sine of incidence."""
    s = np.concatenate([np.linspace(0.0, 0.9, 91), np.linspace(0.905, 0.999, 95)])
    q = np.stack([ABSORPTANCE * s, 0.0 * s, (2.0 * REFLECTANCE + ABSORPTANCE) * np.sqrt(1.0 - s**2)])
    table = PressureTable(
        s,
        np.zeros(1),
        q[..., None],
        np.full((s.size, 1), ABSORPTANCE),
        np.full((s.size, 1), 1e-6),
        axisymmetric=True,
        attrs={"name": "specular"},
    )
    return {"specular": table}


def flown_turned_over(scene: Scene, tables: dict[str, PressureTable], folder: Path) -> tuple[Flight, str]:
    """A short flight of a sail released with its back to the light, and how it ends."""
    flight = Flight(scene, tables, folder)
    flight.step = flight.model.release
    flight.state.x[1:] *= -1.0
    return flight, flight.fly().reason


def test_a_removed_triangle_may_turn_over(tmp_path: Path):
    """It flies on with its nodes; no light is on it, so none comes from behind."""
    scene = small(flight={"duration_s": 2e-5, "on_failure": "remove"}, effects={"tensile_failure": False})
    flight = Flight(scene, smooth_tables(), tmp_path)
    flight.step = flight.model.release
    flight.state.x[1:] *= -1.0
    sheet = flight.work.effects.sheet
    flight.work.effects.tearing.gone[:], sheet.modulus[:], sheet.shear[:] = 1, 0.0, 0.0
    lay_out(flight.model, flight.work)
    assert flight.fly().reason == "finished"
    assert flight.work.effects.light.outside[0] == flight.columns()["power_incident"][0][-1] == 0.0


@pytest.mark.parametrize("outside", ["stop", "clamp"])
def test_a_grating_lit_from_behind_leaves_its_table_even_where_directions_are_clamped(tmp_path: Path, outside: str):
    scene = small(outside_table=outside, flight={"duration_s": 2e-5})
    flight, reason = flown_turned_over(scene, smooth_tables(), tmp_path)
    assert reason == "left_table"
    assert not normals(flight)[2, flight.work.effects.light.outside[1]] > 0.0


def test_the_end_names_the_triangle_lit_from_behind_not_one_clamped_before(tmp_path: Path):
    scene = small(outside_table="clamp", flight={"duration_s": 1e-4}, effects={"tensile_failure": False})
    flight = Flight(scene, smooth_tables(u_max=0.02), tmp_path)
    flight.step = flight.model.release
    flight.state.x[...] = rotation_from_angles(0.1, 0.1, 0.0) @ flight.state.x
    folded = flight.membrane.mesh.triangles[-1]
    flight.state.x[:2, folded[[0, 1]]] = flight.state.x[:2, folded[[1, 0]]]
    assert flight.fly().reason == "left_table"
    assert not normals(flight)[2, flight.work.effects.light.outside[1]] > 0.0


@pytest.mark.parametrize("outside", ["stop", "clamp"])
def test_films_go_on_when_lit_from_behind_and_are_pushed_downstream(tmp_path: Path, outside: str):
    short = {"flight": {"duration_s": 2e-5}, "outside_table": outside, "effects": {"thermal_failure": False}}
    for scene, tables in ((CONSTANT, {}), (TABLED, plain_film_table())):
        flight, reason = flown_turned_over(altered(scene, **short), tables, tmp_path / str(len(tables)))
        assert reason == "finished"
        assert flight.model.masses @ flight.state.v[2] > 0.0


@pytest.mark.parametrize("pose", [(np.pi - 0.2, 0.1, 0.5), (0.3, -0.2, 0.5)])
def test_a_film_s_table_is_the_constant_film_from_both_sides_in_both_models(
    tmp_path: Path, pose: tuple[float, float, float]
):
    turn, place = rotation_from_angles(*pose), np.array([0.05, -0.03, 0.2])
    want = rigid_body(CONSTANT, {}).load(place, turn)[0]
    got, _, flag = rigid_body(TABLED, plain_film_table()).load(place, turn)
    assert flag == INSIDE
    assert np.abs(got - want).max() < 1e-6 * np.linalg.norm(want)
    want, got = (
        column(light_row(scene, tables, tmp_path / str(len(tables)), turn), "force")
        for scene, tables in ((CONSTANT, {}), (TABLED, plain_film_table()))
    )
    assert np.abs(got - want).max() < 1e-6 * np.linalg.norm(want)


# Choices of the scene


@pytest.mark.parametrize("pose", POSES[1:])
def test_the_published_beam_distance_adds_the_axial_coordinate(pose: tuple[float, float, float]):
    """F = (1/c) ∫ I |w| (2R w n + a k) dA with I at √(ρ² + ζ²), ζ the height above the centre of mass."""
    turn, place = rotation_from_angles(*pose), np.array([0.05, -0.03, 0.0])
    scene = altered(CONSTANT, rigid={"beam_distance": "published"})
    force, torque, _ = rigid_body(scene, {}).load(place, turn)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    rho, angle = 0.25 * (nodes + 1.0), 2.0 * np.pi * np.arange(120) / 120
    area = np.outer(0.25 * weights * rho, np.full(120, 2.0 * np.pi / 120)).ravel()
    body = np.stack([np.outer(rho, np.cos(angle)), np.outer(rho, np.sin(angle)), np.zeros((60, 120))]).reshape(3, -1)
    arm = turn @ body
    distance = (arm[0] + place[0]) ** 2 + (arm[1] + place[1]) ** 2 + arm[2] ** 2
    normal = turn[:, 2]
    push = (2.0 * REFLECTANCE * normal[2] * normal + ABSORPTANCE * np.array([0.0, 0.0, 1.0])) * normal[2] / LIGHT_SPEED
    light = 1e9 * np.exp(-2.0 * distance / 0.4**2) * area
    assert np.abs(force - light.sum() * push).max() < 1e-7 * np.linalg.norm(force)
    want = np.cross(arm @ light, push)
    assert np.abs(turn @ torque - want).max() < 1e-6 * np.linalg.norm(want)
    lateral = rigid_body(CONSTANT, {}).load(place, turn)[0]
    assert np.linalg.norm(lateral) > 1.001 * np.linalg.norm(force)


def test_absorptance_of_the_table_heats_by_the_table_and_leaves_the_force_alone(tmp_path: Path):
    turn = rotation_from_angles(0.2, -0.1, 0.4)
    tables, slope = specular(0.8), 0.8
    rows = {
        kind: light_row(altered(TABLED, absorptance=kind), tables, tmp_path / kind, turn)
        for kind in ("material", "table")
    }
    absorbed = {kind: row[COLUMNS["power_absorbed"]] for kind, row in rows.items()}
    incident = rows["table"][COLUMNS["power_incident"]]
    assert absorbed["material"] == pytest.approx(ABSORPTANCE * incident, rel=1e-12)
    assert np.array_equal(column(rows["table"], "force"), column(rows["material"], "force"))
    least, most = (ABSORPTANCE + slope * x for x in (0.0, turn[2, 0] ** 2 + turn[2, 1] ** 2))
    assert least * incident < absorbed["table"] < most * incident
    across = altered(TABLED, absorptance="table", sail={"sectors": [sectors(design="specular")[1]]})
    row = light_row(across, tables, tmp_path / "one", turn)
    u = turn[2, :2] @ DIRECTIONS[1]
    want = (ABSORPTANCE + slope * u**2) * row[COLUMNS["power_incident"]]
    assert row[COLUMNS["power_absorbed"]] == pytest.approx(want, rel=1e-9)


def test_without_light_the_sail_ends_at_the_temperature_of_its_surroundings():
    scene = dark(
        sail={"sectors": film()},
        flight={
            "duration_s": 5e-3,
            "thermal_rate": 1000.0,
            "heat_every": 1,
            "background_temperature_K": 500.0,
        },
    )
    flight, end, series = fly(scene, {})
    assert end.reason == "finished"
    assert np.allclose(flight.state.temperature, 500.0, rtol=1e-6)
    assert series["temperature_mean"][0] < 310.0
    assert np.all(np.diff(series["temperature_mean"]) > -1e-9)
    assert abs(series["power_radiated"][-1]) < 1e-5 * abs(series["power_radiated"][0])
