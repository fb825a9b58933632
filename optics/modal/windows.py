"""The window of directions of a table: its cut-offs, where resonances are looked for, and the first directions."""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Floats
from optics.cells.schema import as_stack
from optics.modal.steps import ModalCell, Slanted
from optics.refinement.regions import first_lines
from optics.table.resonances import Window
from optics.table.strips import Curves, breaks, rayleigh_curves

BEYOND = 0.05  # resonances whose u is further outside of a table than this are not felt within
_MOST_INDICES = 2
# The first rows in u and lines in v² are no further apart: narrower resonances may be missed.
_FIRST_STEP = 0.0112
_FEWEST_ROWS, _FEWEST_LINES = 17, 6


def window_curves(cell: ModalCell, u_max: float, v_max: float) -> Curves:
    """Cut-offs within the window, of both half-spaces."""
    # Where a half-space carries no waves at the largest v its cut-offs close within the table: left to refinement.
    layers = [] if isinstance(cell, Slanted) else as_stack(cell).layers
    thick = {layer.index.n for layer in layers if not layer.coherent}
    around = {cell.surroundings.front, cell.surroundings.back}
    # Orders appear in thick layers as in half-spaces. A table holds cut-offs of two indices.
    indices = tuple(n for n in (around | thick if len(around | thick) <= _MOST_INDICES else around) if n > v_max)
    return rayleigh_curves(cell.pitch, indices, -u_max, u_max, v_max)


def resonance_window(cell: ModalCell, u_max: float, v_max: float) -> Window:
    """Where resonances are looked for: somewhat beyond the table."""
    reach = min(BEYOND, 0.9 * (float(np.sqrt(cell.surroundings.front**2 - v_max**2)) - u_max))
    return Window(-u_max, u_max, reach, window_curves(cell, u_max + reach, v_max))


def first_directions(curves: Curves, u_max: float, v_max: float, step: float = _FIRST_STEP) -> tuple[Floats, Floats]:
    """Rows u (n_u,) and lines v (n_v,) that a table with these cut-offs begins with, `step` apart in u and in v²."""
    u = np.linspace(-u_max, u_max, max(_FEWEST_ROWS, 1 + 2 * int(np.ceil(u_max / step))))
    # Strips between neighbouring cut-offs may be narrower than the rows are apart: they get rows of their own.
    edges = np.sort(curves.u(np.zeros(1))[:, 0])
    within = np.concatenate([edges[:-1] + share * np.diff(edges) for share in (0.25, 0.5, 0.75)])
    u = np.unique(np.concatenate([u, within[np.abs(within) < u_max]]))
    lines = max(_FEWEST_LINES, int(np.ceil(v_max**2 / step)))
    return u, first_lines(breaks(curves, -u_max, u_max, v_max), lines)
