"""What a program is made of: the project's own files, read from its `import` statements, and the libraries they import.

A stage is run again where this changes in meaning: syntax trees without docstrings count, not the text. Imports inside
functions count too, except those of a module's `main`, which runs only where that module is the program.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from beamrider.provenance.kept_sources import KeptSources
from beamrider.provenance.libraries import versions_of

Dotted = tuple[str, ...]
ROOT = Path(__file__).parents[2]
STAMP = ".snakemake_timestamp"  # holds the time of a folder that is an output


@dataclass(frozen=True)
class Module:
    """A source file: digest of its syntax tree without docstrings; names that it imports, and that only `main` does."""

    digest: str
    imports: tuple[tuple[int, Dotted], ...]
    imports_of_main: tuple[tuple[int, Dotted], ...]


@dataclass(frozen=True)
class Program:
    """The program's own files, relative to its folder, with digests; the libraries it uses, with versions."""

    files: dict[str, str]
    libraries: dict[str, str]

    @property
    def code(self) -> str:
        """Digest of the meaning of all sources."""
        return digest_of(self.files)

    @property
    def digest(self) -> str:
        """Digest of sources, libraries and Python."""
        return digest_of([self.files, self.libraries])


def digest_of(data: object) -> str:
    """Digest, of 32 hexadecimal figures, of what JSON can write; keys in any order."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:32]


def digest_of_file(path: Path) -> str:
    """SHA-256 digest of a file's bytes, or of all files of a folder with their names; 'missing' where there is none."""
    if path.is_dir():
        files = [part for part in sorted(path.rglob("*")) if part.is_file() and part.name != STAMP]
        parts = [(part.relative_to(path).as_posix(), digest_of_file(part)) for part in files]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    if not path.is_file():
        return "missing"
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def is_text(node: ast.stmt) -> bool:
    """Is a statement nothing but text, as docstrings are."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _without_docstrings(tree: ast.Module) -> ast.Module:
    """The tree itself, its docstrings taken out, those below the fields of classes too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            node.body[1:] = [part for part in node.body[1:] if not is_text(part)]
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if documented and ast.get_docstring(node, clean=False) is not None:  # type: ignore[arg-type]
            del node.body[0]  # type: ignore[attr-defined]
    return tree


def _names(node: ast.AST) -> Iterator[tuple[int, Dotted]]:
    """Level and dotted name, as a tuple, that a statement imports; of `from a import b` both a and a.b."""
    if isinstance(node, ast.Import):
        yield from ((0, tuple(alias.name.split("."))) for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        base = tuple(node.module.split(".")) if node.module else ()
        yield node.level, base
        yield from ((node.level, (*base, alias.name)) for alias in node.names)


@functools.lru_cache(maxsize=4096)
def _read(path: Path, _changed: tuple[int, int]) -> Module:
    content, kept = path.read_bytes(), _kept()
    found = kept.get(name := kept.name(content))
    if found is None:
        module = _parsed(content, path)
        kept.put(name, (module.digest, list(module.imports), list(module.imports_of_main)))
        return module
    imports, of_main = (tuple((level, tuple(base)) for level, base in names) for names in found[1:])
    return Module(found[0], imports, of_main)


@functools.cache
def _kept() -> KeptSources:
    """What sources were found to mean before, in the project's folder."""
    return KeptSources(ROOT / "__pycache__" / "sources.json", Path(__file__))


def _parsed(content: bytes, path: Path) -> Module:
    tree = ast.parse(content, str(path))
    mains = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "main"]
    of_main = [name for main in mains for node in ast.walk(main) for name in _names(node)]
    others = [part for part in tree.body if part not in mains]
    names = [name for part in others for node in ast.walk(part) for name in _names(node)]
    text = ast.dump(_without_docstrings(tree), annotate_fields=False)
    return Module(hashlib.sha256(text.encode()).hexdigest()[:32], tuple(names), tuple(of_main))


def read_module(path: Path) -> Module:
    """What a source file means and imports; read once for as long as the file stays as it is."""
    about = path.stat()
    return _read(path, (about.st_mtime_ns, about.st_size))


@functools.cache
def _files(root: Path, name: Dotted) -> tuple[tuple[Path, Dotted], ...]:
    """Files under `root` that importing `name` runs, each with its package: the module and the packages around it."""
    return tuple(_found(root, name))


def _found(root: Path, name: Dotted) -> Iterator[tuple[Path, Dotted]]:
    for depth in range(1, len(name) + 1):
        folder = root.joinpath(*name[:depth])
        if (folder / "__init__.py").is_file():
            yield folder / "__init__.py", name[:depth]
        elif folder.with_suffix(".py").is_file():
            yield folder.with_suffix(".py"), name[: depth - 1]
            return
        elif not folder.is_dir():
            return


def _modules(start: str, root: Path) -> tuple[dict[Path, Module], set[str]]:
    """The program's own files, and the first names of all other modules that they import."""
    todo = list(_files(root, tuple(start.split("."))))
    if todo and todo[-1][0].name == "__init__.py" and todo[-1][0].with_name("__main__.py").is_file():
        todo.append((todo[-1][0].with_name("__main__.py"), todo[-1][1]))
    program = todo[-1][0] if todo else root
    named = program.parent.name if program.stem in ("__init__", "__main__") else program.stem
    if named != start.split(".")[-1] or not program.is_file():
        raise FileNotFoundError(f"{start}: no such module in {root.resolve()}")
    found: dict[Path, Module] = {}
    others: set[str] = set()
    mains = {program}  # files whose `main` runs: the program's, or the one that it takes for its own
    while todo:
        path, package = todo.pop()
        if path in found:
            continue
        found[path] = module = read_module(path)
        for level, base in (*module.imports, *(module.imports_of_main if path in mains else ())):
            name = (*(package[: len(package) - level + 1] if level else ()), *base)
            files = list(_files(root, name))
            if path == program and files and name[-1] == "main":
                mains.add(files[-1][0])
            todo += files
            others |= set() if files else set(name[:1])
    _kept().save()
    return found, others


def sources(start: str, root: str | Path = ROOT) -> list[str]:
    """The program's own files, relative to `root`, sorted: `start` is a module ('optics.modal')."""
    root = Path(root)
    return sorted(path.relative_to(root).as_posix() for path in _modules(start, root)[0])


def program(start: str, root: str | Path = ROOT) -> Program:
    """What a program under `root` is made of: `start` is a module ('optics.modal')."""
    root = Path(root)
    found, others = _modules(start, root)
    files = {path.relative_to(root).as_posix(): module.digest for path, module in sorted(found.items())}
    return Program(files, versions_of(others, root / "constraints.txt"))
