"""Flat-topped beam with a smooth edge: Gori's flattened Gaussian, a sum of few Laguerre–Gauss modes.

Of order N its field is exp(−t) Σ tⁿ/n!, n = 0 … N, with t = (N + 1)(ρ/w)² (Gori, Opt. Commun. 107 (1994) 335): order 0
is a Gaussian beam, the edge at ρ = w is about w/√(N + 1) wide.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from numba import carray
from pydantic import Field
from scipy.special import betainc, gammaincc, gammaln

from beamrider.io.files import DIMENSIONLESS
from dynamics.light.compiled import OWN, SHARE, squared
from dynamics.light.intensity import decay
from dynamics.light.profile import Floats, Profile

#: Of t, beyond which it is dark for all orders, and the squared sum still a number.
_MOST = 345.0


def _shine(numbers: Any, x: Any, y: Any, n: int, out: Any) -> None:
    own, u, v, total = carray(numbers, OWN + 1), carray(x, n), carray(y, n), carray(out, n)
    order = int(own[OWN])
    for i in range(n):
        t = min((order + 1.0) * squared(own, u[i], v[i]), _MOST)
        term, series = 1.0, 1.0
        for k in range(1, order + 1):
            term *= t / k
            series += term
        total[i] += own[SHARE] * (series * series * decay(-2.0 * t))


class FlatTop(Profile):
    """I = I₀ [exp(−t) Σ tⁿ/n!]², n = 0 … N, t = (N + 1)(ρ/w)², w the radius at which the smooth edge lies."""

    kind: Literal["flat_top"] = "flat_top"
    """What the profile is."""
    order: Annotated[
        int,
        Field(
            ge=0,
            le=100,
            json_schema_extra=DIMENSIONLESS,
            description="Order N: the edge is about radius/√(N + 1) wide; 0 is a Gaussian beam.",
        ),
    ] = 20

    @property
    def function(self) -> Callable[..., None]:
        """See `Profile`."""
        return _shine

    @property
    def numbers(self) -> list[float]:
        """Order."""
        return [float(self.order)]

    @property
    def finest(self) -> float:
        """Width of the edge."""
        return 1.0 / math.sqrt(self.order + 1.0)

    @property
    def power(self) -> float:
        """2π I_½(N + 2, N + 1), the regularised beta function.

        With Q(a, t) the regularised gamma function, π/a ∫Q(a, t)² dt, a = N + 1, is by parts 2π times the chance that
        a gamma variate of shape a + 1 is below one of shape a.
        """
        return 2.0 * math.pi * float(betainc(self.order + 2.0, self.order + 1.0, 0.5))

    def slope(self, s: Floats) -> Floats:
        """See `Profile`: dQ(a, t)/dt = −t^(a − 1) exp(−t)/Γ(a)."""
        a = self.order + 1.0
        t = a * s
        fall = np.exp((a - 1.0) * np.log(np.maximum(t, 1e-300)) - t - gammaln(a))
        return np.asarray(-2.0 * a * gammaincc(a, t) * fall)
