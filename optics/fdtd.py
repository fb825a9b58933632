"""Pressure of a grating by FDTD (Meep): general, slow, and with an error estimate for every direction.

Two resolutions make a pair; errors fall with the square of the pixel, so Richardson's extrapolation (Richardson 1911,
Phil. Trans. A 210, 307) improves on both. How much the next pair changes of that tells the error; where it exceeds the
tolerance (near resonances) a further resolution is run.

    python -m optics.fdtd --cell workflow/designs/mark1e_te.yaml --out table.h5
    python -m optics.fdtd --cell … --nodes nodes.json --part 3/8 --out part3.h5
    python -m optics.fdtd --cell … --nodes nodes.json --merge part*.h5 --out table.h5
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from optics.cells import Surroundings
from optics.command import add_table_arguments, check_range, checked
from optics.fdtd_grid import FdtdSettings, pixels
from optics.fdtd_parts import Rows, block, merge, read_rows, write_rows
from optics.fdtd_run import Decay, Efficiencies, efficiencies, import_meep
from optics.files import InputError, Stopwatch, progress, run_stage, validate
from optics.incidence import Floats, order_cosines, wave_vector
from optics.momentum import pressure
from optics.outline import Grating, polygons, read_grating
from optics.sampling import chebyshev, even_nodes

# No direction is better than this, whatever two resolutions say: what absorbers and the rest of the pulse leave.
_ERROR_FLOOR = 2e-4
_GRAZING = 0.1
# Extrapolation triples what is missing of either resolution (2 b − a for a ratio of √2).
_RESIDUAL_SHARE = 3.0


@dataclass(frozen=True)
class DirectionResult:
    """One direction solved.

    q (3,) in (g, r, n); absorptance; error: estimated absolute error of q (> 0); energy_imbalance: 1 − R − T of the
    finest run (minus what the material absorbs, if that was solved for); stress: largest difference of q_g and q_n from
    those by Meep's stress monitors; residual: relative change of the fields that was still to come when the run was
    stopped; capped: it was stopped by the longest time allowed; resolutions: pixels per µm used; grazing: smallest |w|
    of any order.
    """

    q: Floats
    absorptance: float
    error: float
    energy_imbalance: float
    stress: float
    residual: float
    capped: bool
    seconds: float
    resolutions: tuple[float, ...]
    grazing: float


def check_cell(cell: Grating, u: float, v: float) -> None:
    """Refuse what this solver can't do."""
    if cell.surroundings != Surroundings():
        raise InputError(f"{cell.name}: surroundings = {cell.surroundings}: FDTD takes vacuum (1.0) on both sides")
    for _, epsilon in polygons(cell):
        if epsilon.real < 1:
            raise InputError(
                f"{cell.name}: index: permittivity {epsilon:.4g}: FDTD at one frequency is stable for a real part of 1 "
                "or more; take optics.modal for metals"
            )
    if not u**2 + v**2 < 1:
        raise InputError(f"{cell.name}: direction u = {u:g}, v = {v:g} is evanescent: u² + v² must be below 1")


def grazing(cell: Grating, u: float, v: float) -> float:
    """Smallest |w| of the diffraction orders: absorbers take light or near fields at less than ~0.1 badly."""
    most = int(np.ceil(2 / cell.pitch))
    return float(np.abs(order_cosines(u, v, cell.pitch, np.arange(-most, most + 1))[1]).min())


def _values(u: float, v: float, result: Efficiencies) -> tuple[Floats, float]:
    """[q_g, q_n, absorptance, and q_g, q_n from the stress] (5,) and 1 − R − T.

    The absorptance of weak absorption comes from the field energy.
    """
    w = wave_vector(u, v)[2]
    q, lost = pressure(u, v, w, result.u_m, result.w_m, result.w_m, result.reflected, result.transmitted)
    weak = np.isfinite(result.absorptance)
    absorptance = result.absorptance if weak else float(lost)
    return np.array([q[0], q[2], absorptance, *result.stress]), float(lost) if weak else 0.0


