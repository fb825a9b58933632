"""What made a file: program, the meaning of its sources, versions of its libraries, arguments, digests of its inputs.

Every stage leaves this in what it writes: as the attribute `made_from` of HDF5 files, as a key of JSON files, as
metadata of Parquet files and figures (`beamrider show FILE` prints it). The same input makes the same record: it holds
no times and no folders.
"""

from __future__ import annotations

import contextlib
import functools
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from beamrider.provenance.sources import Program, digest_of_file, program

NAME = "made_from"
#: Options that change no numbers, each with its value.
_WITHOUT_EFFECT = ("--out", "--svg", "--csv", "--markdown", "--html", "--png", "--threads")

_begun: tuple[str, tuple[str, ...]] | None = None


@contextlib.contextmanager
def by(main: Callable[[], None], program: str | None = None) -> Iterator[None]:
    """While a stage runs, whose command is `main`: what it writes says so, with its command line.

    program: its name, where that is not what runs.
    """
    global _begun
    _begun = program or _program(main), tuple(sys.argv[1:])
    try:
        yield
    finally:
        _begun = None


def _program(main: Callable[[], None]) -> str:
    """Name of the running program as in a command: a module ('optics.modal')."""
    running = sys.modules["__main__"]
    spec = getattr(running, "__spec__", None)
    if getattr(running, "main", None) is not main or not spec:
        return main.__module__
    return str(spec.name).removesuffix(".__main__")


def made_from() -> dict[str, Any] | None:
    """The record of the stage that is running; None where no stage is."""
    return _record(*_begun) if _begun else None


def _record(name: str, given: tuple[str, ...]) -> dict[str, Any] | None:
    try:
        made = _made(name)
    except FileNotFoundError:  # a test's own program
        return None
    return {
        "program": name,
        "arguments": _arguments(given),
        "inputs": _inputs(given),
        "code": made.code,
        "libraries": made.libraries,
    }


@functools.cache
def _made(name: str) -> Program:
    return program(name)  # sources stay what they were as Python read them


def _arguments(given: tuple[str, ...]) -> list[str]:
    """Arguments that change numbers; of files the names alone."""
    left = [word for i, word in enumerate(given) if not {word, given[i - 1] if i else ""} & set(_WITHOUT_EFFECT)]
    parts = [word.rpartition("=") for word in left]
    return [f"{name}{sign}{Path(file).name if Path(file).exists() else file}" for name, sign, file in parts]


def _inputs(given: tuple[str, ...]) -> dict[str, str]:
    """Digests of the files among the arguments, NAME=FILE too, by their names; of several of one name in order."""
    files = [Path(word.split("=", 1)[-1]) for word in given]
    places = [i for i, file in enumerate(files) if file.is_file() and given[i - 1] not in _WITHOUT_EFFECT]
    found: dict[str, list[str]] = {}
    for i in places:
        found.setdefault(files[i].name, []).append(digest_of_file(files[i]))
    return {name: " ".join(digests) for name, digests in found.items()}


def as_attribute() -> dict[str, str]:
    """The record as an attribute: {'made_from': JSON}; empty where no stage is running."""
    record = made_from()
    return {NAME: json.dumps(record, sort_keys=True)} if record else {}
