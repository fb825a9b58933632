"""FDTD without running Meep: one direction's extrapolation, ringing, orders that graze, polarisation, stress."""

from types import SimpleNamespace

import numpy as np
import pytest

from beamrider.io.files import InputError
from optics.cells.schema import Metagrating
from optics.fdtd.direction import (
    cautious_estimate,
    check_cell,
    check_window,
    estimate,
    extrapolate,
    solve_direction,
)
from optics.fdtd.efficiencies import Efficiencies, check_polarisation, stress
from optics.fdtd.grid import FdtdSettings, layout
from optics.fdtd.orders import Orders, grazing
from optics.fdtd.progress import check_memory
from optics.fdtd.run import Decay, Run, pulse_width, reflection, remaining
from optics.waves.incidence import electric_vector, wave_vector

SETTINGS = FdtdSettings()


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


def test_richardson_is_exact_for_an_error_of_second_order():
    values = {n: np.array([0.3, -1.0]) + np.array([5.0, -2.0]) / n**2 for n in (30, 47)}
    best, correction = extrapolate((30, values[30]), (47, values[47]))
    np.testing.assert_allclose(best, [0.3, -1.0], rtol=1e-14)
    np.testing.assert_allclose(correction, np.array([5.0, 2.0]) / 47**2, rtol=1e-12)


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
