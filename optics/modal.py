"""Pressure tables of gratings by the Fourier modal method (`optics.lamellar`): orders, directions and error chosen.

python -m optics.modal --cell workflow/designs/mark1e_te.yaml --out table.h5
"""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_limits

from optics.absorption import imbalance
from optics.cells import as_stack, is_coherent
from optics.command import check_range, table_arguments
from optics.compiling import compiling
from optics.files import Stopwatch, run_stage, versions
from optics.forecast import MOST_MINUTES, announce, forecast, require_time
from optics.incidence import Floats, worst_polarisation
from optics.incidence import cutoffs as rayleigh_cutoffs
from optics.lamellar import Response as Response
from optics.lamellar import solve as solve
from optics.local import normal_response
from optics.membranes import check_fringes
from optics.narrow import FINER, are_there, enough_orders, refine_with_resonances
from optics.normal import ATTRIBUTE
from optics.outline import Grating, polygons, read_grating
from optics.promise import finish, promised
from optics.refinement import Refined, first_lines, refine
from optics.resonances import Window
from optics.samples import Solve, start
from optics.steps import ModalCell, Slanted, modal_cell, source
from optics.strips import Curves, breaks, rayleigh_curves
from optics.table import PARITY, STOKES_PARITY, Cutoffs, PressureTable
from optics.truncation import Chosen, Forces, choose, finer_rungs, propagating, rungs, with_order

# Modes that reach the far side of their layer with less than this share of the tolerance are left out there.
_NEGLIGIBLE, _NOISE = 1e-2, 1e-5
_BEYOND = 0.05  # resonances whose u is further outside of a table than this are not felt within
_WIDE = 75  # orders from which on even choosing their number takes minutes
_MOST_INDICES = 2
_MARGIN = 3  # orders beyond those that run within the layers, to see whether there are resonances
# The first rows in u and lines in v² are no further apart: narrower resonances may be missed.
_FIRST_STEP = 0.0112
_FEWEST_ROWS, _FEWEST_LINES = 17, 6
_OWN = 4  # quantities of the cell's own polarisation, which the directions are chosen for


def _quantities(response: Response) -> Floats:
    """Q and absorptance (20, n_u, n_v): of the cell's own polarisation, then of the four Stokes components."""
    own = np.concatenate([response.q, response.absorptance[..., None]], axis=-1)
    stokes = np.concatenate([response.q_stokes, response.absorptance_stokes[..., None]], axis=-1)
    every = np.concatenate([own[:, :, None], stokes], axis=2)
    return np.moveaxis(every.reshape(*every.shape[:2], -1), -1, 0)


