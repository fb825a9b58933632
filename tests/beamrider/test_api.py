"""What a notebook imports: cheap, typed, whole; and that nothing within the project comes that way."""

import ast
import doctest
import subprocess
import sys
from pathlib import Path

import pytest

import beamrider
from beamrider.provenance.sources import sources

ROOT = Path(__file__).parents[2]
HEAVY = {"numpy", "numba", "scipy", "pandas", "pydantic", "optics", "dynamics"}


def test_importing_beamrider_takes_nothing_heavy():
    script = f"import sys, beamrider; print(*{HEAVY!r} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True).stdout == "\n"


def test_every_name_of_the_stub_is_there():
    stub = ast.parse((ROOT / "beamrider/__init__.pyi").read_text(encoding="utf-8"))
    names = [alias.asname for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert sorted(names) == beamrider.__all__ == dir(beamrider)
    assert all(getattr(beamrider, name) is not None for name in names)
    with pytest.raises(AttributeError, match="another"):
        _ = beamrider.another


def test_packages_say_that_they_are_typed():
    assert all((ROOT / package / "py.typed").is_file() for package in ("beamrider", "optics", "dynamics"))


def _lazily(path: Path) -> list[str]:
    """Imports of a source that go through the lazy face: names of it, or `beamrider` itself."""
    found = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module == "beamrider" and node.level == 0:
            found += [alias.name for alias in node.names if alias.name in beamrider.__all__]
        elif isinstance(node, ast.ImportFrom) and node.module == "beamrider.api":
            found.append("beamrider.api")
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names if alias.name in ("beamrider", "beamrider.api")]
    return found


def test_nothing_within_the_project_is_imported_lazily(tmp_path):
    """What made a result is read from import statements, which the lazy face hides."""
    for folder in ("beamrider", "optics", "dynamics", "workflow"):
        for path in (ROOT / folder).rglob("*.py"):
            assert _lazily(path) == [], path
    (tmp_path / "a.py").write_text("import beamrider\nfrom beamrider import fly, io\n", encoding="utf-8")
    assert _lazily(tmp_path / "a.py") == ["beamrider", "fly"]
    assert "beamrider/api.py" not in sources("dynamics.floquet", ROOT)


def test_the_guide_s_notebook_says_what_it_gives(monkeypatch):
    monkeypatch.chdir(ROOT)
    found = doctest.testfile(str(ROOT / "docs/guide.md"), module_relative=False, encoding="utf-8")
    assert found.attempted > 8
    assert found.failed == 0
