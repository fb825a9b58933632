"""Every stage killed or interrupted in its middle, without room, without a right to write, by a clock that jumps.

What is asked for next gives the bits of a quiet run, and nothing else is left. Flexible flights: `test_survival`.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from beamrider.io.files import read_json, write_lines
from beamrider.io.parquet import write_parquet
from dynamics import mesh as mesh_command
from dynamics.membrane import plan
from dynamics.membrane import stage as membrane_stage
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.scene import schema as scenes
from dynamics.stability import floquet, maps, screening
from optics.cells.schema import read_cell
from optics.fdtd import nodes
from optics.modal import normal_incidence as local
from optics.modal import stage as modal
from optics.thin_film import stage as thin_film
from tests.families import many_cells, many_members
from tests.membranes import altered, write_inputs
from tests.processes import error, fork, full_at, run

ROOT = Path(__file__).parents[2]
FIG6 = scenes.read_scene(ROOT / "workflow/scenes/fig6.yaml")
SHORT = altered(
    FIG6,
    sail={"rings": 3},
    rigid={"duration_s": 0.05},
    flight={
        "duration_s": 1e-3,
        "spin_up_s": 1e-4,
        "snapshot_every_s": 1e-4,
        "checkpoint_every_s": 1e-9,
    },
)
Arguments = Callable[[Path], list[str]]


def flown(name: str) -> Arguments:
    return lambda folder: write_inputs(folder, SHORT, name)


def alone(name: str) -> Arguments:
    """Scene and output, without tables."""
    return lambda folder: [*write_inputs(folder, SHORT)[:2], "--out", str(folder / "out" / name)]


def mapped(folder: Path) -> list[str]:
    folder.joinpath("grid.yaml").write_text("n_offsets: 4\nn_tilts: 4\nduration_s: 0.2\n", encoding="utf-8")
    return ["--grid", str(folder / "grid.yaml"), *write_inputs(folder, SHORT, "basin.h5")]


def of_design(design: str, name: str, *more: str) -> Arguments:
    cell = ROOT / f"workflow/designs/{design}.yaml"
    return lambda folder: ["--cell", str(cell), *more, "--out", str(folder / "out" / name)]


def cells(folder: Path) -> list[str]:
    cell = read_cell(ROOT / "workflow/designs/mark1e_te.yaml").model_dump()
    write_lines(folder / "cells.jsonl", [{**cell, "membrane_nm": 200.0 + i} for i in range(5)])
    return ["--cells", str(folder / "cells.jsonl"), "--out", str(folder / "out/cells.parquet")]


def family(folder: Path) -> list[str]:
    write_parquet(folder / "cells.parquet", many_cells(20).to_parquet())
    write_parquet(folder / "members.parquet", many_members(20).to_parquet())
    more = ["--members", str(folder / "members.parquet"), "--cells", str(folder / "cells.parquet")]
    return [*more, *alone("screened.parquet")(folder)]


STAGES: dict[str, tuple[Callable[[], None], Arguments]] = {
    "film": (thin_film.main, of_design("si43", "film.h5")),
    "grating": (
        modal.main,
        of_design(
            "mark1e_te",
            "te.h5",
            "--u-max",
            "0.02",
            "--v-max",
            "0.02",
            "--tolerance",
            "0.02",
            "--accept-missed",
        ),
    ),
    "nodes": (nodes.main, of_design("mark1e_te", "nodes.json", "--u-max", "0.05", "--v-max", "0.05")),
    "cells": (local.main, cells),
    "screening": (screening.main, family),
    "plan": (plan.main, alone("plan.json")),
    "mesh": (mesh_command.main, alone("mesh.vtkhdf")),
    "floquet": (floquet.main, flown("floquet.json")),
    "maps": (maps.main, flown("maps.h5")),
    "basin": (basin.main, mapped),
    "rigid": (rigid.main, flown("rigid.h5")),
    "flexible": (membrane_stage.main, flown("flight.vtkhdf")),
}
#: A stage of each kind of file in every run of the tests, all of them where slow tests run.
ALL = [
    stage if stage in ("film", "plan", "rigid", "screening") else pytest.param(stage, marks=pytest.mark.slow)
    for stage in STAGES
]


def content(path: Path) -> object:
    """All that a file holds but the times it took."""
    if path.suffix == ".json":
        return {key: value for key, value in read_json(path).items() if not key.endswith("_seconds")}
    if path.suffix == ".parquet":
        return repr(pd.read_parquet(path).to_dict("list"))  # nan is nan
    found: dict[str, bytes] = {}
    with h5py.File(path) as file:

        def keep(name: str, item: h5py.Dataset | h5py.Group) -> None:
            if isinstance(item, h5py.Dataset):
                found[name] = np.asarray(item[()]).tobytes() if item.dtype != object else str(item[()]).encode()
            for key, value in item.attrs.items():
                if not (key.endswith("_seconds") or key in ("DIMENSION_LIST", "REFERENCE_LIST")):  # of netCDF
                    found[f"{name}.{key}"] = repr(value).encode()

        file.visititems(keep)
        keep("/", file)
    return found


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[object, float]]:
    """What a quiet run of a stage makes, and the seconds it takes with everything compiled."""
    made: dict[str, tuple[object, float]] = {}

    def of(stage: str) -> tuple[object, float]:
        if stage not in made:
            main, arguments = STAGES[stage]
            folder = tmp_path_factory.mktemp(stage)
            given = arguments(folder)
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("sys.argv", [stage, *given])
                main()  # what is compiled stays, for all processes forked from this one
            begun = time.monotonic()
            assert run(main, given)[0] == 0
            made[stage] = content(Path(given[-1])), time.monotonic() - begun
        return made[stage]

    return of


def ends_as(stage: str, given: list[str], expected: object) -> None:
    """The same command ends well, with those numbers, and leaves nothing else."""
    assert run(STAGES[stage][0], given)[0] == 0
    out = Path(given[-1])
    assert content(out) == expected
    assert [path.name for path in out.parent.iterdir()] == [out.name]


@pytest.mark.parametrize("stage", ALL)
def test_a_stage_that_was_killed_gives_the_same_bits_when_it_is_run_again(
    tmp_path: Path, stage: str, quiet: Callable[[str], tuple[object, float]]
):
    expected, seconds = quiet(stage)
    main, arguments = STAGES[stage]
    given, draw = arguments(tmp_path), random.Random(stage)
    for _ in range(2):
        child = fork(main, given)
        time.sleep(draw.uniform(0.2, 0.9) * seconds)
        os.kill(child.process, signal.SIGKILL)
        child.end()
    ends_as(stage, given, expected)


@pytest.mark.parametrize("times", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("stage", ALL)
def test_a_stage_that_was_interrupted_says_so_in_a_line_and_gives_the_same_bits(
    tmp_path: Path, stage: str, times: int, quiet: Callable[[str], tuple[object, float]]
):
    expected, seconds = quiet(stage)
    main, arguments = STAGES[stage]
    given = arguments(tmp_path)
    child = fork(main, given)
    time.sleep(0.5 * seconds)
    for _ in range(times):
        os.kill(child.process, signal.SIGINT)
        time.sleep(0.002)
    code = child.end()
    assert code in (0, 130) or (times == 2 and code in (1, -signal.SIGINT))
    assert times == 2 or code == 0 or error(child.said).startswith("interrupted; the same command begins again")
    assert "Traceback" not in child.said or times == 2
    ends_as(stage, given, expected)


def jumping() -> None:
    """A clock that is set back by a day whenever it is looked at, and was in the future before."""
    draw, now = random.Random(0), time.time()
    time.time = lambda: now + 86400.0 * draw.uniform(-1000.0, 1000.0)  # in the child alone


@pytest.mark.parametrize("stage", ALL)
def test_a_clock_that_jumps_changes_no_bit(tmp_path: Path, stage: str, quiet: Callable[[str], tuple[object, float]]):
    expected, _ = quiet(stage)
    main, arguments = STAGES[stage]
    given = arguments(tmp_path)
    for path in tmp_path.iterdir():
        os.utime(path, (4e9, 4e9))  # in the year 2096
    assert run(main, given, jumping)[0] == 0
    assert content(Path(given[-1])) == expected


@pytest.mark.parametrize("stage", ALL)
def test_a_full_disk_ends_a_stage_in_a_line_and_changes_no_bit(
    tmp_path: Path, stage: str, quiet: Callable[[str], tuple[object, float]]
):
    expected, _ = quiet(stage)
    main, arguments = STAGES[stage]
    given = arguments(tmp_path)
    code, said = run(main, given, full_at(100))
    assert code == 2
    assert re.fullmatch(rf"error: {given[-1]}(\.partial/.*)?: File too large", error(said))
    assert not Path(given[-1]).exists()
    ends_as(stage, given, expected)


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """A folder in which nothing can be written, whoever tries."""
    folder = tmp_path / "fixed"
    folder.mkdir()
    options = ["-t", "tmpfs", "-o", "size=1m,ro", "none", str(folder)]
    mounted = subprocess.run(["mount", *options], capture_output=True, check=False).returncode == 0
    if not mounted:
        folder.chmod(0o555)
    yield folder
    if mounted:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("stage", ALL)
@pytest.mark.parametrize("below", ["", "new/"])
def test_a_folder_that_cannot_be_written_is_named_before_anything_is_computed(
    tmp_path: Path, read_only: Path, stage: str, below: str
):
    main, arguments = STAGES[stage]
    out = read_only / f"{below}out.h5"
    code, said = run(main, [*arguments(tmp_path)[:-1], str(out)])
    assert (code, error(said)) == (2, f"error: --out = {out}: no permission to write in {read_only}")
    assert list(read_only.iterdir()) == []
