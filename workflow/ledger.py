"""Digests of results as they were made: what was altered or cut short since is noticed before it is used."""

from __future__ import annotations

import json
from pathlib import Path

from beamrider.io.files import atomic
from beamrider.provenance.sources import STAMP, digest_of_file


class Ledger:
    """Sizes, times and digests of files, kept from run to run.

    A file whose size and time are those that were written down is not read again. One made since is taken for whole if
    it has the time that Snakemake wrote down as its job ended.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._changed = False
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            self._known: dict[str, list[object]] = {name: entry for name, entry in data.items() if len(entry) == 3}
        except (OSError, ValueError, AttributeError, TypeError):
            self._known = {}

    def whole(self, path: str, made_at: float | None) -> bool:
        """Is a file as it was when its job ended, at the file time `made_at`?"""
        folder, stamp = Path(path).is_dir(), Path(path) / STAMP
        about = (stamp if folder and stamp.exists() else Path(path)).stat()
        at = [about.st_mtime_ns, about.st_size]
        known = self._known.get(path)
        if known and known[:2] == at and not folder:
            return True
        digest = digest_of_file(Path(path))
        made_since = made_at is not None and abs(about.st_mtime - made_at) < 1e-6 and (not known or known[0] != at[0])
        if not made_since and not (known and known[2] == digest):
            return False
        self._known[path], self._changed = [*at, digest], True
        return True

    def examine(self, path: str) -> None:
        """Read a file anew: one whose bytes changed behind its size and time is not whole from now on."""
        known = self._known.get(path)
        if known and Path(path).exists() and digest_of_file(Path(path)) != known[2]:
            self._known[path], self._changed = [known[0], -1, known[2]], True

    def save(self) -> None:
        """Write down what was learnt; not where the folder cannot be written."""
        if self._changed and self.path.parent.is_dir():
            with atomic(self.path) as temporary:
                temporary.write_text(json.dumps(self._known), encoding="utf-8")
            self._changed = False
