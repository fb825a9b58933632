"""Flexible sails in beams of any profile that wander and flicker: power on the mesh, force, what is held."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.light import aim, pointing
from dynamics.light import beam as light
from dynamics.light.beam import Beam
from dynamics.membrane.build import build
from dynamics.membrane.flight import Flight
from dynamics.membrane.output.journal import numbers_digest
from dynamics.membrane.output.record import COLUMNS
from dynamics.membrane.summary import errors_met
from dynamics.sail.caught_light import MOST, check_light
from dynamics.sail.mesh import sail_mesh
from tests.dynamics.light.test_profiles import PARTS, TILTED, measured
from tests.membranes import FIG6, altered, dark, film, small, steps
from tests.mirrors import force, lit
from tests.synthetic import smooth_tables

BEAMS: dict[str, dict[str, Any]] = {
    "gaussian": {"radius_m": 0.3},
    "super_gaussian": {"profile": {"kind": "super_gaussian", "order": 6}, "radius_m": 0.4},
    "flat_top": {"profile": {"kind": "flat_top", "order": 8}, "radius_m": 0.4},
    "astigmatic": TILTED,
    "ring": {"profile": {"kind": "ring", "charge": 2}, "radius_m": 0.35},
    "sum": {"profile": {"kind": "sum", "parts": PARTS}},
}


def shining(rings: int = 12, **beam: Any) -> Any:
    """A scene of a mirror in a beam of which no key is given but these."""
    data = dark(rings, sail={"sectors": film(reflectance=1.0, absorptance=0.0)}).model_dump()
    return type(FIG6).model_validate(data | {"beam": {"intensity_W_m2": 1e9, "rise_s": 0.0, **beam}})


def incident(folder: Path, scene: Any) -> tuple[float, Flight]:
    """Power in W that the mesh of a flight gets in one evaluation."""
    flight = Flight(scene, {}, folder)
    flight.step = flight.model.release + 8
    return float(steps(flight, 0)[0][COLUMNS["power_incident"]]), flight


@pytest.mark.parametrize("name", BEAMS)
def test_every_beam_gives_the_mesh_its_power(tmp_path: Path, name: str):
    scene = shining(**BEAMS[name])
    power, flight = incident(tmp_path, scene)
    mesh = flight.membrane.mesh
    middles = mesh.nodes[mesh.triangles].mean(axis=1)
    exact = float(light.intensity(scene.beam, middles[:, 0], middles[:, 1]) @ mesh.areas)
    assert power == pytest.approx(exact, rel=1e-9)
    x, w = np.polynomial.legendre.leggauss(300)
    d, angle = 0.25 * (x + 1.0), 2.0 * np.pi * np.arange(360) / 360
    disc = light.intensity(scene.beam, np.outer(d, np.cos(angle)), np.outer(d, np.sin(angle)))
    whole = float((0.25 * w * d) @ disc.sum(axis=1) * 2.0 * np.pi / 360)
    assert power == pytest.approx(whole, rel=2 * MOST)


def test_a_map_gives_the_mesh_its_power(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    data = shining(radius_m=1.0).model_dump()
    data["beam"] = {"profile": {"kind": "map", "file": measured(tmp_path)}, "rise_s": 0.0}
    scene = type(FIG6).model_validate(data)
    power, flight = incident(tmp_path / "flight", scene)
    mesh = flight.membrane.mesh
    middles = mesh.nodes[mesh.triangles].mean(axis=1)
    exact = float(light.intensity(scene.beam, middles[:, 0], middles[:, 1]) @ mesh.areas)
    assert power == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("name", ["flat_top", "ring"])
def test_a_mesh_that_would_get_the_light_wrong_is_refused(name: str):
    scene = shining(2, **{**BEAMS[name], "radius_m": 0.08})
    with pytest.raises(InputError, match=r"of the light of a beam that changes within 0.\d+ m wrong: must be at least"):
        check_light(scene, sail_mesh(scene.sail))


def wandering(**keys: Any) -> dict[str, Any]:
    """A mirror's groups: a beam that stays where it is told."""
    return {"beam": {"radius_m": 0.4, "rise_s": 0.0, **keys}, "rings": 8}


def test_a_beam_that_wandered_off_is_a_sail_that_moved(tmp_path: Path):
    path = {"path": [[0, -0.03, 0.02], [1, -0.03, 0.02]]}
    shift = np.array([[0.03], [-0.02], [0.0]])
    _, moved = lit(tmp_path / "a", shape=lambda x: x + shift, **wandering())
    _, aimed = lit(tmp_path / "b", **wandering(pointing=path))
    assert np.allclose(force(aimed), force(moved), rtol=1e-11, atol=1e-12 * abs(force(moved)[2]))


