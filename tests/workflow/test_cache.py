"""What is cached is right, on a small real configuration: films, what a scene calls for, stability, a figure.

Every test asks Snakemake, in dry runs, what it would run after a change, and undoes the change; some run it.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import pytest
import yaml

from beamrider.io.files import load_yaml
from dynamics.scene.schema import read_scene
from optics.table.pressure_table import PressureTable
from workflow import shared

ROOT = Path(__file__).parents[2]
TABLE, OTHER = "results/tables/si43/thin_film.h5", "results/tables/thick/thin_film.h5"
UNNAMED = "results/tables/unnamed/thin_film.h5"
INDEX = "workflow/indices/silicon.csv"
STABLE, CALLED = "results/scenes/own/floquet.json", "results/scenes/own/plan.json"
TARGETS = (TABLE, OTHER, STABLE, CALLED, "results/figures/multipliers.png", "results/contents.sha256")
#: What hangs on the table of a film: `thick` flies nowhere.
FLOWN = {"floquet": 1, "multipliers_figure": 1}


def copy(folder: Path) -> Path:
    """A copy of the project with a configuration of films alone: two designs, a scene that flies on one of them."""
    for name in ("beamrider", "optics", "dynamics", "workflow"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("Snakefile", "constraints.txt"):
        shutil.copy(ROOT / name, folder)
    (folder / "profiles").symlink_to("workflow/profiles")
    scene = read_scene(ROOT / "workflow/scenes/fig6.yaml").model_dump(exclude_none=True, mode="json")
    for sector in scene["sail"]["sectors"]:
        sector["design"] = "si43"
    scene["name"] = "own"
    write(folder / "workflow/scenes/own.yaml", scene)
    film = load_yaml(ROOT / "workflow/designs/si43.yaml")
    (folder / INDEX).parent.mkdir()
    (folder / INDEX).write_text("wl,n\n1.0,3.6\n2.0,3.5\n", encoding="utf-8")
    for name in ("thick", "unnamed"):
        layer = {**film["layers"][0], "thickness_nm": 50, "index": {"file": INDEX}}
        write(folder / f"workflow/designs/{name}.yaml", film | {"name": name, "layers": [layer]})
    config = load_yaml(ROOT / "workflow/config.yaml") | {
        "designs": ["si43", "thick"],
        "fdtd": False,
        "fdtd_designs": [],
        "floquet": ["own"],
        "rigid": [],
        "maps": [],
        "flight": [],
        "basins": [],
    }
    write(folder / "workflow/config.yaml", config)
    return folder


def write(path: Path, data: object) -> None:
    """Write YAML."""
    path.write_text(yaml.safe_dump(data), encoding="utf-8")


def snakemake(folder: Path, *arguments: str, **variables: str) -> str:
    """What Snakemake says, plain but for one core."""
    environment = {**os.environ, "BEAMRIDER_CACHE": "", **variables}
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "--cores", "1", *arguments],
        cwd=folder,
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def jobs(folder: Path, *targets: str, **variables: str) -> dict[str, int]:
    """Jobs, by rule, that a run would start."""
    said = snakemake(folder, "--dry-run", "--", *(targets or TARGETS), **variables)
    table = re.search(r"^job +count\n[- ]+\n(.*?)^total", said, re.M | re.S)
    return {name: int(count) for name, count in map(str.split, table[1].splitlines())} if table else {}


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    """A folder where all was made."""
    folder = copy(tmp_path_factory.mktemp("done"))
    assert "Using workflow specific profile" in snakemake(folder, "--", *TARGETS)
    return folder


Change = Callable[[str, Callable[[bytes], bytes]], None]


@pytest.fixture
def change(done) -> Iterator[Change]:
    """A function that changes a file of `done` until the test ends."""
    before: dict[Path, tuple[bytes, os.stat_result]] = {}

    def apply(name: str, edit: Callable[[bytes], bytes]) -> None:
        path = done / name
        before.setdefault(path, (path.read_bytes(), path.stat()))
        path.write_bytes(edit(before[path][0]))

    yield apply
    for path, (content, about) in before.items():
        path.write_bytes(content)
        os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))


def test_a_second_run_starts_no_job_nor_do_touched_files(done):
    assert jobs(done) == {}
    for path in [*done.glob("[odw]*/**/*"), *done.glob("results/**/*")]:
        os.utime(path)
    assert jobs(done) == {}


def test_comments_and_docstrings_make_no_numbers_again(done, change):
    change("optics/thin_film/stage.py", lambda text: text.replace(b'"""', b'"""Reworded. ', 1) + b"\n# a comment\n")
    change("dynamics/rigid/equations.py", lambda text: b"# a comment\n" + text)
    change("workflow/designs/si43.yaml", lambda text: b"# a comment\n" + text)
    assert jobs(done) == {}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("dynamics/rigid/equations.py", {"floquet", "multipliers_figure"}),
        ("dynamics/scene/schema.py", {"scene_plan", "floquet", "multipliers_figure"}),
        ("optics/waves/plane_stack.py", {"thin_film_table", "scene_plan", *FLOWN}),
        ("dynamics/membrane/effects/tearing.py", {"scene_plan"}),  # of flexible flight, and of what it calls for
        ("workflow/figures/drawing.py", {"multipliers_figure"}),
    ],
)
def test_an_edited_kernel_runs_exactly_the_stages_that_import_it(done, change, name, expected):
    change(name, lambda text: text + b"\nEDITED = 1\n")
    assert set(jobs(done)) == expected


def test_beam_power_starts_no_optics(done, change):
    change("workflow/scenes/own.yaml", lambda text: text.replace(b"1000000000.0", b"1100000000.0"))
    assert jobs(done) == {"scene_plan": 1, **FLOWN}


def test_a_changed_cell_makes_its_table_and_what_follows(done, change):
    change("workflow/designs/si43.yaml", lambda text: text.replace(b"thickness_nm: 43", b"thickness_nm: 44"))
    assert jobs(done) == {"thin_film_table": 1, **FLOWN}


def test_a_cell_that_nothing_flies_on_makes_its_table_alone(done, change):
    change("workflow/designs/thick.yaml", lambda text: text.replace(b"thickness_nm: 50", b"thickness_nm: 51"))
    assert jobs(done) == {"thin_film_table": 1}


def test_a_file_that_a_cell_names_makes_its_table_anew(done, change):
    snakemake(done, "--", UNNAMED)  # of a cell that the configuration doesn't name
    assert jobs(done, UNNAMED) == {}
    change(INDEX, lambda text: text.replace(b"3.5", b"3.4"))
    assert jobs(done) == jobs(done, UNNAMED) == {"thin_film_table": 1}


@pytest.mark.parametrize("spoil", [None, lambda x: x[: len(x) // 2], lambda x: x[:99] + bytes([x[99] ^ 1]) + x[100:]])
def test_deleted_cut_and_altered_results_run_their_producers_alone(done, spoil):
    for name in (TABLE, STABLE):
        path = done / name
        path.rename(path.with_name("kept"))
        if spoil:
            path.write_bytes(spoil(path.with_name("kept").read_bytes()))
    found = jobs(done)
    for name in (TABLE, STABLE):
        (done / name).with_name("kept").replace(done / name)
    assert found == {"thin_film_table": 1, "floquet": 1}


def test_a_damaged_table_is_made_again_with_the_same_numbers(done):
    before = PressureTable.read(done / TABLE).digest
    (done / TABLE).write_bytes((done / TABLE).read_bytes()[:-500])
    assert f"{TABLE}: changed since it was made; it is made again" in snakemake(done, "--", *TARGETS)
    assert PressureTable.read(done / TABLE).digest == before
    assert jobs(done) == {}


def test_a_changed_constraint_runs_the_stages_that_use_the_library(done, change):
    change("constraints.txt", lambda text: re.sub(rb"^matplotlib==.*", b"matplotlib==0.1", text, flags=re.M))
    assert jobs(done) == {"multipliers_figure": 1}
    change("constraints.txt", lambda text: re.sub(rb"^meent==.*", b"meent==0.1", text, flags=re.M))
    assert jobs(done) == {}
    change("constraints.txt", lambda text: re.sub(rb"^scipy==.*", b"scipy==0.1", text, flags=re.M))
    assert {"thin_film_table", "floquet"} <= set(jobs(done))


def test_another_version_of_a_library_runs_the_stages_that_use_it(done, tmp_path):
    """Python finds an installed matplotlib 99 first; its modules are those of the old one."""
    about = tmp_path / "matplotlib-99.dist-info/METADATA"
    about.parent.mkdir()
    about.write_text("Metadata-Version: 2.1\nName: matplotlib\nVersion: 99\n", encoding="utf-8")
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    assert jobs(done, PYTHONPATH=path) == {"multipliers_figure": 1}


def test_a_scene_dropped_from_the_configuration_makes_the_report_anew(done, change):
    change("workflow/config.yaml", lambda text: text.replace(b"floquet:\n- own", b"floquet: []"))
    assert jobs(done, "results/contents.sha256") == {"contents": 1}


def test_results_tell_what_made_them(done):
    said = subprocess.run(
        [
            sys.executable,
            "-m",
            "beamrider.show",
            TABLE,
            STABLE,
            "results/figures/multipliers.png",
            "results/figures/multipliers.svg",
            "results/contents.sha256",
        ],
        cwd=done,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    programs = re.findall(r"^  program: (\S+)", said, re.M)
    assert programs == ["optics.thin_film", "dynamics.floquet", *["workflow.figures.multipliers"] * 2]
    assert said.count("(as here)") == 8
    assert re.search(r"^  input: si43.yaml sha256 [0-9a-f]{64}$", said, re.M)
    assert "  rule: contents" in said
    with h5py.File(done / TABLE) as file:
        record = json.loads(file.attrs["made_from"])
    assert record["inputs"].keys() == {"si43.yaml"}
    assert {"Python", "numpy", "numba"} <= set(record["libraries"])
    assert "matplotlib" not in record["libraries"]


def test_results_without_a_record_of_this_workflow_are_named_and_made_again(done, tmp_path):
    """As a folder of results that an older Beamrider, or another folder's, left."""
    folder = copy(tmp_path)
    shutil.copytree(done / "results/tables", folder / "results/tables")
    said = snakemake(folder, "--dry-run", "--", TABLE)
    assert f"{TABLE}: no record of how it was made; it is made again" in said
    assert "thin_film_table" in said


