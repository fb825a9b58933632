"""Smooth made-up pressure tables, near the paper's at normal incidence, for tests that need no solver."""

from __future__ import annotations

import numpy as np

from optics.table.pressure_table import PressureTable


def smooth_table(
    name: str, q_g: tuple[float, ...], q_n: tuple[float, ...], u_max: float = 0.4, absorptance: float = 0.0
) -> PressureTable:
    """Table of q_g, q_n = c₀ + c₁ u + c₂ u² + c₃ v² (c₃ optional), of one absorptance, stored for v ≥ 0."""
    u, v = np.linspace(-u_max, u_max, 81), np.linspace(0.0, u_max, 41)
    uu, vv = np.meshgrid(u, v, indexing="ij")
    basis = np.stack([np.ones_like(uu), uu, uu**2, vv**2])
    q = np.stack([np.tensordot(q_g, basis, 1), np.zeros_like(uu), np.tensordot(q_n, basis, 1)])
    attrs = {"name": name, "wavelength_m": 1064e-9}
    return PressureTable(u, v, q, np.full(uu.shape, absorptance), np.full(uu.shape, 1e-6), mirror_v=True, attrs=attrs)


def smooth_tables(sign: float = 1.0, u_max: float = 0.4) -> dict[str, PressureTable]:
    """Tables of the nominal designs, which absorb as their materials do.

    `sign` = −1 turns the lateral force round: the beam then pushes the sail out.
    """
    te = smooth_table("mark1e_te", (0.152 * sign, 1.33, -1.0, -0.2), (0.714, -2.7, 4.0, -1.5), u_max, 9.448e-6)
    tm = smooth_table("mark1e_tm", (0.142 * sign, 0.67, -1.0, 0.2), (0.233, -0.23, 2.0, 0.4), u_max, 9.763e-6)
    return {"mark1e_te": te, "mark1e_tm": tm}
