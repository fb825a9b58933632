"""Compilation is said where it happens, once, and not where the code is at hand."""

import importlib
import sys

import numba

from beamrider.machine_code.notice import compiling


def test_the_first_function_is_said_and_no_other(capsys):
    twice, thrice = (numba.njit(lambda x, k=k: k * x) for k in (2, 3))
    with compiling("3 s"):
        assert (twice(1), thrice(1)) == (2, 3)
    assert capsys.readouterr().err == "compiling, about 3 s, once\n"
    with compiling("3 s"):
        twice(2)
    assert capsys.readouterr().err == ""


def test_code_from_the_cache_is_not_compiled(tmp_path, capsys, monkeypatch):
    """As in the second run of a stage."""
    (tmp_path / "kept.py").write_text("import numba\n\n@numba.njit(cache=True)\ndef twice(x):\n    return 2 * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    said = []
    for _ in range(2):
        sys.modules.pop("kept", None)
        kept = importlib.import_module("kept")
        with compiling("3 s"):
            kept.twice(1)
        said.append(capsys.readouterr().err)
    assert said == ["compiling, about 3 s, once\n", ""]
