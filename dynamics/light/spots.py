"""Spots of light, each a profile with its place, radii and axes, that add up to a beam. SI units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics.light import compiled
from dynamics.light.profile import Floats, Profile


@dataclass(frozen=True)
class Spot:
    """A profile of radii (2,) in m along its own axes, which are turned by `angle` in rad from x towards y.

    share: of the beam's intensity at its brightest; place (2,) of its middle in m.
    """

    profile: Profile
    share: float
    place: tuple[float, float]
    radii: tuple[float, float]
    angle: float

    @property
    def round(self) -> bool:
        """Does its intensity depend on the distance from the beam's axis alone."""
        return self.profile.round and self.radii[0] == self.radii[1] and self.place == (0.0, 0.0)

    def wider(self, factor: float) -> Spot:
        """The same spot with all its lengths multiplied."""
        place, radii = ((factor * a, factor * b) for a, b in (self.place, self.radii))
        return replace(self, place=place, radii=radii)

    @property
    def axes(self) -> Floats:
        """Matrix (2, 2) that takes a place from the middle in m to radii along the own axes."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[c, s], [-s, c]]) / np.array(self.radii)[:, None]

    def numbers(self, per_metre: float) -> list[float]:
        """As the compiled function reads them, for lengths of which so many are a metre."""
        axes = self.axes
        if self.radii[0] == self.radii[1]:
            square, cross, more = 1.0 / (per_metre * per_metre * self.radii[0] * self.radii[0]), 0.0, 0.0
        else:
            form = axes.T @ axes / per_metre**2
            square, cross, more = form[0, 0], 2.0 * form[0, 1], form[1, 1] - form[0, 0]
        x, y = (per_metre * place for place in self.place)
        own = (axes / per_metre).ravel().tolist()
        return [self.share, x, y, float(square), float(cross), float(more), *own, *self.profile.numbers]


Spots = Sequence[Spot]


def pack(spots: Spots, per_metre: float) -> compiled.Profile:
    """Spots for the kernels, which measure in lengths of which `per_metre` are a metre."""
    numbers = [spot.numbers(per_metre) for spot in spots]
    return compiled.Profile(
        np.array([compiled.address(spot.profile.function) for spot in spots], np.int64),
        np.cumsum([0, *map(len, numbers)]).astype(np.int64),
        np.concatenate([np.empty(0), *numbers]),
    )


def share(spots: Spots, x: Floats, y: Floats) -> Floats:
    """Intensity (...) in units of the beam's at lateral places x, y (broadcast) in m."""
    x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    out = np.empty(x.size)
    flat = (np.ascontiguousarray(x.ravel()), np.ascontiguousarray(y.ravel()))
    compiled.shine(pack(spots, 1.0), *flat, 0, x.size, out, 0)
    return out.reshape(x.shape)


def gradient(spots: Spots, x: Floats, y: Floats) -> Floats:
    """Its derivatives (2, ...) along x and y in 1/m, at x, y (...) in m."""
    out = np.zeros((2, *np.shape(x)))
    for spot in spots:
        at = np.stack([x - spot.place[0], y - spot.place[1]])
        u, v = np.tensordot(spot.axes, at, 1)
        out += spot.share * np.tensordot(spot.axes.T, spot.profile.gradient(u, v), 1)
    return out


def power(spots: Spots) -> float:
    """∫ dA of that in m²."""
    return float(sum(spot.share * math.prod(spot.radii) * spot.profile.power for spot in spots))


def finest(spots: Spots) -> float:
    """The shortest length in m over which the intensity changes: the scale of quadrature and meshes."""
    return min(min(spot.radii) * spot.profile.finest for spot in spots)


def reach(spots: Spots) -> float:
    """Distance in m from the axis where the bright part ends."""
    return max(math.hypot(*spot.place) + max(spot.radii) * spot.profile.reach for spot in spots)


def round_beam(spots: Spots) -> bool:
    """Does the intensity depend on the distance from the axis alone."""
    return all(spot.round for spot in spots)
