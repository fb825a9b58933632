"""What this machine has: memory that is free for this process, room on a disk; and refusals of what needs more."""

from __future__ import annotations

import re
import resource
import shutil
from collections.abc import Iterator
from pathlib import Path

from beamrider.io.files import InputError, amount

#: Forecasts of memory are right within this share (`tests/dynamics/test_forecast`): so much more must be free.
MARGIN = 0.2
MINUTE, HOUR, DAY, YEAR = 60.0, 3600.0, 86400.0, 3.15576e7


def available_memory(root: Path = Path("/")) -> float:
    """Bytes that this process may still take: free and reclaimable ones, its control groups' and its own limits.

    Linux: proc(5), cgroups(7). Infinite where nothing says it.
    """
    return max(0.0, min([*_of_machine(root), *_of_groups(root), *_of_process(root)], default=float("inf")))


def _numbers(path: Path) -> dict[str, float]:
    """Lines 'name value' or 'name: value kB' of a file, in bytes; nothing where there is no such file."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    found = (re.fullmatch(r"(\w+):?\s+(\d+)( kB)?", line) for line in lines)
    return {line[1]: float(line[2]) * (1024.0 if line[3] else 1.0) for line in found if line}


def _number(path: Path) -> float | None:
    """The number that a file holds; None where it holds none, as 'max'."""
    try:
        return float(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _of_machine(root: Path) -> Iterator[float]:
    memory = _numbers(root / "proc/meminfo")
    if "MemAvailable" in memory:
        yield memory["MemAvailable"]


def _of_groups(root: Path) -> Iterator[float]:
    """What the control groups of this process leave, of version 2 and of version 1, with all groups above them."""
    try:
        lines = (root / "proc/self/cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers == "memory":
            top, limit, usage = root / "sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
        elif controllers == "":
            top, limit, usage = root / "sys/fs/cgroup", "memory.max", "memory.current"
        else:
            continue
        here = top / path.lstrip("/")
        for group in (here, *here.parents):
            most, used = _number(group / limit), _number(group / usage)
            if most is not None and used is not None:
                yield most - used + _numbers(group / "memory.stat").get("inactive_file", 0.0)
            if group == top:
                break


def _of_process(root: Path) -> Iterator[float]:
    """What the limit on this process's address space leaves."""
    limit, used = resource.getrlimit(resource.RLIMIT_AS)[0], _numbers(root / "proc/self/status").get("VmSize")
    if limit != resource.RLIM_INFINITY and used is not None:
        yield limit - used


def free_disk(path: Path) -> float:
    """Bytes free on the disk of a file or folder that is, or is to be."""
    return float(shutil.disk_usage(_existing(path)).free)


def _existing(path: Path) -> Path:
    """The path itself, or the nearest folder above it that exists."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


def require_memory(needed: float, given: str, cure: str) -> None:
    """InputError, beginning with the key and its value, where so many bytes are not free."""
    free = available_memory()
    if needed * (1.0 + MARGIN) > free:
        most = amount(needed * (1.0 + MARGIN), "B")
        raise InputError(
            f"{given}: would take {amount(needed, 'B')} of memory, or up to {most}; this machine has "
            f"{amount(free, 'B')} free; {cure}"
        )


def require_disk(needed: float, path: Path, given: str, cure: str) -> None:
    """InputError, beginning with the key and its value, where so many bytes have no room beside `path`."""
    free = free_disk(path)
    if needed > free:
        has = f"the disk of {_existing(path)} has {amount(free, 'B')} free"
        raise InputError(f"{given}: would write {amount(needed, 'B')}; {has}; {cure}")


def in_words(seconds: float) -> str:
    """A time in two digits and a unit that suits it: '0.12 s', '50 s', '14 min', '3.2 days'."""
    for unit, size, until in (("s", 1.0, 99.5), ("min", MINUTE, 99.5), ("h", HOUR, 47.5), ("days", DAY, 999.5)):
        if seconds < until * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds / YEAR:.3g} years"
