"""FDTD against closed forms, the modal solver, symmetry and conservation. Meep runs in a process of its own."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from optics.cells.outline import upright
from optics.cells.schema import Index, LamellarStack, Layer, Metagrating, ThinFilm, read_cell
from optics.fdtd.direction import solve_direction
from optics.fdtd.grid import FdtdSettings
from optics.fdtd.parts import read_rows
from optics.fdtd.stage import solve_part
from optics.modal import stage as modal
from optics.table.pressure_table import PressureTable
from optics.thin_film import stage as thin_film
from optics.waves.incidence import electric_vector

pytestmark = [
    pytest.mark.meep,
    pytest.mark.skipif(importlib.util.find_spec("meep") is None, reason="Meep is not installed"),
]
COARSE = FdtdSettings(pixels_per_wavelength=[5.32, 10.65])
PAIR = FdtdSettings(pixels_per_wavelength=[10.65, 21.3])


def changed(cell, **updates):
    return Metagrating.model_validate(cell.model_dump() | updates)


def slab(te, axis, k=0.0):
    return changed(te, period_nm=500.0, ridges_nm=[[0.0, 500.0]], electric_axis=axis, index={"n": 2.0, "k": k})


def film(u, v, axis, k=0.0):
    """q (3,) and absorptance of the slab by transfer matrix; s and p are weighed by their share of E."""
    sine = np.hypot(u, v)
    across = np.array([-v, u, 0.0]) / sine if sine > 0 else np.array([0.0, 1.0, 0.0])
    share = float(electric_vector(u, v, axis) @ across) ** 2
    layer = Layer(thickness_nm=600.0, index=Index(n=2.0, k=k))
    total = np.zeros(2)
    for polarisation, weight in (("s", share), ("p", 1 - share)):
        stack = ThinFilm(kind="thin_film", name="x", wavelength_nm=1064.0, polarisation=polarisation, layers=[layer])
        q, response = thin_film.pressure(stack, np.array([sine]))
        total += weight * np.array([q[0, 2], response.absorptance[0]])
    return np.array([u * total[1], v * total[1], total[0]]), total[1]


@pytest.mark.parametrize(
    ("u", "v", "axis"),
    [(0, 0, "r"), (0.5, 0, "r"), (0.5, 0, "g"), (0, 0.5, "r"), (0, 0.5, "g"), (0.3, 0.4, "r"), (0.3, 0.4, "g")],
)
def test_a_slab_agrees_with_the_transfer_matrix(te, apart, u, v, axis):
    result = apart(solve_direction, slab(te, axis), u, v, PAIR)
    assert np.abs(result.q - film(u, v, axis)[0]).max() < 1e-2


def test_strong_absorption_is_lost_power(te, apart):
    result = apart(solve_direction, slab(te, "r", 0.05), 0.3, 0.2, PAIR)
    q, absorptance = film(0.3, 0.2, "r", 0.05)
    assert absorptance > 0.1
    assert result.absorptance == pytest.approx(absorptance, abs=1e-2)
    assert np.abs(result.q - q).max() < 1e-2


@pytest.mark.parametrize(
    ("which", "u", "v"), [("te", 0.0, 0.0), ("te", -0.09, 0.09), ("tm", 0.0, 0.0), ("tm", 0.03, 0.09)]
)
def test_the_published_cells_agree_with_the_modal_solver(request, apart, which, u, v):
    cell = request.getfixturevalue(which)
    result = apart(solve_direction, cell, u, v, FdtdSettings(pixels_per_wavelength=[10.65, 21.3], tolerance=1.0))
    exact = modal.solve(cell, np.array([u]), np.array([v]), 30)
    assert np.abs(result.q - exact.q[0, 0]).max() < max(1.5 * result.error, 1e-2)
    assert result.absorptance == pytest.approx(exact.absorptance[0, 0], rel=0.03)
    assert abs(result.energy_imbalance) < 2e-3
    assert result.error > 0


@pytest.mark.parametrize("which", ["te", "tm"])
def test_absorptance_at_normal_incidence_is_the_modal_solver_s(request, apart, which):
    """2.91e-5 and 1.29e-5: by the fields' own loss, where the grid holds them, to 1 % already with 15 pixels."""
    cell = request.getfixturevalue(which)
    result = apart(solve_direction, cell, 0.0, 0.0, FdtdSettings(pixels_per_wavelength=[7.45, 10.65, 14.9]))
    exact = modal.solve(cell, np.zeros(1), np.zeros(1), 40).absorptance[0, 0]
    assert exact == pytest.approx({"te": 2.91e-5, "tm": 1.29e-5}[which], rel=5e-3)
    assert result.absorptance == pytest.approx(exact, rel=1e-2)


