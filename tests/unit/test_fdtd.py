"""FDTD without running Meep: the grid, the extrapolation, blocks of directions, part files, what is refused."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from beamrider.io.checksum import append_checksum
from beamrider.io.files import InputError, validate
from optics.cells.schema import Metagrating
from optics.fdtd.adaptive import adapt
from optics.fdtd.direction import (
    DirectionResult,
    cautious_estimate,
    check_cell,
    check_window,
    estimate,
    extrapolate,
    solve_direction,
)
from optics.fdtd.efficiencies import Efficiencies, check_polarisation, stress
from optics.fdtd.grid import FdtdSettings, layout, periods, pixels, rungs
from optics.fdtd.material import Averages, material, on_grid, spline, spline_integral
from optics.fdtd.medium import dissipated
from optics.fdtd.orders import Orders, grazing
from optics.fdtd.parts import Rows, block, merge, read_rows, write_rows
from optics.fdtd.poles import passive, permittivity, responses
from optics.fdtd.progress import Progress, check_memory, expected_directions, spread
from optics.fdtd.run import Decay, Run, import_meep, pulse_width, reflection, remaining
from optics.fdtd.stage import main, read_nodes, set_aside, solve_adaptively
from optics.refinement.directions import even_nodes, fill
from optics.table.promise import read_promise
from optics.waves.incidence import electric_vector, wave_vector

SETTINGS = FdtdSettings()


PASSIVE = [4.0, 2.25 + 0.1j, -7.6 + 0.73j, -48.5 + 3.6j, 5.0 + 19j, 0.3 + 0j, -2.0 + 0j, -17 + 100j, 1.0, 40.0 + 0.1j]


def smooth(u, v):
    """A response that is even in v and a cubic in u, which splines reproduce."""
    return np.array([0.1 + u - u**3, 0.0, 0.5 + 0.2 * u * v**2]), 1e-5 * (1 + v**2)


def solved(u, v):
    q, absorptance = smooth(u, v)
    return DirectionResult(q, absorptance, 2e-3, 1e-4, 1e-3, 1e-5, False, 1.0, (20.0, 40.0), 0.5)


def rows(directions):
    out = Rows.empty()
    for u, v in directions:
        out = out.added(u, v, solved(u, v))
    return out


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


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_run_without_a_number_ends_the_table_with_its_direction(te, monkeypatch, value):
    def run(cell, u, v, n_x, settings, thicker):
        orders = Orders(np.array([u]), np.array([1.0 + 0j]), np.array([1.0 + 0j]))
        return Efficiencies(orders, np.array([value]), np.zeros(1), 0.0, 0.0, np.zeros(2), Decay(0.0, False))

    monkeypatch.setattr("optics.fdtd.direction.efficiencies", run)
    with pytest.raises(InputError, match=r"mark1e_te at u = 0\.1, v = 0: FDTD with 22 pixels .*not numbers"):
        solve_direction(te, 0.1, 0.0, SETTINGS)


def test_fields_that_blow_up_end_the_run_in_one_line_with_the_direction(te):
    class Fields:
        dt = 0.1

        def step(self):
            raise RuntimeError("meep: simulation fields are NaN or Inf")

    run = Run.__new__(Run)
    run.cell, run.u, run.v, run.grid = te, 0.1, 0.05, layout(te, 22, SETTINGS)
    run.simulation = SimpleNamespace(fields=Fields())
    with pytest.raises(InputError, match=r"mark1e_te at u = 0\.1, v = 0\.05: FDTD with 22 pixels .* NaN or Inf; lower"):
        run._advance(1.0)


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


def test_a_table_states_the_error_of_its_permittivities(te, tmp_path):
    gold = Metagrating.model_validate(te.model_dump() | {"index": {"n": 0.26, "k": 6.97}})
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    write_rows(tmp_path / "part.h5", gold, SETTINGS, rows(block(u, v, 1, 1)))
    assert merge(gold, SETTINGS, u, v, 0.0, [tmp_path / "part.h5"]).attrs["permittivity_error"] < 1e-12


def test_poles_obey_the_recurrence_that_they_are_made_for():
    """P₊ = (2 P − (1 − γΔt/2) P₋ + σ(ωΔt)² E)/(1 + γΔt/2) driven by exp(−iωt) settles to χ E."""
    step = 0.15
    for gamma, wanted in zip((0.0, 1.0), responses(step), strict=True):
        before, now = wanted * np.exp(1j * step), wanted + 0j
        for k in range(200):
            drive = step**2 * np.exp(-1j * step * k)
            before, now = now, (2 * now - (1 - gamma * step / 2) * before + drive) / (1 + gamma * step / 2)
        assert now == pytest.approx(wanted * np.exp(-1j * step * 200), rel=1e-9)


def test_what_does_not_settle_is_not_extrapolated_and_its_error_covers_its_steps():
    """Numbers of a silver grating in TM, whose limit is 0.209: 8 to 91 pixels a period."""
    found = {8: 0.8484, 11: 0.2377, 16: 0.176, 23: 0.1991, 32: 0.4008, 46: 0.164, 65: 0.1748, 91: 0.2214}
    done = [(n, np.array([1 - a, 0.5])) for n, a in found.items()]
    for last in range(3, len(done) + 1):
        best, error = cautious_estimate(done[:last])
        assert abs(best[0] - (1 - 0.209)) <= error
        assert error < 2 * 0.62


@pytest.mark.parametrize("order", [1, 2, 3])
def test_steady_errors_of_any_order_are_covered(order):
    pixels_a_period = (20, 28, 40)
    done = [(n, np.array([0.3 + 20 / n**order, 0.1])) for n in pixels_a_period]
    best, error = cautious_estimate(done)
    assert abs(best[0] - 0.3) <= error <= 5 * 20 / pixels_a_period[-1] ** order


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


def test_time_to_go_is_right_within_a_factor_of_two(te):
    """From a quarter of the directions to nine tenths; near a resonance they take 8 times as long, off plane twice."""
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    directions = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    seconds = [(8.0 if abs(x - 0.1) < 0.03 else 1.0) * (2.0 if y else 1.0) for x, y in directions]
    order, spent = spread(len(directions)), 0.0
    assert sorted(order) == list(range(len(directions)))
    with Progress(te, SETTINGS, directions, "test") as progress:
        for k, i in enumerate(order):
            if len(order) / 4 <= k < 0.9 * len(order):
                done, total = progress._bar.n, progress._bar.total
                assert 0.5 < spent / done * (total - done) / (sum(seconds) - spent) < 2
            progress.begin(*directions[i].tolist())
            for rung in range(6):
                progress.run(rung)
            progress.end()
            spent += seconds[i]
        assert progress._bar.n == pytest.approx(progress._bar.total)


def test_progress_is_told_at_once_and_after_the_first_run(te, capfd):
    with Progress(te, SETTINGS, np.array([[0.0, 0.0], [0.1, 0.0]]), "FDTD te") as progress:
        assert "FDTD te:   0%" in capfd.readouterr().err
        progress.begin(0.0, 0.0)
        progress.run(0)
        assert "0/2 directions" in capfd.readouterr().err
        progress.begin(0.05, 0.0)  # not expected
        progress.end()
    assert "1/1 directions" in capfd.readouterr().err


def test_the_modal_method_tells_how_many_directions_fdtd_will_ask_for(te):
    expected = expected_directions(te, 0.05, 0.05, 3e-2)
    assert len(np.unique(expected, axis=0)) == len(expected)
    assert 27 <= len(expected) < 400


def test_a_table_says_why_it_missed_its_tolerance(te, tmp_path):
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    path = tmp_path / "part.h5"
    for tolerance, met in ((1e-2, True), (5e-4, False)):  # of a direction; a table's is three times that
        settings = FdtdSettings(tolerance=tolerance)
        write_rows(path, te, settings, rows(block(u, v, 1, 1)))
        found = read_promise(merge(te, settings, u, v, 1e-4, [path]))
        assert found.met is met
        assert found.error_99 >= 2e-3 + 1e-4
    assert found.why.startswith("slow convergence: 84 of 84 directions stand at 0.002 with 40 pixels per wavelength")


def test_what_the_nodes_were_chosen_with_is_part_of_the_stated_error(te, tmp_path):
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    write_rows(tmp_path / "part.h5", te, SETTINGS, rows(block(u, v, 1, 1)))
    small, large = (merge(te, SETTINGS, u, v, known, [tmp_path / "part.h5"]).error for known in (0.0, 5e-3))
    assert np.all(large >= 7e-3)
    assert np.all(small < 3e-3)


def test_richardson_is_exact_for_an_error_of_second_order():
    values = {n: np.array([0.3, -1.0]) + np.array([5.0, -2.0]) / n**2 for n in (30, 47)}
    best, correction = extrapolate((30, values[30]), (47, values[47]))
    np.testing.assert_allclose(best, [0.3, -1.0], rtol=1e-14)
    np.testing.assert_allclose(correction, np.array([5.0, 2.0]) / 47**2, rtol=1e-12)


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


def test_two_pairs_tell_the_error_of_a_series_of_fourth_order():
    pixels = (20, 28, 40)
    done = [(n, np.array([0.3 + 5 / n**2 + 400 / n**4, 0.1])) for n in pixels]
    best, error = estimate(done, 1.5)
    assert abs(best[0] - 0.3) < error < 5 * abs(best[0] - 0.3)
    assert estimate(done[:2], 1.5)[1] > error


def test_what_remains_of_a_ringing_is_the_rest_of_its_series():
    series = 0.2 * 0.7 ** np.arange(9)
    assert remaining([np.inf, *series[:5]]) == pytest.approx(0.2 * 0.7**5 / 0.3, rel=1e-12)
    assert remaining([np.inf, *series[:2]]) == np.inf
    assert remaining([np.inf, 1e-3, 1e-3, 1e-3]) == np.inf


def test_blocks_share_all_directions_evenly():
    u, v = np.linspace(-0.18, 0.18, 11), np.array([0.0, 0.1, 0.18])
    blocks = [block(u, v, i, 4) for i in range(1, 5)]
    everything = {tuple(row) for part in blocks for row in part}
    assert everything == {(x, y) for x in u for y in v}
    assert max(map(len, blocks)) - min(map(len, blocks)) <= 1
    in_plane = [int((part[:, 1] == 0).sum()) for part in blocks]
    assert max(in_plane) - min(in_plane) <= 1


def test_part_files_merge_to_the_response_they_hold(te, tmp_path):
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    parts = []
    for i in (1, 2, 3):
        parts.append(tmp_path / f"part{i}.h5")
        write_rows(parts[-1], te, SETTINGS, rows(block(u, v, i, 3)))
    table = merge(te, SETTINGS, u, v, None, parts)
    for x, y in ((0.013, 0.0), (-0.17, 0.11), (0.1, -0.05)):
        q, absorptance = smooth(x, abs(y))
        np.testing.assert_allclose(table.q(x, y)[[0, 2]], q[[0, 2]], atol=1e-6)
        assert table.q(x, y)[1] == pytest.approx(y * absorptance, abs=1e-8)
    assert table.error.min() >= 2e-3
    with pytest.raises(InputError, match="none of the part files"):
        merge(te, SETTINGS, u, v, None, parts[:2])


def test_rows_of_another_cell_or_other_settings_are_not_kept(te, tm, tmp_path):
    path = tmp_path / "part.h5"
    write_rows(path, te, SETTINGS, rows([(0.0, 0.0)]))
    assert read_rows(path, te, SETTINGS).find(0.0, 0.0) == 0
    with pytest.raises(InputError, match="other 'cell'"):
        read_rows(path, tm, SETTINGS)
    with pytest.raises(InputError, match="other 'settings'"):
        read_rows(path, te, FdtdSettings(tolerance=1e-3))
    path.write_bytes(b"torn")
    with pytest.raises(InputError, match="not whole: cut off"):
        read_rows(path, te, SETTINGS)
    append_checksum(path)
    with pytest.raises(InputError, match="not a readable part file"):
        read_rows(path, te, SETTINGS)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"symmetries": ["Mirror(X)"]}, "symmetries"),
        ({"courant": 0.9}, "less than or equal to 0.7"),
        ({"pixels_per_wavelength": [40.0]}, "at least 2"),
        ({"pixels_per_wavelength": [20.0, 20.0]}, "must ascend"),
        ({"pixels_per_wave": 40.0}, "did you mean 'pixels_per_wavelength'"),
        ({"tolerance": 0.0}, "greater than 0"),
    ],
)
def test_bad_settings_are_refused_in_one_line(given, message):
    with pytest.raises(InputError, match=message) as error:
        validate(given, FdtdSettings, "settings.yaml")
    assert "\n" not in str(error.value)


def test_what_fdtd_cannot_do_is_refused(te):
    thinner = Metagrating.model_validate(te.model_dump() | {"surroundings": {"front": 0.9}})
    with pytest.raises(InputError, match=r"front = 0\.9: must be at least 1"):
        check_cell(thinner, 0.0, 0.0)
    with pytest.raises(InputError, match="evanescent"):
        check_cell(te, 0.8, 0.7)
    water = Metagrating.model_validate(te.model_dump() | {"surroundings": {"front": 1.33}})
    check_cell(water, 0.8, 0.7)
    huge = Metagrating.model_validate(te.model_dump() | {"period_nm": 1e9})
    with pytest.raises(InputError, match=r"FDTD needs about \d+ GB"):
        check_memory(huge, SETTINGS)


def test_a_grazing_order_is_seen(tm):
    assert grazing(tm, 1 - tm.pitch, 0.0) < 1e-6
    assert grazing(tm, 0.0, 0.0) > 0.5


@pytest.mark.parametrize(("u_max", "v_max"), [(0.1737, 0.1737), (0.2, 0.1), (0.206, 0.01), (0.3, 0.1), (0.19, 0.3)])
@pytest.mark.parametrize("which", ["te", "tm"])
def test_a_window_is_refused_where_some_direction_in_it_grazes(request, which, u_max, v_max):
    cell = request.getfixturevalue(which)
    u, v = np.linspace(-u_max, u_max, 201), np.linspace(0.0, v_max, 41)
    smallest = min(grazing(cell, x, y) for x in u for y in v)
    if smallest > 0.1:
        check_window(cell, u, v)
    else:
        with pytest.raises(InputError, match=r"u = -0\.\d+ … 0\.\d+, .*diffraction order grazes, \|w\| down to 0"):
            check_window(cell, u[[0, -1]], v[[0, -1]])
    assert smallest > 0.1 or smallest < 0.095


def test_the_flattest_order_is_damped_as_well_as_others():
    for w in (0.1, 0.17, 0.4, 0.9):
        assert reflection(w) ** (w / 2) <= 1.001e-5 or w > 2 / 3
    assert reflection(1.0) == 1e-15


def test_the_pulse_holds_little_of_an_order_s_cut_off_and_ends_in_time():
    for w in (0.15, 0.3, 0.39):
        cutoff = 1 - np.sqrt(1 - w**2)
        width = pulse_width(w, SETTINGS)
        assert np.exp(-((2 * np.pi * cutoff / width) ** 2) / 2) < 0.05
        assert 8 / width <= SETTINGS.longest / 2
    assert pulse_width(0.5, SETTINGS) == SETTINGS.pulse_width
    assert 8 / pulse_width(0.01, SETTINGS) == pytest.approx(SETTINGS.longest / 2)


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


@pytest.mark.parametrize("axis", ["g", "r"])
def test_the_polarisation_check_takes_the_wanted_wave_only(te, axis):
    cell = Metagrating.model_validate(te.model_dump() | {"electric_axis": axis})
    u, v = 0.3, -0.4
    e = electric_vector(u, v, axis)
    h = np.cross(wave_vector(u, v), e)
    wave = 1j * np.array([e[0], e[1], h[0], h[1]])
    check_polarisation(cell, u, v, wave)
    for wrong in (wave * [1, 1, -1, -1], wave + 0.02 * np.array([1, 0, 0, 0]), 0 * wave):
        with pytest.raises(InputError, match="polarisation"):
            check_polarisation(cell, u, v, wrong)


def test_maxwell_s_stress_is_the_momentum_of_all_waves_and_their_beat_cancels():
    rng = np.random.default_rng(3)
    u, v = np.array([-0.6, 0.1, 0.7]), 0.2
    w = np.sqrt(1 - u**2 - v**2)

    def wave(direction):
        """E_X, E_Z, H_X, H_Z (4, 3) of random plane waves along ±Y, and their |E|²."""
        k = np.stack([u, direction * w, np.full(3, v)], axis=-1)
        e = np.cross(k, rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3)))
        h = np.cross(k, e)
        return np.array([e[:, 0], e[:, 2], h[:, 0], h[:, 2]]), (np.abs(e) ** 2).sum(axis=-1)

    (arriving, p), (reflected, r), (transmitted, t) = wave(-1), wave(1), wave(-1)
    force = stress(u, v, np.stack([arriving + reflected, transmitted]))
    np.testing.assert_allclose(force, [(u * w * (p - r - t)).sum(), (w**2 * (p + r - t)).sum()], rtol=1e-12)


def test_bad_nodes_are_refused(te, tmp_path):
    path = tmp_path / "nodes.json"
    good = {"name": te.name, "u": [-0.1, 0.0, 0.1], "v": [0.0, 0.1]}
    cases = [
        ({"name": "other"}, "another cell"), ({"u": [0.1, 0.0]}, "ascending"), ({"v": [0.1, 0.2]}, "must be 0"),
        ({"u": "x"}, "must hold"),
    ]
    for change, message in cases:
        path.write_text(json.dumps(good | change))
        with pytest.raises(InputError, match=message):
            read_nodes(str(path), te)
    with pytest.raises(InputError, match="no such file"):
        read_nodes(str(tmp_path / "none.json"), te)


def test_without_meep_the_stage_says_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "meep", None)
    with pytest.raises(InputError, match="python3-meep") as error:
        import_meep()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("part", ["0/4", "5/4", "x", "3"])
def test_a_bad_part_is_refused(monkeypatch, tmp_path, part):
    monkeypatch.setattr("optics.fdtd.stage.import_meep", lambda: None)
    arguments = ["--cell", "workflow/designs/mark1e_te.yaml", "--out", str(tmp_path / "p.h5"), "--part", part]
    for nodes in ([], ["--nodes", "nodes.json"]):
        monkeypatch.setattr(sys, "argv", ["fdtd", *arguments, *nodes])
        with pytest.raises(InputError, match="--part"):
            main()
    assert not [path for path in tmp_path.iterdir() if path.suffix != ".lock"]  # which the process keeps until it ends


@pytest.mark.parametrize(("u", "message"), [([0.1, 0.33], "order grazes"), ([0.1, 1.2], "evanescent")])
@pytest.mark.parametrize("part", [[], ["--part", "1/1"]])
def test_directions_that_cannot_be_solved_are_refused_before_any_is(monkeypatch, tmp_path, te, u, message, part):
    monkeypatch.setattr("optics.fdtd.stage.import_meep", lambda: None)
    monkeypatch.setattr("optics.fdtd.stage.solve_direction", lambda *_: pytest.fail("solved"))
    nodes = tmp_path / "nodes.json"
    nodes.write_text(json.dumps({"name": te.name, "u": u, "v": [0.0, 0.1]}))
    arguments = ["--cell", "workflow/designs/mark1e_te.yaml", "--nodes", str(nodes), "--out", str(tmp_path / "t.h5")]
    monkeypatch.setattr(sys, "argv", ["fdtd", *arguments, *part])
    with pytest.raises(InputError, match=message):
        main()
    assert [path for path in tmp_path.iterdir() if path.suffix != ".lock"] == [nodes]


def resonance(directions):
    """Values (n, 2) with a resonance of width 0.01 whose place moves with v."""
    u, v = directions.T
    line = 1e-4 / ((u - 0.05 + v**2 / 4) ** 2 + 1e-4)
    return np.stack([0.3 * line + u, line * u], axis=-1)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_adaptive_directions_resolve_a_resonance_to_the_tolerance(tolerance):
    u, v, _ = adapt(resonance, 0.18, 0.18, tolerance)
    values = resonance(np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2)).reshape(u.size, v.size, 2)
    x, y = np.linspace(-0.18, 0.18, 301), np.linspace(0, 0.18, 23)
    exact = resonance(np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)).reshape(x.size, y.size, 2)
    assert np.abs(fill(u, v, values, x, y) - exact).max() < tolerance
    assert np.diff(u)[np.abs(u[1:] - 0.05) < 0.01].max() < 0.5 * np.diff(u).max()


def test_an_adaptive_table_that_was_killed_goes_on_from_its_rows(te, tmp_path, monkeypatch):
    calls = []

    def solve(cell, u, v, settings, told):
        calls.append((u, v))
        if len(calls) == 20:
            raise KeyboardInterrupt
        return solved(u, v)

    monkeypatch.setattr("optics.fdtd.stage.solve_direction", solve)
    path = tmp_path / "rows.h5"
    with pytest.raises(KeyboardInterrupt):
        solve_adaptively(te, 0.18, 0.18, SETTINGS, path)
    assert read_rows(path, te, SETTINGS).values.shape[0] == 19
    u, v, between = solve_adaptively(te, 0.18, 0.18, SETTINGS, path)
    assert len(calls) == len(set(calls)) + 1  # only the one that was cut off is solved again
    table = merge(te, SETTINGS, u, v, between, [path])
    assert table.q(0.02, 0.01)[0] == pytest.approx(smooth(0.02, 0.01)[0][0], abs=1e-6)


def test_damaged_rows_of_an_earlier_run_are_set_aside_and_whole_ones_are_kept(te, tmp_path, capsys):
    path = tmp_path / "part.h5"
    write_rows(path, te, SETTINGS, rows([(0.0, 0.0)]))
    set_aside(path)
    assert (read_rows(path, te, SETTINGS).find(0.0, 0.0), capsys.readouterr().err) == (0, "")
    content = path.read_bytes()
    path.write_bytes(content[:-100])
    set_aside(path)
    assert [item.name for item in tmp_path.iterdir()] == ["part.h5.damaged"]
    assert capsys.readouterr().err.startswith(f"{path}: not whole: cut off, or not a file that")
    set_aside(path)
