"""Stacks of lamellar layers: joined layers, any polarisation, and derivatives against differences."""

import numpy as np
import pytest

from beamrider.io.files import InputError
from optics.cells.schema import Index, LamellarStack, Layer, ThinFilm
from optics.modal.derivatives import derivatives
from optics.modal.lamellar import efficiencies, prepare
from optics.modal.response import solve
from optics.thin_film.stage import pressure
from optics.waves.incidence import electric_vector, polarisation_basis, stokes, wave_vector

U, V = np.array([-0.2, 0.0, 0.31]), np.array([0.0, 0.1, 0.27])
GRATING = {
    "thickness_nm": 300.0,
    "index": {"n": 1.0},
    "ridges": [
        {"start_nm": 100.0, "width_nm": 400.0, "index": {"n": 2.0, "k": 0.01}},
        {"start_nm": 700.0, "width_nm": 200.0, "index": {"n": 3.0}},
    ],
}
FILM = {"thickness_nm": 150.0, "index": {"n": 1.7}}
SECOND = {
    "thickness_nm": 250.0,
    "index": {"n": 2.2},
    "ridges": [{"start_nm": 50.0, "width_nm": 700.0, "index": {"n": 1.2}}],
}


def stack(*layers, axis="g", **surroundings):
    return LamellarStack.model_validate(
        {
            "kind": "lamellar",
            "name": "stack",
            "wavelength_nm": 1064.0,
            "electric_axis": axis,
            "period_nm": 1400.0,
            "layers": list(layers),
            "surroundings": surroundings or {"front": 1.0, "back": 1.5},
        }
    )


def cut(layer, *thicknesses):
    return [{**layer, "thickness_nm": thickness} for thickness in thicknesses]


@pytest.mark.parametrize("axis", ["g", "r"])
def test_a_layer_cut_into_slices_is_the_same_layer(axis):
    whole = solve(stack(GRATING, FILM, SECOND, FILM, axis=axis), U, V, 10)
    slices = [*cut(GRATING, 100.0, 0.0, 200.0), FILM, *cut(SECOND, 50.0, 200.0), *cut(FILM, 75.0, 75.0)]
    sliced = solve(stack(*slices, axis=axis), U, V, 10)
    assert np.abs(whole.q_stokes - sliced.q_stokes).max() < 1e-12
    assert np.abs(whole.absorptance_stokes - sliced.absorptance_stokes).max() < 1e-12


def test_an_order_that_runs_along_a_homogeneous_layer_is_like_its_neighbours():
    """At u = 0 a period of one wavelength sends orders with β² = 0 through a gap of vacuum; v > 0 makes them decay."""
    cell = stack(GRATING, {"thickness_nm": 1500.0, "index": {"n": 1.0}}, SECOND)
    cell = cell.model_copy(update={"wavelength_nm": 1400.0})
    step, v = 1e-5, np.array([0.11, 0.3])
    found = solve(cell, step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), v, 10).q_stokes
    between = (4 * (found[1] + found[3]) - found[0] - found[4]) / 6
    assert np.abs(found[2] - between).max() < 1e-11
    for k, y in enumerate(v):
        q = derivatives(cell, 0.0, float(y), 10, ("u",))
        assert q.q == pytest.approx(solve(cell, np.zeros(1), v, 10).q[0, k], abs=1e-11)
        own = solve(cell, step * np.array([-2.0, -1.0, 1.0, 2.0]), v, 10).q[:, k]
        assert q.q_dot[0] == pytest.approx((8 * (own[2] - own[1]) + own[0] - own[3]) / (12 * step), abs=1e-8)


def test_a_period_taken_twice_has_the_same_response():
    """Twice the period with twice the ridges: the orders in between stay dark."""
    doubled = stack(GRATING, FILM, SECOND).model_dump()
    doubled["period_nm"] *= 2
    for layer in doubled["layers"]:
        layer["ridges"] += [{**ridge, "start_nm": ridge["start_nm"] + 1400.0} for ridge in layer["ridges"]]
    one, two = solve(stack(GRATING, FILM, SECOND), U, V, 8), solve(LamellarStack.model_validate(doubled), U, V, 16)
    assert np.abs(one.q_stokes - two.q_stokes).max() < 1e-11
    assert two.transmitted[..., 1::2].max() < 1e-12


def test_a_stack_that_absorbs_nothing_conserves_energy_in_every_polarisation():
    lossless = {**GRATING, "ridges": [{**ridge, "index": {"n": 2.5}} for ridge in GRATING["ridges"]]}
    response = solve(stack(lossless, FILM, SECOND), U, V, 12)
    assert np.abs(response.absorptance_stokes).max() < 1e-12


