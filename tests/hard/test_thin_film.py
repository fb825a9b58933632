"""Films that break transfer matrices; each asserts a number, most against 50 digits.

python -m pytest -s -k thousand_angles tests/hard/test_thin_film.py      (prints the speed beside the package tmm)
"""

from time import perf_counter

import numpy as np
import pytest
import tmm

from optics.thin_film.stage import P_SHARE, momentum, stack
from tests.films import exact

GLANCING = float(np.sin(np.radians(89.99)))
QUARTERS = [1 / 4 / 2.3, 1 / 4 / 1.45] * 250
ABSOLUTE = {"R": 1e-15, "T": 1e-300, "A": 1e-15}  # below which a digit may be missing: A only if it is none or a rest


def check(index, thickness, s, relative=1e-10):
    """R, T and A of both polarisations to `relative` of themselves."""
    for kind in "sp":
        ours = stack(index, thickness, 1.0, s, P_SHARE[kind])
        values = dict(zip("RTA", (ours.reflectance, ours.transmittance, ours.absorptance), strict=True))
        for (name, value), expected in zip(values.items(), exact(index, thickness, 1.0, s, kind), strict=True):
            lossless = name == "A" and not np.any(np.imag(index))
            expected = 0.0 if lossless else float(expected)
            assert value == pytest.approx(expected, rel=relative, abs=0 if lossless else ABSOLUTE[name]), name


@pytest.mark.parametrize("n", [2.0, 2 + 1e-6j, 2 + 1e-2j, 2 + 0.5j, 0.26 + 6.97j])
@pytest.mark.parametrize("s", [0.0, 0.6, GLANCING])
def test_a_hundred_wavelengths_of_film(n, s):
    check([1.0, n, 1.5], [100.0], s)


@pytest.mark.parametrize("s", [0.0, 0.34, 0.9])
@pytest.mark.parametrize("k", [0.0, 1e-6, 1e-3])
def test_five_hundred_quarter_wave_layers(s, k):
    """T is 1e-100, and right."""
    check([1.0, *[2.3 + 1j * k, 1.45] * 250, 1.5], QUARTERS, s)


def test_five_hundred_lossless_layers_lose_nothing_and_reflect_all():
    response = stack([1.0, *[2.3, 1.45] * 250, 1.5], QUARTERS, 1.0, np.sin(np.radians([0.0, 20.0])))
    assert np.abs(response.reflectance - 1).max() < 1e-12
    assert np.all(response.absorptance == 0)
    assert np.abs(response.imbalance).max() < 1e-12


def test_ten_thousand_layers_neither_overflow_nor_underflow():
    response = stack([1.0, *[4.0, 1.0] * 5000, 1.5], [1 / 16, 1 / 4] * 5000, 1.0, [0.0, 0.5])
    assert np.abs(response.reflectance - 1).max() < 1e-12
    assert np.all(response.transmittance < 1e-300)


@pytest.mark.parametrize("k", [0.0, 1e-6])
@pytest.mark.parametrize("s", [1.0 + 1e-12, 1.2, 1.9])
def test_frustrated_total_reflection_through_twenty_wavelengths(s, k):
    """T falls to 1e-170, where matrices overflow and a cap on decay (as in tmm) ends at 1e-30."""
    check([2.0, 1.0 + 1j * k, 2.0], [20.0], s)


@pytest.mark.parametrize("kind", ["s", "p"])
def test_normal_incidence_is_no_special_case(kind):
    index, thickness = [1.0, 3.48 + 1e-6j, 2.0, 1.5], [0.1, 0.7]
    here, _ = momentum(index, thickness, 1.0, 0.0, 0.0, p_share=P_SHARE[kind])
    assert here[0] == here[1] == 0.0
    for u, v in ((-0.0, -0.0), (1e-300, 0.0), (0.0, -1e-300), (5e-324, 5e-324), (1e-17, 1e-17)):
        there, response = momentum(index, thickness, 1.0, u, v, p_share=P_SHARE[kind])
        assert there[2] == here[2]
        assert there[0] == response.absorptance * u
    other = stack(index, thickness, 1.0, 0.0, 1 - P_SHARE[kind])
    assert here[2] == pytest.approx(1 + other.reflectance - 1.5 * other.transmittance, abs=2e-15)


def test_light_at_89_99_degrees():
    """The digits of w = √((1 − s)(1 + s)) are all there: a square of s would keep eight of them."""
    check([1.0, 2.0 + 1e-6j, 1.0], [0.3], GLANCING, relative=1e-13)
    check([1.0, 2.0 + 1e-6j, 1.0], [0.3], 1 - 1e-15, relative=1e-13)


