"""Everything the workflow is given is valid, and it says in one line what is not."""

from pathlib import Path

import pytest

from dynamics.scene import read_scene
from optics.cells import read_cell
from optics.files import InputError, load_yaml
from workflow.configuration import read_plan

WORKFLOW = Path(__file__).parents[2] / "workflow"
CONFIG = load_yaml(WORKFLOW / "config.yaml")


@pytest.mark.parametrize("path", sorted(WORKFLOW.glob("designs/*.yaml")), ids=lambda path: path.stem)
def test_every_design_is_valid_and_named_like_its_file(path):
    assert read_cell(path).name == path.stem


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


def _plan(**changes):
    return read_plan({**CONFIG, "fdtd": True, **changes}, WORKFLOW.parent)


def test_the_main_job_has_what_was_promised():
    plan = _plan()
    assert {"mark1e_te", "mark1e_tm"} <= set(plan.fdtd_designs) <= set(plan.gratings)
    assert plan.films == ["si43"]
    assert {"fig6", "fig6_published"} <= set(plan.config.rigid) & set(plan.config.flight) & set(plan.config.floquet)
    assert "results/tables/si43/thin_film.h5" in plan.all_tables
    assert len(plan.benchmarks) == len(set(plan.benchmarks))


def test_without_fdtd_nothing_of_it_is_asked_for():
    plan = _plan(fdtd=False)
    everything = [*plan.all_tables, *plan.all_floquet, *plan.all_flights, *plan.benchmarks]
    assert everything
    assert not [path for path in everything if "fdtd" in path]


def test_scenes_fly_on_the_tables_that_the_configuration_names():
    assert _plan().tables("fig6") == ["results/tables/mark1e_tm/modal.h5", "results/tables/mark1e_te/modal.h5"]
    only = {"floquet": ["fig6"], "rigid": ["fig6"], "flight": []}
    assert _plan(tables="fdtd", **only).tables("fig6")[0] == "results/tables/mark1e_tm/fdtd.h5"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tables": "model"}, r"config.yaml: tables = \"model\": must be 'modal' or 'fdtd'"),
        ({"table": "modal"}, r"unknown key 'table'; did you mean 'tables'\?"),
        ({"fdtd": "yes please"}, r"fdtd = \"yes please\": must be 'auto', True or False"),
        ({"fdtd_parts": 0}, r"fdtd_parts = 0: must be greater than or equal to 1"),
        ({"fdtd_grid": {"u_max": 1.2, "v_max": 0.1, "tolerance": 0.01}}, r"fdtd_grid.u_max = 1.2: must be less than 1"),
        ({"rigid": ["fig7"]}, r"scenes/fig7.yaml: no such file"),
        ({"designs": ["gold"]}, r"designs/gold.yaml: no such file"),
        ({"fdtd_designs": ["si43"]}, r"fdtd_designs.0 = 'si43': must be a metagrating"),
        ({"tables": "fdtd", "fdtd_designs": []}, r"tables = 'fdtd': scene '\w+' has no FDTD table of 'mark1e_tm'"),
        ({"tables": "fdtd", "fdtd": False}, r"FDTD is off or Meep is not installed"),
    ],
)
def test_a_wrong_configuration_is_refused_in_one_line(changes, message):
    with pytest.raises(InputError, match=message) as caught:
        _plan(**changes)
    assert "\n" not in str(caught.value)
