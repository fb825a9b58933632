"""What source files mean, kept from run to run by their content: to parse all of them takes a second of every run.

The file is a by-product, as Python's own, in the folder `__pycache__` if there is one: where it cannot be read or
written, or is damaged, files are parsed again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

#: Digest, names imported, and names that only `main` imports.
Names = Sequence[tuple[int, Sequence[str]]]
Kept = tuple[str, Names, Names]
#: Entries that are kept, the newest ones: sources are ten times fewer.
MOST = 2000


class KeptSources:
    """What was found of sources, by digests of their content, of this Python and of the code that finds it."""

    def __init__(self, path: Path, finder: Path) -> None:
        self._path, self._new = path, False
        self._state = sys.version.encode() + finder.read_bytes()
        self._found: dict[str, Kept] = {}
        with contextlib.suppress(OSError, ValueError):
            first, _, text = path.read_bytes().partition(b"\n")
            if first == hashlib.sha256(text).hexdigest().encode():
                self._found = json.loads(text)

    def name(self, content: bytes) -> str:
        """What a source's entry is called."""
        return hashlib.sha256(self._state + content).hexdigest()[:32]

    def get(self, name: str) -> Kept | None:
        """What is kept under a name, or None."""
        return self._found.get(name)

    def put(self, name: str, kept: Kept) -> None:
        """Keep something under a name, until `save`."""
        self._found[name], self._new = kept, True

    def save(self) -> None:
        """Write all to the disk if there is anything new; where that fails, it is found again by the next run."""
        if not self._new:
            return
        text = json.dumps(dict(list(self._found.items())[-MOST:])).encode()
        with contextlib.suppress(OSError):
            handle, name = tempfile.mkstemp(prefix=f".{self._path.name}.", dir=self._path.parent)
            try:
                with open(handle, "wb") as stream:
                    stream.write(hashlib.sha256(text).hexdigest().encode() + b"\n" + text)
                os.chmod(name, 0o644)
                os.replace(name, self._path)
            finally:
                Path(name).unlink(missing_ok=True)
        self._new = False