def test_exactly_glancing_light_is_all_reflected():
    for index in ([1.0, 2.0, 1.0], [1.0, 2 + 0.1j, 1.5], [1.0, 1.0, 2 + 3j]):
        for share in (0.0, 0.5, 1.0):
            response = stack(index, [0.3], 1.0, 1.0, share)
            assert response.reflectance == 1.0
            assert response.transmittance < 1e-90
            assert response.absorptance < 1e-90
    q, _ = momentum([1.0, 2 + 0.1j, 1.0], [0.3], 1.0, 0.6, 0.8)
    assert np.abs(q).max() < 1e-90


def test_glancing_light_sees_no_film_where_there_is_none():
    response = stack([1.0, 1.0, 1.0], [0.3], 1.0, [0.0, GLANCING, 1.0])
    assert np.abs(response.transmittance - 1).max() < 1e-15
    assert np.abs(response.reflectance).max() < 1e-15


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_layer_of_no_thickness_changes_no_bit(share):
    s = np.linspace(0, 1.0, 101)
    plain = stack([1.0, 2 + 1e-3j, 1.5, 1.2], [0.3, 0.2], 1.0, s, share)
    for extra in (1.0, 3.0, 0.2 + 7j):
        more = stack([1.0, 2 + 1e-3j, extra, 1.5, 1.2], [0.3, 0.0, 0.2], 1.0, s, share)
        assert np.array_equal(more.reflectance, plain.reflectance)
        assert np.array_equal(more.transmittance, plain.transmittance)
        assert np.array_equal(more.absorptance, plain.absorptance)


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize("n", [2.0, 2 + 1e-3j, 0.2 + 7j])
def test_a_layer_like_its_neighbour_is_one_with_it(n, share):
    s = np.linspace(0, 1.0, 101)
    whole, parted = stack([1.0, n, 1.2], [0.3], 1.0, s, share), stack([1.0, n, n, 1.2], [0.1, 0.2], 1.0, s, share)
    assert np.abs(whole.reflectance - parted.reflectance).max() < 1e-14
    assert np.allclose(whole.transmittance, parted.transmittance, rtol=1e-13, atol=1e-90)
    assert np.allclose(whole.absorptance, parted.absorptance, rtol=1e-13, atol=1e-90)


@pytest.mark.parametrize("s", [1.0, 1 - 1e-16, 1 + 3e-16, 1 + 1e-13])
def test_the_critical_angle_of_a_layer_hit_exactly(s):
    """k_z = 0 in the gap, where forward and backward wave are the same one."""
    check([2.0, 1.0, 2.0], [0.7], s, relative=1e-13)


def test_the_critical_angle_of_the_half_space_behind_hit_exactly():
    for share in (0.0, 1.0):
        response = stack([2.0, 3.0, 1.0], [0.3], 1.0, 1.0, share)
        assert response.reflectance == pytest.approx(1.0, abs=1e-15)
        assert response.transmittance < 1e-90


def test_loss_at_the_critical_angle_of_a_weak_absorber():
    """Two waves that nearly cancel carry it; A of 1e-7 still has ten digits."""
    check([2.0, 1.0 + 1e-7j, 2.0], [0.7], 1.0)


@pytest.mark.parametrize("k", [0.0, 1e-3])
def test_a_thousand_angles_of_twenty_layers(k):
    """R and T are those of tmm; prints how much sooner (measured in this run, one thread, best of many)."""
    rng = np.random.default_rng(5)
    index, thickness = np.array([1.0, *(rng.uniform(1.2, 3.6, 20) + 1j * k), 1.5]), rng.uniform(0.01, 0.3, 20)
    angles = np.linspace(0, 1.55, 1000)
    for kind in "sp":
        seconds = []
        for _ in range(30):
            start = perf_counter()
            ours = stack(index, thickness, 1.0, np.sin(angles), P_SHARE[kind])
            seconds.append(perf_counter() - start)
        start = perf_counter()
        theirs = [tmm.coh_tmm(kind, index, [np.inf, *thickness, np.inf], angle, 1.0) for angle in angles]
        slow, fast = perf_counter() - start, min(seconds)
        print(f"{kind}, k = {k:g}: tmm {slow:.3f} s, ours {fast * 1e3:.2f} ms, ratio {slow / fast:.0f}")
        assert np.abs(ours.reflectance - [x["R"] for x in theirs]).max() < 1e-12
        assert np.abs(ours.transmittance - [x["T"] for x in theirs]).max() < 1e-12