@pytest.mark.parametrize("axis", ["g", "r"])
def test_the_own_polarisation_is_a_point_of_the_stokes_response(axis):
    response = solve(stack(GRATING, SECOND, axis=axis), U, V, 10)
    field = electric_vector(U[:, None], V, axis)
    s = stokes(U[:, None], V, field)
    assert np.abs(np.einsum("uvs,uvsc->uvc", s, response.q_stokes) - response.q).max() < 1e-15
    # TE and TM cells of one structure differ in the name of the axis alone
    other = solve(stack(GRATING, SECOND, axis="r" if axis == "g" else "g"), U, V, 10)
    assert np.array_equal(response.q_stokes, other.q_stokes)


def test_stokes_response_of_a_film_is_that_of_its_s_and_p():
    """Total power holds no interference of s and p, whichever basis the Stokes components refer to."""
    u, v = 0.3, 0.4
    n_film = Index(n=2.0, k=0.02)
    film = stack({"thickness_nm": 210.0, "index": n_film.model_dump()}, front=1.0, back=1.0)
    response = solve(film, np.array([u]), np.array([v]), 2).q_stokes[0, 0, :, 2]
    s_hat = np.array([-v, u, 0.0]) / 0.5
    e1, e2 = polarisation_basis(u, v)
    q_n = [
        pressure(
            ThinFilm(
                kind="thin_film",
                name="film",
                wavelength_nm=1064.0,
                polarisation=name,
                layers=[Layer(thickness_nm=210.0, index=n_film)],
            ),
            np.array([0.5]),
        )[0][0, 2]
        for name in ("s", "p")
    ]
    for jones in ([1, 0], [0, 1], [1, 1], [1, -1], [1, 1j], [0.6, 0.8j]):
        field = jones[0] * e1 + jones[1] * e2
        share = np.abs(s_hat @ field) ** 2 / np.sum(np.abs(jones) ** 2)
        expected = share * q_n[0] + (1 - share) * q_n[1]
        assert stokes(u, v, field) @ response == pytest.approx(expected, abs=1e-13)


def test_many_v_of_few_u_are_solved():
    one, all_v = np.array([0.1]), np.linspace(0.0, 0.3, 600)
    many = solve(stack(GRATING), np.array([0.0, 0.1]), all_v, 2).q
    assert np.array_equal(many[1, [0, -1]], solve(stack(GRATING), one, all_v[[0, -1]], 2).q[0])


def test_mirrored_light_has_mirrored_stokes_components():
    """v → −v is a mirror: q_g and q_n are even for (1, s₁) and odd for (s₂, s₃), q_r the other way round."""
    cell = stack(GRATING, SECOND)
    here, there = solve(cell, U, V, 10).q_stokes, solve(cell, U, -V, 10).q_stokes
    sign = np.array([1, 1, -1, -1])[:, None] * np.array([1, -1, 1])
    assert np.abs(there - sign * here).max() < 1e-12


LENGTHS = (
    "layers[0].thickness_nm",
    "layers[1].thickness_nm",
    "layers[0].ridges[0].start_nm",
    "layers[0].ridges[1].width_nm",
    "layers[2].ridges[0].width_nm",
    "period_nm",
)


def moved(cell, name, step):
    """The cell with one field moved."""
    data = cell.model_dump()
    *path, last = name.replace("[", ".").replace("]", "").split(".")
    target = data
    for key in path:
        target = target[int(key) if key.isdigit() else key]
    target[int(last) if last.isdigit() else last] += step
    return type(cell).model_validate(data)


def difference(value, step):
    """Central difference with one Richardson step."""
    d = [(value(h) - value(-h)) / (2 * h) for h in (step, step / 2)]
    return (4 * d[1] - d[0]) / 3


@pytest.mark.parametrize(("u", "v"), [(0.0, 0.0), (0.05, 0.0), (-0.13, 0.21)])
@pytest.mark.parametrize("axis", ["g", "r"])
def test_derivatives_are_those_of_the_solution(axis, u, v):
    cell = stack(GRATING, FILM, SECOND, axis=axis)
    found = derivatives(cell, u, v, 9, ("u", "v", *LENGTHS))

    def q(c, x, y):
        response = solve(c, np.array([x]), np.array([y]), 9)
        return np.append(response.q[0, 0], response.absorptance[0, 0])

    values = np.append(found.q, found.absorptance)
    assert np.abs(values - q(cell, u, v)).max() < 1e-12
    dots = np.concatenate([found.q_dot, found.absorptance_dot[:, None]], axis=1)
    expected = [difference(lambda h: q(cell, u + h, v), 2e-4), difference(lambda h: q(cell, u, v + h), 2e-4)]
    expected += [difference(lambda h, n=name: q(moved(cell, n, h), u, v), 0.05) for name in LENGTHS]
    for dot, other in zip(dots, expected, strict=True):
        assert np.abs(dot - other).max() < 1e-7 * max(1.0, np.abs(other).max())


