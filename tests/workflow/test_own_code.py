"""Jobs and programs compute with the code of the folder they stand in, whatever copy Python was installed with."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.workflow.test_dag import _copy

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def second(tmp_path_factory) -> Path:
    """A second checkout, whose modules tell where they are."""
    folder = _copy(tmp_path_factory.mktemp("second"))
    with open(folder / "beamrider/io/files.py", "a", encoding="utf-8") as file:
        file.write("\nprint('FILES OF', Path(__file__).resolve().parents[2])\n")
    return folder


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}  # as an environment that was installed from another folder
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_rules_of_the_workflow_and_of_stages_run_the_code_of_their_folder(second):
    targets = {"results/published/fig6/fig6.yaml": "published/fig6/scene", "results/merit.csv": "merit"}
    done = _run([sys.executable, "-m", "snakemake", "--cores", "1", "--config", "fdtd=false", "--", *targets], second)
    assert done.returncode == 0, done.stderr
    for log in targets.values():
        said = (second / f"results/logs/{log}.log").read_text(encoding="utf-8")
        assert [line for line in said.splitlines() if line.startswith("FILES OF")] == [f"FILES OF {second.resolve()}"]


def test_a_program_run_in_its_folder_computes_with_the_code_there(second):
    done = _run([sys.executable, "-m", "workflow.checks", "--help"], second)
    assert f"FILES OF {second.resolve()}" in done.stdout


def test_a_file_that_would_compute_with_other_code_is_refused(second):
    done = _run([sys.executable, "workflow/checks.py", "--out", "checks.json"], second)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.endswith(f"would compute with the modules of {ROOT}; use python -m workflow.checks")
    assert not (second / "checks.json").exists()