def _apart(quantities: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Q (3, ...), absorptance (...), q_stokes (4, 3, ...), absorptance_stokes (4, ...) of `_quantities` (20, ...)."""
    every = quantities.reshape(5, 4, *quantities.shape[1:])
    return every[0, :3], every[0, 3], every[1:, :3], every[1:, 3]


def _own_error(differences: Floats) -> Floats:
    """Largest error (...) in the cell's own polarisation of `_quantities` (20, ...)."""
    return np.asarray(np.abs(differences[:_OWN]).max(axis=0))


def _error_in_any(differences: Floats) -> Floats:
    """Largest error (...) in any polarisation of `_quantities` (20, ...)."""
    parts = differences[_OWN:].reshape(4, 4, *differences.shape[1:])
    return np.asarray(worst_polarisation(parts).max(axis=0))


def layer_count(cell: ModalCell) -> int:
    """Layers or steps that the solution takes."""
    return cell.count if isinstance(cell, Slanted) else len(as_stack(cell).layers)


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
    reach = min(_BEYOND, 0.9 * (float(np.sqrt(cell.surroundings.front**2 - v_max**2)) - u_max))
    return Window(-u_max, u_max, reach, window_curves(cell, u_max + reach, v_max))


def first_directions(cell: ModalCell, u_max: float, v_max: float) -> tuple[Curves, Floats, Floats]:
    """Cut-offs, rows u and lines v that a table begins with."""
    curves = window_curves(cell, u_max, v_max)
    u = np.linspace(-u_max, u_max, max(_FEWEST_ROWS, 1 + 2 * int(np.ceil(u_max / _FIRST_STEP))))
    # Strips between neighbouring cut-offs may be narrower than the rows are apart: they get rows of their own.
    edges = np.sort(curves.u(np.zeros(1))[:, 0])
    within = np.concatenate([edges[:-1] + share * np.diff(edges) for share in (0.25, 0.5, 0.75)])
    u = np.unique(np.concatenate([u, within[np.abs(within) < u_max]]))
    lines = max(_FEWEST_LINES, int(np.ceil(v_max**2 / _FIRST_STEP)))
    return curves, u, first_lines(breaks(curves, -u_max, u_max, v_max), lines)


def choose_nodes(
    chosen: Chosen, u_max: float, v_max: float, tolerance: float, most_minutes: float = MOST_MINUTES
) -> tuple[Chosen, Refined]:
    """Directions and narrow resonances from which interpolation meets `tolerance`, solved with what was chosen.

    More orders, which are returned, where those don't suffice for the resonances: these move by more than their width.
    InputError where that is forecast to take longer than `most_minutes`.
    """
    cell = chosen.cell

    watch = Stopwatch()

    def solver(n: int, scout: bool = False) -> Solve:
        negligible = min(_NEGLIGIBLE * tolerance, _NOISE)

        def at(u: Floats, v: Floats) -> Floats:
            require_time(watch.cpu_seconds, cell.name, most_minutes)
            found = chosen.scout(u, v, n, negligible) if scout else chosen.solve(u, v, negligible, n)
            return _quantities(found)

        return at

    def scout(n: int) -> Solve:
        return solver(n, scout=True)

    curves, u, v = first_directions(cell, u_max, v_max)
    layers = layer_count(cell)
    announce(forecast(solver(chosen.order), u, v, len(curves), chosen.order, layers), cell.name, most_minutes)
    parity = np.concatenate([PARITY, np.outer(STOKES_PARITY, PARITY).ravel()])
    name, measures = f"modal {cell.name}", (_own_error, _error_in_any)
    samples, window = start(solver(chosen.order), curves, u, v, parity, _OWN), resonance_window(cell, u_max, v_max)
    few = scout(min(chosen.order, _guided(cell, u_max) + _MARGIN))
    if not are_there(few, samples, window, tolerance, name):
        return chosen, refine(samples, tolerance, measures, name)
    order = enough_orders(scout, finer_rungs(chosen.order), samples, window, tolerance, name)
    if order > chosen.order:
        chosen = with_order(chosen, order)
        samples = start(solver(order), curves, u, v, parity, _OWN)
    finer = solver(int(np.ceil(FINER * order)))
    return chosen, refine_with_resonances(samples, window, finer, tolerance, measures, name)


def _guided(cell: ModalCell, u_max: float) -> int:
    """Highest order that may run within the layers for |u| ≤ u_max."""
    every = [1.0, *(epsilon for _, epsilon in polygons(source(cell)))]
    return int(np.ceil((max(np.sqrt(complex(epsilon)).real for epsilon in every) + u_max) / cell.pitch))


def refuse_early(cell: Grating, u_max: float, v_max: float, most_minutes: float) -> None:
    """InputError where the fewest orders that may do, of a wide cell, would take too long: before any are tried."""
    few, order = modal_cell(cell, 8), rungs(cell, u_max)[0]
    if order > _WIDE:
        curves, u, v = first_directions(few, u_max, v_max)
        at_least = forecast(lambda x, y: solve(few, x, y, order), u, v, len(curves), order, layer_count(few))
        announce(at_least, cell.name, most_minutes)


def make_table(
    cell: Grating, u_max: float, v_max: float, tolerance: float, most_minutes: float = MOST_MINUTES
) -> PressureTable:
    """Pressure table over |u| ≤ u_max, |v| ≤ v_max; its orders, slices and directions follow from `tolerance`.

    InputError where it is forecast to take longer than `most_minutes`.
    """
    watch = Stopwatch()
    propagating(cell, u_max)
    check_fringes(cell, u_max, v_max, tolerance)
    refuse_early(cell, u_max, v_max, most_minutes)
    chosen = choose(
        cell, u_max, v_max, tolerance, lambda: require_time(watch.cpu_seconds, cell.name, most_minutes)
    )
    chosen, refined = choose_nodes(chosen, u_max, v_max, tolerance, most_minutes)
    found = refined.samples
    q, absorptance, q_stokes, absorptance_stokes = _apart(found.nodes)
    nodes = Forces(np.moveaxis(q, 0, -1), np.moveaxis(q_stokes, (0, 1), (-2, -1)))
    error, error_stokes = refined.errors + chosen.errors(found.u, found.v, nodes, _NEGLIGIBLE * tolerance)
    cutoffs = Cutoffs(found.curves, *_apart(found.on_curves)) if len(found.curves) else None
    around = cell.surroundings
    lossless = around.back_k == 0 and all(epsilon.imag == 0 for _, epsilon in polygons(cell))
    few = u_max * np.array([-0.7, 0.013, 0.4]), v_max * np.array([0.5, 0.02, 0.9])
    lost = float(np.abs(absorptance).max())
    if not lossless:
        lost = imbalance(chosen.cell, *few, chosen.order) if is_coherent(cell) else max(0.0, -float(absorptance.min()))
    grazing = {x for n in (around.front, around.back) for x in rayleigh_cutoffs(cell.pitch, u_max, index=n)}
    attrs = {
        "name": cell.name, "solver": "modal", "cell": cell.model_dump(), "wavelength_m": cell.wavelength_nm * 1e-9,
        "settings": {"u_max": u_max, "v_max": v_max, "tolerance": tolerance, **chosen.settings},
        "cutoffs": sorted(grazing),
        "energy_imbalance": lost,
        **({ATTRIBUTE: normal_response(chosen.cell, chosen.order, chosen.half).as_dict()} if is_coherent(cell) else {}),
        "cpu_seconds": watch.cpu_seconds, "versions": versions("numpy", "scipy"),
    }
    table = PressureTable(
        found.u, found.v, q, absorptance, error, True, False, attrs, cutoffs, q_stokes, absorptance_stokes,
        error_stokes, resonances=refined.resonances if refined.resonances.count else None,
    )
    return promised(table, tolerance, (*chosen.reasons, *refined.reasons))


def main() -> None:
    """Command line: see the module docstring."""
    what = "Pressure table of a grating by the Fourier modal method"
    arguments = table_arguments("optics.modal", what, 1e-4, 0.4227, most_minutes=MOST_MINUTES)
    cell = read_grating(arguments.cell, arguments.wavelength_nm)
    check_range(cell.surroundings.front, arguments.u_max, arguments.v_max)
    with threadpool_limits(1), compiling("20 s") as spent:
        table = make_table(cell, arguments.u_max, arguments.v_max, arguments.tolerance, arguments.most_minutes)
    table.attrs["cpu_seconds"] -= spent.cpu_seconds
    finish(table, arguments.out, arguments.accept_missed)


if __name__ == "__main__":
    run_stage(main)
