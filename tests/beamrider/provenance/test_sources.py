"""The files a program is made of are exactly those that Python would read."""

import subprocess
import sys
from pathlib import Path

import pytest

from beamrider.provenance.sources import sources

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
        [sys.executable, "-c", LISTED.format(run=f"import {loads}")], cwd=ROOT, capture_output=True, text=True,
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
    _write(tmp_path, {
        "a/__init__.py": "", "a/b/__init__.py": "import os, numpy", "a/b/c.py": "from . import d\nfrom ..e import name",
        "a/b/d.py": "def f():\n    import g", "a/e.py": "name = 1\nimport a.b.c", "g.py": "from a import e as x",
        "a/unused.py": "",
    })
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
