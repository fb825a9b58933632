"""Light is conserved: what a sail catches is what falls on it, however narrow the beam, or the sail does not start."""

from __future__ import annotations

import re

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.light.gaussian import Gaussian
from dynamics.light.gaussian_rules import NARROWEST, beam_rules
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.light.moments import round_moments
from dynamics.membrane.flight import Flight
from dynamics.membrane.output.record import COLUMNS
from dynamics.rigid.body import rigid_body
from dynamics.sail.caught_light import MOST, check_light, share_wrong
from dynamics.sail.mesh import sail_mesh
from dynamics.scene.schema import Scene
from dynamics.stability.floquet import analyse
from tests.membranes import FIG6, altered, dark, film, small
from tests.mirrors import lit
from tests.synthetic import smooth_tables

FOUR = tuple((np.radians(a), np.radians(b)) for a, b in ((30, 150), (150, 210), (210, 330), (330, 390)))
MIRROR = {"sectors": film(reflectance=1.0, absorptance=0.0)}


def shining(radius: float, rings: int, **groups) -> Scene:
    beam = {"radius_m": radius, "intensity_W_m2": 1e9}
    return dark(rings, sail={**MIRROR, **groups.pop("sail", {})}, beam=beam, **groups)


def test_a_mesh_that_starts_catches_the_power_of_the_beam(tmp_path):
    for rings, radius in ((30, 0.05), (5, 0.2), (2, 0.4)):
        _, row = lit(
            tmp_path / str(rings),
            rings=rings,
            beam={"radius_m": radius, "intensity_W_m2": 1e9},
            sail={**MIRROR, "rotation_deg": 10.0},
        )
        # Of a narrow beam all of it, of a wide one what falls on the polygon: between its inner and its outer circle
        whole = 0.5 * np.pi * radius**2 * 1e9
        inner, outer = (whole * -np.expm1(-2.0 * (r / radius) ** 2) for r in (0.5 * np.cos(np.pi / 6 / rings), 0.5))
        power = row[COLUMNS["power_incident"]]
        assert inner * (1 - MOST) <= power <= outer * (1 + MOST)


# On the regular triangles of a hexagon the sum is that of the integral while the beam is wider than they are
@pytest.mark.parametrize(
    ("outline", "rings", "radius"),
    [
        *((outline, 30, 0.02) for outline in ("round", "square")),
        *((outline, *of) for outline in ("round", "square", "hexagonal") for of in ((30, 0.005), (5, 0.05), (1, 1.0))),
    ],
)
def test_a_mesh_that_would_lose_light_is_refused_and_the_rings_it_takes_do(outline, rings, radius):
    scene = shining(radius, rings, sail={"outline": outline})
    with pytest.raises(InputError) as refusal:
        check_light(scene, sail_mesh(scene.sail))
    found = re.fullmatch(
        r"fig6\.yaml: sail\.rings = (\d+): triangles of \S+ m would get \S+ % of the light of a beam of \S+ m wrong: "
        r"must be at least (\d+), or widen beam\.radius_m",
        str(refusal.value),
    )
    assert found
    assert int(found[1]) == rings
    needed = int(found[2])
    if needed <= 100:
        finer = shining(radius, needed, sail={"outline": outline})
        check_light(finer, sail_mesh(finer.sail))


def test_a_refused_mesh_does_not_fly(tmp_path):
    with pytest.raises(InputError, match=r"fig6\.yaml: sail\.rings = 5: .* must be at least \d+"):
        Flight(shining(0.05, 5), {}, tmp_path)


def test_no_mesh_is_asked_for_that_could_not_be_made():
    scene = shining(1e-5, 5)
    with pytest.raises(InputError, match=r"no mesh is fine enough: widen beam\.radius_m"):
        check_light(scene, sail_mesh(scene.sail))


