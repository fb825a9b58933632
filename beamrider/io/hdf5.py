"""HDF5 files as a whole: made in memory, written by plain writes with a checksum, read once that fits, without locks.

HDF5 does not outlive a disk that is full or fails: it ends the process where it closes the file (versions 1.14, 2.0).
Plain writes raise OSError. On a damaged file HDF5 may not return at all. Files that are renamed into place when they
are whole need no locks, and some file systems have none: HDF5 would refuse to open them there (errors 37 and 38).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from beamrider.io.checksum import trailer
from beamrider.io.files import atomic, require_whole
from beamrider.provenance.record import as_attribute


def read_hdf5(path: str | Path) -> h5py.File:
    """The HDF5 file at `path`, open for reading; InputError where it is damaged."""
    require_whole(path)
    return h5py.File(path, "r", locking=False)


def real(data: h5py.Dataset) -> NDArray[np.float64]:
    """The real numbers (...) of a dataset; TypeError where it holds others, or none."""
    if data.dtype.kind not in "fiu":
        raise TypeError(f"{data.name} must hold real numbers")
    return np.asarray(data, float)


def write_hdf5(path: str | Path, content: bytes | memoryview) -> None:
    """Write a file and its checksum, atomically. OSError names it where the disk is full."""
    with atomic(path) as temporary, open(temporary, "wb") as stream:
        stream.write(content)
        stream.write(trailer(content))


@contextlib.contextmanager
def new_hdf5(path: str | Path) -> Iterator[h5py.File]:
    """Yield an HDF5 file in memory, to be filled; on success it is written to `path`, atomically, with what made it."""
    with h5py.File.in_memory() as file:
        yield file
        file.attrs.update(as_attribute())
        file.flush()
        content = file.id.get_file_image()
    write_hdf5(path, content)
