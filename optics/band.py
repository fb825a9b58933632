"""The response of a cell around normal incidence over a band of wavelengths, for the stability of a sail on its way.

    python -m optics.band --cell workflow/designs/mark1e_te.yaml --out te_band.h5 [--wavelength-nm 1064 1303.2]

Gratings by the Fourier modal method, films by the transfer matrix. Wavelengths are added halfway between others until a
cubic spline through the rest foretells what is found there, to the tolerance; by what it misses it is stated to err.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from threadpoolctl import threadpool_limits

from beamrider.arrays import Floats
from beamrider.io.arguments import parser
from beamrider.io.files import InputError, Stopwatch, finish, progress, run_stage, take_out, versions
from beamrider.machine_code.notice import compiling
from optics.cells.outline import Grating, is_upright
from optics.cells.schema import Cell, ThinFilm, read_cell, require_coherent
from optics.modal.limit import refuse_without_limit
from optics.modal.normal_incidence import normal_response
from optics.modal.steps import modal_cell
from optics.modal.truncation import choose
from optics.table.band_response import BandResponse
from optics.table.normal_incidence import NormalResponse, table_response
from optics.table.promise import MISSED
from optics.thin_film.stage import make_table

TOLERANCE = 1e-3
#: λ'/λ of a laser at rest, seen from a sail at 0.2 c: √((1 + β)/(1 − β)); where a band ends if no end is named.
AT_A_FIFTH_OF_C = 1.5**0.5
_FIRST, _MOST = 17, 2000  # wavelengths to begin with, and at most
_NEAR = 0.02  # direction cosines that orders and slices are chosen for
_FILM = 1e-3  # share of the tolerance that films' tables take
SLOPES = 10.0  # slopes may err by so many tolerances: they are those of q over some hundredths of u
_SAFETY = 2.0  # splines err by so much more than was found halfway
Solve = Callable[[float], NormalResponse]


def solver(path: str | Path, middle_nm: float, tolerance: float) -> Solve:
    """A function from wavelengths in nm to responses, with orders and slices chosen in the middle of the band."""
    cell = read_cell(path, middle_nm)
    if isinstance(cell, ThinFilm):
        return lambda wavelength: _film(path, wavelength, tolerance)
    require_coherent(cell, "optics.band")
    chosen = choose(cell, _NEAR, _NEAR, 0.1 * tolerance)

    def at(wavelength: float) -> NormalResponse:
        grating = _grating(read_cell(path, wavelength))
        refuse_without_limit(grating)
        if chosen.slices is None or is_upright(grating):
            return normal_response(modal_cell(grating), chosen.order)
        fine, half = (modal_cell(grating, count) for count in (chosen.slices, chosen.slices // 2))
        return normal_response(fine, chosen.order, half)

    return at


def _grating(cell: Cell) -> Grating:
    assert not isinstance(cell, ThinFilm)
    return cell


def _film(path: str | Path, wavelength: float, tolerance: float) -> NormalResponse:
    cell = read_cell(path, wavelength)
    assert isinstance(cell, ThinFilm)
    return table_response(make_table(cell, _NEAR, _FILM * tolerance))


def _flat(response: NormalResponse) -> Floats:
    """The numbers of a response, q and its slopes, one after the other (9,)."""
    return np.concatenate([response.q, response.gradient.ravel()])


def _halfway(x: Floats) -> Floats:
    """Middles (n − 1,) of intervals."""
    return 0.5 * (x[1:] + x[:-1])


def over_band(solve: Solve, first_nm: float, last_nm: float, tolerance: float, name: str) -> BandResponse:
    """The response from first_nm to last_nm; InputError where more than `_MOST` wavelengths would be needed.

    tolerance: of q; slopes may err by `SLOPES` times as much.
    """
    scale = np.concatenate([np.full(3, tolerance), np.full(6, SLOPES * tolerance)])
    known: dict[float, NormalResponse] = {}
    bar = progress((), f"band {name}", unit="wavelength")

    def find(wavelengths: Floats) -> None:
        for one in wavelengths:
            known[float(one)] = found = solve(float(one))
            bar.update()
            if not np.all(np.isfinite(_flat(found))):
                raise InputError(f"{name}: q has no slope at {one:.6g} nm: leave it out of the band")

    x = np.linspace(first_nm, last_nm, _FIRST)
    find(x)
    due = np.ones(x.size - 1, bool)
    missed = np.zeros((x.size - 1, 9))
    while due.any():
        middles = _halfway(x)[due]
        spline = CubicSpline(x, [_flat(known[one]) for one in x])
        find(middles)
        off = np.abs(spline(middles) - [_flat(known[one]) for one in middles])
        if x.size + middles.size > _MOST:
            raise InputError(f"{name}: needs more than {_MOST} wavelengths: take a narrower band, or ask for less")
        wide = np.any(off > scale, axis=1)
        # Each half of an interval keeps what the whole missed, a sixteenth of it where the spline was right (order 4).
        told = np.where(due[:, None], 0.0, missed)
        told[due] = np.where(wide[:, None], off, off / 16.0)
        counts = 1 + due.astype(int)
        missed, fresh = np.repeat(told, counts, axis=0), np.repeat(due, counts)
        fresh[fresh] = np.repeat(wide, 2)
        x, due = np.sort(np.concatenate([x, middles])), fresh
    bar.close()
    return _gathered(x, [known[one] for one in x], _SAFETY * missed)


def _gathered(x: Floats, found: list[NormalResponse], missed: Floats) -> BandResponse:
    """All that was found, with what splines miss in the intervals beside each wavelength (n − 1, 9) in its error."""
    beside = np.maximum(np.vstack([missed[:1], missed]), np.vstack([missed, missed[-1:]]))
    return BandResponse(
        1e-9 * x,
        np.array([one.q for one in found]),
        np.array([one.gradient for one in found]),
        np.array([one.q_error for one in found]) + beside[:, :3],
        np.array([one.gradient_error for one in found]) + beside[:, 3:].reshape(-1, 3, 2),
    )


def respond(
    path: str | Path, first_nm: float | None = None, last_nm: float | None = None, tolerance: float = TOLERANCE
) -> BandResponse:
    """The response of the cell in a YAML file from first_nm to last_nm, by default all the way to 0.2 c."""
    watch, cell = Stopwatch(), read_cell(path, first_nm)
    first_nm = first_nm or cell.wavelength_nm
    last_nm = last_nm or first_nm * AT_A_FIFTH_OF_C * (1.0 + 1e-9)
    if not 0.0 < first_nm < last_nm < np.inf:
        raise InputError(f"--wavelength-nm = {first_nm:g} {last_nm:g}: must be two ascending wavelengths")
    _refuse_grazing(cell, first_nm, last_nm)
    with threadpool_limits(1):
        solve = solver(path, 0.5 * (first_nm + last_nm), tolerance)
        found = over_band(solve, first_nm, last_nm, tolerance, cell.name)
    found.attrs.update(_attributes(cell, tolerance, watch.cpu_seconds))
    found.attrs["tolerance_met"] = int(found.q_error.max() <= tolerance)
    return found


def _refuse_grazing(cell: Cell, first_nm: float, last_nm: float) -> None:
    """InputError where an order grazes at normal incidence, m λ = n d, within the band: q has no slope there."""
    if isinstance(cell, ThinFilm):
        return
    for index in (cell.surroundings.front, cell.surroundings.back):
        span = cell.period_nm * index
        m = int(span / first_nm)  # the highest order that grazes at no shorter wavelength than the first
        if m > 0 and span / m <= last_nm:
            raise InputError(
                f"{cell.name}: order {m} grazes at normal incidence at {span / m:.6g} nm, where q has no slope: leave "
                "it out of the band, or change period_nm"
            )


def _attributes(cell: Cell, tolerance: float, seconds: float) -> dict[str, Any]:
    return {
        "name": cell.name,
        "solver": "thin_film" if isinstance(cell, ThinFilm) else "modal",
        "cell": cell.model_dump(),
        "settings": {"tolerance": tolerance},
        "cpu_seconds": seconds,
        "versions": versions("numpy", "scipy"),
    }


OPTIONS = {
    "--cell": {"required": True, "help": "YAML file of the unit cell"},
    "--wavelength-nm": {
        "type": float,
        "nargs": 2,
        "metavar": ("FIRST", "LAST"),
        "default": (None, None),
        "help": "the band in vacuum; by default from the cell's own to what a sail at 0.2 c sees of it",
    },
    "--tolerance": {
        "type": float,
        "default": TOLERANCE,
        "help": "largest error of q (default %(default)s); missed: exit code 3",
    },
    "--accept-missed": {"action": "store_true", "help": "end with exit code 0 although the tolerance was missed"},
    "--out": {"required": True, "help": "file to write"},
}


def main() -> None:
    """Response of a cell around normal incidence over a band of wavelengths."""
    watch = Stopwatch()
    given = parser("optics.band", main.__doc__, OPTIONS).parse_args()
    take_out(given.out)
    if not 0 < given.tolerance < 1:
        raise InputError(f"--tolerance = {given.tolerance:g}: must be between 0 and 1")
    with compiling("20 s"):
        found = respond(given.cell, given.wavelength_nm[0], given.wavelength_nm[1], given.tolerance)
    found.write(given.out)
    errors = f"q errs by at most {found.q_error.max():.2g}, its slopes by {found.gradient_error.max():.2g}"
    met = bool(found.attrs["tolerance_met"])
    told = f"tolerance {given.tolerance:g} {'met' if met else 'missed: slow convergence of the diffraction orders'}"
    finish(given.out, watch, f"{found.wavelength.size} wavelengths, {errors}; {told}")
    if not met and not given.accept_missed:
        raise SystemExit(MISSED)


if __name__ == "__main__":
    run_stage(main)
