"""Every benchmark runs to its end on a tiny input, and writes what it says that it writes."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from optics.cells.schema import read_cell
from optics.table.pressure_table import PressureTable
from optics.thin_film.stage import make_table
from tests.processes import run
from tests.synthetic import smooth_tables
from workflow.benchmarks.rows import seconds
from workflow.configuration import meep_installed

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "workflow/scenes"
ONE = {"CELLS": ("mark1e_te",)}
SHORT = {
    "DURATION": 2e-4,
    "SCHEMES": ("verlet",),
    "ELASTICITY": (),
    "SIZES": (2e-5,),
    "INTERVALS": (4,),
    "STEPS": (1.0,),
}
needs_meep = pytest.mark.skipif(not meep_installed(), reason="Meep is not installed")
Given = Callable[[Path, list[str]], list[str]]


def flown(scene: str, *files: str) -> Given:
    """Arguments of what flies a scene on tables and writes files."""

    def given(folder: Path, tables: list[str]) -> list[str]:
        written = [word for file in files for word in (f"--{file}", str(folder / file))]
        return ["--scene", str(SCENES / f"{scene}.yaml"), "--tables", *tables, *written]

    return given


def sets(folder: Path, tables: list[str]) -> list[str]:
    """Arguments of what flies on sets of tables."""
    return flown("fig6", "out", "markdown", "png")(folder, [f"smooth={','.join(tables)}"])


def written(folder: Path, tables: list[str]) -> list[str]:
    """Arguments of what writes rows alone."""
    return ["--out", str(folder / "out")]


def once(work: Callable[[], object], repeats: int) -> float:
    """CPU seconds of a piece of work, done once."""
    return seconds(work, 1)


#: Of each benchmark: its arguments, its constants made small, words that it prints.
BENCHMARKS: dict[str, tuple[Given, dict[str, Any], str]] = {
    "accuracy_modal": (
        written,
        {**ONE, "ORDERS": (3,), "TRUTH": 6, "TABLE_V": np.array([0.0, 0.1]), "ANGLES": np.array([0.0, 0.5])},
        "",
    ),
    "accuracy_tables": (written, {**ONE, "TOLERANCES": (0.1,), "RANGE": 0.05, "TRUTH": 9}, ""),
    "accuracy_rigid": (
        sets,
        {"TOLERANCES": (1e-4,), "QUADRATURES": (1e-2,), "SPACINGS": (0.04,), "BEST": 1e-5, "REPEATS": 1},
        "",
    ),
    "accuracy_flight": (sets, {**SHORT, "RINGS": 2, "FINEST": 3, "MESHES": (2,)}, ""),
    "accuracy_reflections": (
        lambda folder, _: flown("fig4_reflections", "out", "markdown")(folder, [str(folder / "si43.h5")]),
        {"RINGS": 3, "MESHES": (3,), "FINEST": 4, "SIDES": (1,), "MOST": 2, "POLARISATIONS": ("mean",)},
        "",
    ),
    "corotating": (
        lambda folder, tables: [*flown("fig6", "out")(folder, tables), "--rings", "2"],
        {"DURATION": 2e-4, "STEPS": (28e-6,), "REPEATS": 1},
        "",
    ),
    "error_estimate": (lambda *_: ["--cells", "1", "--metals", "1", "--tolerance", "0.1"], ONE, "dielectrics"),
    "flight_speed": (
        lambda folder, _: ["--out", str(folder / "out"), "--rings", "3", "--largest", "3"],
        {"LACKS": {"absorption": {"absorptance": 0.0}}, "PLACES": 1, "REPEATS": 2, "best": once},
        "one thread",
    ),
    "honesty": (
        lambda *_: ["--cells", "8", "--only", "film", "--tolerance", "0.1"],
        {"ROWS": 2, "LINES": 2},
        "cells: ",
    ),
    "modal_speed": (lambda *_: ["--directions", "2"], {**ONE, "ORDERS": (3,), "LARGE": 5, "TOLERANCE": 0.1}, "meent"),
    "table_error": (
        lambda *_: ["--cells", "mark1e_te"],
        {"RANGE": 0.05, "TOLERANCE": 0.1, "TRUTH": 9, "ROWS": 20, "LINES": 2},
        "interpolation",
    ),
    "table_lookup": (lambda folder, tables: tables[:1], {"DIRECTIONS": 20, "REPEATS": 1}, "one by one"),
    "accuracy_fdtd": (
        written,
        {**ONE, "RESOLUTIONS": (7.45, 10.65), "TRUTH": 9, "directions": lambda cell: [("easy", 0.0, 0.0)]},
        "",
    ),
    "fdtd_plain": (
        lambda folder, tables: ["--modal", tables[0], "--fdtd", str(folder / "fdtd.h5"), "--count", "1"],
        {"RESOLUTIONS": (7.45,), "our_way": lambda *_: (1.0, 9)},
        "ratio",
    ),
}
MEEP = ("accuracy_fdtd", "fdtd_plain")
#: Every run of the tests tries those that take seconds; the others compile or solve for minutes.
QUICK = ("accuracy_modal", "accuracy_tables", "error_estimate", "table_lookup")
MARKS = {name: [pytest.mark.slow] for name in BENCHMARKS if name not in QUICK}
for name in MEEP:
    MARKS[name] += [pytest.mark.meep, needs_meep]


@pytest.fixture(scope="module")
def tables(tmp_path_factory) -> tuple[Path, list[str]]:
    """Folder and files of tables of the paper's cells, of a film, and of one that stands for FDTD's."""
    folder = tmp_path_factory.mktemp("benchmarks")
    for name, table in smooth_tables().items():
        table.write(folder / f"{name}.h5")
    make_table(read_cell(ROOT / "workflow/designs/si43.yaml"), 0.9, 1e-3).write(folder / "si43.h5")
    u, v = np.linspace(-0.05, 0.05, 3), np.linspace(0.0, 0.05, 2)
    q = np.full((3, 3, 2), 0.3)
    attrs = {"name": "mark1e_te", "wavelength_m": 1064e-9}
    PressureTable(u, v, q, q[0], q[0], mirror_v=True, attrs=attrs).write(folder / "fdtd.h5")
    return folder, [str(folder / f"{name}.h5") for name in smooth_tables()]


def test_every_benchmark_is_tried():
    programs = {path.stem for path in (ROOT / "workflow/benchmarks").glob("*.py") if "def main" in path.read_text()}
    assert set(BENCHMARKS) == programs


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, [])) for name in BENCHMARKS])
def test_a_benchmark_ends_and_writes(tables, tmp_path, name):
    given, constants, words = BENCHMARKS[name]
    folder, files = tables
    module = importlib.import_module(f"workflow.benchmarks.{name}")
    assert constants.keys() <= vars(module).keys()
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)

    code, said = run(module.main, given(tmp_path, files), lambda: vars(module).update(constants))
    assert (code, words in said) == (0, True), said
    for path in tmp_path.iterdir():
        assert path.stat().st_size > 0
