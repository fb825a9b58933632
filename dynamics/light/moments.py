"""Moments of the light, and of its slopes, on the sectors of a sail that is centred and level: what stability needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynamics.light import rules
from dynamics.light import spots as spot
from dynamics.light.profile import Floats, Profile
from dynamics.light.spots import Spots

#: Points a panel that are tried, and the share of the power that moments may err by.
_FEW, _MANY, _ERROR = 16, 64, 1e-10


@dataclass(frozen=True)
class Moments:
    """Moments of the beam's intensity e over each of n_s sectors, batches in front; lengths in any unit.

    zeroth: ∫e dA (..., n_s). first: ∫X_i e dA (..., n_s, 2). slope: ∫∂e/∂x_j dA (..., n_s, 2). slopes: ∫X_i ∂e/∂x_j dA
    (..., n_s, 2, 2).
    """

    zeroth: Floats
    first: Floats
    slope: Floats
    slopes: Floats


def round_moments(
    profile: Profile, start: Floats, stop: Floats, sail_radius: Floats | float, beam_radius: Floats | float
) -> Moments:
    """Moments over sectors from polar angle start to stop (..., n_s) of a disc with a round beam on its middle.

    Radial integrals of the profile, times integrals over the angle.
    """
    edge, w = (np.asarray(x, float)[..., None] for x in (sail_radius, beam_radius))
    area, lever, fall, falls = profile.radial(edge / w)
    span, double = stop - start, (np.sin(2.0 * stop) - np.sin(2.0 * start)) / 2.0
    mixed = np.sin(stop) ** 2 - np.sin(start) ** 2
    first = np.stack([np.sin(stop) - np.sin(start), np.cos(start) - np.cos(stop)], axis=-1)
    second = np.stack([span + double, mixed, mixed, span - double], axis=-1).reshape(*span.shape, 2, 2) / 2.0
    return Moments(
        w**2 * area * span,
        (w**3 * lever)[..., None] * first,
        (w * fall)[..., None] * first,
        (w**2 * falls)[..., None, None] * second,
    )


def beam_moments(spots: Spots, spans: rules.Spans, radius: float, yaw: Floats) -> Moments:
    """Moments (..., n_s) in m of any beam on a sail of `radius` in m turned by yaw (...) in rad; body components.

    TooSteep where quadrature does not resolve the beam.
    """
    if spot.round_beam(spots):
        edges = np.broadcast_to(np.array(spans), (*np.shape(yaw), len(spans), 2))
        found = [
            _times(one.share, round_moments(one.profile, edges[..., 0], edges[..., 1], radius, one.radii[0]))
            for one in spots
        ]
        return Moments(*(sum(parts) for parts in zip(*found, strict=True)))
    length = min(spot.finest(spots), 2.0 * radius)
    steep = rules.TooSteep(f"changes within {length:.3g} m, too steep for a sail of radius {radius:g} m")
    if rules.size(spans, radius, length, _FEW) > rules.MOST_POINTS:
        raise steep
    coarse = _quadrature(spots, spans, radius, yaw, n := _FEW)
    error = max([_ERROR, *(one.profile.error for one in spots)])
    while (n := n + n // 2) <= _MANY and rules.size(spans, radius, length, n) <= rules.MOST_POINTS:
        fine = _quadrature(spots, spans, radius, yaw, n)
        whole = np.abs(fine.zeroth).sum(axis=-1).max()
        if (
            max(
                np.abs(a - b).max() / c
                for a, b, c in zip(
                    _parts(coarse),
                    _parts(fine),
                    (whole, whole * radius, whole / spot.finest(spots), whole),
                    strict=True,
                )
            )
            <= error
        ):
            return fine
        coarse = fine
    raise steep


def _parts(moments: Moments) -> tuple[Floats, ...]:
    return moments.zeroth, moments.first, moments.slope, moments.slopes


def _times(share: float, moments: Moments) -> tuple[Floats, ...]:
    return tuple(share * part for part in _parts(moments))


def _quadrature(spots: Spots, spans: rules.Spans, radius: float, yaw: Floats, n: int) -> Moments:
    """Moments by panels of n points."""
    sectors = [rules.points(span, radius, min(spot.finest(spots), 2.0 * radius), n).T for span in spans]
    found = [[_sector(spots, sector, float(one)) for sector in sectors] for one in np.ravel(yaw)]
    parts = [np.array([[sector[k] for sector in turned] for turned in found]) for k in range(4)]
    return Moments(*(part.reshape(*np.shape(yaw), *part.shape[1:]) for part in parts))


def _sector(spots: Spots, sector: Floats, yaw: float) -> tuple[Floats, ...]:
    """Moments of one sector of points (4, p), turned by `yaw` in rad."""
    X, Y, _, weight = sector
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, at = c * X - s * Y, s * X + c * Y, np.stack([X, Y])
    light = weight * spot.share(spots, x, y)
    along, across = spot.gradient(spots, x, y)
    slope = weight * np.stack([c * along + s * across, c * across - s * along])
    return light.sum(), at @ light, slope.sum(axis=1), at @ slope.T
