"""FDTD without running Meep: blocks of directions, part files, adaptive tables, progress, what is refused."""

import json
import sys

import numpy as np
import pytest

from beamrider.io.checksum import append_checksum
from beamrider.io.files import InputError, validate
from optics.cells.schema import Metagrating
from optics.fdtd.adaptive import adapt
from optics.fdtd.direction import (
    DirectionResult,
)
from optics.fdtd.grid import FdtdSettings
from optics.fdtd.parts import Rows, block, merge, read_rows, write_rows
from optics.fdtd.progress import Progress, expected_directions, spread
from optics.fdtd.run import import_meep
from optics.fdtd.stage import main, read_nodes, set_aside, solve_adaptively
from optics.refinement.directions import even_nodes, fill
from optics.table.promise import read_promise

SETTINGS = FdtdSettings()


def smooth(u, v):
    """A response that is even in v and a cubic in u, which splines reproduce."""
    return np.array([0.1 + u - u**3, 0.0, 0.5 + 0.2 * u * v**2]), 1e-5 * (1 + v**2)


def solved(u, v):
    q, absorptance = smooth(u, v)
    return DirectionResult(q, absorptance, 2e-3, 1e-4, 1e-3, 1e-5, False, 1.0, (20.0, 40.0), 0.5)


def rows(directions):
    out = Rows.empty()
    for u, v in directions:
        out = out.added(u, v, solved(u, v))
    return out


def test_a_table_states_the_error_of_its_permittivities(te, tmp_path):
    gold = Metagrating.model_validate(te.model_dump() | {"index": {"n": 0.26, "k": 6.97}})
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    write_rows(tmp_path / "part.h5", gold, SETTINGS, rows(block(u, v, 1, 1)))
    assert merge(gold, SETTINGS, u, v, 0.0, [tmp_path / "part.h5"]).attrs["permittivity_error"] < 1e-12


def test_time_to_go_is_right_within_a_factor_of_two(te):
    """From a quarter of the directions to nine tenths; near a resonance they take 8 times as long, off plane twice."""
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    directions = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    seconds = [(8.0 if abs(x - 0.1) < 0.03 else 1.0) * (2.0 if y else 1.0) for x, y in directions]
    order, spent = spread(len(directions)), 0.0
    assert sorted(order) == list(range(len(directions)))
    with Progress(te, SETTINGS, directions, "test") as progress:
        for k, i in enumerate(order):
            if len(order) / 4 <= k < 0.9 * len(order):
                done, total = progress._bar.n, progress._bar.total
                assert 0.5 < spent / done * (total - done) / (sum(seconds) - spent) < 2
            progress.begin(*directions[i].tolist())
            for rung in range(6):
                progress.run(rung)
            progress.end()
            spent += seconds[i]
        assert progress._bar.n == pytest.approx(progress._bar.total)


def test_progress_is_told_at_once_and_after_the_first_run(te, capfd):
    with Progress(te, SETTINGS, np.array([[0.0, 0.0], [0.1, 0.0]]), "FDTD te") as progress:
        assert "FDTD te:   0%" in capfd.readouterr().err
        progress.begin(0.0, 0.0)
        progress.run(0)
        assert "0/2 directions" in capfd.readouterr().err
        progress.begin(0.05, 0.0)  # not expected
        progress.end()
    assert "1/1 directions" in capfd.readouterr().err


def test_the_modal_method_tells_how_many_directions_fdtd_will_ask_for(te):
    expected = expected_directions(te, 0.05, 0.05, 3e-2)
    assert len(np.unique(expected, axis=0)) == len(expected)
    assert 27 <= len(expected) < 400


def test_a_table_says_why_it_missed_its_tolerance(te, tmp_path):
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    path = tmp_path / "part.h5"
    for tolerance, met in ((1e-2, True), (5e-4, False)):  # of a direction; a table's is three times that
        settings = FdtdSettings(tolerance=tolerance)
        write_rows(path, te, settings, rows(block(u, v, 1, 1)))
        found = read_promise(merge(te, settings, u, v, 1e-4, [path]))
        assert found.met is met
        assert found.error_99 >= 2e-3 + 1e-4
    assert found.why.startswith("slow convergence: 84 of 84 directions stand at 0.002 with 40 pixels per wavelength")


