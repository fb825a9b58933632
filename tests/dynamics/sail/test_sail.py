"""The sail: sectors, mass, inertia, and the tables that belong to it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.rigid.body import normal_units
from dynamics.sail.sectors import check_release, load_tables, sail_shape
from dynamics.scene import schema as scenes
from dynamics.scene.materials import MATERIALS
from dynamics.scene.sail_schema import Sail
from tests.synthetic import smooth_tables

SCENES = Path(__file__).parents[3] / "workflow" / "scenes"
FIG6 = scenes.read_scene(SCENES / "fig6.yaml")
NITRIDE = [{"from_deg": 0.0, "material": "nitride_te", "reflectance": 0.2}]


def round_sail(sectors: list[dict]) -> Sail:
    """A disc of 1 m diameter with the given sectors."""
    return Sail.model_validate({"radius_m": 0.5, "rings": 2, "sectors": sectors})


def lopsided(turned_deg: float = 0.0) -> Sail:
    """A disc whose three unequal sectors differ in mass."""
    starts = sorted((20.0 + turned_deg, 100.0 + turned_deg, 250.0 + turned_deg))
    names = ["nitride_te", "nitride_tm", "silicon_43nm"]
    return round_sail([{"from_deg": s, "material": n, "reflectance": 0.1} for s, n in zip(starts, names, strict=True)])


def test_published_mass_and_inertia_of_the_four_sector_sail():
    shape = sail_shape(FIG6.sail)
    assert shape.mass == pytest.approx(8.67079572e-4, rel=1e-9)
    assert np.allclose(np.diag(shape.inertia), [5.467961e-5, 5.370533e-5, 1.0838495e-4], rtol=1e-7)
    assert np.allclose(np.diag(shape.inertia) / shape.mass, [0.06306182, 0.06193818, 0.125], atol=5e-9)


def test_published_units_of_time_and_speed():
    units = normal_units(sail_shape(FIG6.sail), 1e9)
    assert units.time == pytest.approx(1.6122776e-2, rel=1e-7)
    assert units.length / units.time == pytest.approx(62.02406, rel=1e-7)


def test_plain_disc_follows_the_textbook():
    shape = sail_shape(round_sail(NITRIDE))
    assert shape.mass == pytest.approx(np.pi * 0.25 * 1.08e-3, rel=1e-14)
    assert np.allclose(shape.inertia, shape.mass * 0.25 * np.diag([0.25, 0.25, 0.5]), atol=1e-18)


def test_moments_agree_with_quadrature_for_a_lopsided_sail():
    shape = sail_shape(lopsided())
    node, weight = np.polynomial.legendre.leggauss(20)
    total, moment = 0.0, np.zeros((2, 2))
    for sector in shape.sectors:
        d = 0.25 * (node + 1.0)
        angle = sector.start + 0.5 * (sector.stop - sector.start) * (node + 1.0)
        x = np.stack([np.outer(d, np.cos(angle)), np.outer(d, np.sin(angle))]) - shape.centre[:, None, None]
        mass = sector.areal_mass * 0.125 * (sector.stop - sector.start) * np.outer(d * weight, weight)
        total = total + np.array([mass.sum(), *(mass * x).sum((1, 2))])
        moment += np.einsum("rp,irp,jrp->ij", mass, x, x)
    assert np.allclose(total, [shape.mass, 0.0, 0.0], atol=1e-15)
    want = [[moment[1, 1], -moment[0, 1]], [-moment[0, 1], moment[0, 0]]]
    assert np.allclose(shape.inertia[:2, :2], want, atol=1e-12 * shape.inertia[2, 2])


def test_inertia_turns_with_the_sail():
    angle = np.radians(40.0)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    still, turned = sail_shape(lopsided()), sail_shape(lopsided(40.0))
    assert np.allclose(turned.centre, turn[:2, :2] @ still.centre, atol=1e-15)
    assert np.allclose(turned.inertia, turn @ still.inertia @ turn.T, atol=1e-18)


def test_lamina_adds_its_lateral_inertias():
    inertia = sail_shape(lopsided()).inertia
    assert inertia[2, 2] == pytest.approx(inertia[0, 0] + inertia[1, 1], rel=1e-14)
    assert np.allclose(inertia[:2, 2], 0.0)


def test_across_along_and_normal_are_right_handed():
    along = []
    for sector in sail_shape(FIG6.sail).sectors:
        assert np.cross(sector.g, sector.r) == pytest.approx(1.0)
        along.append(sector.r.tolist())
    assert along == [[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]


def test_a_sector_gives_back_no_more_than_it_gets():
    black = {**MATERIALS["nitride_te"].model_dump(), "absorptance": 0.5}
    with pytest.raises(InputError, match=r"sail.sectors\[0\].reflectance = 0.6: .* must not exceed 1"):
        sail_shape(round_sail([{"from_deg": 0.0, "material": black, "reflectance": 0.6}]))


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    """Synthetic tables of both designs as files."""
    for name, table in smooth_tables().items():
        table.write(tmp_path / f"{name}.h5")
    return {name: tmp_path / f"{name}.h5" for name in smooth_tables()}


def test_tables_are_matched_by_name_whatever_the_order_of_files(files: dict[str, Path]):
    tables = load_tables([files["mark1e_te"], files["mark1e_tm"]], FIG6)
    assert list(tables) == FIG6.sail.designs == ["mark1e_tm", "mark1e_te"]
    assert all(table.name == name for name, table in tables.items())


def test_missing_foreign_double_and_unreadable_tables_are_refused(files: dict[str, Path], tmp_path: Path):
    te, tm = files["mark1e_te"], files["mark1e_tm"]
    foreign = replace(smooth_tables()["mark1e_te"], attrs={"name": "other"})
    foreign.write(tmp_path / "other.h5")
    for paths, message in (
        ([te], r"fig6.yaml: sail.sectors: no pressure table of design 'mark1e_tm' \(given: 'mark1e_te' "),
        ([te, tm, te], r"mark1e_te.h5: name = 'mark1e_te': .*mark1e_te.h5 is already the table"),
        ([te, tm, tmp_path / "other.h5"], r"other.h5: name = 'other': not a design of scene 'fig6' \(allowed: mark"),
        ([te, tmp_path / "none.h5"], r"none.h5: no such pressure table"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            load_tables(paths, FIG6)
        assert "\n" not in str(caught.value)


def test_tables_of_another_wavelength_are_refused(files: dict[str, Path], tmp_path: Path):
    infrared = replace(smooth_tables()["mark1e_te"], attrs={"name": "mark1e_te", "wavelength_m": 1550e-9})
    infrared.write(tmp_path / "infrared.h5")
    with pytest.raises(InputError, match=r"infrared.h5: wavelength_m = 1.55e-06: must be 1.064e-06, as in"):
        load_tables([files["mark1e_tm"], tmp_path / "infrared.h5"], FIG6)


def test_a_release_outside_the_tables_is_refused_before_the_flight():
    def tilted(pitch_deg: float, outside: str = "stop") -> scenes.Scene:
        release = FIG6.release.model_copy(update={"pitch_deg": pitch_deg})
        return FIG6.model_copy(update={"release": release, "outside_table": outside})

    with pytest.raises(InputError, match=r"^fig6\.yaml: release\.pitch_deg = 30, .* outside table .* \(allowed u "):
        check_release(tilted(30.0), smooth_tables())
    check_release(tilted(30.0, "clamp"), smooth_tables())
    check_release(tilted(20.0), smooth_tables())
