"""Orders and slices: what a stretched basis converges to, and errors that are told right, on metals as on glass."""

import json
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest

from beamrider.io.files import InputError
from optics.cells.schema import LamellarStack, Metagrating, Profile
from optics.modal import normal_incidence as local
from optics.modal.absorption import imbalance
from optics.modal.lamellar import efficiencies, prepare
from optics.modal.limit import edge_exponent, refuse_without_limit
from optics.modal.response import solve
from optics.modal.stage import guided_order, make_table
from optics.modal.steps import modal_cell
from optics.modal.truncation import change, choose, fitted_rate, remaining
from optics.refinement.forecast import forecast

# n and k of gold and silver at 659 nm (Johnson & Christy 1972) and of tungsten at 633 nm (Palik 1985)
METALS = {"gold": (659.0, 0.14, 3.697), "silver": (659.0, 0.05, 4.483), "tungsten": (633.0, 3.65, 2.89)}


def ridges_of(n, k, wavelength=1000.0, axis="g", below=(), **around):
    """Ridges of 0.4 periods and 0.15 wavelengths in air, at a period of 0.9 wavelengths."""
    period = 0.9 * wavelength
    ridge = {"start_nm": 0.0, "width_nm": 0.4 * period, "index": {"n": n, "k": k}}
    return LamellarStack.model_validate(
        {
            "kind": "lamellar",
            "name": "ridges",
            "wavelength_nm": wavelength,
            "electric_axis": axis,
            "period_nm": period,
            "layers": [{"thickness_nm": 0.15 * wavelength, "index": {"n": 1.0}, "ridges": [ridge]}, *below],
            "surroundings": around,
        }
    )


def silver_tm():
    """Silver ridges under glass on silver at 500 nm: a ratio of permittivities of −3.4 + 0.3i, next to no limit."""
    silver = {"n": 0.13215143357575174, "k": 2.765766440138452}
    ridge = {"start_nm": 60.0, "width_nm": 60.0, "index": silver}
    return LamellarStack.model_validate(
        {
            "kind": "lamellar",
            "name": "silver_tm",
            "wavelength_nm": 500.0,
            "electric_axis": "g",
            "period_nm": 180.0,
            "layers": [
                {"thickness_nm": 20.0, "index": {"n": 1.5}},
                {"thickness_nm": 80.0, "index": {"n": 1.5}, "ridges": [ridge]},
            ],
            "surroundings": {"back": silver["n"], "back_k": silver["k"]},
        }
    )


def at(cell, u, v, order):
    return solve(cell, np.array([u]), np.array([v]), order)


def test_silver_next_to_no_limit_has_the_reflectance_of_finite_elements():
    """R = 0.7855 in TM of finite elements of degree 4, graded to 1e-6 nm at the edges of the ridges; in TE 0.8166.

    Plain plane waves come near it slowly: 0.798 at 150 orders, 0.791 at 400.
    """
    cell = silver_tm()
    assert at(cell, 0.0, 0.0, 60).q[0, 0, 2] - 1 == pytest.approx(0.7855, abs=8e-4)
    assert at(cell.model_copy(update={"electric_axis": "r"}), 0.0, 0.0, 15).q[0, 0, 2] - 1 == pytest.approx(
        0.81660, abs=1e-5
    )


@pytest.mark.parametrize("metal", METALS)
def test_the_stated_error_covers_the_true_one_on_metals(metal):
    """In the cell's own polarisation, TM, and in any: at most ten times too large in the middle, and below 1e-3."""
    wavelength, n, k = METALS[metal]
    cell = ridges_of(n, k, wavelength, below=({"thickness_nm": 60.0, "index": {"n": n, "k": k}},), back=1.5)
    chosen = choose(cell, 0.4, 0.4, 1e-3)
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-0.4, 0.4, 12), rng.uniform(0.0, 0.4, 4)
    found = chosen.solve(u, v)
    stated, true = chosen.errors(u, v, found), change(found, solve(cell, u, v, 75))
    for told, error in zip(stated, true, strict=True):
        assert np.mean(told >= error) >= 0.95
        assert np.median(told / error) < 10
        assert np.quantile(error, 0.99) < 1e-3
    assert not chosen.reasons


def test_a_tolerance_that_is_out_of_reach_says_so():
    chosen = choose(silver_tm(), 0.05, 0.05, 1e-6)
    assert len(chosen.reasons) == 1
    assert chosen.reasons[0].startswith("slow convergence: error ")
    u, v = np.array([0.01]), np.array([0.02])
    found = chosen.solve(u, v)
    assert 1e-6 < chosen.errors(u, v, found)[1][0, 0] < 1e-2


