"""Directions, polarisation and diffraction orders.

Cell frame (g, r, n): g across the ridges, r along them, n = g × r. Light falls on the ridge side:

        light ↓ k
        ██  █     ██  █     ridges face the light        ┌──→ g
        ▀▀▀▀▀▀▀▀▀▀▀▀▀▀▀     membrane                     ↓ n     r points out of the page

Direction cosines: u = k·g, v = k·r, w = k·n > 0. Time factor exp(−iωt).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Complexes, Floats
from beamrider.io.errors import InputError

AXES = {"g": 0, "r": 1}


def wave_vector(u: Floats | float, v: Floats | float, index: float = 1.0) -> Floats:
    """k/k₀ (..., 3) in (g, r, n) of the light, in front of the cell (refractive index `index`)."""
    s = np.hypot(u, v)
    w = np.sqrt((index - s) * (index + s))
    return np.stack(np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float), w), axis=-1)


def electric_vector(u: Floats | float, v: Floats | float, axis: str, index: float = 1.0) -> Floats:
    """Unit electric vector (..., 3) in (g, r, n): the nominal axis 'g' or 'r' projected perpendicular to k.

    The polarisation is fixed to the sail; given as a vector there is no s/p basis to be undefined at u = v = 0.
    """
    k, along = wave_vector(u, v, index) / index, AXES[axis]
    projected = -k * k[..., along, None]
    # 1 − k_axis² as the sum of the other two squares, which keeps its digits at glancing light.
    projected[..., along] = (np.delete(k, along, axis=-1) ** 2).sum(axis=-1)
    return np.asarray(projected / np.linalg.norm(projected, axis=-1, keepdims=True))


def polarisation_basis(u: Floats | float, v: Floats | float, index: float = 1.0) -> tuple[Floats, Floats]:
    """Unit vectors e₁, e₂ (..., 3) across k: e₁ is r projected perpendicular to k, e₂ = k̂ × e₁."""
    first = electric_vector(u, v, "r", index)
    return first, np.cross(wave_vector(u, v, index) / index, first)


def stokes(u: Floats | float, v: Floats | float, field: Complexes | Floats, index: float = 1.0) -> Floats:
    """Stokes components (..., 4) of light with the complex electric vector `field` (..., 3), as shares of its power.

    (1, s₁, s₂, s₃) with a = E·e₁ and b = E·e₂ of `polarisation_basis`: s₁ = |a|² − |b|², s₂ = 2 Re(a b*),
    s₃ = 2 Im(a b*), divided by |a|² + |b|² (Born & Wolf, Principles of Optics, §10.8.3, with their sign of s₃ for the
    time factor exp(−iωt)). s₁ = 1: E along e₁; s₂ = 1: along e₁ + e₂; s₃ = 1: E turns from e₂ to e₁.
    """
    a, b = ((np.asarray(field) * e).sum(-1) for e in polarisation_basis(u, v, index))
    cross, power = a * np.conj(b), np.abs(a) ** 2 + np.abs(b) ** 2
    parts = [power, np.abs(a) ** 2 - np.abs(b) ** 2, 2 * cross.real, 2 * cross.imag]
    return np.stack(parts, axis=-1) / power[..., None]


def worst_polarisation(stokes_parts: Floats) -> Floats:
    """Largest size (...) of a quantity over all polarisations, from what it is for the Stokes components (4, ...).

    It is linear in the normalised Stokes vector (1, s₁, s₂, s₃), s₁² + s₂² + s₃² ≤ 1.
    """
    return np.asarray(np.abs(stokes_parts[0]) + np.sqrt((stokes_parts[1:] ** 2).sum(axis=0)))


def order_cosines(
    u: Floats | float, v: Floats | float, pitch: float, orders: NDArray[np.int64], index: float = 1.0
) -> tuple[Floats, Complexes]:
    """u_m = u + m λ/d and w_m = √(n² − u_m² − v²) (Im ≥ 0) of the diffraction orders.

    `pitch` is λ/d. u and v (...) broadcast; the last axis of the results runs over `orders` (n,). Evanescent ones have
    an imaginary w_m.
    """
    u_m = np.asarray(u)[..., None] + pitch * orders
    s = np.hypot(u_m, np.asarray(v)[..., None])
    w_m = np.sqrt(((index - s) * (index + s)).astype(complex))
    return u_m, w_m


def cutoffs(pitch: float, u_max: float, v: float = 0.0, index: float = 1.0) -> list[float]:
    """Values of u in [−u_max, u_max] where a diffraction order appears or vanishes (Rayleigh cut-offs) at given v."""
    edge = np.sqrt(index**2 - v**2)
    m_max = int(np.ceil((index + u_max) / pitch)) + 1
    found = {round(sign * edge - m * pitch, 15) for m in range(-m_max, m_max + 1) if m for sign in (-1, 1)}
    return sorted(float(u) for u in found if abs(u) <= u_max)


def check_range(index: float, u_max: float, v_max: float | None = None) -> None:
    """Refuse a table that reaches light that doesn't exist (u² + v² ≥ n²) or is empty."""
    if not 0 < u_max < index:
        raise InputError(f"--u-max = {u_max:g}: must be between 0 and {index:g}")
    if v_max is None:
        return
    if not 0 < v_max < index:
        raise InputError(f"--v-max = {v_max:g}: must be between 0 and {index:g}")
    if u_max**2 + v_max**2 >= index**2:
        raise InputError(f"--u-max = {u_max:g}, --v-max = {v_max:g}: u² + v² must stay below {index**2:g}")
