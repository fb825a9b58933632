"""Quadrature of any beam over the sectors of a round sail: Gauss–Legendre panels in radius and polar angle.

Panels are some of the profile's own lengths wide (Abramowitz & Stegun, §25.4.29). The number of points in a panel is
the least with which the integrals for beams that fall here and there on the sail, also tilted, agree with those of four
more.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dynamics.light import spots as spot
from dynamics.light.compiled import Profile
from dynamics.light.profile import Floats
from dynamics.light.sectors import Rules, moments
from dynamics.light.spots import Spots

Spans = tuple[tuple[float, float], ...]

#: Lengths of the profile in a panel; points of a panel that are tried; most points of all sectors.
_PANEL, _LEAST, _MOST, MOST_POINTS = 3.0, 5, 48, 2_000_000
#: Distances of the beam in its reaches, and lateral parts of k in the body, up to which the near rule is good.
_NEAR = (0.3, 0.3)
_TRIED = 40


class TooSteep(ValueError):
    """No rule of reasonable size integrates the beam."""


def points(span: tuple[float, float], radius: float, length: float, n: int) -> Floats:
    """Points (k, 4) over a sector: X, Y, 0, weight; n to a panel, in radius and in angle."""
    d, wd = _panels(0.0, radius, length, n)
    angle, wa = _panels(*span, length / radius, n)
    columns = [np.outer(d, np.cos(angle)), np.outer(d, np.sin(angle)), np.zeros((d.size, angle.size))]
    return np.stack([*columns, np.outer(wd * d, wa)], axis=-1).reshape(-1, 4)


def _panels(a: float, b: float, length: float, n: int) -> tuple[Floats, Floats]:
    x, weight = np.polynomial.legendre.leggauss(n)
    count = max(1, math.ceil((b - a) / (_PANEL * length)))
    step = (b - a) / count
    return (a + step * (np.arange(count)[:, None] + 0.5 * (x + 1.0))).ravel(), np.tile(0.5 * step * weight, count)


def size(spans: Spans, radius: float, length: float, n: int) -> float:
    """How many points the rule of n to a panel has, for all sectors."""
    along = radius / (_PANEL * length) + 1.0
    return n * n * along * sum((b - a) * radius / (_PANEL * length) + 1.0 for a, b in spans)


def _rule(spans: Spans, radius: float, length: float, n: int) -> tuple[NDArray[np.int64], Floats]:
    every = [points(span, radius, length, n) for span in spans]
    ends = np.cumsum([0, *map(len, every)]).astype(np.int64)
    return ends, np.concatenate(every)


def _tried(reach: float, slant: float, seed: int) -> list[tuple[Floats, Floats]]:
    """Attitudes (3, 3) and places (2,) of a sail, within those limits and at them."""
    random = np.random.default_rng(seed)
    distance = reach * np.sqrt(random.uniform(0.0, 1.0, _TRIED))
    tilt = math.asin(slant) * random.choice([0.0, 1.0], _TRIED)
    distance[:8], tilt[:8] = reach * np.array([0.0, 0.0, 1.0, 1.0] * 2), math.asin(slant) * np.array([0.0, 1.0] * 4)
    angle, towards, yaw = random.uniform(0.0, 2.0 * np.pi, (3, _TRIED))
    out = []
    for r, a, t, b, c in zip(distance, angle, tilt, towards, yaw, strict=True):
        turn = Rotation.from_euler("XYZ", [t * math.cos(b), t * math.sin(b), c]).as_matrix()
        out.append((np.ascontiguousarray(turn), r * np.array([math.cos(a), math.sin(a)])))
    return out


def _found(
    profile: Profile, rule: tuple[NDArray[np.int64], Floats], tried: list[tuple[Floats, Floats]], radius: float
) -> Floats:
    """Integrals (k, n_s, 3) of sectors by one rule, first moments over the radius."""
    first, every = rule
    rules = Rules(np.array([np.inf]), np.array([np.inf]), first[None], every, 0.0)
    out = np.empty((len(tried), first.size - 1, 3))
    for (turn, place), one in zip(tried, out, strict=True):
        moments(profile, rules, np.zeros(2), False, turn, place[0], place[1], one)
    return out / np.array([1.0, radius, radius])


def _least(
    spots: Spots, spans: Spans, radius: float, tried: list[tuple[Floats, Floats]], error: float
) -> tuple[NDArray[np.int64], Floats]:
    """The rule of fewest points a panel that holds the error, as a share of the most power on the sail."""
    profile, length, n = spot.pack(spots, 1.0), min(spot.finest(spots), 2.0 * radius), _LEAST
    while n <= _MOST:
        if size(spans, radius, length, n + 4) > MOST_POINTS:
            break
        one, other = (_rule(spans, radius, length, k) for k in (n, n + 4))
        best = _found(profile, other, tried, radius)
        power = float(best[:, :, 0].sum(axis=1).max())
        if np.abs(_found(profile, one, tried, radius) - best).max() <= error * power:
            return one
        n += 1 + n // 6
    raise TooSteep(f"changes within {length:.3g} m, too steep for quadrature over a sail of radius {radius:g} m")


def profile_rules(spots: Spots, spans: Spans, radius: float, error: float) -> Rules:
    """Rules in m for sectors between polar angles `spans` of a sail of that radius in m; TooSteep where none will do.

    `error` is that of a sector's ∫e dA, ∫X e dA/radius and ∫Y e dA/radius, as a share of the most power on the sail.
    """
    reach = spot.reach(spots)
    limits = [(_NEAR[0] * reach, _NEAR[1]), (radius + reach, 0.6)]
    found = [_least(spots, spans, radius, _tried(*limit, seed), error) for seed, limit in enumerate(limits)]
    starts = np.cumsum([0, *(len(every) for _, every in found)])
    first = np.stack([ends + start for (ends, _), start in zip(found, starts, strict=False)])
    return Rules(
        np.array([limits[0][0], np.inf]),
        np.array([limits[0][1], np.inf]),
        first,
        np.concatenate([every for _, every in found]),
        0.0,
    )


def scaled(rules: Rules, length: float) -> Rules:
    """Rules in units of `length`."""
    points = rules.points / np.array([length, length, 1.0, length**2])
    return Rules(rules.reach / length, rules.slant, rules.first, points, rules.radius / length)
