"""A flight that is killed, whose disk is full, whose checkpoint is damaged: the same command, the same bits.

Children are forked, so that a kill costs no new start of Python; one test of `unit/test_flight_file` kills a process of
its own, and the slow one here several.
"""

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from beamrider.io import resources as machine
from dynamics.membrane import flight as membrane
from dynamics.membrane import stage
from dynamics.membrane.output import flight_file as flight
from dynamics.membrane.output import journal
from dynamics.scene.schema import Scene
from tests import processes
from tests.membranes import altered, small, write_inputs
from tests.processes import error, full_at
from tests.synthetic import smooth_tables

#: A checkpoint after every call of the kernels, at most every 0.1 ms of flight.
SCENE = small(
    rings=4,
    release={"spin_Hz": -120.0},
    flight={
        "duration_s": 2e-3,
        "snapshot_every_s": 1e-4,
        "series_every": 4,
        "checkpoint_every_s": 1e-9,
        "optics_every": 1,
    },
)
#: The same by the co-rotating scheme, whose work space is part of a checkpoint.
CAROUSEL = altered(SCENE, flight={"integrator": "corotating", "heat_every": 1, "series_every": 1})


def fly(arguments: list[str], prepare: Callable[[], object] = lambda: None) -> tuple[int, str]:
    """Exit code and words of a child that flies."""
    return processes.run(stage.main, arguments, prepare)


def numbers(path: Path) -> dict[str, bytes]:
    """Bits of all data sets of a flight file, and its attributes but the wall time."""
    with h5py.File(path) as file:
        found: dict[str, bytes] = {}
        file.visititems(
            lambda name, item: found.update({name: item[()].tobytes()}) if isinstance(item, h5py.Dataset) else None
        )
        attributes = {k: np.asarray(v).tobytes() for k, v in file["series"].attrs.items() if k != "wall_seconds"}
    return {**found, **attributes}


def uninterrupted(folder: Path, scene: Scene) -> tuple[dict[str, bytes], float]:
    """Numbers of the uninterrupted flight, and the seconds it took with the compiled code at hand."""
    membrane.fly(altered(scene, flight={"duration_s": 1e-5}), smooth_tables())
    arguments = write_inputs(folder, scene)
    started = time.monotonic()
    assert fly(arguments)[0] == 0
    return numbers(folder / "out" / "flight.vtkhdf"), time.monotonic() - started


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], float]:
    return uninterrupted(tmp_path_factory.mktemp("whole"), SCENE)


def same(folder: Path, whole: tuple[dict[str, bytes], float]) -> bool:
    """Is the folder's flight the whole one to the bit, and nothing else left beside it."""
    got = numbers(folder / "out" / "flight.vtkhdf")
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["flight.vtkhdf"]
    return len(got) > 40 and got == whole[0]


# kill -9


def killed_at_random(folder: Path, scene: Scene, seconds: float, kills: int, seed: int) -> int:
    """Kill a flight at random moments until so many kills hit, then let it end; how many found a checkpoint."""
    arguments, draw, hits, resumed = write_inputs(folder, scene), random.Random(seed), 0, 0
    for _ in range(10 * kills):
        if hits == kills:
            break
        child = processes.fork(stage.main, arguments)
        time.sleep(draw.uniform(0.0, 0.8 * seconds))
        os.kill(child.process, signal.SIGKILL)
        if child.end() == 0:  # it ended before: begin again
            shutil.rmtree(folder / "out")
            continue
        hits += 1
        resumed += (folder / "out" / "flight.vtkhdf.partial" / "checkpoint.npz").exists()
    assert hits == kills
    assert fly(arguments)[0] == 0
    return resumed


def test_kills_at_random_moments_change_no_bit(tmp_path: Path, whole: tuple[dict[str, bytes], float]):
    resumed = killed_at_random(tmp_path, SCENE, whole[1], 6, 1)
    assert resumed >= 3
    assert same(tmp_path, whole)


def test_kills_at_random_moments_change_no_bit_of_a_corotating_flight(tmp_path: Path):
    turning = uninterrupted(tmp_path / "whole", CAROUSEL)
    resumed = killed_at_random(tmp_path / "killed", CAROUSEL, turning[1], 4, 2)
    assert resumed >= 2
    assert same(tmp_path / "killed", turning)


