"""FDTD without running Meep: pixels, permittivity on the grid, poles of metals."""

import numpy as np
import pytest

from optics.cells.schema import Metagrating
from optics.fdtd.grid import FdtdSettings, layout, periods, pixels, rungs
from optics.fdtd.material import Averages, material, on_grid, spline, spline_integral
from optics.fdtd.medium import dissipated
from optics.fdtd.poles import passive, permittivity, responses

SETTINGS = FdtdSettings()


PASSIVE = [4.0, 2.25 + 0.1j, -7.6 + 0.73j, -48.5 + 3.6j, 5.0 + 19j, 0.3 + 0j, -2.0 + 0j, -17 + 100j, 1.0, 40.0 + 0.1j]


@pytest.mark.parametrize("period_nm", [5.0, 90.0, 300.0, 532.0, 1600.0, 30000.0])
@pytest.mark.parametrize("n", [1.0, 1.5, 3.5])
def test_every_resolution_is_finer_than_the_one_before(te, period_nm, n):
    cell = Metagrating.model_validate(
        te.model_dump() | {"period_nm": period_nm, "ridges_nm": [[0.0, period_nm / 2]], "index": {"n": n}}
    )
    pixels_a_period = rungs(cell, SETTINGS)
    assert len(pixels_a_period) == len(SETTINGS.pixels_per_wavelength)
    assert pixels_a_period[0] >= 8
    ratios = np.divide(pixels_a_period[1:], pixels_a_period[:-1])
    np.testing.assert_allclose(ratios, np.sqrt(2), rtol=0.06)  # whole numbers from 8 on
    assert pixels_a_period[0] / periods(cell) >= 7  # never coarser than asked for, but for rounding


def test_resolutions_that_round_to_the_same_pixels_still_rise(te):
    close = FdtdSettings(pixels_per_wavelength=[7.45, 7.46, 7.47])
    assert all(np.diff(rungs(te, close)) >= 1)


def test_a_metal_is_resolved_by_its_skin_depth(te):
    gold = Metagrating.model_validate(te.model_dump() | {"index": {"n": 0.26, "k": 6.97}})
    behind = Metagrating.model_validate(te.model_dump() | {"surroundings": {"back": 0.26, "back_k": 6.97}})
    assert periods(gold) == pytest.approx(periods(behind)) == pytest.approx(np.hypot(0.26, 6.97) * 1600 / 1064)


@pytest.mark.parametrize("step", [0.02, 0.2, 0.4])
def test_poles_give_the_wanted_permittivity_exactly_and_stay_as_dense_as_vacuum_to_the_end_of_the_grid(step):
    wanted = np.array(PASSIVE, complex)
    medium = passive(wanted, step)
    np.testing.assert_allclose(permittivity(medium, step), wanted, rtol=1e-13)
    assert np.all(medium.free >= 0)
    assert np.all(medium.lossy >= 0)
    # At ωΔt = π each pole has lowered ε by its strength times (ωΔt)²/4.
    assert np.all(medium.infinity - (medium.free + medium.lossy) * step**2 / 4 >= 1 - 1e-9) or np.any(wanted.real < 1)
    dense = wanted.real >= 1
    np.testing.assert_allclose(medium.free[dense & (wanted.imag < 1)], 0)


def test_poles_obey_the_recurrence_that_they_are_made_for():
    """P₊ = (2 P − (1 − γΔt/2) P₋ + σ(ωΔt)² E)/(1 + γΔt/2) driven by exp(−iωt) settles to χ E."""
    step = 0.15
    for gamma, wanted in zip((0.0, 1.0), responses(step), strict=True):
        before, now = wanted * np.exp(1j * step), wanted + 0j
        for k in range(200):
            drive = step**2 * np.exp(-1j * step * k)
            before, now = now, (2 * now - (1 - gamma * step / 2) * before + drive) / (1 + gamma * step / 2)
        assert now == pytest.approx(wanted * np.exp(-1j * step * 200), rel=1e-9)


