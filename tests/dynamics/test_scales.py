"""Defaults go with the size of sail and beam, and what a flight neglects is said where it begins to matter."""

from __future__ import annotations

import sys

import h5py
import numpy as np
import pytest
import yaml

from beamrider.io.files import InputError
from dynamics.membrane import flight as membrane
from dynamics.membrane import summary
from dynamics.membrane.effects.spin import spin_up_time
from dynamics.membrane.flight import fly
from dynamics.rigid import stage as rigid
from dynamics.rigid.basin import Grid
from dynamics.sail.neglected import neglected, rayleigh_range
from dynamics.scene.schema import Scene
from tests.membranes import FIG6, altered, film, small
from tests.synthetic import smooth_tables

C = 299792458.0


def large(**groups) -> Scene:
    """A sail of ten metres, released a metre and a half off the axis of a beam of four."""
    release = {"offset_m": [1.5, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0, "spin_Hz": 1.0, **groups.pop("release", {})}
    scene = small(
        rings=6,
        sail={"radius_m": 5.0, "sectors": film(thickness_m=43e-9, reflectance=0.3)},
        beam={"radius_m": 4.0},
        release=release,
        rigid={"duration_s": 0.01},
        flight={"duration_s": 5e-4},
    )
    return altered(scene, **groups)


def test_a_large_sail_flies_beyond_the_edge_of_a_small_one():
    flight = rigid.fly(large(), {})
    assert (flight.end_reason, flight.time[-1]) == ("finished", pytest.approx(0.01))
    _, end, series = fly(large(), {})
    assert end.reason == "finished"
    assert series["position"][series["time"] >= 0.0][0, 0] == pytest.approx(1.5, abs=1e-3)


@pytest.mark.parametrize(
    ("sail", "beam", "limit"), [(0.5, 0.4, 1.25), (0.5, 0.5, 1.25), (5.0, 4.0, 12.5), (0.1, 1.0, 2.5)]
)
def test_flights_end_where_it_is_dark(sail, beam, limit):
    scene = altered(FIG6, sail={"radius_m": sail}, beam={"radius_m": beam})
    assert scene.fly_away == limit
    # The nearest part of the sail has a ninetieth of the light, or less
    assert np.exp(-2.0 * ((limit - sail) / beam) ** 2) <= np.exp(-4.5)
    assert altered(scene, flight={"fly_away_m": 3.0}).fly_away == 3.0


def test_a_release_where_flights_end_is_refused():
    scene = large(release={"offset_m": [10.0, 8.0]})
    line = (
        r"fig6\.yaml: release\.offset_m = \[10\.0, 8\.0\]: the centre of mass is 12\.8062 m from the axis: must be "
        r"below 12\.5 m, where a flight ends; release it nearer or set flight\.fly_away_m"
    )
    with pytest.raises(InputError, match=line):
        rigid.fly(scene, {})
    with pytest.raises(InputError, match=line):
        fly(scene, {})
    near = altered(FIG6, release={"offset_m": [0.05, 0.05]}, flight={"fly_away_m": 0.07})
    with pytest.raises(InputError, match=r"must be below 0\.07 m"):
        rigid.fly(near, smooth_tables())


def test_large_sails_take_longer_to_spin_up():
    assert spin_up_time(FIG6) == 120.0 / 18018.0
    assert spin_up_time(altered(FIG6, sail={"radius_m": 5.0})) == pytest.approx(10 * 120.0 / 18018.0)
    assert spin_up_time(altered(FIG6, sail={"radius_m": 0.1})) == 120.0 / 18018.0


def test_maps_of_basins_go_as_far_as_the_beam():
    assert Grid().over(FIG6.beam).offsets_m == [0.0, 0.36]
    assert Grid().over(large().beam).offsets[-1] == pytest.approx(3.6)
    assert Grid(offsets_m=[0.0, 0.1]).over(FIG6.beam).offsets_m == [0.0, 0.1]


def test_what_matters_is_said_from_when_on():
    time, tables = np.linspace(0.0, 10.0, 11), smooth_tables()
    far = rayleigh_range(FIG6, tables)
    assert far == pytest.approx(np.pi * 0.4**2 / 1064e-9, rel=1e-12)
    position, velocity = np.zeros((11, 3)), np.zeros((11, 3))
    assert neglected(FIG6, tables, time, position, velocity, None) == ""
    velocity[4:, 2] = 1.01e-3 * C
    position[7:, 2] = 1.01 * far
    assert neglected(FIG6, tables, time, position, velocity, 9.5) == (
        "relativity, at more than 0.001 of the speed of light from 4 s on; the spread of the beam, beyond its 4.72e+05 "
        "m from 7 s on; shade, and that the far face differs from the near one, lit from behind from 9.5 s on"
    )
    assert "spread" not in neglected(FIG6, {}, time, position, velocity, None)
    assert neglected(altered(FIG6, beam={"intensity_W_m2": 0.0}), tables, time, position, velocity, 1.0) == ""


@pytest.mark.parametrize(("depth", "said"), [(0.0, False), (0.2309, False), (0.2419, True)])
def test_orders_of_gratings_meet_steep_sails_again(depth: float, said: bool):
    """The first order of λ/p = 0.665, from where 2s + asin(sin s + 0.665) is a right angle: slopes of 13.3° on."""
    tables = smooth_tables()
    for table in tables.values():
        table.attrs["cell"] = {"wavelength_nm": 1064.0, "period_nm": 1600.0}
    sail = {"profile": "cone", "depth": depth} if depth else {}
    scene = altered(FIG6, sail=sail, release={"pitch_deg": 0.0, "roll_deg": 0.0})
    still = np.zeros((2, 3))
    told = neglected(scene, tables, np.arange(2.0), still, still, None)
    assert told == ("orders of gratings that meet the sail again from 0 s on" if said else "")


def test_flights_say_it_in_their_files_and_at_their_ends(tmp_path, monkeypatch, capsys):
    beam = {"intensity_W_m2": 1e12, "radius_m": 4e3}
    scene = large(beam=beam, rigid={"duration_s": 0.03}, release={"offset_m": [0.0, 0.0]})
    path = tmp_path / "fig6.yaml"
    path.write_text(yaml.safe_dump(scene.model_dump()), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["rigid", "--scene", str(path), "--out", str(tmp_path / "rigid.h5")])
    rigid.main()
    (said,) = capsys.readouterr().out.splitlines()
    with h5py.File(tmp_path / "rigid.h5") as file:
        held, speed, time = file.attrs["neglected"], file["velocity"][:, 2], file["time"][:]
    assert said.endswith(f"; neglected: {held}")
    first = time[np.argmax(speed > 1e-3 * C)]
    assert held == f"relativity, at more than 0.001 of the speed of light from {first:.3g} s on"


def test_parts_that_turn_their_back_to_the_light_are_noticed(tmp_path):
    flight = membrane.Flight(large(), {}, tmp_path)
    flight._frame()
    assert summary.lit_from_behind(flight) is None
    flight.step = flight.model.release + 1000
    corner = flight.membrane.mesh.triangles[0, 1]
    flight.state.x[:2, corner] *= -3.0
    flight._frame()
    assert summary.lit_from_behind(flight) == pytest.approx(1000 * flight.model.dt)


def test_ordinary_flights_neglect_nothing_that_matters():
    flight = rigid.fly(altered(FIG6, rigid={"duration_s": 0.05}), smooth_tables())
    assert rigid.remark(flight, FIG6, smooth_tables()) == ""


def test_a_rim_near_the_speed_of_light_is_refused():
    """Neither rigid nor flexible flight knows relativity: half a metre at 1 MHz is a hundredth of it."""
    with pytest.raises(ValueError, match=r"spin_Hz = 1e\+08: moves the rim at 3.14e\+08 m/s: must be below 0.01"):
        altered(FIG6, release={"spin_Hz": 1e8})
    assert altered(FIG6, release={"spin_Hz": 9e5}).release.spin_Hz == 9e5
