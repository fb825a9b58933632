"""Films: against Fresnel, an independent transfer-matrix code, high precision, and laws."""

import mpmath
import numpy as np
import pytest
import tmm

from optics.cells import Index, Layer, Surroundings, ThinFilm
from optics.table import PressureTable
from optics.thin_film import make_table, pressure, solve


def film(layers, polarisation="mean", wavelength=1550.0, back=1.0):
    return ThinFilm(
        kind="thin_film", name="film", wavelength_nm=wavelength, polarisation=polarisation,
        layers=[Layer(thickness_nm=t, index=Index(n=n, k=k)) for t, n, k in layers],
        surroundings=Surroundings(back=back),
    )


# Gao, Kelzenberg & Atwater use these films at 1550 nm; R and a evaluated from Airy's formula.
@pytest.mark.parametrize(
    ("layer", "degrees", "reflectance", "absorptance"),
    [
        ((43, 3.48, 1.2e-6), 0, 0.452992, 7.131e-7),
        ((43, 3.48, 1.2e-6), 30, 0.44802, None),
        ((43, 3.48, 1.2e-6), 60, 0.43755, None),
        ((43, 3.48, 1.2e-6), 80, 0.51495, None),
        ((43, 3.48636, 1.29905e-7), 0, 0.454851, 7.704e-8),
        ((37, 2.0, 4e-6), 0, 0.04682, 2.237e-6),
    ],
)
def test_values_of_the_papers_films(layer, degrees, reflectance, absorptance):
    response = solve(film([layer]), np.sin(np.radians([degrees])))
    assert response.reflectance[0] == pytest.approx(reflectance, abs=5e-6)
    if absorptance is not None:
        assert response.absorptance[0] == pytest.approx(absorptance, rel=2e-4)


@pytest.mark.parametrize("polarisation", ["s", "p"])
def test_twenty_layers_agree_with_an_independent_code(polarisation):
    rng = np.random.default_rng(5)
    layers = [(rng.uniform(20, 400), rng.uniform(1.2, 3.6), rng.choice([0.0, 1e-3, 0.2])) for _ in range(20)]
    angles = np.linspace(0, 1.5, 40)
    ours = solve(film(layers, polarisation, back=1.5), np.sin(angles))
    indices = [1.0, *(complex(n, k) for _, n, k in layers), 1.5]
    thicknesses = [np.inf, *(t for t, _, _ in layers), np.inf]
    for i, angle in enumerate(angles):
        other = tmm.coh_tmm(polarisation, indices, thicknesses, angle, 1550.0)
        assert ours.reflectance[i] == pytest.approx(other["R"], abs=1e-12)
        assert ours.transmittance[i] == pytest.approx(other["T"], abs=1e-12)


def test_frustrated_total_reflection_through_twenty_wavelengths():
    """A gap of 20 λ below the critical angle's cosine: T is 1e-70 or so, where transfer matrices overflow."""
    around = Surroundings(front=2.0, back=2.0)
    cell = film([(20 * 1550.0, 1.0, 0.0)], "s").model_copy(update={"surroundings": around})
    s = 1.2
    with mpmath.workdps(50):
        w, kappa = mpmath.sqrt(4 - mpmath.mpf(s) ** 2), mpmath.sqrt(mpmath.mpf(s) ** 2 - 1)
        sinh = mpmath.sinh(kappa * 2 * mpmath.pi * 20)
        exact = 1 / (1 + ((w**2 + kappa**2) / (2 * w * kappa)) ** 2 * sinh**2)
    assert solve(cell, np.array([s])).transmittance[0] == pytest.approx(float(exact), rel=1e-10)


def test_five_hundred_quarter_wave_layers_reflect_all_and_lose_nothing():
    pair = [(1550 / 4 / 2.3, 2.3, 0.0), (1550 / 4 / 1.45, 1.45, 0.0)]
    response = solve(film(pair * 250), np.sin(np.radians([0.0, 20.0])))
    assert np.abs(response.reflectance - 1).max() < 1e-12
    assert np.abs(response.absorptance).max() < 1e-12


def test_momentum_of_a_specular_film():
    """F = (P/c)[2R (k·n) n + a k] (Gao, Kelzenberg & Atwater, specular model) is the same statement."""
    s = np.linspace(0, 0.99, 50)
    q, response = pressure(film([(43, 3.48, 0.05)]), s)
    w = np.sqrt(1 - s * s)
    assert np.allclose(q[:, 0], response.absorptance * s, atol=1e-15)
    assert np.allclose(q[:, 2], 2 * response.reflectance * w + response.absorptance * w, atol=1e-14)


def test_table_is_as_good_as_it_says():
    cell = film([(43, 3.48, 1.2e-6)])
    table = make_table(cell, 0.999, 1e-6)
    s = np.random.default_rng(0).uniform(0, 0.99, 2000)
    error = np.abs(table.q(s, 0.0) - pressure(cell, s)[0]).max(axis=1)
    assert error.max() < 2e-6
    assert isinstance(table, PressureTable)
    assert table.error.max() < 2e-6