def die(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def nth(function: Callable[..., object], count: int, instead: Callable[..., object]) -> Callable[..., object]:
    """The function, but at its call number `count` the other one, and then death."""
    calls = 0

    def wrapped(*arguments: object, **keys: object) -> object:
        nonlocal calls
        calls += 1
        if calls == count:
            instead(*arguments, **keys)
            die()
        return function(*arguments, **keys)

    return wrapped


def half_a_row(self: journal.Journal, name: str, values: np.ndarray) -> None:
    with open(self._path(name), "ab") as stream:
        stream.write(values.tobytes()[: values.nbytes // 2 + 3])


def half_a_checkpoint(stream: object, **arrays: np.ndarray) -> None:
    stream.write(b"PK\x03\x04" + bytes(1000))
    stream.flush()


def half_a_removal(folder: Path, **_: object) -> None:
    (folder / "rows").unlink()


#: Where a process dies: what is replaced, at which call, and what it does before.
DEATHS: dict[str, tuple[object, str, int, Callable[..., object]]] = {
    "half a row written": (journal.Journal, "_append", 9, half_a_row),
    "half a frame written": (journal.Journal, "_append", 12, half_a_row),
    "half a checkpoint written": (journal.np, "savez", 5, half_a_checkpoint),
    "checkpoint written, not renamed": (Path, "replace", 6, die),
    "checkpoint renamed": (Path, "replace", 6, Path.replace),
    "half the flight file written": (flight._Grid, "frame", 20, flight._Grid.frame),
    "flight file written, not renamed": (stage, "write_flight", 1, stage.write_flight),
    "flight file in place, half the folder removed": (journal.shutil, "rmtree", 1, half_a_removal),
}


@pytest.mark.parametrize("moment", list(DEATHS))
def test_a_kill_during_any_kind_of_writing_changes_no_bit(
    tmp_path: Path, whole: tuple[dict[str, bytes], float], moment: str
):
    owner, name, count, instead = DEATHS[moment]
    arguments = write_inputs(tmp_path, SCENE)
    patch = nth(getattr(owner, name), count, instead)
    assert fly(arguments, lambda: setattr(owner, name, patch))[0] == -signal.SIGKILL
    out = tmp_path / "out"
    left = sorted(path.name for path in out.iterdir() if path.name != "flight.vtkhdf")
    assert left == [".flight.vtkhdf.lock", "flight.vtkhdf.partial"]
    assert out.joinpath("flight.vtkhdf").exists() == ("in place" in moment)
    assert fly(arguments)[0] == 0
    assert same(tmp_path, whole)


@pytest.mark.slow
def test_kills_of_whole_processes_at_random_moments_change_no_bit(
    tmp_path: Path, whole: tuple[dict[str, bytes], float]
):
    """As the user does it: new processes of the command, each killed with all that it started."""
    command = [sys.executable, "-m", "dynamics.membrane", *write_inputs(tmp_path, SCENE)]
    draw = random.Random(3)
    started = time.monotonic()
    subprocess.run([sys.executable, "-c", "import dynamics.membrane.stage"], check=True)
    imports, kills = time.monotonic() - started, 0
    while kills < 12:
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)
        time.sleep(imports + draw.uniform(-0.5, 2.0))
        os.killpg(process.pid, signal.SIGKILL)
        if process.wait() == 0:
            shutil.rmtree(tmp_path / "out")
        else:
            kills += 1
    subprocess.run(command, check=True)
    assert same(tmp_path, whole)


# A full disk


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Callable[[int], Path]]:
    """Folders on disks of so many kilobytes, where the machine lets us make them; else plain folders."""
    made: list[Path] = []

    def make(kilobytes: int) -> Path:
        folder = tmp_path / f"disk{len(made)}"
        folder.mkdir()
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "none", str(folder)], capture_output=True, check=False
        )
        if done.returncode == 0:
            made.append(folder)
        return folder

    yield make
    for folder in made:
        subprocess.run(["umount", str(folder)], check=True)


def frames_full_at(size: int) -> Callable[[], None]:
    """The same for the frames alone, whatever the size of a checkpoint."""

    def prepare() -> None:
        append, most = journal.Journal._append, resource.getrlimit(resource.RLIMIT_FSIZE)[0]

        def limited(self: journal.Journal, name: str, values: np.ndarray) -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size if name == "frames" else most, most))
            append(self, name, values)
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

        journal.Journal._append = limited

    return prepare


