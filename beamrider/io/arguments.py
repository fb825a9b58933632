"""The command lines of the stages: what they share, and errors of one line.

A stage is given as `python -m optics.modal …`, or as `beamrider table …` (`beamrider.command`): help and errors name
the one that was. `argparse` loads in 11 ms, click in 39, typer in 71 and cyclopts in 95, at every start of every stage.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from typing import Any, NoReturn

from beamrider.io.errors import InputError
from beamrider.io.files import Stopwatch, take_out

#: Arguments by name, each with its help or with all that `add_argument` takes.
Options = Mapping[str, Any]
TABLES = "pressure table of each design of the scene"


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the command line, and end."""
        self.exit(2, f"error: {self.prog}: {message}; --help lists what it takes\n")


def parser(module: str, description: str | None, options: Options | None = None) -> Parser:
    """A parser for `python -m module`, with its arguments."""
    command = sys.argv[0] if sys.argv[0].startswith("beamrider ") else f"python -m {module}"
    made = Parser(prog=command, description=description)
    for name, about in (options or {}).items():
        given: dict[str, Any] = {"help": about} if isinstance(about, str) else dict(about)
        made.add_argument(name, **given)
    return made


def stage_arguments(
    module: str, description: str | None, out: str, tables: bool = True, options: Options | None = None
) -> argparse.Namespace:
    """Parsed --scene, --out and, where the stage takes them, --tables of `python -m module`.

    `out` says what is written; `options` are further arguments, as in `parser`. `watch` among what is returned runs
    from now on. InputError where --out could not be written.
    """
    every: dict[str, Any] = {"--scene": {"required": True, "help": "YAML file of the scene"}}
    if tables:
        every["--tables"] = {"nargs": "*", "default": [], "help": TABLES}
    every |= {"--out": {"required": True, "help": out}, **(options or {})}
    arguments = parser(module, description, every).parse_args()
    take_out(arguments.out)
    arguments.watch = Stopwatch()
    return arguments


def table_arguments(
    module: str, description: str, tolerance: float, u_max: float, v_max: bool = True, options: Options | None = None
) -> argparse.Namespace:
    """Parsed arguments of `python -m module`, which makes a pressure table; the numbers are defaults.

    `options` are further arguments, as in `parser`. InputError where --out could not be written, or --tolerance makes
    no sense.
    """
    every: dict[str, Any] = {
        "--cell": {"required": True, "help": "YAML file of the unit cell"},
        "--out": {"required": True, "help": "file to write"},
        "--wavelength-nm": {"type": float, "help": "replaces the cell's own; an index given as a table follows it"},
        "--u-max": {"type": float, "default": u_max, "help": "largest |u| of the table (default %(default)s)"},
        "--v-max": {"type": float, "default": u_max, "help": "largest |v| of the table (default %(default)s)"},
        "--tolerance": {
            "type": float,
            "default": tolerance,
            "help": "error of q that 99 %% of the directions must keep (default %(default)s); missed: exit code 3",
        },
        "--accept-missed": {
            "action": "store_true",
            "help": "end with exit code 0 although the tolerance was missed",
        },
    }
    if not v_max:
        del every["--v-max"]
    arguments = parser(module, description, {**every, **(options or {})}).parse_args()
    take_out(arguments.out)
    if not 0 < arguments.tolerance < 1:
        raise InputError(f"--tolerance = {arguments.tolerance:g}: must be between 0 and 1")
    return arguments


def part_of(option: str, text: str) -> tuple[int, int]:
    """(i, n) from 'i/n', 1 ≤ i ≤ n, that an option gives; InputError where it is anything else."""
    i, _, n = text.partition("/")
    if not (i.isdecimal() and n.isdecimal() and 1 <= int(i) <= int(n)):
        raise InputError(f"{option} = {text}: must be i/n with 1 ≤ i ≤ n, as in 3/8")
    return int(i), int(n)
