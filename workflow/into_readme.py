"""Put a generated table into the README, between the comments that carry its name.

python -m workflow.into_readme accuracy_optics results/accuracy/optics.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

from beamrider.io.files import InputError, atomic, run_stage

README = Path(__file__).parents[1] / "README.md"


def replaced(text: str, name: str, table: str) -> str:
    """The text with `table` between `<!-- name -->` and `<!-- /name -->`; InputError where they are missing."""
    start, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    if text.count(start) != 1 or text.count(end) != 1:
        raise InputError(f"README.md: must hold the comments {start.strip()} and {end} once each")
    head, rest = text.split(start)
    return f"{head}{start}{table.strip()}\n{end}{rest.split(end)[1]}"


def main() -> None:
    """Replace one table of the README."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name")
    parser.add_argument("table", type=Path)
    arguments = parser.parse_args()
    text = replaced(README.read_text(encoding="utf-8"), arguments.name, arguments.table.read_text(encoding="utf-8"))
    with atomic(README) as temporary:
        Path(temporary).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    run_stage(main)
