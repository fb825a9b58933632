"""A workflow that was killed: its locks go, unless it lives; its jobs may live on; what is next gives the same bits."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from beamrider.io.errors import InputError
from beamrider.machine_code.cache import VARIABLE
from dynamics.scene.schema import Scene, read_scene
from tests.hard.test_bad_days import content
from tests.membranes import altered
from tests.workflow.test_dag import ROOT, _copy
from workflow.unlock import unlock, working


@pytest.fixture
def locked(tmp_path: Path) -> Path:
    """A folder with a lock, and a command that takes it off."""
    (tmp_path / ".snakemake/locks").mkdir(parents=True)
    (tmp_path / ".snakemake/locks/0.input.lock").write_text("a\n")
    return tmp_path


TAKE_OFF = ["rm", ".snakemake/locks/0.input.lock"]


@pytest.fixture
def snakemake(locked: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process by that name that works in the folder."""
    process = subprocess.Popen(["bash", "-c", "exec -a snakemake sleep 600"], cwd=locked)
    while process.pid not in working(locked):
        time.sleep(0.01)
    yield process
    process.kill()
    process.wait()


def test_left_over_locks_go_and_none_is_missed(locked: Path, capsys: pytest.CaptureFixture[str]):
    unlock(TAKE_OFF, locked)
    assert not list((locked / ".snakemake/locks").iterdir())
    assert capsys.readouterr().err == f"{locked}: locked by a Snakemake that is no more; unlocked\n"
    unlock(TAKE_OFF, locked)
    assert capsys.readouterr().err == ""


def test_locks_of_one_that_works_here_stay(locked: Path, snakemake: subprocess.Popen[bytes], tmp_path_factory):
    with pytest.raises(InputError, match=f"results are being made here by process {snakemake.pid}; wait for it"):
        unlock(TAKE_OFF, locked)
    assert list(working(tmp_path_factory.mktemp("elsewhere"))) == []
    snakemake.kill()
    snakemake.wait()
    unlock(TAKE_OFF, locked)


def test_locks_of_another_host_stay(locked: Path):
    (locked / ".snakemake/host").write_text("elsewhere\n")
    with pytest.raises(InputError, match=r"locked by a Snakemake on elsewhere; .*; if it is no more: rm \.snakemake"):
        unlock(TAKE_OFF, locked)
    unlock(TAKE_OFF, locked.parent / "free")
    assert (locked.parent / "free/.snakemake/host").read_text().strip() == socket.gethostname()


# Whole workflows, of one scene of films

FLIGHT, TABLE = "results/scenes/own/flight.vtkhdf", "results/tables/si43/thin_film.h5"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project, which compiles its own machine code, with a scene of films that flies for some seconds."""
    folder = _copy(tmp_path_factory.mktemp("project"))
    scene = read_scene(ROOT / "workflow/scenes/fig6.yaml").model_dump()
    for sector in scene["sail"]["sectors"]:
        sector["design"] = "si43"
    flight = {"duration_s": 0.3, "checkpoint_every_s": 0.1, "snapshot_every_s": 0.01}
    own = altered(Scene.model_validate({**scene, "name": "own"}), sail={"rings": 12}, flight=flight)
    (folder / "workflow/scenes/own.yaml").write_text(own.model_dump_json(exclude_none=True), encoding="utf-8")
    return folder


def snake(*more: str) -> list[str]:
    profile = ["--workflow-profile", "workflow/profiles/default"]
    return [sys.executable, "-B", "-m", "snakemake", *profile, "--cores", "2", *more]


def surroundings(folder: Path) -> dict[str, str]:
    """Modules, and their machine code, are those of the folder."""
    return {**{key: value for key, value in os.environ.items() if key != VARIABLE}, "PYTHONPATH": str(folder)}


def start(folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        snake("--config", "fdtd=false", "--", FLIGHT),
        cwd=folder,
        env=surroundings(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def make(folder: Path) -> tuple[int, str]:
    """As `make results`: unlock, then Snakemake."""
    command = [sys.executable, "-m", "workflow.unlock", *snake("--unlock", "--config", "fdtd=false")]
    done = subprocess.run(
        command,
        cwd=folder,
        env=surroundings(folder),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        return done.returncode, done.stderr
    process = start(folder)
    said, _ = process.communicate()
    return process.returncode, done.stderr + said


def flying(folder: Path) -> int:
    """Number of the process that flies, once it has left a checkpoint."""
    end = time.monotonic() + 300
    while not (folder / f"{FLIGHT}.partial/checkpoint.npz").exists():
        assert time.monotonic() < end
        time.sleep(0.05)
    said = (folder / "results/scenes/own/.flight.vtkhdf.lock").read_text(encoding="utf-8")
    return int(re.findall(r"process (\d+) on", said)[0])


@pytest.fixture(scope="module")
def quiet(project: Path) -> dict[str, object]:
    """What a quiet run makes."""
    code, said = make(project)
    assert code == 0, said
    return {name: content(project / name) for name in (TABLE, FLIGHT)}


@pytest.fixture
def whole(project: Path, quiet: dict[str, object]) -> dict[str, object]:
    """The same, all of which is there but the flight."""
    (project / FLIGHT).unlink()
    return quiet


def ends_as(project: Path, whole: dict[str, object]) -> None:
    code, said = make(project)
    assert code == 0, said
    assert {name: content(project / name) for name in whole} == whole
    left = sorted(path.name for path in (project / FLIGHT).parent.iterdir())
    assert left == ["flight.vtkhdf"]


@pytest.mark.slow
def test_snakemake_is_killed_and_its_job_lives_on(project: Path, whole: dict[str, object]):
    process = start(project)
    job = flying(project)
    os.kill(job, signal.SIGSTOP)
    code, said = make(project)
    assert (code, said.count("\n")) == (2, 1)
    assert f"results are being made here by process {process.pid}; wait" in said
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    code, said = make(project)
    assert code == 1
    assert "locked by a Snakemake that is no more; unlocked" in said
    assert f"is being written by process {job} on " in said
    os.kill(job, signal.SIGCONT)
    os.kill(job, signal.SIGKILL)
    ends_as(project, whole)


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2, 0])
def test_a_workflow_that_is_interrupted_or_killed_with_its_jobs(project: Path, whole: dict[str, object], times: int):
    """Ctrl-C reaches all processes of the terminal; 0: kill -9 of all of them."""
    process = start(project)
    flying(project)
    for _ in range(times):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.1)
    if times == 0:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert process.returncode != 0
    ends_as(project, whole)
