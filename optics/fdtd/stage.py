"""Pressure of a grating by FDTD (Meep): general, slow, and with an error estimate for every direction.

Two resolutions make a pair; errors fall with the square of the pixel, so Richardson's extrapolation (Richardson 1911,
Phil. Trans. A 210, 307) improves on both. How much the next pair changes of that tells the error, and Maxwell's stress
checks it; where it exceeds the tolerance (near resonances) a further resolution is run. Directions come from the modal
method (`optics.nodes`); without --nodes they are chosen by what FDTD itself finds, about twice as many. A killed run
goes on where it was.

    python -m optics.fdtd --cell workflow/designs/mark1e_te.yaml --nodes nodes.json --out table.h5
    python -m optics.fdtd --cell … --nodes nodes.json --part 3/8 --out part3.h5
    python -m optics.fdtd --cell … --nodes nodes.json --merge part*.h5 --out table.h5
    python -m optics.fdtd --cell … --out table.h5
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.arrays import Floats
from beamrider.io.arguments import part_of, table_arguments
from beamrider.io.checksum import fault
from beamrider.io.files import InputError, read_json, validate
from optics.cells.outline import Grating, read_grating
from optics.cells.schema import require_coherent
from optics.fdtd.adaptive import adapt
from optics.fdtd.direction import check_window, solve_direction
from optics.fdtd.grid import TABLE, FdtdSettings
from optics.fdtd.parts import Rows, block, merge, read_rows, write_rows
from optics.fdtd.progress import Progress, check_memory, expected_directions, spread
from optics.fdtd.run import import_meep
from optics.table.promise import finish
from optics.waves.incidence import check_range


def solve_rows(
    cell: Grating, directions: Floats, settings: FdtdSettings, path: Path, progress: Progress | None = None
) -> Rows:
    """Rows of `path` with those of `directions` (n, 2) of u, v; what it lacks is solved, each row written at once."""
    rows = read_rows(path, cell, settings) if path.exists() else Rows.empty()
    for u, v in directions[spread(len(directions))].tolist():
        if rows.find(u, v) is not None:
            continue
        if progress is None:
            result = solve_direction(cell, u, v, settings)
        else:
            progress.begin(u, v)
            result = solve_direction(cell, u, v, settings, progress.run)
            progress.end()
        rows = rows.added(u, v, result)
        write_rows(path, cell, settings, rows)
    return rows


def set_aside(path: Path) -> None:
    """Rename rows of an earlier run that are damaged, and say so: they are solved again."""
    if path.exists() and (found := fault(path)):
        aside = path.with_name(f"{path.name}.damaged")
        path.replace(aside)
        print(f"{path}: {found}; renamed to {aside.name}, and solved again", file=sys.stderr)


def lacking(cell: Grating, directions: Floats, settings: FdtdSettings, path: Path) -> Floats:
    """Those of `directions` (n, 2) that `path` does not hold."""
    rows = read_rows(path, cell, settings) if path.exists() else Rows.empty()
    return np.array([d for d in directions.tolist() if rows.find(*d) is None]).reshape(-1, 2)


def solve_part(cell: Grating, directions: Floats, settings: FdtdSettings, path: Path, what: str = "FDTD") -> Rows:
    """Like `solve_rows`, with progress; `path` ends with the rows of `directions` (n, 2) alone, in order."""
    with Progress(cell, settings, lacking(cell, directions, settings, path), f"{what} {cell.name}") as progress:
        rows = solve_rows(cell, directions, settings, path, progress).selected(directions)
    write_rows(path, cell, settings, rows)
    return rows


def solve_adaptively(
    cell: Grating, u_max: float, v_max: float, settings: FdtdSettings, path: Path
) -> tuple[Floats, Floats, float]:
    """Nodes u (n,), v (m,) chosen by what FDTD finds, the error between those in v; all their rows in `path`."""
    expected = lacking(cell, expected_directions(cell, u_max, v_max, (TABLE - 1) * settings.tolerance), settings, path)
    with Progress(cell, settings, expected, f"FDTD {cell.name}") as progress:

        def response(directions: Floats) -> Floats:
            rows = solve_rows(cell, directions, settings, path, progress).selected(directions)
            return np.stack([rows.column("q_g"), rows.column("q_n")], axis=-1)

        return adapt(response, u_max, v_max, (TABLE - 1) * settings.tolerance)


def read_nodes(path: str, cell: Grating) -> tuple[Floats, Floats, float | None]:
    """Nodes u (n_u), v (n_v) from a JSON file {'name', 'u', 'v'}, and the 'error' between them if it is known.

    InputError says what is wrong with it.
    """
    if not Path(path).exists():
        raise InputError(f"{path}: no such file; make it with python -m optics.nodes")
    data = read_json(path, needed=False)
    try:
        u, v = np.array(data["u"], float), np.array(data["v"], float)
        error = None if data.get("error") is None else float(data["error"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: must hold the lists 'u' and 'v' ({type(error).__name__}: {error})") from None
    if data.get("name", cell.name) != cell.name:
        raise InputError(f"{path}: name = {data['name']!r}: made for another cell than '{cell.name}'")
    for name, nodes in (("u", u), ("v", v)):
        if nodes.ndim != 1 or nodes.size < 2 or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0):
            raise InputError(f"{path}: {name}: must be a list of at least 2 ascending numbers")
    if v[0] != 0:
        raise InputError(f"{path}: v[0] = {v[0]:g}: must be 0 (v → −v is a mirror)")
    if error is not None and not (np.isfinite(error) and error >= 0):
        raise InputError(f"{path}: error = {error:g}: must be at least 0")
    return u, v, error


def _checked_nodes(path: str, cell: Grating) -> tuple[Floats, Floats, float | None]:
    """Nodes from a file, if their whole range can be solved: told before the first direction is."""
    u, v, error = read_nodes(path, cell)
    check_window(cell, u, v)
    return u, v, error


OPTIONS: dict[str, Any] = {
    "--nodes": "JSON file of the directions, from python -m optics.nodes",
    "--part": {"metavar": "I/N", "help": "solve the i-th of n blocks of the directions only, as in 3/8"},
    "--merge": {"nargs": "+", "metavar": "PART", "help": "make the table from these part files"},
}


def _table(cell: Grating, settings: FdtdSettings, arguments: argparse.Namespace, out: Path) -> None:
    """Solve everything and write the table; the rows are kept beside it until it is written."""
    rows = out.with_name(f"{out.name}.rows.h5")
    set_aside(rows)
    nodes: tuple[Floats, Floats, float | None]
    if arguments.nodes:
        nodes = _checked_nodes(arguments.nodes, cell)
        solve_part(cell, block(*nodes[:2], 1, 1), settings, rows)
    else:
        check_window(cell, arguments.u_max * np.array([-1.0, 1.0]), np.array([0.0, arguments.v_max]))
        nodes = solve_adaptively(cell, arguments.u_max, arguments.v_max, settings, rows)
    table = merge(cell, settings, *nodes, [rows])
    table.write(out)  # only then are the rows of no more use
    rows.unlink()
    finish(table, out, arguments.accept_missed)


def main() -> None:
    """Command line: see the module docstring."""
    arguments = table_arguments("optics.fdtd", "Pressure table by FDTD (Meep)", 1e-2, 0.18, options=OPTIONS)
    out = Path(arguments.out)
    cell = read_grating(arguments.cell, arguments.wavelength_nm)
    require_coherent(cell, "optics.fdtd")
    check_range(cell.surroundings.front, arguments.u_max, arguments.v_max)
    settings = validate({"tolerance": arguments.tolerance / TABLE}, FdtdSettings, "command line")
    if (arguments.part or arguments.merge) and not arguments.nodes:
        raise InputError("--part and --merge need --nodes, the file of all directions; make it with optics.nodes")
    if arguments.merge:
        parts = [Path(part) for part in arguments.merge]
        finish(merge(cell, settings, *read_nodes(arguments.nodes, cell), parts), out, arguments.accept_missed)
        return
    import_meep()
    check_memory(cell, settings)
    with threadpool_limits(1):
        if not arguments.part:
            _table(cell, settings, arguments, out)
            return
        i, n = part_of("--part", arguments.part)
        directions = block(*_checked_nodes(arguments.nodes, cell)[:2], i, n)
        set_aside(out)
        solve_part(cell, directions, settings, out, f"part {i}/{n} of FDTD")
