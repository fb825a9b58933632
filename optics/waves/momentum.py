"""From diffraction efficiencies to the force on the cell: the same few lines for every solver.

With R_m, T_m the fractions of the incident power in reflected and transmitted orders, momentum conservation gives the
force × c per incident power (Minkowski form; in vacuum, textbook photon momentum):

    q_g = u − Σ (R_m + T_m) u_m,   q_r = v a,   q_n = w + Σ (R_m − T_m) w_m
"""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Complexes, Floats


def pressure(
    u: Floats | float,
    v: Floats | float,
    w: Floats | float,
    *,
    u_m: Floats,
    w_front: Complexes,
    w_back: Complexes,
    reflected: Floats,
    transmitted: Floats,
    light: Floats | float = 1.0,
) -> tuple[Floats, Floats]:
    """Pressure coefficients q (..., 3) in (g, r, n) and absorptance (...).

    `u_m`, `w_front`, `w_back`, `reflected`, `transmitted` (..., n_orders) over the orders, w_* complex as from
    `order_cosines`, efficiencies zero for evanescent orders; u, v, w (...) of the incident light. `light` (...): power
    that comes in, 0 for the efficiencies of the Stokes components s₁, s₂, s₃, which carry none.
    """
    absorptance = light - (reflected + transmitted).sum(-1)
    q_g = u * light - ((reflected + transmitted) * u_m).sum(-1)
    q_n = w * light + (reflected * w_front.real - transmitted * w_back.real).sum(-1)
    return np.stack([q_g, v * absorptance, q_n], axis=-1), absorptance
