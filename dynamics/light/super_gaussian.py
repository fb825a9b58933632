"""Super-Gaussian beam: exp(−2 sᵖᐟ²), s = (ρ/w)², flat in the middle.

Parent, Morin & Lavigne, Opt. Quantum Electron. 24 (1992) S1071.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from numba import carray
from pydantic import Field

from beamrider.io.files import DIMENSIONLESS
from dynamics.light.compiled import OWN, SHARE, squared
from dynamics.light.intensity import decay
from dynamics.light.profile import Floats, Profile


def _shine(numbers: Any, x: Any, y: Any, n: int, out: Any) -> None:
    own, u, v, total = carray(numbers, OWN + 1), carray(x, n), carray(y, n), carray(out, n)
    power = own[OWN]
    for i in range(n):
        total[i] += own[SHARE] * decay(-2.0 * squared(own, u[i], v[i]) ** power)


class SuperGaussian(Profile):
    """I = I₀ exp(−2(ρ/w)ᵖ), w the radius."""

    kind: Literal["super_gaussian"] = "super_gaussian"
    """What the profile is."""
    order: Annotated[
        int,
        Field(
            ge=2,
            le=100,
            multiple_of=2,
            json_schema_extra=DIMENSIONLESS,
            description="Power p of the distance, even: odd ones have a cusp; 2 is Gaussian.",
        ),
    ] = 8

    @property
    def function(self) -> Callable[..., None]:
        """See `Profile`."""
        return _shine

    @property
    def numbers(self) -> list[float]:
        """Power of s."""
        return [0.5 * self.order]

    @property
    def finest(self) -> float:
        """Width of the edge."""
        return 2.0 / self.order

    @property
    def power(self) -> float:
        """π Γ(1 + 2/p)/2^(2/p): with s as variable it is π∫exp(−2sᵖᐟ²)ds (Gradshteyn & Ryzhik, 3.326)."""
        q = 2.0 / self.order
        return math.pi * math.gamma(1.0 + q) / 2.0**q

    def slope(self, s: Floats) -> Floats:
        """See `Profile`."""
        q = 0.5 * self.order
        return np.asarray(-2.0 * q * s ** (q - 1.0) * np.exp(-2.0 * s**q))
