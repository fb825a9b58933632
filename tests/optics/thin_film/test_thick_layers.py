"""Layers of any thickness: fringes that no sampling could hold, resonances that none may miss, and fringes averaged."""

import numpy as np
import pytest
import tmm
from scipy.optimize import minimize_scalar

from beamrider.io.files import InputError
from optics.cells.schema import Index, LamellarLayer, LamellarStack, Layer, Surroundings, ThinFilm
from optics.modal import stage as modal
from optics.table.lookup import lookup, lookup_many
from optics.table.normal_incidence import table_response
from optics.table.pressure_table import PressureTable
from optics.thin_film.fringes import fringes
from optics.thin_film.stage import P_SHARE, film, make_table, momentum, polarised, pressure, solve, stack
from tests.films import exact

QUARTER = {"H": (1550 / 4 / 2.3, 2.3, 0.0), "L": (1550 / 4 / 1.45, 1.45, 0.0)}


def cell(layers, polarisation="mean", front=1.0, back=1.0, back_k=0.0, wavelength=1550.0, incoherent=()):
    return ThinFilm(
        kind="thin_film",
        name="film",
        wavelength_nm=wavelength,
        polarisation=polarisation,
        layers=[
            Layer(thickness_nm=t, index=Index(n=n, k=k), coherent=i not in incoherent)
            for i, (t, n, k) in enumerate(layers)
        ],
        surroundings=Surroundings(front=front, back=back, back_k=back_k),
    )


# A millimetre of coated glass; a plate on glass; a weakly absorbing plate; a metal behind a thick gap.
GLASS = cell([(1e6, 1.4648, 0.0), (120, 1.9932, 0.0039253)], "s", 1.00028018, 1.00028018, wavelength=460.0)
PLATE = cell([(3e5, 1.45, 0.0)], "p", back=1.5)
LOSSY = cell([(2e4, 3.48, 1e-5), (5e4, 1.45, 0.0)], "mean")
GAP = cell([(1e5, 1.0, 0.0), (30.0, 0.2, 6.0)], "mean", back=1.5)
# Frustrated total reflection into a guide between two gaps; a surface plasmon of silver; a cavity of 41 layers.
TUNNEL = cell([(1500, 1.0, 0.0), (300, 2.0, 1e-6), (1500, 1.0, 0.0)], "mean", 1.9, 1.9)
PLASMON = cell([(55, 0.0562, 4.2776)], "p", 1.515, wavelength=633.0)
CAVITY = cell([QUARTER[x] for x in "HL" * 10] + [(1.02 * 1550 / 2 / 1.45, 1.45, 0.0)] + [QUARTER[x] for x in "LH" * 10])
MATERIALS = [(3.05, 3.39), (1.7, 0.3), (0.26, 6.97), (3.5, 0.1), (2.4, 0.0)]
NARROW = [TUNNEL, PLASMON, CAVITY]


def q_exact(of, s):
    """q_n and absorptance (float) at one sine from 50 digits."""
    index = film(of).index
    thickness, kinds = [layer.thickness_nm for layer in of.layers], {"mean": "sp"}.get(of.polarisation, of.polarisation)
    r, t, a = np.mean([exact(index, thickness, of.wavelength_nm, s, kind) for kind in kinds], axis=0)
    w, behind = (np.sqrt(max(n.real**2 - s**2, 0.0)) for n in index[[0, -1]])
    return float(w * (1 + r) - behind * t), float(a)


@pytest.mark.parametrize("of", [GLASS, PLATE, LOSSY, GAP, *NARROW])
def test_thick_and_resonant_films_are_within_their_stated_error_at_any_direction(of):
    """At 1e-10 rad of rounding, not at the 0.1 that samples of 8000 fringes would err by."""
    s_max = 0.98 * of.surroundings.front
    table = make_table(of, s_max, 1e-6)
    assert table.attrs["tolerance_met"] == 1
    assert table.error.max() < 1e-9
    for s in np.random.default_rng(1).uniform(0, s_max, 40):
        stated = table.error[np.abs(table.u - s).argmin(), 0]
        q_n, a = q_exact(of, s)
        assert abs(table.q(s, 0.0)[2] - q_n) < stated
        assert abs(table.absorptance(s, 0.0) - a) < stated


