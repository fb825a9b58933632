"""Machine code in the cache is that of today's sources, whole, and has a place wherever the program runs."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from beamrider.machine_code import cache as compiled
from optics.table.pressure_table import PressureTable

CALLED = "import numba\n\n\n@numba.njit(cache=True)\ndef twice(x):\n    return {} * x\n"
CALLER = "import numba\nfrom optics.called import twice\n\n@numba.njit(cache=True)\ndef run(x):\n    return twice(x)\n"
RUN = "import optics; from dynamics.caller import run; print(run(1), run(0.5))"


def _environment(**given: str) -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "PYTHONPATH")} | given


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A small project with a compiled function that calls another, and the folder of its machine code not yet made."""
    root = tmp_path / "project"
    for name in ("optics", "dynamics", "beamrider/machine_code"):
        (root / name).mkdir(parents=True)
    for name in (
        "optics/__init__.py",
        "beamrider/__init__.py",
        "beamrider/__init__.pyi",
        "beamrider/machine_code/__init__.py",
        "beamrider/machine_code/cache.py",
        "beamrider/machine_code/standalone.py",
        "beamrider/machine_code/entrances.py",
    ):
        (root / name).write_bytes((compiled.ROOT / name).read_bytes())
    (root / "dynamics/__init__.py").write_text("")
    (root / "dynamics/caller.py").write_text(CALLER)
    (root / "optics/called.py").write_text(CALLED.format(2))
    return root


