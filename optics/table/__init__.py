"""The pressure table: file, memory layout, look-up, narrow resonances, and what it promises.

`from optics.table import PressureTable` is for users. Modules of the project are imported by their own names, from
which follows what a stage is made of.
"""

import importlib
from typing import Any


def __getattr__(name: str) -> Any:
    """The class, read when it is asked for."""
    if name == "PressureTable":
        return importlib.import_module("optics.table.pressure_table").PressureTable
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