def solve_direction(cell: Grating, u: float, v: float, settings: FdtdSettings) -> DirectionResult:
    """Solve one direction with rising resolution until the error estimated meets the tolerance."""
    check_cell(cell, u, v)
    watch = Stopwatch()
    done: list[tuple[int, Floats]] = []
    decay = Decay(0.0, False)
    for resolution in settings.resolutions_per_um:
        result = efficiencies(cell, u, v, resolution, settings)
        decay = decay.worse(result.decay)
        _refuse_ringing(cell, u, v, result.decay, settings)
        values, imbalance = _values(u, v, result)
        done.append((pixels(cell, resolution), values))
        if len(done) < min(3, len(settings.resolutions_per_um)):
            continue
        best, error = estimate(done)
        error += _RESIDUAL_SHARE * decay.residual
        if error <= settings.tolerance:
            break
    return DirectionResult(
        q=np.array([best[0], v * best[2], best[1]]), absorptance=float(best[2]), error=error,
        energy_imbalance=imbalance, stress=float(np.abs(best[:2] - best[3:]).max()), residual=decay.residual,
        capped=decay.capped, seconds=watch.seconds, resolutions=tuple(n / cell.period_nm * 1000 for n, _ in done),
        grazing=grazing(cell, u, v),
    )


def _refuse_ringing(cell: Grating, u: float, v: float, decay: Decay, settings: FdtdSettings) -> None:
    """InputError where a run was cut off so early that what it misses exceeds the tolerance."""
    if decay.capped and _RESIDUAL_SHARE * decay.residual > settings.tolerance:
        raise InputError(
            f"{cell.name} at u = {u:g}, v = {v:g}: the fields still ring after {settings.longest:g} periods (longest): "
            f"residual {decay.residual:.2g}, allowed {settings.tolerance / _RESIDUAL_SHARE:.2g}; a sharp resonance: "
            "raise 'longest', or use optics.modal"
        )


def estimate(done: Sequence[tuple[int, Floats]]) -> tuple[Floats, float]:
    """Extrapolated value (k,) of the finest of two or more (pixels, values), and the error of the first two of them.

    Of one pair the error is taken to be the correction that it applies. From three resolutions on it is half of the
    change from one pair's value to the next pair's: what is left of an error of third to fourth order (0.54 to 0.33 of
    the change, resolutions rising by √2); not less than a tenth of the correction, as two pairs may agree by chance.
    """
    best, correction = extrapolate(done[-2], done[-1])
    error = float(correction[:2].max())
    if len(done) > 2:
        change = float(np.abs(best - extrapolate(done[-3], done[-2])[0])[:2].max())
        error = min(error, max(change / 2, error / 10))
    return best, max(error, _ERROR_FLOOR)


def extrapolate(coarse: tuple[int, Floats], fine: tuple[int, Floats]) -> tuple[Floats, Floats]:
    """Richardson's second-order value (k,) from two (pixels, values), and the size (k,) of its correction."""
    (n, a), (m, b) = coarse, fine
    correction = (b - a) * n**2 / (m**2 - n**2)
    return b + correction, np.abs(correction)


def solve_part(
    cell: Grating, directions: Floats, settings: FdtdSettings, path: Path, what: str = "FDTD"
) -> Rows:
    """Solve `directions` (n, 2) of u, v; rows that `path` already holds are kept, each new one is written at once."""
    rows = read_rows(path, cell, settings) if path.exists() else Rows.empty()
    for u, v in progress(directions, f"{what} {cell.name}", unit="direction"):
        if rows.find(u, v) is None:
            rows = rows.added(u, v, solve_direction(cell, float(u), float(v), settings))
            write_rows(path, cell, settings, rows)
    rows = rows.selected(directions)
    write_rows(path, cell, settings, rows)
    return rows


