"""What a beam profile is. Lengths are in radii of the spot, along its own axes; the brightest place has intensity 1."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import Strict
from dynamics.light import compiled

#: Points to a panel, of two lengths of the profile, of the radial integrals that have no closed form.
_POINTS = 24


class Profile(Strict):
    """A profile gives its compiled function, gradient, power and lengths; nothing else knows its formula.

    Here is what is common to round ones, which depend on s = (distance/radius)² alone. `kind` names it in the file.
    """

    round: ClassVar[bool] = True
    #: Share of the power on the sail by which quadrature over it may err.
    error: ClassVar[float] = 1e-11
    kind: str

    @property
    def function(self) -> Callable[..., None]:
        """What `compiled.address` compiles: adds the intensity at n places to `out`."""
        raise NotImplementedError

    @property
    def numbers(self) -> list[float]:
        """The profile's own numbers, as the function reads them from `compiled.OWN` on."""
        return []

    @property
    def finest(self) -> float:
        """Length over which the intensity changes."""
        return 1.0

    @property
    def reach(self) -> float:
        """Where the bright part ends: at the radius, if not told otherwise."""
        return 1.0

    @property
    def dark(self) -> float:
        """Distance from the middle beyond which there is no light: less than 1e-30.

        NotImplementedError for a profile with tails beyond 8 radii, which has to tell the distance itself.
        """
        d = np.linspace(self.reach, 8.0, 321)
        dark = self.values(d, np.zeros(1)) < 1e-30
        if not dark[-1]:
            raise NotImplementedError(
                f"beam.profile.kind = '{self.kind}': is not dark at 8 radii: it must define `dark`"
            )
        return float(d[np.argmax(dark)])

    @property
    def power(self) -> float:
        """∫ intensity dA."""
        raise NotImplementedError

    def slope(self, s: Floats) -> Floats:
        """d(intensity)/ds at s (...)."""
        raise NotImplementedError

    def values(self, u: Floats, v: Floats) -> Floats:
        """Intensity (...) at places u, v (broadcast)."""
        u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        out = np.empty(u.size)
        one = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]
        packed = compiled.Profile(
            np.array([compiled.address(self.function)]),
            np.array([0, compiled.OWN + len(self.numbers)]),
            np.array([*one, *self.numbers]),
        )
        compiled.shine(packed, u.flatten(), v.flatten(), 0, u.size, out, 0)
        return out.reshape(u.shape)

    def gradient(self, u: Floats, v: Floats) -> Floats:
        """∂(intensity)/∂(u, v) (2, ...) at places u, v (...)."""
        return np.asarray(2.0 * self.slope(u * u + v * v) * np.stack([u, v]))

    def radial(self, edge: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """(∫f d dd, ∫f d² dd, ∫f' d dd, ∫f' d² dd), each (...), of f(d) from 0 to edge (...)."""
        end = np.minimum(edge, self.dark)
        x, weight = np.polynomial.legendre.leggauss(_POINTS)
        panels = math.ceil(0.5 * self.dark / self.finest)
        d = end[..., None] * ((np.arange(panels)[:, None] + 0.5 * (x + 1.0)) / panels).ravel()
        step = end[..., None] * np.tile(0.5 * weight, panels) / panels
        f, fall = self.values(d, np.zeros(1)), 2.0 * d * self.slope(d * d)
        area, lever = (np.asarray((step * f * d**k).sum(axis=-1)) for k in (1, 2))
        slope, slopes = (np.asarray((step * fall * d**k).sum(axis=-1)) for k in (1, 2))
        return area, lever, slope, slopes
