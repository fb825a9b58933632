"""Pressure tables of gratings by the Fourier modal method (`optics.lamellar`): orders, directions and error chosen.

python -m optics.modal --cell workflow/designs/mark1e_te.yaml --out table.h5
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from optics.cells import Metagrating, read_metagrating
from optics.command import check_range, table_arguments
from optics.files import InputError, Stopwatch, progress, run_stage, versions
from optics.incidence import Floats, cutoffs
from optics.lamellar import Response as Response
from optics.lamellar import solve as solve
from optics.local import normal_response
from optics.normal import ATTRIBUTE
from optics.sampling import Refined, refine, spread
from optics.table import PressureTable

_LADDER = (8, 10, 12, 15, 18, 22, 27, 33, 40, 50, 60, 75, 100, 125, 150)
_SEEN = 0.6
_SCOUT_ORDER = 12
_SMALLEST_STEP = 5e-4


def _flat(response: Response) -> Floats:
    """Q and absorptance (n_u, 4 n_v): one row a u."""
    values = np.concatenate([response.q, response.absorptance[..., None]], axis=-1)
    return values.reshape(values.shape[0], -1)


@dataclass(frozen=True)
class _Grid:
    """Nodes u (n_u), v (n_v) of a table and the interpolation error (n_u, n_v) to expect around them."""

    u: Floats
    v: Floats
    error: Floats


def _along(refined: Refined, lines: Floats, at: Floats) -> Floats:
    """Error of q (n_nodes, n_at): of the sampled line nearest to each of `at`."""
    error = refined.error.reshape(refined.nodes.size, lines.size, 4)[..., :3].max(axis=-1)
    return np.asarray(error[:, np.abs(lines[:, None] - at).argmin(axis=0)])


def choose_nodes(cell: Metagrating, u_max: float, v_max: float, tolerance: float) -> _Grid:
    """Nodes in u and in v ≥ 0 at which interpolation meets `tolerance`, found with a modest number of orders.

    Rayleigh cut-offs at v = 0 are nodes; away from it they run along circles through the grid, where `refine` stops at
    a smallest step and reports the error that is left.
    """
    lines_v = v_max * np.array([0.0, 0.37, 0.71, 1.0])
    front = cell.surroundings.front
    start = spread(u_max, max(u_max / 16, 1e-3), cutoffs(cell.pitch, u_max, index=front))
    u = refine(lambda x: _flat(solve(cell, x, lines_v, _SCOUT_ORDER)), start, tolerance, _SMALLEST_STEP)
    lines_u = u.nodes[:: max(1, u.nodes.size // 12)]

    def over_v(x: Floats) -> Floats:
        response = solve(cell, lines_u, x, _SCOUT_ORDER)
        return _flat(Response(*(np.swapaxes(part, 0, 1) for part in vars(response).values())))

    v = refine(over_v, np.linspace(0.0, v_max, 9), tolerance, 24 * _SMALLEST_STEP)
    error = np.hypot(_along(u, lines_v, v.nodes), _along(v, lines_u, u.nodes).T)
    return _Grid(u.nodes, v.nodes, error)


def choose_order(cell: Metagrating, u: Floats, v: Floats, tolerance: float) -> int:
    """Fewest orders whose error is below `tolerance` at 95 % of u × v.

    It is seen against 1.5 times as many orders (the next but one step), which still have 0.4 of it, as N⁻² falls.
    """
    results: dict[int, Floats] = {}
    for order, finer in zip(_LADDER, _LADDER[2:], strict=False):
        for n in (order, finer):
            if n not in results:
                results[n] = solve(cell, u, v, n).q
        if np.quantile(np.abs(results[order] - results[finer]).max(axis=-1), 0.95) <= _SEEN * tolerance:
            return order
    raise InputError(f"tolerance = {tolerance:g}: not reached with ±{_LADDER[-3]} diffraction orders; allow more")


def order_error(cell: Metagrating, u: Floats, v: Floats, order: int, q: Floats) -> Floats:
    """Estimated error (n_u, n_v) of q from truncation, from what fewer orders give.

    Half the changes from 0.7 and 0.6 of the orders and a quarter from half. Errors fall between N⁻² and N⁻³,
    with beats that depend on where the ridges lie: each change is one to seven times the error of `order`, but any one
    of them may vanish. `workflow/benchmarks/error_estimate.py` shows how often the sum covers the error.
    """
    coarser = [(0.5, 0.7), (0.5, 0.6), (0.25, 0.5)]
    changes = [
        weight * np.abs(solve(cell, u, v, int(np.ceil(share * order))).q - q).max(axis=-1) for weight, share in coarser
    ]
    return np.asarray(sum(changes) + 1e-13)


def make_table(cell: Metagrating, u_max: float, v_max: float, tolerance: float) -> PressureTable:
    """Pressure table over |u| ≤ u_max, |v| ≤ v_max, its orders and directions chosen for an error near `tolerance`."""
    watch = Stopwatch()
    grid = choose_nodes(cell, u_max, v_max, tolerance)
    order = choose_order(cell, grid.u[:: max(1, grid.u.size // 24)], v_max * np.array([0.0, 0.5, 1.0]), tolerance)
    blocks = np.array_split(grid.u, max(1, grid.u.size // 8))
    rows = [solve(cell, block, grid.v, order) for block in progress(blocks, f"modal {cell.name}", unit="block")]
    q, absorptance = (np.concatenate([getattr(row, name) for row in rows]) for name in ("q", "absorptance"))
    error = order_error(cell, grid.u, grid.v, order, q) + grid.error
    lossless = cell.index.k == 0
    attrs = {
        "name": cell.name, "solver": "modal", "cell": cell.model_dump(), "wavelength_m": cell.wavelength_nm * 1e-9,
        "settings": {"u_max": u_max, "v_max": v_max, "tolerance": tolerance, "orders": order},
        "cutoffs": cutoffs(cell.pitch, u_max, index=cell.surroundings.front),
        "energy_imbalance": float(np.abs(absorptance).max()) if lossless else float(max(0.0, -absorptance.min())),
        ATTRIBUTE: normal_response(cell, order).as_dict(),
        "wall_seconds": watch.seconds, "versions": versions("numpy", "scipy"),
    }
    return PressureTable(grid.u, grid.v, np.moveaxis(q, -1, 0), absorptance, error, mirror_v=True, attrs=attrs)


def main() -> None:
    """Command line: see the module docstring."""
    arguments = table_arguments("optics.modal", "Pressure table of a grating by the Fourier modal method", 1e-4, 0.4227)
    cell = read_metagrating(arguments.cell)
    check_range(cell.surroundings.front, arguments.u_max, arguments.v_max)
    with threadpool_limits(1):
        make_table(cell, arguments.u_max, arguments.v_max, arguments.tolerance).write(arguments.out)


if __name__ == "__main__":
    run_stage(main)
