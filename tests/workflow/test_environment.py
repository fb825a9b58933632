"""Pins, requirements and the conda environment say the same, for the Python of either Debian."""

import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement

from beamrider.io.files import load_yaml

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PINS = [
    Requirement(line)
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]


def _name(requirement: Requirement) -> str:
    return re.sub(r"[-_.]+", "-", requirement.name).lower()


def _of(requirements: list[Requirement], python: str) -> list[Requirement]:
    here = {**default_environment(), "python_version": python}
    return [one for one in requirements if one.marker is None or one.marker.evaluate(here)]


@pytest.mark.parametrize("python", ["3.11", "3.13"])
def test_every_requirement_has_one_pin_that_meets_it(python):
    extras = PROJECT["optional-dependencies"]
    texts = [*PROJECT["dependencies"], *extras["dev"], *extras["slurm"]]
    pins = {}
    for pin in _of(PINS, python):
        assert _name(pin) not in pins
        ((kind, pins[_name(pin)]),) = ((one.operator, one.version) for one in pin.specifier)
        assert kind == "=="
    for requirement in _of([Requirement(text) for text in texts], python):
        assert requirement.specifier.contains(pins[_name(requirement)])
    assert pins["numpy"].startswith({"3.11": "1.", "3.13": "2."}[python])  # as the Meep of that Debian was built


def test_conda_has_the_versions_of_debian_12():
    lines = load_yaml(ROOT / "environment.yml")["dependencies"]
    python = next(line.split("=")[1] for line in lines if str(line).startswith("python="))
    (numpy,) = (pin for pin in _of(PINS, python) if pin.name == "numpy")
    assert f"numpy={str(numpy.specifier).removeprefix('==')}" in lines
    assert {"pip": ["-c constraints.txt", "-e .[dev]"]} in lines


def test_setup_says_what_is_missing_without_python(tmp_path):
    (tmp_path / "Makefile").write_bytes((ROOT / "Makefile").read_bytes())
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).write_text("", encoding="utf-8")
    made = ["make", "setup", f"PYTHON={tmp_path}/python3", f"MEEP={tmp_path}/meep", "AS_ROOT="]
    done = subprocess.run(made, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[:2] == [
        "Neither root nor sudo: Debian's packages python3-venv and python3-meep are not installed.",
        f"error: {tmp_path}/python3: must be Python 3.11 or later with venv; on Debian 12 or 13, as root: "
        "apt-get install python3-venv",
    ]
