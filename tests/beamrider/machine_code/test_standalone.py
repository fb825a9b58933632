"""Functions that stand by themselves: callers hold their names, not their code, in memory and from the cache."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from beamrider.machine_code import standalone
from beamrider.machine_code.cache import ROOT

SOURCE = """
import numba
from beamrider.machine_code.standalone import standalone

@standalone()
def scaled(a, k):
    if k < 0:
        raise ValueError("negative")
    return k * a.sum(), k > 1

@numba.njit(cache=True, error_model="numpy")
def between(a, k):
    return scaled(a, k)[0] + 1.0

@numba.njit(cache=True, error_model="numpy")
def outer(a, k):
    return 2.0 * between(a, k)
"""
RUN = """
import numpy as np
import optics
from numba.core import event

with event.install_recorder("numba:compile") as compiled:
    import kernels
    print(kernels.outer(np.ones(3), 2), kernels.scaled(np.ones(3), 2))
    try:
        kernels.outer(np.ones(3), -1)
    except ValueError as error:
        print(error)
names = {data["dispatcher"].py_func.__name__ for _, data in ((time, found.data) for time, found in compiled.buffer)}
print(*sorted(names & {"outer", "between", "scaled"}))
"""
#: A caller whose own text stays, and two of what it calls, which return a float and an integer.
CALLER = """
import numba
from shared import scaled

@numba.njit(cache=True, error_model="numpy")
def outer(a, k):
    return 1.0 * scaled(a, k)
"""
SHARED = """
import numpy as np
from beamrider.machine_code.standalone import standalone

@standalone()
def scaled(a, k):
    return RETURNED
"""
RUN_CALLER = """
import numpy as np
import optics
import kernels

print(kernels.outer(np.ones(3), 2))
"""
SAID = ["14.0 (6.0, True)", "negative"]


def run(folder: Path, source: str = SOURCE, program: str = RUN) -> list[str]:
    """What a new process says."""
    if not (folder / "kernels.py").exists():
        (folder / "kernels.py").write_text(source)
    given = os.environ | {"NUMBA_CACHE_DIR": str(folder / "code"), "PYTHONPATH": f"{ROOT}:{folder}"}
    done = subprocess.run([sys.executable, "-B", "-c", program], env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_callers_find_it_in_every_process_and_compile_nothing_again(tmp_path: Path):
    assert run(tmp_path) == [*SAID, "between outer scaled"]
    assert run(tmp_path) == [*SAID, ""]


@pytest.mark.parametrize("name", ["scaled", "outer"])
def test_one_that_lost_its_code_is_compiled_again_alone(tmp_path: Path, name: str):
    """`outer` holds the code of `between`, but not that of `scaled`."""
    run(tmp_path)
    for path in (tmp_path / "code").glob(f"**/kernels.{name}-*"):
        path.unlink()
    assert run(tmp_path) == [*SAID, name]


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """The module, imported here."""
    folder = tmp_path_factory.mktemp("kernels")
    (folder / "kernels_here.py").write_text(SOURCE)
    sys.path.insert(0, str(folder))
    import kernels_here  # type: ignore[import-not-found]

    sys.path.remove(str(folder))
    kernels_here.outer(np.ones(3), 2)
    return kernels_here


def test_the_code_of_callers_holds_the_name_alone(kernels):
    text = kernels.outer.inspect_llvm(kernels.outer.signatures[0])
    assert any(line.startswith("declare") and "beamrider.standalone." in line for line in text.splitlines())
    assert "scaled" not in "".join(line for line in text.splitlines() if line.startswith("define"))


def test_a_function_that_is_gone_is_not_reached_by_old_code(kernels):
    (origin,) = standalone.called_by(kernels.outer.inspect_asm(kernels.outer.signatures[0]))
    assert origin[:2] == ("kernels_here", "scaled")
    assert standalone.bring([origin])
    assert not standalone.bring([("kernels_here", "scaled_once", *origin[2:])])
    assert not standalone.bring([("kernels_here", "between", *origin[2:])])
    assert not standalone.bring([(*origin[:3], "that of another type")])


def test_callers_of_one_that_returns_another_type_are_compiled_again(tmp_path: Path):
    """Their own source, and the types of its arguments, are what they were."""
    for returned in ("k * a.sum()", "np.int64(k * a.sum())"):
        (tmp_path / "shared.py").write_text(SHARED.replace("RETURNED", returned))
        assert run(tmp_path, CALLER, RUN_CALLER) == ["6.0"]