def run(root: Path, code: str = RUN, **given: str) -> str:
    """What the copy's caller gives for 1 and 0.5, or what other code says."""
    command = [sys.executable, "-B", "-c", code]
    done = subprocess.run(command, cwd=root, env=_environment(**given), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.strip()


def files(folder: Path) -> list[Path]:
    """Numba's index and data files below a folder."""
    return sorted(folder.glob("**/*.nb[ic]"))


def test_an_edited_callee_is_compiled_again(copy: Path):
    assert run(copy) == "2 1.0"
    assert len(files(copy / "__pycache__")) > 0
    (copy / "optics/called.py").write_text(CALLED.format(3))
    assert run(copy) == "3 1.5"


def test_folders_with_links_to_a_checkout_share_its_machine_code(copy: Path, tmp_path: Path):
    run(copy)
    before = {path: path.stat().st_mtime_ns for path in files(copy)}
    folder = tmp_path / "results here"
    folder.mkdir()
    for name in ("beamrider", "optics", "dynamics"):
        (folder / name).symlink_to(copy / name)
    assert run(folder) == "2 1.0"
    assert files(folder) == []
    assert {path: path.stat().st_mtime_ns for path in files(copy)} == before


def test_what_was_compiled_is_used_again(copy: Path):
    run(copy)
    before = {path: path.stat().st_mtime_ns for path in files(copy)}
    run(copy)
    assert {path: path.stat().st_mtime_ns for path in files(copy)} == before


def test_a_function_serves_compiled_code_and_python_in_any_order(copy: Path):
    """Compiled for its caller alone it has no entrance from Python, and is kept so."""
    called = "import optics; from optics.called import twice; print(twice(3))"
    both = f"{called}; {RUN.removeprefix('import optics; ')}; print(twice(4))"
    for _ in range(2):
        assert run(copy) == "2 1.0"
        assert run(copy, called) == "6"
        assert run(copy, both) == "6\n2 1.0\n8"


DAMAGE = {
    "empty": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "garbage": lambda content: random.Random(1).randbytes(len(content)),
    "a bit": lambda content: (
        content[: len(content) // 2] + bytes([content[len(content) // 2] ^ 16]) + content[len(content) // 2 + 1 :]
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_damaged_machine_code_is_compiled_again(copy: Path, kind: str, suffix: str):
    run(copy)
    whole = {path: path.read_bytes() for path in files(copy)}
    hurt = [path for path in whole if path.suffix == suffix]
    for path in hurt:
        path.write_bytes(DAMAGE[kind](whole[path]))
    damaged = {path: path.read_bytes() for path in hurt}
    assert run(copy) == "2 1.0"
    assert all(path.read_bytes() != damaged[path] for path in hurt)
    assert run(copy) == "2 1.0"


def test_a_stage_gives_the_same_numbers_after_any_damage(tmp_path: Path):
    film = str(compiled.ROOT / "workflow/designs/si43.yaml")
    numbers = []
    for name in ("before", "after"):
        out = tmp_path / f"{name}.h5"
        command = [sys.executable, "-m", "optics.thin_film", "--cell", film, "--out", str(out)]
        given = _environment(NUMBA_CACHE_DIR=str(tmp_path / "code"))
        done = subprocess.run(command, cwd=compiled.ROOT, env=given, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "Error" not in done.stderr
        numbers.append(PressureTable.read(out).q_nodes.tobytes())
        for i, path in enumerate(files(tmp_path / "code")):
            path.write_bytes(list(DAMAGE.values())[i % len(DAMAGE)](path.read_bytes()))
    assert numbers[0] == numbers[1]


def _cache(folder: Path) -> compiled.Checked:
    return compiled.Checked(str(folder), "function", "stamp")


def test_what_another_process_kept_under_the_same_number_is_not_taken_for_ours(tmp_path: Path):
    ours, theirs = _cache(tmp_path), _cache(tmp_path)
    ours.save("float", "code for floats")
    theirs._save_data(theirs._data_name(1), ("int", "code for ints"))  # as one does that saw no index yet
    assert ours.load("float") is None
    ours.save("float", "code for floats")
    assert ours.load("float") == "code for floats"


def test_two_processes_may_compile_at_once(copy: Path):
    command = [sys.executable, "-B", "-c", RUN]
    given = {"cwd": copy, "env": _environment(), "stdout": subprocess.PIPE, "text": True}
    both = [subprocess.Popen(command, **given) for _ in range(2)]
    assert [process.communicate()[0].strip() for process in both] == ["2 1.0", "2 1.0"]
    assert run(copy) == "2 1.0"


def test_a_full_disk_costs_the_cache_alone(tmp_path: Path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(compiled.Checked, "_save_index", full)
    _cache(tmp_path).save("float", "code")
    assert _cache(tmp_path).load("float") is None


def test_the_digest_sees_every_compiled_source(tmp_path: Path):
    (tmp_path / "dynamics" / "kernels").mkdir(parents=True)
    source = tmp_path / "dynamics" / "kernels" / "one.py"
    seen = set()
    for text in ("@njit 1", "@njit 2", "plain", "plain too"):
        source.write_text(text)
        seen.add(compiled.digest(tmp_path))
    assert len(seen) == 3


def test_places_go_from_the_choice_of_the_user_to_the_last_resort(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(compiled.tempfile, "gettempdir", lambda: "/tmp")
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    temporary = Path(f"/tmp/beamrider-{os.getuid()}")
    assert compiled.places(tmp_path) == [tmp_path / "__pycache__", Path("/home/me/.cache/beamrider"), temporary]
    for given in ("/some/where", "/some/where/numba-0123456789abcdef"):  # the second is a parent process's
        monkeypatch.setenv("NUMBA_CACHE_DIR", given)
        assert compiled.places(tmp_path) == [Path("/some/where")]


def test_a_folder_in_tmp_is_used_if_it_is_closed_to_others(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(compiled.tempfile, "gettempdir", lambda: str(tmp_path))
    folder = tmp_path / "beamrider-1"
    assert compiled.usable(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o777)
    assert not compiled.usable(folder)
    (tmp_path / "file").write_text("")
    assert not compiled.usable(tmp_path / "file")


def _closed(copy: Path) -> None:
    """The copy's own folder for machine code cannot be made: a file has its name, which stops even root."""
    (copy / "__pycache__").write_text("")


def test_an_installation_that_cannot_be_written_uses_the_cache_of_the_user(copy: Path, tmp_path: Path):
    _closed(copy)
    assert run(copy, HOME=str(tmp_path / "home"), XDG_CACHE_HOME="") == "2 1.0"
    assert files(tmp_path / "home/.cache/beamrider")


def test_without_a_home_it_uses_a_folder_in_tmp(copy: Path, tmp_path: Path):
    _closed(copy)
    (tmp_path / "tmp").mkdir()
    assert run(copy, HOME="/dev/null", XDG_CACHE_HOME="", TMPDIR=str(tmp_path / "tmp")) == "2 1.0"
    assert files(tmp_path / f"tmp/beamrider-{os.getuid()}")


def test_without_any_place_one_line_names_the_variable(copy: Path):
    given = _environment(NUMBA_CACHE_DIR="/dev/null/code")
    done = subprocess.run([sys.executable, "-c", RUN], cwd=copy, env=given, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    line = "error: NUMBA_CACHE_DIR: must name a folder to keep compiled code in; cannot use /dev/null/code\n"
    assert done.stderr == line
