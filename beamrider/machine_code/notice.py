"""Says that machine code is being made, where it has to be, so that nobody takes it for a slow start of the work."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from typing import Any

from numba.core import event


class Compiling(event.Listener):
    """Writes one line at the first function that is compiled, none where all comes from the cache.

    cpu_seconds: what all that is compiled has taken.
    """

    def __init__(self, about: str) -> None:
        self.cpu_seconds = 0.0
        self._about, self._told, self._depth, self._since = about, False, 0, 0.0

    def on_start(self, event: Any) -> None:
        """A function is not in the cache."""
        if not self._told:
            self._told = True
            print(f"compiling, about {self._about}, once", file=sys.stderr, flush=True)
        if self._depth == 0:
            self._since = time.process_time()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """A function is done; those that it calls are within its time."""
        self._depth -= 1
        if self._depth == 0:
            self.cpu_seconds += time.process_time() - self._since


@contextlib.contextmanager
def compiling(about: str) -> Iterator[Compiling]:
    """Say on standard error if anything is compiled within, `about` how long all of it takes on a quiet core."""
    with event.install_listener("numba:compile", listener := Compiling(about)):
        yield listener
