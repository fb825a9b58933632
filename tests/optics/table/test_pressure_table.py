"""The pressure table: exact where it must be, smooth, honest about its edge, and refused when it isn't itself."""

import h5py
import numpy as np
import pytest
import xarray as xr

from beamrider.io.checksum import append_checksum
from beamrider.io.files import InputError
from optics.table.hermite import slope_matrix
from optics.table.pressure_table import OutsideTable, PressureTable
from tests.damage import edited


def _smooth(u, v):
    q = np.stack([np.sin(6 * u) * np.cos(5 * v), 0.1 * np.sin(3 * v), np.cos(3 * u + 1) * np.cos(4 * v)], -1)
    return q, 1e-3 * (1 + u) * np.cos(v)


def _table(n=33, mirror=True):
    u = np.linspace(-0.4, 0.4, n) + 0.1 / n * np.sin(np.arange(n))
    v = np.linspace(0.0 if mirror else -0.4, 0.4, n)
    q, a = _smooth(*np.meshgrid(u, v, indexing="ij"))
    attrs = {"name": "smooth"}
    return PressureTable(u, v, np.moveaxis(q, -1, 0), a, np.full(a.shape, 1e-6), mirror_v=mirror, attrs=attrs)


def _directions(count=2000, reach=0.38):
    return np.random.default_rng(3).uniform(-reach, reach, (2, count))


def test_nodes_are_returned_exactly():
    table = _table()
    q = table.q(table.u[:, None], table.v[None, :])
    assert np.array_equal(q, np.moveaxis(table.q_nodes, 0, -1))
    assert np.array_equal(table.absorptance(table.u[:, None], table.v), table.absorptance_nodes)


@pytest.mark.parametrize("mirror", [True, False])
def test_interpolation_is_of_fourth_order(mirror):
    u, v = _directions()
    errors = [np.abs(_table(n, mirror).q(u, v) - _smooth(u, v)[0]).max() for n in (33, 65)]
    assert errors[0] < 2e-5
    assert np.log2(errors[0] / errors[1]) > 3.7


def test_gradient_is_the_derivative_of_what_is_looked_up():
    table, (u, v), h = _table(), _directions(200, 0.37), 1e-6
    gradient = table.gradient(u, v)
    assert np.allclose(gradient[..., 0], (table.q(u + h, v) - table.q(u - h, v)) / (2 * h), atol=1e-7)
    assert np.allclose(gradient[..., 1], (table.q(u, v + h) - table.q(u, v - h)) / (2 * h), atol=1e-7)


def test_value_and_slope_are_continuous_across_nodes():
    table, h = _table(), 1e-9
    inner = table.u[3:-3]
    v = np.full(inner.size, 0.123)
    assert np.allclose(table.q(inner - h, v), table.q(inner + h, v), atol=1e-7)
    assert np.allclose(table.gradient(inner - h, v), table.gradient(inner + h, v), atol=1e-6)


def test_mirror_symmetry_of_the_components():
    table, (u, v) = _table(), _directions()
    plus, minus = table.q(u, v), table.q(u, -v)
    assert np.allclose(plus * [1, -1, 1], minus, atol=1e-15)


def test_film_points_its_force_along_the_tilt():
    s = np.linspace(0, 0.9, 40)
    q = np.stack([1e-3 * s, 0 * s, np.sqrt(1 - s * s)])[..., None]
    film = PressureTable(s, np.zeros(1), q, 0 * s[:, None], np.full((40, 1), 1e-9), axisymmetric=True)
    u, v = _directions(reach=0.6)
    got = film.q(u, v)
    assert np.allclose(got[:, 0] * v, got[:, 1] * u, atol=1e-15)
    assert np.allclose(np.hypot(got[:, 0], got[:, 1]), 1e-3 * np.hypot(u, v), atol=1e-12)
    assert np.array_equal(film.q(0.0, 0.0)[:2], [0, 0])


def test_outside_is_an_error_that_names_the_direction_and_the_limits():
    with pytest.raises(OutsideTable, match=r"u = 0\.5, v = 0 is outside table 'smooth': allowed u -0\.4 … 0\.4"):
        _table().q(0.5, 0.0)


def test_nearest_returns_node_values():
    from optics.table.pressure_table import lookup

    table = _table()
    arrays = table.arrays(nearest=True)
    step = table.u[11] - table.u[10]
    got = lookup(arrays, table.u[10] + 0.4 * step, table.v[5])
    assert got[:3] == tuple(table.q_nodes[:, 10, 5])


def test_slope_matrix_is_exact_for_quartics():
    x = np.array([0.0, 0.1, 0.15, 0.4, 0.55, 0.7, 1.0])
    assert np.allclose(slope_matrix(x) @ x**4, 4 * x**3, atol=1e-12)


def test_round_trip_and_plain_readers(tmp_path):
    table, path = _table(), tmp_path / "t.h5"
    table.write(path)
    back = PressureTable.read(path)
    for name in ("u", "v", "q_nodes", "absorptance_nodes", "error"):
        assert np.array_equal(getattr(back, name), getattr(table, name))
    assert (back.mirror_v, back.name) == (True, "smooth")
    with xr.open_dataset(path, engine="h5netcdf") as data:
        assert data.q.dims == ("component", "u", "v")
        assert float(data.q.sel(component="g").isel(u=4, v=7)) == table.q_nodes[0, 4, 7]
    with h5py.File(path) as file:
        assert np.array_equal(file["q"][:], table.q_nodes)


def test_truncated_foreign_and_edited_files_are_refused_with_the_reason(tmp_path):
    path = tmp_path / "t.h5"
    _table().write(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="not whole: cut off"):
        PressureTable.read(path)
    path.write_bytes(b"not HDF5")
    append_checksum(path)
    with pytest.raises(InputError, match="not a readable HDF5 table"):
        PressureTable.read(path)
    xr.Dataset({"x": ("a", [1.0])}).to_netcdf(path, engine="h5netcdf")
    append_checksum(path)
    with pytest.raises(InputError, match="not a pressure table: 'u' is missing"):
        PressureTable.read(path)
    path.write_bytes(whole)
    with edited(path) as file:
        file["q"][0, 3, 3] += 1e-6
    with pytest.raises(InputError, match="digest differs"):
        PressureTable.read(path)
    for name, value in (("mirror_v", 0), ("name", "another"), ("mirror_v", "no"), ("schema", "abc"), ("cell", "{")):
        path.write_bytes(whole)
        with edited(path) as file:
            file.attrs[name] = value
        with pytest.raises(InputError) as caught:
            PressureTable.read(path)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="no such pressure table"):
        PressureTable.read(tmp_path / "none.h5")


def test_a_table_without_error_bars_is_refused():
    table = _table()
    with pytest.raises(InputError, match="error must be greater than 0"):
        PressureTable(table.u, table.v, table.q_nodes, table.absorptance_nodes, 0 * table.error, mirror_v=True)
