"""Gratings on thick layers whose fringes are kept: parts joined by exact phases, against direct solutions."""

import numpy as np
import pytest

from optics.cells.schema import Index, LamellarLayer, LamellarStack, Metagrating, Ridge, Surroundings
from optics.modal import lamellar
from optics.modal.parts import parity, part, scattering
from optics.modal.quantities import quantities
from optics.modal.stage import make_table, solve
from optics.modal.thick_tables import layers_of
from optics.table.lookup import lookup, lookup_many, lookup_slopes
from optics.table.pressure_table import PressureTable
from optics.table.promise import read_promise

RIDGES = [(50.0, 200.0, 2.2, 1e-3)]


def layer(thickness, n, k=0.0, ridges=(), coherent=True):
    return LamellarLayer(
        thickness_nm=thickness,
        index=Index(n=n, k=k),
        coherent=coherent,
        ridges=[Ridge(start_nm=a, width_nm=b, index=Index(n=m, k=k_m)) for a, b, m, k_m in ridges],
    )


def grating(layers, axis="g", period=700.0, **around):
    return LamellarStack(
        kind="lamellar",
        name="thick",
        wavelength_nm=1064.0,
        electric_axis=axis,
        period_nm=period,
        surroundings=Surroundings(**around),
        layers=layers,
    )


def sail(membrane, k=2e-6, **more):
    return Metagrating(
        kind="metagrating",
        name="sail",
        wavelength_nm=1064.0,
        electric_axis="r",
        period_nm=1600.0,
        ridges_nm=[[0.0, 600.0], [790.0, 200.0]],
        ridge_height_nm=400.0,
        membrane_nm=membrane,
        index=Index(n=2.0, k=k),
        **more,
    )


THICK = {
    "ridges in front": (sail(2e5), 1, 1),
    "thin layers beside it": (
        grating(
            [layer(100, 1.7), layer(300, 1.0, 0.0, RIDGES), layer(120, 1.3), layer(1e5, 1.5, 1e-6), layer(90, 1.9)],
            back=1.2,
        ),
        3,
        3,
    ),
    "two, and a dark back": (
        grating(
            [layer(300, 1.0, 0.0, RIDGES), layer(1e5, 1.5, 1e-6), layer(90, 1.9), layer(2e5, 1.45)],
            "r",
            front=1.2,
            back=1.5,
            back_k=0.1,
        ),
        1,
        3,
    ),
    "ridges behind": (grating([layer(1e6, 1.5, 1e-6), layer(300, 1.0, 0.0, RIDGES)], back=1.2), 0, 0),
    "ridges on both sides": (
        grating(
            [layer(200, 1.2, 0.0, [(30, 100, 2.2, 0.0)]), layer(1e5, 1.5), layer(300, 1.0, 0.0, RIDGES)], back_k=0.3
        ),
        1,
        1,
    ),
}


@pytest.mark.parametrize("name", THICK)
def test_parts_joined_are_the_whole(name):
    """In every polarisation, with the absorptance, at any angle: two ways to solve the same truncated equations."""
    cell, first, last = THICK[name]
    u, v = np.random.default_rng(1).uniform(-0.4, 0.4, (2, 8))
    of = part(lamellar.prepare(cell), first, last, 0.4)
    found = layers_of(of, cell.electric_axis).join(u, v, parts := scattering(of, u, v, 8, 1e-9))
    direct = np.stack([quantities(solve(cell, u[i : i + 1], v[i : i + 1], 8))[:, 0, 0] for i in range(u.size)], axis=1)
    assert np.abs(found - direct).max() < 1e-9
    assert np.abs(scattering(of, u, -v, 8, 1e-9) - parity(of)[:, None] * parts).max() < 1e-12


def directions(reach, count):
    return np.sort(np.random.default_rng(3).uniform(-reach, reach, count)), np.linspace(-0.97, 0.93, 4) * reach


