"""The light on the sectors of a flat sail, for compiled kernels: ∫e dA and its first moments, e the beam's intensity.

Lengths are in any unit that profile, rules and places share. Rules of a round Gaussian beam hold it as their weight
(`dynamics.light.gaussian_rules`); those of all others are for the profile as it is (`dynamics.light.rules`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from dynamics.light.compiled import Profile, shine

_DARK = -746.0  # below, exp is 0


class Rules(NamedTuple):
    """Quadrature rules for beams that fall at different distances from the middle of the sail.

    Rule k serves distances up to reach[k] and tilts up to slant[k], as the lateral component of k in the body; the last
    one serves all. Its points of sector s are first[k, s] … first[k, s + 1]. points (n, 4): X and Y from the middle,
    exponent, weight. radius: of the round Gaussian beam that they are for, so that
    ∫ exp(−2ρ²/w²) f dA = Σ weight exp(exponent + 2(d² − ρ²)/w²) f with d² = X² + Y²; 0 for all others: ∫ f dA =
    Σ weight f.
    """

    reach: Floats
    slant: Floats
    first: NDArray[np.int64]
    points: Floats
    radius: float


@numba.njit(cache=True, error_model="numpy")
def _choose(rules: Rules, square: float, slant: float) -> int:
    """The rule that serves a beam at that squared distance and squared tilt."""
    rule = 0
    while square > rules.reach[rule] ** 2 or slant > rules.slant[rule] ** 2:
        rule += 1
    return rule


@numba.njit(cache=True, error_model="numpy")
def exponent(rules: Rules, centre: Floats, axial: bool, turn: Floats, x: float, y: float, out: Floats) -> int:
    """Write the coefficients (6,) of the beam's exponent over the sail; returns the quadrature rule that serves it.

    With the middle of the sail at lateral position p, its point d at p + A d, A the lateral part of the rotation, and
    κ the lateral part of k in the body: ρ² = p² + 2 p·A d + d² − (κ·d)², as AᵀA = 1 − κκᵀ. The coefficients are those
    of 2(d² − ρ²)/w² = c₀ + c₁X + c₂Y + c₃(c₄X + c₅Y)².
    """
    kx, ky = turn[2, 0], turn[2, 1]
    cx, cy = centre[0], centre[1]
    px = x - turn[0, 0] * cx - turn[0, 1] * cy
    py = y - turn[1, 0] * cx - turn[1, 1] * cy
    s = 2.0 / (rules.radius * rules.radius)
    square = px * px + py * py
    out[0] = -s * square
    out[1] = -2.0 * s * (turn[0, 0] * px + turn[1, 0] * py)
    out[2] = -2.0 * s * (turn[0, 1] * px + turn[1, 1] * py)
    out[3], out[4], out[5] = s, kx, ky
    if axial:  # ρ² + (κ·(d − centre))²
        height = kx * cx + ky * cy
        out[0] -= s * height * height
        out[1] += 2.0 * s * height * kx
        out[2] += 2.0 * s * height * ky
        out[3] = 0.0
    return _choose(rules, square, kx * kx + ky * ky)


@numba.njit(cache=True, error_model="numpy")
def gaussian_moments(rules: Rules, centre: Floats, rule: int, s: int, c: Floats) -> tuple[float, float, float]:
    """(∫e dA, ∫X e dA, ∫Y e dA) over sector s, e = exp(−2ρ²/w²), X, Y from the centre of mass; c (n,) of `exponent`."""
    total, first_x, first_y = 0.0, 0.0, 0.0
    points = rules.points
    for p in range(rules.first[rule, s], rules.first[rule, s + 1]):
        X, Y = points[p, 0], points[p, 1]
        tilt = c[4] * X + c[5] * Y
        dark = points[p, 2] + c[0] + c[1] * X + c[2] * Y + c[3] * tilt * tilt
        if dark > _DARK:
            e = points[p, 3] * math.exp(dark)
            total += e
            first_x += e * X
            first_y += e * Y
    return total, first_x - total * centre[0], first_y - total * centre[1]


@numba.njit(cache=True, error_model="numpy")
def _profile_moments(
    profile: Profile, rules: Rules, centre: Floats, turn: Floats, x: float, y: float, rule: int, out: Floats
) -> None:
    """The same of all sectors (n_s, 3) for any profile."""
    px = x - turn[0, 0] * centre[0] - turn[0, 1] * centre[1]
    py = y - turn[1, 0] * centre[0] - turn[1, 1] * centre[1]
    first, points = rules.first[rule], rules.points
    begin, n = first[0], first[first.size - 1] - first[0]
    places, light = np.empty((2, n)), np.empty(n)
    u, v = places[0], places[1]
    for i in range(n):
        X, Y = points[begin + i, 0], points[begin + i, 1]
        u[i] = px + turn[0, 0] * X + turn[0, 1] * Y
        v[i] = py + turn[1, 0] * X + turn[1, 1] * Y
    shine(profile, u, v, 0, n, light, 0)
    for s in range(out.shape[0]):
        total, first_x, first_y = 0.0, 0.0, 0.0
        for i in range(first[s] - begin, first[s + 1] - begin):
            e = points[begin + i, 3] * light[i]
            total += e
            first_x += e * points[begin + i, 0]
            first_y += e * points[begin + i, 1]
        out[s, 0], out[s, 1], out[s, 2] = total, first_x - total * centre[0], first_y - total * centre[1]


@numba.njit(cache=True, error_model="numpy")
def moments(
    profile: Profile, rules: Rules, centre: Floats, axial: bool, turn: Floats, x: float, y: float, out: Floats
) -> None:
    """Write (∫e dA, ∫X e dA, ∫Y e dA) (n_s, 3) over the sectors, X and Y from the centre of mass.

    centre (2,) of mass, from the middle of the sail; it lies at (x, y) in the lab. turn (3, 3): from body to lab, the
    light along its z. axial: of a round Gaussian beam, with the axial coordinate in the distance from the axis.
    """
    if rules.radius > 0.0:
        c = np.empty(6)
        rule = exponent(rules, centre, axial, turn, x, y, c)
        for s in range(out.shape[0]):
            out[s, 0], out[s, 1], out[s, 2] = gaussian_moments(rules, centre, rule, s, c)
        return
    px = x - turn[0, 0] * centre[0] - turn[0, 1] * centre[1]
    py = y - turn[1, 0] * centre[0] - turn[1, 1] * centre[1]
    rule = _choose(rules, px * px + py * py, turn[2, 0] * turn[2, 0] + turn[2, 1] * turn[2, 1])
    _profile_moments(profile, rules, centre, turn, x, y, rule, out)
