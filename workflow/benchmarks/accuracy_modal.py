"""Error against time of the modal method, of `meent`, and of thin films by this project and by `tmm`.

Gratings: one direction solved by itself, error against ±120 orders; a row of a table shares its modes among all v, so
that its directions cost far less. Films: 1,000 angles of incidence of a 20-layer stack, error against 50-digit
arithmetic at a few of them.

    python -m workflow.benchmarks.accuracy_modal --out accuracy_modal.csv
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain

import mpmath
import numpy as np
import tmm

from beamrider.io.files import run_stage
from optics.cells.schema import read_metagrating
from optics.modal import stage as modal
from optics.thin_film import stage as thin_film
from workflow.benchmarks import meent_solver
from workflow.benchmarks.rows import CELLS, DESIGNS, Row, directions, seconds, write_measured

ORDERS = (6, 8, 10, 12, 15, 18, 22, 27, 33, 40, 50, 60)
TRUTH = 120
TABLE_V = np.linspace(0.0, 0.42, 26)
FILM = np.array([1.0, *(2.0 + 2e-6j, 1.45) * 10, 1.0])
THICKNESS = np.full(20, 150.0)
WAVELENGTH = 1064.0
ANGLES = np.sin(np.linspace(0.0, 1.4, 1000))


def gratings() -> Iterator[Row]:
    """The modal method by itself and within a row of a table, and `meent`, at every number of orders."""
    for name in CELLS:
        cell = read_metagrating(DESIGNS / f"{name}.yaml")
        for where, u, v in directions(name):
            one = np.array([u]), np.array([v])
            truth = modal.solve(cell, *one, TRUTH).q
            for order in ORDERS:
                error = float(np.abs(modal.solve(cell, *one, order).q - truth).max())
                alone = seconds(partial(modal.solve, cell, *one, order))
                row = seconds(partial(modal.solve, cell, one[0], TABLE_V, order)) / TABLE_V.size
                yield Row("modal", name, where, f"±{order}", error, alone)
                yield Row("modal, in a table", name, where, f"±{order}", error, row)
                theirs = seconds(partial(meent_solver.solve, cell, [(u, v)], order))
                yield Row("meent", name, where, f"±{order}", error, theirs)


def reflectance(polarisation: str, sine: float) -> float:
    """Reflectance of the film stack in 50-digit arithmetic, by the recursion of reflection coefficients."""
    with mpmath.workdps(50):
        k0 = 2 * mpmath.pi / WAVELENGTH
        index = [mpmath.mpc(n) for n in FILM]
        w = [mpmath.sqrt(n**2 - mpmath.mpf(sine) ** 2) for n in index]
        y = w if polarisation == "s" else [n**2 / x for n, x in zip(index, w, strict=True)]
        r = (y[-2] - y[-1]) / (y[-2] + y[-1])
        for i in range(len(index) - 3, -1, -1):
            bounce = r * mpmath.exp(2j * k0 * w[i + 1] * THICKNESS[i])
            own = (y[i] - y[i + 1]) / (y[i] + y[i + 1])
            r = (own + bounce) / (1 + own * bounce)
        return float(abs(r) ** 2)


def films() -> Iterator[Row]:
    """Time of 1,000 angles with either code, and the largest error among some of them."""
    checked = range(0, ANGLES.size, 50)
    for share, polarisation in ((0.0, "s"), (1.0, "p")):
        truth = np.array([reflectance(polarisation, ANGLES[i]) for i in checked])

        def ours(share: float = share) -> np.ndarray:
            return np.asarray(thin_film.stack(FILM, THICKNESS, WAVELENGTH, ANGLES, share).reflectance)

        def theirs(polarisation: str = polarisation) -> np.ndarray:
            layers = [np.inf, *THICKNESS, np.inf]
            return np.array([tmm.coh_tmm(polarisation, FILM, layers, np.arcsin(s), WAVELENGTH)["R"] for s in ANGLES])

        for solver, work, repeats in (("thin film", ours, 5), ("tmm", theirs, 2)):
            error = float(np.abs(work()[checked] - truth).max())
            spent = seconds(work, repeats) / ANGLES.size
            yield Row(solver, "20 layers", polarisation, "double precision", error, spent)


def main() -> None:
    """Measure and write."""
    write_measured(__doc__, chain(gratings(), films()))


if __name__ == "__main__":
    run_stage(main)
