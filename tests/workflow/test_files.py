"""Everything the workflow is given is valid, and it says in one line what is not."""

import shutil
from pathlib import Path

import pytest

from beamrider.io.files import InputError, load_yaml
from dynamics.scene.schema import Scene, read_scene
from optics.cells.schema import read_cell
from workflow.configuration import read_plan
from workflow.family import read_family

WORKFLOW = Path(__file__).parents[2] / "workflow"
CONFIG = load_yaml(WORKFLOW / "config.yaml")


@pytest.mark.parametrize("path", sorted(WORKFLOW.glob("designs/*.yaml")), ids=lambda path: path.stem)
def test_every_design_is_valid_and_named_like_its_file(path):
    read = read_family if load_yaml(path)["kind"] == "family" else read_cell
    assert read(path).name == path.stem


@pytest.mark.parametrize("path", sorted(WORKFLOW.glob("scenes/*.yaml")), ids=lambda path: path.stem)
def test_every_scene_is_valid_and_its_designs_exist(path):
    for design in read_scene(path).sail.designs:
        assert (WORKFLOW / "designs" / f"{design}.yaml").is_file()


def test_scenes_named_published_differ_from_their_twins_in_the_published_choices_alone():
    for published in WORKFLOW.glob("scenes/*_published.yaml"):
        twin = published.with_name(published.name.replace("_published", ""))
        if twin.exists():
            ours, theirs = read_scene(twin), read_scene(published)
            assert (ours.sail, ours.beam, ours.release) == (theirs.sail, theirs.beam, theirs.release)
            assert (ours.incidence, theirs.incidence) == ("sail_frame", "yaw_blind")


WIDE = {"u_max": 0.18, "v_max": 0.18, "tolerance": 0.01}


def _plan(**changes):
    return read_plan({**CONFIG, "fdtd": True, **changes}, WORKFLOW.parent)


def test_the_main_job_has_what_was_promised():
    plan = _plan()
    assert {"mark1e_te", "mark1e_tm"} <= set(plan.fdtd_designs) <= set(plan.gratings)
    assert plan.films == ["si43"]
    assert {"fig6", "fig6_published"} <= set(plan.config.rigid) & set(plan.config.flight) & set(plan.config.floquet)
    assert "results/tables/si43/thin_film.h5" in plan.all_tables
    assert len(plan.benchmarks) == len(set(plan.benchmarks))


def test_a_family_among_the_designs_is_screened_and_its_best_are_confirmed():
    plan = _plan(designs=["si43", "wider_periods", "gap_study"])
    assert plan.families == {"wider_periods": 1, "gap_study": 0}
    assert not plan.families.keys() & plan.cells.keys()
    folder = "results/screening"
    assert plan.all_families == [
        f"{folder}/wider_periods/screened.parquet",
        f"{folder}/gap_study/screened.parquet",
        f"{folder}/wider_periods/confirmed.md",
    ]
    assert {"family_wider_periods", "confirmed_wider_periods", "family_gap_study"} <= set(plan.figures)
    assert "confirmed_gap_study" not in plan.figures
    assert _plan().all_families == []


def test_without_fdtd_nothing_of_it_is_asked_for():
    plan = _plan(fdtd=False)
    everything = [*plan.all_tables, *plan.all_floquet, *plan.all_flights, *plan.benchmarks]
    assert everything
    assert not [path for path in everything if "fdtd" in path]
    assert (plan.checks, _plan().checks) == ([], ["results/checks.json"])


def _with_scene(folder: Path, name: str, design: str, **changes):
    """A plan with a further scene, of fig6 with one design throughout, in a copy of the workflow's files."""
    for kind in ("scenes", "designs"):
        shutil.copytree(WORKFLOW / kind, folder / "workflow" / kind)
    scene = read_scene(WORKFLOW / "scenes/fig6.yaml").model_dump()
    for sector in scene["sail"]["sectors"]:
        sector["design"] = design
    path = folder / "workflow/scenes" / f"{name}.yaml"
    path.write_text(Scene.model_validate({**scene, "name": name}).model_dump_json(), encoding="utf-8")
    return read_plan({**CONFIG, "fdtd": True, **changes}, folder)