@pytest.mark.parametrize("fixture", ["te", "tm"])
def test_derivatives_of_a_metagrating_go_by_its_own_field_names(fixture, request):
    cell = request.getfixturevalue(fixture)
    names = ("ridge_height_nm", "membrane_nm", "ridges_nm[0][1]", "ridges_nm[1][0]")
    found = derivatives(cell, 0.02, 0.01, 10, names)
    for dot, name in zip(found.q_dot, names, strict=True):
        expected = difference(lambda h, n=name: solve(moved(cell, n, h), [0.02], [0.01], 10).q[0, 0], 0.05)
        assert np.abs(dot - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("axis", ["g", "r"])
def test_an_order_that_runs_along_an_inner_layer_is_no_special_case(axis):
    """k_z = 0 between two gratings is no cut-off: q is smooth there, and so are its slopes."""
    film = {"thickness_nm": 150.0, "index": {"n": 2.0}}
    cell = stack(GRATING, film, SECOND, axis=axis, front=1.5, back=1.5).model_copy(update={"period_nm": 1064.0})

    def q(u):
        return solve(cell, np.array([u]), np.zeros(1), 8).q[0, 0]

    assert np.abs(q(0.0) - (q(1e-6) + q(-1e-6)) / 2).max() < 1e-7
    assert np.abs(derivatives(cell, 0.0, 0.0, 8).q_dot[0] - difference(q, 4e-4)).max() < 2e-6


def test_an_unknown_parameter_is_refused_by_name(te):
    with pytest.raises(InputError, match=r"mark1e_te: no derivative by 'ridges_nm\[2\]\[0\]'"):
        derivatives(te, 0.0, 0.0, 5, ["ridges_nm[2][0]"])


def test_overlapping_ridges_are_refused():
    with pytest.raises(ValueError, match=r"layers\[0\].ridges\[1\].start_nm = 700: must be at least 800"):
        stack({**GRATING, "ridges": [{**GRATING["ridges"][0], "width_nm": 700.0}, GRATING["ridges"][1]]})


@pytest.mark.parametrize(("u", "v"), [(0.1, 0.05), (-0.3, 0.2), (0.0, 0.25)])
def test_orders_agree_with_meent(u, v):
    """An independent solver with the same factorisation rules and as many orders: equal to rounding."""
    import meent

    order, pixel = 9, 50.0
    cell = stack(GRATING, FILM, SECOND, front=1.0, back=1.5)
    places = (np.arange(28) + 0.5) * pixel
    rows = []
    for layer in cell.layers:
        row = np.full(places.size, complex(layer.index.n, -layer.index.k))  # time factor exp(+iωt)
        for ridge in layer.ridges:
            inside = (places > ridge.start_nm) & (places < ridge.start_nm + ridge.width_nm)
            row[inside] = complex(ridge.index.n, -ridge.index.k)
        rows.append([row])
    theta, phi = np.arcsin(np.hypot(u, v)), np.arctan2(v, u)
    theirs = meent.call_mee(
        backend=0,
        pol=1,
        n_top=1,
        n_bot=1.5,
        theta=theta,
        phi=phi,
        fto=[order, 0],
        wavelength=1064.0,
        period=[1400.0],
        ucell=np.array(rows),
        thickness=[layer.thickness_nm for layer in cell.layers],
        fourier_type=1,
        enhanced_dfs=True,
    ).conv_solve()
    s_hat = np.array([-np.sin(phi), np.cos(phi), 0.0])
    for field, result in ((s_hat, theirs.res_te_inc), (np.cross(s_hat, wave_vector(u, v)), theirs.res_tm_inc)):
        ours = efficiencies(prepare(cell), np.array([u]), np.array([v]), order)
        for mine, their in zip(ours, (np.squeeze(result.de_ri), np.squeeze(result.de_ti)), strict=True):
            runs = their > 0
            assert np.abs(stokes(u, v, field) @ mine[0] - their)[runs].max() < 1e-12
            assert runs.sum() >= 2
