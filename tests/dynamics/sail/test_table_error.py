"""What tables state along a motion: the right directions, the right weights, and the tables that missed."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.sail.attitude import rotation_from_angles
from dynamics.sail.mesh import sail_mesh
from dynamics.sail.table_error import membrane_errors, rigid_errors
from dynamics.scene.schema import read_scene
from tests.conftest import DESIGNS
from tests.synthetic import smooth_table

FIG6 = DESIGNS.parent / "scenes" / "fig6.yaml"


def _tables(error=lambda u, v: 1e-3 + 0.0 * u * v, thrust=(0.5, 0.5), **attrs):
    made = {}
    for name, q_n in zip(("mark1e_te", "mark1e_tm"), thrust, strict=True):
        table = smooth_table(name, (0.15, 1.0, -1.0, 0.0), (q_n, 0.0, 0.0, 0.0))
        stated = error(table.u[:, None], table.v[None, :]) * np.ones((table.u.size, table.v.size))
        made[name] = replace(table, error=stated, attrs=table.attrs | attrs)
    return made


def _scene(**more):
    return read_scene(FIG6).model_copy(update=more)


def _both(scene, tables, roll=0.0, pitch=0.0, yaw=0.0, offset=(0.0, 0.0)):
    turn = rotation_from_angles(np.radians(roll), np.radians(pitch), np.radians(yaw))
    mesh, place = sail_mesh(scene.sail), np.array([*offset, 0.0])
    rigid = rigid_errors(scene, tables, place[None], turn[None])
    return rigid, membrane_errors(scene, tables, mesh, [mesh.nodes @ turn.T + place])


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.3, -0.2)])
def test_one_error_everywhere_is_that_share_of_one_thrust_whatever_the_light(offset):
    for found in _both(_scene(), _tables(), pitch=2.0, yaw=17.0, offset=offset):
        assert found.largest == pytest.approx(1e-3, rel=1e-12)
        assert found.share == pytest.approx(2e-3, rel=1e-9)
        assert found.missed == ()


@pytest.mark.parametrize("incidence", ["sail_frame", "yaw_blind"])
def test_rigid_and_flexible_sails_of_one_attitude_see_the_same(incidence):
    tables = _tables(lambda u, v: 1e-3 + 0.01 * (u - 0.01) ** 2 + 0.02 * v**2, (0.7, 0.2))
    rigid, flexible = _both(_scene(incidence=incidence), tables, 3.0, -4.0, 55.0, (0.1, 0.05))
    assert flexible.largest == pytest.approx(rigid.largest, rel=1e-9)
    assert flexible.design == rigid.design
    assert flexible.at == pytest.approx(rigid.at, abs=1e-12)
    # Sectors by quadrature against triangles of 12 rings.
    assert flexible.share == pytest.approx(rigid.share, rel=2e-3)


def test_the_direction_of_the_largest_error_is_that_of_the_light_in_the_cell():
    # Pitch θ: light comes along −sin θ x in the body; sector 3 has g = −x, so it sees u = +sin θ there.
    found, _ = _both(_scene(), _tables(lambda u, v: np.where(u > 0, 1e-3 + 0.1 * u, 1e-3)), pitch=5.0)
    assert found.design == "mark1e_te"
    assert found.at == pytest.approx((np.sin(np.radians(5.0)), 0.0), abs=1e-12)


def test_yaw_changes_what_the_sail_sees_but_not_what_the_paper_looks_up():
    tables = _tables(lambda u, v: 1e-3 + 3.0 * v**2 + 0.0 * u)
    blind = [_both(_scene(incidence="yaw_blind"), tables, pitch=5.0, yaw=yaw)[0].largest for yaw in (0.0, 30.0)]
    true = [_both(_scene(), tables, pitch=5.0, yaw=yaw)[0].largest for yaw in (0.0, 30.0)]
    assert blind[0] == pytest.approx(blind[1], rel=1e-12)
    assert true[0] == pytest.approx(blind[0], rel=1e-12)
    assert true[1] < 0.9 * true[0]


def test_missed_tables_are_named():
    found, _ = _both(_scene(), _tables(tolerance_met=0))
    assert found.missed == ("mark1e_te", "mark1e_tm")
    assert found.text.endswith("table of mark1e_te, mark1e_tm MISSED its tolerance")
    assert found.attributes()["tables_missed"] == "mark1e_te, mark1e_tm"
