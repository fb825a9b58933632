"""What a running flight has written so far, and the checkpoint from which it goes on to the same bits.

A folder beside the output holds raw rows and frames, appended to, and one checkpoint, replaced as a whole. What lies
behind the lengths that the checkpoint knows was written after it and is cut off.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.files import atomic

Floats = NDArray[np.float64]


def leaves(tree: Any, prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Names and arrays of nested named tuples, in order."""
    for name, value in zip(tree._fields, tree, strict=True):
        if isinstance(value, tuple):
            yield from leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


class Journal:
    """Rows (·, width) and frames (·, size) of a flight in a folder."""

    def __init__(self, folder: Path, width: int, size: int) -> None:
        self._folder = folder
        self._width, self._size = width, size
        folder.mkdir(parents=True, exist_ok=True)

    def _path(self, name: str) -> Path:
        return self._folder / name

    def _append(self, name: str, values: Floats) -> None:
        with open(self._path(name), "ab") as stream:
            stream.write(np.ascontiguousarray(values, "<f8").tobytes())

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
    def rows(self) -> Floats:
        """All rows (k, width) so far."""
        return self._read("rows", self._width)

    @property
    def frames(self) -> Floats:
        """All frames (k, size) so far."""
        return self._read("frames", self._size)

    def save(self, fingerprint: str, counters: dict[str, float], *trees: Any) -> None:
        """Replace the checkpoint: counters and all arrays of the trees."""
        arrays = {f"{i}.{name}": value for i, tree in enumerate(trees) for name, value in leaves(tree)}
        sizes = [self._path(name).stat().st_size if self._path(name).exists() else 0 for name in ("rows", "frames")]
        with atomic(self._path("checkpoint.npz")) as temporary, open(temporary, "wb") as stream:
            np.savez(stream, fingerprint=np.array(fingerprint), sizes=np.array(sizes), **arrays, **counters)

    def restore(self, fingerprint: str, *trees: Any) -> dict[str, float] | None:
        """Fill the trees from the checkpoint and return its counters; None if there is none of this flight."""
        path = self._path("checkpoint.npz")
        if not path.exists():
            self._clear()
            return None
        with np.load(path) as data:
            if str(data["fingerprint"]) != fingerprint:
                self._clear()
                return None
            for i, tree in enumerate(trees):
                for name, value in leaves(tree):
                    value[...] = data[f"{i}.{name}"]
            for name, size in zip(("rows", "frames"), data["sizes"], strict=True):
                with open(self._path(name), "ab") as stream:
                    stream.truncate(int(size))
            scalars = [name for name in data.files if "." not in name and name not in ("fingerprint", "sizes")]
            return {name: data[name].item() for name in scalars}

    def _clear(self) -> None:
        for name in ("rows", "frames"):
            self._path(name).unlink(missing_ok=True)

    def remove(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self._folder, ignore_errors=True)
