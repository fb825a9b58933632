"""Pressure coefficients of one cell over the direction of the light: modal, FDTD, and the difference of the two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.io.files import run_stage
from optics.table.pressure_table import PressureTable
from workflow.figures.drawing import parser, save

POINTS = 181
ROWS = ((0, "$q_g$ (across the ridges)"), (2, "$q_n$ (along the normal)"))


def _directions(table: PressureTable) -> tuple[np.ndarray, np.ndarray]:
    """u and v, evenly over the range of a table and both signs of v."""
    return np.linspace(-table.u[-1], table.u[-1], POINTS), np.linspace(-table.v[-1], table.v[-1], POINTS)


def _map(axes: Axes, u: np.ndarray, v: np.ndarray, values: np.ndarray, label: str, **style: Any) -> None:
    image = axes.pcolormesh(u, v, values.T, shading="gouraud", rasterized=True, **style)
    axes.grid(False)
    axes.set_aspect("equal")
    axes.figure.colorbar(image, ax=axes, label=label, shrink=0.85)


def _difference(axes: Axes, u: np.ndarray, v: np.ndarray, difference: np.ndarray, label: str) -> None:
    largest = np.abs(difference).max()
    _map(axes, u, v, difference, label, vmin=-largest, vmax=largest, cmap="PuOr")
    axes.set_title(f"FDTD − modal, largest {largest:.1e}")


def draw(modal: PressureTable, fdtd: PressureTable | None) -> Figure:
    """One row a coefficient; one column, or three where there is an FDTD table, over the directions that both hold."""
    u, v = _directions(fdtd or modal)
    tables = {"modal": modal} | ({"FDTD": fdtd} if fdtd else {})
    columns = 3 if fdtd else 1
    figure, grid = plt.subplots(2, columns, figsize=(3.6 * columns, 6), sharex=True, sharey=True, squeeze=False)
    values = {name: table.q(u[:, None], v) for name, table in tables.items()}
    for axes, (k, name) in zip(grid, ROWS, strict=True):
        low, high = (f([q[..., k] for q in values.values()]) for f in (np.min, np.max))
        for one, (solver, q) in zip(axes, values.items(), strict=False):
            _map(one, u, v, q[..., k], f"$q_{'grn'[k]}$", vmin=low, vmax=high, cmap="viridis")
            one.set_title(f"{solver}: {name}")
        if fdtd:
            label = rf"$\Delta q_{'grn'[k]}$"
            _difference(axes[2], u, v, values["FDTD"][..., k] - values["modal"][..., k], label)
        axes[0].set_ylabel("direction cosine v (along the ridges)")
    for one in grid[1]:
        one.set_xlabel("direction cosine u (across the ridges)")
    figure.suptitle(f"{modal.name}: force × c per incident power")
    return figure


def main() -> None:
    """Draw the tables of one design."""
    arguments = parser(__doc__)
    arguments.add_argument("--modal", required=True, type=Path, help="modal pressure table")
    arguments.add_argument("--fdtd", type=Path, help="FDTD pressure table of the same cell")
    given = arguments.parse_args()
    fdtd = PressureTable.read(given.fdtd) if given.fdtd else None
    save(draw(PressureTable.read(given.modal), fdtd), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
