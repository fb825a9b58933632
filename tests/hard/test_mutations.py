"""Mutated scenes, designs and configurations: valid, or refused in one line within 20 s, before any solver.

    pytest tests/hard/test_mutations.py -m slow --hypothesis-seed=7      2,000 inputs

Without `slow` a few of each are drawn, always the same ones.
"""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from beamrider.io.files import InputError, load_yaml
from beamrider.io.wording import place
from dynamics import mesh as mesh_command
from dynamics.membrane import flight as membrane
from dynamics.membrane import plan as plan_stage
from dynamics.membrane import stage as membrane_stage
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.scene import schema as scenes
from dynamics.stability import floquet, maps
from optics.cells.schema import read_cell
from optics.fdtd import nodes
from optics.fdtd import stage as fdtd
from optics.modal import normal_incidence as local
from optics.modal import stage as modal
from optics.thin_film import stage as thin_film
from optics.thin_film.stage import make_table
from tests import mutations
from tests.hard.test_wording import WHOLE, changed, line
from tests.mutations import FEW, Outcome, inputs, many, outcome
from tests.synthetic import smooth_tables
from workflow import family, machine_code
from workflow.configuration import Config, read_config, read_plan
from workflow.published import read_published

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / "workflow"
TE = read_cell(WORKFLOW / "designs/mark1e_te.yaml")


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
    "plan": (plan_stage.main, []),
    "mesh": (mesh_command.main, []),
    "rigid": (rigid.main, [(rigid, "_integrate")]),
    "membrane": (membrane_stage.main, [(membrane.Flight, "advance")]),
    "floquet": (floquet.main, []),
    "maps": (maps.main, [(maps, "make_maps")]),
    "basin": (basin.main, [(basin, "_outcome")]),
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
    ({"rigid": {"duration_s": 1e5}}, "rigid"),
    ({"sail": {"rings": 1000}}, "membrane"),
    ({"sail": {"radius_m": 1e-300}}, "rigid"),
    ({"sail": {"radius_m": 1e300}}, "membrane"),
    ({"beam": {"radius_m": 1e300}}, "floquet"),
    ({"release": {"spin_Hz": 1e15}}, "rigid"),
    ({"sail": {"rings": 10**400}}, "plan"),
    ({"flight": {"time_step_s": 1e-300}}, "membrane"),
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
    "../fig6",
    "..",
    ".",
    "/etc/passwd",
    "~root",
    "a/b",
    "a\\b",
    "a\0b",
    ".hidden",
    "-rf",
    "$(touch x)",
    "é",
    "a b",
    "",
    "x" * 300,
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_names_lead_to_no_other_folder(name: str):
    for model, data, path in (
        (scenes.Scene, SCENES["fig6"], ("name",)),
        (scenes.Scene, SCENES["fig6"], ("sail", "sectors", 0, "design")),
        (Config, LISTS["config"], ("designs", 0)),
        (Config, LISTS["config"], ("rigid", 0)),
        (family.Family, LISTS["search"], ("scene",)),
        (type(TE), DESIGNS["mark1e_te"], ("name",)),
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
