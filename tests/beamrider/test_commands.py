"""The command `beamrider`: the programs that `python -m` runs, chosen by name, kind and ending; none taken in vain."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from beamrider.command import COMMANDS, SOLVERS, Refused, main, overview, stage_of, without
from beamrider.show import read_record
from tests.processes import main_of, run

ROOT = Path(__file__).parents[2]
GRATING, FILM = (str(ROOT / f"workflow/designs/{name}.yaml") for name in ("mark1e_te", "si43"))


@pytest.mark.parametrize(
    ("words", "program"),
    [
        (["table", "--cell", GRATING], "optics.modal"),
        (["table", f"--cell={FILM}"], "optics.thin_film"),
        (["table", "--cell", "none.yaml"], "optics.modal"),
        (["table", "--help"], "optics.modal"),
        (["table", "--cell", GRATING, "--solver", "fdtd"], "optics.fdtd"),
        (["table", "--solver=modal"], "optics.modal"),
        (["fly", "--out", "f.h5"], "dynamics.rigid"),
        (["fly", "--out=f.vtkhdf"], "dynamics.membrane"),
        (["fly", "--out", "f.vtkhdf", "--rigid"], "dynamics.rigid"),
        (["fly", "--flexible"], "dynamics.membrane"),
        (["fly", "--out", "f", "--flexible"], "dynamics.membrane"),
        (["fly"], "dynamics.rigid"),
        (["stability", "--rigid"], "dynamics.floquet"),
    ],
)
def test_names_kinds_and_endings_choose_the_program(words, program):
    found, rest = stage_of(words[0], words[1:])
    assert found == program
    chosen = ("fdtd", "--solver", "--solver=modal", "--rigid", "--flexible") if words[0] != "stability" else ()
    assert rest == [word for word in words[1:] if word not in chosen]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["flyy"], r"no command 'flyy'; did you mean 'fly'\?"),
        (["fly", "--out", "f.hdf"], "--out = f.hdf: must end"),
        (["fly", "--rigid", "--flexible"], "--rigid, --flexible: must be one"),
        (["table", "--solver", "meep"], "--solver = meep: must be one of modal, fdtd, thin_film"),
        (["table", "--solver"], "--solver: must have a value"),
        (["--out"], "no command '--out'"),
    ],
)
def test_what_names_no_program_is_refused(words, why, capsys, monkeypatch):
    with pytest.raises(Refused, match=why):
        stage_of(words[0], words[1:])
    monkeypatch.setattr("sys.argv", ["beamrider", *words])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: beamrider")


def test_options_are_taken_out_of_words():
    assert without("--a", ["b", "--a", "c", "d", "--a=e"]) == ("e", ["b", "d"])
    assert without("--a", ["--ab", "c"]) == (None, ["--ab", "c"])


def test_each_command_has_a_line_and_a_program():
    lines = overview().splitlines()
    for name, (program, about) in COMMANDS.items():
        assert f"  {name:10}  {about}" in lines
        assert len(f"  {name:10}  {about}") <= 100
        assert callable(main_of(program))
    for program in SOLVERS.values():
        assert callable(main_of(program))


def test_a_file_is_the_same_by_either_command(tmp_path):
    """Record of what made it and all numbers: the times alone differ."""
    given = ["--cell", FILM, "--u-max", "0.5"]
    one, other = tmp_path / "one.h5", tmp_path / "other.h5"
    assert run(main, ["table", *given, "--out", str(one)])[0] == 0
    assert run(main_of("optics.thin_film"), [*given, "--out", str(other)])[0] == 0
    record, own = read_record(one), read_record(other)
    assert record is not None
    assert record["program"] == "optics.thin_film"
    # Within a test the running program is pytest: the module of its `main` is named
    assert own is not None
    assert (record["arguments"], record["inputs"]) == (own["arguments"], own["inputs"])
    table = importlib.import_module("optics.table.pressure_table").PressureTable
    assert table.read(one).digest == table.read(other).digest


def test_errors_of_a_command_line_are_one_line_that_names_the_command_given():
    wants = "the following arguments are required: --scene, --out; --help lists what it takes"
    for words, name in ((["beamrider", "maps"], "beamrider maps"), (["dynamics.maps"], "python -m dynamics.maps")):
        ended = subprocess.run([sys.executable, "-m", *words], cwd=ROOT, capture_output=True, text=True)
        assert ended.returncode == 2
        assert ended.stderr.splitlines() == [f"error: {name}: {wants}"]


def test_help_and_version_take_no_stage():
    script = (
        "import sys; sys.argv = ['beamrider', '--version']; from beamrider.command import main; main()\n"
        "print(*{'numpy', 'numba', 'scipy', 'pydantic', 'optics', 'dynamics', 'argparse'} & set(sys.modules))"
    )
    ended = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    version, *loaded = ended.stdout.splitlines()
    assert version.startswith("beamrider ")
    assert loaded == [""]