def default_nodes(u_max: float, v_max: float) -> tuple[Floats, Floats]:
    """Nodes where nothing is known of the response: Chebyshev in u, and in v² for v ≥ 0."""
    return chebyshev(-u_max, u_max, 41), even_nodes(v_max, 4)


def read_nodes(path: str, cell: Grating) -> tuple[Floats, Floats]:
    """Nodes u (n_u), v (n_v) from a JSON file {'name', 'u', 'v'}; InputError says what is wrong with it."""
    try:
        data: Any = json.loads(Path(path).read_text(encoding="utf-8"))
        u, v = np.array(data["u"], float), np.array(data["v"], float)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; make it with python -m optics.nodes") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: must hold the lists 'u' and 'v' ({type(error).__name__}: {error})") from None
    if data.get("name", cell.name) != cell.name:
        raise InputError(f"{path}: name = {data['name']!r}: made for another cell than '{cell.name}'")
    for name, nodes in (("u", u), ("v", v)):
        if nodes.ndim != 1 or nodes.size < 2 or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0):
            raise InputError(f"{path}: {name}: must be a list of at least 2 ascending numbers")
    if v[0] != 0:
        raise InputError(f"{path}: v[0] = {v[0]:g}: must be 0 (v → −v is a mirror)")
    return u, v


def _part(text: str) -> tuple[int, int]:
    """(i, n) from 'i/n', 1 ≤ i ≤ n."""
    try:
        i, n = (int(number) for number in text.split("/"))
    except ValueError:
        raise InputError(f"--part = {text}: must be like 3/8") from None
    if not 1 <= i <= n:
        raise InputError(f"--part = {text}: must be i/n with 1 ≤ i ≤ n")
    return i, n


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m optics.fdtd", description="Pressure table by FDTD (Meep)")
    add_table_arguments(parser, 1e-2, 0.18)
    parser.add_argument("--nodes", help="JSON file of the directions, from python -m optics.nodes")
    parser.add_argument("--part", help="solve the i-th of n blocks of the directions only, as in 3/8")
    parser.add_argument("--merge", nargs="+", metavar="PART", help="make the table from these part files")
    return checked(parser.parse_args())


def _warn_of_grazing(cell: Grating, directions: Floats) -> None:
    close = [(u, v) for u, v in directions if grazing(cell, u, v) < _GRAZING]
    if close:
        print(
            f"note: {cell.name}: at {len(close)} directions, the first u = {close[0][0]:g}, v = {close[0][1]:g}, a "
            f"diffraction order grazes (|w| < {_GRAZING}) and the absorbers damp it badly; it is recorded as 'grazing'",
            file=sys.stderr,
        )


def main() -> None:
    """Command line: see the module docstring."""
    arguments = _arguments()
    out = Path(arguments.out)
    cell = read_grating(arguments.cell)
    check_range(1.0, arguments.u_max, arguments.v_max)
    settings = validate({"tolerance": arguments.tolerance}, FdtdSettings, "command line")
    nodes = default_nodes(arguments.u_max, arguments.v_max)
    if arguments.nodes:
        nodes = read_nodes(arguments.nodes, cell)
    check_cell(cell, float(np.abs(nodes[0]).max()), float(nodes[1][-1]))
    if arguments.merge:
        merge(cell, settings, *nodes, [Path(part) for part in arguments.merge]).write(out)
        return
    import_meep()
    i, n = _part(arguments.part) if arguments.part else (1, 1)
    directions = block(*nodes, i, n)
    _warn_of_grazing(cell, directions)
    with threadpool_limits(1):
        if arguments.part:
            solve_part(cell, directions, settings, out, f"part {i}/{n} of FDTD")
            return
        rows = out.with_name(f"{out.name}.rows.h5")
        solve_part(cell, directions, settings, rows)
        merge(cell, settings, *nodes, [rows]).write(out)
        rows.unlink()


if __name__ == "__main__":
    run_stage(main)
