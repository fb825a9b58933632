"""Gratings on thick membranes: fringes averaged, as powers of the orders to and fro."""

from time import process_time

import numpy as np
import pytest

from beamrider.io.files import InputError
from optics.cells.schema import (
    Index,
    LamellarLayer,
    LamellarStack,
    Layer,
    Metagrating,
    Ridge,
    Surroundings,
    ThinFilm,
    require_coherent,
)
from optics.modal import stage as modal
from optics.modal.derivatives import derivatives
from optics.modal.stage import make_table
from optics.modal.thick_fringes import least_thickness
from optics.thin_film.stage import pressure


def layer(thickness, n, k=0.0, ridges=(), coherent=True):
    return LamellarLayer(
        thickness_nm=thickness,
        index=Index(n=n, k=k),
        coherent=coherent,
        ridges=[Ridge(start_nm=a, width_nm=b, index=Index(n=m)) for a, b, m in ridges],
    )


def grating(layers, axis, period, back=1.0):
    return LamellarStack(
        kind="lamellar",
        name="thick",
        wavelength_nm=1064.0,
        electric_axis=axis,
        period_nm=period,
        surroundings=Surroundings(back=back),
        layers=layers,
    )


def sail(k=2e-6, **more):
    return Metagrating(
        kind="metagrating",
        name="sail",
        wavelength_nm=1064.0,
        electric_axis="r",
        period_nm=1600.0,
        ridges_nm=[[0.0, 600.0], [790.0, 200.0]],
        ridge_height_nm=400.0,
        membrane_nm=2e5,
        index=Index(n=2.0, k=k),
        **more,
    )


@pytest.mark.parametrize(("axis", "polarisation"), [("r", "s"), ("g", "p")])
def test_without_ridges_it_is_the_film(axis, polarisation):
    """Two averaged layers, so the film's mode of tmm: tests/optics/thin_film/test_thick_layers.py."""
    parts = [(120.0, 2.0, 0.0, True), (1e5, 1.5, 1e-6, False), (80.0, 1.8, 0.0, True), (2e4, 1.4, 1e-6, False)]
    plain = ThinFilm(
        kind="thin_film",
        name="film",
        wavelength_nm=1064.0,
        polarisation=polarisation,
        layers=[Layer(thickness_nm=t, index=Index(n=n, k=k), coherent=c) for t, n, k, c in parts],
        surroundings=Surroundings(back=1.2),
    )
    u = np.array([-0.7, -0.1, 0.0, 0.33, 0.8])
    found = modal.solve(grating([layer(t, n, k, (), c) for t, n, k, c in parts], axis, 900.0, 1.2), u, np.zeros(1), 3)
    q, light = pressure(plain, u)
    assert np.abs(found.q[:, 0] - q).max() < 1e-13
    assert np.abs(found.absorptance[:, 0] - light.absorptance).max() < 1e-13


@pytest.mark.parametrize("axis", ["r", "g"])
@pytest.mark.parametrize(("k", "tolerance"), [(0.0, 1e-12), (3e-6, 2e-6)])
@pytest.mark.parametrize(("u", "v"), [(-0.5, 0.0), (0.0, 0.3), (0.55, 0.5)])
def test_where_one_order_runs_inside_it_is_the_mean_over_thicknesses(u, v, k, tolerance, axis):
    """64 thicknesses over half a wavelength sum every round trip exactly; absorbing ones decay by 1e-6 more or less."""

    def cell(thickness, coherent):
        ridges = layer(200, 1.0, 0.0, [(50, 150, 2.2)])
        return grating([ridges, layer(thickness, 1.5, k, (), coherent), layer(100, 1.3)], axis, 330.0)

    period = 532.0 / np.sqrt(1.5**2 - u * u - v * v)
    u, v = np.array([u]), np.array([v])
    mean = np.mean(
        [modal.solve(cell(1e5 + share * period, True), u, v, 10).q_stokes[0, 0] for share in np.arange(-32, 32) / 64],
        axis=0,
    )
    assert np.abs(modal.solve(cell(1e5, False), u, v, 10).q_stokes[0, 0] - mean).max() < tolerance


