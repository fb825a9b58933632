"""Regions of one sail, each with its own material, thickness and response to light: sums over them in closed form."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.output.record import COLUMNS
from tests.dynamics.test_light_on_sails import plain_film_table
from tests.membranes import FILM, dark, film, steps

WIDE = {"intensity_W_m2": 1e9, "radius_m": 1e4, "on_s": 1.0}
COLD = {"emissivity_front": 0.0, "emissivity_back": 0.0, "conductivity_W_mK": 0.0}


def region(reflectance: float, absorptance: float, thickness: float, **other: Any) -> dict[str, Any]:
    """A region of constant response."""
    material = {**FILM, **COLD, "absorptance": absorptance}
    return {"material": material, "thickness_m": thickness, "reflectance": reflectance, **other}


MAPS: dict[str, dict[str, Any]] = {
    "sectors": {"sectors": [region(0.2, 1e-3, 2e-7, from_deg=30.0), region(0.7, 3e-3, 6e-7, from_deg=150.0)]},
    "sectors with a rim": {
        "sectors": [region(0.2, 1e-3, 2e-7, from_deg=30.0), region(0.7, 3e-3, 6e-7, from_deg=150.0)],
        "rim": {
            "from_m": 0.4,
            "sectors": [
                region(0.9, 0.0, 4e-7, from_deg=0.0),
                region(0.1, 2e-3, 3e-7, from_deg=90.0),
            ],
        },
    },
    "grid": {
        "sectors": [region(0.5, 1e-3, 4e-7, from_deg=0.0)],
        "grid": {
            "x_m": [-0.2, 0.2],
            "y_m": [0.0],
            "regions": [
                [region(0.1, 2e-3, 2e-7), None, region(0.8, 1e-4, 5e-7)],
                [None, region(0.3, 3e-3, 6e-7), None],
            ],
        },
    },
}


@pytest.mark.parametrize("outline", ["round", "hexagonal", "square"])
@pytest.mark.parametrize("kind", list(MAPS))
def test_force_heat_and_mass_are_sums_over_the_regions(tmp_path: Path, kind: str, outline: str):
    """F_z = Σ (2R + a) I A/c, absorbed Σ a I A, mass Σ ρ h A."""
    flight = Flight(dark(6, sail={**MAPS[kind], "outline": outline}, beam=WIDE), {}, tmp_path)
    flight.step = flight.model.release + 8
    row = steps(flight, 0)[0]
    sail, mesh = flight.membrane.scene.sail, flight.membrane.mesh
    area = np.bincount(mesh.sector, mesh.areas, minlength=len(sail.regions))
    assert np.all(area > 0.01)
    reflectance = np.array([r.reflectance for r in sail.regions])
    absorptance, thickness = (
        np.array([getattr(r.properties, name) for r in sail.regions]) for name in ("absorptance", "thickness_m")
    )
    push = (2 * reflectance + absorptance) @ area * 1e9 / LIGHT_SPEED
    assert row[COLUMNS["force"] + 2] == pytest.approx(push, rel=1e-6)
    assert row[COLUMNS["power_absorbed"]] == pytest.approx(absorptance @ area * 1e9, rel=1e-6)
    assert flight.model.masses.sum() == pytest.approx(2700.0 * thickness @ area, rel=1e-12)


def test_each_region_heats_by_its_own_absorptance_and_thickness():
    """T − T₀ = a I t/(ρ h c) at nodes whose triangles all belong to one region."""
    scene = dark(
        6,
        sail=MAPS["sectors with a rim"],
        beam=WIDE,
        effects={"tensile_failure": False, "expansion": False},
        flight={"duration_s": 1e-4, "heat_every": 1, "fly_away_m": 1e9},
    )
    flight, end, _ = fly(scene, {})
    assert end.reason == "finished"
    mesh, regions = flight.membrane.mesh, flight.membrane.scene.sail.regions
    time, seen = 1e-4 - 0.5e-6, 0
    for k, given in enumerate(regions):
        inside = np.setdiff1d(mesh.triangles[mesh.sector == k], mesh.triangles[mesh.sector != k])
        material = given.properties
        want = material.absorptance * 1e9 * time / (material.areal_mass * 800.0)
        got = flight.state.temperature[inside] - 300.0
        late = want / time * 2.0 * flight.model.dt
        assert np.all(np.abs(got - want) <= late + 1e-9)
        seen += inside.size
    assert seen > 60


def test_a_tabled_and_a_constant_region_lie_side_by_side(tmp_path: Path):
    """A film given by its table in one half, by its numbers in the other: light sees no seam."""
    constant = film(reflectance=0.45, absorptance=0.3)[0]
    tabled = {"from_deg": 180.0, "material": constant["material"], "design": "specular"}
    rows = []
    for sectors in ([{**constant, "from_deg": 0.0}, tabled], [{**constant, "from_deg": 0.0}]):
        scene = dark(6, sail={"sectors": sectors}, beam={"intensity_W_m2": 1e9, "radius_m": 0.4, "on_s": 1.0})
        tables = plain_film_table() if len(sectors) == 2 else {}
        flight = Flight(scene, tables, tmp_path / str(len(sectors)))
        flight.step = flight.model.release + 8
        rows.append(steps(flight, 0)[0])
    force = slice(COLUMNS["force"], COLUMNS["force"] + 3)
    assert np.abs(rows[0][force] - rows[1][force]).max() < 1e-6 * np.linalg.norm(rows[1][force])
