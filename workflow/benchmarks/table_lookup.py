"""Nanoseconds a look-up, of random directions in a table split at cut-offs and in a plain one of the same run.

In batches, as flexible sails look theirs up, and one by one, as rigid sails do: there each waits for the one before.

    python -m workflow.benchmarks.table_lookup TABLE.h5
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import run_stage
from optics.table.lookup import TableArrays, lookup, lookup_many, lookup_slopes_many
from optics.table.pressure_table import PressureTable

DIRECTIONS, REPEATS = 20_000, 300


def nanoseconds(function: Callable[..., Any], *arguments: Any) -> float:
    """Least time of a call, per direction."""
    function(*arguments)
    best = np.inf
    for _ in range(REPEATS):
        start = time.perf_counter()
        function(*arguments)
        best = min(best, time.perf_counter() - start)
    return best / DIRECTIONS * 1e9


@numba.njit(cache=False)  # what is kept of it would not know of another `lookup`
def one_by_one(arrays: TableArrays, u: Floats, v: Floats) -> float:
    """Sum of q_g, each look-up in need of the one before."""
    q = 0.0
    for i in range(u.size):
        q += lookup(arrays, u[i] + 1e-300 * q, v[i])[0]
    return q


def main() -> None:
    """Print one line each for values, for values with slopes and for single look-ups."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", type=Path)
    table = PressureTable.read(parser.parse_args().table)
    rng = np.random.default_rng(0)
    u, v = (rng.uniform(-edge, edge, DIRECTIONS) for edge in (table.u[-1], table.v[-1]))
    values, slopes = np.empty((DIRECTIONS, 4)), np.empty((DIRECTIONS, 3, 4))
    for name, one in (("plain", replace(table, cutoffs=None)), ("split at cut-offs", table)):
        arrays = one.arrays()
        print(f"{name:18s} values            {nanoseconds(lookup_many, arrays, u, v, values):6.1f} ns")
        print(f"{name:18s} values and slopes {nanoseconds(lookup_slopes_many, arrays, u, v, slopes):6.1f} ns")
        print(f"{name:18s} values one by one {nanoseconds(one_by_one, arrays, u, v):6.1f} ns")


if __name__ == "__main__":
    run_stage(main)
