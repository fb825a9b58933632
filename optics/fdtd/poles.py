"""A medium of any passive permittivity for FDTD: ε∞ and two Drude poles that give it exactly at one frequency.

Only the response at the frequency of the light counts, so nothing is fitted over a band: of every causal medium with
that ε there, one is taken that is stable on the grid. The poles are χ = −ω²/ω̂² (free electrons) and
χ = −ω²/(ω̂² + iω ω̃) (as many collisions as oscillations) with

    ω̂ = 2 sin(ωΔt/2)/Δt,    ω̃ = sin(ωΔt)/Δt:

what (P₊ − 2P + P₋)/Δt² and (P₊ − P₋)/2Δt make of exp(−iωt), so that the time step leaves no error either. The second
pole takes all absorption, the first makes ε as low as it must be. At the highest frequency of a grid, ωΔt = π, either
has lowered ε by σ (ωΔt)²/4: a medium that is still as dense as vacuum then is stable with vacuum's time step (Taflove &
Hagness, Computational Electrodynamics, §9.4; the energy of the grid stays positive). ε∞ is the least that allows it:
the frequency of free oscillations, where ε = 0, stays far from the light's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamrider.arrays import Complexes, Floats


class Medium(NamedTuple):
    """ε∞ (...), and the strengths of the pole without and with collisions (...)."""

    infinity: Floats
    free: Floats
    lossy: Floats


def responses(step: float) -> tuple[float, complex]:
    """χ of the two poles of unit strength at the frequency of the light; step: ωΔt."""
    second, first = (2 * np.sin(step / 2) / step) ** 2, np.sin(step) / step
    return float(-1 / second), complex(-1 / (second + 1j * first))


def passive(epsilon: Complexes, step: float) -> Medium:
    """The medium of permittivity `epsilon` (...), Im ε ≥ 0, on a time grid of step ωΔt."""
    free_response, lossy_response = responses(step)
    nyquist = step**2 / 4
    lossy = np.asarray(epsilon).imag / lossy_response.imag
    rest = np.asarray(epsilon).real - lossy * lossy_response.real
    missing = np.maximum(1 + nyquist * lossy - rest, 0.0)
    free = missing / (-free_response - nyquist)
    return Medium(rest - free * free_response, free, np.asarray(lossy, float))


def permittivity(medium: Medium, step: float) -> Complexes:
    """The permittivity (...) that a medium shows the light on a time grid of step ωΔt."""
    free_response, lossy_response = responses(step)
    return np.asarray(medium.infinity + medium.free * free_response + medium.lossy * lossy_response)
