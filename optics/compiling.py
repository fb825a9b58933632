"""Says that machine code is being made, where it has to be, so that nobody takes it for a slow start of the work."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

from numba.core import event


class _Teller(event.Listener):
    """Writes one line at the first function that is compiled, none where all comes from the cache."""

    def __init__(self, about: str) -> None:
        self._about, self._told = about, False

    def on_start(self, event: Any) -> None:
        """A function is not in the cache."""
        if not self._told:
            self._told = True
            print(f"compiling, about {self._about}, once", file=sys.stderr, flush=True)

    def on_end(self, event: Any) -> None:
        """A function is done."""


@contextlib.contextmanager
def compiling(about: str) -> Iterator[None]:
    """Say on standard error if anything is compiled within, `about` how long all of it takes on a quiet core."""
    with event.install_listener("numba:compile", _Teller(about)):
        yield
