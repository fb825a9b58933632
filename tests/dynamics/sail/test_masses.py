"""Mass and membrane of a region come from the cross-section of its design."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.membrane import lattice
from dynamics.membrane.build import build
from dynamics.rigid.body import rigid_body
from dynamics.sail.masses import designed
from dynamics.sail.mesh import sail_mesh
from dynamics.sail.sectors import sail_shape
from dynamics.scene.schema import Scene
from optics.cells.schema import KINDS
from optics.table.pressure_table import PressureTable
from tests.membranes import FIG6, FILM, altered, small
from tests.synthetic import smooth_tables

SOLID = {"n": 1.98, "k": 1e-6}
#: 563.2 nm of solid on average, 300 nm of it continuous
GRATING = {
    "kind": "metagrating",
    "name": "own",
    "wavelength_nm": 1550,
    "electric_axis": "r",
    "period_nm": 1900,
    "ridges_nm": [[0, 700], [980, 300]],
    "ridge_height_nm": 500,
    "membrane_nm": 300,
    "index": SOLID,
}
MEAN = 300e-9 + 500e-9 * 1000 / 1900


def tables(**cell: Any) -> dict[str, PressureTable]:
    """The tables of fig6's designs as if they were of a cell."""
    data = {**GRATING, **cell}
    if data["kind"] != GRATING["kind"]:
        data = cell
    dumped = KINDS[data["kind"]].model_validate(data).model_dump()
    return {name: replace(table, attrs={**table.attrs, "cell": dumped}) for name, table in smooth_tables().items()}


def of(material: Any = "nitride_te", rings: int = 6, **region: Any) -> Scene:
    """A sail of one design all round, so that its mass is that of one cell."""
    sector = {"from_deg": 0.0, "design": "mark1e_te", "material": material, **region}
    sail = {"rings": rings, "sectors": [sector]}
    return altered(FIG6, sail=sail, release={"offset_m": [0.02, 0.0]}, flight={"in_plane": "membrane"})


def test_a_grating_of_ones_own_has_its_own_mass_whatever_grating_its_material_was_named_after():
    te, tm = (tables()[name] for name in ("mark1e_te", "mark1e_tm"))
    scene = altered(FIG6, sail={"rings": 6})
    body = rigid_body(scene, {"mark1e_te": te, "mark1e_tm": tm})
    assert body.shape.mass == pytest.approx(1.194e-3, abs=5e-7)
    assert body.shape.mass == pytest.approx(2700.0 * MEAN * np.pi * 0.25, rel=1e-12)
    flexible = build(scene, {"mark1e_te": te, "mark1e_tm": tm})
    ring = 0.5 * 36 * np.sin(2 * np.pi / 36) / np.pi  # area of the mesh's polygon over that of the disc
    assert flexible.model.masses.sum() == pytest.approx(body.shape.mass * ring, rel=1e-12)
    assert flexible.lattice.heat_capacities == pytest.approx(800.0 * flexible.model.masses, rel=1e-12)


def test_floquet_takes_the_mass_too():
    light, heavy = (rigid_body(FIG6, given, quadrature=None).shape for given in (smooth_tables(), tables()))
    assert heavy.mass / light.mass == pytest.approx(MEAN / ((400e-9 + 2 * 1240e-9 / 3) / 3), rel=1e-12)


@pytest.mark.parametrize(
    ("cell", "mean", "membrane"),
    [
        ({}, MEAN, 300e-9),
        (
            {"kind": "thin_film", "name": "f", "wavelength_nm": 1550, "layers": [{"thickness_nm": 43, "index": SOLID}]},
            43e-9,
            43e-9,
        ),
        (
            {
                "kind": "lamellar",
                "name": "l",
                "wavelength_nm": 1550,
                "electric_axis": "g",
                "period_nm": 1000,
                "layers": [
                    {
                        "thickness_nm": 100,
                        "index": {"n": 1.0},
                        "ridges": [{"start_nm": 0, "width_nm": 250, "index": SOLID}],
                    },
                    {"thickness_nm": 60, "index": SOLID},
                ],
            },
            85e-9,
            60e-9,
        ),
        (
            {
                "kind": "profile",
                "name": "p",
                "wavelength_nm": 1550,
                "electric_axis": "g",
                "period_nm": 1000,
                "depth_nm": 400,
                "polygons": [{"index": SOLID, "vertices_nm": [[0, 300], [1000, 0], [1000, 400], [0, 400]]}],
            },
            250e-9,
            100e-9,
        ),
    ],
)
def test_every_kind_of_cell_knows_its_mass_and_membrane(cell, mean, membrane):
    region = designed(of(), tables(**cell)).sail.sectors[0]
    assert region.properties.areal_mass == pytest.approx(2700.0 * mean, rel=1e-12)
    assert region.carries_m == pytest.approx(membrane, rel=1e-12)


