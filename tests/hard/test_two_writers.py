"""Two writers of one output: the second is refused in a line, and takes over where the first was killed."""

import errno
import os
import re
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from beamrider.io import lock
from beamrider.io.errors import InputError
from beamrider.io.files import run_stage
from dynamics.membrane import stage
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.scene.schema import read_scene
from dynamics.stability import screening
from optics.thin_film import stage as thin_film
from tests.hard.test_survival import SCENE, numbers, uninterrupted
from tests.membranes import altered, write_inputs
from tests.processes import Child, error, fork, run, without_locks

ROOT = Path(__file__).parents[2]
SHORT = altered(read_scene(ROOT / "workflow" / "scenes" / "fig6.yaml"), rigid={"duration_s": 0.01})


def film(folder: Path) -> list[str]:
    return ["--cell", str(ROOT / "workflow/designs/si43.yaml"), "--out", str(folder / "out" / "film.h5")]


def flight(folder: Path) -> list[str]:
    return write_inputs(folder, SHORT, "result.h5")


def flexible(folder: Path) -> list[str]:
    return write_inputs(folder, SCENE)


def mapped(folder: Path) -> list[str]:
    folder.joinpath("grid.yaml").write_text("n_offsets: 2\nn_tilts: 2\nduration_s: 0.01\n", encoding="utf-8")
    return ["--grid", str(folder / "grid.yaml"), *flight(folder)]


def screened(folder: Path) -> list[str]:
    return ["--members", "none", "--cells", "none", *flight(folder)[:2], "--out", str(folder / "out" / "s.parquet")]


STAGES = {
    "table": (thin_film.main, film),
    "rigid flight": (rigid.main, flight),
    "basin": (basin.main, mapped),
    "flexible flight": (stage.main, flexible),
    "screening": (screening.main, screened),
}


def wait_for(path: Path, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not path.exists():
        assert time.monotonic() < end
        time.sleep(0.01)


def holding(out: Path, prepare: Callable[[], object] = lambda: None) -> Child:
    """A process that writes an output for as long as it lives."""

    def main() -> None:
        lock.claim(out)
        out.with_name("ready").touch()
        time.sleep(600)

    child = fork(main, [], prepare)
    wait_for(out.with_name("ready"))
    return child


def end(child: Child) -> None:
    os.kill(child.process, signal.SIGKILL)
    child.end()


@pytest.mark.parametrize("stage", list(STAGES))
def test_every_stage_refuses_an_output_that_another_process_writes(tmp_path: Path, stage: str):
    main, arguments = STAGES[stage]
    given = arguments(tmp_path)
    out = Path(given[-1])
    child = holding(out)
    code, said = run(main, given)
    end(child)
    who = rf"process {child.process} on {re.escape(socket.gethostname())}, since [-\d]{{10}} [:\d]{{8}}"
    assert code == 2
    assert re.fullmatch(rf"error: --out = {out}: is being written by {who}; wait for it, or end it", error(said))
    assert sorted(path.name for path in out.parent.iterdir()) == [f".{out.name}.lock", "ready"]


def test_two_flights_of_one_file_give_the_numbers_of_one(tmp_path: Path):
    """The second starts while the first flies, and again once that was killed."""
    whole = uninterrupted(tmp_path / "whole", SCENE)[0]
    arguments = write_inputs(tmp_path, SCENE)
    partial = tmp_path / "out" / "flight.vtkhdf.partial"
    first = fork(stage.main, arguments)
    wait_for(partial / "checkpoint.npz")
    os.kill(first.process, signal.SIGSTOP)
    code, said = run(stage.main, arguments)
    assert code == 2
    assert f"is being written by process {first.process} on " in error(said)
    os.kill(first.process, signal.SIGCONT)
    os.kill(first.process, signal.SIGKILL)
    assert first.end() == -signal.SIGKILL
    code, said = run(stage.main, arguments)
    assert (code, "going on from step" in said) == (0, True)
    assert numbers(tmp_path / "out" / "flight.vtkhdf") == whole
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["flight.vtkhdf"]


def test_what_a_killed_writer_left_is_removed_and_that_of_others_is_not(tmp_path: Path):
    out = tmp_path / "new" / "a.h5"
    out.parent.mkdir()
    end(holding(out))
    for name in (".a.h5.abcd1234.part", ".a.h5.x.h5.abcd1234.part", ".a.abcd1234.part", "a.h5.abcd1234.part"):
        out.with_name(name).touch()
    out.with_name("ready").unlink()
    lock.claim(out)
    lock.claim(out)
    assert sorted(path.name for path in out.parent.iterdir()) == [
        ".a.abcd1234.part",
        ".a.h5.lock",
        ".a.h5.x.h5.abcd1234.part",
        "a.h5.abcd1234.part",
    ]
    lock.release(out)
    assert not out.with_name(".a.h5.lock").exists()


def test_folders_that_were_made_for_an_output_that_never_came_go_again(tmp_path: Path):
    (tmp_path / "old").mkdir()
    lock.claim(tmp_path / "old" / "new" / "deep" / "a")
    lock.release()
    assert [path.name for path in tmp_path.rglob("*")] == ["old"]


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS])
def test_where_there_are_no_locks_the_holder_is_asked_for(tmp_path: Path, number: int):
    out = tmp_path / "a.h5"
    child = holding(out, without_locks(number))
    code, said = run(lambda: lock.claim(out), [], without_locks(number))
    assert code == 2
    assert f"is being written by process {child.process} on " in error(said)
    assert error(said).endswith(f"wait for it, or end it; if it is no more, delete {tmp_path / '.a.h5.lock'}")
    end(child)
    assert run(lambda: lock.claim(out), [], without_locks(number)) == (0, "")


def test_a_holder_of_another_host_counts_where_there_are_no_locks_and_a_number_used_again_does_not(tmp_path: Path):
    held = lock._name(os.getppid())
    assert lock._alive(held)
    assert lock._alive(held.replace(socket.gethostname(), "elsewhere"))
    assert not lock._alive(re.sub(r"begun at \d+", "begun at 1", held))
    assert not lock._alive("")


def test_of_many_that_start_at_once_one_writes(tmp_path: Path):
    """Those that find a lock file which its holder is just removing try again."""
    out = tmp_path / "a"

    def main() -> None:
        for _ in range(200):
            try:
                lock.claim(out)
            except InputError:
                continue
            with open(out, "x"):  # fails where two are here
                pass
            out.unlink()
            lock.release(out)

    children = [fork(lambda: run_stage(main), []) for _ in range(4)]
    assert [(child.end(), child.said) for child in children] == [(0, "")] * 4
