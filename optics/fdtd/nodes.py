"""Which directions FDTD should solve: found with the modal solver, which knows where the resonances are.

python -m optics.nodes --cell workflow/designs/mark1e_te.yaml --out nodes.json
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from threadpoolctl import threadpool_limits

from beamrider.io.arguments import table_arguments
from beamrider.io.files import write_json
from optics.cells.outline import Grating, read_grating, upright
from optics.modal.response import solve
from optics.modal.truncation import propagating
from optics.refinement.directions import choose_nodes, fill
from optics.waves.incidence import check_range

_SPACING = 0.002
_ORDER = 12


def fdtd_nodes(cell: Grating, u_max: float, v_max: float, tolerance: float) -> dict[str, object]:
    """Tensor nodes from which interpolation of the modal response meets `tolerance`: {'name', 'u', 'v', …}.

    'error' is what that interpolation misses of the modal response, which it was chosen by: FDTD's is as hard.
    """
    u = np.linspace(-u_max, u_max, 2 * int(np.ceil(u_max / _SPACING)) + 1)
    v = np.linspace(0.0, v_max, 13)
    stack = upright(cell)
    q = solve(stack, u, v, max(_ORDER, propagating(stack, u_max))).q[..., [0, 2]]
    u_nodes, v_nodes = choose_nodes(u, v, q, tolerance)
    at_nodes = CubicSpline(v, q[np.isin(u, u_nodes)], axis=1)(v_nodes)
    error = float(np.abs(fill(u_nodes, v_nodes, at_nodes, u, v) - q).max())
    return {"name": cell.name, "u": u_nodes.tolist(), "v": v_nodes.tolist(), "tolerance": tolerance, "error": error}


def main() -> None:
    """Command line: see the module docstring."""
    arguments = table_arguments("optics.nodes", "Directions for FDTD to solve", 1e-2, 0.18)
    cell = read_grating(arguments.cell, arguments.wavelength_nm)
    check_range(cell.surroundings.front, arguments.u_max, arguments.v_max)
    with threadpool_limits(1):
        write_json(arguments.out, fdtd_nodes(cell, arguments.u_max, arguments.v_max, arguments.tolerance))
