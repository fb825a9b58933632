"""Made-up cells and members of a family, for screening without a solver."""

from __future__ import annotations

import numpy as np
import pandas as pd

from dynamics.stability import screening


def many_cells(n: int) -> pd.DataFrame:
    """Responses of n pairs of made-up cells, TE then TM by turns; cell 3 has no derivative."""
    random = np.random.default_rng(2)
    te = np.array([0.152, 0.714, 1.21, -2.60, 4e-6])
    tm = np.array([0.142, 0.233, 0.604, -0.203, 4e-6])
    rows = np.stack([te, tm] * n) * random.uniform(0.3, 1.7, (2 * n, 5))
    rows[3, 2:4] = np.nan
    frame = pd.DataFrame(rows, columns=list(screening.NUMBERS)).assign(
        cell=np.arange(2 * n),
        q_error=1e-4,
        gradient_error=1e-3,
        absorptance_error=1e-9,
        resolved=True,
    )
    return frame.assign(mean_thickness_m=np.where(frame["cell"] % 2, 1240e-9 / 3, 400e-9))


def many_members(n: int) -> pd.DataFrame:
    """Every pair of the cells, with sectors, spins and beams of their own."""
    te, tm = (x.ravel() for x in np.meshgrid(np.arange(0, 2 * n, 2), np.arange(1, 2 * n, 2), indexing="ij"))
    random = np.random.default_rng(3)
    return pd.DataFrame(
        {
            "te_cell": te,
            "tm_cell": tm,
            "sail.sector_deg": random.uniform(40.0, 90.0, te.size),
            "sail.spin_Hz": random.uniform(-150.0, 150.0, te.size),
            "sail.beam_radius_m": random.uniform(0.3, 0.6, te.size),
        }
    )