def test_tension_and_heat_go_through_the_membrane():
    found = {kind: build(small(of(), flight={"in_plane": kind}), tables()) for kind in ("membrane", "mass_equivalent")}
    modulus = found["membrane"].model.effects.sheet.modulus / found["mass_equivalent"].model.effects.sheet.modulus
    assert modulus == pytest.approx(300e-9 / MEAN, rel=1e-12)
    conductance = found["membrane"].lattice.conductance / found["mass_equivalent"].lattice.conductance
    assert conductance == pytest.approx(300e-9 / MEAN, rel=1e-9)
    assert np.array_equal(found["membrane"].model.masses, found["mass_equivalent"].model.masses)


def test_a_membrane_may_be_given():
    scene = designed(of(membrane_m=350e-9), tables())
    assert scene.sail.sectors[0].carries_m == 350e-9
    with pytest.raises(InputError, match=r"sail\.sectors\[0\]\.membrane_m = 6e-07: must be at most 5.63158e-07"):
        designed(of(membrane_m=600e-9), tables())


@pytest.mark.parametrize(
    "region",
    [
        {"thickness_m": 400e-9},
        {"material": {**FILM, "thickness_m": 400e-9}},
        {"material": {**FILM, "thickness_m": 563.2e-9}, "thickness_m": 400e-9},
    ],
)
def test_a_thickness_that_contradicts_the_design_is_refused_with_both_numbers(region):
    with pytest.raises(InputError) as refusal:
        designed(of(**region), tables())
    assert str(refusal.value) == (
        "fig6.yaml: sail.sectors[0].thickness_m = 4e-07: must be 5.63158e-07 m, the cross-section of design "
        "'mark1e_te' over its period; leave it out"
    )


@pytest.mark.parametrize("region", [{"thickness_m": 563e-9}, {"material": {**FILM, "thickness_m": 563e-9}}])
def test_a_thickness_that_agrees_is_taken_as_it_is_given(region):
    assert designed(of(**region), tables()).sail.sectors[0].properties.thickness_m == 563e-9


def test_a_material_needs_no_thickness_where_there_is_a_design():
    material = {key: value for key, value in FILM.items() if key != "thickness_m"}
    assert designed(of(material), tables()).sail.sectors[0].properties.thickness_m == pytest.approx(MEAN)
    with pytest.raises(ValueError, match=r"thickness_m: must be given, in the material or beside it"):
        of(material, design=None, reflectance=0.5)
    with pytest.raises(InputError, match=r"thickness_m: must be given, as the table of design 'mark1e_te' does not"):
        designed(of(material), smooth_tables())


def test_every_region_of_a_sail_is_seen_to():
    cell, own = {"design": "mark1e_tm", "material": "nitride_tm"}, {"design": "mark1e_te", "material": "nitride_te"}
    scene = altered(
        FIG6,
        sail={
            "rings": 6,
            "sectors": [{"from_deg": 0.0, **own}],
            "rim": {"from_m": 0.4, "sectors": [{"from_deg": 0.0, **cell}]},
            "grid": {"x_m": [0.2], "regions": [[None, own]]},
        },
    )
    sail = designed(scene, tables()).sail
    assert [region.properties.thickness_m for region in sail.regions] == pytest.approx([MEAN] * 3)
    mesh = sail_mesh(sail)
    masses = lattice.lump(mesh, lattice.per_triangle(sail, mesh, "areal_mass"))
    assert masses.sum() == pytest.approx(2700.0 * MEAN * mesh.areas.sum(), rel=1e-12)


def test_cells_of_several_materials_or_without_a_membrane_ask_for_what_they_lack():
    two = {
        "kind": "thin_film",
        "name": "f",
        "wavelength_nm": 1550,
        "layers": [
            {"thickness_nm": 100, "index": SOLID},
            {"thickness_nm": 300, "index": {"n": 1.45}},
        ],
    }
    with pytest.raises(InputError, match=r"thickness_m: must be given: design 'mark1e_te' is of 2 materials"):
        designed(of(), tables(**two))
    region = designed(of(thickness_m=344e-9), tables(**two)).sail.sectors[0]
    assert (region.properties.thickness_m, region.carries_m) == (344e-9, pytest.approx(344e-9))
    with pytest.raises(InputError, match=r"membrane_m: must be given: nothing in design 'mark1e_te' is continuous"):
        designed(of(), tables(membrane_nm=0))
    assert designed(of(membrane_m=1e-7), tables(membrane_nm=0)).sail.sectors[0].carries_m == 1e-7
    equal = small(of(), flight={"in_plane": "mass_equivalent"})
    assert designed(equal, tables(membrane_nm=0)).sail.sectors[0].carries_m == pytest.approx(MEAN - 300e-9)


def test_the_papers_sail_weighs_what_it_did_to_the_bit(te, tm):
    cells = {"mark1e_te": te, "mark1e_tm": tm}
    known = {n: replace(t, attrs={**t.attrs, "cell": cells[n].model_dump()}) for n, t in smooth_tables().items()}
    assert sail_shape(designed(FIG6, known).sail).mass == sail_shape(FIG6.sail).mass
    scene = altered(FIG6, sail={"rings": 6})
    one, other = (build(scene, given).model.effects.sheet for given in (known, smooth_tables()))
    assert np.array_equal(one.modulus, other.modulus)
    assert np.array_equal(build(scene, known).model.masses, build(scene, smooth_tables()).model.masses)
