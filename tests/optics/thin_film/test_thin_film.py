"""Films: against Fresnel, an independent transfer-matrix code, high precision, and laws."""

from itertools import product

import numpy as np
import pytest
import tmm
from scipy import special

from optics.cells.schema import Index, Layer, Surroundings, ThinFilm
from optics.table.pressure_table import PressureTable
from optics.thin_film.stage import P_SHARE, make_table, momentum, pressure, solve, stack
from tests.films import exact


def film(layers, polarisation="mean", wavelength=1550.0, back=1.0):
    return ThinFilm(
        kind="thin_film",
        name="film",
        wavelength_nm=wavelength,
        polarisation=polarisation,
        layers=[Layer(thickness_nm=t, index=Index(n=n, k=k)) for t, n, k in layers],
        surroundings=Surroundings(back=back),
    )


# Gao, Kelzenberg & Atwater use these films at 1550 nm; R and a evaluated from Airy's formula.
@pytest.mark.parametrize(
    ("layer", "degrees", "reflectance", "absorptance"),
    [
        ((43, 3.48, 1.2e-6), 0, 0.452992, 7.131e-7),
        ((43, 3.48, 1.2e-6), 30, 0.44802, None),
        ((43, 3.48, 1.2e-6), 45, 0.44209, None),
        ((43, 3.48, 1.2e-6), 60, 0.43755, None),
        ((43, 3.48, 1.2e-6), 70, 0.44545, None),
        ((43, 3.48, 1.2e-6), 80, 0.51495, None),
        ((43, 3.48636, 1.29905e-7), 0, 0.454851, 7.704e-8),
        ((43, 3.48, 4e-6), 0, None, 2.377e-6),
        ((37, 2.0, 4e-6), 0, 0.04682, 2.237e-6),
    ],
)
def test_values_of_the_papers_films(layer, degrees, reflectance, absorptance):
    response = solve(film([layer]), np.sin(np.radians([degrees])))
    if reflectance is not None:
        assert response.reflectance[0] == pytest.approx(reflectance, abs=5e-6)
    if absorptance is not None:
        assert response.absorptance[0] == pytest.approx(absorptance, rel=2e-4)


def random_stack(seed, layers=20, back=1.5 + 0.1j, k=(0.0, 1e-3, 0.2)):
    """Indices and thicknesses in nm of some stack."""
    rng = np.random.default_rng(seed)
    inside = rng.uniform(1.2, 3.6, layers) + 1j * rng.choice(k, layers)
    return np.array([1.2, *inside, back]), rng.uniform(20, 400, layers)


@pytest.mark.parametrize("polarisation", ["s", "p"])
@pytest.mark.parametrize("back", [1.5, 1.1, 1.5 + 0.1j])
def test_twenty_layers_agree_with_an_independent_code(polarisation, back):
    """Also where the half-space behind absorbs, or reflects totally: its flux is that just inside."""
    index, thickness = random_stack(5, back=back)
    angles = np.linspace(0, 1.5, 40)
    ours = stack(index, thickness, 1550.0, 1.2 * np.sin(angles), P_SHARE[polarisation])
    for i, angle in enumerate(angles):
        other = tmm.coh_tmm(polarisation, index, [np.inf, *thickness, np.inf], angle, 1550.0)
        assert ours.reflectance[i] == pytest.approx(other["R"], abs=1e-12)
        assert ours.transmittance[i] == pytest.approx(other["T"], abs=1e-12)


