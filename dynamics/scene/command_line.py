"""The command line that the stages of motion share."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from beamrider.io.files import Stopwatch, take_out
from beamrider.io.files import finish as finish  # every stage ends with it

TABLES = "pressure table of each design of the scene"


def stage_arguments(
    module: str, description: str | None, out: str, tables: bool = True, options: Mapping[str, Any] | None = None
) -> argparse.Namespace:
    """Parsed --scene, --out and, where the stage takes them, --tables of `python -m module`.

    `out` says what is written; `options` names further arguments, each with its help or
    with all that `add_argument` takes. `watch` among what is returned runs from now on. InputError where --out could
    not be written.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    parser.add_argument("--scene", required=True, help="YAML file of the scene")
    if tables:
        parser.add_argument("--tables", nargs="*", default=[], help=TABLES)
    parser.add_argument("--out", required=True, help=out)
    for name, text in (options or {}).items():
        parser.add_argument(name, **({"help": text} if isinstance(text, str) else text))
    arguments = parser.parse_args()
    take_out(arguments.out)
    arguments.watch = Stopwatch()
    return arguments
