"""A disk that is full when a stage writes its HDF5 file: one line and exit code 2, no crash, what was there stays."""

from pathlib import Path

import numpy as np
import pytest

from dynamics import mesh as mesh_command
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.scene.schema import read_scene
from optics.cells.schema import read_cell
from optics.fdtd.grid import FdtdSettings
from optics.fdtd.parts import Rows, write_rows
from optics.thin_film import stage as thin_film
from tests.membranes import altered, write_inputs
from tests.processes import error, full_at, run

ROOT = Path(__file__).parents[2]
SHORT = altered(read_scene(ROOT / "workflow" / "scenes" / "fig6.yaml"), rigid={"duration_s": 0.01})
GRID = "offsets_m: [0.0, 0.1]\nn_offsets: 2\ntilts_deg: [-3.0, 3.0]\nn_tilts: 3\nduration_s: 0.01\n"


def film(folder: Path) -> list[str]:
    return ["--cell", str(ROOT / "workflow/designs/si43.yaml"), "--out", str(folder / "out" / "film.h5")]


def flight(folder: Path) -> list[str]:
    return write_inputs(folder, SHORT, "result.h5")


def mapped(folder: Path) -> list[str]:
    folder.joinpath("grid.yaml").write_text(GRID, encoding="utf-8")
    return ["--grid", str(folder / "grid.yaml"), *flight(folder)]


def meshed(folder: Path) -> list[str]:
    return ["--scene", str(ROOT / "workflow/scenes/fig6.yaml"), "--out", str(folder / "out" / "mesh.vtkhdf")]


STAGES = {
    "table": (thin_film.main, film),
    "rigid flight": (rigid.main, flight),
    "basin": (basin.main, mapped),
    "mesh": (mesh_command.main, meshed),
}


@pytest.mark.parametrize("stage", list(STAGES))
def test_a_stage_on_a_full_disk_ends_in_one_line_and_leaves_what_was_there(tmp_path: Path, stage: str):
    """Full from the first byte, in the middle, and one byte before the end of the file."""
    main, arguments = STAGES[stage]
    given = arguments(tmp_path)
    out = Path(given[-1])
    assert run(main, given)[0] == 0
    size = out.stat().st_size
    out.write_text("the former file")
    for room in (0, size // 2, size - 1):
        code, said = run(main, given, full_at(room))
        assert (code, error(said)) == (2, f"error: {out}: File too large")
        assert out.read_text() == "the former file"
        assert [path.name for path in out.parent.iterdir()] == [out.name]
    assert run(main, given, full_at(size))[0] == 0
    assert out.stat().st_size == size


def rows_of_fdtd(path: Path) -> None:
    write_rows(path, read_cell(ROOT / "workflow/designs/mark1e_te.yaml"), FdtdSettings(), Rows(np.ones((20, 14))))


def test_a_part_of_fdtd_on_a_full_disk(tmp_path: Path):
    path = tmp_path / "part.h5"
    code, said = run(lambda: rows_of_fdtd(path), [], full_at(3000))
    assert (code, error(said)) == (2, f"error: {path}: File too large")
    assert list(tmp_path.iterdir()) == []
