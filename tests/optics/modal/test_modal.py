"""The modal solver: exact slabs, conservation, symmetry, reciprocity, convergence."""

import numpy as np
import pytest
import yaml

from optics.cells.schema import Index, Layer, Metagrating, ThinFilm
from optics.modal import stage as modal
from optics.modal.stage import make_table, solve
from optics.table.pressure_table import PressureTable
from optics.thin_film.stage import pressure


def one(cell, u, v, order):
    response = solve(cell, np.array([u]), np.array([v]), order)
    return response.q[0, 0], response.absorptance[0, 0], response.reflected[0, 0], response.transmitted[0, 0]


def changed(cell, **updates):
    return Metagrating.model_validate(cell.model_dump() | updates)


@pytest.mark.parametrize("axis", ["g", "r"])
@pytest.mark.parametrize(("u", "v"), [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (-0.3, 0.0)])
def test_a_full_ridge_is_a_slab_to_rounding(tm, axis, u, v):
    cell = changed(tm, ridges_nm=[[0.0, 1350.0]], electric_axis=axis, index={"n": 2.0, "k": 2e-3})
    along = "s" if (axis == "r") == (v == 0) else "p"
    slab = ThinFilm(
        kind="thin_film",
        name="slab",
        wavelength_nm=1064.0,
        polarisation=along,
        layers=[Layer(thickness_nm=600.0, index=Index(n=2.0, k=2e-3))],
    )
    q, absorptance, _, _ = one(cell, u, v, 7)
    expected, film = pressure(slab, np.array([np.hypot(u, v)]))
    sign = np.sign(u) or 1.0
    turned = expected[0] * [sign, 1, 1] if v == 0 else expected[0][[1, 0, 2]]
    assert np.abs(q - turned).max() < 1e-12
    assert absorptance == pytest.approx(film.absorptance[0], abs=1e-12)


@pytest.mark.parametrize("axis", ["g", "r"])
def test_conical_incidence_on_a_slab_mixes_s_and_p_as_it_must(tm, axis):
    """With |E|² split into s and p of the oblique plane, a slab's q_n is their weighted mean: they don't interfere."""
    cell = changed(tm, ridges_nm=[[0.0, 1350.0]], electric_axis=axis)
    u, v = 0.3, 0.4
    from optics.waves.incidence import electric_vector

    e = electric_vector(u, v, axis)
    share_s = np.dot(e, [-v / 0.5, u / 0.5, 0.0]) ** 2
    q_n = 0.0
    for polarisation, share in (("s", share_s), ("p", 1 - share_s)):
        slab = ThinFilm(
            kind="thin_film",
            name="slab",
            wavelength_nm=1064.0,
            polarisation=polarisation,
            layers=[Layer(thickness_nm=600.0, index=cell.index)],
        )
        q_n += share * pressure(slab, np.array([0.5]))[0][0, 2]
    assert one(cell, u, v, 5)[0][2] == pytest.approx(q_n, abs=1e-12)


def test_lossless_cells_lose_nothing(te, tm):
    u, v = np.array([-0.25, 0.0, 0.123]), np.array([0.0, 0.2])
    for cell in (te, tm):
        lossless = changed(cell, index={"n": 2.0, "k": 0.0})
        assert np.abs(solve(lossless, u, v, 14).absorptance).max() < 1e-12


def test_force_along_the_ridges_is_the_absorbed_momentum(te):
    lossy = changed(te, index={"n": 2.0, "k": 1e-2})
    q, absorptance, _, _ = one(lossy, 0.1, 0.2, 14)
    assert absorptance > 0.05
    assert q[1] == pytest.approx(0.2 * absorptance, abs=1e-15)


def test_v_and_minus_v_mirror(te, tm):
    for cell in (te, tm):
        plus, minus = one(cell, 0.07, 0.15, 12)[0], one(cell, 0.07, -0.15, 12)[0]
        assert np.abs(plus * [1, -1, 1] - minus).max() < 1e-12


def test_the_mirrored_cell_pushes_the_other_way(te, tm):
    for cell in (te, tm):
        mirrored = changed(cell, ridges_nm=[[cell.period_nm - a - w, w] for a, w in reversed(cell.ridges_nm)])
        here, there = one(cell, 0.1, 0.05, 12)[0], one(mirrored, -0.1, 0.05, 12)[0]
        assert np.abs(here * [-1, 1, 1] - there).max() < 1e-11