def test_a_tilted_beam_pushes_as_a_tilted_world_would(tmp_path: Path):
    """Force on a sail in a beam along k is the turned one of the sail that is turned the other way."""
    beam = Beam.model_validate(
        {
            "intensity_W_m2": 1.0,
            "radius_m": 1.0,
            "pointing": {"path": [[0, 0, 0, 3.0, -2.0], [1, 0, 0, 3.0, -2.0]]},
        }
    )
    now, frame = np.empty(5), np.empty((3, 3))
    aim.where(beam.wander, 0.0, now)
    aim.axes(now, frame)
    _, tilted = lit(tmp_path / "a", **wandering(pointing=beam.pointing.model_dump()))
    _, turned = lit(tmp_path / "b", shape=lambda x: frame @ x, **wandering())
    assert np.allclose(force(tilted), frame.T @ force(turned), rtol=1e-10, atol=1e-12 * abs(force(turned)[2]))
    # Of a level film: a k_x along x, (2R + a) k_z along z
    assert force(tilted)[0] / force(tilted)[2] == pytest.approx(0.1 / 1.3 * np.tan(np.radians(3.0)), rel=1e-9)


def test_power_that_fluctuates_pushes_by_as_much_more(tmp_path: Path):
    noise = {"rms": 0.1, "cutoff_Hz": 50.0, "seed": 2, "record_s": 0.1}
    flight, row = lit(tmp_path / "a", **wandering(power_noise=noise))
    _, plain = lit(tmp_path / "b", **wandering())
    t = 8 * flight.model.dt
    share = pointing.at(flight.membrane.scene.beam.pointing, flight.membrane.scene.beam.power_noise, [t])[0, 4]
    assert abs(share) > 1e-3
    assert force(row)[2] == pytest.approx((1.0 + share) * force(plain)[2], rel=1e-12)


def test_jitter_flies_and_keeps_its_momentum(tmp_path: Path):
    noise = {"rms": 0.01, "cutoff_Hz": 50.0, "seed": 2, "record_s": 0.1}
    scene = shining(6, radius_m=0.4, pointing={"jitter_m": noise}, power_noise=noise)
    flight = Flight(scene, {}, tmp_path)
    flight.step = flight.model.release
    rows = steps(flight, 400)
    mass = float(flight.model.masses.sum())
    velocity, impulse = (rows[:, COLUMNS[name] : COLUMNS[name] + 3] for name in ("velocity", "impulse"))
    gained = mass * (velocity[-1] - velocity[0])
    assert np.abs(gained - (impulse[-1] - impulse[0])).max() < 1e-9 * np.abs(gained).max()
    assert np.abs(gained[:2]).max() > 0.0


def test_light_that_is_held_must_follow_the_jitter(tmp_path: Path):
    noise = {"rms": 0.01, "cutoff_Hz": 5000.0, "seed": 2, "record_s": 0.1}
    scene = altered(shining(6, radius_m=0.4, pointing={"jitter_m": noise}), flight={"optics_every": 1000})
    with pytest.raises(InputError, match=r"flight.optics_every = 1000: so many steps of .* beam.pointing.jitter_m"):
        build(scene, {})
    tilt = shining(6, radius_m=0.4, pointing={"path": [[0, 0, 0, 1, 0], [1, 0, 0, 1, 0]]})
    with pytest.raises(InputError, match="tilts need incidence: sail_frame"):
        build(altered(tilt, incidence="yaw_blind"), {})


def with_profile(model: Any, profile: Any) -> Any:
    """The model with another profile of its beam."""
    light = model.effects.light._replace(profile=profile)
    return model._replace(effects=model.effects._replace(light=light))


def test_a_steady_beam_costs_nothing_and_addresses_are_no_part_of_a_flight():
    model = build(small(), smooth_tables()).model
    assert model.effects.light.wander.times.size == model.effects.light.wander.pieces.size == 0
    elsewhere = model.effects.light.profile._replace(functions=model.effects.light.profile.functions + 64)
    other = with_profile(model, elsewhere)
    assert numbers_digest(other) == numbers_digest(model)
    dimmer = model.effects.light.profile._replace(numbers=0.5 * model.effects.light.profile.numbers)
    assert numbers_digest(with_profile(model, dimmer)) != numbers_digest(model)


def test_errors_of_tables_are_those_of_the_beam_where_it_was(tmp_path: Path):
    """In a beam that moved with the sail they are those of the sail in the middle."""
    tables = smooth_tables()

    def met(folder: str, offset: list[float], **beam: Any) -> float:
        scene = small(rings=4, beam=beam, release={"offset_m": offset, "pitch_deg": 1.0, "roll_deg": 0.0})
        flight = Flight(scene, tables, tmp_path / folder)
        flight.state.x[...] += np.array([[offset[0]], [offset[1]], [0.0]])
        flight.step = flight.model.release
        flight._frame()
        return errors_met(flight, tables).share

    plain = met("a", [0.0, 0.0])
    moved = met("b", [0.2, 0.1], pointing={"path": [[0, 0.2, 0.1], [1, 0.2, 0.1]]})
    assert moved == pytest.approx(plain, rel=1e-9)