@pytest.mark.parametrize(
    ("full", "file", "kept"),
    [
        (full_at(40_000), "checkpoint.npz", False),
        (frames_full_at(30_000), "frames", True),
        (frames_full_at(5_000), "frames", False),
    ],
)
def test_files_that_cannot_grow_end_the_flight_in_one_line_and_it_goes_on_later(
    tmp_path: Path, whole: tuple[dict[str, bytes], float], full: Callable[[], None], file: str, kept: bool
):
    arguments, folder = write_inputs(tmp_path, SCENE), tmp_path / "out" / "flight.vtkhdf.partial"
    code, said = fly(arguments, full)
    assert (code, error(said)) == (2, f"error: {folder / file}: File too large")
    assert not (tmp_path / "out" / "flight.vtkhdf").exists()
    assert (folder / "checkpoint.npz").exists() == kept
    code, said = fly(arguments)
    assert code == 0
    assert ("going on from step" in said) == kept
    assert same(tmp_path, whole)


def seemingly_empty() -> None:
    """A disk has room enough when it is asked for."""
    machine.free_disk = lambda path: 1e12  # in the child alone


def test_a_full_disk_ends_the_flight_in_one_line_and_it_goes_on_when_there_is_space(
    tmp_path: Path, disk: Callable[[int], Path], whole: tuple[dict[str, bytes], float]
):
    """A disk that takes a checkpoint (twice, for a moment) and some of the frames."""
    trial = membrane.Flight(SCENE, smooth_tables(), tmp_path / "trial")
    trial.advance()
    trial.checkpoint()
    kilobytes = 2.2 * (tmp_path / "trial" / "checkpoint.npz").stat().st_size / 1024
    arguments, small_disk = write_inputs(tmp_path, SCENE), disk(round(kilobytes))
    out = small_disk / "flight.vtkhdf"
    limited = os.path.ismount(small_disk)
    if limited:  # refused before it starts
        code, said = fly([*arguments[:-1], str(out)])
        assert code == 2
        assert "fig6.yaml: flight.duration_s = 0.002: would write " in error(said)
        assert not list(small_disk.iterdir())
    # Another program fills the disk in the meantime
    code, said = fly([*arguments[:-1], str(out)], seemingly_empty if limited else frames_full_at(30_000))
    assert code == 2
    assert error(said).startswith(f"error: {out}.partial/")
    assert error(said).endswith("No space left on device" if limited else "File too large")
    assert not out.exists()
    # Space is back: the folder moves to a larger disk
    shutil.copytree(small_disk / "flight.vtkhdf.partial", tmp_path / "out" / "flight.vtkhdf.partial")
    code, said = fly(arguments)
    assert code == 0
    assert "going on from step" in said
    assert same(tmp_path, whole)


@pytest.mark.parametrize("room", [0, 60_000, 400_000])
def test_a_disk_that_is_full_when_the_flight_file_is_written(
    tmp_path: Path, whole: tuple[dict[str, bytes], float], room: int
):
    """HDF5 would crash; the room is asked for before. No half file, and the flight goes on from its last state."""
    arguments = write_inputs(tmp_path, SCENE)

    def prepare() -> None:
        write = stage.write_flight

        def limited(*given: object) -> None:
            full_at(room)()
            write(*given)

        stage.write_flight = limited

    code, said = fly(arguments, prepare)
    assert code == 2
    assert error(said).startswith(f"error: {tmp_path / 'out' / 'flight.vtkhdf.partial'}: File too large: ")
    assert error(said).endswith(" MB are needed")
    assert not (tmp_path / "out" / "flight.vtkhdf").exists()
    code, said = fly(arguments)
    assert code == 0
    assert "going on from step" in said
    assert same(tmp_path, whole)


# Damage


@pytest.mark.parametrize("name", ["rows", "frames", "checkpoint.npz"])
@pytest.mark.parametrize("damage", ["flipped", "cut off", "gone"])
def test_a_journal_that_was_damaged_starts_anew_and_says_so(
    tmp_path: Path, whole: tuple[dict[str, bytes], float], name: str, damage: str
):
    """A single flipped byte is enough, in any file of the folder."""
    arguments, out = write_inputs(tmp_path, SCENE), tmp_path / "out"
    patch = nth(Path.replace, 8, die)
    assert fly(arguments, lambda: setattr(Path, "replace", patch))[0] == -signal.SIGKILL
    path = out / "flight.vtkhdf.partial" / name
    content = bytearray(path.read_bytes())
    if damage == "flipped":
        content[len(content) // 3] ^= 16
    if damage == "gone":
        path.unlink()
    else:
        path.write_bytes(content if damage == "flipped" else content[: len(content) // 4])
    code, said = fly(arguments)
    assert code == 0
    assert "going on" not in said
    assert ("not a readable checkpoint" in said) == ((name, damage) != ("checkpoint.npz", "gone"))
    assert same(tmp_path, whole)