def test_loss_is_that_of_the_points_that_hold_the_fields():
    """One lossy row in a period of 3 pixels; fields that differ from point to point."""
    rng = np.random.default_rng(5)
    mean = np.zeros((6, 9), complex)
    mean[:, 4] = 2j  # an even row: E_X and E_Z are there
    mean[:, 5] = 3j  # an odd one: E_Y
    seen = Averages(mean, mean, np.zeros((6, 9)), np.zeros((6, 9)))
    e_x, e_y, e_z = (rng.normal(size=shape) + 0j for shape in ((4, 5), (4, 6), (4, 5)))
    expected = 2 * (e_x[1:, 2] ** 2).sum() + 2 * (e_z[:3, 2] ** 2).sum() + 3 * (e_y[:3, 3] ** 2).sum()
    assert dissipated(seen, [e_x, e_y, e_z], oblique=True) == pytest.approx(expected.real, rel=1e-12)
    assert dissipated(seen, [None, None, e_z], oblique=True) == pytest.approx(2 * (e_z[:3, 2] ** 2).sum().real)


@pytest.mark.parametrize("resolution", [10.65, 17.7, 21.3, 42.55])
def test_the_grid_is_even_in_height_and_holds_the_material_between_its_lines(tm, resolution):
    grid = layout(tm, pixels(tm, resolution), SETTINGS)
    assert grid.n_y % 2 == 0
    assert grid.n_x * grid.pixel == pytest.approx(1.35)
    assert grid.y_back < grid.y_bottom
    assert grid.y_bottom + 0.6 < grid.y_front < grid.y_source
    for y in (grid.y_front, grid.y_back):
        assert (y / grid.pixel) % 1 == pytest.approx(0.5)