@pytest.mark.parametrize(
    ("around", "axis", "v"),
    [
        ({"back": 1.5}, "r", 0.1),
        ({"front": 1.5}, "g", 0.0),
        ({"front": 1.33, "back": 1.8}, "g", 0.1),
        ({"front": 1.45, "back": 1.45}, "r", 0.0),
    ],
)
def test_half_spaces_other_than_vacuum_agree_with_the_modal_solver(te, apart, around, axis, v):
    cell = changed(
        te,
        period_nm=600.0,
        ridges_nm=[[50.0, 250.0]],
        ridge_height_nm=100.0,
        membrane_nm=60.0,
        surroundings=around,
        electric_axis=axis,
    )
    result = apart(solve_direction, cell, 0.05, v, FdtdSettings(pixels_per_wavelength=[7.45, 10.65, 14.9]))
    exact = modal.solve(cell, np.array([0.05]), np.array([v]), 40).q[0, 0]
    assert np.abs(result.q - exact).max() <= result.error
    assert np.abs(result.q - exact).max() < 5e-3
    assert abs(result.energy_imbalance) < 1e-3


# Index, electric axis, thickness: gold and tungsten at 1064 nm, a strong absorber.
LOSSY = [({"n": 0.26, "k": 6.97}, "r", 60.0), ({"n": 3.5, "k": 2.7}, "g", 200.0), ({"n": 2.0, "k": 0.3}, "g", 300.0)]


@pytest.mark.parametrize(("index", "axis", "height"), LOSSY)
def test_metals_and_absorbers_agree_with_the_modal_solver_and_keep_energy(te, apart, index, axis, height):
    cell = changed(
        te,
        period_nm=500.0,
        ridges_nm=[[50.0, 250.0]],
        ridge_height_nm=height,
        membrane_nm=100.0,
        index=index,
        electric_axis=axis,
    )
    result = apart(solve_direction, cell, 0.05, 0.1, FdtdSettings(pixels_per_wavelength=[7.45, 10.65, 14.9]))
    exact = modal.solve(cell, np.array([0.05]), np.array([0.1]), 100)
    assert np.abs(result.q - exact.q[0, 0]).max() <= result.error
    assert result.error < 3e-2
    assert result.absorptance == pytest.approx(exact.absorptance[0, 0], abs=result.error)
    # What came in less what left is what the fields lose by themselves: 1 − R − T was 0 by definition before.
    assert result.absorptance > 10 * abs(result.energy_imbalance)
    assert abs(result.energy_imbalance) < 5e-4


def silver(axis):
    """Silver ridges under a film on silver at 500 nm."""
    metal, film_index = {"n": 0.13215143357575174, "k": 2.765766440138452}, {"n": 1.5}
    return LamellarStack.model_validate(
        {
            "kind": "lamellar",
            "name": "silver",
            "wavelength_nm": 500.0,
            "electric_axis": axis,
            "period_nm": 180.0,
            "layers": [
                {"thickness_nm": 20.0, "index": film_index},
                {
                    "thickness_nm": 80.0,
                    "index": film_index,
                    "ridges": [{"start_nm": 60.0, "width_nm": 60.0, "index": metal}],
                },
            ],
            "surroundings": {"front": 1.0, "back": metal["n"], "back_k": metal["k"]},
        }
    )


def test_silver_on_silver_reflects_what_it_should(apart):
    result = apart(solve_direction, silver("r"), 0.0, 0.0, FdtdSettings(tolerance=2e-3))
    assert result.q[2] == pytest.approx(1.8166, abs=result.error)
    assert result.error < 2e-3
    assert abs(result.energy_imbalance) < 1e-4


def test_slow_convergence_of_silver_in_tm_is_stated(apart):
    """Even and odd numbers of pixels; where the substrate reached the other absorber, fields grew without limit."""
    result = apart(solve_direction, silver("g"), 0.0, 0.0, FdtdSettings(pixels_per_wavelength=[10.65, 14.9, 21.3]))
    assert abs(result.q[2] - 1.791) <= result.error
    assert abs(result.energy_imbalance) < 2e-4


def test_a_period_far_below_the_wavelength_is_solved(te, apart):
    cell = changed(te, period_nm=90.0, ridges_nm=[[0.0, 45.0]], ridge_height_nm=100.0, membrane_nm=100.0)
    result = apart(solve_direction, cell, 0.02, 0.0, FdtdSettings(tolerance=2e-2))
    exact = modal.solve(cell, np.array([0.02]), np.zeros(1), 20).q[0, 0]
    assert np.abs(result.q - exact).max() <= result.error < 2e-2
    assert all(np.diff(result.resolutions) > 0)


def test_mirroring_the_cell_flips_the_force_across(te, apart):
    ridges = [[1600.0 - start - width, width] for start, width in reversed(te.ridges_nm)]
    one = apart(solve_direction, te, 0.1, 0.0, COARSE)
    other = apart(solve_direction, changed(te, ridges_nm=ridges), -0.1, 0.0, COARSE)
    # The mirrored edges lie elsewhere on the grid: equal to the error of the coarse pair only.
    assert np.abs(one.q * [-1, 1, 1] - other.q).max() < one.error + other.error
    assert abs(one.q[0]) > 2 * one.error


