"""Stability on the way: against the analysis at one wavelength, closed forms, and windows that a coarse grid misses."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from beamrider.io.files import InputError
from dynamics.scene import schema as scenes
from dynamics.stability import floquet, way
from dynamics.stability.linear import RESOLUTION
from optics import band
from optics.cells.outline import read_grating
from optics.modal.normal_incidence import normal_response
from optics.table.band_response import BandResponse
from optics.table.normal_incidence import ATTRIBUTE
from optics.table.pressure_table import PressureTable
from tests.payloads import behind, ring

WORKFLOW = Path(__file__).parents[3] / "workflow"
FIG6 = scenes.read_scene(WORKFLOW / "scenes/fig6.yaml")
LAST = 1303.2
CELLS = {name: WORKFLOW / f"designs/{name}.yaml" for name in ("mark1e_te", "mark1e_tm")}
C = 299792458.0


def changed(**groups):
    """The scene fig6 with some entries replaced; groups merge."""
    data = FIG6.model_dump()
    for name, value in groups.items():
        data[name] = {**data[name], **value} if isinstance(value, dict) else value
    return scenes.Scene.model_validate(data)


@pytest.fixture(scope="module")
def bands():
    """The responses of the paper's cells from 1064 nm to those of 0.2 c."""
    return {name: band.respond(path, 1064.0, LAST) for name, path in CELLS.items()}


@pytest.fixture(scope="module")
def fig6(bands):
    return way.Way(FIG6, bands)


def constant(name, q_n=2.0, absorptance=0.0):
    """A band of a cell that neither deflects nor changes with the wavelength."""
    cell = read_grating(CELLS[name])
    x = np.linspace(1064e-9, 1e-9 * LAST, 4)
    gradient = np.zeros((4, 3, 2))
    gradient[:, 0, 0] = gradient[:, 1, 1] = absorptance
    attrs = {"name": name, "cell": cell.model_dump()}
    return BandResponse(x, np.tile([0.0, 0.0, q_n], (4, 1)), gradient, np.zeros((4, 3)), np.zeros((4, 3, 2)), attrs)


def test_splines_keep_what_they_state(bands):
    """Against solutions at wavelengths that no spline has seen."""
    for name, found in bands.items():
        for wavelength in np.random.default_rng(3).uniform(1064.0, LAST, 12):
            exact = normal_response(read_grating(CELLS[name], wavelength), 30)
            held = found.at(1e-9 * wavelength)
            assert np.all(np.abs(held.q - exact.q) <= held.q_error + exact.q_error + 1e-12)
            assert np.all(np.abs(held.gradient - exact.gradient) <= held.gradient_error + exact.gradient_error + 1e-12)
        assert found.q_error.max() < 1e-3


@pytest.mark.parametrize("beta", [0.0, 0.05, 0.14, 0.2])
def test_each_place_is_the_analysis_of_the_sail_in_that_light(fig6, beta):
    """By `dynamics.floquet`, in a scene as dim as the light is there and with responses solved at its wavelength."""
    dim = changed(beam={"intensity_W_m2": 1e9 * (1.0 - beta) / (1.0 + beta)})
    light, axis = 1064.0 * way.redshift(beta), np.array([-1.0, 1.0])
    tables = {}
    for name, path in CELLS.items():
        cell = read_grating(path, light)
        attrs = {"name": name, "cell": cell.model_dump(), ATTRIBUTE: normal_response(cell, 24).as_dict()}
        tables[name] = PressureTable(axis, axis, np.zeros((3, 2, 2)), np.zeros((2, 2)), np.ones((2, 2)), attrs=attrs)
    there = floquet.analyse(dim, tables)
    found = way.assess(fig6, np.array([beta]))
    low, high = found.margin_range[0]
    assert low <= there.margin <= high
    assert found.margin[0] == pytest.approx(there.margin, abs=2e-4)
    assert way.VERDICTS[found.verdict[0]] == there.verdict


def test_the_papers_sail_is_lost_at_a_tenth_of_c_and_a_window_within_is_found(fig6, bands):
    found = way.report(fig6)
    edges = np.array(found["changes"])
    assert edges.shape == (4, 2)
    assert np.all(np.diff(edges, axis=1) <= way.EDGE)
    assert np.allclose(edges[:, 0], [0.1009, 0.1662, 0.1692, 0.1903], atol=2e-4)
    assert edges[0, 0] - 2e-4 < found["stable_to_beta"] < edges[0, 0]  # within the errors, and so before
    assert 0.1009 < found["lost_at_beta"] < 0.1015
    one = {entry["beta"]: entry for entry in found["way"]}
    assert one[0.2]["verdict"] == "marginally_stable"
    assert one[0.2]["wavelength_m"] == pytest.approx(1303.13e-9, abs=1e-11)
    assert all(
        low - 1e-9 <= entry["margin_1_s"] <= high + 1e-9
        for entry in one.values()
        for low, high in [entry["margin_range_1_s"]]
    )
    at_rest = way.Way(FIG6, bands, "rest")
    assert np.allclose(way.changes(at_rest, 0.2)[[0, -1], 0], [0.0976, 0.1953], atol=2e-4)
    assert way.VERDICTS[way.assess(at_rest, np.array([0.15])).verdict[0]] == "unstable"


