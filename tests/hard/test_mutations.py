"""Mutated scenes, designs, configurations and files: valid, or refused in one line within 20 s, before any solver.

    pytest tests/hard/test_mutations.py -m slow --hypothesis-seed=7      2,000 inputs and 500 files of every kind

Without `slow` a few of each are drawn, always the same ones.
"""

from __future__ import annotations

import copy
import functools
import importlib
import json
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from dynamics import basin, floquet, maps, membrane, mesh, rigid, screening
from dynamics import scene as scenes
from dynamics.journal import Journal
from optics import fdtd, local, modal, nodes, thin_film
from optics.cells import read_cell
from optics.checksum import append_checksum
from optics.fdtd_grid import FdtdSettings
from optics.fdtd_parts import Rows, read_rows, write_rows
from optics.files import InputError, load_yaml, read_json, write_json, write_lines
from optics.parquet import read_parquet, write_parquet
from optics.table import PressureTable
from optics.thin_film import make_table
from optics.wording import place
from tests import mutations
from tests.damage import edited
from tests.families import many_cells, many_members
from tests.hard.test_wording import WHOLE, changed, line
from tests.membranes import small
from tests.mutations import Outcome, damaged, edited_file, inputs, outcome
from tests.synthetic import smooth_tables
from workflow import family, machine_code
from workflow.configuration import Config, read_config, read_plan
from workflow.published import read_published

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / "workflow"
TE = read_cell(WORKFLOW / "designs/mark1e_te.yaml")
FEW = settings(
    max_examples=25, deadline=None, derandomize=True, database=None, phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)


