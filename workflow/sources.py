"""Which of the project's own files a program is made of, read from its `import` statements.

Rules take these files as inputs, so an edit re-runs exactly the stages that import the edited module. Imports inside
functions count too, except those of a module's `main`, which runs only where that module is the program. Modules from
outside the project do not count: `constraints.txt` pins those.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path


def _statements(tree: ast.AST, is_program: bool) -> Iterator[ast.AST]:
    """All nodes below `tree`, without the body of `main` unless the module is the program itself."""
    for node in ast.iter_child_nodes(tree):
        if is_program or not (isinstance(node, ast.FunctionDef) and node.name == "main"):
            yield node
            yield from _statements(node, is_program)


def _imports(path: Path, package: tuple[str, ...], is_program: bool) -> Iterator[tuple[str, ...]]:
    """Dotted names, as tuples, that the file at `path` in `package` imports; of `from a import b` both a and a.b."""
    for node in _statements(ast.parse(path.read_bytes(), str(path)), is_program):
        if isinstance(node, ast.Import):
            yield from (tuple(alias.name.split(".")) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = (*above, *(node.module.split(".") if node.module else ()))
            yield base
            yield from ((*base, alias.name) for alias in node.names)


def _files(root: Path, name: tuple[str, ...]) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """Files under `root` that importing `name` runs, each with its package: the module and the packages around it."""
    for depth in range(1, len(name) + 1):
        folder = root.joinpath(*name[:depth])
        if (folder / "__init__.py").is_file():
            yield folder / "__init__.py", name[:depth]
        elif folder.with_suffix(".py").is_file():
            yield folder.with_suffix(".py"), name[: depth - 1]
            return
        elif not folder.is_dir():
            return


def digest(paths: Iterable[str | Path]) -> str:
    """Short digest of the contents of files, in order."""
    return hashlib.sha256(b"\0".join(Path(path).read_bytes() for path in paths)).hexdigest()[:12]


def sources(start: str, root: str | Path = ".") -> list[str]:
    """The program's own files, relative to `root`, sorted: `start` is a module ('optics.modal') or a script's path.

    A script sees the modules of its own folder first, then those of `root`, as Python does.
    """
    root = Path(root)
    script = root / start
    is_script = start.endswith(".py")
    roots = [script.parent, root] if is_script else [root]
    todo = [(script, ())] if is_script else list(_files(root, tuple(start.split("."))))
    program = todo[-1][0] if todo else script
    if program.stem != (script.stem if is_script else start.split(".")[-1]) or not program.is_file():
        raise FileNotFoundError(f"{start}: no such module or script in {root.resolve()}")
    found: dict[Path, None] = {}
    while todo:
        path, package = todo.pop()
        if path not in found:
            found[path] = None
            names = list(_imports(path, package, path == program))
            todo += [file for name in names for base in roots for file in _files(base, name)]
    return sorted(path.relative_to(root).as_posix() for path in found)
