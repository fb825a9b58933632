"""How far an FDTD table is, and the time to go: directions weighed by the work that their grids are.

A run takes pixels × steps, which is the third power of the resolution; out of the plane of incidence there are twice
as many field components. How many resolutions a direction needs, and how long it rings, is not known before: what the
directions done so far took is carried over to those that are left, which the order of work spreads over the table.
"""

from __future__ import annotations

import os
import sys
from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from optics.cells.outline import Grating, upright
from optics.fdtd.adaptive import adapt
from optics.fdtd.grid import FEWEST_RUNS, FdtdSettings, finest, memory, work
from optics.modal.response import solve

_OUT_OF_PLANE = 2.0
_GOLDEN = (5**0.5 - 1) / 2
_ORDER = 12


def check_memory(cell: Grating, settings: FdtdSettings) -> None:
    """InputError where the resolutions that every direction takes do not fit into this machine's memory."""
    n, needed = finest(cell, settings), memory(cell, settings)
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > there:
        raise InputError(
            f"{cell.name}: period_nm = {cell.period_nm:g}: FDTD needs about {needed / 1e9:.0f} GB for {n} pixels a "
            f"period, this machine has {there / 1e9:.0f}; use optics.modal"
        )


def spread(count: int) -> NDArray[np.int64]:
    """An order (count,) of things in which the first few already lie all over them: steps of the golden section."""
    return np.argsort(np.arange(count) * _GOLDEN % 1, kind="stable")


def expected_directions(cell: Grating, u_max: float, v_max: float, tolerance: float) -> Floats:
    """Directions (n, 2) that `adapt` would ask for if FDTD found what the modal method finds with few orders."""
    asked: dict[tuple[float, float], None] = {}
    stack = upright(cell)

    def response(directions: Floats) -> Floats:
        asked.update(dict.fromkeys(map(tuple, directions.tolist())))
        u, v = (np.unique(part) for part in directions.T)
        q = solve(stack, u, v, _ORDER).q[..., [0, 2]]
        return np.asarray(q[np.searchsorted(u, directions[:, 0]), np.searchsorted(v, directions[:, 1])])

    adapt(response, u_max, v_max, tolerance)
    return np.array(list(asked))


class Progress:
    """A bar on a terminal, a line a minute in a log, the first at once; one direction after the other is reported."""

    def __init__(self, cell: Grating, settings: FdtdSettings, directions: Floats, what: str) -> None:
        self._runs = work(cell, settings)[:FEWEST_RUNS]
        self._weights = self._runs
        self._part = 0.0
        self._left = {(float(u), float(v)): self._weight(float(v)) for u, v in directions}
        self._done, self._count = 0, len(self._left)
        terminal = sys.stderr.isatty()
        self._bar = tqdm(
            total=sum(self._left.values()),
            desc=what,
            mininterval=0.2 if terminal else 60,
            ascii=not terminal,
            smoothing=0,
            bar_format="{desc}: {percentage:3.0f}%|{bar}| [{elapsed}<{remaining}{postfix}]",
            postfix=self._said,
        )

    def _weight(self, v: float) -> float:
        return float(self._runs.sum() * (_OUT_OF_PLANE if v else 1.0))

    @property
    def _said(self) -> str:
        return f"{self._done}/{self._count} directions"

    def begin(self, u: float, v: float) -> None:
        """A direction is begun; one that was not expected counts from now on."""
        self._weights = self._runs * (_OUT_OF_PLANE if v else 1.0)
        self._part = 0.0
        if self._left.pop((u, v), None) is None:
            self._count += 1
            self._bar.total = float(self._bar.total or 0.0) + self._weights.sum()

    def run(self, rung: int) -> None:
        """A resolution of it is done, the first is 0. The first of all is told at once: it is the first measured."""
        if rung < self._runs.size:
            self._part += self._weights[rung]
            self._bar.update(self._weights[rung])
        if self._done == 0 and rung == 0:
            self._bar.refresh()

    def end(self) -> None:
        """The direction is done."""
        self._done += 1
        self._bar.set_postfix_str(self._said, refresh=False)
        self._bar.update(self._weights.sum() - self._part)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:  # what was expected and not asked for
            self._bar.total, self._count = self._bar.n, self._done
            self._bar.set_postfix_str(self._said, refresh=False)
            self._bar.refresh()
        self._bar.close()
