"""Unit cells are read strictly, and what is wrong is said in one line."""

import re
from pathlib import Path

import pytest
import yaml

from beamrider.io.files import InputError
from optics.cells.schema import read_cell, read_metagrating

DESIGN = (Path(__file__).parents[3] / "workflow/designs/mark1e_te.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("period_nm: 1600", "period_nm: -1600", r"period_nm = -1600(\.0)?: must be greater than 0"),
        ("period_nm: 1600", "period_nm: 1500nm", r'period_nm = "1500nm": must be a number'),
        ("period_nm: 1600", "perod_nm: 1600", r"unknown key 'perod_nm'; did you mean 'period_nm'\? \(allowed: .*\)"),
        ("period_nm: 1600", "", r"missing period_nm"),
        ("period_nm: 1600", "period_nm: .nan", r"period_nm = .nan: must be a finite number"),
        ("[790, 200]", "[590, 200]", r"ridges_nm\[1\] = \[590, 200\] overlaps the ridge before it: .* at least 600"),
        ("[790, 200]", "[1490, 200]", r"the last ridge ends at 1690, beyond period_nm = 1600"),
        ("[790, 200]", "[790, 0]", r"ridges_nm\[1\] = \[790, 0\]: the width must be greater than 0"),
        ("electric_axis: r", "electric_axis: x", r"electric_axis = \"x\": must be 'g' or 'r'"),
        ("kind: metagrating", "kind: grating", r"kind = \"grating\": must be one of metagrating, thin_film"),
        ("kind: metagrating", "kind: [a]", r"kind = \[\"a\"\]: must be one of metagrating, thin_film"),
        ("period_nm: 1600", "period_nm: [", r"not valid YAML"),
        ("period_nm: 1600", "period_nm: 1600\nperiod_nm: 1500", r"not valid YAML: key 'period_nm' is given twice"),
        ("name: mark1e_te", "name: ../te", r"name = "),
        ("period_nm: 1600", "period_nm: 1e300", r"period_nm = 1e\+300: must be less than or equal to 1e\+12"),
        ("wavelength_nm: 1064", "wavelength_nm: 1e-300", r"1e-300: must be greater than or equal to 0.001"),
    ],
)
def test_bad_cells_are_refused_with_file_field_and_what_is_allowed(tmp_path, old, new, message):
    assert old in DESIGN
    path = tmp_path / "cell.yaml"
    path.write_text(DESIGN.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_cell(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    assert re.search(message, text), text


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.yaml: no such file"):
        read_cell(tmp_path / "nothing.yaml")


def test_film_is_no_grating():
    with pytest.raises(InputError, match="must be metagrating"):
        read_metagrating(Path(__file__).parents[3] / "workflow/designs/si43.yaml")


def test_derived_quantities(te, tm):
    assert te.fill == pytest.approx(0.5)
    assert te.mean_thickness_nm == pytest.approx(400.0)
    assert tm.mean_thickness_nm == pytest.approx(1240 / 3)
    assert te.index.permittivity == pytest.approx((2 + 2e-6j) ** 2)


def test_a_dispersive_index_is_taken_at_the_wavelength(tmp_path, te):
    data = te.model_dump() | {"index": {"table": [[1000.0, 2.1, 0.0], [1100.0, 2.0, 1e-6]]}}
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    assert read_cell(path).index.n == pytest.approx(2.036)
    moved = read_cell(path, wavelength_nm=1050.0)
    assert (moved.index.n, moved.index.k, moved.wavelength_nm) == pytest.approx((2.05, 5e-7, 1050.0))
    with pytest.raises(InputError, match=r"index.table: wavelength_nm = 900: must be within 1000 … 1100"):
        read_cell(path, wavelength_nm=900.0)


@pytest.mark.parametrize("table", ["nitride", [[1000.0, 2.0]], [[1000.0, 2.0, 0.0]], [[1100, 2, 0], [1000, 2, 0]]])
def test_a_malformed_index_table_is_refused(tmp_path, te, table):
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(te.model_dump() | {"index": {"table": table}}), encoding="utf-8")
    with pytest.raises(InputError, match=r"index.table: must be two or more rows \[wavelength_nm, n, k\]"):
        read_cell(path)
