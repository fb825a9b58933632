"""The response around normal incidence: errors that hold, the same numbers whatever the block, and what tables note."""

import json
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from beamrider.io.files import InputError
from optics.cells.schema import Metagrating
from optics.modal import normal_incidence as local
from optics.modal.stage import solve
from optics.table.normal_incidence import table_response
from optics.table.pressure_table import PressureTable


@pytest.mark.parametrize("name", ["te", "tm"])
def test_errors_hold_against_many_orders(request, name):
    cell = request.getfixturevalue(name)
    found, fine = local.normal_response(cell, local.ORDER), local.slopes(cell, 33)
    assert np.all(np.abs(found.q - fine[0]) <= found.q_error + 1e-12)
    assert np.all(np.abs(found.gradient - fine[1]) <= found.gradient_error + 1e-9)
    assert found.q_error.max() < 2e-3
    assert found.gradient_error.max() < 1e-2


def test_slopes_are_those_of_the_solution(tm):
    q, gradient = local.slopes(tm, 10)
    step = 1e-4
    u = solve(tm, np.array([-step, 0.0, step]), np.zeros(1), 10).q[:, 0]
    v = solve(tm, np.zeros(1), np.array([0.0, step]), 10).q[0]
    assert np.allclose(q, u[1], atol=1e-12)
    assert np.allclose(gradient[:, 0], (u[2] - u[0]) / (2 * step), atol=1e-5)
    assert np.allclose(gradient[:, 1], (v[1] - v[0]) / step, atol=1e-3)
    assert gradient[1, 1] == pytest.approx((v[1] - v[0])[1] / step, rel=1e-3)


@pytest.mark.parametrize("index", [{"front": 1.0}, {"front": 1.25}, {"front": 1.0, "back": 1.25}])
def test_a_period_of_whole_wavelengths_on_either_side_has_no_slope(te, index):
    data = te.model_dump() | {"period_nm": te.wavelength_nm, "surroundings": index}
    data["period_nm"] = te.wavelength_nm / max(index.values())
    data["ridges_nm"] = [[0.0, 500.0]]
    cell = Metagrating.model_validate(data)
    assert np.isnan(local.slopes(cell, 6)[1]).all()
    axis = np.array([-0.1, 0.1])
    noted = {"normal_incidence": local.normal_response(cell, 6).as_dict()}
    table = PressureTable(axis, axis, np.zeros((3, 2, 2)), np.zeros((2, 2)), np.ones((2, 2)), attrs=noted)
    with pytest.raises(InputError, match="an order grazes at normal incidence"):
        table_response(table)


def test_a_table_tells_what_its_solver_noted(te):
    found = local.normal_response(te, 8)
    axis = np.array([-0.1, 0.1])
    table = PressureTable(
        axis, axis, np.zeros((3, 2, 2)), np.zeros((2, 2)), np.ones((2, 2)), attrs={"normal_incidence": found.as_dict()}
    )
    for name, value in vars(table_response(table)).items():
        assert np.array_equal(value, getattr(found, name))


def test_blocks_hold_the_bits_of_the_whole(tmp_path, monkeypatch, te, tm):
    (tmp_path / "cells.jsonl").write_text("\n".join(json.dumps(cell.model_dump()) for cell in (te, tm, te)) + "\n")

    def rows(block):
        out = tmp_path / "out.parquet"
        arguments = ["--cells", str(tmp_path / "cells.jsonl"), "--block", block, "--order", "6", "--out", str(out)]
        monkeypatch.setattr(sys, "argv", ["local", *arguments])
        local.main()
        return pq.read_table(out).to_pylist()

    whole = rows("1/1")
    assert [row["cell"] for row in whole] == [0, 1, 2]
    assert sorted(rows("1/2") + rows("2/2"), key=lambda row: row["cell"]) == whole
    assert rows("4/4") == []
