"""The diffraction orders that an FDTD run has to carry away, and how close one of them is to its cut-off."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamrider.arrays import Complexes, Floats
from optics.cells.outline import Grating
from optics.fdtd.grid import half_spaces
from optics.waves.incidence import order_cosines


class Orders(NamedTuple):
    """u_m (n,), ascending; w_m in front and behind (n,), complex, real where the order leaves on that side."""

    u: Floats
    front: Complexes
    back: Complexes


def _all_orders(cell: Grating, u: float, v: float) -> Orders:
    """Every order that leaves, and more."""
    front, back = (complex(np.sqrt(e)) for e in half_spaces(cell))
    most = int(np.ceil((max(front.real, back.real) + 1 + abs(u)) / cell.pitch))
    m = np.arange(-most, most + 1)
    u_m, w_front = order_cosines(u, v, cell.pitch, m, front.real)
    behind = (
        np.sqrt(half_spaces(cell)[1] - u_m**2 - v**2) if back.imag else order_cosines(u, v, cell.pitch, m, back.real)[1]
    )
    return Orders(u_m, w_front, behind)


def leaving_orders(cell: Grating, u: float, v: float) -> Orders:
    """The orders that leave on either side, the specular one among them; in an absorbing half-space none gets far."""
    u_m, front, back = _all_orders(cell, u, v)
    if half_spaces(cell)[1].imag:
        back = 1j * np.abs(back)
    keep = (front.real > 0) | (back.real > 0)
    return Orders(u_m[keep], front[keep], back[keep])


def grazing(cell: Grating, u: float, v: float) -> float:
    """Smallest |w| of the diffraction orders, propagating or evanescent, in either half-space."""
    _, front, back = _all_orders(cell, u, v)
    return float(min(np.abs(front).min(), np.abs(back).min()))


def steepness(cell: Grating, u: float, v: float) -> float:
    """Smallest |w|/n of them: the cosine to the normal, which tells how far in frequency the cut-off is."""
    _, front, back = _all_orders(cell, u, v)
    indices = [abs(np.sqrt(e)) for e in half_spaces(cell)]
    return float(min(np.abs(w).min() / n for w, n in zip((front, back), indices, strict=True)))


def least_in_window(cell: Grating, u: Floats, v_max: float) -> float:
    """Smallest |w| of any order over u (n_u), ascending, and |v| ≤ v_max, at its nodes or between.

    Over the range the squares of an order's u_m and of v, and so its w_m², take all values between two ends.
    """
    smallest = []
    for epsilon in half_spaces(cell):
        most = int(np.ceil((abs(np.sqrt(epsilon)) + 1 + np.abs(u).max()) / cell.pitch))
        ends = np.array([u[0], u[-1]])[:, None] + cell.pitch * np.arange(-most, most + 1)
        least = np.where(ends[0] * ends[1] <= 0, 0.0, np.abs(ends).min(axis=0))
        high, low = epsilon.real - least**2, epsilon.real - np.abs(ends).max(axis=0) ** 2 - v_max**2
        nearest = np.where(high * low <= 0, 0.0, np.minimum(np.abs(high), np.abs(low)))
        smallest.append(float(np.sqrt(np.hypot(nearest, epsilon.imag).min())))
    return min(smallest)
