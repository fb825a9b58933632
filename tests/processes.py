"""Programs in forked processes: killed, on a full disk, or without file locks, with no new start of Python."""

from __future__ import annotations

import ctypes
import importlib
import io
import os
import platform
import re
import resource
import struct
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass

from beamrider.io.files import run_stage


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


def main_of(name: str) -> Stage:
    """What `python -m name` runs."""
    module = importlib.import_module(name)
    found: Stage = (importlib.import_module(f"{name}.__main__") if hasattr(module, "__path__") else module).main
    return found


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


FLOCK = {"x86_64": 73, "aarch64": 32}  # numbers of the system call


def without_locks(number: int) -> Callable[[], None]:
    """The kernel answers flock with error `number` from now on in this process, as a file system without locks does.

    By a seccomp filter (Linux, Documentation/userspace-api/seccomp_filter.rst): load the number of the system call; if
    it is flock's return the error, else allow it.
    """
    code = [
        (0x20, 0, 0, 0),
        (0x15, 0, 1, FLOCK[platform.machine()]),
        (0x06, 0, 0, 0x00050000 | number),
        (0x06, 0, 0, 0x7FFF0000),
    ]

    def prepare() -> None:
        filters = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in code))
        program = ctypes.create_string_buffer(struct.pack("HL", len(code), ctypes.addressof(filters)))
        prctl = ctypes.CDLL(None, use_errno=True).prctl
        if prctl(38, 1, 0, 0, 0) or prctl(22, 2, program, 0, 0):
            raise OSError(ctypes.get_errno(), "prctl")

    return prepare


def error(said: str) -> str:
    """The one line with which a run ended, apart from its forecast and its bar of progress."""
    other = re.compile(r"\| \d+/\d+ \[|free\), about |^compiling, ")
    lines = [line for line in said.splitlines() if line and not other.search(line)]
    assert len(lines) == 1
    return lines[0]
