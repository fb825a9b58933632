"""Files say whether they are whole: any change of a bit, any cut or addition is refused before they are opened."""

import json
import struct
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from beamrider.io.checksum import LENGTH, append_checksum, fault, with_checksum
from beamrider.io.files import InputError, load_yaml, read_json, read_lines, write_json, write_lines
from beamrider.io.hdf5 import new_hdf5, read_hdf5
from beamrider.io.parquet import read_parquet, write_parquet
from optics.cells.schema import read_cell
from optics.fdtd.grid import FdtdSettings
from optics.fdtd.parts import Rows, read_rows, write_rows

TE = read_cell(Path(__file__).parents[3] / "workflow/designs/mark1e_te.yaml")


def written(path: Path) -> Path:
    """A small file of the kind that its name says."""
    if path.suffix == ".h5":
        with new_hdf5(path) as file:
            file["x"] = np.arange(10.0)
    elif path.suffix == ".parquet":
        write_parquet(path, pd.DataFrame({"a": np.arange(10.0), "b": ["x"] * 10}).to_parquet(index=False))
    elif path.suffix == ".json":
        write_json(path, {"x": [1.5, 2.0]})
    elif path.suffix == ".jsonl":
        write_lines(path, [{"x": 1.5}, {"x": 2.0}])
    else:
        path.write_bytes(with_checksum(b"x: 1.5\n", 0, b"# "))
    return path


READ = {
    ".h5": lambda path: read_hdf5(path)["x"][()].tolist(),
    ".parquet": lambda path: read_parquet(path)["a"].tolist(),
    ".json": read_json,
    ".jsonl": read_lines,
    ".yaml": load_yaml,
}
RIGHT = {
    ".h5": list(range(10)),
    ".parquet": list(range(10)),
    ".json": {"x": [1.5, 2.0]},
    ".jsonl": ['{"x": 1.5}', '{"x": 2.0}'],
    ".yaml": {"x": 1.5},
}
OF_USERS = (".jsonl", ".yaml")


@pytest.mark.parametrize("kind", list(READ))
def test_every_flipped_bit_cut_and_addition_is_refused(tmp_path: Path, kind: str):
    path = written(tmp_path / f"a{kind}")
    assert READ[kind](path) == RIGHT[kind]
    content = path.read_bytes()
    at = content.rfind(b"beamrider sha256 ")
    draw = np.random.default_rng(1)
    for place in [*draw.integers(0, len(content), 60), at + LENGTH - 1, len(content) - 1]:
        if kind in OF_USERS and at <= place < at + 17:
            continue  # a file of the user's own, which is read as it is
        path.write_bytes(content[:place] + bytes([content[place] ^ (1 << draw.integers(8))]) + content[place + 1 :])
        with pytest.raises(InputError, match=r"checksum does not fit|not a file that this version"):
            READ[kind](path)
    for changed in (content[: at + 20], content[:-1], content + b"\n", content[1:]):
        path.write_bytes(changed)
        assert fault(path, kind not in OF_USERS)
    path.write_bytes(content[:at])
    if kind not in OF_USERS:
        with pytest.raises(InputError, match=r"a\.\w+: not whole: cut off, .*; delete it, and") as error:
            READ[kind](path)
        assert "\n" not in str(error.value)


def test_a_file_of_a_user_needs_no_checksum(tmp_path: Path):
    path = tmp_path / "a.yaml"
    path.write_text("x: 1.5\n")
    assert load_yaml(path) == {"x": 1.5}
    path = tmp_path / "a.jsonl"
    path.write_text('{"x": 1.5}\n')
    assert read_lines(path) == ['{"x": 1.5}']


def test_other_programs_read_the_files(tmp_path: Path):
    with h5py.File(written(tmp_path / "a.h5")) as file:
        assert file["x"][3] == 3.0
    assert pd.read_parquet(written(tmp_path / "a.parquet"))["b"].tolist() == ["x"] * 10
    assert json.loads(written(tmp_path / "a.json").read_text())["x"] == [1.5, 2.0]
    assert [json.loads(line) for line in written(tmp_path / "a.jsonl").read_text().splitlines()][2] == {"x": 2.0}


def test_a_checksum_that_is_appended_is_that_of_the_whole(tmp_path: Path):
    path = tmp_path / "a"
    for content in (b"", b"abc", bytes(3_000_000)):
        path.write_bytes(content)
        append_checksum(path)
        assert path.read_bytes() == with_checksum(content, after=b"")
        assert fault(path) == ""


def test_one_doubled_number_in_a_part_of_fdtd_is_refused(tmp_path: Path):
    path, settings = tmp_path / "part.h5", FdtdSettings()
    rows = np.random.default_rng(0).uniform(0.1, 0.9, (20, 14))
    write_rows(path, TE, settings, Rows(rows))
    assert np.array_equal(read_rows(path, TE, settings).values, rows)
    one = struct.pack("<d", rows[7, 2])
    content = path.read_bytes()
    assert content.count(one) == 1
    path.write_bytes(content.replace(one, struct.pack("<d", 2.0 * rows[7, 2])))
    with h5py.File(path) as file:
        assert file["q_g"][7] == 2.0 * rows[7, 2]  # HDF5 sees nothing wrong
    with pytest.raises(InputError, match=r"part\.h5: not whole: damaged"):
        read_rows(path, TE, settings)


def test_the_command_names_the_files_that_are_not_whole(tmp_path: Path):
    good, bad = (written(tmp_path / name) for name in ("good.h5", "bad.json"))
    bad.write_text(bad.read_text().replace("1.5", "2.5"))
    own = tmp_path / "own.yaml"
    own.write_text("name: own\n")  # a user's: nothing to be deleted
    done = subprocess.run(
        [sys.executable, "-m", "beamrider.check", good, bad, tmp_path / "none.h5", own],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert [line.split(": ")[1] for line in done.stderr.splitlines()] == [str(bad), str(tmp_path / "none.h5")]
