"""Machine code: a folder of its own for every state of the compiled sources, and files that are what was compiled.

Numba looks at a function's own file when it decides whether its cached machine code is current, not at the files of the
functions it calls: after an edit of a called file it would go on with the old code, and with wrong numbers. And it
loads what it finds: a file that a crash or a full disk cut short ends every later run, one with a flipped bit is run.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from numba.core import caching, config

from beamrider.machine_code import entrances, standalone

ROOT = Path(__file__).resolve().parents[2]
VARIABLE = "NUMBA_CACHE_DIR"
_OURS = re.compile(r"numba-[0-9a-f]{16}")
_SUM = hashlib.sha256().digest_size


class Checked(caching.IndexDataCacheFile):
    """Numba's index and data files, each with a SHA-256 sum at its end; one that it doesn't fit is compiled again.

    A data file also holds its key, because two processes that compile at once may both give it the same number, and
    the functions that its code reaches by name (see `standalone`).
    """

    def save(self, key: Any, data: Any) -> None:
        """Keep `data`, or not where the disk is full."""
        with contextlib.suppress(OSError):
            key = (key, entrances.inside())
            super().save(key, (key, data, standalone.called_by(data)))

    def load(self, key: Any) -> Any:
        """What was kept under `key`, whole, or None."""
        key = (key, entrances.inside())
        found = super().load(key)
        return found[1] if found and found[0] == key and standalone.bring(found[2]) else None

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return content + hashlib.sha256(content).digest()

    def _load_index(self) -> Any:
        start = pickle.dumps(self._version, protocol=-1)
        with contextlib.suppress(FileNotFoundError):
            content = Path(self._index_path).read_bytes()
            if content.startswith(start) and _fits(content[len(start) :]):
                return super()._load_index()
        return {}

    def _load_data(self, name: str) -> Any:
        if not _fits(Path(self._data_path(name)).read_bytes()):
            raise OSError("damaged")  # Numba takes the file for missing
        return super()._load_data(name)


class Resolved(caching.UserProvidedCacheLocator):
    """Machine code of a file is one, by whatever link the file is reached: a checkout's, in all folders of results."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, os.path.realpath(py_file))


def _fits(content: bytes) -> bool:
    """Whether the sum at the end fits what stands before it."""
    return hashlib.sha256(content[:-_SUM]).digest() == content[-_SUM:]


def digest(root: Path = ROOT) -> str:
    """Digest of the names and contents of all compiled sources below `root`."""
    sums = hashlib.sha256()
    folders = ("beamrider/machine_code", "optics", "dynamics")
    for path in sorted(path for folder in folders for path in root.glob(f"{folder}/**/*.py")):
        content = path.read_bytes()
        if any(mark in content for mark in (b"njit", b"@intrinsic", b"hook", b"carray", b"standalone")):
            sums.update(path.relative_to(root).as_posix().encode() + b"\0" + content)
    return sums.hexdigest()[:16]


def places(root: Path = ROOT) -> list[Path]:
    """Folders to keep machine code in, best first: the user's choice; or `root`'s, the user's cache, one in /tmp."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return [Path(chosen).parent if _OURS.fullmatch(Path(chosen).name) else Path(chosen)]
    found = [root / "__pycache__"]
    with contextlib.suppress(RuntimeError):  # no home folder
        found.append(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "beamrider")
    return [*found, Path(tempfile.gettempdir()) / f"beamrider-{os.getuid()}"]


def usable(folder: Path) -> bool:
    """Whether this user can write in `folder`, made if need be, and in all folders within.

    In /tmp it must be the user's own and closed to others: who writes there chooses what is run.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        about, within = folder.stat(), [path for path in folder.iterdir() if path.is_dir()]
    except OSError:
        return False
    own = about.st_uid == os.getuid() and not about.st_mode & 0o077
    return (own or folder.parent != Path(tempfile.gettempdir())) and all(os.access(path, os.W_OK) for path in within)


def use_cache(root: Path = ROOT) -> None:
    """Point Numba, here and in child processes, at the folder of these sources; without one, exit code 2."""
    name, tried = f"numba-{digest(root)}", places(root)
    folder = next((place / name for place in tried if usable(place) and usable(place / name)), None)
    if folder is None:
        given = ", ".join(map(str, tried))
        print(f"error: {VARIABLE}: must name a folder to keep compiled code in; cannot use {given}", file=sys.stderr)
        raise SystemExit(2)
    os.environ[VARIABLE] = config.CACHE_DIR = str(folder)
    caching.IndexDataCacheFile = Checked
    entrances.close()
    if Resolved not in caching.CacheImpl._locator_classes:
        caching.CacheImpl._locator_classes.insert(0, Resolved)
