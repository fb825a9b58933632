"""Compiled functions whose machine code stands by itself: those that call them reach it by name, and hold no copy.

Numba links the code of all that a function calls into its own, and optimises and translates that again for each level
of callers: what is called from many places, or from deep below, is compiled many times. A function that does much a
call loses nothing by a call. Its callers' code in the cache holds its name; it must be at hand before theirs is loaded.
"""

from __future__ import annotations

import copy
import hashlib
import importlib
import re
from collections.abc import Callable
from typing import Any

import llvmlite.binding
from numba.core import compiler_lock, serialize, sigutils
from numba.core.registry import CPUDispatcher

from beamrider.machine_code.entrances import for_compiled_code

_PREFIX = "beamrider.standalone."
_NAME = re.compile(re.escape(_PREFIX).encode() + rb"[0-9a-f]{32}")

#: Where a function comes from: module, name there, types of the arguments, name for the linker.
Origin = tuple[str, str, tuple[Any, ...], str]
_offered: dict[str, Origin] = {}


class Standalone(CPUDispatcher):
    """Numba's dispatcher, but that compiled callers get a call by name in place of the code to be linked in."""

    def compile(self, sig: Any) -> Any:
        """Entry point for a signature, from the cache or compiled now; from then on its name is known to the linker."""
        with compiler_lock.global_compiler_lock:
            types = tuple(sigutils.normalize_signature(sig)[0])
            before = self.overloads.get(types)
            entry = super().compile(sig)
            if self.overloads[types] is not before:
                _offer(self, types, entry)
        return entry


def _offer(function: Standalone, types: tuple[Any, ...], entry: Any) -> None:
    """Tell the linker the function's address, and callers its name alone."""
    found, where = function.overloads[types], (function.py_func.__module__, function.py_func.__qualname__)
    # With what is returned: code of callers from before that changed must not reach it.
    text = repr((where, str(types), str(found.signature.return_type)))
    name = _PREFIX + hashlib.sha256(text.encode()).hexdigest()[:32]
    address = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
    llvmlite.binding.add_symbol(name, address)
    called = copy.copy(found.fndesc)
    called.mangled_name = name
    function.targetctx.remove_user_function(entry)
    function.targetctx.insert_user_function(entry, called, [])
    _offered[name] = *where, types, name


def standalone(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of a function that does much a call and is called from several places, or from deep below."""

    def decorate(function: Callable[..., Any]) -> Any:
        given = {"nopython": True, "error_model": "numpy", "boundscheck": None} | options
        made = Standalone(function, targetoptions=given)
        made.enable_caching()
        return made

    return decorate


def called_by(code: Any) -> list[Origin]:
    """The functions that compiled code, as it goes to the cache, reaches by name."""
    names = sorted(set(_NAME.findall(serialize.dumps(code))))
    return [_offered[name.decode()] for name in names if name.decode() in _offered]


def bring(origins: list[Origin]) -> bool:
    """Have these functions at hand; False where one is gone, stands no longer by itself, or returns another type."""
    for module, name, types, called in origins:
        function = getattr(importlib.import_module(module), name, None)
        if not isinstance(function, Standalone):
            return False
        for_compiled_code(function, types)
        if called not in _offered:
            return False
    return True