def test_tables_are_shared_between_folders(done, tmp_path):
    cache, first, second = tmp_path / "cache", *(copy(tmp_path / name) for name in ("first", "second"))
    cache.mkdir()
    snakemake(first, "--", TABLE, OTHER, BEAMRIDER_CACHE=str(cache))
    entries = [path.parent for path in cache.glob("*/*/sums.json")]
    assert len(entries) == 2
    (second / "workflow/designs/thick.yaml").write_text(
        (second / "workflow/designs/thick.yaml").read_text().replace("thickness_nm: 50", "thickness_nm: 60")
    )
    snakemake(second, "--", TABLE, OTHER, BEAMRIDER_CACHE=str(cache))
    assert (first / TABLE).read_bytes() == (second / TABLE).read_bytes()
    assert PressureTable.read(first / OTHER).digest != PressureTable.read(second / OTHER).digest
    assert len(list(cache.glob("*/*/sums.json"))) == 3
    assert jobs(second, TABLE, OTHER) == {}  # with no cache the keys are the same
    (second / TABLE).unlink()
    entry = next(path for path in entries if (path / "0").read_bytes() == (first / TABLE).read_bytes())
    (entry / "0").chmod(0o644)
    (entry / "0").write_bytes(b"damaged")
    snakemake(second, "--", TABLE, BEAMRIDER_CACHE=str(cache))
    assert PressureTable.read(second / TABLE).digest == PressureTable.read(first / TABLE).digest


