"""Ring of light: the Laguerre–Gauss beam with ℓ turns of phase about its axis and no radial node.

I ∝ (2s)^ℓ exp(−2s), s = (ρ/w)², brightest at ρ = w √(ℓ/2) (Allen et al., Phys. Rev. A 45 (1992) 8185).
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
    charge = own[OWN]
    for i in range(n):
        twice = 2.0 * squared(own, u[i], v[i])
        rise = charge * math.log(twice / charge) + charge if charge > 0.0 else 0.0
        total[i] += own[SHARE] * decay(rise - twice)


class Ring(Profile):
    """I = I₀ (2ρ²/(ℓ w²))^ℓ exp(ℓ − 2ρ²/w²), w the radius of its Gaussian factor, I₀ on the brightest circle."""

    kind: Literal["ring"] = "ring"
    """What the profile is."""
    charge: Annotated[
        int,
        Field(
            ge=0,
            le=50,
            json_schema_extra=DIMENSIONLESS,
            description="Turns ℓ of phase about the axis; brightest at radius·√(ℓ/2); 0 is a Gaussian beam.",
        ),
    ] = 1

    @property
    def function(self) -> Callable[..., None]:
        """See `Profile`."""
        return _shine

    @property
    def numbers(self) -> list[float]:
        """Turns of phase."""
        return [float(self.charge)]

    @property
    def finest(self) -> float:
        """Width of the ring, as that of the Gaussian factor; of many turns the peak's own, in ρ² and so in ρ."""
        return 0.5 if self.charge else 1.0

    @property
    def reach(self) -> float:
        """One radius beyond the brightest circle."""
        return 1.0 + math.sqrt(0.5 * self.charge) if self.charge else 1.0

    @property
    def dark(self) -> float:
        """See `Profile`: of the gamma distribution that the power is in 2s."""
        return math.sqrt(0.5 * self.charge + 6.0 * math.sqrt(self.charge) + 36.0)

    @property
    def power(self) -> float:
        """π/2 ℓ! e^ℓ/ℓ^ℓ, from Euler's integral of the gamma function."""
        k = self.charge
        return 0.5 * math.pi * math.exp(math.lgamma(k + 1.0) + k - (k * math.log(k) if k else 0.0))

    def slope(self, s: Floats) -> Floats:
        """See `Profile`."""
        k = self.charge
        if k == 0:
            return np.asarray(-2.0 * np.exp(-2.0 * s))
        twice = np.maximum(2.0 * s, 1e-300)
        value = np.exp(k * np.log(twice / k) + k - twice)
        return np.asarray(2.0 * (k / twice - 1.0) * value)