def test_what_the_nodes_were_chosen_with_is_part_of_the_stated_error(te, tmp_path):
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    write_rows(tmp_path / "part.h5", te, SETTINGS, rows(block(u, v, 1, 1)))
    small, large = (merge(te, SETTINGS, u, v, known, [tmp_path / "part.h5"]).error for known in (0.0, 5e-3))
    assert np.all(large >= 7e-3)
    assert np.all(small < 3e-3)


def test_blocks_share_all_directions_evenly():
    u, v = np.linspace(-0.18, 0.18, 11), np.array([0.0, 0.1, 0.18])
    blocks = [block(u, v, i, 4) for i in range(1, 5)]
    everything = {tuple(row) for part in blocks for row in part}
    assert everything == {(x, y) for x in u for y in v}
    assert max(map(len, blocks)) - min(map(len, blocks)) <= 1
    in_plane = [int((part[:, 1] == 0).sum()) for part in blocks]
    assert max(in_plane) - min(in_plane) <= 1


def test_part_files_merge_to_the_response_they_hold(te, tmp_path):
    u, v = np.linspace(-0.18, 0.18, 21), even_nodes(0.18, 4)
    parts = []
    for i in (1, 2, 3):
        parts.append(tmp_path / f"part{i}.h5")
        write_rows(parts[-1], te, SETTINGS, rows(block(u, v, i, 3)))
    table = merge(te, SETTINGS, u, v, None, parts)
    for x, y in ((0.013, 0.0), (-0.17, 0.11), (0.1, -0.05)):
        q, absorptance = smooth(x, abs(y))
        np.testing.assert_allclose(table.q(x, y)[[0, 2]], q[[0, 2]], atol=1e-6)
        assert table.q(x, y)[1] == pytest.approx(y * absorptance, abs=1e-8)
    assert table.error.min() >= 2e-3
    with pytest.raises(InputError, match="none of the part files"):
        merge(te, SETTINGS, u, v, None, parts[:2])


def test_rows_of_another_cell_or_other_settings_are_not_kept(te, tm, tmp_path):
    path = tmp_path / "part.h5"
    write_rows(path, te, SETTINGS, rows([(0.0, 0.0)]))
    assert read_rows(path, te, SETTINGS).find(0.0, 0.0) == 0
    with pytest.raises(InputError, match="other 'cell'"):
        read_rows(path, tm, SETTINGS)
    with pytest.raises(InputError, match="other 'settings'"):
        read_rows(path, te, FdtdSettings(tolerance=1e-3))
    path.write_bytes(b"torn")
    with pytest.raises(InputError, match="not whole: cut off"):
        read_rows(path, te, SETTINGS)
    append_checksum(path)
    with pytest.raises(InputError, match="not a readable part file"):
        read_rows(path, te, SETTINGS)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"symmetries": ["Mirror(X)"]}, "symmetries"),
        ({"courant": 0.9}, "less than or equal to 0.7"),
        ({"pixels_per_wavelength": [40.0]}, "at least 2"),
        ({"pixels_per_wavelength": [20.0, 20.0]}, "must ascend"),
        ({"pixels_per_wave": 40.0}, "did you mean 'pixels_per_wavelength'"),
        ({"tolerance": 0.0}, "greater than 0"),
    ],
)
def test_bad_settings_are_refused_in_one_line(given, message):
    with pytest.raises(InputError, match=message) as error:
        validate(given, FdtdSettings, "settings.yaml")
    assert "\n" not in str(error.value)


def test_bad_nodes_are_refused(te, tmp_path):
    path = tmp_path / "nodes.json"
    good = {"name": te.name, "u": [-0.1, 0.0, 0.1], "v": [0.0, 0.1]}
    cases = [
        ({"name": "other"}, "another cell"),
        ({"u": [0.1, 0.0]}, "ascending"),
        ({"v": [0.1, 0.2]}, "must be 0"),
        ({"u": "x"}, "must hold"),
    ]
    for change, message in cases:
        path.write_text(json.dumps(good | change))
        with pytest.raises(InputError, match=message):
            read_nodes(str(path), te)
    with pytest.raises(InputError, match="no such file"):
        read_nodes(str(tmp_path / "none.json"), te)


def test_without_meep_the_stage_says_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "meep", None)
    with pytest.raises(InputError, match="python3-meep") as error:
        import_meep()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("part", ["0/4", "5/4", "x", "3"])
