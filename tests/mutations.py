"""Inputs and files that are wrong in the ways of users, editors and disks; and what a stage makes of one, in a process.

Hypothesis draws them, so that a seed gives the same ones again (`pytest --hypothesis-seed=N`). Stages run up to their
solvers, which are replaced by the answer that they were reached: what is refused never gets there, what is valid does.
"""

from __future__ import annotations

import copy
import functools
import json
import math
import operator
import re
import resource
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import yaml
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

from beamrider.io.checksum import with_checksum
from beamrider.io.files import read_json, read_lines
from beamrider.io.parquet import write_parquet
from tests.damage import edited
from tests.hard.test_wording import places
from tests.processes import fork

#: Few examples, always the same ones.
FEW = settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
#: CPU seconds in which everything must have been said, wall seconds on a busy machine, bytes that a process may take.
LONGEST, PATIENCE, MEMORY = 20, 300, 6 << 30
#: What a stage may say beside its one line: its forecast, what it compiles, its bar of progress.
OTHER = re.compile(r"\| \d+/\d+ \[|free\), about |^compiling, |it/s\]|\?it/s|^$")

EXTREMES = [
    0,
    -1,
    1,
    0.0,
    -0.0,
    1e-300,
    1e300,
    -1e300,
    1e-30,
    1e30,
    1e15,
    1e9,
    1e6,
    1e5,
    1e3,
    1e-3,
    1e-9,
    5e-324,
    10**12,
    10**30,
    10**400,
    1000,
    2**63,
    float("nan"),
    float("inf"),
    float("-inf"),
]
SCALES = [-1, 0.5, 0.9, 1.1, 2, 3, 10, 100, 1e3, 1e-3, 1e6, 1e-6, 1e12, 1e-12, 1e30, 1e-30]
#: Values of another kind than any number, choice or name.
FOREIGN: list[Any] = [
    "a b",
    "x" * 100_000,
    "",
    "../../etc/passwd",
    "/etc/passwd",
    "\x00",
    "é" * 70,
    "!!python/name:os.system",
    [],
    {},
    [1, [2]],
    {"a": {"b": 1}},
    [[[[[[[[[[1]]]]]]]]]],
    ["x"] * 3000,
    {str(i): i for i in range(3000)},
]
VALUES = st.one_of(
    st.sampled_from(EXTREMES),
    st.sampled_from(FOREIGN),
    st.sampled_from([None, True, False]),
    st.floats(),
    st.integers(-(10**20), 10**20),
    st.text(max_size=30),
)
GARBAGE = [
    "[" * 3000,
    "{a: " * 400,
    "- " * 2000 + "x",
    "a: " + "9" * 100_000,
    "a: 0x" + "f" * 100_000,
    "? [a, b]\n: 1",
    "\t- x",
    "&a [*a]",
    "a: &a [x, x, x, x, x, x, x, x, x]\n"
    + "".join(f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join([f'*{chr(97 + i)}'] * 9)}]\n" for i in range(9)),
    "!!python/object/apply:os.system ['touch executed']",
    "a: !!python/name:os.system",
    "a: !!binary x",
    "<<: {a: 1}",
    "%YAML 9",
    "--- 1\n--- 2",
    "\ufeff",
    "a: 2026-01-01",
    "'",
    '"',
    "\x07",
    "#",
    "a: 1e999",
    "a: -",
    ": ",
    "a: .inf",
    "a: 1_000",
    "...",
]


def many(count: int) -> settings:
    """So many examples, other ones with another seed; what is wrong is not made simpler, which takes long."""
    return settings(FEW, max_examples=count, derandomize=False)


def is_number(value: Any) -> bool:
    """Is a value a number, and not true or false."""
    return isinstance(value, int | float) and not isinstance(value, bool)


#: What is done to a place, the more often named the likelier.
KINDS = ["scaled"] * 5 + ["value"] * 2 + ["extreme", "gone", "added", "renamed"]


