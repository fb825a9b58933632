"""The beam over a sector, integrated to 1e-10 wherever the beam falls and however the sail is tilted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import dblquad

from dynamics.light import sectors as kernel
from dynamics.light import spots
from dynamics.light.beam import Beam
from dynamics.light.gaussian_rules import beam_rules
from dynamics.light.moments import beam_moments, round_moments
from dynamics.light.rules import TooSteep, profile_rules
from dynamics.sail.attitude import rotation_from_angles
from tests.dynamics.light.test_profiles import PARTS, TILTED, measured
from tests.dynamics.light.test_profiles import beam as shaped

RADIUS = 0.5
SPANS = tuple((np.radians(a), np.radians(b)) for a, b in ((30, 150), (150, 210), (210, 330), (330, 390)))
CENTRE = np.array([0.02, -0.03])  # of mass
SCALE = np.array([1.0, RADIUS, RADIUS])


def power(beam: float) -> float:
    """∫e dA over the centred, level sail."""
    return 0.5 * np.pi * beam**2 * -np.expm1(-2.0 * (RADIUS / beam) ** 2)


def sector_integrals(spans: Any, beam: float, turn: np.ndarray, place: np.ndarray, axial: bool, rule: int = -1) -> Any:
    """(moments (n_s, 3), rule used) by the kernel, about the centre of mass at `place`."""
    rules, c = beam_rules(spans, RADIUS, beam), np.empty(6)
    chosen = kernel.exponent(rules, CENTRE, axial, turn, *place, c)
    chosen = chosen if rule < 0 else rule
    return np.array([kernel.gaussian_moments(rules, CENTRE, chosen, s, c) for s in range(len(spans))]), chosen


def reference(span: Any, beam: float, turn: np.ndarray, place: np.ndarray, axial: bool, n: int = 240) -> np.ndarray:
    """The same integrals from Gauss–Legendre points without thrift."""
    x, w = np.polynomial.legendre.leggauss(n)
    d, angle = 0.5 * RADIUS * (x + 1.0), span[0] + 0.5 * (span[1] - span[0]) * (x + 1.0)
    weight = 0.25 * RADIUS * (span[1] - span[0]) * np.outer(d * w, w)
    b = np.stack([np.outer(d, np.cos(angle)) - CENTRE[0], np.outer(d, np.sin(angle)) - CENTRE[1]])
    at = np.einsum("ij,jrp->irp", turn[:, :2], b)
    square = (at[0] + place[0]) ** 2 + (at[1] + place[1]) ** 2 + (at[2] ** 2 if axial else 0.0)
    e = weight * np.exp(-2.0 * square / beam**2)
    return np.array([e.sum(), (e * b[0]).sum(), (e * b[1]).sum()])


def attitude(tilt: float, azimuth: float, yaw: float) -> np.ndarray:
    return rotation_from_angles(0, 0, azimuth) @ rotation_from_angles(0, tilt, 0) @ rotation_from_angles(0, 0, yaw)


@pytest.mark.parametrize("beam", [0.05, 0.2, 0.4, 1.0, 30.0])
def test_every_rule_holds_1e_10_at_the_edge_of_its_range(beam: float):
    rules = beam_rules(SPANS, RADIUS, beam)
    random = np.random.default_rng(1)
    for rule, (reach, slant) in enumerate(zip(rules.reach, rules.slant, strict=True)):
        for _ in range(6):
            phase, azimuth, yaw = random.uniform(0.0, 2.0 * np.pi, 3)
            turn = attitude(np.arcsin(min(slant, 0.999999)), azimuth, yaw)
            middle = min(reach, RADIUS + beam) * np.array([np.cos(phase), np.sin(phase)])
            place = middle + turn[:2, :2] @ CENTRE
            for axial in (False, True):
                got, _ = sector_integrals(SPANS, beam, turn, place, axial, rule)
                want = np.array([reference(span, beam, turn, place, axial) for span in SPANS])
                assert np.abs((got - want) / SCALE).max() < 1e-10 * power(beam)


def test_a_sector_agrees_with_adaptive_quadrature():
    turn, place, beam = attitude(0.3, 0.4, 1.1), np.array([0.2, -0.1]), 0.4
    got, _ = sector_integrals(SPANS, beam, turn, place, False)

    def integrand(d: float, angle: float, k: int) -> float:
        b = np.array([d * np.cos(angle), d * np.sin(angle)]) - CENTRE
        return d * np.exp(-2.0 * ((place + turn[:2, :2] @ b) ** 2).sum() / beam**2) * (1.0, *b)[k]

    for k in range(3):
        want = dblquad(integrand, *SPANS[1], 0.0, RADIUS, (k,), epsabs=1e-14, epsrel=1e-13)[0]
        assert abs(got[1, k] - want) / SCALE[k] < 1e-11 * power(beam)


@pytest.mark.parametrize("beam", [0.03, 0.4, 3.0])
def test_the_sectors_add_up_to_the_disc(beam: float):
    """∫e dA over the centred, level disc is π w²/2 (1 − e^{−2R²/w²})."""
    got, _ = sector_integrals(SPANS, beam, np.eye(3), CENTRE, False)
    assert got[:, 0].sum() == pytest.approx(power(beam), rel=1e-11)


def test_one_sector_all_around_is_the_disc_too():
    whole = ((0.3, 0.3 + 2.0 * np.pi),)
    place = np.array([0.11, -0.05]) + CENTRE
    got, _ = sector_integrals(whole, 0.4, np.eye(3), place, False)
    assert np.allclose(got[0] / SCALE, reference(whole[0], 0.4, np.eye(3), place, False) / SCALE, atol=1e-12)


def test_a_beam_near_the_middle_needs_fewer_points():
    rules = beam_rules(SPANS, RADIUS, 0.4)
    counts = np.diff(rules.first[:, [0, -1]], axis=1)[:, 0]
    assert counts[0] < counts[1] < counts[2]
    assert 2 * counts[0] < counts[-1]
    chosen = [sector_integrals(SPANS, 0.4, np.eye(3), CENTRE + [d, 0.0], False)[1] for d in (0.05, 0.15, 0.3, 0.9)]
    assert chosen == [0, 1, 2, 3]


# Any other beam

OTHERS: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({"kind": "gaussian"}, TILTED),
    ({"kind": "super_gaussian", "order": 10}, {}),
    ({"kind": "super_gaussian", "order": 6}, TILTED),
    ({"kind": "flat_top", "order": 30}, {}),
    ({"kind": "ring", "charge": 3}, {}),
    ({"kind": "sum", "parts": PARTS}, {}),
    ({"kind": "gaussian"}, {"radius_m": 0.05, "radius_y_m": 0.06}),
]


def brute(which: Beam, turn: np.ndarray, place: np.ndarray, n: int = 300) -> np.ndarray:
    """Integrals (n_s, 3) about the centre of mass, from Gauss–Legendre points without thrift."""
    x, w = np.polynomial.legendre.leggauss(n)
    out = []
    for span in SPANS:
        d, angle = 0.5 * RADIUS * (x + 1.0), span[0] + 0.5 * (span[1] - span[0]) * (x + 1.0)
        weight = 0.25 * RADIUS * (span[1] - span[0]) * np.outer(d * w, w)
        b = np.stack([np.outer(d, np.cos(angle)) - CENTRE[0], np.outer(d, np.sin(angle)) - CENTRE[1]])
        u, v = np.einsum("ij,jrp->irp", turn[:2, :2], b) + place[:, None, None]
        e = weight * spots.share(which.spots, u, v)
        out.append([e.sum(), (e * b[0]).sum(), (e * b[1]).sum()])
    return np.array(out)


def worst(which: Beam, error: float) -> float:
    """Largest error of the rules, as a share of the largest power that the sail gets."""
    rules = profile_rules(which.spots, SPANS, RADIUS, error)
    profile, random = spots.pack(which.spots, 1.0), np.random.default_rng(3)
    off, most = 0.0, 0.0
    for distance, tilt in ((0.0, 0.0), (0.05, 0.05), (0.1, 0.25), (0.3, 0.3), (0.5, 0.1), (0.7, 1.0)):
        phase, azimuth, yaw = random.uniform(0.0, 2.0 * np.pi, 3)
        turn = np.ascontiguousarray(attitude(tilt, azimuth, yaw))
        place = distance * np.array([np.cos(phase), np.sin(phase)]) + turn[:2, :2] @ CENTRE
        found, want = np.empty((len(SPANS), 3)), brute(which, turn, place)
        kernel.moments(profile, rules, CENTRE, False, turn, place[0], place[1], found)
        off, most = max(off, np.abs((found - want) / SCALE).max()), max(most, want[:, 0].sum())
    return off / most


@pytest.mark.parametrize(("profile", "keys"), OTHERS)
def test_every_profile_is_integrated_to_1e_10(profile: dict[str, Any], keys: dict[str, Any]):
    assert worst(shaped(profile, **keys), 1e-11) < 1e-10


def test_a_map_is_integrated_to_1e_6(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    which = Beam.model_validate({"profile": {"kind": "map", "file": measured(tmp_path)}})
    assert worst(which, 1e-7) < 1e-6


def test_a_beam_too_steep_for_quadrature_is_refused():
    with pytest.raises(TooSteep, match=r"changes within 0.000\d+ m"):
        profile_rules(shaped({"kind": "gaussian"}, radius_m=1.0, radius_y_m=4e-4).spots, SPANS, RADIUS, 1e-11)


def test_the_rules_of_other_beams_agree_with_those_of_the_gaussian():
    oval = shaped({"kind": "gaussian"}, radius_y_m=0.4 * (1 + 1e-13))
    rules, found = profile_rules(oval.spots, SPANS, RADIUS, 1e-11), np.empty((len(SPANS), 3))
    turn, place = np.ascontiguousarray(attitude(0.2, 0.4, 1.1)), np.array([0.2, -0.1])
    kernel.moments(spots.pack(oval.spots, 1.0), rules, CENTRE, False, turn, *place, found)
    want, _ = sector_integrals(SPANS, 0.4, turn, place, False)
    assert np.abs((found - want) / SCALE).max() < 1e-11 * power(0.4)


# Moments for stability


@pytest.mark.parametrize(("profile", "keys"), OTHERS[:-1])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_moments_and_those_of_slopes_are_the_integrals_and_their_derivatives(
    profile: dict[str, Any], keys: dict[str, Any], yaw: float
):
    """∫∂e/∂x dA is how ∫e dA changes as the sail moves against the beam."""
    which, turn = shaped(profile, **keys), attitude(0.0, 0.0, yaw)
    found, h = beam_moments(which.spots, SPANS, RADIUS, np.array(yaw)), 1e-3

    def integrals(x: float, y: float) -> np.ndarray:
        at = turn[:2, :2] @ (np.array([x, y]) + CENTRE)
        about = brute(which, turn, at)
        return about + about[:, :1] * np.array([0.0, *CENTRE])

    want, most = integrals(0.0, 0.0), integrals(0.0, 0.0)[:, 0].sum()
    assert np.abs(found.zeroth - want[:, 0]).max() < 1e-9 * most
    assert np.abs(found.first - want[:, 1:]).max() < 1e-9 * most
    for j, (dx, dy) in enumerate(((h, 0.0), (0.0, h))):
        pairs = [integrals(k * dx, k * dy) - integrals(-k * dx, -k * dy) for k in (1, 2, 3)]
        slope = (45.0 * pairs[0] - 9.0 * pairs[1] + pairs[2]) / (60.0 * h)
        assert np.abs(found.slope[:, j] - slope[:, 0]).max() < 1e-7 * most / 0.1
        assert np.abs(found.slopes[:, :, j] - slope[:, 1:]).max() < 1e-7 * most / 0.1


def test_moments_without_closed_forms_agree_with_the_gaussians():
    start, stop = np.array(SPANS).T
    exact = round_moments(shaped({"kind": "gaussian"}).spots[0].profile, start, stop, RADIUS, 0.4)
    limits: list[dict[str, Any]] = [
        {"kind": "super_gaussian", "order": 2},
        {"kind": "flat_top", "order": 0},
        {"kind": "ring", "charge": 0},
    ]
    for profile in limits:
        found = round_moments(shaped(profile).spots[0].profile, start, stop, RADIUS, 0.4)
        for one, other in zip(vars(found).values(), vars(exact).values(), strict=True):
            assert np.allclose(one, other, rtol=1e-13, atol=1e-16)