def dip(of, low, high):
    """Sine at which least is reflected between two."""
    s = np.linspace(low, high, 1_000_001)
    k = int(solve(of, s).reflectance.argmin())
    found = minimize_scalar(
        lambda x: float(solve(of, np.array([x])).reflectance[0]),
        bounds=(s[k - 1], s[k + 1]),
        method="bounded",
        options={"xatol": 1e-13},
    )
    return found.x


@pytest.mark.parametrize(("of", "low", "high"), [(TUNNEL, 1.3, 1.85), (PLASMON, 1.0, 1.3), (CAVITY, 0.1, 0.3)])
def test_the_table_holds_a_resonance_wherever_it_lies(of, low, high):
    """At its bottom and on its flanks, where the closed form at 50 digits is the judge."""
    at, table = dip(of, low, high), make_table(of, 0.98 * of.surroundings.front, 1e-6)
    depth = abs(table.q(at, 0.0)[2] - np.interp(at, table.u, table.q_nodes[2, :, 0]))
    width = fringes(film(of), np.array([at])).width[0] if of is not PLASMON else 1e-2
    assert width < 1.1e-2
    for s in at + width * np.array([-3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0]):
        assert table.q(s, 0.0)[2] == pytest.approx(q_exact(of, s)[0], abs=1e-9)
    assert depth > 1e-6 or of is PLASMON


def test_the_sharpness_of_a_cavity_is_known_off_its_resonance():
    """Of a lossless plate F = 1/(1 − R₁) at every angle; the half width of its fringes in s is 1/(F 2 ∂φ/∂s)."""
    plate = cell([(5000.0, 3.0, 0.0)], "s")
    s = np.linspace(0.1, 0.8, 50)
    w, inside = np.sqrt(1 - s * s), np.sqrt(9 - s * s)
    face = ((inside - w) / (inside + w)) ** 2
    by_p = ((9 * w - inside) / (9 * w + inside)) ** 2
    slope = 2 * (2 * np.pi * 5000 / 1550) * s / inside
    assert np.allclose(fringes(film(plate), s).width, (1 - np.maximum(face, by_p)) / slope, rtol=1e-12)


def test_thin_films_are_sampled_and_thick_ones_are_not():
    """A look-up costs 0.02 µs in samples, 0.15 µs and more a layer by the stack: only who needs it pays."""
    assert make_table(cell([(43, 3.48, 1.2e-6)]), 0.999, 1e-6).film is None
    assert make_table(cell([(400, 2.0, 0.0)]), 0.9, 1e-6).film is None
    for of in (GLASS, PLATE, *NARROW):
        assert make_table(of, 0.98 * of.surroundings.front, 1e-6).film is not None


def test_sampled_films_state_an_error_that_covers_theirs():
    """Of layers of metals, absorbers and dielectrics, at sines that no node or test place holds."""
    rng = np.random.default_rng(3)
    for _ in range(25):
        layers = [(10 ** rng.uniform(0.5, 3.0), *rng.choice(MATERIALS)) for _ in range(rng.integers(1, 4))]
        of = cell(layers, str(rng.choice(["s", "p", "mean"])))
        table, s = make_table(of, 0.999, 1e-6), rng.uniform(0, 0.999, 400)
        at = np.clip(np.searchsorted(table.u, s), 1, table.u.size - 1)
        stated = np.maximum(table.error[at, 0], table.error[at - 1, 0])
        assert np.all(np.abs(table.q(s, 0.0) - pressure(of, s)[0]).max(axis=1) <= stated)
        assert table.attrs["tolerance_met"] == 1