@st.composite
def mutated(draw: st.DrawFn, data: Any) -> Any:
    """Nested mappings and lists with one to three places that are changed, gone, renamed, added or scaled."""
    out = copy.deepcopy(data)
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        kind, found = draw(st.sampled_from(KINDS)), list(places(out))
        if kind in ("scaled", "extreme"):
            found = [path for path in found if is_number(functools.reduce(operator.getitem, path, out))]
        if not found:
            break
        path = draw(st.sampled_from(found))
        parent = functools.reduce(operator.getitem, path[:-1], out)
        old = parent[path[-1]]
        if kind == "gone":
            del parent[path[-1]]
        elif kind == "scaled":
            parent[path[-1]] = old * draw(st.sampled_from(SCALES))
        elif kind == "extreme":
            parent[path[-1]] = draw(st.sampled_from(EXTREMES))
        elif kind == "renamed" and isinstance(parent, dict):
            parent[str(path[-1]) + draw(st.sampled_from(["_", "x" * 50_000, " ", "\n", "é"]))] = parent.pop(path[-1])
        elif kind == "added" and isinstance(parent, dict):
            parent[draw(st.text(max_size=8))] = draw(VALUES)
        elif kind == "added":
            parent.extend([copy.deepcopy(old)] * draw(st.sampled_from([1, 3, 1000])))
        else:
            parent[path[-1]] = draw(VALUES)
    return out


@st.composite
def garbled(draw: st.DrawFn, text: str) -> bytes:
    """A file's text that is cut, in which bytes are flipped, lines doubled or gone, or something else is put."""
    content = text.encode()
    place = draw(st.integers(0, len(content)))
    kind = draw(st.sampled_from(["cut", "byte", "insert", "instead", "line", "value"]))
    if kind == "cut":
        return content[:place]
    if kind == "byte":
        return content[:place] + draw(st.binary(min_size=1, max_size=3)) + content[place + 1 :]
    garbage = draw(st.sampled_from(GARBAGE)).encode()
    if kind == "insert":
        return content[:place] + garbage + content[place:]
    if kind == "instead":
        return garbage
    lines = text.splitlines()
    at = draw(st.integers(0, len(lines) - 1))
    if kind == "line":
        lines[at:at] = [lines[draw(st.integers(0, len(lines) - 1))]]
    else:
        lines[at] = f"{lines[at].split(':')[0]}: {draw(st.sampled_from(GARBAGE))}"
    return "\n".join(lines).encode()


@st.composite
def inputs(draw: st.DrawFn, data: Any) -> bytes:
    """A YAML file of wrong, or just other, data."""
    if draw(st.integers(0, 5)) == 0:
        return draw(garbled(yaml.safe_dump(data, allow_unicode=True)))
    return yaml.safe_dump(draw(mutated(data)), allow_unicode=True, sort_keys=False).encode(errors="replace")


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """A file's bytes, other than they were: cut, longer, flipped, a number doubled, a block lost or moved."""
    place, size = draw(st.integers(0, len(content) - 1)), draw(st.sampled_from([1, 8, 64, 512, 4096]))
    kind = draw(st.sampled_from(["cut", "longer", "flipped", "doubled", "zeros", "moved", "gone", "empty"]))
    found = {
        "cut": content[:place],
        "longer": content + content[:size],
        "empty": b"",
        "flipped": content[:place] + bytes([content[place] ^ 1 << draw(st.integers(0, 7))]) + content[place + 1 :],
        "doubled": content[:place] + bytes([(content[place] + 16) % 256]) + content[place + 1 :],
        "zeros": content[:place] + bytes(len(content[place : place + size])) + content[place + size :],
        "moved": content[place:] + content[:place],
        "gone": content[:place] + content[place + size :],
    }[kind]
    return found if found != content else content[:-1]


class Reached(Exception):
    """A solver was reached."""


def reached(*_: Any, **__: Any) -> Any:
    """What stands in for a solver."""
    raise Reached


@dataclass(frozen=True)
class Outcome:
    """What became of an input: exit code (negative the signal), the lines that were said, seconds, a solver reached."""

    code: int
    said: tuple[str, ...]
    seconds: float
    solved: bool

    def fault(self, names: tuple[str, ...], most: int = 700) -> str:
        """What is wrong with what became of an input that is one of `names` in messages; '' for nothing."""
        last = self.said[-1][:300] if self.said else ""
        if self.code in (-signal.SIGALRM, -signal.SIGXCPU, -signal.SIGKILL):
            return f"not done in {LONGEST} s: {last}"
        if self.code not in (0, 2, 3):
            return f"exit code {self.code}: {last}"
        if self.code != 2:
            return ""
        if len(self.said) != 1:
            return f"{len(self.said)} lines: {last}"
        if not last.startswith("error: ") or len(self.said[0]) > most:
            return f"{len(self.said[0])} characters: {last}"
        return "" if any(name in last for name in names) else f"names none of {names}: {last}"


