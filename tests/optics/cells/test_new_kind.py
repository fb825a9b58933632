"""A new kind of cell takes what CONTRIBUTING.md says, and no more: a model that gives polygons, and two lines."""

from typing import Any, Literal

import numpy as np
import pytest
from pydantic import model_validator

from optics.cells import cross_section, schema
from optics.cells.outline import polygons, read_grating, staircase
from optics.cells.schema import Index, Length, Profile
from optics.modal.stage import solve


class Sawtooth(Profile):
    """Triangular ridges, one a period, upright on one side; they stand on nothing."""

    kind: Literal["sawtooth"]  # type: ignore[assignment]
    height_nm: Length
    index: Index

    @model_validator(mode="before")
    @classmethod
    def _as_polygons(cls, data: dict[str, Any]) -> dict[str, Any]:
        period, height = data["period_nm"], data["height_nm"]
        tooth = {"index": data["index"], "vertices_nm": [[0, height], [period, height], [0, 0]]}
        return {**data, "depth_nm": height, "polygons": [tooth]}


def test_a_kind_of_its_own_is_read_weighed_and_solved(tmp_path, monkeypatch):
    monkeypatch.setitem(schema.KINDS, "sawtooth", Sawtooth)
    monkeypatch.setitem(cross_section._SLABS, "sawtooth", cross_section._profile)
    path = tmp_path / "saw.yaml"
    path.write_text(
        "{kind: sawtooth, name: saw, wavelength_nm: 1064, electric_axis: r, period_nm: 900, height_nm: 300, "
        "index: {n: 2}}"
    )
    cell = read_grating(path)
    ((vertices, permittivity),) = polygons(cell)
    assert (vertices.shape, permittivity) == ((3, 2), 4.0)
    assert cross_section.cross_section(cell.model_dump()).mean_m == pytest.approx(150e-9, rel=1e-12)
    u, v = np.array([0.1]), np.array([0.05])
    same = Profile.model_validate({**cell.model_dump(exclude={"height_nm", "index"}), "kind": "profile"})
    assert np.array_equal(solve(staircase(cell, 4), u, v, 6).q, solve(staircase(same, 4), u, v, 6).q)
