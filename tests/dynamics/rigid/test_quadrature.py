"""The beam over a sector, integrated to 1e-10 wherever the beam falls and however the sail is tilted."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import dblquad

from dynamics.rigid import equations as kernel
from dynamics.rigid.quadrature import beam_rules
from dynamics.sail.attitude import rotation_from_angles

RADIUS = 0.5
SPANS = tuple((np.radians(a), np.radians(b)) for a, b in ((30, 150), (150, 210), (210, 330), (330, 390)))
CENTRE = np.array([0.02, -0.03])  # of mass
SCALE = np.array([1.0, RADIUS, RADIUS])


def power(beam: float) -> float:
    """∫e dA over the centred, level sail."""
    return 0.5 * np.pi * beam**2 * -np.expm1(-2.0 * (RADIUS / beam) ** 2)


def sector_integrals(spans: Any, beam: float, turn: np.ndarray, place: np.ndarray, axial: bool, rule: int = -1) -> Any:
    """(moments (n_s, 3), rule used) by the kernel, about the centre of mass at `place`."""
    rules, none = beam_rules(spans, RADIUS, beam), np.zeros(len(spans))
    sail = kernel.RigidSail(
        np.zeros((len(spans), 2)), rules, CENTRE, none.astype(int), none, none, np.eye(3), np.eye(3)
    )
    light = kernel.Light(1.0, beam, 0.0, 0.0, 1.0, False, axial, False, 0.0, 0.0)
    c = np.empty(6)
    chosen = kernel.exponent(sail, light, turn, *place, c)
    chosen = chosen if rule < 0 else rule
    return np.array([kernel.moments(sail, chosen, s, c) for s in range(len(spans))]), chosen


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