def many(count: int) -> settings:
    """So many examples, other ones with another seed; what is wrong is not made simpler, which takes long."""
    return settings(FEW, max_examples=count, derandomize=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tables of the paper's cells and of a film; what stages run is compiled, which no process has time for."""
    machine_code.compile_all(scenes.read_scene(machine_code.SCENE))
    made = tmp_path_factory.mktemp("mutations")
    for name, table in smooth_tables().items():
        table.write(made / f"{name}.h5")
    make_table(read_cell(WORKFLOW / "designs/si43.yaml"), 0.9, 1e-4).write(made / "si43.h5")  # type: ignore[arg-type]
    return made


# Scenes

SCENES = {name: load_yaml(WORKFLOW / f"scenes/{name}.yaml") for name in ("fig6", "s7a_published", "fig4_reflections")}
SCENES["scene"] = WHOLE["scene"][1]
CURVED = ("plan", "mesh", "membrane")  # stages for sails that are not flat, or not of sectors alone
FLYING: dict[str, tuple[Callable[[], None], list[tuple[Any, str]]]] = {
    "plan": (scenes.main, []), "mesh": (mesh.main, []), "rigid": (rigid.main, [(rigid, "_integrate")]),
    "membrane": (membrane.main, [(membrane.Flight, "advance")]), "floquet": (floquet.main, []),
    "maps": (maps.main, [(maps, "make_maps")]), "basin": (basin.main, [(basin, "_outcome")]),
}


def fly(folder: Path, name: str, stage: str, content: bytes) -> Outcome:
    """What a stage of motion makes of a scene, with the tables of the scene of that name that it was made from."""
    main, solvers = FLYING[stage]
    path = mutations.write(folder / "fig6.yaml", content)
    designs = {"fig4_reflections": ["si43"], "scene": []}.get(name, ["mark1e_te", "mark1e_tm"])
    tables = [] if stage in ("plan", "mesh") else ["--tables", *(str(folder / f"{design}.h5") for design in designs)]
    return outcome(main, ["--scene", str(path), *tables, "--out", str(folder / "out")], solvers)


def scene_fault(folder: Path, drawn: tuple[str, str, bytes]) -> str:
    return fly(folder, *drawn).fault(("fig6", str(folder)))


@st.composite
def wrong_scenes(draw: st.DrawFn) -> tuple[str, str, bytes]:
    """Name of a scene, a stage that takes such scenes, and a mutation of it."""
    name = draw(st.sampled_from(list(SCENES)))
    stage = draw(st.sampled_from(list(FLYING) if name in ("fig6", "s7a_published") else CURVED))
    return name, stage, draw(inputs({**SCENES[name], "name": "fig6"}))


@FEW
@given(drawn=wrong_scenes())
def test_some_mutated_scenes(folder: Path, drawn: tuple[str, str, bytes]):
    assert scene_fault(folder, drawn) == ""


@pytest.mark.slow
@many(1000)
@given(drawn=wrong_scenes())
def test_mutated_scenes(folder: Path, drawn: tuple[str, str, bytes]):
    assert scene_fault(folder, drawn) == ""


SEEN = [
    ({"rigid": {"duration_s": 1e5}}, "rigid"), ({"sail": {"rings": 1000}}, "membrane"),
    ({"sail": {"radius_m": 1e-300}}, "rigid"), ({"sail": {"radius_m": 1e300}}, "membrane"),
    ({"beam": {"radius_m": 1e300}}, "floquet"), ({"release": {"spin_Hz": 1e15}}, "rigid"),
    ({"sail": {"rings": 10**400}}, "plan"), ({"flight": {"time_step_s": 1e-300}}, "membrane"),
    ({"name": "x" * 100_000}, "plan"),
]


@pytest.mark.parametrize(("changes", "stage"), SEEN)
def test_values_that_ended_in_tracebacks_or_never(folder: Path, changes: dict[str, Any], stage: str):
    data = copy.deepcopy(SCENES["fig6"])
    for key, value in changes.items():
        data[key] = {**data.get(key, {}), **value} if isinstance(value, dict) else value
    found = fly(folder, "fig6", stage, json.dumps(data).encode())
    assert (found.code, found.fault(("fig6", str(folder)))) == (2, "")


# Designs

DESIGNS = {name: load_yaml(WORKFLOW / f"designs/{name}.yaml") for name in ("mark1e_te", "rounded_tm", "si43")}
DESIGNS |= {name: WHOLE[name][1] for name in ("thin_film", "lamellar", "profile", "metagrating")}
SOLVING: dict[str, tuple[Callable[[], None], list[str], list[tuple[Any, str]]]] = {
    "modal": (modal.main, [], [(modal, "choose"), (modal, "refuse_early")]),
    "thin_film": (thin_film.main, [], [(thin_film, "refine")]),
    "nodes": (nodes.main, [], [(nodes, "solve")]),
    "fdtd": (fdtd.main, [], [(fdtd, "import_meep")]),
    "local": (local.main, [], [(local, "row")]),
}


def design_fault(folder: Path, drawn: tuple[str, bytes]) -> str:
    """What is wrong with what a solver makes of a design."""
    stage, content = drawn
    main, more, solvers = SOLVING[stage]
    path = mutations.write(folder / "cell.yaml", as_json(content) if stage == "local" else content)
    cell = "--cells" if stage == "local" else "--cell"
    return outcome(main, [cell, str(path), *more, "--out", str(folder / "out")], solvers).fault(
        (str(folder), *(str(data["name"]) for data in DESIGNS.values()), "--u-max", "--v-max")
    )


def as_json(content: bytes) -> bytes:
    """The same as JSON in one line, if it is YAML."""
    try:
        return json.dumps(yaml.safe_load(content)).encode()
    except (yaml.YAMLError, ValueError, TypeError, RecursionError, AttributeError):
        return content


@st.composite
def wrong_designs(draw: st.DrawFn) -> tuple[str, bytes]:
    """A solver, and a mutation of a design that it takes."""
    stage = draw(st.sampled_from(list(SOLVING)))
    films, plain = ("si43", "thin_film"), ("mark1e_te",)
    fitting = [n for n in DESIGNS if (n in films) == (stage == "thin_film") and (stage != "local" or n in plain)]
    return stage, draw(inputs(DESIGNS[draw(st.sampled_from(fitting))]))


@FEW
@given(drawn=wrong_designs())
def test_some_mutated_designs(folder: Path, drawn: tuple[str, bytes]):
    assert design_fault(folder, drawn) == ""


@pytest.mark.slow
@many(500)
@given(drawn=wrong_designs())
def test_mutated_designs(folder: Path, drawn: tuple[str, bytes]):
    assert design_fault(folder, drawn) == ""


# Configurations, families, lists of cases

def plan() -> None:
    read_plan(read_config([sys.argv[1]]), ROOT)


def published() -> None:
    read_published(sys.argv[1])


LISTS = {"published": load_yaml(WORKFLOW / "published.yaml"), "config": load_yaml(WORKFLOW / "config.yaml")}
LISTS |= {name: load_yaml(WORKFLOW / f"designs/{name}.yaml") for name in ("search", "gap_study", "tolerances")}
LISTS["family"] = WHOLE["family"][1]
LISTS["basin grid"] = WHOLE["basin grid"][1]


def list_fault(folder: Path, what: str, content: bytes) -> str:
    """What is wrong with what is made of a configuration, a family, a list of published flights, or a grid."""
    name = LISTS[what].get("name", "a") if isinstance(LISTS[what], dict) else "a"
    path = mutations.write(folder / f"{name}.yaml", content)
    if what in ("published", "config"):
        return outcome(published if what == "published" else plan, [str(path)], []).fault((str(path), "workflow/"))
    if what == "basin grid":
        scene = mutations.write(folder / "fig6.yaml", json.dumps(SCENES["fig6"]).encode())
        tables = [str(folder / f"mark1e_{x}.h5") for x in ("te", "tm")]
        given = ["--scene", str(scene), "--tables", *tables, "--grid", str(path), "--out", str(folder / "out")]
        return outcome(basin.main, given, [(basin, "_outcome")]).fault((str(path), "fig6"))
    given = ["--family", str(path), "--workflow", str(WORKFLOW), "--out", str(folder / "family")]
    return outcome(family.main, given, []).fault((str(path), path.name, path.stem, "scenes/", "designs/"))


WRONG_LISTS = st.sampled_from(list(LISTS)).flatmap(lambda what: st.tuples(st.just(what), inputs(LISTS[what])))


@FEW
@given(drawn=WRONG_LISTS)
def test_some_mutated_configurations(folder: Path, drawn: tuple[str, bytes]):
    assert list_fault(folder, *drawn) == ""


@pytest.mark.slow
@many(500)
@given(drawn=WRONG_LISTS)
def test_mutated_configurations(folder: Path, drawn: tuple[str, bytes]):
    assert list_fault(folder, *drawn) == ""


# What is in a file stays data, and names stay within the project

OUTSIDE = [
    "../fig6", "..", ".", "/etc/passwd", "~root", "a/b", "a\\b", "a\0b", ".hidden", "-rf", "$(touch x)", "é", "a b", "",
    "x" * 300,
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_names_lead_to_no_other_folder(name: str):
    for model, data, path in (
        (scenes.Scene, SCENES["fig6"], ("name",)), (scenes.Scene, SCENES["fig6"], ("sail", "sectors", 0, "design")),
        (Config, LISTS["config"], ("designs", 0)), (Config, LISTS["config"], ("rigid", 0)),
        (family.Family, LISTS["search"], ("scene",)), (type(TE), DESIGNS["mark1e_te"], ("name",)),
    ):
        assert line(model, changed(data, path, name)).startswith(f"a.yaml: {place(path)} = ")


@pytest.mark.parametrize(
    "tag", ["apply:os.system ['touch {}']", "new:os.system ['touch {}']", "name:os.system", "module:os"]
)
@pytest.mark.parametrize("kind", ["python/object/", "python/"])
def test_nothing_in_a_yaml_file_is_executed(tmp_path: Path, kind: str, tag: str):
    path, made = tmp_path / "a.yaml", tmp_path / "executed"
    path.write_text(f"a: !!{kind}{tag.format(made)}\n", encoding="utf-8")
    with pytest.raises(InputError, match="could not determine a constructor for the tag"):
        load_yaml(path)
    assert not made.exists()


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


# Files that we write

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


def figure(module: str, name: str) -> Callable[[Path], Any]:
    """A reader of the figures, whose scripts see the modules of their own folder."""
    def read(path: Path) -> Any:
        sys.path.insert(0, str(WORKFLOW / "figures"))
        return getattr(importlib.import_module(module), name)(path)
    return read


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
    "rigid.h5": (functools.partial(stage, rigid.main), figure("drawing", "read_series")),
    "maps.h5": (functools.partial(stage, maps.main), figure("drawing", "read_series")),
    "flight.vtkhdf": (functools.partial(stage, membrane.main), figure("flown", "read")),
    "flight2.vtkhdf": (functools.partial(stage, membrane.main), figure("snapshots", "read")),
    "floquet.json": (functools.partial(stage, floquet.main), read_json),
    "nodes.json": (
        lambda path: write_json(path, {"name": TE.name, "u": [-0.1, 0.0, 0.1], "v": [0.0, 0.1], "error": 1e-3}),
        lambda path: fdtd.read_nodes(str(path), TE),  # type: ignore[arg-type]
    ),
    "cells.jsonl": (lambda path: write_lines(path, [TE.model_dump()] * 2), local.read_cells),
    "screened.parquet": (screened_rows, read_parquet),
}


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
