"""Narrow guided-mode resonances: found wherever they are, met by the table between its nodes, refused when damaged."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from optics.cells.schema import Metagrating
from optics.modal.response import solve
from optics.modal.stage import make_table
from optics.modal.windows import resonance_window
from optics.table.lookup import lookup, lookup_many, lookup_slopes, lookup_slopes_many
from optics.table.pole_tracks import Resonances
from optics.table.pressure_table import PressureTable
from optics.table.rational import fit
from optics.table.resonances import find_poles
from optics.waves.incidence import cutoffs
from tests.damage import edited

ORDER = 12
U_MAX, V_MAX = 0.39, 0.12


def shallow(height: float = 10.0, period: float = 900.0) -> Metagrating:
    """Shallow ridges on a slab: its guided modes hardly leak."""
    return Metagrating(
        kind="metagrating",
        name="shallow",
        wavelength_nm=1064,
        electric_axis="r",
        period_nm=period,
        ridges_nm=[[0, period / 2]],
        ridge_height_nm=height,
        membrane_nm=200,
        index={"n": 2.0, "k": 0.0},
    )


@cache
def table(height: float = 10.0, period: float = 900.0) -> PressureTable:
    return make_table(shallow(height, period), U_MAX, V_MAX, 1e-3)


def along(cell: Metagrating, order: int = ORDER) -> Callable[[Floats, float], Floats]:
    """q and absorptance of the Stokes components (16, n) at u on a line of v."""

    def response(u: Floats, v: float) -> Floats:
        found = solve(cell, u, np.array([v]), order)
        both = np.concatenate([found.q_stokes, found.absorptance_stokes[..., None]], axis=-1)
        return both[:, 0].reshape(u.size, 16).T

    return response


def beside(found: PressureTable, count: int) -> tuple[Floats, Floats]:
    """Directions some half widths away from resonances, a few widths for most, far for others."""
    rng, poles = np.random.default_rng(3), found.resonances
    assert poles is not None
    u, v = np.empty(count), rng.uniform(0.0, V_MAX, count)
    for i in range(count):
        p = rng.choice(poles.line(v[i]).p)
        u[i] = np.clip(p.real + p.imag * np.sinh(2.0 * rng.normal()), -U_MAX, U_MAX)
    return u, v


def test_a_rational_function_gives_back_its_poles_and_residues():
    """Two functions with common poles, 1e-6 and 0.02 off the real axis, from samples 0.025 apart."""
    p, c = np.array([0.3 + 1e-6j, -0.4 + 0.02j]), np.array([[1e-6j, 0.01], [2e-6, 0.02 + 0.01j]])

    def f(x: Floats) -> Floats:
        return (c @ (1.0 / (x - p[:, None]))).real + np.stack([x**2, 1.0 - x])

    x = np.unique(np.append(np.linspace(-1, 1, 81), 0.3 + 1e-6 * np.array([-9.0, -3.0, -1.0, 0.3, 1.2, 4.0, 11.0])))
    rational = fit(x, f(x), 1e-12, 20)
    found, residues = rational.poles()
    for k in range(2):
        i = np.abs(found - p[k]).argmin()
        assert abs(found[i] - p[k]) < 1e-6 * p[k].imag
        assert np.allclose(2.0 * residues[:, i], c[:, k], rtol=1e-5, atol=0)
    assert np.allclose(rational(np.array([0.123])), f(np.array([0.123])), rtol=0, atol=1e-10)


@pytest.mark.parametrize("height", [30.0, 10.0, 3.0, 1.0])
def test_resonances_are_found_however_narrow_they_are(height: float):
    """Their widths fall as the square of the height, from 1e-3 to 1e-6; in a symmetric cell they come as ±u.

    Beside the pole the response of a lossless slab passes from one extreme to the other.
    """
    cell = shallow(height)
    rows = np.linspace(-U_MAX, U_MAX, 73)
    line = find_poles(along(cell), resonance_window(cell, U_MAX, V_MAX), rows, 0.05, 1e-5)
    assert not line.missed
    p = line.p[np.argsort(line.p.real)]
    assert p.size == 4
    assert np.abs(p.real + p.real[::-1]).max() < 1e-9
    assert np.abs(p.imag / p.imag[::-1] - 1.0).max() < 1e-5
    assert 1.0e-6 < p.imag.max() / height**2 < 1.6e-6
    for x, width in zip(p.real, p.imag, strict=True):
        q = along(cell)(x + width * np.array([-30.0, -1.0, 0.0, 1.0]), 0.05)
        assert np.ptp(q, axis=1).max() > 0.3


@pytest.mark.parametrize("height", [10.0, 3.0])
def test_a_table_meets_its_tolerance_on_narrow_resonances(height: float):
    """Directions within some half widths (1.2e-4 and 1.1e-5, 7e-5 and 6e-6) of the poles, against twice the orders."""
    found, cell = table(height), shallow(height)
    assert found.attrs["tolerance_met"] == 1
    u, v = beside(found, 60)
    order = 2 * found.attrs["settings"]["orders"]
    exact = np.array([solve(cell, u[i : i + 1], v[i : i + 1], order).q[0, 0] for i in range(u.size)])
    error = np.abs(found.q(u, v) - exact).max(axis=1)
    assert error.max() < 1e-3
    assert np.ptp(exact[:, 2]) > 0.9
    i, j = (np.searchsorted(nodes, x, side="right") - 1 for nodes, x in ((found.u, u), (found.v, v)))
    i, j = np.minimum(i, found.u.size - 2), np.minimum(j, found.v.size - 2)
    stated = np.max([found.error[i + a, j + b] for a in (0, 1) for b in (0, 1)], axis=0)
    assert np.all(error <= stated)


def test_a_table_of_a_thick_grating_has_no_resonances_to_take_out():
    found = make_table(shallow(450.0), 0.12, 0.06, 1e-2)
    assert found.resonances is None


def test_resonances_add_nothing_at_no_directions():
    """A grating of short period has no cut-offs, and may have resonances all the same."""
    height = np.ones((4, 1, 2), complex)
    one = Resonances(np.array([0.0, 0.2]), np.full((1, 2), 0.1 + 1e-4j), height, np.ones(4))
    assert one.on(np.empty((0, 3)), np.zeros(3)).shape == (4, 0, 3)


def test_nodes_and_mirrored_directions_are_given_back():
    found = table()
    u, v = (x.ravel() for x in np.meshgrid(found.u, found.v, indexing="ij"))
    assert np.abs(found.q(u, v).T - found.q_nodes.reshape(3, -1)).max() < 1e-5
    u, v = beside(found, 200)
    assert np.array_equal(found.q(u, -v), found.q(u, v) * [1.0, -1.0, 1.0])
    assert np.abs(found.q(-u, v) * [-1.0, 1.0, 1.0] - found.q(u, v)).max() < 1e-3


@pytest.mark.parametrize("stokes", [False, True])
def test_many_look_ups_are_the_same_bits_as_one_by_one(stokes: bool):
    found = table()
    arrays, k = found.arrays(stokes=stokes), 16 if stokes else 4
    u, v = beside(found, 300)
    v[::2] *= -1.0
    out, slopes, one = np.empty((300, k)), np.empty((300, 3, k)), np.empty((300, 3, k))
    lookup_many(arrays, u, v, out)
    lookup_slopes_many(arrays, u, v, slopes)
    for i in range(300):
        lookup_slopes(arrays, u[i], v[i], one[i])
    assert np.array_equal(slopes, one)
    assert np.array_equal(slopes[:, 0], out)
    if not stokes:
        assert np.array_equal(out, [lookup(arrays, a, b)[:4] for a, b in zip(u, v, strict=True)])


def test_slopes_on_resonances_are_the_derivatives_of_the_values():
    """Richardson's central differences, with steps of a hundredth of the half width."""
    found = table()
    u, v = beside(found, 60)
    keep = (np.abs(u) < U_MAX - 1e-3) & (v > 2e-3) & (v < V_MAX - 1e-3)
    keep &= np.array(
        [
            min((abs(x - c) for c in cutoffs(1064 / 900, U_MAX, y)), default=1.0) > 1e-3
            for x, y in zip(u, v, strict=True)
        ]
    )
    u, v = u[keep], v[keep]
    gradient, step = found.gradient(u, v), 1e-6
    for axis, (a, b) in enumerate(((1.0, 0.0), (0.0, 1.0))):

        def at(h: float, a: float = a, b: float = b) -> Floats:
            return found.q(u + h * a, v + h * b)

        central = [(at(h) - at(-h)) / (2 * h) for h in (step, 2 * step)]
        want = (4.0 * central[0] - central[1]) / 3.0
        assert np.allclose(gradient[..., axis], want, rtol=1e-4, atol=1e-4 * np.abs(want).max())


