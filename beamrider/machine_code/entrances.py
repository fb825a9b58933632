"""An entrance from Python for those compiled functions alone that Python calls.

Numba gives each function two more, one that takes arguments from Python and one for C, and compiles them with it. For
a function that compiled code alone calls they are never used, and take as long as the function itself; where it is
handed dozens of arrays, several times as long. Here a function of ours that is compiled because compiled code calls it
gets none, and is compiled once more if Python ever calls it, too.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

from numba.core import compiler_lock, cpu, sigutils
from numba.core.registry import CPUDispatcher

_OURS = ("optics", "dynamics")


class _Now(threading.local):
    """Is a function compiled for compiled code that calls it."""

    inside = False


_now = _Now()


@contextlib.contextmanager
def _compiled_for(compiled: bool) -> Iterator[None]:
    before, _now.inside = _now.inside, compiled
    try:
        yield
    finally:
        _now.inside = before


def inside() -> bool:
    """Is a function compiled, or looked for in the cache, for compiled code that calls it."""
    return _now.inside


def for_compiled_code(function: Any, types: tuple[Any, ...]) -> None:
    """Have a function at hand for compiled code that calls it."""
    with _compiled_for(function.py_func.__module__.split(".")[0] in _OURS):
        function.compile(types)


class _Entrances:
    """What takes the place of methods of Numba's dispatcher."""

    call_template, compile, add, for_python = (
        CPUDispatcher.get_call_template,
        CPUDispatcher.compile,
        CPUDispatcher.add_overload,
        CPUDispatcher._compile_for_args,
    )
    finalize = cpu.CPUTargetOptions.finalize


def _get_call_template(self: Any, args: Any, kws: Any) -> Any:
    """Compiled code calls the function."""
    with _compiled_for(self.py_func.__module__.split(".")[0] in _OURS):
        return _Entrances.call_template(self, args, kws)


def _compile_for_args(self: Any, *args: Any, **kws: Any) -> Any:
    """Python calls the function."""
    with _compiled_for(False):
        return _Entrances.for_python(self, *args, **kws)


def _compile(self: Any, sig: Any) -> Any:
    """As Numba's, but that code without an entrance does not serve Python."""
    with compiler_lock.global_compiler_lock:
        types = tuple(sigutils.normalize_signature(sig)[0])
        closed = self.__dict__.setdefault("_closed", set())
        if types in closed and not _now.inside:
            closed.remove(types)
            del self.overloads[types]
        return _Entrances.compile(self, sig)


def _add_overload(self: Any, found: Any) -> None:
    """As Numba's, but that what calls from Python does not find code without an entrance."""
    if not _now.inside:
        _Entrances.add(self, found)
        return
    types = tuple(found.signature.args)
    self.overloads[types] = found
    self.__dict__.setdefault("_closed", set()).add(types)


def _finalize(self: Any, flags: Any, options: Any) -> None:
    """As Numba's, but for entrances, and that references are counted or not as a function says, not as its caller."""
    if _now.inside and not flags.is_set("nrt"):
        flags.nrt = True
    _Entrances.finalize(self, flags, options)
    if _now.inside:
        flags.no_cpython_wrapper, flags.no_cfunc_wrapper = True, True


def close() -> None:
    """Compile functions without entrances where they need none, from now on in this process."""
    CPUDispatcher.get_call_template, CPUDispatcher.compile = _get_call_template, _compile
    CPUDispatcher.add_overload, CPUDispatcher._compile_for_args = _add_overload, _compile_for_args
    cpu.CPUTargetOptions.finalize = _finalize
