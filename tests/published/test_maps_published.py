"""Force and torque at yaw 0 against the values of the published sail (Gao, Kelzenberg & Atwater, Fig. 5C–E), w = 0.4 D.

From the published tables themselves, and from tables of the exact solver, which differ by their mesh error. The
paper's distance from the beam's axis counts the axial coordinate too (`beam_distance: published`): 0.3 % of a torque at
3°. With the lateral distance modal tables come within 1 % of every published value; like for like the torque at 3°
pitch is 1.2 % lower. There the published TE table has too much thrust: q_n = 0.9062 and 0.6123 at −3° and 3° where
modal solutions of 27 to 120 orders give 0.8943 and 0.6039 and FDTD (40 and 80 pixels per µm, extrapolated) 0.8942 and
0.6039.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from dynamics.rigid.body import rigid_body
from dynamics.scene import schema as scene
from dynamics.stability.maps import make_maps, normalised_load
from optics.cells.schema import read_metagrating
from optics.modal.stage import solve
from optics.table.pressure_table import PressureTable
from tests.published.reference import needs_reference, published_tables

WORKFLOW = Path(__file__).parents[2] / "workflow"
S3, S3_PUBLISHED = (scene.read_scene(WORKFLOW / "scenes" / f"{name}.yaml") for name in ("s3", "s3_published"))
FORCE = {-0.05: 3.402524e-3, -0.1: 6.631824e-3, -0.2: 1.189071e-2}
PITCH = {1.0: -8.2109e-4, 3.0: -2.64862e-3}
ROLL = {1.0: -1.14092e-4, 3.0: -4.33355e-4}
OWN_FORCE = {-0.05: 3.407e-3, -0.1: 6.641e-3, -0.2: 1.1906e-2}
OWN_PITCH = {1.0: -8.264e-4, 3.0: -2.623e-3}
OWN_ROLL = {1.0: -1.142e-4, 3.0: -4.350e-4}


@lru_cache(maxsize=2)
def modal_table(design: str) -> PressureTable:
    """Table of a design for tilts to 4°, finely spaced."""
    u, v = np.linspace(-0.07, 0.07, 57), np.array([0.0, 0.035, 0.07])
    found = solve(read_metagrating(WORKFLOW / "designs" / f"{design}.yaml"), u, v, 27)
    q, error = np.moveaxis(found.q, -1, 0), np.full((u.size, v.size), 1e-3)
    return PressureTable(u, v, q, found.absorptance, error, mirror_v=True, attrs={"name": design})


def modal_tables() -> dict[str, PressureTable]:
    return {design: modal_table(design) for design in S3.sail.designs}


def assert_matches(case, tables, force, pitch, roll, within):
    """The values above, each and of the opposite sign on the other side."""
    body = rigid_body(case, tables)
    for sign in (1.0, -1.0):
        for shift, value in force.items():
            assert sign * normalised_load(body, x=sign * shift)[0] == pytest.approx(value, rel=within)
        for degrees, value in pitch.items():
            assert sign * normalised_load(body, pitch=sign * np.radians(degrees))[4] == pytest.approx(value, rel=within)
        for degrees, value in roll.items():
            assert sign * normalised_load(body, roll=sign * np.radians(degrees))[3] == pytest.approx(value, rel=within)


@needs_reference
def test_published_tables_give_the_published_forces_and_torques():
    assert_matches(S3_PUBLISHED, published_tables(), FORCE, PITCH, ROLL, 1e-3)


def test_modal_tables_give_the_published_forces_and_torques():
    assert_matches(S3, modal_tables(), FORCE, PITCH, ROLL, 1e-2)


@needs_reference
def test_the_torque_over_pitch_differs_through_the_published_te_table_alone():
    """Its q_n falls 1.25 % more from −3° to 3° than the solution's, and the torque is 1.2 % larger; TM has no part."""
    published, modal = published_tables(), modal_tables()
    at = np.sin(np.radians([-3.0, 3.0]))
    falls = [np.ptp(tables["mark1e_te"].q(at, np.zeros(2))[:, 2]) for tables in (published, modal)]
    assert falls[0] / falls[1] - 1.0 == pytest.approx(0.0125, abs=1e-3)
    mixed = {"mark1e_te": modal["mark1e_te"], "mark1e_tm": published["mark1e_tm"]}
    bodies = [rigid_body(S3_PUBLISHED, tables) for tables in (mixed, modal, published)]
    of_te, of_both, of_paper = (normalised_load(body, pitch=np.radians(3.0))[4] for body in bodies)
    assert of_te == pytest.approx(of_both, rel=1e-6)
    assert of_paper / of_te - 1.0 == pytest.approx(0.0125, abs=1e-3)


def test_modal_tables_give_what_another_modal_code_gave():
    assert_matches(S3, modal_tables(), OWN_FORCE, OWN_PITCH, OWN_ROLL, 2e-3)


def test_maps_are_odd_and_blank_outside_the_tables():
    """Turning the sail by half a turn maps it onto itself: every map changes sign with both of its arguments."""
    maps = make_maps(S3, modal_tables(), np.linspace(-0.3, 0.3, 5), np.radians([-6.0, -3.0, 0.0, 3.0, 6.0]))
    for values in (maps.F_x, maps.F_y, maps.tau_x, maps.tau_y):
        inside = values[..., 1:-1]
        assert np.allclose(inside, -np.flip(inside), atol=1e-12)
        assert np.isnan(values[..., [0, -1]]).all()
        assert np.isfinite(inside).all()
