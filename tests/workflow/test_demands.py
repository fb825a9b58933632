"""What jobs ask a cluster for: by mesh, table and cell, more at every attempt, in blocks of minutes."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from dynamics.scene.schema import read_scene
from optics.cells.schema import read_metagrating
from optics.fdtd.grid import FdtdSettings, memory
from workflow import demands
from workflow.configuration import read_config, read_plan

ROOT = Path(__file__).parents[2]
PLAN = read_plan(read_config([ROOT / "workflow/config.yaml"]), ROOT)
MINUTES = PLAN.config.block_minutes
NODES, CORES = 16, 2  # nodes like the one that times were measured on


def _scene(folder: Path, rings: int) -> str:
    data = yaml.safe_load((ROOT / "workflow/scenes/fig6.yaml").read_text())
    data["sail"]["rings"] = rings
    path = folder / "fig6.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


def test_memory_follows_mesh_table_and_cell(tmp_path: Path):
    table = tmp_path / "table.h5"
    table.write_bytes(b"0" * 10**6)
    coarse, fine, finer = (demands.flight_mb({"scene": _scene(tmp_path, n), "tables": []}) for n in (30, 300, 600))
    assert (finer - coarse) / (fine - coarse) == pytest.approx(4, rel=0.02)
    with_table = demands.flight_mb({"scene": _scene(tmp_path, 30), "tables": [str(table)]})
    assert with_table - coarse == pytest.approx((1 + demands.MARGIN) * demands.UNPACKED)
    design = ROOT / "workflow/designs/mark1e_te.yaml"
    wide = read_metagrating(design).model_copy(update={"period_nm": 8000.0})
    grid = [memory(cell, FdtdSettings()) for cell in (read_metagrating(design), wide)]
    assert grid[1] > 3 * grid[0]
    assert demands.fdtd_mb({"cell": read_metagrating(design)}) == demands.fdtd_mb({"cell": str(design)}) > grid[0] / 1e6


class Files(dict):
    """Input files of a job, by name."""


def _rule(command: str, **resources: int) -> SimpleNamespace:
    values = {name: SimpleNamespace(value=value, is_evaluable=lambda: False) for name, value in resources.items()}
    return SimpleNamespace(shellcmd=command, resources=values, name="a")


def test_every_attempt_asks_for_as_much_again(tmp_path: Path):
    rule = _rule("python -m dynamics.membrane --scene {input.scene}", mem_mb=2000, runtime=600)
    runtime, asked = (demands.request(rule, name, {}) for name in ("runtime", "mem_mb"))
    assert [runtime(None, Files(), attempt) for attempt in (1, 2, 3)] == [600, 1200, 1800]
    assert asked(None, Files(), 1) == 2000  # as stated, where the files are not there yet
    files = Files(scene=_scene(tmp_path, 30), tables=[])
    assert asked(None, files, 3) == 3 * asked(None, files, 1) != 6000
    read = demands.request(rule, "mem_mb", {files["scene"]: read_scene(files["scene"])})
    fitting = asked(None, files, 1)
    Path(files["scene"]).unlink()
    assert (read(None, files, 1), asked(None, files, 1)) == (fitting, 2000)


def test_those_that_fly_wait_for_machine_code_and_no_others():
    added: dict[str, list[str]] = {}
    rules = [_rule(f"python -m {name}", mem_mb=1) for name in ("dynamics.rigid", "dynamics.scene", "optics.modal")]
    for rule in rules:
        rule.set_input = added.setdefault(rule.shellcmd, []).append
    demands.attach(rules, "code.txt", {})
    assert {name.split()[-1]: first for name, first in added.items()} == {
        "dynamics.rigid": ["code.txt"],
        "dynamics.scene": [],
        "optics.modal": [],
    }


def _jobs(seconds: float) -> list[float]:
    count = demands.blocks(seconds, MINUTES)
    return [seconds / count] * count


def test_work_is_cut_into_blocks_of_minutes():
    for seconds in (1.0, 400.0, 1e4, 1e6):
        jobs = _jobs(seconds)
        assert len(jobs) == 1 or all(0.6 * MINUTES < job / 60 < 1.5 * MINUTES for job in jobs)


def test_a_cluster_spends_less_than_a_twentieth_of_the_work_beside_it():
    """10,000 designs of two cells, 1,000 basin flights with either incidence, FDTD of two cells, on 16 nodes."""
    fdtd = [demands.fdtd_seconds(PLAN.cells[design], PLAN.config.fdtd_tolerance) for design in PLAN.config.fdtd_designs]
    work = [demands.cells_seconds(20_000, 15), *2 * [demands.basin_seconds(PLAN.scene("fig6"))], *fdtd]
    jobs = [job for seconds in work for job in _jobs(seconds)]
    assert max(demands.overhead(jobs, NODES * CORES)) < 0.05


def test_many_jobs_are_held_up_by_submission_for_their_first_minutes_alone():
    """A hundred times the designs: one submission a second fills the cores for as long as their first jobs take."""
    assert max(demands.overhead(_jobs(100 * demands.cells_seconds(20_000, 15)), NODES * CORES)) < 0.05
    assert min(demands.overhead([3.0] * 20_000, NODES * CORES)) > 1.0  # of seconds, they would wait for one another