def test_v_to_minus_v_is_a_mirror(tm, apart):
    one, other = (apart(solve_direction, tm, 0.05, v, COARSE) for v in (0.12, -0.12))
    np.testing.assert_allclose(one.q * [1, -1, 1], other.q, atol=1e-6)


@pytest.mark.parametrize(
    ("which", "u", "v"),
    [
        ("te", 0.05, 0.0),
        ("te", -0.09, 0.09),
        ("te", 0.1737, 0.1737),
        ("tm", 0.03, 0.17),
        ("tm", -0.1737, 0.0),
        # Here an order leaves at 10° to the plane of the grating, |w| = 0.17.
        ("tm", 0.18, 0.18),
        ("tm", -0.18, 0.18),
    ],
)
def test_each_row_states_an_error_that_covers_the_modal_solver_and_the_stress(request, apart, tmp_path, which, u, v):
    cell, settings = request.getfixturevalue(which), FdtdSettings(tolerance=1e-2)
    path = tmp_path / "part.h5"
    apart(solve_part, cell, np.array([[u, v]]), settings, path)
    q_g, q_r, q_n, error, stress = (
        read_rows(path, cell, settings).column(name)[0]
        for name in (
            "q_g",
            "q_r",
            "q_n",
            "error",
            "stress",
        )
    )
    exact = modal.solve(cell, np.array([u]), np.array([v]), 40).q[0, 0]
    assert np.abs([q_g, q_r, q_n] - exact).max() <= error <= settings.tolerance
    # Orders and stress come from the same fields on the same lines: what is left between them are remainders of fourth
    # order, (π/30)⁴ = 1.2e-4 with 30 pixels a wavelength of vacuum, and light that was still to come (`decay`).
    assert 0 < stress <= 5e-4


def test_a_cell_twice_as_large_at_twice_the_wavelength_has_the_same_response(te, apart):
    lengths = {name: 2 * getattr(te, name) for name in ("wavelength_nm", "period_nm", "ridge_height_nm", "membrane_nm")}
    large = changed(te, ridges_nm=[[2 * x for x in ridge] for ridge in te.ridges_nm], **lengths)
    one, other = (apart(solve_direction, cell, 0.1, 0.05, COARSE) for cell in (te, large))
    np.testing.assert_allclose(other.q, one.q, rtol=0, atol=1e-9)
    assert other.error == pytest.approx(one.error, abs=1e-9)
    assert other.resolutions == pytest.approx(one.resolutions)


def test_a_stage_that_is_started_again_keeps_its_rows(te, apart, tmp_path):
    path, directions = tmp_path / "part.h5", np.array([[0.0, 0.0], [0.1, 0.0]])
    apart(solve_part, te, directions[:1], COARSE, path)
    first = read_rows(path, te, COARSE).values
    apart(solve_part, te, directions, COARSE, path)
    second = read_rows(path, te, COARSE).values
    assert second.shape[0] == 2
    np.testing.assert_array_equal(second[0], first[0])  # its time too: it was not solved again
    assert [item.name for item in tmp_path.iterdir()] == ["part.h5"]


@pytest.mark.slow
@pytest.mark.parametrize(("u", "v"), [(0.122, 0.0), (-0.09, 0.09)])
def test_the_resonance_is_resolved_by_the_finest_pair(tm, apart, u, v):
    # At 20 and 40 pixels per µm the resonance is off by more than its width: q errs by 0.1, the absorptance by 70 %.
    # As the tables are made: at 1e-2 the second direction is left at 15 per wavelength, its absorptance 5 % off.
    result = apart(solve_direction, tm, u, v, FdtdSettings(tolerance=5e-3))
    exact = modal.solve(tm, np.array([u]), np.array([v]), 40)
    assert np.abs(result.q - exact.q[0, 0]).max() < 1e-2
    assert result.absorptance == pytest.approx(exact.absorptance[0, 0], rel=0.03)


@pytest.mark.slow
def test_fdtd_finds_the_directions_for_a_rounded_cell_itself(tmp_path):
    cell, out = "workflow/designs/rounded_te.yaml", tmp_path / "table.h5"
    window = ["--u-max", "0.1737", "--v-max", "0.1737", "--tolerance", "5e-3"]
    subprocess.run([sys.executable, "-m", "optics.fdtd", "--cell", cell, *window, "--out", str(out)], check=True)
    table = PressureTable.read(out)
    some = np.ix_(np.arange(0, table.u.size, 6), np.arange(0, table.v.size, 6))
    exact = modal.solve(upright(read_cell(cell)), table.u[::6], table.v[::6], 20).q
    difference = np.abs(np.moveaxis(table.q_nodes, 0, -1)[some] - exact).max(axis=-1)
    assert np.all(difference <= table.error[some])
    assert difference.max() < 5e-3
