"""What the accuracy benchmarks of flights share: their command line, with sets of tables, and what they write."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rows import write

from dynamics.sail import load_tables
from dynamics.scene import Scene, read_scene
from optics.files import InputError, atomic
from optics.table import PressureTable

Tables = dict[str, PressureTable]


def _set(text: str, scene: Scene) -> tuple[str, Tables]:
    """'NAME=FILE,FILE' as (name, tables)."""
    name, separator, files = text.partition("=")
    if not separator:
        raise InputError(f"--tables {text}: must be NAME=FILE,FILE…")
    return name, load_tables(files.split(","), scene)


def write_flown(
    description: str | None,
    rows: Callable[[Scene, dict[str, Tables]], Iterable[Any]],
    markdown: Callable[[list[Any]], str],
    draw: Callable[[Path, list[Any], str], None],
) -> None:
    """Command line of a benchmark: measure the rows of a scene on sets of tables; write CSV, Markdown and figure."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", required=True, type=Path)
    parser.add_argument("--tables", required=True, nargs="+", help="NAME=FILE,FILE… of each source, the best first")
    parser.add_argument("--out", required=True, type=Path, help="CSV to write")
    parser.add_argument("--markdown", required=True, type=Path, help="table to write")
    parser.add_argument("--png", required=True, type=Path, help="figure to write")
    arguments = parser.parse_args()
    scene = read_scene(arguments.scene)
    found = list(rows(scene, dict(_set(text, scene) for text in arguments.tables)))
    write(arguments.out, found)
    with atomic(arguments.markdown) as temporary:
        temporary.write_text(markdown(found), encoding="utf-8")
    draw(arguments.png, found, scene.name)
