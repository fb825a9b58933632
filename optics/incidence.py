"""Directions, polarisation and diffraction orders.

Cell frame (g, r, n): g across the ridges, r along them, n = g × r. Light falls on the ridge side:

         k ↘  | n (downstream, +)
    ▔▔▔█▔▔▔█▔▔▔   ridges face the light
    ▔▔▔▔▔▔▔▔▔▔▔   membrane              g →   r into the page... n ↓

Direction cosines: u = k·g, v = k·r, w = k·n > 0. Time factor exp(−iωt).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

AXES = {"g": 0, "r": 1}


def normal_cosine(u: Floats | float, v: Floats | float) -> Floats:
    """w = √(1 − u² − v²) of directions inside the unit circle, in a form that is accurate at glancing light."""
    s = np.hypot(u, v)
    return np.sqrt((1.0 - s) * (1.0 + s))


def electric_vector(u: float, v: float, axis: str) -> Floats:
    """Unit electric vector (3,) in (g, r, n): the nominal axis 'g' or 'r' projected perpendicular to k.

    The polarisation is fixed to the sail; given as a vector there is no s/p basis to be undefined at u = v = 0.
    """
    k = np.array([u, v, float(normal_cosine(u, v))])
    e = np.zeros(3)
    e[AXES[axis]] = 1.0
    e = e - k * k[AXES[axis]]
    return np.asarray(e / np.linalg.norm(e))


def order_cosines(
    u: Floats | float, v: Floats | float, pitch: float, orders: NDArray[np.int64], index: float = 1.0
) -> tuple[Floats, Complexes]:
    """u_m = u + m λ/d and w_m = √(n² − u_m² − v²) (Im ≥ 0) of the diffraction orders.

    `pitch` is λ/d. u and v broadcast; the last axis of the results runs over `orders`. Evanescent orders have imaginary w_m.
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
