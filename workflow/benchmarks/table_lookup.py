"""Nanoseconds a look-up, of random directions in a table split at cut-offs and in a plain one of the same run.

    python workflow/benchmarks/table_lookup.py TABLE.h5
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from optics.interpolation import lookup_slopes_many
from optics.table import PressureTable, lookup_many

DIRECTIONS, REPEATS = 8192, 300


def nanoseconds(function: Callable[..., Any], *arguments: Any) -> float:
    """Least time of a call, per direction."""
    function(*arguments)
    best = np.inf
    for _ in range(REPEATS):
        start = time.perf_counter()
        function(*arguments)
        best = min(best, time.perf_counter() - start)
    return best / DIRECTIONS * 1e9


def main() -> None:
    """Print one line each for values and for values with slopes."""
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


if __name__ == "__main__":
    main()
