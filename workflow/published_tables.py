"""The published pressure tables as `PressureTable`s, where the data are at hand. They are never part of the repository.

python -m workflow.published_tables --data ../shared/reference/published_pressure_tables.npz --out DIR
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline

from beamrider.arrays import Floats
from beamrider.io.files import InputError, run_stage
from optics.table.pressure_table import PressureTable

ABSORPTANCE = {"TE": 9.448e-6, "TM": 9.763e-6}
DESIGN = {"TE": "mark1e_te", "TM": "mark1e_tm"}
ERROR = 1e-3
#: File of the published tables, in the folder BEAMRIDER_REFERENCE or in ../shared/reference.
NAME = "published_pressure_tables.npz"


def _angle_grid(data: dict[str, Floats], cell: str, quantity: str) -> tuple[Floats, Floats, Floats]:
    """Pitch (n), roll (m) in rad and the quantity (n, m) on the finest grid of both.

    Rows of larger roll hold fewer pitches; a cubic spline along each row fills in the missing ones.
    """
    roll, pitch = np.round(data[f"{cell}_roll_rad"], 9), np.round(data[f"{cell}_pitch_rad"], 9)
    pitches, rolls = np.unique(pitch), np.unique(roll)
    values = np.empty((pitches.size, rolls.size))
    for j, phi in enumerate(rolls):
        row = roll == phi
        order = np.argsort(pitch[row])
        values[:, j] = CubicSpline(pitch[row][order], data[f"{cell}_{quantity}"][row][order].astype(float))(pitches)
    return pitches, rolls, values


def _resample(data: dict[str, Floats], cell: str, quantity: str) -> tuple[Floats, Floats, Floats]:
    """u (n_u), v ≥ 0 (n_v) and the quantity (n_u, n_v), by a bicubic spline in the published angles.

    TE: u = sinθ cosφ, v = −sinφ. TM: u = −sinφ, |v| = sinθ cosφ. Beyond the pitches held: the edge value.
    """
    pitches, rolls, values = _angle_grid(data, cell, quantity)
    spline = RectBivariateSpline(pitches, rolls, values)
    across, along = (pitches, rolls) if cell == "TE" else (rolls, pitches)
    u, v = np.sin(across), np.sin(along[along > -1e-9])
    v[0] = 0.0
    uu, vv = np.meshgrid(u, v, indexing="ij")
    phi = np.arcsin(-vv if cell == "TE" else -uu)
    sine = (uu if cell == "TE" else vv) / np.cos(phi)
    theta = np.arcsin(np.clip(sine, np.sin(pitches[0]), np.sin(pitches[-1])))
    return u, v, spline.ev(theta, phi)


def published_table(path: Path, cell: str) -> PressureTable:
    """The published table of 'TE' or 'TM', on sines of the published angles; nominal absorptance, error 1e-3."""
    with np.load(path) as file:
        data = {key: file[key] for key in file.files if key.startswith(cell)}
    u, v, q_g = _resample(data, cell, "q_g")
    q_n = _resample(data, cell, "q_n")[2]
    absorptance = np.full(q_g.shape, ABSORPTANCE[cell])
    q = np.stack([q_g, absorptance * v, q_n])
    attrs = {"name": DESIGN[cell], "wavelength_m": 1064e-9, "solver": "published"}
    return PressureTable(u, v, q, absorptance, np.full(q_g.shape, ERROR), mirror_v=True, attrs=attrs)


def main() -> None:
    """Write the published tables, of both cells, into a folder."""
    parser = argparse.ArgumentParser(prog="python -m workflow.published_tables", description=main.__doc__)
    parser.add_argument("--data", type=Path, required=True, help=f"the published tables, {NAME}")
    parser.add_argument("--out", type=Path, required=True, help="folder to write tables into")
    given = parser.parse_args()
    if not given.data.exists():
        raise InputError(f"{given.data}: no such file")
    for cell, design in DESIGN.items():
        published_table(given.data, cell).write(given.out / f"{design}.h5")


if __name__ == "__main__":
    run_stage(main)