def test_sails_in_the_dark_and_in_wide_beams_may_have_any_mesh():
    for scene in (shining(1e4, 1), dark(1, beam={"radius_m": 1e-3})):
        check_light(scene, sail_mesh(scene.sail))


def test_the_share_is_that_of_the_integral():
    mesh = sail_mesh(shining(0.1, 10).sail)
    # By brute force on the middle of the mesh, whose triangles tile it: all of the beam falls there
    a, b, c = (mesh.nodes[mesh.triangles[:, i], :2] for i in range(3))
    middle = np.exp(-2.0 * (((a + b + c) / 3.0) ** 2).sum(axis=1) / 0.1**2) @ mesh.areas
    want = abs(middle / (0.5 * np.pi * 0.1**2) - 1.0)
    assert share_wrong(mesh, shining(0.1, 10).beam.spots, np.zeros((1, 2))) == pytest.approx(want, rel=3e-2)


@pytest.mark.parametrize("ratio", [0.099, 0.04, 0.015, NARROWEST])
@pytest.mark.parametrize("spans", [FOUR, ((0.0, 2.0 * np.pi),)])
def test_the_rules_of_rigid_sails_hold_for_narrow_beams(ratio, spans):
    rules = beam_rules(spans, 1.0, ratio)
    exact, whole = round_moments(Gaussian(), *np.array(spans).T, 1.0, ratio), 0.5 * np.pi * ratio**2
    for rule in (0, len(rules.reach) - 1):
        for s in range(len(spans)):
            x, y, dark_, weight = rules.points[rules.first[rule, s] : rules.first[rule, s + 1]].T
            e = weight * np.exp(dark_)
            found = np.array([e.sum(), e @ x, e @ y])
            assert np.abs(found - [exact.zeroth[s], *exact.first[s]]).max() < 1e-11 * whole
    x, y, _, weight = rules.points[rules.first[-1, 0] : rules.first[-1, -1]].T
    for place in ([0.3, 0.1], [-0.2, 0.25], [0.02, -0.39]):
        e = weight * np.exp(-2.0 * ((x - place[0]) ** 2 + (y - place[1]) ** 2) / ratio**2)
        assert e.sum() == pytest.approx(whole, rel=1e-11)
        assert [e @ x / e.sum(), e @ y / e.sum()] == pytest.approx(place, abs=1e-11)


def test_a_rigid_mirror_gets_all_of_a_narrow_beam_wherever_it_falls():
    scene = shining(0.005, 5)
    body = rigid_body(scene, {})
    for place in ([0.0, 0.0, 0.0], [0.1, 0.05, 0.0], [-0.2, 0.3, 0.0]):
        force, torque, _ = body.load(np.array(place), np.eye(3))
        thrust = 2.0 * 0.5 * np.pi * 0.005**2 * 1e9 / LIGHT_SPEED
        assert force[2] == pytest.approx(thrust, rel=1e-10)
        assert torque == pytest.approx(thrust * np.array([-place[1], place[0], 0.0]), abs=1e-10 * thrust)


def test_beams_too_narrow_for_a_rigid_sail_are_refused_in_one_line():
    with pytest.raises(InputError) as refusal:
        rigid_body(shining(0.004, 5), {})
    assert str(refusal.value) == (
        "fig6.yaml: beam.radius_m = 0.004: must be at least 0.01 of sail.radius_m, 0.005, for a rigid sail"
    )


def test_stability_knows_no_beam_that_is_too_narrow():
    narrow = analyse(altered(FIG6, beam={"radius_m": 0.004}), smooth_tables())
    assert narrow.verdict in ("unstable", "marginally_stable", "undecided")
    # The thrust of all of the beam: a third of it falls on TE
    q = 0.714 / 3 + 2 * 0.233 / 3
    assert float(narrow.model.thrust) == pytest.approx(q * 0.5 * np.pi * 0.004**2, rel=1e-6)
    assert small(rings=5).beam.radius_m == 0.4