def test_metals_converge_algebraically_and_far_faster_than_plain_plane_waves():
    cell = ridges_of(0.14, 3.697)
    stack = [prepare(cell, stretched) for stretched in (True, False)]
    one = np.array([0.05])

    def error(which, order):
        fine = efficiencies(stack[0], one, one, 90)[0][0, :, 90]
        return np.abs(efficiencies(stack[which], one, one, order)[0][0, :, order] - fine).max()

    assert error(0, 40) < 2e-5
    assert error(1, 40) > 1e-3


def test_dielectrics_lose_nothing_and_converge_to_what_plain_plane_waves_converge_to(te):
    cell = Metagrating.model_validate(te.model_dump() | {"index": {"n": 2.0, "k": 0.0}})
    u, v = np.array([-0.3, 0.02, 0.11]), np.array([0.05, 0.3])
    found = solve(cell, u, v, 22)
    assert np.abs(found.absorptance_stokes).max() < 1e-12
    uu, vv = np.repeat(u, v.size), np.tile(v, u.size)
    slow = [efficiencies(prepare(cell, False), uu, vv, n)[0][:, :, n] for n in (30, 60)]
    fast = efficiencies(prepare(cell), uu, vv, 22)[0][:, :, 22]
    assert np.abs(fast - slow[1]).max() < 1.5 * np.abs(slow[0] - slow[1]).max() < 1e-3


def test_the_fitted_rate_is_that_of_a_power_and_the_rest_is_its_sum():
    rungs = [8, 12, 18, 27, 40]
    values = [np.array([3.0 * n**-1.3, -2.0 * n**-1.3]) for n in rungs]
    changes = [np.abs(a - b) for a, b in pairwise(values)]
    rate, scatter = fitted_rate(rungs, changes)
    assert rate == pytest.approx(1.3, abs=0.05)
    assert scatter < 0.05
    assert np.all(remaining(rungs, changes) / np.abs(values[-1]) == pytest.approx(1.0, abs=0.2))


@pytest.mark.parametrize("ratio", [-3.4, -3.0 + 1e-9, -0.3])
def test_edges_have_exponents_outside_the_gap(ratio):
    """At −3 and −1/3 the exponent reaches 0; outside them cos(πτ/2) = (1 − r)/(2 (1 + r)) holds."""
    tau = edge_exponent(ratio, 1.0)
    assert np.cos(np.pi * tau / 2) == pytest.approx(min(1.0, abs((1 - ratio) / (2 * (1 + ratio)))), abs=1e-6)


def test_where_there_is_no_limit_the_cell_is_refused_in_one_line():
    cell = ridges_of(0.01, 1.41)  # ε = −1.99 + 0.03i
    with pytest.raises(InputError, match=r"ridges: permittivity of ridges over that of gaps = -1.99\+0.028i: must be"):
        refuse_without_limit(cell)
    refuse_without_limit(ridges_of(0.14, 3.697))
    refuse_without_limit(silver_tm())


def test_screening_marks_what_has_no_limit(tmp_path, monkeypatch, te):
    metal = Metagrating.model_validate(te.model_dump() | {"index": {"n": 0.01, "k": 1.41}})
    (tmp_path / "cells.jsonl").write_text("\n".join(json.dumps(cell.model_dump()) for cell in (te, metal)) + "\n")
    out = tmp_path / "out.parquet"
    monkeypatch.setattr("sys.argv", ["local", "--cells", str(tmp_path / "cells.jsonl"), "--out", str(out)])
    local.main()
    assert [row["resolved"] for row in pq.read_table(out).to_pylist()] == [True, False]


BLAZE = {
    "kind": "profile",
    "name": "blaze",
    "wavelength_nm": 1064.0,
    "electric_axis": "g",
    "period_nm": 1600.0,
    "depth_nm": 1000.0,
    "polygons": [{"index": {"n": 2.0}, "vertices_nm": [[0, 1000], [0, 800], [1600, 0], [1600, 1000]]}],
}


def test_steps_follow_from_the_tolerance_and_their_error_is_told():
    """A blaze: 8 steps err by 0.03 and more. Against far more steps at more orders."""
    cell = Profile.model_validate(BLAZE)
    chosen = choose(cell, 0.1, 0.1, 1e-2)
    u, v = np.array([-0.083, 0.017, 0.071]), np.array([0.043])
    found = chosen.solve(u, v)
    many = solve(modal_cell(cell, 256), u, v, 16)
    stated, true = chosen.errors(u, v, found), change(found, many)
    assert chosen.settings["slices"] == chosen.slices >= 16
    assert np.all(true[1] <= stated[1])
    assert np.all(true[1] < 1e-2)
    assert np.median(stated[1]) < 1e-2
    assert np.median(change(solve(modal_cell(cell, 8), u, v, chosen.order), many)[1]) > 3e-2


