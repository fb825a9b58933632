"""Compiled functions have an entrance from Python where Python calls them, and say themselves what they count."""

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from beamrider.machine_code.streams import uncounted

ROOT = Path(__file__).parents[3]


def ours(function: Callable[..., Any], **options: Any) -> Any:
    """Compiled as one of Beamrider's own."""
    function.__module__ = "dynamics.made_up"
    return numba.njit(function, **options)


def code(function: Any) -> str:
    """Its code, as the compiler made it."""
    return str(function.inspect_llvm(function.signatures[0]))


def test_a_function_that_compiled_code_alone_calls_has_no_entrance():
    """Numba's `no_cpython_wrapper`, `no_cfunc_wrapper`, and its dispatcher's methods."""
    inner = ours(lambda x: 2 * x)
    outer = ours(lambda x: inner(x) + 1)
    assert outer(1) == 3
    assert not any(word in code(inner) for word in ("cpython", "cfunc"))
    assert "cpython" in code(outer)


def test_it_gets_one_when_python_calls_it_and_goes_on_to_serve_compiled_code():
    inner = ours(lambda x: 2 * x)
    outer, other = ours(lambda x: inner(x) + 1), ours(lambda x: inner(x) + 2)
    assert (outer(1), inner(1), inner(2.5), outer(2), other(1), inner(3)) == (3, 2, 5.0, 5, 4, 6)
    assert "cpython" in code(inner)


def test_functions_of_others_are_left_as_numba_makes_them():
    inner = numba.njit(lambda x: 2 * x)
    outer = numba.njit(lambda x: inner(x) + 1)
    assert outer(1) == 3
    assert "cpython" in code(inner)


def test_what_is_called_counts_references_though_its_caller_does_not():
    """Numba would hand `_nrt = False` on to what is compiled for a function with it: here no array could be made."""
    inner = ours(lambda n: np.ones(n).sum())

    def caller(n: int) -> float:
        return inner(n) + 1.0

    caller.__module__ = "dynamics.made_up"
    assert uncounted(cache=False)(caller)(3) == 4.0


def test_every_kernel_says_what_a_division_by_zero_gives():
    """Else the function that calls it first would say so, for all, and the cache would keep it.

    Those that are copied into their callers have these callers' options.
    """
    silent = []
    for path in sorted(file for room in ("optics", "dynamics", "beamrider") for file in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef):
                continue
            for text in map(ast.unparse, node.decorator_list):
                if "njit" in text and "error_model" not in text and "inline='always'" not in text:
                    silent.append(f"{path.relative_to(ROOT)}: {node.name}")
    assert silent == []