def test_a_bad_part_is_refused(monkeypatch, tmp_path, part):
    monkeypatch.setattr("optics.fdtd.stage.import_meep", lambda: None)
    arguments = ["--cell", "workflow/designs/mark1e_te.yaml", "--out", str(tmp_path / "p.h5"), "--part", part]
    for nodes in ([], ["--nodes", "nodes.json"]):
        monkeypatch.setattr(sys, "argv", ["fdtd", *arguments, *nodes])
        with pytest.raises(InputError, match="--part"):
            main()
    assert not [path for path in tmp_path.iterdir() if path.suffix != ".lock"]  # which the process keeps until it ends


@pytest.mark.parametrize(("u", "message"), [([0.1, 0.33], "order grazes"), ([0.1, 1.2], "evanescent")])
@pytest.mark.parametrize("part", [[], ["--part", "1/1"]])
def test_directions_that_cannot_be_solved_are_refused_before_any_is(monkeypatch, tmp_path, te, u, message, part):
    monkeypatch.setattr("optics.fdtd.stage.import_meep", lambda: None)
    monkeypatch.setattr("optics.fdtd.stage.solve_direction", lambda *_: pytest.fail("solved"))
    nodes = tmp_path / "nodes.json"
    nodes.write_text(json.dumps({"name": te.name, "u": u, "v": [0.0, 0.1]}))
    arguments = ["--cell", "workflow/designs/mark1e_te.yaml", "--nodes", str(nodes), "--out", str(tmp_path / "t.h5")]
    monkeypatch.setattr(sys, "argv", ["fdtd", *arguments, *part])
    with pytest.raises(InputError, match=message):
        main()
    assert [path for path in tmp_path.iterdir() if path.suffix != ".lock"] == [nodes]


def resonance(directions):
    """Values (n, 2) with a resonance of width 0.01 whose place moves with v."""
    u, v = directions.T
    line = 1e-4 / ((u - 0.05 + v**2 / 4) ** 2 + 1e-4)
    return np.stack([0.3 * line + u, line * u], axis=-1)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_adaptive_directions_resolve_a_resonance_to_the_tolerance(tolerance):
    u, v, _ = adapt(resonance, 0.18, 0.18, tolerance)
    values = resonance(np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2)).reshape(u.size, v.size, 2)
    x, y = np.linspace(-0.18, 0.18, 301), np.linspace(0, 0.18, 23)
    exact = resonance(np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)).reshape(x.size, y.size, 2)
    assert np.abs(fill(u, v, values, x, y) - exact).max() < tolerance
    assert np.diff(u)[np.abs(u[1:] - 0.05) < 0.01].max() < 0.5 * np.diff(u).max()


def test_an_adaptive_table_that_was_killed_goes_on_from_its_rows(te, tmp_path, monkeypatch):
    calls = []

    def solve(cell, u, v, settings, told):
        calls.append((u, v))
        if len(calls) == 20:
            raise KeyboardInterrupt
        return solved(u, v)

    monkeypatch.setattr("optics.fdtd.stage.solve_direction", solve)
    path = tmp_path / "rows.h5"
    with pytest.raises(KeyboardInterrupt):
        solve_adaptively(te, 0.18, 0.18, SETTINGS, path)
    assert read_rows(path, te, SETTINGS).values.shape[0] == 19
    u, v, between = solve_adaptively(te, 0.18, 0.18, SETTINGS, path)
    assert len(calls) == len(set(calls)) + 1  # only the one that was cut off is solved again
    table = merge(te, SETTINGS, u, v, between, [path])
    assert table.q(0.02, 0.01)[0] == pytest.approx(smooth(0.02, 0.01)[0][0], abs=1e-6)


def test_damaged_rows_of_an_earlier_run_are_set_aside_and_whole_ones_are_kept(te, tmp_path, capsys):
    path = tmp_path / "part.h5"
    write_rows(path, te, SETTINGS, rows([(0.0, 0.0)]))
    set_aside(path)
    assert (read_rows(path, te, SETTINGS).find(0.0, 0.0), capsys.readouterr().err) == (0, "")
    content = path.read_bytes()
    path.write_bytes(content[:-100])
    set_aside(path)
    assert [item.name for item in tmp_path.iterdir()] == ["part.h5.damaged"]
    assert capsys.readouterr().err.startswith(f"{path}: not whole: cut off, or not a file that")
    set_aside(path)
