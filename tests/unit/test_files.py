"""Files appear whole or not at all; numbers in YAML are numbers."""

import json

import pytest

from optics.files import InputError, atomic, load_yaml, run_stage, write_json


def _names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_atomic_replaces_only_on_success(tmp_path):
    path = tmp_path / "out.txt"
    path.write_text("old")

    def half():
        with atomic(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        half()
    assert path.read_text() == "old"
    assert _names(tmp_path) == ["out.txt"]
    with atomic(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert _names(tmp_path) == ["out.txt"]


def test_json_refuses_nan_and_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="Out of range"):
        write_json(tmp_path / "a.json", {"x": float("nan")})
    assert _names(tmp_path) == []
    write_json(tmp_path / "a.json", {"x": 1.5})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": 1.5}


def test_yaml_numbers(tmp_path):
    (tmp_path / "a.yaml").write_text("a: 1e9\nb: 2.5e-6\nc: 1_000\nd: -3E4\ne: v1e9\n")
    assert load_yaml(tmp_path / "a.yaml") == {"a": 1e9, "b": 2.5e-6, "c": 1000, "d": -3e4, "e": "v1e9"}


def test_stage_turns_an_input_error_into_one_line(capsys):
    def main():
        raise InputError("cell.yaml: period_nm = -1: must be greater than 0")

    with pytest.raises(SystemExit) as caught:
        run_stage(main)
    assert caught.value.code == 2
    assert capsys.readouterr().err == "error: cell.yaml: period_nm = -1: must be greater than 0\n"
