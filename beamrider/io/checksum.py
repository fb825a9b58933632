"""Files that say whether they are whole: a checksum of all their bytes, looked at before any library opens them.

The text 'beamrider sha256 ' and 64 digits stand once in a file: the SHA-256 of all its other bytes, whatever its kind.
In HDF5 and NumPy files it follows the end, which their libraries pass over; in Parquet it stands between the data and
the footer, which is found from the end; in JSON it is a key, in YAML a comment, in a list of JSON its first line. A
file that is moved or copied keeps it, other programs read the file as ever, and a damaged one, in which HDF5 may not
return at all, is never opened.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import BinaryIO

MARK = b"beamrider sha256 "
LENGTH = len(MARK) + 64
#: Bytes at the beginning or the end of a file among which the checksum stands, and those that are read at once.
HEAD, TAIL, PIECE = 1 << 12, 1 << 20, 1 << 20


def with_checksum(content: bytes, at: int | None = None, before: bytes = b"", after: bytes = b"\n") -> bytes:
    """The content with its checksum at a place of it, by default the end, between the bytes `before` and `after`."""
    at, whole = len(content) if at is None else at, memoryview(content)
    sums = hashlib.sha256()
    for part in (whole[:at], before, after, whole[at:]):
        sums.update(part)
    return b"".join((whole[:at], before, MARK, sums.hexdigest().encode(), after, whole[at:]))


def trailer(content: bytes | memoryview) -> bytes:
    """The checksum that follows a content at its end."""
    return MARK + hashlib.sha256(content).hexdigest().encode()


def append_checksum(path: Path) -> None:
    """Let a file's checksum follow its end."""
    with open(path, "r+b") as stream:
        sums = hashlib.sha256()
        while piece := stream.read(PIECE):
            sums.update(piece)
        stream.write(MARK + sums.hexdigest().encode())


def fault(path: str | Path, needed: bool = True) -> str:
    """What is wrong with a file, in words that follow its name; '' where it is whole. OSError where it can't be read.

    needed: whether it must have a checksum at all; files that users write as well need none.
    """
    with open(path, "rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        at = _find(stream, size)
        if at < 0 or at + LENGTH > size:
            none = "not whole: cut off, or not a file that this version of Beamrider made"
            return none if needed or at >= 0 else ""
        stream.seek(at + len(MARK))
        said, sums = stream.read(LENGTH - len(MARK)), hashlib.sha256()
        for start, stop in ((0, at), (at + LENGTH, size)):
            stream.seek(start)
            while start < stop and (piece := stream.read(min(PIECE, stop - start))):
                sums.update(piece)
                start += len(piece)
    if sums.hexdigest().encode() == said:
        return ""
    return "not whole: damaged or edited after it was made (its checksum does not fit)"


def _find(stream: BinaryIO, size: int) -> int:
    """Where the checksum of a file begins, −1 where there is none."""
    for start, length in ((max(0, size - TAIL), TAIL), (0, HEAD)):
        stream.seek(start)
        if (found := stream.read(length).rfind(MARK)) >= 0:
            return start + found
    return -1
