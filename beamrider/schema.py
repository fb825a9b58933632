"""Schemas of the files that users write: `beamrider schema scene > scene.json`, also `python -m beamrider.schema`.

Editors complete and check YAML by them: see docs/guide.md. `beamrider schema reference --out docs/reference.md` writes
the page that lists every key.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Annotated, Any

from pydantic import Discriminator

from beamrider.io.arguments import parser
from beamrider.io.files import InputError, atomic, run_stage, take_out
from beamrider.io.json_schema import json_schema
from beamrider.io.reference import reference
from beamrider.provenance.sources import ROOT

#: For each file: the module and the name of what reads it, what the file is, and where it lies.
FILES = {
    "scene": ("dynamics.scene.schema", "Scene", "Scenes", "`workflow/scenes/NAME.yaml`: what is flown, and how."),
    "cell": ("optics.cells.schema", "Cell", "Cells", "`workflow/designs/NAME.yaml`: what a sail's surface is made of."),
    "family": (
        "workflow.family",
        "Family",
        "Families",
        "`workflow/designs/NAME.yaml` with `kind: family`: many designs, to be screened.",
    ),
    "config": ("workflow.configuration", "Config", "Configuration", "`workflow/config.yaml`: what `snakemake` makes."),
    "grid": ("dynamics.rigid.basin", "Grid", "Releases of a basin map", "The file of `beamrider basin --grid`."),
}
PAGE = """# Reference of all keys

Made from the schema that reads the files, by `beamrider schema reference --out docs/reference.md`: don't edit it. Keys
end in their unit; numbers without one are dimensionless. Rules that tie several keys together are told where one breaks
them.
"""


def model_of(name: str) -> Any:
    """The type that reads a kind of file; InputError where this installation has none, as that of the workflow."""
    module, attribute, *_ = FILES[name]
    if module.startswith("workflow.") and str(ROOT) not in sys.path:
        sys.path.append(str(ROOT))
    try:
        return getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        raise InputError(f"schema of {name}: needs {error.name}, in a checkout of Beamrider") from None


def schema_of(name: str) -> dict[str, Any]:
    """The JSON schema of a kind of file, one of `FILES`."""
    kind = model_of(name)
    return json_schema(kind if hasattr(kind, "model_fields") else _told_apart(kind), f"Beamrider {name}")


def _told_apart(kinds: Any) -> Any:
    """A union of models, told apart by their `kind`, so that editors check a file as what it says it is."""
    return Annotated[kinds, Discriminator("kind")]


def page() -> str:
    """The page that lists every key of every file, in Markdown."""
    parts = ((title, where, reference(schema_of(name), name)) for name, (*_, title, where) in FILES.items())
    return "\n\n".join([PAGE.rstrip(), *(f"## {title}\n\n{where}\n\n{keys}" for title, where, keys in parts)]) + "\n"


OPTIONS = {
    "what": {"choices": [*FILES, "reference"], "help": "kind of file, or the reference page"},
    "--out": {"help": "file to write instead of standard output"},
}


def main() -> None:
    """Write the JSON schema of a kind of file, for editors, or the reference page of all of them."""
    given = parser("beamrider.schema", main.__doc__, OPTIONS).parse_args()
    of_page = given.what == "reference"
    text = page() if of_page else json.dumps(schema_of(given.what), indent=1, ensure_ascii=False) + "\n"
    if given.out is None:
        sys.stdout.write(text)
        return
    take_out(given.out)
    with atomic(given.out) as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(f"{given.out}: {given.what}, {len(Path(given.out).read_text(encoding='utf-8').splitlines())} lines")


if __name__ == "__main__":
    run_stage(main)
