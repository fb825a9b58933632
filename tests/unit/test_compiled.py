"""Cached machine code is thrown away when any compiled source changes, also one that is only called."""

import os
import subprocess
import sys
from pathlib import Path

from optics import compiled

CALLED = "import numba\n\n\n@numba.njit(cache=True)\ndef twice(x):\n    return {} * x\n"
CALLER = "import numba\nfrom optics.called import twice\n\n@numba.njit(cache=True)\ndef run(x):\n    return twice(x)\n"


def run(root: Path) -> str:
    """What the copy's caller gives for 1."""
    code = "import optics; from dynamics.caller import run; print(run(1))"
    free = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run([sys.executable, "-c", code], cwd=root, env=free, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_an_edited_callee_is_compiled_again(tmp_path: Path):
    (tmp_path / "optics").mkdir()
    (tmp_path / "dynamics").mkdir()
    for name in ("optics/__init__.py", "optics/compiled.py"):
        (tmp_path / name).write_bytes((compiled.ROOT / name).read_bytes())
    (tmp_path / "dynamics/__init__.py").write_text("")
    (tmp_path / "dynamics/caller.py").write_text(CALLER)
    (tmp_path / "optics/called.py").write_text(CALLED.format(2))
    assert run(tmp_path) == "2"
    assert len(list(tmp_path.glob("__pycache__/numba-*/**/*.nbi"))) > 0
    (tmp_path / "optics/called.py").write_text(CALLED.format(3))
    assert run(tmp_path) == "3"


def test_the_digest_sees_every_compiled_source(tmp_path: Path):
    (tmp_path / "dynamics" / "kernels").mkdir(parents=True)
    source = tmp_path / "dynamics" / "kernels" / "one.py"
    seen = set()
    for text in ("@njit 1", "@njit 2", "plain", "plain too"):
        source.write_text(text)
        seen.add(compiled.digest(tmp_path))
    assert len(seen) == 3
