"""Files at the edge: strict YAML in, atomic files out, one-line errors, progress. Used by every stage."""

from __future__ import annotations

import contextlib
import difflib
import importlib.metadata
import json
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from tqdm import tqdm

from optics import made
from optics.wording import brief, describe

# Field types of the configuration: wide enough for everything, narrow enough for every number that follows to be one.
Number = Annotated[float, Field(ge=-1e30, le=1e30)]
Positive = Annotated[float, Field(ge=1e-30, le=1e30)]
NonNegative = Annotated[float, Field(ge=0, le=1e30)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]


#: Values that a YAML file may hold, each as often as aliases name it.
MOST_VALUES = 1_000_000


class InputError(ValueError):
    """Something the user gave is wrong. The message is one line: what was given, what is allowed, what to do."""


class Strict(BaseModel):
    """Base of all configuration: no unknown keys, no silent conversion, no NaN, immutable."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            for key in data:
                if key not in cls.model_fields:
                    name = brief(key).strip('"')
                    near = difflib.get_close_matches(name, cls.model_fields, n=1)
                    hint = f"; did you mean '{near[0]}'?" if near else ""
                    raise ValueError(f"unknown key '{name}'{hint} (allowed: {', '.join(cls.model_fields)})")
        return data


Model = TypeVar("Model", bound=BaseModel)


class _Loader(yaml.SafeLoader):
    """The core schema of YAML 1.2 (section 10.3.2 of its specification), and no duplicate keys.

    PyYAML reads YAML 1.1, where 0600 is 384, 1:30 is 90, 1e-3 is text, `no` is false and 2026-01-01 a date.
    """

    yaml_implicit_resolvers: dict[Any, Any] = {}


def _mapping(loader: _Loader, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
    keys = [loader.construct_object(key, deep=True) for key, _ in node.value]
    for key in keys:
        if keys.count(key) > 1:
            raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is given twice", node.start_mark)
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


def _integer(loader: _Loader, node: yaml.ScalarNode) -> int:
    text = loader.construct_scalar(node)
    return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))


_INTEGER = r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+"
_FLOAT = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
for _tag, _pattern in (
    ("null", "null|Null|NULL|~|"), ("bool", "true|True|TRUE|false|False|FALSE"), ("int", _INTEGER), ("float", _FLOAT),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^(?:{_pattern})$"), [None])
_Loader.add_constructor("tag:yaml.org,2002:int", _integer)
_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_yaml(path: str | Path) -> Any:
    """Content of a YAML file; InputError names the file and the line when it can't be read."""
    try:
        with open(path, encoding="utf-8") as stream:
            return within_reason(yaml.load(stream, Loader=_Loader))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}, line {mark.line + 1}" if mark else str(path)
        said = " ".join(str(getattr(error, "problem", None) or error).split())
        raise InputError(f"{where}: not valid YAML: {said}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid YAML: nested too deeply") from None
    except (ValueError, LookupError, AttributeError, TypeError) as error:  # of values that are none of their type
        raise InputError(f"{path}: not valid YAML: {' '.join(str(error).split())[:100]}") from None


def scalar(text: str) -> Any:
    """A value given as text, on the command line, as it would be in a file: '1e-3' is a number, 'modal' stays text."""
    loader = _Loader("")
    return loader.construct_object(yaml.ScalarNode(loader.resolve(yaml.ScalarNode, text, (True, False)), text))


def within_reason(data: Any) -> Any:
    """The data, if it is a tree of at most MOST_VALUES; ValueError where aliases make it more, or endless."""
    sizes: dict[int, int] = {}

    def size(value: Any) -> int:
        if not isinstance(value, dict | list):
            return 1
        if id(value) not in sizes:
            sizes[id(value)] = MOST_VALUES  # met again within itself: endless
            sizes[id(value)] = 1 + sum(map(size, value.values() if isinstance(value, dict) else value))
        return sizes[id(value)]

    if size(data) > MOST_VALUES:
        raise ValueError(f"more than {MOST_VALUES} values, or an alias within what it stands for")
    return data


def read_mapping(path: str | Path) -> dict[Any, Any]:
    """Content of a YAML file, which maps keys to values; InputError where it is anything else."""
    data = load_yaml(path)
    if not isinstance(data, dict):
        given = "empty" if data is None else brief(data)
        raise InputError(f"{path}: must be a mapping of keys to values; it is {given}")
    return data


