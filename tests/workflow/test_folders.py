"""Results are made in any folder, from a program that is never written to; settings are read as scenes are."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from beamrider.io.files import InputError, load_yaml
from dynamics.scene.schema import Scene, read_scene
from optics.table.pressure_table import PressureTable
from tests.workflow.test_dag import _copy
from workflow.configuration import PROGRAM, link_program, read_config, read_plan

ROOT = Path(__file__).parents[2]
TABLE, STABILITY = "results/tables/si43/thin_film.h5", "results/scenes/own/floquet.json"


def _snakemake(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-B", "-m", "snakemake", "--cores", "1", *arguments]
    clean = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(command, cwd=folder, env=clean, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    """A copy of the project with a scene of films alone; it lacks the tests."""
    folder = _copy(tmp_path_factory.mktemp("program"))
    scene = read_scene(ROOT / "workflow/scenes/fig6.yaml").model_dump()
    for sector in scene["sail"]["sectors"]:
        sector["design"] = "si43"
    own = Scene.model_validate({**scene, "name": "own"})
    (folder / "workflow/scenes/own.yaml").write_text(own.model_dump_json(exclude_none=True), encoding="utf-8")
    return folder


def _content(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


def test_results_are_made_in_another_folder_and_nothing_in_that_of_the_program(program, tmp_path):
    before = _content(program)
    done = _snakemake(tmp_path, "-s", str(program / "Snakefile"), "--config", "fdtd=false", "--", TABLE, STABILITY)
    assert done.returncode == 0, done.stdout + done.stderr
    assert PressureTable.read(tmp_path / TABLE).q_nodes.size > 0
    assert load_yaml(tmp_path / STABILITY)["scene"] == "own"
    assert _content(program) == before
    again = _snakemake(program, "--directory", str(tmp_path), "--dry-run", "--config", "fdtd=false", "--", STABILITY)
    assert "Nothing to be done" in again.stdout + again.stderr
    assert _content(program) == before


@pytest.mark.parametrize(
    ("given", "tolerance", "fdtd"),
    [
        ({"fdtd": "false", "modal": {"tolerance": "1e-2"}}, 1e-2, False),  # as Snakemake hands on the command line
        ({"fdtd": True, "modal": {"tolerance": 2e-3}}, 2e-3, True),
        ({"fdtd": "false"}, 1e-3, False),
    ],
)
def test_the_command_line_overrules_the_file_key_by_key(given, tolerance, fdtd):
    plan = read_plan(read_config([ROOT / "workflow/config.yaml"], given), ROOT)
    assert (plan.config.modal.tolerance, plan.config.modal.u_max, plan.fdtd) == (tolerance, 0.4227, fdtd)


def test_a_further_file_overrules_the_first(tmp_path):
    (tmp_path / "mine.yaml").write_text("modal: {tolerance: 1e-2}\nblock_minutes: 010\nfdtd: false\n", encoding="utf-8")
    plan = read_plan(read_config([ROOT / "workflow/config.yaml", tmp_path / "mine.yaml"], {"fdtd": "auto"}), ROOT)
    assert (plan.config.modal.tolerance, plan.config.block_minutes, plan.config.fdtd) == (1e-2, 10, "auto")


def test_snakemake_reads_numbers_as_the_stages_do(program, tmp_path):
    config = (program / "workflow/config.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(config.replace("tolerance: 0.001", "tolerance: 1e-3"), encoding="utf-8")
    assert "tolerance: 1e-3" in (tmp_path / "mine.yaml").read_text(encoding="utf-8")
    given = ["--configfile", str(tmp_path / "mine.yaml"), "--config", "fdtd=false", "modal={v_max: 2e-1}"]
    table = "results/tables/mark1e_te/modal.h5"
    done = _snakemake(tmp_path, "-s", str(program / "Snakefile"), "--dry-run", "-p", *given, "--", table)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "--u-max 0.4227 --v-max 0.2 --tolerance 0.001" in done.stdout + done.stderr


def test_what_is_in_the_way_of_a_link_is_named_and_left(tmp_path):
    (tmp_path / "optics").mkdir()
    with pytest.raises(InputError, match=r"optics: in the way of a link to .*; make results in another folder"):
        link_program(ROOT, tmp_path)
    assert (tmp_path / "optics").is_dir()


def test_links_follow_a_program_that_was_moved(tmp_path):
    old, new, here = (tmp_path / name for name in ("old", "new", "here"))
    for folder in (*(new / name for name in PROGRAM), here):
        folder.mkdir(parents=True)
    (here / "optics").symlink_to(old / "optics")
    link_program(new, here)
    assert all((here / name).resolve() == new / name for name in PROGRAM)
    link_program(new, new)
    assert not any((new / name).is_symlink() for name in PROGRAM)
