"""Docstrings of public functions tell the shapes of arrays that they take and give, or name the function that does."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
ARRAYS = re.compile(r"\b(Floats|Complexes|Integers|Booleans|NDArray|ndarray)\b")
AXIS = r"(?:\.\.\.|\d* ?[A-Za-z_]+|\d+)(?: [+−-] \d+)?"
SHAPE = re.compile(rf"\({AXIS}(?:, {AXIS})*,?\)")
#: What an effect does in a step is described once, in the list of effects.
HOOK = "hook"


def functions(body: list[ast.stmt]) -> Iterator[ast.FunctionDef]:
    """Public functions and methods."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not any("Protocol" in ast.unparse(base) for base in node.bases):
            yield from functions(node.body)
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def silent(function: ast.FunctionDef) -> bool:
    """Has a function arrays of which its docstring tells no shape, and refers to no other's."""
    if HOOK in map(ast.unparse, function.decorator_list):
        return False
    given = [*function.args.args, *function.args.kwonlyargs]
    kinds = [note for note in (*(one.annotation for one in given), function.returns) if note]
    said = ast.get_docstring(function) or ""
    refers = re.match(r"(As|Like|See) `", said)
    return any(ARRAYS.search(ast.unparse(kind)) for kind in kinds) and not (refers or SHAPE.search(said))


def test_docstrings_tell_shapes():
    found = [
        f"{path.relative_to(ROOT)}:{function.lineno}: {function.name}"
        for package in ("beamrider", "optics", "dynamics")
        for path in sorted((ROOT / package).rglob("*.py"))
        for function in functions(ast.parse(path.read_text(encoding="utf-8")).body)
        if silent(function)
    ]
    assert found == []