def test_no_layer_gives_light_where_fringes_are_averaged():
    """Also beside the critical angle of a weak absorber, where the waves to and fro interfere more than they run."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        n, k, front = rng.uniform(1.1, 2), 10 ** rng.uniform(-6, -1), float(rng.choice([1.0, 1.5, 1.9]))
        s = np.linspace(0.0, 0.9999 * front, 400)
        s = np.sort(np.concatenate([s, np.clip(n + np.linspace(-0.02, 0.02, 100), 0.0, front)]))
        back = rng.choice([1.0, 1.3, 2.0, 0.2 + 5j])
        for share in (0.0, 1.0):
            light = stack([front, n + 1j * k, back], [rng.uniform(0.5, 10)], 1.0, s, share, False)
            assert light.absorptance.min() >= 0
            assert np.abs(light.imbalance).max() < 1e-12


def test_a_layer_too_thin_for_fringes_cannot_have_them_averaged():
    with pytest.raises(ValueError, match=r"must be true below 516\.6"):
        cell([(100.0, 1.5, 0.0)], incoherent=(0,))


def test_a_table_that_holds_the_stack_comes_back_from_its_file(tmp_path):
    table = make_table(LOSSY, 0.98, 1e-6)
    table.write(tmp_path / "film.h5")
    again = PressureTable.read(tmp_path / "film.h5")
    u, v = np.random.default_rng(0).uniform(-0.6, 0.6, (2, 500))
    assert np.array_equal(table.q(u, v), again.q(u, v))
    assert np.array_equal(table.q(u, v), pressure(LOSSY, u, v)[0]) or np.allclose(
        table.q(u, v), pressure(LOSSY, u, v)[0], rtol=0, atol=1e-11
    )


def test_one_direction_and_many_have_the_same_bits_and_the_edge_value_outside():
    table = make_table(LOSSY, 0.9, 1e-6)
    arrays = table.arrays()
    u, v = np.random.default_rng(0).uniform(-0.8, 0.8, (2, 200))
    out = np.empty((200, 4))
    outside = np.hypot(u, v) > 0.9
    assert lookup_many(arrays, u, v, out) == (outside.sum(), np.flatnonzero(outside)[0])
    for i in range(200):
        *one, inside = lookup(arrays, u[i], v[i])
        assert np.array_equal(one, out[i])
        assert inside != outside[i]
    edge = table.q(0.9, 0.0)
    assert np.allclose(out[outside, 2], edge[2], rtol=0, atol=0)
    with pytest.raises(InputError, match="outside table"):
        table.q(0.95, 0.0)


def test_nearest_look_up_still_gives_the_nodes_own_values():
    table = make_table(LOSSY, 0.9, 1e-6)
    out = np.empty((table.u.size, 4))
    lookup_many(table.arrays(nearest=True), table.u, 0.0 * table.u, out)
    assert np.allclose(out[:, 2], table.q_nodes[2, :, 0], rtol=0, atol=1e-15)


def test_fields_of_tracked_reflections_are_those_of_the_stack():
    s, out = np.random.default_rng(2).uniform(0, 0.9, 300), np.empty((300, 4))
    first, second = make_table(LOSSY, 0.9, 1e-6).amplitude_arrays()
    expected = polarised(LOSSY, s)
    lookup_many(first, s, 0.0 * s, out)
    assert np.array_equal(out.T, expected[:4])
    lookup_many(second, s, 0.0 * s, out)
    assert np.array_equal(out.T[:2], expected[4:])


@pytest.mark.parametrize("of", [GLASS, LOSSY])
def test_the_slopes_that_stability_asks_for_know_no_fringes(of):
    """∂q_t/∂k_t = A at normal incidence and ∂q_n/∂k_t = 0; a parabola through samples has other ideas."""
    found, light = table_response(make_table(of, 0.9, 1e-6)), solve(of, np.zeros(1))
    assert np.allclose(found.gradient, light.absorptance * np.array([[1, 0], [0, 1], [0, 0]]), rtol=0, atol=1e-10)
    assert found.q[2] == pytest.approx(q_exact(of, 0.0)[0], abs=1e-10)
    assert found.gradient_error.max() < 1e-9


# --- fringes averaged -------------------------------------------------------------------------------------------------

STACKS = {
    "one plate": ([1.0, 1.5, 1.0], [1e5], [False]),
    "coated": ([1.0, 2.0, 1.45, 2.3, 1.5], [120.0, 1e6, 80.0], [True, False, True]),
    "absorbing plate": ([1.0, 1.5 + 1e-4j, 1.2], [1e4], [False]),
    "three in a row": ([1.0, 1.5 + 2e-5j, 2.0, 1.4 + 1e-5j, 1.1], [1e4, 2e4, 3e4], [False] * 3),
    "first": ([1.0, 1.5, 2.0 + 0.01j, 1.7, 1.3], [1e4, 150.0, 80.0], [False, True, True]),
    "last": ([1.2, 2.0 + 0.01j, 1.7, 1.5 + 1e-5j, 1.3], [150.0, 80.0, 1e4], [True, True, False]),
    "metal inside": ([1.0, 1.5, 0.2 + 4j, 1.45, 1.0], [1e4, 20.0, 2e4], [False, True, False]),
    "absorbing behind": ([1.0, 1.8, 1.5 + 1e-5j, 1.5 + 0.1j], [90.0, 1e4], [True, False]),
    "two coatings": ([1.0, 2.0, 1.5, 1.45, 2.0, 1.6, 1.5, 1.0], [60, 90, 1e5, 50, 70, 2e5], [1, 1, 0, 1, 1, 0]),
}


@pytest.mark.parametrize("kind", ["s", "p"])
@pytest.mark.parametrize("name", STACKS)
def test_averaged_fringes_are_those_of_tmm(name, kind):
    index, thickness, coherent = STACKS[name]
    flags = ["i", *("c" if c else "i" for c in coherent), "i"]
    for angle in np.radians([0.0, 10.0, 45.0, 70.0, 88.0]):
        other = tmm.inc_tmm(kind, index, [np.inf, *thickness, np.inf], flags, angle, 1550.0)
        s = np.real(index[0]) * np.sin(angle)
        ours = stack(index, thickness, 1550.0, s, P_SHARE[kind], coherent)
        assert ours.reflectance == pytest.approx(other["R"], abs=1e-10)
        assert ours.transmittance == pytest.approx(other["T"], abs=1e-10)
        assert ours.absorptance == pytest.approx(sum(tmm.inc_absorp_in_each_layer(other)[1:-1]), abs=1e-10)
        assert abs(ours.imbalance) < 1e-12


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("s", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("layer", [1, 3])
def test_averaged_fringes_are_the_mean_over_thicknesses_of_the_coherent_stack(layer, s, share):
    """Over half a wavelength of phase in the averaged layer, which 128 phases sum exactly; at nearly one decay.

    In the absorbing layer the waves to and fro interfere at its faces, which takes and gives power: it is in A. (With
    two such layers paths of equal length through both still interfere in this mean, by 1e-4; tmm, and so we, add powers
    of any two paths.)
    """
    index, thickness = np.array([1.0, 2.1, 1.5 + 3e-6j, 1.8 + 0.01j, 1.6, 1.2]), np.array([130.0, 3e5, 90.0, 5e4])
    period = 500.0 / np.sqrt(index[layer + 1].real ** 2 - s * s)
    many = np.tile(thickness, (128, 1))
    many[:, layer] += np.linspace(-0.5, 0.5, 128, endpoint=False) * period
    mean = stack(index, many, 1e3, s, share)
    ours = stack(index, thickness, 1e3, s, share, np.arange(4) != layer)
    for name in ("reflectance", "transmittance", "absorptance"):
        assert getattr(ours, name) == pytest.approx(getattr(mean, name).mean(), abs=1e-6), name


@pytest.mark.parametrize("k", [1e-6, 1e-12])
def test_weak_absorption_keeps_its_digits_where_fringes_are_averaged(k):
    """A = V d Im ε /(n …) to first order in k: doubling k doubles it to all digits."""
    one, two = (stack([1.0, 1.5 + f * k * 1j, 1.3], [2e3], 1550.0, 0.4, 0.5, False).absorptance for f in (1, 2))
    assert two / one == pytest.approx(2.0, abs=1e5 * k + 1e-12)
    assert one > 0


def test_a_plate_with_averaged_fringes_has_its_closed_form():
    """R = R₁ + T₁² R₁/(1 − R₁²) = 2 R₁/(1 + R₁) of a lossless plate (Born & Wolf, §7.6)."""
    face = (0.5 / 2.5) ** 2
    ours = stack([1.0, 1.5, 1.0], [1e6], 1550.0, 0.0, 0.5, False)
    assert ours.reflectance == pytest.approx(2 * face / (1 + face), abs=1e-15)
    assert ours.transmittance == pytest.approx((1 - face) / (1 + face), abs=1e-15)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_total_reflection_below_an_averaged_plate(share):
    """Light that cannot leave at the back comes back, and a gap in which it only decays is crossed coherently."""
    for index, thickness, flags in (
        ([2.0, 1.8, 1.0], [1e5], [False]),
        ([2.0, 1.8, 1.0, 2.0], [1e5, 1e5], [False, False]),
        ([2.0, 1.0, 1.9, 1.0], [1e4, 1e5], [True, False]),
    ):
        response = stack(index, thickness, 1550.0, np.linspace(1.01, 1.79, 50), share, flags)
        assert np.abs(response.reflectance - 1).max() < 1e-12
        assert response.transmittance.max() < 1e-12
    thin, whole = (stack([2.0, 1.0, 2.0], [300.0], 1550.0, 1.3, share, c) for c in (False, True))
    assert thin.transmittance == whole.transmittance


def test_a_film_with_averaged_fringes_is_pushed_as_its_table_says():
    glass = cell([(1e6, 1.4648, 1e-8), (120, 1.9932, 0.0039253)], "mean", wavelength=460.0, incoherent=(0,))
    table = make_table(glass, 0.999, 1e-6)
    s = np.random.default_rng(0).uniform(0, 0.999, 1000)
    q, light = pressure(glass, s)
    w = np.sqrt(1 - s * s)
    assert np.allclose(q[:, 2], w * (1 + light.reflectance - light.transmittance), atol=1e-15)
    assert np.abs(table.q(s, 0.0) - q).max() < 1e-6
    assert table.attrs["tolerance_met"] == 1


def test_averaged_fringes_have_no_phase_to_follow():
    table = make_table(cell([(1e5, 1.45, 0.0)], incoherent=(0,)), 0.9, 1e-6)
    with pytest.raises(InputError, match="all layers coherent"):
        table.amplitude_arrays()


# --- absorbing half-spaces --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("polarisation", ["s", "p", "mean"])
def test_light_that_enters_an_absorbing_half_space_stays_there(polarisation):
    """q_t = (1 − R) k_t and q_n = w(1 + R), whatever the film; no momentum leaves at the back."""
    of = cell([(200, 2.0, 1e-3), (90, 1.45, 0.0)], polarisation, back=0.2, back_k=6.0)
    s = np.linspace(0.0, 0.95, 40)
    q, light = pressure(of, s)
    w = np.sqrt(1 - s * s)
    assert np.allclose(q, np.stack([(1 - light.reflectance) * s, 0 * s, w * (1 + light.reflectance)], -1), atol=1e-14)
    table = make_table(of, 0.95, 1e-6)
    assert np.abs(table.q(s, 0.0) - q).max() < 1e-6
    assert np.abs(table.absorptance(s, 0.0) - (1 - light.reflectance)).max() < 1e-6


def test_an_absorbing_half_space_is_a_layer_of_it_so_thick_that_nothing_comes_back():
    """Of a layer in front of vacuum the same light arrives; what it absorbs, the half-space takes."""
    s = np.linspace(0.0, 0.9, 20)
    behind, _ = momentum([1.0, 1.9, 1.5 + 0.1j], [200.0], 1550.0, s, 0.0)
    layer, _ = momentum([1.0, 1.9, 1.5 + 0.1j, 1.0], [200.0, 1e5], 1550.0, s, 0.0)
    assert np.allclose(behind, layer, rtol=0, atol=1e-12)


@pytest.mark.parametrize("axis", ["r", "g"])
def test_the_modal_method_pushes_an_unpatterned_stack_on_an_absorber_alike(axis):
    layers = [(200.0, 2.0, 1e-3), (90.0, 1.45, 0.0)]
    flat = LamellarStack(
        kind="lamellar",
        name="flat",
        wavelength_nm=1550.0,
        electric_axis=axis,
        period_nm=900.0,
        surroundings=Surroundings(back=0.2, back_k=6.0),
        layers=[LamellarLayer(thickness_nm=t, index=Index(n=n, k=k)) for t, n, k in layers],
    )
    u = np.linspace(-0.9, 0.9, 13)
    grating = modal.solve(flat, u, np.zeros(1), 2)
    q, light = pressure(cell(layers, "s" if axis == "r" else "p", back=0.2, back_k=6.0), u)
    assert np.abs(grating.q[:, 0] - q).max() < 1e-12
    assert np.abs(grating.absorptance[:, 0] - (1 - light.reflectance)).max() < 1e-12
