"""What a running flight has written so far, and the checkpoint from which it goes on to the same bits.

A folder beside the output holds raw rows and frames, appended to, and one checkpoint, replaced as a whole. What lies
behind the lengths that the checkpoint knows was written after it and is cut off; what lies before must have its
checksums.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from beamrider.io.checksum import append_checksum, fault
from beamrider.io.files import InputError, atomic

#: Files that are appended to.
STREAMS = ("rows", "frames")
#: What reading a truncated, foreign or otherwise broken checkpoint raises.
UNREADABLE = (ValueError, TypeError, OSError, zipfile.BadZipFile, KeyError, EOFError)


def leaves(tree: Any, prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Names and arrays (...) of nested named tuples, in order."""
    for name, value in zip(tree._fields, tree, strict=True):
        if isinstance(value, tuple):
            yield from leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def without(tree: Any, other: Any) -> Any:
    """Nested named tuples, with nothing in place of arrays that another tree holds as well."""
    known = {id(value) for _, value in leaves(other)}

    def left(value: Any) -> Any:
        if isinstance(value, tuple):
            return type(value)(*map(left, value))
        return value[:0] if isinstance(value, np.ndarray) and id(value) in known else value

    return left(tree)


def numbers_digest(tree: Any) -> str:
    """SHA-256 of all numbers of nested named tuples: name, type, shape and bits of each array and scalar."""
    sums = hashlib.sha256()
    for name, value in leaves(tree):
        if name.endswith("profile.functions"):  # addresses; what lies there is in the digest of compiled sources
            continue
        array = np.ascontiguousarray(value)
        sums.update(f"{name} {array.dtype.str} {np.shape(value)} ".encode() + array.tobytes())
    return sums.hexdigest()


class Journal:
    """Rows (·, width) and frames (·, size) of a flight in a folder; InputError where a file lies in its place."""

    def __init__(self, folder: Path, width: int, size: int) -> None:
        self._folder = folder
        self._width, self._size = width, size
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: must be a folder, for the flight in progress, or absent; remove or rename it")
        folder.mkdir(parents=True, exist_ok=True)
        self._sums = dict.fromkeys(STREAMS, 0)

    def _path(self, name: str) -> Path:
        return self._folder / name

    def _append(self, name: str, values: Floats) -> None:
        content = np.ascontiguousarray(values, "<f8").tobytes()
        try:
            with open(self._path(name), "ab") as stream:
                stream.write(content)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path(name))) from None
        self._sums[name] = zlib.crc32(content, self._sums[name])

    def add_rows(self, rows: Floats) -> None:
        """Append rows (k, width)."""
        self._append("rows", rows)

    def add_frame(self, *parts: Floats) -> None:
        """Append one frame, the numbers of its parts one after the other."""
        self._append("frames", np.concatenate([part.ravel() for part in parts]))

    def _read(self, name: str, width: int) -> Floats:
        path = self._path(name)
        if not path.exists() or path.stat().st_size == 0:
            return np.empty((0, width))
        return np.memmap(path, dtype="<f8", mode="r").reshape(-1, width)

    @property
    def folder(self) -> Path:
        """Where everything is."""
        return self._folder

    @property
    def rows(self) -> Floats:
        """All rows (k, width) so far."""
        return self._read("rows", self._width)

    @property
    def frames(self) -> Floats:
        """All frames (k, size) so far."""
        return self._read("frames", self._size)

    def save(self, fingerprint: str, counters: dict[str, float], *trees: Any) -> None:
        """Replace the checkpoint: counters and all arrays of the trees. OSError where the disk is full."""
        arrays: dict[str, Any] = {f"{i}.{name}": value for i, tree in enumerate(trees) for name, value in leaves(tree)}
        sizes, sums = [self._length(name) for name in STREAMS], [self._sums[name] for name in STREAMS]
        with atomic(self._path("checkpoint.npz")) as temporary:
            with open(temporary, "wb") as stream:
                np.savez(
                    stream,
                    fingerprint=np.array(fingerprint),
                    sizes=np.array(sizes),
                    sums=np.array(sums),
                    **(arrays | counters),
                )
            append_checksum(temporary)

    def _length(self, name: str) -> int:
        return self._path(name).stat().st_size if self._path(name).exists() else 0

    def restore(self, fingerprint: str, *trees: Any) -> dict[str, float] | None:
        """Fill the trees from the checkpoint and return its counters; None if there is none of this flight.

        A checkpoint that cannot be read counts as none, with a note on standard error.
        """
        path = self._path("checkpoint.npz")
        for stale in self._folder.glob(".*.part"):
            stale.unlink()
        if path.exists():
            try:
                if found := fault(path):
                    raise ValueError(found)
                with np.load(path, allow_pickle=False) as data:
                    kept = {name: data[name] for name in data.files}
                if str(kept.pop("fingerprint")) == fingerprint:
                    return self._take(kept, trees)
            except UNREADABLE as error:
                print(f"{path}: not a readable checkpoint ({error}); starting anew", file=sys.stderr)
        self._clear()
        return None

    def _take(self, kept: dict[str, NDArray[Any]], trees: tuple[Any, ...]) -> dict[str, float]:
        """Counters of a checkpoint's arrays, whose numbers go to the trees only when all of them fit."""
        pairs = [(value, kept.pop(f"{i}.{name}")) for i, tree in enumerate(trees) for name, value in leaves(tree)]
        lengths, sums = (dict(zip(STREAMS, kept.pop(name).tolist(), strict=True)) for name in ("sizes", "sums"))
        if any(value.shape != new.shape for value, new in pairs):
            raise ValueError("arrays of another shape")
        for name, length in lengths.items():
            if length > self._length(name):
                raise ValueError(f"'{name}' is shorter than it says")
            if self._checksum(name, length) != sums[name]:
                raise ValueError(f"'{name}' has changed since")
        counters = {name: value.item() for name, value in kept.items()}
        for name, length in lengths.items():
            with open(self._path(name), "ab") as stream:
                stream.truncate(length)
        for value, new in pairs:
            value[...] = new
        self._sums = sums
        return counters

    def _checksum(self, name: str, length: int) -> int:
        """CRC-32 of the first `length` bytes of a stream, read in pieces."""
        value = 0
        if length > 0:
            with open(self._path(name), "rb") as stream:
                while length > 0 and (content := stream.read(min(length, 1 << 20))):
                    value, length = zlib.crc32(content, value), length - len(content)
        return value

    def _clear(self) -> None:
        self._sums = dict.fromkeys(STREAMS, 0)
        for name in STREAMS:
            self._path(name).unlink(missing_ok=True)

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self._folder, ignore_errors=True)
