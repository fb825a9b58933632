"""What a table promises: the error that its user asked for, the error that it states, and why they may differ.

A tolerance is met where the stated error of q is at most the tolerance at 99 % of the directions, taken evenly over u
and v. The stated error covers the true one (truncation, staircase and interpolation together). A table that misses it
is written all the same, marked, and the command that made it ends with exit code 3.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from beamrider.io.lock import release
from optics.table.pressure_table import PressureTable
from optics.table.verification import spread_evenly

SHARE = 0.99
MISSED = 3  # exit code
_ROWS, _ON_ROW = 256, 16  # random directions in u, and in v at each of them
_UNSTATED = "slow convergence"


@dataclass(frozen=True)
class Promise:
    """The tolerance asked for, the error stated at `SHARE` of the directions, the largest and its direction (u, v).

    causes: what stopped the solver before it was better, in its own words.
    """

    tolerance: float
    error_99: float
    largest: float
    at: tuple[float, float]
    causes: tuple[str, ...] = ()

    @property
    def met(self) -> bool:
        """Whether the tolerance is met."""
        return self.error_99 <= self.tolerance

    @property
    def why(self) -> str:
        """Why the tolerance is missed; empty where it is met."""
        return "" if self.met else "; ".join(self.causes) or _UNSTATED

    @property
    def text(self) -> str:
        """The promise in words."""
        place = f"u = {self.at[0]:.6g}, v = {self.at[1]:.6g}"
        found = f"error {self.error_99:.2g} at 99 %, largest {self.largest:.2g} at {place}"
        return f"{found}; tolerance {self.tolerance:g} {'met' if self.met else f'missed ({self.why})'}"


def cell_errors(table: PressureTable) -> tuple[Floats, Floats]:
    """Stated error of q between neighbouring nodes, the largest of their corners, and the area of directions there.

    Both (n, m) of n_u − 1 by n_v − 1; of an axisymmetric table (n_u − 1, 1), with the areas of rings.
    """
    error = np.maximum(table.error[1:], table.error[:-1])
    if table.axisymmetric:
        return error, np.diff(table.u**2)[:, None]
    return np.maximum(error[:, 1:], error[:, :-1]), np.outer(np.diff(table.u), np.diff(table.v))


def weighted_quantile(values: Floats, weights: Floats, share: float) -> float:
    """The least of `values` (...) that at least `share` of the weight does not exceed."""
    order = np.argsort(values, axis=None)
    total = np.cumsum(weights.ravel()[order])
    return float(values.ravel()[order][np.searchsorted(total, share * total[-1] * (1 - 1e-12))])


def error_at_share(table: PressureTable) -> float:
    """Stated error that `SHARE` of the directions don't exceed.

    Where errors follow fringes, on thick layers, of random directions spread evenly, always the same.
    """
    if table.thick is None:
        return weighted_quantile(*cell_errors(table), SHARE)
    u, v = spread_evenly(table.u, table.v, _ROWS, _ON_ROW)
    return float(np.quantile(table.stated_error(u[:, None], v), SHARE))


def promise(table: PressureTable, tolerance: float, causes: Iterable[str] = ()) -> Promise:
    """What a table made for `tolerance` keeps of it."""
    i, j = np.unravel_index(int(table.error.argmax()), table.error.shape)
    at = float(table.u[i]), float(table.v[j])
    return Promise(
        tolerance,
        error_at_share(table),
        float(table.error[i, j]),
        at,
        tuple(dict.fromkeys(causes)),
    )


def promised(table: PressureTable, tolerance: float, causes: Iterable[str] = ()) -> PressureTable:
    """The table with what it keeps of its promise among its attributes."""
    found = promise(table, tolerance, causes)
    return replace(
        table,
        attrs=table.attrs
        | {
            "tolerance_met": int(found.met),
            "error_99": found.error_99,
            "error_largest": found.largest,
            "error_largest_at": list(found.at),
            "missed_because": found.why,
        },
    )


def read_promise(table: PressureTable) -> Promise:
    """The promise that a table's file holds; InputError where it holds none, as files of older versions do."""
    try:
        at = table.attrs["error_largest_at"]
        return Promise(
            float(table.attrs["settings"]["tolerance"]),
            float(table.attrs["error_99"]),
            float(table.attrs["error_largest"]),
            (float(at[0]), float(at[1])),
            tuple(filter(None, [str(table.attrs["missed_because"])])),
        )
    except (KeyError, TypeError, ValueError, IndexError):
        raise InputError(f"table '{table.name}' doesn't say whether it met its tolerance: make it again") from None


def finish(table: PressureTable, out: str | Path, accept_missed: bool = False) -> None:
    """Write a table that has its promise and say in one line how good it is.

    SystemExit with code `MISSED` where it missed its tolerance, unless that is accepted.
    """
    table.write(out)
    kept = read_promise(table)
    count = f"{table.u.size} × {table.v.size}" if table.v.size > 1 else f"{table.u.size}"
    cost = float(table.attrs["cpu_seconds"])
    print(f"{out}: {count} directions, {kept.text}; {cost:.3g} CPU s", flush=True)
    release(out)
    if not kept.met and not accept_missed:
        raise SystemExit(MISSED)
