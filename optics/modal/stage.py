"""Pressure tables of gratings by the Fourier modal method (`lamellar`): orders, directions and error chosen.

python -m optics.modal --cell workflow/designs/mark1e_te.yaml --out table.h5
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.arrays import Floats
from beamrider.io.arguments import table_arguments
from beamrider.io.files import Stopwatch, versions
from beamrider.machine_code.notice import compiling
from optics.cells.outline import Grating, polygons, read_grating
from optics.cells.schema import as_stack, is_coherent
from optics.modal.absorption import imbalance
from optics.modal.normal_incidence import normal_response
from optics.modal.quantities import OWN, apart, error_in_any, own_error, quantities
from optics.modal.response import Response as Response
from optics.modal.response import solve as solve
from optics.modal.steps import ModalCell, Slanted, modal_cell, source
from optics.modal.thick_fringes import least_thickness
from optics.modal.thick_tables import Found, find
from optics.modal.truncation import Chosen, Forces, choose, finer_rungs, propagating, rungs, with_order
from optics.modal.windows import first_directions, resonance_window, window_curves
from optics.refinement.forecast import MOST_MINUTES, announce, forecast, require_time
from optics.refinement.narrow_resonances import FINER, are_there, enough_orders, refine_with_resonances
from optics.refinement.regions import Refined, refine
from optics.refinement.samples import Solve, start
from optics.table.contents import PARITY, STOKES_PARITY, Cutoffs
from optics.table.normal_incidence import ATTRIBUTE
from optics.table.pressure_table import PressureTable
from optics.table.promise import finish, promised
from optics.waves.incidence import check_range
from optics.waves.incidence import cutoffs as rayleigh_cutoffs

#: What tables are made for where nothing else is asked for: error of q, largest direction cosines, those of 25°.
TOLERANCE, U_MAX = 1e-4, 0.4227
# Modes that reach the far side of their layer with less than this share of the tolerance are left out there.
_NEGLIGIBLE, _NOISE = 1e-2, 1e-5
_TOLD = 3  # of so many rows, and lines, one is solved with fewer orders, to tell the error of the orders
_WIDE = 75  # orders from which on even choosing their number takes minutes
_MARGIN = 3  # orders beyond those that run within the layers, to see whether there are resonances


@dataclass(frozen=True)
class _Solver:
    """Solves with so many orders, until `go_on` refuses."""

    chosen: Chosen
    order: int
    negligible: float
    go_on: Callable[[], None]

    def __call__(self, u: Floats, v: Floats) -> Floats:
        """Quantities (20, n_u, n_v) at u × v."""
        self.go_on()
        return quantities(self.chosen.solve(u, v, self.negligible, self.order))

    def each(self, u: Floats, v: Floats) -> Floats:
        """Quantities (20, n) at single directions u, v (n)."""
        self.go_on()
        return quantities(self.chosen.solve_each(u, v, self.negligible, self.order))[:, 0]


def layer_count(cell: ModalCell) -> int:
    """Layers or steps that the solution takes."""
    return cell.count if isinstance(cell, Slanted) else len(as_stack(cell).layers)


def choose_nodes(
    chosen: Chosen, u_max: float, v_max: float, tolerance: float, most_minutes: float = MOST_MINUTES
) -> tuple[Chosen, Refined]:
    """Directions and narrow resonances from which interpolation meets `tolerance`, solved with what was chosen.

    More orders, which are returned, where those don't suffice for the resonances: these move by more than their width.
    InputError where that is forecast to take longer than `most_minutes`.
    """
    cell, watch = chosen.cell, Stopwatch()
    window = resonance_window(cell, u_max, v_max)

    def go_on() -> None:
        require_time(watch.cpu_seconds, cell.name, most_minutes)

    chosen = chosen.within((u_max + window.reach, v_max), tolerance, go_on)
    negligible = min(_NEGLIGIBLE * tolerance, _NOISE)

    def solver(n: int) -> Solve:
        return _Solver(chosen, n, negligible, go_on)

    def scout(n: int) -> Solve:
        return _Solver(chosen.scout, n, negligible, go_on)

    u, v = first_directions(curves := window_curves(cell, u_max, v_max), u_max, v_max)
    layers = layer_count(cell)
    announce(forecast(solver(chosen.order), u, v, len(curves), chosen.order, layers), cell.name, most_minutes)
    parity = np.concatenate([PARITY, np.outer(STOKES_PARITY, PARITY).ravel()])
    name, measures = f"modal {cell.name}", (own_error, error_in_any)
    samples = start(solver(chosen.order), curves, u, v, parity, OWN)
    few = scout(chosen.order if chosen.fast else min(chosen.order, guided_order(cell, u_max) + _MARGIN))
    if not are_there(few, samples, window, tolerance, name):
        return chosen, refine(samples, tolerance, measures, name)
    order = enough_orders(scout, finer_rungs(chosen.order), samples, window, tolerance, name)
    if order > chosen.order:
        chosen = with_order(chosen, order)
        samples = start(solver(order), curves, u, v, parity, OWN)
    finer = solver(int(np.ceil(FINER * order)))
    return chosen, refine_with_resonances(samples, window, finer, tolerance, measures, name)


def guided_order(cell: ModalCell, u_max: float) -> int:
    """Highest order that may run in front or within the layers for |u| ≤ u_max."""
    every = [cell.surroundings.front**2, *(epsilon for _, epsilon in polygons(source(cell)))]
    return int(np.ceil((max(np.sqrt(complex(epsilon)).real for epsilon in every) + u_max) / cell.pitch))


def refuse_early(cell: Grating, u_max: float, v_max: float, most_minutes: float) -> None:
    """InputError where the fewest orders that may do, of a wide cell, would take too long: before any are tried."""
    few, order = modal_cell(cell, 8), rungs(cell, u_max)[0]
    if order > _WIDE:
        u, v = first_directions(curves := window_curves(few, u_max, v_max), u_max, v_max)
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
    thick = least_thickness(cell, u_max, v_max, tolerance)
    refuse_early(cell, u_max, v_max, most_minutes)
    chosen = choose(cell, u_max, v_max, tolerance, lambda: require_time(watch.cpu_seconds, cell.name, most_minutes))
    if np.isfinite(thick):
        chosen, table, reasons = _joined(find(chosen, thick, u_max, v_max, tolerance, most_minutes))
    else:
        chosen, refined = choose_nodes(chosen, u_max, v_max, tolerance, most_minutes)
        table, reasons = _sampled(chosen, refined, tolerance), (*chosen.reasons, *refined.reasons)
    settings = {"u_max": u_max, "v_max": v_max, "tolerance": tolerance, **chosen.settings}
    attrs = _attributes(cell, chosen, table.absorptance_nodes, settings) | table.attrs
    return promised(replace(table, attrs=attrs | {"cpu_seconds": watch.cpu_seconds}), tolerance, reasons)


def _attributes(cell: Grating, chosen: Chosen, absorptance: Floats, settings: dict[str, float]) -> dict[str, Any]:
    """What a table notes of how it was made."""
    around, u_max, v_max = cell.surroundings, settings["u_max"], settings["v_max"]
    lossless = around.back_k == 0 and all(epsilon.imag == 0 for _, epsilon in polygons(cell))
    few = u_max * np.array([-0.7, 0.013, 0.4]), v_max * np.array([0.5, 0.02, 0.9])
    lost = float(np.abs(absorptance).max())
    if not lossless:
        lost = imbalance(chosen.cell, *few, chosen.order) if is_coherent(cell) else max(0.0, -float(absorptance.min()))
    grazing = {x for n in (around.front, around.back) for x in rayleigh_cutoffs(cell.pitch, u_max, index=n)}
    return {
        "name": cell.name,
        "solver": "modal",
        "cell": cell.model_dump(),
        "wavelength_m": cell.wavelength_nm * 1e-9,
        "settings": settings,
        "cutoffs": sorted(grazing),
        "energy_imbalance": lost,
        **({ATTRIBUTE: normal_response(chosen.cell, chosen.order, chosen.half).as_dict()} if is_coherent(cell) else {}),
        "versions": versions("numpy", "scipy"),
    }


def _of_orders(chosen: Chosen, u: Floats, v: Floats, nodes: Forces, negligible: float) -> Floats:
    """Errors (2, n_u, n_v) from orders and slices at nodes u × v, told at some of them and linear between these."""
    some = [
        np.unique(np.linspace(0, x.size - 1, 1 + int(np.ceil((x.size - 1) / _TOLD))).round().astype(int))
        for x in (u, v)
    ]
    told = chosen.errors(u[some[0]], v[some[1]], Forces(*(part[np.ix_(*some)] for part in nodes)), negligible)
    along_u, along_v = (
        np.stack([np.interp(np.arange(x.size), at, row) for row in np.eye(at.size)], axis=1)
        for x, at in zip((u, v), some, strict=True)
    )
    return np.asarray(along_u @ np.stack(told) @ along_v.T)


def _sampled(chosen: Chosen, refined: Refined, tolerance: float) -> PressureTable:
    """A table that is interpolated."""
    found = refined.samples
    q, absorptance, q_stokes, absorptance_stokes = apart(found.nodes)
    nodes = Forces(np.moveaxis(q, 0, -1), np.moveaxis(q_stokes, (0, 1), (-2, -1)))
    error, error_stokes = refined.errors + _of_orders(chosen, found.u, found.v, nodes, _NEGLIGIBLE * tolerance)
    cutoffs = Cutoffs(found.curves, *apart(found.on_curves)) if len(found.curves) else None
    return PressureTable(
        found.u,
        found.v,
        q,
        absorptance,
        error,
        mirror_v=True,
        cutoffs=cutoffs,
        q_stokes=q_stokes,
        absorptance_stokes=absorptance_stokes,
        error_stokes=error_stokes,
        resonances=refined.resonances if refined.resonances.count else None,
    )


def _joined(found: Found) -> tuple[Chosen, PressureTable, tuple[str, ...]]:
    """A table of a grating on thick layers, and why it is not better."""
    samples = found.samples
    q, absorptance, q_stokes, absorptance_stokes = apart(found.nodes)
    cutoffs = Cutoffs(samples.curves, *apart(found.on_curves)) if len(samples.curves) else None
    table = PressureTable(
        samples.u,
        samples.v,
        q,
        absorptance,
        found.error,
        mirror_v=True,
        attrs={"between_nodes": "thick layers joined"},
        cutoffs=cutoffs,
        q_stokes=q_stokes,
        absorptance_stokes=absorptance_stokes,
        error_stokes=found.error_stokes,
        thick=found.thick,
    )
    return found.chosen, table, found.reasons


OPTIONS = {
    "--most-minutes": {
        "type": float,
        "default": MOST_MINUTES,
        "help": "refuse a table that is forecast to take more CPU time (default %(default)s)",
    },
}


def main() -> None:
    """Command line: see the module docstring."""
    what = "Pressure table of a grating by the Fourier modal method"
    arguments = table_arguments("optics.modal", what, TOLERANCE, U_MAX, options=OPTIONS)
    cell = read_grating(arguments.cell, arguments.wavelength_nm)
    check_range(cell.surroundings.front, arguments.u_max, arguments.v_max)
    with threadpool_limits(1), compiling("20 s, or a minute on thick layers") as spent:
        table = make_table(cell, arguments.u_max, arguments.v_max, arguments.tolerance, arguments.most_minutes)
    table.attrs["cpu_seconds"] -= spent.cpu_seconds
    finish(table, arguments.out, arguments.accept_missed)
