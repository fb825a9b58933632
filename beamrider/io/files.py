"""Files at the edge: strict YAML in, atomic files out, one-line errors, progress. Used by every stage."""

from __future__ import annotations

import contextlib
import difflib
import importlib.metadata
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from tqdm import tqdm

from beamrider.io.checksum import fault, with_checksum
from beamrider.io.errors import InputError as InputError
from beamrider.io.lock import claim, release
from beamrider.io.wording import brief, describe, shortened
from beamrider.io.yaml12 import MOST_BYTES, Loader, within_reason
from beamrider.io.yaml12 import scalar as scalar
from beamrider.provenance import record as made

# Field types of the configuration: wide enough for everything, narrow enough for every number that follows to be one.
Number = Annotated[float, Field(ge=-1e30, le=1e30)]
Positive = Annotated[float, Field(ge=1e-30, le=1e30)]
NonNegative = Annotated[float, Field(ge=0, le=1e30)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
# Part of the names of files: not of a folder above, nor a hidden one, nor an option of a command.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=100)]
#: The unit of numbers whose key names none; others, as 'steps', are given alike (`beamrider.schema`).
DIMENSIONLESS: dict[str, Any] = {"unit": "1"}


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


def load_yaml(path: str | Path) -> Any:
    """Content of a YAML file; InputError names the file and the line when it can't be read."""
    require_whole(path, needed=False)
    try:
        with open(path, encoding="utf-8") as stream:
            text = stream.read(MOST_BYTES + 1)
        if len(text) > MOST_BYTES:
            raise InputError(f"{path}: must be of at most {MOST_BYTES:,} characters")
        return within_reason(yaml.load(text, Loader=Loader))
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}, line {mark.line + 1}" if mark else str(path)
        said = " ".join(str(getattr(error, "problem", None) or error).split())[:150]
        raise InputError(f"{where}: not valid YAML: {said}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid YAML: nested too deeply") from None
    except (ValueError, LookupError, AttributeError, TypeError) as error:  # of values that are none of their type
        raise InputError(f"{path}: not valid YAML: {' '.join(str(error).split())[:100]}") from None


def read_mapping(path: str | Path) -> dict[Any, Any]:
    """Content of a YAML file, which maps keys to values; InputError where it is anything else."""
    data = load_yaml(path)
    if not isinstance(data, dict):
        given = "empty" if data is None else brief(data)
        raise InputError(f"{path}: must be a mapping of keys to values; it is {given}")
    return data


def validate(data: Any, model: type[Model], source: str | Path, context: Mapping[str, Any] | None = None) -> Model:
    """`data` as a `model`; InputError names `source`, the field, the value given and what is allowed.

    context: what fields take from outside of themselves, see the model.
    """
    try:
        return model.model_validate(data, context=context)
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


def take_out(path: str | Path) -> None:
    """`check_out`, and be the only one who writes there until the stage ends; InputError names who does."""
    check_out(path)
    claim(path)


def write_json(path: str | Path, data: Mapping[str, Any]) -> None:
    """`data` as readable JSON with a checksum and what made it, atomically. NaN is refused."""
    if record := made.made_from():
        data = {**data, made.NAME: record}
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    with atomic(path) as temporary:
        temporary.write_bytes(with_checksum(text.encode(), len(text.encode()) - 3, b',\n "checksum": "', b'"'))


def read_json(path: str | Path, needed: bool = True) -> dict[str, Any]:
    """What `write_json` wrote; InputError where it is not that, or damaged. needed: as in `whole`."""
    require_whole(path, needed)
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a readable JSON file ({one_line(error)})") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: must be a mapping of keys to values; it is {brief(data)}")
    if data.pop("checksum", None) is not None:
        require_whole(path)  # also where the checksum itself is damaged
    data.pop(made.NAME, None)
    return data


