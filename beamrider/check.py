"""Tell which files are not whole.

python -m beamrider.check FILE …        one line for each file that is not; exit code 2 if there is one
"""

from __future__ import annotations

import sys

from beamrider.io.arguments import parser
from beamrider.io.files import whole

#: Endings of files that users write as well: these need no checksum.
OWN = (".yaml", ".yml", ".csv", ".jsonl")


def main() -> None:
    """Are files whole? One line on standard error for each that is not, and exit code 2."""
    given = parser("beamrider.check", main.__doc__, {"files": {"nargs": "+", "metavar": "FILE"}}).parse_args()
    said = [error for file in given.files if (error := whole(file, not file.endswith(OWN)))]
    for line in said:
        print(f"error: {line}", file=sys.stderr)
    raise SystemExit(2 if said else 0)


if __name__ == "__main__":
    main()
