"""Gaussian beam: exp(−2s), s = (ρ/w)² (Saleh & Teich, Fundamentals of Photonics, §3.1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numba import carray
from scipy.special import erf

from dynamics.light.compiled import OWN, SHARE, squared
from dynamics.light.intensity import decay
from dynamics.light.profile import Floats, Profile


def _shine(numbers: Any, x: Any, y: Any, n: int, out: Any) -> None:
    own, u, v, total = carray(numbers, OWN), carray(x, n), carray(y, n), carray(out, n)
    for i in range(n):
        total[i] += own[SHARE] * decay(-2.0 * squared(own, u[i], v[i]))


class Gaussian(Profile):
    """I = I₀ exp(−2ρ²/w²), w the radius."""

    kind: Literal["gaussian"] = "gaussian"
    """What the profile is."""

    @property
    def function(self) -> Callable[..., None]:
        """See `Profile`."""
        return _shine

    @property
    def power(self) -> float:
        """π/2 (Saleh & Teich, §3.1)."""
        return 0.5 * math.pi

    def slope(self, s: Floats) -> Floats:
        """See `Profile`."""
        return np.asarray(-2.0 * np.exp(-2.0 * s))

    def radial(self, edge: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Closed forms of ∫ dᵏ exp(−2d²) dd up to edge (...), k = 1, 2, 3, by parts."""
        end = np.exp(-2.0 * edge**2)
        area = 0.25 * (1.0 - end)
        lever = 0.25 * (np.sqrt(np.pi / 8.0) * erf(np.sqrt(2.0) * edge) - edge * end)
        square = 0.25 * (2.0 * area - edge**2 * end)
        return area, lever, -4.0 * lever, -4.0 * square