def write_lines(path: str | Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Mappings as JSON, one a line, after a line of their checksum, atomically."""
    text = "".join(f"{json.dumps(row, allow_nan=False)}\n" for row in rows)
    with atomic(path) as temporary:
        temporary.write_bytes(with_checksum(text.encode(), 0, b'{"checksum": "', b'"}\n'))


def read_lines(path: str | Path) -> list[str]:
    """Lines that `write_lines` wrote, or a user, without that of the checksum; InputError where they are damaged."""
    require_whole(path, needed=False)
    with reading(path, "readable text"):
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    if not (lines and lines[0].startswith('{"checksum": ')):
        return lines
    require_whole(path)  # also where the checksum itself is damaged
    return lines[1:]


def whole(path: str | Path, needed: bool = True) -> str:
    """What keeps a file that Beamrider made from being used, and what to do, in one line; '' where it is whole.

    needed: whether it must have a checksum; files that users write as well need none, but one that is there must fit.
    """
    try:
        found = fault(path, needed)
    except FileNotFoundError:
        return f"{path}: no such file"
    except OSError as error:
        return f"{path}: cannot be read ({error.strerror})"
    cure = (
        "delete it, and give the command again that made it"
        if needed
        else (
            "delete it, and give the command again that made it; "
            "or delete its checksum, to use it as a file of your own"
        )
    )
    return f"{path}: {found}; {cure}" if found else ""


def require_whole(path: str | Path, needed: bool = True) -> None:
    """InputError where a file is not `whole`: before a library opens it."""
    if said := whole(path, needed):
        raise InputError(said)


@contextlib.contextmanager
def reading(path: str | Path, what: str) -> Iterator[None]:
    """While a whole file is taken apart: what is missing in it, or of another kind than it must be, as InputError.

    what: what the file should be, in words.
    """
    try:
        yield
    except InputError:
        raise
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, ArithmeticError) as error:
        raise InputError(f"{path}: not {what} ({one_line(error)}); make it again") from None


def one_line(error: BaseException) -> str:
    """Kind and words of an error in one line that is not too long."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:150]


def versions(*packages: str) -> dict[str, str]:
    """Versions of Beamrider and of the named packages, for the record in an output file."""
    return {name: importlib.metadata.version(name) for name in ("beamrider", *packages)}


def progress(items: Iterable[Any], what: str, total: int | None = None, unit: str = "it", initial: int = 0) -> Any:
    """`tqdm` over `items`: a bar with the time to go on a terminal, one line a minute in a log.

    initial: items that an earlier run has done. The time to go follows from the mean rate of this one.
    """
    terminal = sys.stderr.isatty()
    return tqdm(
        items,
        desc=what,
        total=total,
        unit=unit,
        initial=initial,
        smoothing=0,
        mininterval=0.2 if terminal else 60,
        ascii=not terminal,
    )


def _refuse_other_code(main: Path) -> None:
    """InputError where the program of one checkout would compute with the modules of another, the one installed."""
    own = next((folder.parent for folder in main.parents if folder.name == "workflow"), None)
    ours = Path(__file__).resolve().parents[2]
    if own not in (None, ours) and (own / "optics").is_dir():
        name = ".".join(main.relative_to(own).with_suffix("").parts)
        raise InputError(f"{main}: would compute with the modules of {ours}; use python -m {name}")


def run_stage(main: Callable[[], None], program: str | None = None) -> None:
    """Run a stage's `main`; an InputError or a failing disk becomes one line on standard error and exit code 2.

    program: its name, as in `python -m name`, where that is not what runs. Outputs that it was the only writer of are
    others' to write when it ends.
    """
    try:
        said, code = _ended(main, program)  # with what was raised its bar of progress is gone from the line
        if code:
            print(said, file=sys.stderr)
            raise SystemExit(code)
    finally:
        release()


def _ended(main: Callable[[], None], program: str | None) -> tuple[str, int]:
    """What is to be said of how a stage ended, and its exit code."""
    try:
        _refuse_other_code(Path(getattr(sys.modules["__main__"], "__file__", None) or "").resolve())
        with made.by(main, program):
            main()
    except InputError as error:
        return f"error: {shortened(str(error))}", 2
    except KeyboardInterrupt:
        return "interrupted; the same command begins again, or goes on where a stage keeps what it has", 130
    except MemoryError as error:
        return f"error: memory: not enough on this machine for what was asked for ({one_line(error)})", 2
    except OSError as error:
        return f"error: {error.filename or 'input or output'}: {str(error.strerror or error).splitlines()[0]}", 2
    return "", 0


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

    `said`: the end reason, verdict or count. The file is on the disk, and others may write it again.
    """
    size = amount(Path(path).stat().st_size, "B")
    line = f"{path}: {said} ({size}, {watch.seconds:.3g} s, {watch.cpu_seconds:.3g} s of CPU)"
    print("; ".join(" ".join(part.split()) for part in (line, *notes) if part))
    release(path)


def amount(value: float, unit: str) -> str:
    """A number with its unit in three digits, as in '12.3 MB'; from 1 on."""
    power = next((n for n in range(6) if value < 999.5 * 1000.0**n), 6)
    return f"{value / 1000.0**power:.3g} {('', 'k', 'M', 'G', 'T', 'P', 'E')[power]}{unit}"