def test_wavelengths_angles_and_polarisations_at_once_are_the_same_as_one_by_one():
    """Dispersion: the index is a function of the wavelength, along an axis of its own."""
    wavelength = np.linspace(1000.0, 1600.0, 4)
    silicon = 3.4 + (500.0 / wavelength) ** 2 + 1j * 1e-3 * (1000.0 / wavelength) ** 3
    index = np.stack([np.ones(4), silicon, np.full(4, 1.45), np.ones(4)], axis=-1)
    s, share = np.linspace(-0.9, 0.9, 5), np.array([0.0, 0.5, 1.0])
    table = stack(index[:, None], [43.0, 200.0], wavelength[:, None], s, share[:, None, None])
    assert table.reflectance.shape == (3, 4, 5)
    for i, j, k in np.ndindex(3, 4, 5):
        one = stack(index[j], [43.0, 200.0], wavelength[j], s[k], share[i])
        assert table.reflectance[i, j, k] == one.reflectance
        assert table.transmittance[i, j, k] == one.transmittance
        assert table.absorptance[i, j, k] == one.absorptance


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_reflected_transmitted_and_dissipated_light_is_all_there_is(share):
    """The three are computed apart: loss from the fields in each layer."""
    s = np.linspace(-1.2, 1.2, 201)
    for seed in range(20):
        assert np.abs(stack(*random_stack(seed), 1550.0, s, share).imbalance).max() < 1e-12


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_stack_transmits_as_much_either_way(share):
    """Reciprocity (Born & Wolf, §1.6.4), with loss or without; without, the reflectances are equal too."""
    s = np.linspace(0, 1.19, 50)
    for k in ((0.0,), (0.0, 1e-2)):
        index, thickness = random_stack(7, back=1.5, k=k)
        ahead = stack(index, thickness, 1550.0, s, share)
        behind = stack(index[::-1], thickness[::-1], 1550.0, s, share)
        assert np.allclose(ahead.transmittance, behind.transmittance, rtol=1e-12, atol=0)
        assert np.allclose(ahead.reflectance, behind.reflectance, atol=1e-12) == (k == (0.0,))


def test_no_p_light_is_reflected_at_brewsters_angle():
    s = np.sin(np.arctan(2.0))
    assert stack([1, 2, 1], [300.0], 1550.0, s, 1.0).reflectance < 1e-30


@pytest.mark.parametrize("pairs", [1, 5, 20])
def test_quarter_wave_mirrors_have_their_closed_form(pairs):
    """(HL)^N on a substrate, R = ((n₀ n_L^2N − n_s n_H^2N)/(n₀ n_L^2N + n_s n_H^2N))² (Macleod, §5.1)."""
    high, low, substrate = 2.3, 1.45, 1.52
    thickness = [1550 / 4 / high, 1550 / 4 / low] * pairs
    response = stack([1.0, *[high, low] * pairs, substrate], thickness, 1550.0, 0.0)
    ratio = substrate * (high / low) ** (2 * pairs)
    assert response.reflectance == pytest.approx(((1 - ratio) / (1 + ratio)) ** 2, abs=1e-14)
    assert response.transmittance == pytest.approx(4 * ratio / (1 + ratio) ** 2, rel=1e-12)


def graded(count, s, share):
    """ε rising evenly from 1.5 to 6 over 1.3 wavelengths, as `count` layers of the value at their middle."""
    index = np.sqrt(1.5 + 4.5 * (np.arange(count) + 0.5) / count)
    return stack([1.0, *index, 2.0], np.full(count, 1.3 / count), 1.0, s, share).reflectance


def airy(s):
    """R of the same ε by Airy functions: E'' + (2π)² (ε₀ + ε' z − s²) E = 0 (Abramowitz & Stegun, §10.4), s light."""
    slope, k = 4.5 / 1.3, 2 * np.pi
    scale = (k * k * slope) ** (1 / 3)

    def basis(z):
        ai, d_ai, bi, d_bi = special.airy(-scale * (z + (1.5 - s * s) / slope))
        return np.array([[ai, bi], [-scale * d_ai, -scale * d_bi]])

    behind = np.array([1, 1j * k * np.sqrt(4 - s * s)])
    field, slope_of_field = basis(0.0) @ np.linalg.solve(basis(1.3), behind)
    y = slope_of_field / (1j * k) / field
    return abs((np.sqrt(1 - s * s) - y) / (np.sqrt(1 - s * s) + y)) ** 2


