"""What made results: `beamrider show FILE …`, also `python -m beamrider.show FILE …`."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from beamrider.io.arguments import parser
from beamrider.io.files import InputError, run_stage
from beamrider.io.hdf5 import read_hdf5
from beamrider.provenance.record import NAME
from beamrider.provenance.sources import program


def read_record(path: Path) -> dict[str, Any] | None:
    """The record that a file holds; None where it holds none, OSError or ValueError where it can't be read."""
    reader = {
        ".json": _of_json,
        ".parquet": _of_parquet,
        ".png": _of_png,
        ".svg": _of_svg,
        ".h5": _of_hdf5,
        ".vtkhdf": _of_hdf5,
    }.get(path.suffix)
    found = reader(path) if reader else None
    record: dict[str, Any] | None = json.loads(found) if isinstance(found, str | bytes) else found
    return record


def _of_json(path: Path) -> Any:
    data = json.loads(path.read_text(encoding="utf-8"))
    return data.get(NAME) if isinstance(data, dict) else None


def _of_hdf5(path: Path) -> Any:
    with read_hdf5(path) as file:
        return file.attrs.get(NAME)


def _of_parquet(path: Path) -> Any:
    import pyarrow.parquet as pq

    found = pq.read_schema(path).metadata or {}
    return found.get(NAME.encode()) or json.loads(found.get(b"pandas", b"{}")).get("attributes", {}).get(NAME)


def _of_png(path: Path) -> Any:
    from PIL import Image

    with Image.open(path) as image:
        return image.info.get("Description")


def _of_svg(path: Path) -> Any:
    text = "{http://purl.org/dc/elements/1.1/}description"
    return next((node.text for _, node in ElementTree.iterparse(path) if node.tag == text), None)


def of_workflow(path: Path) -> dict[str, Any] | None:
    """What Snakemake wrote down of a file that carries no record of its own, as tables in CSV: rule, inputs, key."""
    name = base64.urlsafe_b64encode(str(path).encode()).decode()
    try:
        found = json.loads((Path(".snakemake/metadata") / name).read_text(encoding="utf-8"))
        keys = ("rule", "input", "params", "shellcmd")
        return {key: found[key] for key in keys}
    except (OSError, ValueError, LookupError, TypeError):
        return None


def in_words(record: dict[str, Any]) -> list[str]:
    """Lines that say what made a file, and whether its sources and libraries are those that are here."""
    if "program" not in record:
        return [f"  {key}: {value}" for key, value in record.items()]
    try:
        here = program(record["program"])
        same = {"code": here.code == record["code"], "libraries": here.libraries == record["libraries"]}
    except FileNotFoundError:
        same = {"code": False, "libraries": False}
    said = {True: "as here", False: "not as here"}
    return [
        f"  program: {record['program']} {' '.join(record['arguments'])}",
        f"  sources: {record['code']} ({said[same['code']]})",
        f"  versions ({said[same['libraries']]}): {', '.join(f'{n} {v}' for n, v in record['libraries'].items())}",
        *(f"  input: {name} sha256 {digest}" for name, digest in record["inputs"].items()),
    ]


def show(path: Path) -> None:
    """Print what made a file; InputError where it says nothing of it."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        record = read_record(path) or of_workflow(path)
    except (OSError, ValueError, LookupError, SyntaxError) as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())[:150]})") from None
    if record is None:
        raise InputError(f"{path}: doesn't say what made it: made by an older Beamrider, or by something else")
    print("\n".join([f"{path}:", *in_words(record)]))


def main() -> None:
    """Say what made results: program, sources, versions, inputs."""
    options = {"files": {"nargs": "+", "type": Path, "metavar": "FILE"}}
    for path in parser("beamrider.show", main.__doc__, options).parse_args().files:
        show(path)


if __name__ == "__main__":
    run_stage(main)