def test_unstable_swings_grow_as_told(fig6):
    """exp(A T) over some turns, against the growth that is told."""
    beta = np.array([0.14])
    found, model = way.assess(fig6, beta), fig6.models(beta)
    period = float(model.period) * fig6.body.units.time
    turn = model.turn_matrix()[0]
    much = np.linalg.norm(np.linalg.matrix_power(turn, 400)) / np.linalg.norm(np.linalg.matrix_power(turn, 300))
    assert np.log(much) / (100 * period) == pytest.approx(found.growth[0], rel=1e-3)
    assert found.growth[0] * period > RESOLUTION


def test_a_mirror_takes_the_time_of_the_closed_form():
    """t = σc²/(6 I) [(1 + β)(2 − β) γ/(1 − β) − 2] of a plane perfect mirror in even light; 0.755676 at 0.2 c."""
    wide = changed(beam={"radius_m": 1e4})
    flown = way.Way(wide, {name: constant(name) for name in CELLS})
    beta = np.linspace(0.0, 0.2, 20001)
    trip = way.journey(flown, beta, np.zeros(beta.size))
    gamma = 1.0 / np.sqrt(1.0 - beta**2)
    mass = flown.body.shape.mass / (np.pi * 0.25)
    exact = mass * C**2 / (6.0 * 1e9) * ((1.0 + beta) * (2.0 - beta) * gamma / (1.0 - beta) - 2.0)
    assert exact[-1] * 6e9 / (mass * C**2) == pytest.approx(0.755676, abs=1e-6)
    assert np.allclose(trip.time, exact, rtol=1e-7, atol=1e-3)
    assert np.all(trip.proper_time <= trip.time)
    with pytest.raises(InputError, match=r"the light does not push it on at beta = 0$"):
        way.journey(way.Way(wide, {name: constant(name, -2.0) for name in CELLS}), beta, np.zeros(beta.size))


def test_aberration_brakes_what_absorbs():
    """A black sail feels −(thrust/c) v across the beam: without spin, in even light, v decays at thrust/(m c)."""
    still = changed(release={"spin_Hz": 0.0}, beam={"radius_m": 1e4})
    black = way.Way(still, {name: constant(name, 1.0, 1.0) for name in CELLS})
    drag = 1e9 * np.pi * 0.25 / C**2 / black.body.shape.mass  # I A/(m c²)
    assert np.allclose(black.models(np.zeros(1)).jacobian[0, :2, 2:], 0.0, atol=1e-12)  # pushed along the light
    # Sums of exponents are as exact as the matrix; single ones, of which six are zero together, are not.
    assert way.aberrated(black, np.zeros(1)).sum().real == pytest.approx(-2.0 * drag, rel=1e-6)
    mirror = way.Way(still, {name: constant(name) for name in CELLS})  # pushed along its normal, whatever the light's
    assert abs(way.aberrated(mirror, np.zeros(1)).sum().real) < 1e-6 * drag


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"incidence": "yaw_blind"}, "incidence = yaw_blind: must be sail_frame"),
        ({"beam": {"radius_y_m": 0.3}}, "beam: must be round and stay where it is"),
        ({"beam": {"intensity_W_m2": 0.0}}, "must be above 0"),
        ({"payload": [behind(1e-4, 0.3, ring(3, 0.3, 100.0))]}, "payload: must be left out"),
    ],
)
def test_what_has_no_way_is_refused(bands, change, said):
    with pytest.raises(InputError, match=said):
        way.report(way.Way(changed(**change), bands))


def test_a_band_that_ends_before_the_way_is_named(bands):
    with pytest.raises(
        InputError, match=r"the band of 'mark1e_te' ends at 1303.2 nm: light is seen at 1373.62 nm at beta = 0.25"
    ):
        way.report(way.Way(FIG6, bands), 0.25)


def test_a_sail_unstable_at_rest_is_lost_at_once(bands):
    """A swing has grown tenfold after ln 10/growth, at a speed of the acceleration times that."""
    found = way.report(way.Way(changed(release={"spin_Hz": 0.0}), bands))
    first = found["way"][0]
    assert not found["stable_at_start"]
    after = np.log(way.LOST) / first["growth_1_s"]
    # Growth falls by 2.7 % to the next place at which it is added up; within, its mean counts.
    assert found["lost_at_beta"] == pytest.approx(first["acceleration_m_s2"] * after / C, rel=2e-2)


def test_files_hold_what_was_found(bands, tmp_path):
    path = tmp_path / "te.h5"
    bands["mark1e_te"].write(path)
    again = BandResponse.read(path)
    for name in ("wavelength", "q", "gradient", "q_error", "gradient_error"):
        assert np.array_equal(getattr(again, name), getattr(bands["mark1e_te"], name))
    assert again.attrs["cell"] == bands["mark1e_te"].attrs["cell"]
    with pytest.raises(InputError, match="name = 'mark1e_te': must be a design of scene 'fig6', once"):
        way.read_bands([path, path], FIG6)
    with pytest.raises(InputError, match="no response of 'mark1e_tm'"):
        way.read_bands([path], FIG6)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match=str(path)):
        BandResponse.read(path)


def test_an_order_that_grazes_within_the_band_is_named(tmp_path):
    cell = yaml.safe_load(CELLS["mark1e_te"].read_text()) | {"period_nm": 1200.0}
    (tmp_path / "mark1e_te.yaml").write_text(yaml.safe_dump(cell | {"ridges_nm": [[0, 400], [600, 200]]}))
    with pytest.raises(InputError, match="order 1 grazes at normal incidence at 1200 nm"):
        band.respond(tmp_path / "mark1e_te.yaml", 1100.0, 1300.0)