@pytest.mark.parametrize(
    ("design", "fdtd", "again"),
    [("si43", False, False), ("si43", True, False), ("mark1e_te", False, False), ("mark1e_te", True, True)],
)
def test_stability_is_analysed_again_where_fdtd_solved_a_grating(tmp_path, design, fdtd, again):
    plan = _with_scene(tmp_path, "own", design, floquet=["own"], fdtd=fdtd)
    assert ("results/scenes/own/floquet_fdtd.json" in plan.all_floquet) is again


def test_a_scene_outside_the_configuration_can_be_asked_for(tmp_path):
    plan = _with_scene(tmp_path, "own", "wide_gap_te", floquet=["fig6"])
    assert "wide_gap_te" not in plan.cells
    assert plan.tables("own") == ["results/tables/wide_gap_te/modal.h5"]
    assert not any("own" in path for path in [*plan.all_floquet, *plan.all_flights])
    with pytest.raises(InputError, match=r"scenes/nothing.yaml: no such file"):
        plan.tables("nothing")


def test_a_scene_outside_the_configuration_is_refused_without_its_fdtd_tables(tmp_path):
    plan = _with_scene(tmp_path, "own", "wide_gap_te", tables="fdtd", floquet=["fig6"])
    with pytest.raises(InputError, match=r"scene 'own' has no FDTD table of 'wide_gap_te': name it in fdtd_designs"):
        plan.tables("own")


def test_with_fdtd_tables_alone_stability_is_analysed_once():
    plan = _plan(tables="fdtd", floquet=["fig6"])
    assert plan.all_floquet == ["results/scenes/fig6/floquet.json"]


def test_scenes_fly_on_the_tables_that_the_configuration_names():
    assert _plan().tables("fig6") == ["results/tables/mark1e_tm/modal.h5", "results/tables/mark1e_te/modal.h5"]
    only = {"floquet": ["fig6"], "rigid": ["fig6"], "flight": []}
    assert _plan(tables="fdtd", **only).tables("fig6")[0] == "results/tables/mark1e_tm/fdtd.h5"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tables": "model"}, r"config.yaml: tables = \"model\": must be 'modal' or 'fdtd'"),
        ({"table": "modal"}, r"unknown key 'table'; did you mean 'tables'\?"),
        ({"fdtd": "yes please"}, r"fdtd = \"yes please\": must be 'auto', true or false"),
        ({"block_minutes": 0}, r"block_minutes = 0: must be greater than or equal to 0.1"),
        ({"fdtd_grid": {"u_max": 1.2, "v_max": 0.1, "tolerance": 0.01}}, r"fdtd_grid.u_max = 1.2: must be less than 1"),
        ({"rigid": ["fig7"]}, r"scenes/fig7.yaml: no such file"),
        ({"designs": ["gold"]}, r"designs/gold.yaml: no such file"),
        ({"fdtd_designs": ["search"]}, r"designs/search.yaml: kind = \"family\": must be one of metagrating, "),
        ({"fdtd_designs": ["si43"]}, r"fdtd_designs\[0\] = 'si43': must be a grating"),
        ({"tables": "fdtd", "fdtd_designs": []}, r"tables = 'fdtd': scene '\w+' has no FDTD table of 'mark1e_tm'"),
        ({"modal": {**WIDE, "u_max": 0.8, "v_max": 0.6}}, r"yaml: modal: u_max² \+ v_max² = 1: must be less than 1"),
        ({"fdtd_grid": {**WIDE, "u_max": 0.8, "v_max": 0.7}}, r"config.yaml: fdtd_grid: u_max² \+ v_max² = 1.13"),
        ({"fdtd_grid": {**WIDE, "v_max": 0.43}}, r"fdtd_grid.v_max = 0.43: must be at most modal.v_max = 0.4227"),
        ({"modal": {**WIDE, "u_max": 0.02}, "fdtd": False}, r"modal: u_max = 0.02, .* of scene 'fig6'.* 0.03488"),
        ({"tables": "fdtd", "fdtd_grid": {**WIDE, "v_max": 0.03}, "floquet": []}, r"fdtd_grid: .* v_max = 0.03: too"),
        ({"tables": "fdtd", "fdtd": False}, r"FDTD is off or Meep is not installed"),
    ],
)
def test_a_wrong_configuration_is_refused_in_one_line(changes, message):
    with pytest.raises(InputError, match=message) as caught:
        _plan(**changes)
    assert "\n" not in str(caught.value)
