"""Files appear whole or not at all; numbers in YAML are numbers."""

import json
import math

import pytest

from beamrider.io.files import InputError, atomic, load_yaml, read_json, run_stage, scalar, write_json


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
    assert read_json(tmp_path / "a.json") == {"x": 1.5}
    assert json.loads((tmp_path / "a.json").read_text())["x"] == 1.5


@pytest.mark.parametrize(
    ("text", "value"),
    [
        # YAML 1.2.2, section 10.3.2, and what YAML 1.1 made of them
        ("0600", 600),
        ("-012", -12),
        ("+7", 7),
        ("0o17", 15),
        ("0x1F", 31),
        ("017.5", 17.5),
        ("1e9", 1e9),
        ("1e-3", 1e-3),
        ("-3E4", -3e4),
        ("2.5e-6", 2.5e-6),
        (".5", 0.5),
        ("5.", 5.0),
        ("-.inf", -math.inf),
        ("1:30", "1:30"),
        ("190:20:30.15", "190:20:30.15"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("v1e9", "v1e9"),
        ("yes", "yes"),
        ("No", "No"),
        ("on", "on"),
        ("off", "off"),
        ("true", True),
        ("FALSE", False),
        ("2026-01-01", "2026-01-01"),
        ("~", None),
        ("null", None),
        ("", None),
        ("'0600'", "0600"),
    ],
)
def test_yaml_is_that_of_version_1_2(tmp_path, text, value):
    (tmp_path / "a.yaml").write_text(f"a: {text}\n")
    read = load_yaml(tmp_path / "a.yaml")["a"]
    assert (type(read), read) == (type(value), value)
    if not text.startswith("'"):
        assert (type(scalar(text)), scalar(text)) == (type(value), value)


def test_lists_of_numbers_with_leading_zeros(tmp_path):
    (tmp_path / "a.yaml").write_text("ridges_nm: [[0000, 0600], [0750, 0200]]\n")
    assert load_yaml(tmp_path / "a.yaml") == {"ridges_nm": [[0, 600], [750, 200]]}


def test_stage_turns_an_input_error_into_one_line(capsys):
    def main():
        raise InputError("cell.yaml: period_nm = -1: must be greater than 0")

    with pytest.raises(SystemExit) as caught:
        run_stage(main)
    assert caught.value.code == 2
    assert capsys.readouterr().err == "error: cell.yaml: period_nm = -1: must be greater than 0\n"
