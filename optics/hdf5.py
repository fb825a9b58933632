"""HDF5 files as a whole: made in memory, written by plain writes.

HDF5 does not outlive a disk that is full or fails: it ends the process where it closes the file (versions 1.14, 2.0).
Plain writes raise OSError.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import h5py

from optics.files import atomic


def write_bytes(path: str | Path, content: bytes | memoryview) -> None:
    """Write a file atomically. OSError names it where the disk is full."""
    with atomic(path) as temporary:
        temporary.write_bytes(content)


@contextlib.contextmanager
def new_hdf5(path: str | Path) -> Iterator[h5py.File]:
    """Yield an HDF5 file in memory, to be filled; on success it is written to `path`, atomically."""
    with h5py.File.in_memory() as file:
        yield file
        file.flush()
        content = file.id.get_file_image()
    write_bytes(path, content)
