"""The files a program is made of are exactly those that Python would read."""

import functools
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from beamrider.provenance import sources as module
from beamrider.provenance.kept_sources import KeptSources
from beamrider.provenance.sources import program, read_module, sources

ROOT = Path(__file__).parents[3]

LISTED = """
import runpy, sys
from pathlib import Path
root = Path.cwd()
sys.argv = ["x", "--help"]
try:
    {run}
except SystemExit:
    pass
files = {{Path(m.__file__) for m in list(sys.modules.values()) if getattr(m, "__file__", None)}}
inside = {{f.relative_to(root).as_posix() for f in files if f.is_relative_to(root) and ".venv" not in f.parts}}
print("FILES", *sorted(inside))
"""


@pytest.mark.parametrize("program", ["optics.modal", "dynamics.membrane", "workflow.figures.pressure"])
def test_sources_are_what_python_loads(program):
    loads = program if program.startswith("workflow") else f"{program}.__main__"
    output = subprocess.run(
        [sys.executable, "-c", LISTED.format(run=f"import {loads}")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    loaded = {name for line in output.splitlines() if line.startswith("FILES") for name in line.split()[1:]}
    assert set(sources(program, ROOT)) == loaded


def _write(root: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def test_every_form_of_import_is_followed_once(tmp_path):
    _write(
        tmp_path,
        {
            "a/__init__.py": "",
            "a/b/__init__.py": "import os, numpy",
            "a/b/c.py": "from . import d\nfrom ..e import name",
            "a/b/d.py": "def f():\n    import g",
            "a/e.py": "name = 1\nimport a.b.c",
            "g.py": "from a import e as x",
            "a/unused.py": "",
        },
    )
    every = ["a/__init__.py", "a/b/__init__.py", "a/b/c.py", "a/b/d.py", "a/e.py", "g.py"]
    assert sources("a.b.c", tmp_path) == every


def test_imports_of_main_count_for_the_program_alone(tmp_path):
    _write(tmp_path, {"a.py": "def main():\n    import c", "b.py": "import a", "c.py": ""})
    assert sources("a", tmp_path) == ["a.py", "c.py"]
    assert sources("b", tmp_path) == ["a.py", "b.py"]


def test_a_program_that_is_not_there_is_named(tmp_path):
    for start in ("nowhere", "a.nowhere"):
        _write(tmp_path, {"a/__init__.py": ""})
        with pytest.raises(FileNotFoundError, match=start):
            sources(start, tmp_path)


@pytest.fixture
def kept(tmp_path, monkeypatch) -> Iterator[Path]:
    """Where what sources mean is kept, nothing as yet."""
    path = tmp_path / "__pycache__/sources.json"
    path.parent.mkdir()
    monkeypatch.setattr(module, "_kept", functools.cache(lambda: KeptSources(path, Path(module.__file__))))
    module._read.cache_clear()
    yield path
    module._read.cache_clear()


@pytest.mark.parametrize("damage", [bytes.upper, lambda text: text[:50], lambda text: text.replace(b"0", b"1"), None])
def test_what_sources_mean_is_found_again_or_anew(tmp_path, kept, monkeypatch, damage):
    """From the file of the run before; where that is damaged, or the folder cannot be written, from the sources."""
    _write(tmp_path, {"a.py": "import b\n", "b.py": "from . import c\n\ndef main():\n    import a.b\n"})
    found = program("a", tmp_path), [read_module(tmp_path / name) for name in ("a.py", "b.py")]
    assert kept.exists()
    if damage:
        kept.write_bytes(damage(kept.read_bytes()))
    else:
        monkeypatch.setattr(module, "_parsed", None)
    module._kept.cache_clear()
    module._read.cache_clear()
    assert (program("a", tmp_path), [read_module(tmp_path / name) for name in ("a.py", "b.py")]) == found


def test_an_edit_counts_whatever_is_kept(tmp_path, kept):
    _write(tmp_path, {"a.py": "x = 1\n"})
    before = program("a", tmp_path).digest
    _write(tmp_path, {"a.py": "x = 1  # as before\n"})
    assert program("a", tmp_path).digest == before
    _write(tmp_path, {"a.py": "x = 2\n"})
    assert program("a", tmp_path).digest != before
