"""A cache of tables that folders and users share: results by key (`workflow.keys`), each with its digest.

    python -m workflow.shared fetch KEY FILE …     exit code 1 where the cache does not hold them, whole
    python -m workflow.shared store KEY FILE …

The environment variable BEAMRIDER_CACHE names its folder; without it there is none. An entry is a folder, renamed into
place when it is whole, and never changed: of two who store the same, the first is kept. What cannot be stored or
fetched is made as if there were no cache.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

VARIABLE = "BEAMRIDER_CACHE"
SUMS = "sums.json"


def entry(cache: Path, key: str) -> Path:
    """Folder of a key's files."""
    return cache / key[:2] / key


def store(cache: Path, key: str, files: list[Path]) -> bool:
    """Keep files under a key, all or none; False where they are there already."""
    target = entry(cache, key)
    if target.exists():
        return False
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.parent.stat().st_uid == os.getuid():
        target.parent.chmod(cache.stat().st_mode & 0o7777)  # who may write in the cache may write here
    with tempfile.TemporaryDirectory(prefix=".new.", dir=target.parent) as name:
        new = Path(name) / key
        new.mkdir()
        sums = {str(i): copy(file, new / str(i)) for i, file in enumerate(files)}
        (new / SUMS).write_text(json.dumps(sums), encoding="utf-8")
        for path in (new, *new.iterdir()):
            path.chmod(0o755 if path.is_dir() else 0o444)
        try:
            new.rename(target)
        except OSError:
            if not target.exists():
                raise
            return False
    return True


def fetch(cache: Path, key: str, files: list[Path]) -> bool:
    """Bring files of a key to their places, all or none; False where the cache does not hold them, whole."""
    source = entry(cache, key)
    if not source.is_dir():
        return False
    sums = json.loads((source / SUMS).read_text(encoding="utf-8"))
    brought: list[tuple[Path, Path]] = []
    try:
        for i, file in enumerate(files):
            file.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(prefix=f".{file.name}.", suffix=".part", dir=file.parent)
            os.close(handle)
            brought.append((Path(name), file))
            if copy(source / str(i), Path(name)) != sums.get(str(i)):
                print(f"{source / str(i)}: damaged; it is made again{_put_aside(source)}", file=sys.stderr)
                return False
            Path(name).chmod(0o644)
        for temporary, file in brought:
            temporary.replace(file)
        return True
    finally:
        for temporary, _ in brought:
            temporary.unlink(missing_ok=True)


def _put_aside(damaged: Path) -> str:
    """Make room for an entry made again, whoever stored the damaged one; what to add where that is not allowed."""
    aside = damaged.with_name(f".damaged.{damaged.name}.{os.getpid()}")
    try:
        damaged.rename(aside)
    except OSError:
        return f" every time, until {damaged.owner()} deletes {damaged}"
    shutil.rmtree(aside, ignore_errors=True)  # of what belongs to another, the folder stays
    return ""


def copy(source: Path, target: Path) -> str:
    """Copy a file to the disk; digest of what was copied."""
    sums = hashlib.sha256()
    with open(source, "rb") as reading, open(target, "wb") as writing:
        while piece := reading.read(1 << 20):
            sums.update(piece)
            writing.write(piece)
        writing.flush()
        os.fsync(writing.fileno())
    return sums.hexdigest()


def main() -> int:
    """Command line: see the module docstring."""
    what, key, *names = sys.argv[1:]
    cache, files = Path(os.environ[VARIABLE]), list(map(Path, names))
    try:
        if what == "fetch":
            found = fetch(cache, key, files)
            print(f"{' '.join(names)}: {f'from {entry(cache, key)}' if found else f'not in {cache}'}")
            return 0 if found else 1
        stored = store(cache, key, files)
        print(f"{' '.join(names)}: {'kept in' if stored else 'already in'} {entry(cache, key)}")
    except (OSError, ValueError) as error:
        print(f"{cache}: the shared cache is of no use here: {error}", file=sys.stderr)
        return 1 if what == "fetch" else 0
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
