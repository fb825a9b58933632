"""Error and cost of FDTD, direction by direction: deviation from the modal solution, CPU time, its own estimate."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from beamrider.arrays import Floats
from beamrider.io.files import reading, run_stage
from beamrider.io.hdf5 import read_hdf5
from optics.table.pressure_table import PressureTable
from workflow.figures.drawing import COLOURS, parser, save

MARKERS = ("o", "s", "^", "D", "v", "P")
COLUMNS = ("u", "v", "q_g", "q_n", "error", "seconds", "finest")


def read_parts(paths: list[Path]) -> dict[str, Floats]:
    """Columns of the part files of one design, joined."""
    columns: dict[str, list[Floats]] = {name: [] for name in COLUMNS}
    for path in paths:
        with reading(path, "a readable part file of FDTD"), read_hdf5(path) as file:
            for name in COLUMNS:
                columns[name].append(file[name][()])
    return {name: np.concatenate(values) for name, values in columns.items()}


def deviation(modal: PressureTable, rows: dict[str, Floats]) -> Floats:
    """Larger deviation (n,) of q_g and q_n from the modal table."""
    q = modal.q(rows["u"], rows["v"])
    return np.maximum(np.abs(rows["q_g"] - q[:, 0]), np.abs(rows["q_n"] - q[:, 2]))


def draw(designs: dict[str, tuple[Floats, dict[str, Floats]]]) -> Figure:
    """Deviation against CPU time and against the estimate; a colour a design, a marker a resolution."""
    figure, (cost, honesty) = plt.subplots(1, 2, figsize=(9.5, 4.4), sharey=True)
    finest = np.unique(np.concatenate([rows["finest"].round() for _, rows in designs.values()]))
    for (name, (away, rows)), colour in zip(designs.items(), COLOURS, strict=False):
        for resolution, marker in zip(finest, MARKERS, strict=False):
            at = rows["finest"].round() == resolution
            if at.any():
                style = {"marker": marker, "ls": "none", "ms": 4, "mfc": "none", "color": colour}
                cost.loglog(rows["seconds"][at], away[at], label=f"{name}, to {resolution:g} per λ", **style)
                honesty.loglog(rows["error"][at], away[at], **style)
    everything = [rows["error"] for _, rows in designs.values()]
    ends = [min(e.min() for e in everything), max(e.max() for e in everything)]
    honesty.loglog(ends, ends, color="0.5", lw=0.8, label="estimate = deviation")
    cost.set(xlabel="CPU time of the direction (s)", ylabel="|FDTD − modal|, larger of q_g and q_n")
    honesty.set(xlabel="error estimated by FDTD itself")
    # the errors may lie within one decade
    honesty.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    honesty.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    honesty.xaxis.set_minor_formatter(NullFormatter())
    cost.legend()
    honesty.legend()
    return figure


def main() -> None:
    """Draw the directions of several designs."""
    arguments = parser(__doc__)
    arguments.add_argument("--modal", required=True, nargs="+", type=Path, help="modal tables, tables/DESIGN/…")
    arguments.add_argument("--parts", required=True, nargs="+", type=Path, help="part files, tables/DESIGN/fdtd/…")
    given = arguments.parse_args()
    designs = {}
    for path in given.modal:
        rows = read_parts([part for part in given.parts if part.parent.parent.name == path.parent.name])
        designs[path.parent.name] = deviation(PressureTable.read(path), rows), rows
    save(draw(designs), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
