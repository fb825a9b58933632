"""Every stage ends on wrong input with exit code 2, one line that names the file, and no file left behind."""

import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from beamrider.io.files import run_stage
from tests.processes import main_of
from tests.synthetic import smooth_tables

ROOT = Path(__file__).parents[2]
CELL = (ROOT / "workflow/designs/mark1e_te.yaml").read_text(encoding="utf-8")
SCENE = (ROOT / "workflow/scenes/fig6.yaml").read_text(encoding="utf-8")
OPTICS = ["optics.modal", "optics.nodes", "optics.thin_film", "optics.fdtd"]
DYNAMICS = ["dynamics.scene", "dynamics.mesh", "dynamics.floquet", "dynamics.rigid", "dynamics.membrane"]
FLYING = ["dynamics.floquet", "dynamics.rigid", "dynamics.membrane"]


@pytest.fixture
def refused(monkeypatch, capsys, tmp_path):
    """A function that runs a stage with arguments and returns the one line of its error."""

    def run(module: str, *arguments: str) -> str:
        before = set(tmp_path.rglob("*"))
        monkeypatch.setattr(sys, "argv", [module, *arguments, "--out", str(tmp_path / "out")])
        with pytest.raises(SystemExit) as caught:
            run_stage(main_of(module))
        assert caught.value.code == 2
        assert set(tmp_path.rglob("*")) == before
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("error: ")
        return line.removeprefix("error: ")

    return run


@pytest.mark.parametrize("module", OPTICS)
@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("period_nm: 1600", "period_nm: -1600", "period_nm = -1600"),
        ("period_nm: 1600", "period_nm: wide", 'period_nm = "wide"'),
        ("period_nm: 1600", "periode_nm: 1600", "unknown key 'periode_nm'; did you mean 'period_nm'?"),
        ("[790, 200]", "[500, 200]", "ridges_nm[1] = [500, 200] overlaps"),
    ],
)
def test_a_wrong_cell(refused, tmp_path, module, old, new, field):
    cell = tmp_path / "cell.yaml"
    cell.write_text(CELL.replace(old, new), encoding="utf-8")
    assert refused(module, "--cell", str(cell)).startswith(f"{cell}: {field}")


@pytest.mark.parametrize("module", OPTICS)
def test_a_wavelength_of_nothing(refused, tmp_path, module):
    cell = tmp_path / "cell.yaml"
    cell.write_text(CELL, encoding="utf-8")
    assert refused(module, "--cell", str(cell), "--wavelength-nm", "0").startswith(f"{cell}: wavelength_nm = 0")


@pytest.mark.parametrize("module", OPTICS + DYNAMICS)
def test_a_missing_file(refused, tmp_path, module):
    path = tmp_path / "none.yaml"
    assert refused(module, "--cell" if module in OPTICS else "--scene", str(path)) == f"{path}: no such file"


@pytest.mark.parametrize("module", DYNAMICS)
@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("rings: 30", "rings: -3", "sail.rings = -3"),
        ("radius_m: 0.5", "radius_m: half", 'sail.radius_m = "half"'),
        ("release:", "relaese:", "unknown key 'relaese'; did you mean 'release'?"),
        ("name: fig6", "name: fig7", "name = 'fig7'"),
    ],
)
def test_a_wrong_scene(refused, tmp_path, module, old, new, field):
    scene = tmp_path / "fig6.yaml"
    scene.write_text(SCENE.replace(old, new), encoding="utf-8")
    assert refused(module, "--scene", str(scene)).startswith(f"{scene}: {field}")


@pytest.mark.parametrize("module", FLYING)
def test_missing_tables(refused, tmp_path, module):
    scene = str(ROOT / "workflow/scenes/fig6.yaml")
    assert "mark1e_t" in refused(module, "--scene", scene)
    assert refused(module, "--scene", scene, "--tables", "none.h5").startswith("none.h5: no such pressure table")
    foreign = tmp_path / "foreign.h5"
    foreign.write_text("not HDF5")
    line = refused(module, "--scene", scene, "--tables", str(foreign))
    assert line.startswith(f"{foreign}: not whole: cut off, or not a file")


@pytest.mark.parametrize("content", ["", "\x89PNG\r\n\x1a\n", "name: mark1e_te\n", "a folder", "a flight"])
def test_tables_that_are_none(refused, tmp_path, content):
    path = tmp_path / "table.h5"
    if content == "a folder":
        path.mkdir()
    elif content == "a flight":
        with h5py.File(path, "w") as file:
            file["time"], file["position"] = [0.0, 1.0], [[0.0] * 3] * 2
    else:
        path.write_text(content, encoding="latin-1")
    line = refused("dynamics.rigid", "--scene", str(ROOT / "workflow/scenes/fig6.yaml"), "--tables", str(path))
    assert line.startswith(f"{path}: cannot be read (Is a" if content == "a folder" else f"{path}: not whole: cut off")
    assert len(line) < 300


def test_the_designs_that_lack_a_table_are_named_with_those_that_have_one(refused, tmp_path):
    smooth_tables()["mark1e_te"].write(tmp_path / "te.h5")
    scene = str(ROOT / "workflow/scenes/fig6.yaml")
    line = refused("dynamics.rigid", "--scene", scene, "--tables", str(tmp_path / "te.h5"))
    given = f"(given: 'mark1e_te' ({tmp_path}/te.h5)); add its file to --tables"
    assert line == f"fig6.yaml: sail.sectors: no pressure table of design 'mark1e_tm' {given}"
    line = refused("dynamics.rigid", "--scene", scene)
    assert "of design 'mark1e_tm', 'mark1e_te' (given: none)" in line


@pytest.mark.parametrize("module", ["dynamics.rigid", "dynamics.membrane"])
def test_a_release_outside_the_tables(refused, tmp_path, module):
    scene = tmp_path / "fig6.yaml"
    scene.write_text(SCENE.replace("pitch_deg: 2,", "pitch_deg: 30,"), encoding="utf-8")
    for name, table in smooth_tables().items():
        table.write(tmp_path / f"{name}.h5")
    tables = [str(tmp_path / f"mark1e_{polarisation}.h5") for polarisation in ("te", "tm")]
    line = refused(module, "--scene", str(scene), "--tables", *tables)
    assert line.startswith("fig6.yaml: release.pitch_deg = 30, roll_deg = ")


@pytest.mark.parametrize("module", DYNAMICS)
@pytest.mark.parametrize("place", ["", "folder", "file/flight"])
def test_motion_refuses_an_unusable_output_before_it_reads_or_computes(monkeypatch, capsys, tmp_path, module, place):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    before = set(tmp_path.rglob("*"))
    out = str(tmp_path / place) if place else ""
    monkeypatch.setattr(sys, "argv", [module, "--scene", "none.yaml", "--out", out])
    with pytest.raises(SystemExit) as caught:
        run_stage(main_of(module))
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: --out = ")
    assert set(tmp_path.rglob("*")) == before


def test_a_design_is_a_name_and_no_path(refused, tmp_path):
    scene = tmp_path / "fig6.yaml"
    scene.write_text(SCENE.replace("design: mark1e_te", "design: ../../x"), encoding="utf-8")
    assert 'design = "../../x": must be made of letters, digits' in refused("dynamics.scene", "--scene", str(scene))


def test_a_stage_run_as_a_program_ends_the_same_way(tmp_path):
    command = [sys.executable, "-m", "optics.thin_film", "--cell", "none.yaml", "--out", str(tmp_path / "film.h5")]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (2, "", "error: none.yaml: no such file\n")
    assert not list(tmp_path.iterdir())
