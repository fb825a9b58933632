"""Every stage of motion says in one line what it made: file, how it ended, size, wall and CPU time."""

import re
import sys
from pathlib import Path

import pytest

from beamrider.io.files import Stopwatch, amount, finish
from beamrider.io.parquet import write_parquet
from tests.families import many_cells, many_members
from tests.membranes import small, write_inputs
from tests.processes import main_of

SCENE = small(rings=3, rigid={"duration_s": 1e-3}, flight={"duration_s": 1e-5, "spin_up_s": 1e-5})
ENDS = {
    "scene": r"\d+ of \d+ effects on",
    "mesh": "37 nodes, 54 triangles",
    "floquet": r"marginally_stable, largest \|λ\| = ",
    "maps": r"13122 places of force, \d+ outside a table",
    "rigid": r"finished at 0.001 s, \d+ steps",
    "membrane": r"finished at .* s, \d+ steps",
    "basin": r"\d+ of 4 flights bounded",
}


@pytest.mark.parametrize("module", ENDS)
def test_every_stage_says_what_it_made(module, tmp_path, monkeypatch, capsys):
    arguments = write_inputs(tmp_path, SCENE, "made")
    if module in ("scene", "mesh"):
        arguments = [*arguments[:2], *arguments[-2:]]
    if module == "basin":
        (tmp_path / "grid.yaml").write_text("n_offsets: 2\nn_tilts: 2\nduration_s: 0.01\n")
        arguments += ["--grid", str(tmp_path / "grid.yaml")]
    monkeypatch.setattr(sys, "argv", [module, *arguments])
    main_of(f"dynamics.{module}")()
    (line,) = capsys.readouterr().out.splitlines()
    path = re.escape(str(tmp_path / "out/made"))
    made = rf"{path}: {ENDS[module]}.* \([\d.e+]+ k?M?B, [\d.e-]+ s, [\d.e-]+ s of CPU\)"
    assert re.fullmatch(made + r"(; tables err by at most .*)?", line)


def test_screening_says_how_many_members_are_stable(tmp_path, monkeypatch, capsys):
    arguments = write_inputs(tmp_path, SCENE, "made")
    write_parquet(tmp_path / "cells.parquet", many_cells(2).to_parquet())
    write_parquet(tmp_path / "members.parquet", many_members(2).to_parquet())
    more = ["--members", str(tmp_path / "members.parquet"), "--cells", str(tmp_path / "cells.parquet")]
    monkeypatch.setattr(sys, "argv", ["screening", *arguments[:2], *arguments[-2:], *more])
    main_of("dynamics.screening")()
    (line,) = capsys.readouterr().out.splitlines()
    assert re.match(rf"{re.escape(str(tmp_path / 'out/made'))}: \d \w+, .*\d impossible .*s of CPU\)", line)


def test_notes_follow_and_stay_on_the_line(tmp_path, capsys):
    path = Path(tmp_path / "a")
    path.write_bytes(bytes(12345))
    finish(path, Stopwatch(), "finished", ["neglected:\nspeed above 1e-3 c"])
    assert re.fullmatch(r".*/a: finished \(12.3 kB, .*\); neglected: speed above 1e-3 c\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0 B"),
        (999.4, "999 B"),
        (999.6, "1 kB"),
        (12345, "12.3 kB"),
        (1e15, "1 PB"),
        (1e21, "1e+03 EB"),
    ],
)
def test_amounts(value, text):
    assert amount(value, "B") == text
