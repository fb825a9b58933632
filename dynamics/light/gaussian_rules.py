"""Gauss rules for a round Gaussian beam over the sectors of a round sail: few points where it is near the middle.

The beam over a sector is exp(−2ρ²/w²), ρ from the beam axis. With the sail level and centred that is e^{−2d²/w²}, d
from the middle of the sail; near rules take this as the weight function of their radial Gauss rule (Gautschi,
Orthogonal Polynomials: Computation and Approximation, §2.2), and the rest, e^{2(d² − ρ²)/w²}, is nearly a polynomial.
The last rule is Gauss–Legendre (Abramowitz & Stegun, §25.4.29) and serves every place and tilt, in panels where the
beam is narrow against the sail. Orders are the least ones that integrate the steepest beams of a rule's range to the
error asked for, radially and in the polar angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.linalg import eigh_tridiagonal

from beamrider.arrays import Floats
from dynamics.light.sectors import Rules

Spans = tuple[tuple[float, float], ...]
Rule = tuple[Floats, Floats]

ERROR = 1e-11  # of the power on the centred sail
RANGES = ((0.25, 0.15), (0.5, 0.2), (1.0, 0.35))  # distance of the beam in its radii, lateral part of k in the body
_MOST = 512
_NARROW = 0.1  # radii of the sail below which a beam calls for panels
_PANEL = 4.0  # radii of the beam that a panel is wide
NARROWEST = 0.01  # radii of the sail: two million points
_LAST = 6.0  # radii of the beam where e^{−2d²/w²} is below 1e-31, and what a rule multiplies it by below 1e16


@lru_cache(maxsize=256)
def beam_rules(spans: Spans, radius: float, beam: float, error: float = ERROR) -> Rules:
    """Rules for sectors between polar angles `spans`, a sail of that radius and a beam of that 1/e² radius.

    `error` is that of a sector's ∫e dA, ∫X e dA/radius and ∫Y e dA/radius, as a share of ∫e dA over the centred sail.
    ValueError where the beam is narrower than `NARROWEST`.
    """
    ratio = beam / radius
    if ratio < NARROWEST:
        raise ValueError(f"beam of {ratio:.3g} radii of the sail: must be at least {NARROWEST:g}")
    pieces: list[list[Floats]] = [[_near(span, ratio, error, *r) for span in spans] for r in RANGES]
    pieces.append([_far(span, ratio, error) for span in spans])
    counts = np.array([[len(points) for points in rule] for rule in pieces])
    ends = counts.cumsum().reshape(counts.shape)
    first = np.concatenate([(ends[:, :1] - counts[:, :1]), ends], axis=1)
    points = np.concatenate([points for rule in pieces for points in rule]) * [radius, radius, 1.0, radius**2]
    reach, slant = np.array([*RANGES, (np.inf, np.inf)]).T
    return Rules(reach * beam, np.ascontiguousarray(slant), first, points, beam)


def _near(span: tuple[float, float], w: float, error: float, reach: float, slant: float) -> Floats:
    """Points (n, 4) over a sector of unit radius for beams within reach · w; w in radii of the sail."""
    target = error * _power(w)
    s, p = 2.0 / w**2, reach * w
    k = np.arange(2)[:, None]

    def along(d: Floats) -> Floats:
        steep = np.array([-2.0, -1.0, 1.0, 2.0])[:, None, None] * s * p * d - s * p * p
        return _flat(d**k * np.exp(steep + s * slant**2 * d**2))

    def around(angle: Floats) -> Floats:
        d = np.linspace(0.25, 1.0, 4)[:, None, None] * min(1.0, 2.0 * w)
        shift = np.linspace(0.0, 2.0 * np.pi, 12)[:, None, None, None]
        tilt = shift[:6, None] * 0.5
        beam = np.exp(2 * s * p * d * np.cos(angle - shift) + s * (slant * d * np.cos(angle - tilt)) ** 2)
        return _flat(_moments(angle, beam * d * np.exp(-s * (d * d + p * p))))

    radial = _weighted(w, along, target / (span[1] - span[0]))
    # Where the beam is narrow so is what the angle is integrated over
    angular = _legendre(*span, around, target if w >= _NARROW else target / (2.0 * w))
    return _product(radial, angular, np.zeros_like)


def _far(span: tuple[float, float], w: float, error: float) -> Floats:
    """Points (n, 4) over a sector of unit radius for beams anywhere."""
    target = error * _power(w)
    s = 2.0 / w**2
    if w < _NARROW:
        radial, angular = _panels(0.0, 1.0, w, error), _panels(*span, w, error)
        return _product((radial[0], radial[1] * radial[0]), angular, lambda d: -s * d * d)
    k = np.arange(1, 3)[:, None]

    def along(d: Floats) -> Floats:
        place = np.linspace(0.0, 1.0 + w, 17)[:, None, None]
        return _flat(d**k * np.exp(-s * (d - place) ** 2))

    def around(angle: Floats) -> Floats:
        d = np.linspace(0.25, 1.0, 4)[:, None, None]
        shift = np.linspace(*span, 9)[:, None, None, None]
        return _flat(_moments(angle, d * np.exp(2 * s * d * d * (np.cos(angle - shift) - 1.0))))

    radial = _legendre(0.0, 1.0, along, target / (span[1] - span[0]))
    angular = _legendre(*span, around, target)
    return _product((radial[0], radial[1] * radial[0]), angular, lambda d: -s * d * d)


def _power(w: float) -> float:
    """∫e dA of the centred, level sail of unit radius (Saleh & Teich, Fundamentals of Photonics, §3.1)."""
    return -0.5 * math.pi * w * w * math.expm1(-2.0 / w**2)


def _flat(values: Floats) -> Floats:
    return values.reshape(-1, values.shape[-1])


def _moments(angle: Floats, beam: Floats) -> Floats:
    """The beam (..., 1, n) times 1, cos and sin of the polar angle (n,): (..., 3, n)."""
    return np.asarray(beam * np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)]))


def _product(radial: Rule, angular: Rule, exponent: Callable[[Floats], Floats]) -> Floats:
    """Points (n, 4) as the kernels want them: X, Y, exponent, weight."""
    (d, wd), (angle, wa) = radial, angular
    columns = [np.outer(d, np.cos(angle)), np.outer(d, np.sin(angle)), exponent(d)[:, None] + 0.0 * angle]
    return np.stack([*columns, np.outer(wd, wa)], axis=-1).reshape(-1, 4)


def _least(rule: Callable[[int], Rule], functions: Callable[[Floats], Floats], target: float) -> Rule:
    """The rule of least order whose integrals of all functions agree with those of the next two to the target."""
    n = 2
    while n < _MOST:
        (x, wx), (y, wy), (z, wz) = rule(n), rule(n + 1), rule(n + 4)
        best = functions(z) @ wz
        if max(np.abs(functions(x) @ wx - best).max(), np.abs(functions(y) @ wy - best).max()) <= target:
            return x, wx
        n += 1 + n // 8
    raise ArithmeticError(f"no quadrature of {_MOST} points reaches {target:g}: the beam is too narrow for the sail")


def _legendre(a: float, b: float, functions: Callable[[Floats], Floats], target: float) -> Rule:
    """Gauss–Legendre rule on [a, b]."""

    def rule(n: int) -> Rule:
        x, w = _nodes(n)
        return a + 0.5 * (b - a) * (x + 1.0), 0.5 * (b - a) * w

    return _least(rule, functions, target)


def _panels(a: float, b: float, w: float, error: float) -> Rule:
    """Gauss–Legendre rule on [a, b] in equal panels, for Gaussians of 1/e² radius w anywhere; b − a in units of 1."""
    count = math.ceil((b - a) / (_PANEL * w))
    step = (b - a) / count
    # Steeper than the beam, which a tilt makes steeper in the published distance from the axis
    places = np.linspace(-0.5, 1.5, 33)[:, None]
    x, weight = _legendre(0.0, 1.0, lambda y: np.exp(-2.5 * (_PANEL * (y - places)) ** 2), 0.1 * error)
    points = a + step * (np.arange(count)[:, None] + x)
    return points.ravel(), np.tile(step * weight, count)


def _weighted(w: float, functions: Callable[[Floats], Floats], target: float) -> Rule:
    """Gauss rule on [0, 1] for the weight function d e^{−2d²/w²}."""
    return _least(lambda n: _gauss(w, n), functions, target)


@lru_cache(maxsize=1024)
def _nodes(n: int) -> Rule:
    return np.polynomial.legendre.leggauss(n)


@lru_cache(maxsize=1024)
def _gauss(w: float, n: int) -> Rule:
    """Nodes and weights (n,) from the recurrence of the orthogonal polynomials (Golub & Welsch, 1969)."""
    diagonal, beside, total = _recurrence(w)
    if n > diagonal.size:
        raise ArithmeticError(f"a radial rule of {n} points: the quadrature error asked for is too small")
    values, vectors = eigh_tridiagonal(diagonal[:n], beside[: n - 1])
    return values, total * vectors[0] ** 2


@lru_cache(maxsize=64)
def _recurrence(w: float, most: int = 40) -> tuple[Floats, Floats, float]:
    """Jacobi matrix of the weight d e^{−2d²/w²} on [0, 1], and its integral, by Stieltjes (Gautschi, §2.2)."""
    x, weight = _nodes(160)
    end = min(1.0, _LAST * w)
    d = 0.5 * end * (x + 1.0)
    mass = 0.5 * end * weight * d * np.exp(-2.0 * (d / w) ** 2)
    total = float(mass.sum())
    rows = [np.sqrt(mass / total)]
    diagonal, beside = np.zeros(most), np.zeros(most - 1)
    for k in range(most):
        following = d * rows[k]
        diagonal[k] = following @ rows[k]
        for row in (*rows, *rows):  # twice: orthogonal to rounding
            following -= (following @ row) * row
        if k < most - 1:
            beside[k] = np.sqrt(following @ following)
            rows.append(following / beside[k])
    return diagonal, beside, total
