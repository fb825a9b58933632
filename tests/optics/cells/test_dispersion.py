"""Dispersive indices: formulas against values known elsewhere, files as refractiveindex.info gives them, refusals."""

import math

import numpy as np
import pytest
import yaml

from beamrider.io.files import InputError
from optics.cells import dispersion
from optics.cells.schema import read_cell

CELL = {
    "kind": "metagrating",
    "name": "own",
    "wavelength_nm": 1064.0,
    "electric_axis": "r",
    "period_nm": 1600.0,
    "ridges_nm": [[0.0, 600.0], [790.0, 200.0]],
    "ridge_height_nm": 400.0,
    "membrane_nm": 200.0,
}
X = 1.064
#: Coefficients, λ in µm, n: of BK7 (Schott, d line), air (Ciddor 1996, 633 nm), and the rest written out.
FORMULAS = [
    (1, "0 0.6961663 0.0684043 0.4079426 0.1162414 0.8974794 9.896161", 0.5875618, 1.4584637, 1e-7),
    (2, "0 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653", 0.5875618, 1.51680, 5e-6),
    (3, "2.3 -0.01 2 0.02 -2", X, math.sqrt(2.3 - 0.01 * X**2 + 0.02 / X**2), 1e-15),
    (
        4,
        "2.7359 0.01878 0 0.01822 1 0 0 0 1 -0.01354 2",
        X,
        math.sqrt(2.7359 + 0.01878 / (X**2 - 0.01822) - 0.01354 * X**2),
        1e-15,
    ),
    (4, "2.1 0.5 2 0.1 2 0.2 0 9.0 1", X, math.sqrt(2.1 + 0.5 * X**2 / (X**2 - 0.01) + 0.2 / (X**2 - 9.0)), 1e-15),
    (5, "1.5 0.004 -2", X, 1.5 + 0.004 / X**2, 1e-15),
    (6, "0 0.05792105 238.0185 0.00167917 57.362", 0.633, 1.000276530, 1e-8),
    (
        7,
        "3.41983 0.159906 -0.123109 1.26878E-6 -1.95104E-9",
        X,
        3.41983 + 0.159906 / (X**2 - 0.028) - 0.123109 / (X**2 - 0.028) ** 2 + 1.26878e-6 * X**2 - 1.95104e-9 * X**4,
        1e-15,
    ),
    (8, "0.2 0.1 0.02 -0.001", X, None, 1e-15),
    (
        9,
        "2.51527 0.0240 0.0300 0.020 1.52 0.8771",
        X,
        math.sqrt(2.51527 + 0.0240 / (X**2 - 0.03) + 0.02 * (X - 1.52) / ((X - 1.52) ** 2 + 0.8771)),
        1e-15,
    ),
]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Paths of files are below the present folder."""
    monkeypatch.chdir(tmp_path)


def record(tmp_path, parts, name="own.yml"):
    (tmp_path / name).write_text(yaml.safe_dump({"REFERENCES": "A. <i>Person</i>\n 2020", "DATA": parts}))
    return dispersion.of_file(name)


def read(tmp_path, index, wavelength=None):
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(CELL | {"index": index}))
    return read_cell("own.yaml", wavelength)


@pytest.mark.parametrize(("kind", "coefficients", "x", "n", "error"), FORMULAS)
def test_formulas_give_what_is_known(tmp_path, kind, coefficients, x, n, error):
    part = {"type": f"formula {kind}", "wavelength_range": "0.2 6", "coefficients": coefficients}
    found, k = record(tmp_path, [part]).at(1000.0 * x)
    if kind == 8:  # (n² − 1)/(n² + 2)
        found, n = (found**2 - 1.0) / (found**2 + 2.0), 0.2 + 0.1 * X**2 / (X**2 - 0.02) - 0.001 * X**2
    assert found == pytest.approx(n, abs=2 * error)
    assert k == 0.0


@pytest.mark.parametrize(
    ("name", "wavelength", "n", "k"),
    [
        ("Si3N4", 1064.0, 2.0112, 0.0),
        ("SiO2", 1064.0, 1.44963, 0.0),
        ("Si", 1200.0, 3.520, 2.1008e-7),
        ("MoS2", 1300.0, 4.135279, 1.875827e-4),
    ],
)
def test_built_in_materials(tmp_path, name, wavelength, n, k):
    index = read(tmp_path, {"material": name}, wavelength).index
    assert (index.n, index.k) == pytest.approx((n, k), abs=5e-6, rel=2e-5)
    assert "doi:" in index.source
    assert read(tmp_path, {"material": name, "k": 1e-3}, wavelength).index.k == 1e-3
    for first in (10.0, 1e5):
        with pytest.raises(InputError, match=rf"own.yaml: index.material: wavelength_nm = {first:g}: must be within"):
            read(tmp_path, {"material": name}, first)


def test_tables_are_smooth_and_never_overshoot():
    rows = [[1000.0, 2.1, 0.0], [1100.0, 2.0, 1e-6], [1150.0, 2.0, 2e-6], [1300.0, 1.9, 2e-6]]
    curve = dispersion.of_rows(rows, "rows")
    x = np.linspace(1000.0, 1300.0, 601)
    n, k = np.array([curve.at(w) for w in x]).T
    assert [curve.at(row[0]) for row in rows] == [(row[1], row[2]) for row in rows]
    assert np.all(np.diff(n) <= 1e-15)
    assert np.all(np.diff(k) >= -1e-21)
    assert np.abs(np.diff(n, 2)).max() < 2e-5  # no kinks: a step of 0.5 nm turns the slope by little


def test_csv_exports_have_a_block_of_n_and_one_of_k(tmp_path):
    (tmp_path / "au.csv").write_text("wl,n\n0.5,0.85\n1.0,0.25\n1.5,0.5\n\nwl,k\n0.6,2.9\n1.0,6.5\n1.4,9.3\n")
    curve = dispersion.of_file("au.csv")
    assert curve.at(1000.0) == (0.25, 6.5)
    assert (curve.first_nm, curve.last_nm) == pytest.approx((600.0, 1400.0))
    (tmp_path / "one.csv").write_text("wl,n,k\n0.5,2.0,0.1\n1.0,2.1,0.2\n")
    assert dispersion.of_file("one.csv").at(1000.0) == (2.1, 0.2)


def test_a_record_of_a_formula_and_a_table_of_k(tmp_path):
    parts = [
        {"type": "formula 5", "wavelength_range": "0.4 2", "coefficients": 1.5},
        {"type": "tabulated k", "data": "0.5 1e-5\n1 2e-5\n1.5 3e-5"},
    ]
    curve = record(tmp_path, parts)
    assert curve.at(1000.0) == (1.5, 2e-5)
    assert curve.told == "own.yml (A. Person 2020), 500 … 1500 nm"
    assert read(tmp_path, {"file": "own.yml"}, 1000.0).index.source == curve.told


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ([], "DATA must be a list of its parts"),
        ([{"type": "formula 12", "wavelength_range": "1 2", "coefficients": "1"}], "must be formula 1 … 9"),
        ([{"type": "formula 1", "wavelength_range": "1 2", "coefficients": "0 1 two"}], "must be numbers"),
        ([{"type": "formula 1", "wavelength_range": "1 2", "coefficients": "0 1"}], "must be 3 to 31 numbers"),
        ([{"type": "formula 1", "wavelength_range": "1 2", "coefficients": "0 1 1 2"}], "must be an odd number"),
        ([{"type": "formula 1", "wavelength_range": "2 1", "coefficients": "0 1 1"}], "two ascending wavelengths"),
        ([{"type": "tabulated nk", "data": "1 2\n2 2"}], "rows of a wavelength in µm and n and k"),
        ([{"type": "tabulated n", "data": "1 2\n1 2"}], "ascending wavelengths"),
        ([{"type": "tabulated n", "data": "1 -2\n2 2"}], "n must be greater than 0"),
        ([{"type": "tabulated n", "data": "1 nan\n2 2"}], "n must be greater than 0"),
        ([{"type": "tabulated k", "data": "1 0\n2 0"}], "must give n"),
    ],
)
def test_malformed_records_are_refused_in_a_line(tmp_path, parts, said):
    with pytest.raises(ValueError, match=said):
        record(tmp_path, parts)
    with pytest.raises(InputError, match=rf"own.yaml: index\b.*{said}") as refused:
        read(tmp_path, {"file": "own.yml"})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("index", "said"),
    [
        ({"material": "Unobtainium"}, r'index.material = "Unobtainium": must be one of MoS2, Si, Si3N4, SiO2'),
        ({"sellmeier": [[1.0, 0.1]]}, "index: missing range_nm"),
        ({"sellmeier": [[1.0, 0.1]], "range_nm": [2000.0, 100.0]}, "two ascending wavelengths"),
        ({"sellmeier": [[-9.0, 0.1]], "range_nm": [100.0, 2000.0]}, "formula 1 gives n = nan"),
        ({"file": "/etc/passwd"}, "must be a path of a .yml, .yaml or .csv file below this folder"),
        ({"file": "a/../../b.csv"}, "below this folder"),
        ({"file": "none.csv"}, r"cannot be read \(No such file or directory\)"),
        ({"material": "Si", "table": [[1000.0, 2.0, 0.0], [1100.0, 2.0, 0.0]]}, "table, material: must be one of them"),
        ({"material": "Si", "k": -1.0}, "index.k = -1.0: must be greater than or equal to 0"),
    ],
)
def test_what_names_no_index_is_refused_in_a_line(tmp_path, index, said):
    with pytest.raises(InputError, match=said) as refused:
        read(tmp_path, index)
    assert "\n" not in str(refused.value)


def test_sellmeier_terms_are_those_of_the_material(tmp_path):
    terms = {"sellmeier": [[3.0249, 0.1353406], [40314.0, 1239.842]], "range_nm": [310.0, 5504.0]}
    for wavelength in (400.0, 1064.0, 1303.1, 5000.0):
        assert read(tmp_path, terms, wavelength).index.n == read(tmp_path, {"material": "Si3N4"}, wavelength).index.n