@pytest.mark.parametrize("membrane", [3e4, 2e5, 1e6])
def test_a_table_is_as_good_as_it_says_whatever_the_thickness(membrane):
    """Fringes 2e-4 and less apart, on samples 0.01 apart."""
    cell, reach = sail(membrane), 0.1
    table = make_table(cell, reach, reach, 1e-2)
    u, v = directions(reach, 30)
    exact = solve(cell, u, v, 2 * table.attrs["settings"]["orders"])
    error, stated = np.abs(table.q(u[:, None], v) - exact.q).max(axis=-1), table.stated_error(u[:, None], v)
    assert read_promise(table).met
    assert (error <= 1e-2).mean() >= 0.99
    assert (error <= stated).mean() >= 0.99
    assert np.abs(table.absorptance(u[:, None], v) / exact.absorptance - 1).max() < 5e-3
    assert table.u.size * table.v.size < 500


def test_a_guided_wave_is_met_wherever_it_is():
    """Ridges of 10 nm on 200 µm: thousands of resonances, some 1e-6 wide; q at the steepest places among 4,000."""
    cell, reach = sail(2e5, 0.0).model_copy(update={"ridge_height_nm": 10.0}), 0.02
    table = make_table(cell, reach, reach, 1e-2)
    u = np.linspace(-reach, reach, 4000)
    q, v = table.q(u, 0.3 * reach), np.array([0.3 * reach])
    steep = u[np.argsort(-np.abs(np.diff(q[:, 2])))[:40]]
    exact = solve(cell, steep, v, 2 * table.attrs["settings"]["orders"]).q[:, 0]
    error = np.abs(table.q(steep, v) - exact).max(axis=-1)
    assert np.ptp(q[:, 2]) > 0.3  # 0.02 of it fringes of the film
    assert (error <= table.stated_error(steep, v)).mean() > 0.9
    assert np.median(error) < 1e-2
    assert np.abs(table.absorptance(u, v)).max() < 1e-9


@pytest.fixture(scope="module")
def behind():
    """Ridges behind a thick layer, in a small window: quick to make."""
    return make_table(THICK["ridges behind"][0], 0.05, 0.05, 1e-2)


def test_one_look_up_or_many_are_the_same_bits(behind, tmp_path):
    behind.write(tmp_path / "table.h5")
    again = PressureTable.read(tmp_path / "table.h5")
    u, v = np.random.default_rng(0).uniform(-0.06, 0.06, (2, 50))
    out, more, arrays = np.empty((50, 4)), np.empty((50, 4)), behind.arrays()
    outside = (np.abs(u) > 0.05) | (np.abs(v) > 0.05)
    assert lookup_many(arrays, u, v, out) == (outside.sum(), np.flatnonzero(outside)[0])
    lookup_many(again.arrays(), u, v, more)
    for i in range(u.size):
        *one, inside = lookup(arrays, u[i], v[i])
        assert np.array_equal(one, out[i])
        assert inside == (not outside[i])
    assert np.array_equal(out, more)
    assert np.array_equal(again.stated_error(u, v), behind.stated_error(u, v))
    assert again.digest == behind.digest


def test_stokes_components_make_any_light(behind):
    """s₁ = 1 is light along the ridges: that of the same cell with its axis turned."""
    turned = make_table(THICK["ridges behind"][0].model_copy(update={"electric_axis": "r"}), 0.05, 0.05, 1e-2)
    u, v, out = *np.random.default_rng(0).uniform(-0.05, 0.05, (2, 20)), np.empty((20, 16))
    lookup_many(behind.arrays(stokes=True), u, v, out)
    assert np.abs(out[:, :4] + out[:, 4:8] - np.column_stack([turned.q(u, v), turned.absorptance(u, v)])).max() < 1e-3


def test_slopes_are_those_of_the_look_up(behind):
    """Centred, and at the edges of the table to one side, over a small part of a fringe."""
    arrays, out, step = behind.arrays(), np.empty((3, 4)), 1e-8
    for u, v in ((0.0123, -0.021), (-0.04, 0.007), (0.05, 0.05)):
        lookup_slopes(arrays, u, v, out)
        sides = [behind.q(np.clip(u + a, -0.05, 0.05), v) for a in (-step, step)]
        width = np.clip(u + step, -0.05, 0.05) - (u - step)
        assert np.abs((sides[1] - sides[0]) / width - out[1, :3]).max() < 1e-3 * max(1.0, np.abs(out[1]).max())
        assert np.array_equal(out[0, :3], behind.q(u, v))
