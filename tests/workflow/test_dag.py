"""Snakemake runs what it should, once, and again only what a change calls for: content counts, not time."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from beamrider.io.files import load_yaml
from workflow.configuration import read_plan

ROOT = Path(__file__).parents[2]
NODES = '''"""Stands in for the choice of directions: quick, and always the same."""
from pathlib import Path
import optics.modal.stage
import sys

def main() -> None:
    Path(sys.argv[sys.argv.index("--out") + 1]).write_text("{}")

if __name__ == "__main__":
    main()
'''


def _snakemake(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "snakemake", "--cores", "1", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def _jobs(folder: Path, *arguments: str) -> dict[str, int]:
    """Number of jobs of each rule that a run would start."""
    result = _snakemake(folder, "--dry-run", "--config", "fdtd=true", *arguments)
    assert result.returncode == 0, result.stdout + result.stderr
    table = re.search(r"^job +count\n[- ]+\n(.*?)^total", result.stdout + result.stderr, re.M | re.S)
    return {name: int(count) for name, count in (line.split() for line in table[1].splitlines())} if table else {}


def _copy(folder: Path) -> Path:
    for name in ("beamrider", "optics", "dynamics", "workflow"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "Snakefile", folder)
    (folder / "optics/nodes.py").write_text(NODES, encoding="utf-8")
    return folder


def _outputs(folder: Path) -> list[str]:
    plan = read_plan({**load_yaml(folder / "workflow/config.yaml"), "fdtd": True}, folder)
    parts = [path for design in plan.fdtd_designs for path in plan.parts(design)]
    nodes = [f"results/tables/{design}/fdtd/nodes.json" for design in plan.fdtd_designs]
    plans = [f"results/scenes/{scene}/plan.json" for scene in plan.scenes]
    figures = [f"results/figures/{name}.{kind}" for name in plan.figures for kind in ("png", "svg")]
    summary = ["results/summary.csv", "results/summary.html", "results/contents.sha256"]
    maps = [f"results/scenes/{scene}/maps.h5" for scene in plan.config.maps]
    stages = [*maps, *plan.all_tables, *parts, *nodes, *plans, *plan.all_floquet, *plan.all_flights]
    return [*stages, *plan.benchmarks, *plan.checks, *figures, *summary]


@pytest.fixture(scope="module")
def new(tmp_path_factory) -> Path:
    """A copy of the project where nothing was made yet."""
    return _copy(tmp_path_factory.mktemp("new"))


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    """A copy of the project where all was made, with empty files for results."""
    folder = _copy(tmp_path_factory.mktemp("done"))
    for name in _outputs(folder):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("{}" if path.suffix == ".json" else "")
    result = _snakemake(folder, "--touch", "--forceall", "--config", "fdtd=true")
    assert result.returncode == 0, result.stderr
    return folder


@pytest.fixture
def edit(done):
    """A function that changes what a file of `done` means, or appends `text` to it, until the test ends."""
    before = {}

    def change(name: str, text: str | None = None) -> None:
        path = done / name
        before[path] = path.read_bytes()
        added = text or ("EDITED = 1\n" if path.suffix == ".py" else "")
        meant = before[path].replace(b"membrane_nm: 200", b"membrane_nm: 201") if text is None else before[path]
        path.write_bytes(meant + f"\n{added}".encode())

    yield change
    for path, content in before.items():
        path.write_bytes(content)


def test_all_stages_are_run_the_first_time(new):
    plan = read_plan({**load_yaml(ROOT / "workflow/config.yaml"), "fdtd": True}, ROOT)
    assert _jobs(new) == {
        "all": 1,
        "modal_table": len(plan.gratings),
        "thin_film_table": 1,
        "fdtd_nodes": len(plan.fdtd_designs),
        "fdtd_part": sum(map(plan.fdtd_parts, plan.fdtd_designs)),
        "fdtd_table": len(plan.fdtd_designs),
        "scene_plan": len(plan.scenes),
        "floquet": len(plan.config.floquet),
        "floquet_fdtd": len(plan.fdtd_scenes),
        "rigid": len(plan.config.rigid),
        "flight": len(plan.config.flight),
        "pressure_figure": len(plan.gratings),
        "fdtd_figure": 1,
        "multipliers_figure": 1,
        "flights_figure": 1,
        "summary": 1,
        "checks": 1,
        "snapshots_figure": len(plan.config.flight),
        "maps": len(plan.config.maps),
        "maps_figure": len(plan.config.maps),
        "contents": 1,
    }


def test_machine_code_comes_first_where_that_is_asked_for(new, monkeypatch):
    plain = _jobs(new)
    monkeypatch.setenv("BEAMRIDER_COMPILE_FIRST", "yes")
    assert _jobs(new) == plain | {"machine_code": 1}


def test_a_second_run_does_nothing_and_new_dates_change_nothing(done):
    assert _jobs(done) == {}
    for path in done.glob("[odw]*/**/*"):
        os.utime(path)
    assert _jobs(done) == {}


LAST = {"summary", "all"}
MAPS = {"pressure_figure", "multipliers_figure"}
LOADS = {"maps", "maps_figure"}
FLIGHTS = {"flights_figure", "snapshots_figure"}


@pytest.mark.parametrize(
    ("name", "rules"),
    [
        ("optics/thin_film/stage.py", {"thin_film_table", *LAST}),
        ("optics/fdtd/stage.py", {"fdtd_part", "fdtd_table", "floquet_fdtd", "fdtd_figure", "checks", *MAPS, *LAST}),
        ("dynamics/membrane/flight.py", {"flight", *FLIGHTS, *LAST}),
        ("workflow/figures/multipliers.py", {"multipliers_figure", "all"}),
        ("workflow/designs/wide_gap_te.yaml", {"modal_table", "floquet", *MAPS, *LAST}),
    ],
)
def test_an_edit_runs_the_stages_that_import_the_file_and_what_follows(done, edit, name, rules):
    edit(name)
    assert set(_jobs(done)) == rules


def test_fdtd_is_not_run_again_where_an_edit_leaves_its_directions_as_they_were(done, edit):
    edit("optics/modal/stage.py")
    expected = {"modal_table", "floquet", "rigid", "flight", "fdtd_figure", "checks", *MAPS, *LOADS, *FLIGHTS, *LAST}
    before = _jobs(done)
    assert set(before) >= {*expected, "fdtd_nodes"}
    assert "thin_film_table" not in before
    result = _snakemake(done, "--until", "fdtd_nodes", "--config", "fdtd=true")
    assert result.returncode == 0, result.stderr
    assert set(_jobs(done)) == expected


def test_a_scene_depends_on_the_tables_of_its_designs_alone(done, edit):
    plan = read_plan({**load_yaml(done / "workflow/config.yaml"), "fdtd": True}, done)
    edit("workflow/designs/wide_gap_te.yaml")
    jobs = _jobs(done)
    assert jobs["modal_table"] == 1
    assert jobs["floquet"] == sum("wide_gap_te" in plan.scenes[name].sail.designs for name in plan.config.floquet)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tables: modal", "tables: model", "error: workflow/config.yaml: tables = \"model\": must be 'modal'"),
        ("rigid: [", "rigid: [fig7, ", "error: workflow/scenes/fig7.yaml: no such file"),
        ("tables: modal", "tables: [", "error: workflow/config.yaml, line "),
        (None, "# nothing\n", "error: workflow/config.yaml: must map keys (designs, tables, "),
        (None, "- tables: modal\n", "error: workflow/config.yaml: must map keys (designs, tables, "),
    ],
)
def test_a_wrong_configuration_ends_snakemake_with_one_line(tmp_path, old, new, message):
    config = _copy(tmp_path) / "workflow/config.yaml"
    config.write_text(config.read_text().replace(old, new) if old else new)
    result = _snakemake(tmp_path, "--dry-run")
    assert result.returncode == 2
    (line,) = (result.stdout + result.stderr).splitlines()
    assert line.startswith(message)


def test_without_fdtd_the_workflow_says_so(new):
    result = _snakemake(new, "--dry-run", "--config", "fdtd=false")
    assert result.returncode == 0
    text = result.stdout + result.stderr
    assert "FDTD left out, everything else runs: fdtd: false" in text
    assert "optics.fdtd" not in text


def test_a_scene_that_the_configuration_does_not_name_can_be_made(tmp_path):
    scenes = _copy(tmp_path) / "workflow/scenes"
    fig6 = (scenes / "fig6.yaml").read_text(encoding="utf-8")
    (scenes / "own.yaml").write_text(fig6.replace("name: fig6", "name: own"), encoding="utf-8")
    assert _jobs(tmp_path, "--", "results/scenes/own/rigid.h5") == {"modal_table": 2, "rigid": 1}
    result = _snakemake(tmp_path, "--dry-run", "--config", "fdtd=false", "--", "results/scenes/none/rigid.h5")
    assert result.returncode == 2
    assert result.stderr.splitlines()[-1] == "error: workflow/scenes/none.yaml: no such file"
    assert not re.search("Traceback|Error|Exception", result.stdout + result.stderr)


def test_no_rule_makes_files_of_another_folder(new):
    for name in ("..", ".hidden", "-rf"):
        result = _snakemake(new, "--dry-run", "--config", "fdtd=false", "--", f"results/tables/{name}/modal.h5")
        assert "MissingRuleException" in result.stdout + result.stderr