def grid_points(grid, per_pixel=1):
    half = 0.5 if per_pixel == 1 else 0.0
    x = (np.arange(per_pixel * grid.n_x) + half) * grid.pixel / per_pixel - grid.period / 2
    y = (np.arange(-per_pixel * grid.n_y // 2, per_pixel * grid.n_y // 2) + half) * grid.pixel / per_pixel
    return x, y


@pytest.mark.parametrize("radius", [0.0, 100.0])
def test_the_absorbing_area_is_that_of_the_cross_section(te, radius):
    cell = Metagrating.model_validate(te.model_dump() | {"corner_radius_nm": radius, "index": {"n": 2.0, "k": 0.01}})
    grid = layout(cell, pixels(cell, 21.3), SETTINGS)
    loss = material(cell, grid, 0.65).averages(*grid_points(grid, 2)).mean.imag
    inside = on_grid(cell.index.permittivity, 2 * np.pi * grid.pixel / 1.064, 0.65)
    area = loss.sum() * (grid.pixel / 2) ** 2 / inside.imag
    corners = 4 * (1 - 8 * np.sin(np.pi / 32)) * (radius / 1000) ** 2  # of arcs in 16 straight pieces
    assert area == pytest.approx(1.6 * 0.2 + 0.8 * 0.4 - corners, rel=3e-5)


def test_permittivity_keeps_its_integral_and_its_limits_on_the_grid(tm):
    grid = layout(tm, pixels(tm, 17.55), SETTINGS)
    x, y = grid_points(grid, 2)
    tensor = material(tm, grid, 0.65).averages(x, y).tensor()
    inside = on_grid(4.0, 2 * np.pi * grid.pixel / 1.064, 0.65)
    area = 1.35 * 0.2 + 0.72 * 0.4
    assert (tensor[..., 2].real - 1).sum() * (grid.pixel / 2) ** 2 == pytest.approx((inside - 1) * area, rel=1e-4)
    assert np.all(tensor[..., :3].real >= 1 - 1e-12)
    assert np.all(tensor[..., :3].real <= inside + 1e-12)
    # Across a face the mean is harmonic, which is smaller.
    assert np.all(tensor[..., :2].real <= tensor[..., 2, None].real + 1e-12)


def test_a_flat_face_gives_arithmetic_and_harmonic_means(te):
    cell = Metagrating.model_validate(te.model_dump() | {"ridges_nm": [[0.0, 1600.0]]})
    grid = layout(cell, pixels(cell, 10.65), SETTINGS)
    share = np.array([1 / 6, 1 / 2, 5 / 6])  # of the spline, half a pixel and none below a face
    y = grid.y_bottom + np.array([-0.5, 0.0, 0.5]) * grid.pixel
    inside = on_grid(4.0, 2 * np.pi * grid.pixel / 1.064, 0.65)
    along, across, out_of_plane, mixed = material(cell, grid, 0.65).averages(np.array([0.1]), y).tensor()[0].T
    np.testing.assert_allclose(along, 1 + (inside - 1) * share, rtol=1e-5)
    np.testing.assert_allclose(out_of_plane, 1 + (inside - 1) * share, rtol=1e-5)
    np.testing.assert_allclose(across, 1 / (1 - (1 - 1 / inside) * share), rtol=1e-5)
    np.testing.assert_allclose(mixed, 0, atol=1e-12)


def test_the_spline_averages_straight_lines_to_themselves():
    t = np.arange(-4, 5) + np.linspace(0, 1, 7)[:, None]
    np.testing.assert_allclose(spline(t).sum(axis=1), 1, atol=1e-14)
    np.testing.assert_allclose((spline(t) * t).sum(axis=1), 0, atol=1e-14)
    step = 1e-5
    slope = (spline_integral(t + step) - spline_integral(t - step)) / (2 * step)
    np.testing.assert_allclose(slope, spline(t), atol=1e-9)


def test_permittivity_on_the_grid_gives_a_wave_its_true_length():
    """Yee's dispersion relation, averaged over directions, is left with an error of fourth order in the pixel."""
    angles = (np.arange(64) + 0.5) * 2 * np.pi / 64
    errors = []
    for phase in (0.2, 0.1):
        k = 2.0 * phase * np.array([np.cos(angles), np.sin(angles)])  # per pixel, in ε = 4
        left = on_grid(4.0, phase, 0.65) * (np.sin(phase * 0.65 / 2) / 0.65) ** 2
        right = (np.sin(k / 2) ** 2).sum(axis=0).mean()
        errors.append(abs(left / right - 1))
    assert errors[0] < 2e-4
    assert errors[1] == pytest.approx(errors[0] / 16, rel=0.05)


def test_ridges_that_touch_across_the_period_leave_no_seam(te):
    cell = Metagrating.model_validate(te.model_dump() | {"ridges_nm": [[0.0, 600.0], [600.0, 1000.0]]})
    grid = layout(cell, pixels(cell, 10.65), SETTINGS)
    tensor = material(cell, grid, 0.65).averages(*grid_points(grid, 2)).tensor()
    np.testing.assert_allclose(tensor, np.broadcast_to(tensor[:1], tensor.shape), atol=1e-12)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_cell_at_another_wavelength_has_the_same_grid(te, scale):
    lengths = ("wavelength_nm", "period_nm", "ridge_height_nm", "membrane_nm")
    scaled = {name: scale * getattr(te, name) for name in lengths}
    scaled["ridges_nm"] = [[scale * x for x in ridge] for ridge in te.ridges_nm]
    cell = Metagrating.model_validate(te.model_dump() | scaled)
    for resolution in SETTINGS.pixels_per_wavelength:
        one, other = layout(te, pixels(te, resolution), SETTINGS), layout(cell, pixels(cell, resolution), SETTINGS)
        assert (one.n_x, one.n_y, one.n_absorber) == (other.n_x, other.n_y, other.n_absorber)
        assert other.y_front == pytest.approx(scale * one.y_front, rel=1e-12)


def test_a_denser_material_has_smaller_pixels(te):
    silicon = Metagrating.model_validate(te.model_dump() | {"index": {"n": 3.5, "k": 0.0}})
    one, other = (layout(cell, pixels(cell, 21.3), SETTINGS).n_x for cell in (te, silicon))
    assert (one, other) == (64, 112)
