"""The command line that the table-making stages share."""

from __future__ import annotations

import argparse

from optics.files import InputError


def table_arguments(module: str, description: str, tolerance: float, u_max: float) -> argparse.Namespace:
    """Parsed --cell, --out, --u-max, --v-max, --tolerance of `python -m module`; the numbers are defaults."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    add_table_arguments(parser, tolerance, u_max)
    return parser.parse_args()


def add_table_arguments(parser: argparse.ArgumentParser, tolerance: float, u_max: float) -> None:
    """Add the arguments that every table-making stage takes."""
    parser.add_argument("--cell", required=True, help="YAML file of the unit cell")
    parser.add_argument("--out", required=True, help="file to write")
    parser.add_argument("--u-max", type=float, default=u_max, help="largest |u| of the table (default %(default)s)")
    parser.add_argument("--v-max", type=float, default=u_max, help="largest |v| of the table (default %(default)s)")
    parser.add_argument("--tolerance", type=float, default=tolerance, help="error of q aimed at (default %(default)s)")


def check_range(index: float, u_max: float, v_max: float) -> None:
    """Refuse a table that reaches light that doesn't exist (u² + v² ≥ n²) or is empty."""
    for name, value in (("--u-max", u_max), ("--v-max", v_max)):
        if not 0 < value < index:
            raise InputError(f"{name} = {value:g}: must be between 0 and {index:g}")
    if u_max**2 + v_max**2 >= index**2:
        raise InputError(f"--u-max = {u_max:g}, --v-max = {v_max:g}: u² + v² must stay below {index**2:g}")
