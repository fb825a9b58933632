"""How sharp the fringes and resonances of a plane stack can be, at every direction, whether it is on one or not.

Light of phase φ = k_z d across a layer, between mirrors of reflected fields ρ and ρ' (those of everything before and
behind, complex), is 1/|1 − ρρ' exp(2iφ)| as strong as without them: at most F = 1/(1 − |ρρ' exp(2iφ)|), which does not
know where the resonances are and therefore cannot miss one. They are 1/(F |2 ∂φ/∂s|) wide in s (half width; Born &
Wolf, Principles of Optics, §7.6.1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamrider.arrays import Complexes, Floats
from optics.table.films import Film

# Resonances narrower than this part of a fringe occupy no direction that will be met.
_SHARPEST = 1e8
# Re ε below which a medium is a mirror: no wave in it, and none bound to it at angles at which others carry one.
_METAL = -1.0


class Fringes(NamedTuple):
    """Of a stack at sines s (n,): half width in s of the narrowest resonance (n,), and what rounding does to q (n,)."""

    width: Floats
    rounding: Floats


def carries_waves(film: Film, s_max: float) -> bool:
    """Do all media but metals carry waves at all sines up to s_max: none totally reflects, no wave clings to a face."""
    epsilon = film.index[1:] ** 2
    return bool(np.all((film.index[1:].real >= s_max) | (epsilon.real < _METAL)))


def _reflected(k_z: Complexes, y: Complexes, once: Complexes) -> Complexes:
    """ρ (media, n): the field reflected by everything behind each medium, at its back face; 0 for the last one."""
    rho = np.zeros_like(k_z)
    for i in range(len(k_z) - 2, -1, -1):
        face = (y[i] - y[i + 1]) / (y[i] + y[i + 1])
        back = rho[i + 1] * once[i + 1] ** 2
        rho[i] = (face + back) / (1.0 + face * back)
    return rho


def _finesse(k_z: Complexes, y: Complexes, once: Complexes) -> Floats:
    """F (media, n) of each medium; 1 where its wave decays faster than it runs."""
    before, behind = _reflected(k_z[::-1], y[::-1], once[::-1])[::-1], _reflected(k_z, y, once)
    closed = np.minimum(np.abs(before * behind * once**2), 1.0 - 1.0 / _SHARPEST)
    return np.asarray(np.where(k_z.real > k_z.imag, 1.0 / (1.0 - closed), 1.0))


def fringes(film: Film, s: Floats) -> Fringes:
    """Fringes of a film at sines s (n,); layers that are not coherent have none."""
    squares = (film.index[:, None] - s) * (film.index[:, None] + s)
    k_z = np.sqrt(np.where(squares == 0, 1e-200, squares))
    depth = np.concatenate([[0.0], film.depth, [0.0]])[:, None]
    coherent = np.concatenate([[0], film.coherent, [0]])[:, None]
    once = np.where(coherent == 1, np.exp(1j * k_z * depth), 0.0)
    sharp = np.maximum(*(_finesse(k_z, y, once) for y in (k_z, k_z / film.index[:, None] ** 2)))
    phase = np.abs(k_z.real * depth)
    slope = np.where(k_z.real > k_z.imag, 2.0 * depth * np.abs(s / k_z) * coherent * sharp, 0.0).max(axis=0)
    rounding = 1e-14 + 4.0 * np.finfo(float).eps * ((1.0 + phase) * np.where(coherent == 1, sharp, 1.0)).sum(axis=0)
    return Fringes(1.0 / np.maximum(slope, 1e-300), rounding)
