"""Tables of gratings: right between their directions, continuous across the cut-offs, smooth elsewhere."""

import numpy as np
import pytest

from beamrider.io.files import InputError
from optics.cells.schema import Metagrating
from optics.modal.stage import make_table, solve
from optics.table.lookup import lookup_many
from optics.table.pressure_table import PressureTable
from optics.table.strips import breaks
from optics.waves.incidence import electric_vector, stokes, worst_polarisation
from tests.damage import edited

TOLERANCE = 3e-3
WINDOW = 0.36  # holds both cut-offs of the TE cell, their crossing at v = 0.0707 and where they leave the window


@pytest.fixture(scope="module", params=["te", "tm"])
def made(request):
    """A table that is quick to make, and its cell."""
    cell = request.getfixturevalue(request.param)
    return make_table(cell, WINDOW, 0.3, TOLERANCE), cell


def directions(table: PressureTable, rows: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    return rng.uniform(-table.u[-1], table.u[-1], (rows, 1)), rng.uniform(0.0, table.v[-1], (rows, lines))


def test_interpolation_meets_the_tolerance_at_random_directions(made):
    table, cell = made
    u, v = directions(table, 40, 20)
    order = table.attrs["settings"]["orders"]
    exact = np.array([solve(cell, a, b, order).q[0] for a, b in zip(u, v, strict=True)])
    error = np.abs(table.q(u, v) - exact).max(axis=-1)
    assert np.mean(error > 3 * TOLERANCE) <= 1e-3
    assert np.quantile(error, 0.95) <= TOLERANCE


def test_values_beside_a_cutoff_are_the_solver_s(made):
    """Within 1e-3 of a cut-off q changes by 0.05 and more; the table follows it."""
    table, cell = made
    order, curves = table.attrs["settings"]["orders"], table.cutoffs.curves
    v = np.array([0.031, 0.123, 0.251])
    u = curves.take(curves.offset == 0.0).u(v)
    for side in (-4e-4, -1e-5, 1e-5, 4e-4):
        for near, b in zip((u + side).T, v, strict=True):
            near = near[np.abs(near) < WINDOW]
            exact = solve(cell, near, np.array([b]), order).q[:, 0]
            assert np.abs(table.q(near, b) - exact).max() < 2 * TOLERANCE


def test_every_node_has_its_value(made):
    """On the edges of the window too, and where cut-offs leave it there; 1e-8 beside them in τ."""
    table, _ = made
    found = table.q(table.u[:, None], table.v)
    assert np.abs(found - np.moveaxis(table.q_nodes, 0, -1))[[0, -1]].max() < 1e-6
    assert np.quantile(np.abs(found - np.moveaxis(table.q_nodes, 0, -1)), 0.999) < TOLERANCE


def test_q_is_continuous_across_cutoffs_and_where_the_range_of_v_is_split(made):
    table, _ = made
    curves = table.cutoffs.curves
    cuts = curves.take(curves.offset == 0.0)
    v = np.random.default_rng(1).uniform(0.0, table.v[-1], 300)
    for u in cuts.u(v):
        held = np.abs(u) < table.u[-1] - 1e-9
        # Beside a cut-off q changes as the root of the distance, here of that between neighbouring numbers.
        step = table.q(np.nextafter(u, 1.0)[held], v[held]) - table.q(np.nextafter(u, -1.0)[held], v[held])
        assert np.abs(step).max() < 1e-6
    u = np.random.default_rng(2).uniform(-table.u[-1], table.u[-1], 300)
    for split in breaks(cuts, table.u[0], table.u[-1], table.v[-1])[1:-1]:
        assert np.abs(table.q(u, split + 1e-13) - table.q(u, split - 1e-13)).max() < 1e-6


def test_the_gradient_is_that_of_the_values_and_continuous_off_the_cutoffs(made):
    table, _ = made
    u, v = (np.ravel(x) for x in np.broadcast_arrays(*directions(table, 30, 10)))
    curves = table.cutoffs.curves
    far = np.abs(curves.take(curves.offset == 0.0).u(v) - u).min(axis=0) > 0.01
    u, v, h = np.clip(u[far], -0.355, 0.355), np.clip(v[far], 1e-3, 0.295), 1e-6
    gradient = table.gradient(u, v)
    assert np.allclose(gradient[..., 0], (table.q(u + h, v) - table.q(u - h, v)) / (2 * h), atol=1e-4)
    assert np.allclose(gradient[..., 1], (table.q(u, v + h) - table.q(u, v - h)) / (2 * h), atol=1e-4)
    for line in table.v[1:-1]:
        if np.abs(breaks(curves, table.u[0], table.u[-1], table.v[-1]) - line).min() > 1e-9:
            above, below = table.gradient(u, line + 1e-12), table.gradient(u, line - 1e-12)
            near = np.abs(curves.take(curves.offset == 0.0).u(np.array([line])) - u).min(axis=0) < 1e-3
            assert np.abs(above - below)[~near].max() < 1e-6


def test_slopes_go_on_where_the_range_of_v_is_split(made):
    """There ∂v is shared at the nodes in u; between them it is as good as the interpolation of that product."""
    table, _ = made
    cuts = table.cutoffs.curves.take(table.cutoffs.curves.offset == 0.0)
    u = np.random.default_rng(3).uniform(-table.u[-1], table.u[-1], 2000)
    for split in breaks(cuts, table.u[0], table.u[-1], table.v[-1])[1:-1]:
        far = np.abs(cuts.u(np.array([split])) - u).min(axis=0) > 0.03
        above, below = table.gradient(u[far], split + 1e-12), table.gradient(u[far], split - 1e-12)
        assert np.abs(above - below).max() < 2e-3 * np.abs(above).max()


def test_a_lossless_cell_on_an_absorber_keeps_its_energy_balance(te):
    around = {"front": 1.0, "back": 1.5, "back_k": 0.5}
    cell = Metagrating.model_validate(te.model_dump() | {"index": {"n": 2.0}, "surroundings": around})
    table = make_table(cell, 0.05, 0.05, 0.1)
    assert table.absorptance_nodes.min() > 0.5
    # From the fields' own loss behind the cell, which is all that is lost.
    assert 0.0 <= table.attrs["energy_imbalance"] < 1e-10


def test_more_orders_than_can_be_solved_in_time_are_refused_with_the_time(te):
    wide = Metagrating.model_validate(te.model_dump() | {"period_nm": 2e5})
    with pytest.raises(InputError, match=r"--most-minutes = 30: the table of mark1e_te would take longer: .*minutes"):
        make_table(wide, 0.05, 0.05, 0.1)


def test_a_narrow_window_far_along_the_ridges_is_held(te):
    """Its rows are good from the start; only the surroundings of its cut-offs are refined."""
    cell = Metagrating.model_validate(te.model_dump() | {"period_nm": 1500.0, "ridges_nm": [[100.0, 600.0]]})
    table = make_table(cell, 0.05, 0.99, 3e-2)
    v = np.linspace(0.0, 0.98, 40)
    exact = solve(cell, np.array([0.02]), v, table.attrs["settings"]["orders"]).q[0]
    assert np.quantile(np.abs(table.q(0.02, v) - exact).max(axis=-1), 0.9) < 3e-2


def test_v_and_minus_v_mirror_also_in_the_gradient(made):
    table, _ = made
    u, v = directions(table, 30, 10)
    assert np.array_equal(table.q(u, v) * [1, -1, 1], table.q(u, -v))
    mirrored = table.gradient(u, -v) * np.array([[1, -1], [-1, 1], [1, -1]])
    assert np.array_equal(table.gradient(u, v), mirrored)
    assert not np.any(table.gradient(u, 0.0)[..., [0, 2], 1])


def test_round_trip_with_cutoffs(made, tmp_path):
    table, _ = made
    table.write(tmp_path / "t.h5")
    back = PressureTable.read(tmp_path / "t.h5")
    u, v = directions(table, 20, 5)
    assert np.array_equal(back.q(u, v), table.q(u, v))
    assert (tmp_path / "t.h5").stat().st_size < 20e6


def test_every_polarisation_is_looked_up_as_it_was_solved(made):
    table, cell = made
    u, v = directions(table, 12, 8)
    order = table.attrs["settings"]["orders"]
    out = np.empty((u.size * v.shape[1], 16))
    lookup_many(table.arrays(stokes=True), np.repeat(u, v.shape[1]), v.ravel(), out)
    responses = [solve(cell, a, b, order) for a, b in zip(u, v, strict=True)]
    exact = np.concatenate(
        [np.concatenate([r.q_stokes, r.absorptance_stokes[..., None]], axis=-1).reshape(-1, 16) for r in responses]
    )
    assert np.quantile(np.abs(out - exact).max(axis=1), 0.95) <= TOLERANCE
    worst = worst_polarisation(np.moveaxis((out - exact).reshape(*v.shape, 4, 4), 2, 0)).max(axis=-1)
    near = np.abs(table.u - u).argmin(axis=1), np.abs(table.v[:, None] - v[:, None]).argmin(axis=1)
    assert np.mean(worst <= table.error_stokes[near[0][:, None], near[1]]) >= 0.95
    nominal = np.concatenate([table.q(u, v), table.absorptance(u, v)[..., None]], axis=-1).reshape(-1, 1, 4)
    field = electric_vector(np.broadcast_to(u, v.shape), v, cell.electric_axis)
    s = stokes(np.broadcast_to(u, v.shape), v, field).reshape(-1, 4, 1)
    assert np.quantile(np.abs((s * out.reshape(-1, 4, 4)).sum(axis=1) - nominal[:, 0]), 0.99) <= TOLERANCE


@pytest.mark.parametrize("name", ["normal_incidence", "cell", "settings"])
def test_an_edited_attribute_is_refused(made, tmp_path, name):
    """Stability takes its slopes from one of them."""
    path = tmp_path / "t.h5"
    made[0].write(path)
    with edited(path) as file:
        text = file.attrs[name]
        file.attrs[name] = text.replace("1", "2", 1)
        assert file.attrs[name] != text
    with pytest.raises(InputError, match="it was changed after it was made"):
        PressureTable.read(path)


@pytest.mark.parametrize("name", ["cutoff_q", "cutoff_shift", "q_stokes", "cutoff_absorptance_stokes"])
def test_an_edited_or_missing_variable_is_refused(made, tmp_path, name):
    path = tmp_path / "t.h5"
    made[0].write(path)
    with edited(path) as file:
        file[name][...] = file[name][...] * (1 + 1e-12)
    with pytest.raises(InputError, match="it was changed after it was made"):
        PressureTable.read(path)
    with edited(path) as file:
        del file[name]
    with pytest.raises(InputError, match=r"not a pressure table|must be given together|digest differs"):
        PressureTable.read(path)
