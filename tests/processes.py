"""Programs in forked processes: killed, or on a full disk, without a new start of Python."""

from __future__ import annotations

import io
import os
import re
import resource
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass

from optics.files import run_stage


@dataclass
class Child:
    """A forked process that runs a stage, and the pipe of what it says."""

    process: int
    pipe: int
    said: str = ""

    def end(self) -> int:
        """Wait for its exit code, negative the signal that ended it."""
        with open(self.pipe, "rb") as stream:
            self.said = stream.read().decode()
        return os.waitstatus_to_exitcode(os.waitpid(self.process, 0)[1])


Stage = Callable[[], None]


def fork(main: Stage, arguments: list[str], prepare: Callable[[], object] = lambda: None) -> Child:
    """A child that runs a stage's `main` with command-line arguments, after `prepare` in the child."""
    reading, writing = os.pipe()
    process = os.fork()
    if process:
        os.close(writing)
        return Child(process, reading)
    code = 1
    try:
        os.dup2(writing, 2)
        sys.stderr = sys.stdout = io.TextIOWrapper(io.FileIO(writing, "w"), write_through=True)
        sys.argv = [main.__module__, *arguments]
        prepare()
        run_stage(main)
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def run(main: Stage, arguments: list[str], prepare: Callable[[], object] = lambda: None) -> tuple[int, str]:
    """Exit code and words of a child that runs a stage's `main`."""
    child = fork(main, arguments, prepare)
    return child.end(), child.said


def full_at(size: int) -> Callable[[], None]:
    """No file may grow beyond so many bytes: every write beyond fails, as on a full disk."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


def error(said: str) -> str:
    """The one line with which a run ended, apart from its forecast and its bar of progress."""
    other = re.compile(r"\| \d+/\d+ \[|free\), about |^compiling, ")
    lines = [line for line in said.splitlines() if line and not other.search(line)]
    assert len(lines) == 1
    return lines[0]
