"""The command line that the table-making stages share."""

from __future__ import annotations

import argparse

from beamrider.io.files import InputError, take_out


def table_arguments(
    module: str, description: str, tolerance: float, u_max: float, v_max: bool = True, most_minutes: float | None = None
) -> argparse.Namespace:
    """Checked arguments of `python -m module`, those of `add_table_arguments`; the numbers are defaults."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    add_table_arguments(parser, tolerance, u_max, v_max)
    if most_minutes is not None:
        parser.add_argument(
            "--most-minutes", type=float, default=most_minutes,
            help="refuse a table that is forecast to take more CPU time (default %(default)s)",
        )
    return checked(parser.parse_args())


def add_table_arguments(parser: argparse.ArgumentParser, tolerance: float, u_max: float, v_max: bool = True) -> None:
    """Add the arguments that every table-making stage takes."""
    parser.add_argument("--cell", required=True, help="YAML file of the unit cell")
    parser.add_argument("--out", required=True, help="file to write")
    parser.add_argument(
        "--wavelength-nm", type=float, help="replaces the cell's own; an index given as a table follows it"
    )
    parser.add_argument("--u-max", type=float, default=u_max, help="largest |u| of the table (default %(default)s)")
    if v_max:
        parser.add_argument("--v-max", type=float, default=u_max, help="largest |v| of the table (default %(default)s)")
    parser.add_argument(
        "--tolerance", type=float, default=tolerance,
        help="error of q that 99 %% of the directions must keep (default %(default)s); missed: exit code 3",
    )
    parser.add_argument(
        "--accept-missed", action="store_true", help="end with exit code 0 although the tolerance was missed"
    )


def checked(arguments: argparse.Namespace) -> argparse.Namespace:
    """The arguments, if the output can be written and the tolerance makes sense."""
    take_out(arguments.out)
    if not 0 < arguments.tolerance < 1:
        raise InputError(f"--tolerance = {arguments.tolerance:g}: must be between 0 and 1")
    return arguments


def check_range(index: float, u_max: float, v_max: float | None = None) -> None:
    """Refuse a table that reaches light that doesn't exist (u² + v² ≥ n²) or is empty."""
    if not 0 < u_max < index:
        raise InputError(f"--u-max = {u_max:g}: must be between 0 and {index:g}")
    if v_max is None:
        return
    if not 0 < v_max < index:
        raise InputError(f"--v-max = {v_max:g}: must be between 0 and {index:g}")
    if u_max**2 + v_max**2 >= index**2:
        raise InputError(f"--u-max = {u_max:g}, --v-max = {v_max:g}: u² + v² must stay below {index**2:g}")
