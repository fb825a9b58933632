"""Let a Snakemake that was killed stand in nobody's way: its locks go, where none lives that could hold them.

    python -m workflow.unlock COMMAND …      COMMAND, `snakemake --unlock`, is run where locks are left over

Snakemake locks the folder in which it works and says no more than that it is locked, whether another one works there or
one was killed. Who works there is seen from the processes of this host; work on another host, of which the folder's
locks tell nothing, is remembered in `.snakemake/host`.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from beamrider.io.files import InputError, run_stage

LOCKS, HOST = Path(".snakemake/locks"), Path(".snakemake/host")


def _process(folder: Path) -> tuple[bool, Path | None]:
    """Is a process, given as its folder in /proc, a Snakemake; and the folder it works in, None where it is gone."""
    try:
        words = folder.joinpath("cmdline").read_bytes().decode(errors="replace").split("\0")
        return any(Path(word).name == "snakemake" for word in words[:4]), folder.joinpath("cwd").resolve(strict=True)
    except OSError:
        return False, None


def working(here: Path, proc: Path = Path("/proc")) -> Iterator[int]:
    """Numbers of the Snakemakes of this host that work in a folder."""
    for folder in proc.iterdir():
        if folder.name.isdecimal() and int(folder.name) != os.getpid() and _process(folder) == (True, here.resolve()):
            yield int(folder.name)


def unlock(command: list[str], here: Path) -> None:
    """Run the command that takes left-over locks off a folder; InputError where they are those of who works there."""
    locked, last, host = any((here / LOCKS).glob("*")), here / HOST, socket.gethostname()
    for process in working(here) if locked else ():
        raise InputError(f"{here}: results are being made here by process {process}; wait for it, or end it")
    if locked and last.exists() and (other := last.read_text(encoding="utf-8").strip()) != host:
        raise InputError(
            f"{here}: locked by a Snakemake on {other}; wait for it, or end it; if it is no more: {' '.join(command)}"
        )
    if locked:
        print(f"{here}: locked by a Snakemake that is no more; unlocked", file=sys.stderr)
        subprocess.run(command, cwd=here, check=True, capture_output=True)
    last.parent.mkdir(parents=True, exist_ok=True)
    last.write_text(f"{host}\n", encoding="utf-8")


if __name__ == "__main__":
    run_stage(lambda: unlock(sys.argv[1:], Path.cwd()))