def outcome(main: Callable[[], None], arguments: list[str], solvers: list[tuple[Any, str]]) -> Outcome:
    """Run a stage in a process of its own up to its solvers, given as owners and names."""

    def prepare() -> None:
        signal.alarm(PATIENCE)
        spent = math.ceil(time.process_time())
        resource.setrlimit(resource.RLIMIT_CPU, (spent + LONGEST, spent + LONGEST + 1))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        for owner, name in solvers:
            setattr(owner, name, reached)

    def until_solved() -> None:
        try:
            main()
        except Reached:
            print("SOLVER REACHED")

    begun = time.monotonic()
    child = fork(until_solved, arguments, prepare)
    code = child.end()
    lines = [line for line in re.split(r"[\r\n]+", child.said) if not OTHER.search(line)]
    said = tuple(line for line in lines if line != "SOLVER REACHED")
    return Outcome(code, said, time.monotonic() - begun, len(said) < len(lines))


def write(path: Path, content: bytes) -> Path:
    """A file with that content."""
    path.write_bytes(content)
    return path


OTHER_ARRAYS = [
    np.zeros(()),
    np.zeros(0),
    np.zeros((2, 2)),
    np.full(9, np.nan),
    np.full(9, np.inf),
    np.arange(9),
    np.array([b"text"] * 3),
    np.array("text", dtype=h5py.string_dtype()),
    np.array([b"pickled"], dtype=h5py.opaque_dtype(np.dtype("V7"))),
    np.zeros(3, complex),
    np.zeros(3, [("a", "f8"), ("b", "i4")]),
    np.zeros((1, 1, 1, 1, 1)),
    np.zeros(3, np.int8),
]
OTHER_ATTRIBUTES = [
    "",
    "text",
    "{",
    "[1",
    "{}",
    "[]",
    1,
    -1.5,
    float("nan"),
    np.zeros(3),
    "x" * 10_000,
    np.zeros((2, 0)),
]


@st.composite
def edited_file(draw: st.DrawFn, path: Path) -> None:
    """Change one thing in a file, as by a program that knows of the checksum: it fits again."""
    if path.suffix in (".h5", ".vtkhdf"):
        with edited(path) as file:
            edit_hdf5(draw, file)
    elif path.suffix == ".parquet":
        frame = pd.read_parquet(path)
        column = draw(st.sampled_from(list(frame.columns)))
        found = draw(st.sampled_from([frame.drop(columns=column), frame.assign(**{column: "x"}), frame.iloc[:0]]))
        write_parquet(path, found.to_parquet(index=False))
    elif path.suffix == ".json":
        changed = draw(mutated(read_json(path)))
        path.write_bytes(with_checksum(json.dumps(changed).encode() + b"\n"))
    else:
        rows = [json.loads(line) for line in read_lines(path)]
        text = "".join(f"{json.dumps(row)}\n" for row in draw(mutated(rows)))
        path.write_bytes(with_checksum(text.encode(), 0, b'{"checksum": "', b'"}\n'))


def edit_hdf5(draw: st.DrawFn, file: h5py.File) -> None:
    """Delete, or replace by another one, a dataset or an attribute of a file."""
    names: list[str] = []
    file.visit(names.append)
    owner = file[draw(st.sampled_from(["/", *names]))]
    gone = draw(st.booleans())
    if len(owner.attrs) and (owner.name == "/" or draw(st.booleans())):
        key = draw(st.sampled_from(sorted(owner.attrs)))
        del owner.attrs[key]
        if not gone:
            owner.attrs[key] = draw(st.sampled_from(OTHER_ATTRIBUTES))
    elif owner.name != "/":
        old, name = owner[()] if isinstance(owner, h5py.Dataset) else 0.0, owner.name
        del file[name]
        if not gone:
            other = np.asarray(old)
            alike = [other[: len(other) // 2], other.T, -other] if other.ndim and other.dtype.kind in "fi" else []
            file[name] = draw(st.sampled_from([*OTHER_ARRAYS, *alike]))