def refuse(*_) -> None:
    raise PermissionError


def test_a_damaged_table_that_another_user_stored_gives_way_or_is_told(tmp_path, monkeypatch, capsys):
    """Users may rename each other's folders in a folder that all may write to, but not if it is sticky, as /tmp is."""
    cache, table = tmp_path / "cache", tmp_path / "table.h5"
    cache.mkdir()
    table.write_text("whole")
    assert shared.store(cache, "abc", [table]) is True
    (shared.entry(cache, "abc") / "0").chmod(0o644)
    (shared.entry(cache, "abc") / "0").write_text("damaged")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", refuse)
        assert shared.fetch(cache, "abc", [table]) is False
    said = capsys.readouterr().err
    assert said.endswith(f"made again every time, until {cache.owner()} deletes {shared.entry(cache, 'abc')}\n")
    assert shared.fetch(cache, "abc", [table]) is False
    assert capsys.readouterr().err.endswith("damaged; it is made again\n")
    assert shared.store(cache, "abc", [table]) is True
    table.unlink()
    assert shared.fetch(cache, "abc", [table]) is True
    assert table.read_text() == "whole"


def test_what_a_disk_spoilt_is_refused_once_and_then_made_again(done, change):
    """Bits that change behind a file's size and time: the stage that reads it refuses it, and the next run makes it."""
    before, about = (done / TABLE).read_bytes(), (done / TABLE).stat()
    (done / TABLE).write_bytes(before[:-500] + bytes(500))
    os.utime(done / TABLE, ns=(about.st_atime_ns, about.st_mtime_ns))
    change("dynamics/stability/floquet.py", lambda text: text + b"\nEDITED = 1\n")
    failed = subprocess.run(
        [sys.executable, "-m", "snakemake", "--cores", "1", "--", STABLE],
        cwd=done,
        capture_output=True,
        text=True,
        check=False,
    )
    assert failed.returncode == 1
    assert f"error: {TABLE}" in failed.stdout + failed.stderr
    assert jobs(done, STABLE) == {"thin_film_table": 1, "floquet": 1}
    snakemake(done, "--", STABLE)
    assert jobs(done, STABLE) == {}