def test_graded_stacks_converge_to_airy_functions_with_the_square_of_the_sublayers():
    for s in (0.0, 0.4, 0.9):
        error = [abs(graded(n, s, 0.0) - airy(s)) for n in (50, 100, 200, 400)]
        assert np.allclose(np.array(error[:-1]) / error[1:], 4.0, rtol=0.02)
        assert (4 * graded(400, s, 0.0) - graded(200, s, 0.0)) / 3 == pytest.approx(airy(s), abs=1e-8)


def test_graded_stacks_converge_for_p_light_too():
    for s in (0.4, 0.9):
        step = np.diff([graded(n, s, 1.0) for n in (50, 100, 200, 400)])
        assert np.allclose(step[:-1] / step[1:], 4.0, rtol=0.03)


def test_an_absorptance_of_1e_7_has_all_its_digits():
    """1 − R − T would keep nine of them at k = 1e-6, one at 1e-14, none at 1e-30."""
    for k, s, kind in product((1e-6, 1e-8, 1e-14, 1e-30), (0.0, 0.5), "sp"):
        index, thickness = [1, 3.48 + 1j * k, 1.45 + 2j * k, 1.2], [43.0, 500.0]
        expected = float(exact(index, thickness, 1550.0, s, kind)[2])
        ours = stack(index, thickness, 1550.0, s, P_SHARE[kind]).absorptance
        assert ours == pytest.approx(expected, rel=1e-13, abs=0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 2, 1], [1.0, 2.0], 1.0, 0.0), "two more indices"),
        (([1, 2 - 0.1j, 1], [1.0], 1.0, 0.0), "k at least 0"),
        (([1 + 0.1j, 2, 1], [1.0], 1.0, 0.0), "lossless"),
        (([1, 2, 1], [-1.0], 1.0, 0.0), "at least 0"),
        (([1, 2, 1], [np.inf], 1.0, 0.0), "finite"),
        (([1, 2, 1], [1.0], 1.0, 1.01), "must not exceed"),
        (([1, 2, 1], [1.0], 1.0, np.nan), "must not exceed"),
    ],
)
def test_what_does_not_exist_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        stack(*arguments)


@pytest.mark.parametrize("from_back", [False, True])
def test_a_film_has_no_preferred_direction_in_its_plane(from_back):
    """Turning the light about n turns the force with it."""
    index, thickness = random_stack(3, layers=4, back=1.5)
    rng = np.random.default_rng(3)
    u, v, angle = rng.uniform(-0.8, 0.8, (3, 100))
    c, s = np.cos(np.pi * angle), np.sin(np.pi * angle)
    q, _ = momentum(index, thickness, 1550.0, u, v, from_back=from_back)
    turned, _ = momentum(index, thickness, 1550.0, c * u - s * v, s * u + c * v, from_back=from_back)
    expected = np.stack([c * q[:, 0] - s * q[:, 1], s * q[:, 0] + c * q[:, 1], q[:, 2]], -1)
    assert np.abs(turned - expected).max() < 1e-13


def test_light_from_the_back_is_light_on_the_reversed_film():
    index, thickness = random_stack(4, layers=5, back=1.5)
    u, v = np.array([0.0, 0.3, -0.5]), np.array([0.0, 0.7, 0.2])
    back, _ = momentum(index, thickness, 1550.0, u, v, p_share=1.0, from_back=True)
    front, _ = momentum(index[::-1], thickness[::-1], 1550.0, u, v, p_share=1.0)
    assert np.array_equal(back, front * [1, 1, -1])
    assert np.all(back[:, 2] < 0)


def test_a_film_in_vacuum_lit_from_the_back_is_pushed_as_from_the_front():
    """F = (P/c)[2R (k·n) n + a k] holds for either side (Gao, Kelzenberg & Atwater, specular model)."""
    cell = film([(43, 3.48, 0.05)])
    u, v = np.linspace(-0.6, 0.6, 9), np.linspace(0.1, 0.7, 9)
    w = -np.sqrt(1 - u * u - v * v)
    q, response = pressure(cell, u, v, from_back=True)
    k = np.stack([u, v, w], -1)
    expected = 2 * (response.reflectance * w)[:, None] * [0, 0, 1] + response.absorptance[:, None] * k
    assert np.abs(q - expected).max() < 1e-14


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
