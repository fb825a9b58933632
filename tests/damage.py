"""Files that are edited as an HDF5 library would, or a program that knows of the checksum."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import h5py

from beamrider.io.checksum import append_checksum


@contextlib.contextmanager
def edited(path: Path) -> Iterator[h5py.File]:
    """The HDF5 file, open for changes, after which its checksum fits again."""
    with h5py.File(path, "r+") as file:  # cuts off what follows the end that HDF5 knows: the checksum
        yield file
    append_checksum(path)
