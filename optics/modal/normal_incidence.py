"""The response of many grating cells around normal incidence by the Fourier modal method: what screening asks for.

    python -m optics.local --cells cells.jsonl --block 1/8 --out block1.parquet

Each line of the cells is a metagrating as JSON. A block takes every n-th of them, so that blocks take equally long. One
row a cell: its number, q and ∂q/∂u of the components g and n, their errors, absorptance and the mean thickness, and
whether so many orders resolve it: false where fields have no limit (`optics.modal.limit`) or q errs by over 0.05.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from beamrider.arrays import Floats
from beamrider.io.arguments import parser, part_of
from beamrider.io.files import InputError, progress, read_lines, reading, take_out, validate
from beamrider.io.parquet import write_parquet
from beamrider.provenance.record import as_attribute
from optics.cells.cross_section import cross_section
from optics.cells.schema import Metagrating, as_stack, require_coherent
from optics.modal.derivatives import derivatives
from optics.modal.limit import without_limit
from optics.modal.response import solve
from optics.modal.steps import ModalCell, Slanted
from optics.table.normal_incidence import NormalResponse

_STEP = 1e-4  # in u, of differences
CUTOFF = 1e-9  # of a period of a whole number of wavelengths
COARSER = (0.7, 0.85)  # shares of the orders; errors fall with wiggles, so that one of them may be right by chance
ORDER = 15
COLUMNS = (
    "q_g",
    "q_n",
    "q_g_u",
    "q_n_u",
    "absorptance",
    "q_error",
    "gradient_error",
    "absorptance_error",
    "mean_thickness_m",
    "wavelength_m",
)
SCHEMA = pa.schema(
    [
        ("cell", pa.int64()),
        *((name, pa.float64()) for name in COLUMNS),
        ("order", pa.int64()),
        ("resolved", pa.bool_()),
    ]
)
UNRESOLVED = 0.05  # error of q from which on its slopes and their errors mean nothing


def _at_cutoff(pitch: float, index: float) -> bool:
    """Whether an order grazes at normal incidence: m λ/d = index."""
    nearest = max(1.0, round(index / pitch))
    return abs(nearest * pitch / index - 1.0) < CUTOFF


def _slopes_of_steps(cell: Slanted, order: int) -> tuple[Floats, Floats]:
    """`slopes` of a profile with slanted walls, by differences of fourth order."""
    found = solve(cell, _STEP * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), np.zeros(1), order)
    q, weights = found.q[:, 0], np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12 * _STEP)
    return q[2], np.stack([weights @ q, [0.0, found.absorptance[2, 0], 0.0]], axis=1)


def slopes(cell: ModalCell, order: int) -> tuple[Floats, Floats]:
    """Value q (3,) and its gradient (3, 2) at normal incidence with diffraction orders −order … order.

    Along v the response is even but for q_r = v a: momentum along the ridges is lost to absorption alone. At a Rayleigh
    cut-off, a period of a whole number of wavelengths in front of the cell or behind it, q has no gradient: NaN.
    """
    at_cutoff = any(_at_cutoff(cell.pitch, index) for index in (cell.surroundings.front, cell.surroundings.back))
    if isinstance(cell, Slanted):
        q, gradient = _slopes_of_steps(cell, order)
        return q, gradient * (np.nan if at_cutoff else 1.0)
    found = derivatives(cell, 0.0, 0.0, order, ("u",))
    if at_cutoff:
        return found.q, np.full((3, 2), np.nan)
    return found.q, np.stack([found.q_dot[0], [0.0, found.absorptance, 0.0]], axis=1)


def normal_response(cell: ModalCell, order: int, half: ModalCell | None = None) -> NormalResponse:
    """Response of a cell; errors: the largest change of a value, or a slope, from 0.7 and 0.85 of the orders.

    half: the cell with half the slices or steps; values are then extrapolated, by what the errors grow.
    """
    q, gradient = slopes(cell, order)
    if half is not None:
        # of second order in the thickness of a slice, of fourth in that of a step, as in `optics.modal.truncation`
        share = 1 / 15 if isinstance(cell, Slanted) else 1 / 3
        steps = [share * (a - b) for a, b in zip((q, gradient), slopes(half, order), strict=True)]
        rest = normal_response(cell, order)
        return NormalResponse(
            q + steps[0], gradient + steps[1], rest.q_error + np.abs(steps[0]), rest.gradient_error + np.abs(steps[1])
        )
    rough = [slopes(cell, int(np.ceil(share * order))) for share in COARSER]
    q_error = np.max([np.abs(q - other) for other, _ in rough]) * np.array([1.0, 0.0, 1.0])
    gradient_error = np.max([np.abs(gradient - other) for _, other in rough], axis=0)
    gradient_error[[0, 2], 0] = gradient_error[:, 0].max()
    return NormalResponse(q, gradient, q_error, gradient_error)


def read_cells(path: str | Path, block: int = 1, blocks: int = 1) -> list[tuple[int, Metagrating]]:
    """Cells of a block, with their numbers; InputError names the line that holds none."""
    lines, out = read_lines(path), []
    if not lines:
        raise InputError(f"{path}: must hold a cell a line; it is empty")
    for number in range(block - 1, len(lines), blocks):
        with reading(f"{path}, line {number + 1}", "JSON"):
            data = json.loads(lines[number])
        cell = validate(data, Metagrating, f"{path}, line {number + 1}")
        as_stack(cell)  # refuses rounded corners before any cell is solved
        require_coherent(cell, "optics.local")
        out.append((number, cell))
    return out


def row(number: int, cell: Metagrating, order: int) -> dict[str, Any]:
    """One row of the file."""
    found = normal_response(cell, order)
    return {
        "cell": number,
        "q_g": found.q[0],
        "q_n": found.q[2],
        "q_g_u": found.gradient[0, 0],
        "q_n_u": found.gradient[2, 0],
        "absorptance": found.gradient[1, 1],
        "q_error": found.q_error[0],
        "gradient_error": found.gradient_error[0, 0],
        "absorptance_error": found.gradient_error[1, 1],
        "mean_thickness_m": cross_section(cell.model_dump()).mean_m,
        "wavelength_m": cell.wavelength_nm * 1e-9,
        "order": order,
        "resolved": bool(found.q_error[0] <= UNRESOLVED) and not without_limit(cell),
    }


OPTIONS = {
    "--cells": {"required": True, "help": "metagratings, one JSON a line"},
    "--block": {"default": "1/1", "metavar": "I/N", "help": "take every n-th cell, from the i-th on"},
    "--order": {"type": int, "default": ORDER, "help": "highest diffraction order (default %(default)s)"},
    "--out": {"required": True, "help": "Parquet file to write"},
}


def main() -> None:
    """Response of grating cells around normal incidence."""
    given = parser("optics.local", main.__doc__, OPTIONS).parse_args()
    take_out(given.out)
    if given.order < 1:
        raise InputError(f"--order = {given.order}: must be at least 1")
    cells = read_cells(given.cells, *part_of("--block", given.block))
    with threadpool_limits(1):
        rows = [row(number, cell, given.order) for number, cell in progress(cells, "cells", unit="cell")]
    stream = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, SCHEMA.with_metadata(as_attribute())), stream)
    write_parquet(given.out, stream.getvalue())