def test_stokes_components_make_up_the_response_of_any_polarisation():
    found, cell = table(), shallow()
    u, v = beside(found, 20)
    out = np.empty((20, 16))
    lookup_many(found.arrays(stokes=True), u, v, out)
    order = found.attrs["settings"]["orders"]
    exact = np.array([along(cell, order)(u[i : i + 1], v[i])[:, 0] for i in range(20)])
    assert np.abs(out - exact).max() < 2e-3


def test_a_bound_state_in_the_continuum_is_no_trouble():
    """A resonance of a symmetric cell whose light cannot leave at u = 0: on one v its width is 0 there."""
    found = table(10.0, 911.0)
    poles = found.resonances
    assert poles is not None
    near = np.abs(poles.p.real) < 5e-3
    assert poles.p.imag[near & poles.felt].min() < 3e-5
    u, v = np.meshgrid(np.append(np.linspace(-0.02, 0.02, 41), 0.0), np.linspace(0.0, V_MAX, 301))
    assert np.isfinite(found.q(u, v)).all()
    assert np.isfinite(found.gradient(u, v)).all()
    u, v = beside(found, 60)
    order = found.attrs["settings"]["orders"]
    exact = np.array([solve(shallow(10.0, 911.0), u[i : i + 1], v[i : i + 1], order).q[0, 0] for i in range(u.size)])
    assert np.quantile(np.abs(found.q(u, v) - exact).max(axis=1), 0.9) < 1e-3


def test_a_file_gives_the_same_table_and_a_damaged_one_is_refused(tmp_path: Path):
    found = table()
    path = tmp_path / "table.h5"
    found.write(path)
    again = PressureTable.read(path)
    u, v = beside(found, 100)
    assert np.array_equal(found.q(u, v), again.q(u, v))
    for name, value in (("pole_u", -1.0), ("pole_q", np.nan), ("pole_v", 0.5), ("pole_absorptance_stokes", 1e-3)):
        found.write(path)
        with edited(path) as file:
            file[name][..., -1] = value
        with pytest.raises(InputError, match=r"pole_|changed after"):
            PressureTable.read(path)
    found.write(path)
    with edited(path) as file:
        del file["pole_u"]
    with pytest.raises(InputError, match="pole_u"):
        PressureTable.read(path)
    poles = found.resonances
    assert poles is not None
    with pytest.raises(InputError, match="pole_v"):
        replace(found, resonances=replace(poles, v=poles.v[::-1]))