def test_orders_that_run_in_front_are_looked_for_too():
    """Glass in front is what no ridge covers: it guides where the ridges, of less index, do not."""
    assert guided_order(wide(), 0.2) == np.ceil((1.5 + 0.2) * 10000.0 / 500.0)
    assert guided_order(
        wide(
            layers=[
                {
                    "thickness_nm": 500.0,
                    "index": {"n": 1.5},
                    "ridges": [
                        {"start_nm": 0.0, "width_nm": 5000.0, "index": {"n": 1.1}},
                    ],
                }
            ]
        ),
        0.2,
    ) == np.ceil((1.5 + 0.2) * 10000.0 / 500.0)


def wide(**changed):
    """A binary grating of glass, 20 wavelengths wide and half a wave deep, into air; values of Meep's tutorial."""
    return LamellarStack.model_validate(
        {
            "kind": "lamellar",
            "name": "wide",
            "wavelength_nm": 500.0,
            "electric_axis": "r",
            "period_nm": 10000.0,
            "layers": [
                {
                    "thickness_nm": 500.0,
                    "index": {"n": 1.5},
                    "ridges": [{"start_nm": 5000.0, "width_nm": 5000.0, "index": {"n": 1.0}}],
                }
            ],
            "surroundings": {"front": 1.5, "back": 1.0},
        }
        | changed
    )


def test_a_period_of_twenty_wavelengths_has_the_orders_known():
    order = 50
    here = at(wide(), 0.0, 0.0, order).transmitted[0, 0]
    assert here[[order + m for m in (1, 3, 5, 7)]] == pytest.approx([0.3888, 0.0429, 0.0152, 0.0076], abs=1e-4)
    there = at(wide(), 0.278494, 0.0, order)
    assert there.reflected.sum() == pytest.approx(0.05893, abs=5e-5)
    assert there.transmitted[0, 0, order - 1 : order + 2] == pytest.approx([0.38738, 0.00108, 0.38465], abs=5e-5)


@pytest.mark.parametrize("metal", METALS)
def test_what_the_orders_miss_is_lost_by_the_fields(metal):
    """R + T + ∫ Im ε |E|² = 1 in both polarisations, at any truncation, on metals and on weakly absorbing glass."""
    wavelength, n, k = METALS[metal]
    u, v = np.array([-0.3, 0.05]), np.array([0.2, 0.0])
    cell = ridges_of(n, k, wavelength, below=({"thickness_nm": 60.0, "index": {"n": 2.0, "k": 1e-2}},), back=1.5)
    assert solve(cell, u, v, 20).absorptance.min() > 1e-3
    assert imbalance(cell, u, v, 20) < 1e-8
    glass = ridges_of(2.0, 2e-6, wavelength)
    assert imbalance(glass, u, v, 15) < 1e-3 * solve(glass, u, v, 15).absorptance.min()


def test_a_table_that_would_take_hours_is_forecast_and_refused():
    hundred = wide(
        period_nm=50000.0,
        layers=[
            {
                "thickness_nm": 500.0,
                "index": {"n": 1.5},
                "ridges": [{"start_nm": 25000.0, "width_nm": 25000.0, "index": {"n": 1.0}}],
            }
        ],
    )
    with pytest.raises(InputError, match=r"--most-minutes = 0.5: the table of wide would take longer: .* CPU minutes"):
        make_table(hundred, 0.05, 0.05, 1e-2, 0.5)


def test_a_forecast_grows_with_the_directions():
    cell = ridges_of(1.5, 0.0)
    u, v = np.linspace(-0.1, 0.1, 9), np.linspace(0.0, 0.1, 8)

    def work(x, y):
        return solve(cell, x, y, 20)

    few, many = (forecast(work, np.repeat(u, k), v, 2, 20, 1) for k in (1, 100))
    assert (few.rows, few.lines, few.beside) == (9, 8, 48)
    assert 10 < many.seconds / few.seconds < 200
    assert many.bytes > few.bytes


@pytest.mark.parametrize("axis", ["r", "g"])
def test_what_is_stated_of_orders_leaves_room_for_interpolation(axis):
    """Two ridges of nitride at 1550 nm: with the orders chosen the stated error of other directions is below half."""
    cell = Metagrating.model_validate(
        {
            "kind": "metagrating",
            "name": "own",
            "wavelength_nm": 1550.0,
            "electric_axis": axis,
            "period_nm": 1900.0,
            "ridges_nm": [[0.0, 700.0], [980.0, 300.0]],
            "ridge_height_nm": 500.0,
            "membrane_nm": 300.0,
            "index": {"n": 1.98, "k": 1e-6},
        }
    )
    chosen = choose(cell, 0.4, 0.4, 1e-2)
    rng = np.random.default_rng(5)
    u, v = rng.uniform(-0.4, 0.4, 20), np.sort(rng.uniform(0.0, 0.4, 5))
    fine = chosen.solve(u, v)
    own, _ = chosen.errors(u, v, fine)
    true, _ = change(fine, solve(cell, u, v, 3 * chosen.order))
    assert np.quantile(own, 0.9) <= 0.5e-2
    assert np.quantile(true, 0.99) <= 0.4e-2