def validate(data: Any, model: type[Model], source: str | Path) -> Model:
    """`data` as a `model`; InputError names `source`, the field, the value given and what is allowed."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{source}: {describe(error.errors(include_url=False), data, model)}") from None


def read_model(path: str | Path, model: type[Model]) -> Model:
    """The YAML file at `path`, validated as `model`."""
    return validate(read_mapping(path), model, path)


@contextlib.contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Yield a temporary name beside `path`; on success it is renamed to `path`, on failure it is removed.

    OSError of a write that failed, on a full disk for example, names `path`.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        with open(temporary, "rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(temporary), temporary):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def check_out(path: str | Path) -> None:
    """Refuse an output path that could not be written, before anything is computed."""
    path = Path(path)
    if not path.name or path.is_dir():
        raise InputError(f"--out = {str(path)!r}: must be a file name, not a folder")
    parent = path.parent
    while not parent.exists() and parent != parent.parent:
        parent = parent.parent
    if not parent.is_dir():
        raise InputError(f"--out = {path}: {parent} is not a folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"--out = {path}: no permission to write in {parent}")


def write_json(path: str | Path, data: Any) -> None:
    """`data` as readable JSON, atomically, a mapping with what made it. NaN is refused."""
    if isinstance(data, dict) and (record := made.made_from()):
        data = {**data, made.NAME: record}
    text = json.dumps(data, indent=1, allow_nan=False)
    with atomic(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def versions(*packages: str) -> dict[str, str]:
    """Versions of Beamrider and of the named packages, for the record in an output file."""
    return {name: importlib.metadata.version(name) for name in ("beamrider", *packages)}


def progress(items: Iterable[Any], what: str, total: int | None = None, unit: str = "it", initial: int = 0) -> Any:
    """`tqdm` over `items`: a bar with the time to go on a terminal, one line a minute in a log.

    initial: items that an earlier run has done. The time to go follows from the mean rate of this one.
    """
    terminal = sys.stderr.isatty()
    return tqdm(
        items, desc=what, total=total, unit=unit, initial=initial, smoothing=0, mininterval=0.2 if terminal else 60,
        ascii=not terminal,
    )


def _refuse_other_code(script: Path) -> None:
    """InputError where a script of one checkout would compute with the modules of another, the one installed."""
    own = next((folder.parent for folder in script.parents if folder.name == "workflow"), None)
    ours = Path(__file__).resolve().parents[1]
    if own not in (None, ours) and (own / "optics").is_dir():
        raise InputError(f"{script}: would compute with the modules of {ours}; set PYTHONPATH={own}")


def run_stage(main: Callable[[], None]) -> None:
    """Run a stage's `main`; an InputError or a failing disk becomes one line on standard error and exit code 2."""
    try:
        _refuse_other_code(Path(getattr(sys.modules["__main__"], "__file__", None) or "").resolve())
        with made.by(main.__module__):
            main()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        print("interrupted; the same command begins again, or goes on where a stage keeps what it has", file=sys.stderr)
        raise SystemExit(130) from None
    except OSError as error:
        said = str(error.strerror or error).splitlines()[0]
        print(f"error: {error.filename or 'input or output'}: {said}", file=sys.stderr)
        raise SystemExit(2) from None


class Stopwatch:
    """Wall and CPU seconds since it was made."""

    def __init__(self) -> None:
        self._start, self._cpu = time.perf_counter(), time.process_time()

    @property
    def seconds(self) -> float:
        """Elapsed wall time in seconds."""
        return time.perf_counter() - self._start

    @property
    def cpu_seconds(self) -> float:
        """CPU time of this process in seconds, the same on a busy machine and on a quiet one."""
        return time.process_time() - self._cpu


def finish(path: str | Path, watch: Stopwatch, said: str, notes: Iterable[str] = ()) -> None:
    """Say on standard output, in one line, what a stage made: file, how it ended, size, time, and any notes.

    `said`: the end reason, verdict or count. The file is on the disk.
    """
    size = amount(Path(path).stat().st_size, "B")
    line = f"{path}: {said} ({size}, {watch.seconds:.3g} s, {watch.cpu_seconds:.3g} s of CPU)"
    print("; ".join(" ".join(part.split()) for part in (line, *notes) if part))


def amount(value: float, unit: str) -> str:
    """A number with its unit in three digits, as in '12.3 MB'; from 1 on."""
    power = next((n for n in range(6) if value < 999.5 * 1000.0**n), 6)
    return f"{value / 1000.0**power:.3g} {('', 'k', 'M', 'G', 'T', 'P', 'E')[power]}{unit}"