def test_a_symmetric_cell_does_not_push_sideways(te):
    symmetric = changed(te, ridges_nm=[[500.0, 600.0]])
    assert abs(one(symmetric, 0.0, 0.0, 15)[0][0]) < 1e-13


def test_moving_the_origin_along_g_changes_nothing(tm):
    shifted = changed(tm, ridges_nm=[[a + 137.0, w] for a, w in tm.ridges_nm])
    assert np.abs(one(tm, 0.1, 0.1, 15)[0] - one(shifted, 0.1, 0.1, 15)[0]).max() < 1e-11


@pytest.mark.parametrize("axis", ["g", "r"])
def test_reciprocity(tm, axis):
    """In the plane of incidence, an order sent back is as efficient (Petit, Electromagnetic Theory of Gratings).

    Exact for the specular order; for others the two truncations differ, so the difference falls with their number.
    """
    cell = changed(tm, electric_axis=axis)

    def difference(u, m, order):
        back = one(cell, -(u + m * cell.pitch), 0.0, order)
        return abs(one(cell, u, 0.0, order)[2][order + m] - back[2][order + m])

    assert difference(0.11, 0, 15) < 1e-12
    assert difference(0.11, -1, 60) < min(1e-5, 0.2 * difference(0.11, -1, 15))


@pytest.mark.parametrize("fixture", ["te", "tm"])
def test_convergence_is_algebraic_and_better_than_order_three_halves(fixture, request):
    cell = request.getfixturevalue(fixture)
    u, v = np.linspace(-0.3, 0.3, 7), np.array([0.0, 0.1])
    reference = solve(cell, u, v, 60).q
    errors = [np.median(np.abs(solve(cell, u, v, n).q - reference).max(-1)) for n in (8, 24)]
    assert errors[1] < 4e-4
    assert np.log(errors[0] / errors[1]) / np.log(3) > 1.5


def test_thick_layers_do_not_overflow(tm):
    thick = changed(tm, ridge_height_nm=106400.0, membrane_nm=106400.0, index={"n": 2.0, "k": 0.0})
    q, absorptance, _, _ = one(thick, 0.05, 0.1, 12)
    assert np.all(np.isfinite(q))
    assert abs(absorptance) < 1e-11


@pytest.mark.parametrize("v", [0.0, 0.05])
def test_at_a_rayleigh_cutoff_q_is_the_limit_from_both_sides(tm, v):
    cut = np.sqrt(1 - v * v) - 1 * tm.pitch
    here = one(tm, cut, v, 12)[0]
    assert np.all(np.isfinite(here))
    for side in (-1e-12, 1e-12):
        assert np.abs(one(tm, cut + side, v, 12)[0] - here).max() < 1e-5


def test_a_table_holds_what_it_promises(tm):
    table = make_table(tm, 0.1, 0.1, 2e-3)
    rng = np.random.default_rng(2)
    u, v = rng.uniform(-0.1, 0.1, 20), np.array([0.01, 0.05, 0.09])
    true = solve(tm, u, v, 45).q
    error = np.abs(table.q(u[:, None], v) - true).max(-1)
    assert np.quantile(error, 0.95) < 2e-3
    assert table.error.min() > 0
    assert table.attrs["settings"]["orders"] >= 8


def test_another_wavelength_is_another_scale(te, tmp_path, monkeypatch):
    """Maxwell's equations have no length of their own: all lengths and the wavelength halved change nothing."""
    half = te.model_dump(exclude={"wavelength_nm"}) | {
        "period_nm": te.period_nm / 2,
        "ridges_nm": [[a / 2, b / 2] for a, b in te.ridges_nm],
        "ridge_height_nm": te.ridge_height_nm / 2,
        "membrane_nm": te.membrane_nm / 2,
        "wavelength_nm": 5.0,
    }
    (tmp_path / "half.yaml").write_text(yaml.safe_dump(half), encoding="utf-8")
    out = tmp_path / "half.h5"
    monkeypatch.setattr(
        "sys.argv",
        [
            "modal",
            "--cell",
            str(tmp_path / "half.yaml"),
            "--out",
            str(out),
            "--wavelength-nm",
            f"{te.wavelength_nm / 2}",
            "--u-max",
            "0.05",
            "--v-max",
            "0.05",
            "--tolerance",
            "0.01",
        ],
    )
    modal.main()
    table, whole = PressureTable.read(out), make_table(te, 0.05, 0.05, 0.01)
    assert table.attrs["wavelength_m"] == pytest.approx(te.wavelength_nm * 0.5e-9)
    assert np.abs(table.q_nodes - whole.q_nodes).max() < 1e-12
