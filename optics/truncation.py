"""How many diffraction orders a table needs, and the error that is left: the truncation of the modal method."""

from __future__ import annotations

import numpy as np

from optics.cells import LamellarStack, Metagrating
from optics.files import InputError
from optics.incidence import Floats, worst_polarisation
from optics.lamellar import solve

_LADDER = (8, 10, 12, 15, 18, 22, 27, 33, 40, 50, 60, 75, 100, 125, 150)
_SEEN = 0.6


def propagating(cell: Metagrating | LamellarStack, u_max: float) -> int:
    """Highest diffraction order that may leave the cell for |u| ≤ u_max; InputError beyond what can be solved."""
    reach = max(cell.surroundings.front, cell.surroundings.back) + u_max
    if reach > _LADDER[-3] * cell.pitch:
        raise InputError(
            f"{cell.name}: period_nm = {cell.period_nm:g}: must be at most "
            f"{_LADDER[-3] * cell.wavelength_nm / reach:g}; more than ±{_LADDER[-3]} diffraction orders would propagate"
        )
    return int(reach / cell.pitch)


def choose_order(cell: Metagrating | LamellarStack, u: Floats, v: Floats, tolerance: float) -> int:
    """Fewest orders whose error is below `tolerance` at 95 % of u × v.

    It is seen against 1.5 times as many orders (the next but one step), which still have 0.4 of it, as N⁻² falls.
    """
    least = propagating(cell, float(np.abs(u).max()))
    results: dict[int, Floats] = {}
    for order, finer in zip(_LADDER, _LADDER[2:], strict=False):
        if order < least:
            continue
        for n in (order, finer):
            if n not in results:
                results[n] = solve(cell, u, v, n).q
        if np.quantile(np.abs(results[order] - results[finer]).max(axis=-1), 0.95) <= _SEEN * tolerance:
            return order
    raise InputError(f"tolerance = {tolerance:g}: not reached with ±{_LADDER[-3]} diffraction orders; allow more")


def order_error(
    cell: Metagrating | LamellarStack, u: Floats, v: Floats, order: int, q: Floats, q_stokes: Floats
) -> tuple[Floats, Floats]:
    """Estimated error (n_u, n_v) from truncation at `order` of q (n_u, n_v, 3), and of q_stokes (n_u, n_v, 4, 3).

    The first is that in the cell's own polarisation, the second the largest in any. Half the changes from 0.7 and 0.6
    of the orders and a quarter from half. Errors fall between N⁻² and N⁻³,
    with beats that depend on where the ridges lie: each change is one to seven times the error of `order`, but any one
    of them may vanish. `workflow/benchmarks/error_estimate.py` shows how often the sum covers the error.
    """
    own, every = np.full((2, u.size, v.size), 1e-13)
    for share, weight in ((0.7, 0.5), (0.6, 0.5), (0.5, 0.25)):
        coarser = solve(cell, u, v, int(np.ceil(share * order)))
        own += weight * np.abs(coarser.q - q).max(axis=-1)
        every += weight * worst_polarisation(np.moveaxis(coarser.q_stokes - q_stokes, -2, 0)).max(axis=-1)
    return own, every
