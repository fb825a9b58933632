"""One writer an output: a lock beside it, which ends with the process that holds it, however that ends.

The lock is the kernel's (flock(2)), on `.NAME.lock`, which says who holds it; network file systems pass it on to other
hosts. Where a file system has no locks, who is named there is asked for: a process of this host that is no more, or
whose number another one has now, holds nothing.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import socket
import time
from dataclasses import dataclass
from pathlib import Path

from beamrider.io.errors import InputError

_HOLDER = re.compile(r"process (\d+) on (\S+), begun at (\d+), ")


@dataclass(frozen=True)
class _Claim:
    """An open lock file, its path, and the folders that were made for it, the last one first."""

    handle: int
    place: Path
    made: tuple[Path, ...]


_held: dict[Path, _Claim] = {}


def claim(path: str | Path) -> None:
    """Be the only one who writes an output until `release`, or the end of this process; again is no harm.

    InputError says which process writes it already. What a writer that was killed left half done beside it is removed.
    """
    out = Path(path)
    folder = out.parent.resolve()
    key = folder / out.name
    if key in _held:
        return
    made = tuple(place for place in (folder, *folder.parents) if not place.exists())
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / f".{out.name}.lock"
    _held[key] = _Claim(_locked(place, out), place, made)
    half = re.compile(rf"\.{re.escape(out.name)}\.[a-z0-9_]{{8}}\.part")  # of `beamrider.io.files.atomic`
    for left in folder.iterdir():
        if half.fullmatch(left.name):
            left.unlink(missing_ok=True)


def _locked(place: Path, out: Path) -> int:
    """A locked lock file, which is still the one of that name when it is."""
    while True:
        handle = os.open(place, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            _lock(handle, place, out)
            if _same(handle, place):
                with contextlib.suppress(OSError):  # a full disk: it is locked all the same
                    os.truncate(handle, 0)
                    os.pwrite(handle, _name(os.getpid()).encode(), 0)
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int, place: Path, out: Path) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return
    except BlockingIOError:
        holder, cure = os.pread(handle, 200, 0).decode(errors="replace"), "wait for it, or end it"
    except OSError:  # a file system without locks
        holder = os.pread(handle, 200, 0).decode(errors="replace")
        if not _alive(holder):
            return
        cure = f"wait for it, or end it; if it is no more, delete {place}"
    who = re.sub(r"begun at \d+, ", "", holder) or "another process"
    raise InputError(f"--out = {out}: is being written by {who}; {cure}")


def _same(handle: int, place: Path) -> bool:
    """Is an open file still the one at that place: not one that its holder removed in the meantime."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(place))
    except FileNotFoundError:
        return False


def _name(process: int) -> str:
    now = time.strftime("%Y-%m-%d %H:%M:%S")
    return f"process {process} on {socket.gethostname()}, begun at {_begun(process)}, since {now}"


def _begun(process: int) -> int:
    """When a process of this host began, in ticks since boot (proc(5), stat); 0 where there is none."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return 0
    return int(stat.rpartition(")")[2].split()[19])


def _alive(holder: str) -> bool:
    """Does who is named as holder still run, as far as can be seen from here; of other hosts nothing can."""
    found = _HOLDER.match(holder)
    if not found or int(found[1]) == os.getpid():
        return False
    return found[2] != socket.gethostname() or _begun(int(found[1])) == int(found[3])


def release(path: str | Path | None = None) -> None:
    """Let others write an output again, or all that this process held; folders that stayed empty go."""
    keys = list(_held) if path is None else [Path(path).parent.resolve() / Path(path).name]
    for key in keys:
        if (held := _held.pop(key, None)) is not None:
            held.place.unlink(missing_ok=True)  # while it is locked
            os.close(held.handle)
            with contextlib.suppress(OSError):
                for folder in held.made:
                    folder.rmdir()
