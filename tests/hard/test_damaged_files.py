"""Mutated and damaged files: whole, or refused in one line within 20 s, and nothing in them is executed.

    pytest tests/hard/test_damaged_files.py -m slow --hypothesis-seed=7      500 files of every kind

Without `slow` a few of each are drawn, always the same ones.
"""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from beamrider.io.checksum import append_checksum
from beamrider.io.files import InputError, read_json, write_json, write_lines
from beamrider.io.parquet import read_parquet, write_parquet
from dynamics.membrane import stage as membrane_stage
from dynamics.membrane.output.journal import Journal
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.scene import schema as scenes
from dynamics.stability import floquet, maps, screening
from optics.cells.schema import read_cell
from optics.fdtd import stage as fdtd
from optics.fdtd.grid import FdtdSettings
from optics.fdtd.parts import Rows, read_rows, write_rows
from optics.modal import normal_incidence as local
from optics.table.pressure_table import PressureTable
from optics.thin_film.stage import make_table
from tests import mutations
from tests.damage import edited
from tests.families import many_cells, many_members
from tests.membranes import small
from tests.mutations import FEW, damaged, edited_file, many, outcome
from tests.synthetic import smooth_tables
from workflow.figures import drawing, flown, snapshots

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / "workflow"
TE = read_cell(WORKFLOW / "designs/mark1e_te.yaml")


class Executes:
    """Unpickling this would touch a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_nothing_in_hdf5_files_and_checkpoints_is_executed(tmp_path: Path):
    """Objects that NumPy would unpickle: refused in a checkpoint, bytes like any others in a table."""
    made, table, found = tmp_path / "executed", tmp_path / "table.h5", Executes(tmp_path / "executed")
    smooth_tables()["mark1e_te"].write(table)
    with edited(table) as file:
        file.attrs["cell"] = np.void(pickle.dumps(found))
        del file["error"]
        file["error"] = np.void(pickle.dumps(found))
    with pytest.raises(InputError, match=r"table\.h5: "):
        PressureTable.read(table)
    flight = Journal(tmp_path / "flight", 3, 4)
    with open(tmp_path / "flight/checkpoint.npz", "wb") as stream:
        np.savez(stream, fingerprint=np.array("x"), sizes=np.array([found], dtype=object))
    append_checksum(tmp_path / "flight/checkpoint.npz")
    assert flight.restore("x") is None
    assert not made.exists()


def screened_rows(path: Path) -> None:
    """A screened family of few members."""
    scene, members, cells = scenes.read_scene(WORKFLOW / "scenes/fig6.yaml"), many_members(3), many_cells(3)
    found = screening.rank(screening.screen(scene, members, cells), "margin_1_s", [])
    write_parquet(path, found.to_parquet(index=False))


GRID = basin.Grid(offsets_m=[0.0, 0.1], n_offsets=2, tilts_deg=[-3.0, 3.0], n_tilts=2, duration_s=0.01)
SHORT = small(rings=3, rigid={"duration_s": 1e-3}, flight={"duration_s": 1e-5, "spin_up_s": 1e-5})


def map_basin(path: Path) -> None:
    tables = smooth_tables()
    basin.write(path, basin.fly_cells(SHORT, tables, GRID, [1, 3]), SHORT, tables, GRID)


def stage(main: Callable[[], None], path: Path) -> None:
    """Run a stage on the small scene in this process."""
    scene = path.with_name("small.yaml")
    scene.write_text(SHORT.model_copy(update={"name": "small"}).model_dump_json(), encoding="utf-8")
    tables = [str(path.with_name(f"{name}.h5")) for name in smooth_tables()]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["stage", "--scene", str(scene), "--tables", *tables, "--out", str(path)])
        main()


#: How a file of each kind is made, and read.
KINDS: dict[str, tuple[Callable[[Path], Any], Callable[[Path], Any]]] = {
    "table.h5": (lambda path: smooth_tables()["mark1e_te"].write(path), PressureTable.read),
    "film.h5": (
        lambda path: make_table(read_cell(WORKFLOW / "designs/si43.yaml"), 0.9, 1e-4).write(path),  # type: ignore[arg-type]
        PressureTable.read,
    ),
    "part.h5": (
        lambda path: write_rows(path, TE, FdtdSettings(), Rows(np.random.default_rng(0).uniform(size=(9, 14)))),
        lambda path: read_rows(path, TE, FdtdSettings()),
    ),
    "block.h5": (map_basin, lambda path: basin.merge([path, path], SHORT, smooth_tables(), GRID)),
    "rigid.h5": (functools.partial(stage, rigid.main), drawing.read_series),
    "maps.h5": (functools.partial(stage, maps.main), drawing.read_series),
    "flight.vtkhdf": (functools.partial(stage, membrane_stage.main), flown.read),
    "flight2.vtkhdf": (functools.partial(stage, membrane_stage.main), snapshots.read),
    "floquet.json": (functools.partial(stage, floquet.main), read_json),
    "nodes.json": (
        lambda path: write_json(path, {"name": TE.name, "u": [-0.1, 0.0, 0.1], "v": [0.0, 0.1], "error": 1e-3}),
        lambda path: fdtd.read_nodes(str(path), TE),  # type: ignore[arg-type]
    ),
    "cells.jsonl": (lambda path: write_lines(path, [TE.model_dump()] * 2), local.read_cells),
    "screened.parquet": (screened_rows, read_parquet),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the files are written."""
    return tmp_path_factory.mktemp("damaged")


@pytest.fixture(scope="module")
def kept(folder: Path) -> dict[str, bytes]:
    """The content of a file of every kind."""
    for name in smooth_tables():
        smooth_tables()[name].write(folder / f"{name}.h5")
    for name, (make, _) in KINDS.items():
        make(folder / name)
    return {name: (folder / name).read_bytes() for name in KINDS}


def read_fault(folder: Path, kind: str, content: bytes, refused: bool) -> str:
    """What is wrong with how a changed file is read; `refused` if it must not be."""
    path = mutations.write(folder / f"changed_{kind}", content)

    def main() -> None:
        KINDS[kind][1](path)

    found = outcome(main, [], [])
    used = "used" if refused and found.code == 0 else ""
    return used or found.fault((str(path), "--parts"))


def files_fault(folder: Path, kept: dict[str, bytes], data: st.DataObject, kind: str) -> str:
    """What is wrong with how a file of a kind is read that was damaged; or edited, so that its checksum fits."""
    if data.draw(st.booleans(), label="damaged"):
        return read_fault(folder, kind, data.draw(damaged(kept[kind])), True)
    path = mutations.write(folder / f"edited_{kind}", kept[kind])
    data.draw(edited_file(path))
    return read_fault(folder, kind, path.read_bytes(), False)


@settings(FEW, max_examples=4)
@given(data=st.data())
@pytest.mark.parametrize("kind", list(KINDS))
def test_some_damaged_files(folder: Path, kept: dict[str, bytes], kind: str, data: st.DataObject):
    assert files_fault(folder, kept, data, kind) == ""


@pytest.mark.slow
@many(500)
@given(data=st.data())
@pytest.mark.parametrize("kind", list(KINDS))
def test_damaged_files(folder: Path, kept: dict[str, bytes], kind: str, data: st.DataObject):
    assert files_fault(folder, kept, data, kind) == ""
