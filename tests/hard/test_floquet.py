"""Hard cases of linear stability: ill-conditioned eigenvalues, no light, a response with a kink, extreme spin."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.scene import schema as scene
from dynamics.stability import floquet
from dynamics.stability.linear import LinearModel
from optics.table.normal_incidence import table_response
from tests.synthetic import smooth_tables

FIG6 = scene.read_scene(Path(__file__).parents[2] / "workflow" / "scenes" / "fig6.yaml")
INERTIA = np.diag([0.063, 0.062])


def spun(hertz: float) -> scene.Scene:
    """The scene fig6 at another spin."""
    return FIG6.model_copy(update={"release": FIG6.release.model_copy(update={"spin_Hz": hertz})})


def coupled(coupling: float, split: float) -> LinearModel:
    """No spin: x with pitch as ẍ = −x + κ α, α̈ = −(1 + split) α − κ x; y and roll on their own, far off."""
    jacobian = np.diag([-1.0, -9.0, -16.0 * INERTIA[0, 0], -(1.0 + split) * INERTIA[1, 1]])
    jacobian[0, 3], jacobian[3, 0] = coupling, -coupling * INERTIA[1, 1]
    return LinearModel(jacobian, np.array(0.1), INERTIA, 0.0, False)


def test_defective_sail_is_undecided_though_no_multiplier_leaves_the_circle():
    """One mode short: (s² + 1)² with one eigenvector; motion grows as the number of turns n."""
    model = coupled(0.0, 0.0)
    model.jacobian[0, 3] = 0.5
    found = floquet.assess(model, [])
    assert found.verdict == "undecided"
    assert floquet.doubt(found, []).text({}) == "on the very edge of stability: no better table decides"
    assert found.condition > 1e7
    assert abs(found.max_modulus - 1.0) < 1e-7
    assert np.abs(found.multipliers - np.exp(1j)).min() < 1e-7
    turns = [np.linalg.norm(np.linalg.matrix_power(model.turn_matrix(), n)) for n in (1000, 100000)]
    assert turns[1] / turns[0] == pytest.approx(100.0, rel=0.15)


@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1e-6])
def test_nearly_defective_sail_has_the_margin_of_its_gap(gap: float):
    """ẍ = −x + α/2, α̈ = −(1 + g)² α: exponents i and i (1 + g) with nearly one eigenvector; margin g/2."""
    model = coupled(0.0, gap * (2.0 + gap))
    model.jacobian[0, 3] = 0.5
    found = floquet.assess(model, [])
    assert found.margin == pytest.approx(gap / 2.0, rel=1e-9 / gap)
    assert found.condition == pytest.approx(1.0 / (2.0 * gap), rel=9.0)
    assert found.verdict == "marginally_stable"
    assert found.route_difference < 1e-9 / gap


def meeting(coupling: float, split: float) -> complex:
    """Exponent of the pair of `coupled` that grows, or the distance of the two: s² = −(1 + split/2) ± √δ."""
    discriminant = np.sqrt(complex(split**2 / 4.0 - coupling**2))
    return np.sqrt(-(1.0 + split / 2.0) + discriminant), np.sqrt(-(1.0 + split / 2.0) - discriminant)


@pytest.mark.parametrize("excess", [-1e-2, -1e-4, -1e-6, 1e-5, 1e-4, 1e-2])
def test_margin_through_a_collision_on_the_circle(excess: float):
    """Two pairs meet where the coupling is half the split of the squares, and leave the axis beyond (closed form)."""
    split = 0.2
    coupling = split / 2.0 * (1.0 + excess)
    found = floquet.assess(coupled(coupling, split), [])
    one, other = meeting(coupling, split)
    if excess < 0:
        assert found.margin == pytest.approx(abs(abs(one.imag) - abs(other.imag)) / 2.0, rel=1e-6)
        assert found.verdict == "marginally_stable"
    else:
        growth = abs(one.real)
        assert found.verdict == "unstable"
        assert found.margin == pytest.approx(-growth, rel=1e-6)
    # δ changes sign smoothly: the square of the margin has the same slope on both sides
    slope = np.sign(found.margin) * found.margin**2 / excess
    assert slope == pytest.approx(-(split**2) / 8.0 / (1.0 + split / 2.0), rel=0.03)


def test_margin_through_a_collision_of_a_spinning_sail():
    """A sail held with unequal strengths a, b is thrown off by spins between √a and √b (the rotating saddle).

    s⁴ + s² (a + b + 2Ω²) + (a − Ω²)(b − Ω²) = 0; the pair ±s meets at 0 at either end.
    """
    a, b = 4.0, 6.0
    jacobian = np.diag([-a, -b, -30.0 * 0.063, -40.0 * 0.062])
    for square in (3.9999, 4.0001, 5.0, 5.9999, 6.0001):
        spin = np.sqrt(square)
        found = floquet.assess(LinearModel(jacobian, np.array(0.1), INERTIA, spin, False), [])
        middle = (a + b + 2.0 * square) / 2.0
        root = np.sqrt(complex(-middle + np.sqrt(middle**2 - (a - square) * (b - square))))
        assert found.verdict == ("unstable" if a < square < b else "marginally_stable")
        assert found.margin == pytest.approx(-root.real if a < square < b else root.imag, rel=1e-6)
        assert found.route_difference < 1e-7  # the root of rounding, where ±s meet


def test_darkness_is_refused_in_one_line():
    dark = FIG6.model_copy(update={"beam": FIG6.beam.model_copy(update={"intensity_W_m2": 0.0})})
    with pytest.raises(InputError) as refusal:
        floquet.analyse(dark, smooth_tables())
    assert str(refusal.value) == "fig6.yaml: beam.intensity_W_m2 = 0: must be above 0 for a stability analysis"


def test_kink_at_the_equilibrium_is_an_error_of_the_slope():
    """A table whose q_n turns a corner at u = 0: either slope may hold, and the verdict is open where they disagree."""
    tables = smooth_tables()
    tm = tables["mark1e_tm"]
    bend = np.abs(tm.u)[None, :, None] * np.array([0.0, 0.0, 1.0])[:, None, None]
    for size, verdict in ((0.01, "marginally_stable"), (20.0, "undecided")):
        bent = replace(tm, q_nodes=tm.q_nodes + size * bend)
        response = table_response(bent)
        assert response.gradient_error[2, 0] == pytest.approx(size, rel=2e-2)
        assert response.gradient[2, 0] == pytest.approx(table_response(tm).gradient[2, 0], abs=1e-9)
        found = floquet.analyse(FIG6, {**tables, "mark1e_tm": bent})
        assert found.verdict == verdict
        assert found.margin_range[0] < found.margin < found.margin_range[1]


@pytest.mark.parametrize("hertz", [0.25, 1e4, 1e6])
def test_slow_and_fast_spin(hertz: float):
    """Both routes agree; slow spin is no spin, and the determinant of a fast turn is 1, as nothing damps."""
    found = floquet.analyse(spun(hertz), smooth_tables())
    assert found.route_difference < 1e-9
    if hertz < 20.0:
        still = floquet.analyse(spun(0.0), smooth_tables())
        assert found.verdict == still.verdict == "unstable"
        assert found.margin == pytest.approx(still.margin, rel=0.03)
    else:
        assert found.verdict == "marginally_stable"
        assert abs(np.prod(found.multipliers) - 1.0) < 1e-6


def test_spin_too_slow_for_multipliers_is_refused():
    with pytest.raises(InputError, match=r"release.spin_Hz = 0.01: must be 0, or fast enough .* at least 0.06"):
        floquet.analyse(spun(0.01), smooth_tables())


def test_very_fast_spin_averages_the_sail():
    """Beyond all its own rates a sail is held by the mean of its two strengths: angle √(−(F_xx + F_yy)/2) T a turn."""
    found = floquet.analyse(spun(1e5), smooth_tables())
    held = np.sqrt(-(found.model.jacobian[0, 0] + found.model.jacobian[1, 1]) / 2.0) * found.model.period
    angles = np.sort(np.abs(np.angle(found.multipliers)))
    assert angles[-4:] == pytest.approx(held, rel=1e-3)