def test_with_many_orders_inside_it_is_the_mean_over_thicknesses_within_its_spread():
    """Of 300 membranes within ±10 %: what of their fringes is left in the mean has a spread, and is within three."""
    u, v = np.array([0.12]), np.array([0.2])
    many = np.array(
        [
            modal.solve(sail().model_copy(update={"membrane_nm": 2e5 + more}), u, v, 12).q[0, 0]
            for more in np.random.default_rng(0).uniform(-2e4, 2e4, 300)
        ]
    )
    found = modal.solve(sail(membrane_coherent=False), u, v, 12).q[0, 0]
    spread = many.std(axis=0) / np.sqrt(len(many))
    assert spread.max() < 0.015
    assert np.all(np.abs(found - many.mean(axis=0)) < 3 * spread)


def test_no_light_is_lost_between_lossless_orders():
    found = modal.solve(sail(0.0, membrane_coherent=False), np.linspace(-0.4, 0.4, 5), np.linspace(0, 0.4, 3), 12)
    assert np.abs(found.absorptance).max() < 1e-11


def test_a_table_of_a_sail_with_a_thick_membrane_is_as_good_as_it_says():
    cell = sail(membrane_coherent=False)
    table = make_table(cell, 0.1, 0.1, 2e-2)
    u, v = np.random.default_rng(0).uniform(-0.1, 0.1, (2, 60))
    exact = np.array([modal.solve(cell, u[i : i + 1], v[i : i + 1], 40).q[0, 0] for i in range(u.size)])
    assert table.u.size < 60
    assert np.abs(table.q(u, v) - exact).max() < table.error.max()


def test_solvers_that_know_fields_alone_say_so():
    for cell in (sail(membrane_coherent=False), grating([layer(1e5, 1.5, 0.0, (), False)], "r", 900.0)):
        with pytest.raises(InputError, match=r"coherent = false: must be true for derivatives"):
            derivatives(cell, 0.0, 0.0, 3)
    require_coherent(sail(), "anything")
    with pytest.raises(ValueError, match="must be true for a layer with ridges"):
        grating([layer(200, 1.0, 0.0, [(50, 150, 2.2)], False)], "r", 900.0)
    with pytest.raises(ValueError, match="kind: lamellar"):
        sail(membrane_coherent=False, corner_radius_nm=20.0)


def test_layers_too_thick_for_samples_are_told_at_once():
    """Thin ones are sampled, however wide the window; thick ones in a narrow window too."""
    assert least_thickness(sail(), 0.4227, 0.4227, 1e-2) == 2e5
    assert least_thickness(sail().model_copy(update={"membrane_nm": 2e3}), 0.4227, 0.4227, 1e-2) == np.inf
    assert least_thickness(sail().model_copy(update={"membrane_nm": 2e4}), 0.03, 0.03, 1e-2) == np.inf


def test_fringes_that_no_table_could_hold_are_refused_at_once():
    """One line that names the layer, its fringes and the thickness up to which they could be held."""
    began = process_time()
    wide = sail().model_copy(update={"period_nm": 8000.0})
    with pytest.raises(InputError, match=r"membrane_nm = 200000: makes \d+ fringes .* at most .*, .*average"):
        make_table(wide, 0.4227, 0.4227, 1e-2)
    assert process_time() - began < 20.0
    part = layer(200, 1.0, 0.0, [(50, 150, 2.2)])
    with pytest.raises(InputError, match=r"layers\[1\].thickness_nm = 1e\+06: .*averaged"):
        least_thickness(grating([part, layer(1e6, 1.5), layer(1e5, 1.6, 0.0, (), False)], "r", 330.0), 0.4, 0.4, 1e-3)
    with pytest.raises(InputError, match=r"ridges between two"):
        least_thickness(grating([layer(1e6, 1.5), part, layer(1e6, 1.5)], "r", 330.0), 0.4, 0.4, 1e-3)


def test_layers_that_make_no_fringes_to_speak_of_are_let_through():
    """One that light does not cross, and one between its like: their thickness is no matter."""
    dark = grating([layer(200, 1.0, 0.0, [(50, 150, 2.2)]), layer(1e6, 1.5, 1e-3)], "r", 330.0)
    same = grating([layer(200, 1.0, 0.0, [(50, 150, 2.2)]), layer(1e6, 1.0)], "r", 330.0)
    for cell in (dark, same):
        assert least_thickness(cell, 0.4, 0.4, 1e-3) == np.inf
    assert least_thickness(grating([dark.layers[0], layer(1e6, 1.5)], "r", 330.0), 0.4, 0.4, 1e-3) == 1e6
