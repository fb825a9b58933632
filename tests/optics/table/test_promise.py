"""What a table says of its tolerance: over the area of directions, in its file, in one line and as an exit code."""

import numpy as np
import pytest

from beamrider.io.files import InputError
from optics.table.pressure_table import PressureTable
from optics.table.promise import MISSED, finish, promise, promised, read_promise, weighted_quantile


def _table(error, u=None, v=None, **attrs):
    error = np.asarray(error, float)
    u = np.linspace(-0.4, 0.4, error.shape[0]) if u is None else np.asarray(u, float)
    v = np.linspace(0.0, 0.4, error.shape[1]) if v is None else np.asarray(v, float)
    zero = np.zeros(error.shape)
    given = {"name": "made_up", "settings": {"tolerance": 1e-3}, "cpu_seconds": 2.0} | attrs
    return PressureTable(u, v, np.zeros((3, *error.shape)), zero, error, axisymmetric=v.size == 1, attrs=given)


def test_directions_count_by_their_area_and_not_by_their_number():
    # Nine tenths of the nodes crowd into a hundredth of the window, where the error is large.
    u = np.concatenate([np.linspace(-0.4, 0.4, 10)[:-1], np.linspace(0.396, 0.4, 100)])
    error = np.where(u[:, None] < 0.396, 1e-4, 1e-2) * np.ones(3)
    share = 0.004 / 0.8 + (u[9] - u[8]) / 0.8  # the bad nodes and the interval that leads to them
    kept = promise(_table(error, u), 1e-3)
    assert weighted_quantile(*_cells(error, u), 1 - share - 1e-9) == 1e-4
    assert weighted_quantile(*_cells(error, u), 1 - share + 1e-9) == 1e-2
    assert not kept.met
    assert kept.largest == 1e-2


def _cells(error, u):
    from optics.table.promise import cell_errors

    return cell_errors(_table(error, u))


@pytest.mark.parametrize(("bad", "met"), [(0.0099, True), (0.0101, False)])
def test_films_count_by_rings(bad, met):
    # Outside of s² = 1 − bad lies a share `bad` of the disc of directions.
    s = np.array([0.0, 0.5, np.sqrt(1 - bad), np.sqrt(1 - bad) + 1e-12, 1.0])
    error = np.array([1e-6, 1e-6, 1e-6, 1e-2, 1e-2])[:, None]
    assert promise(_table(error, s, [0.0]), 1e-3).met is met


def test_the_largest_error_is_named_with_its_direction():
    error = np.full((9, 5), 1e-4)
    error[3, 2] = 0.2
    kept = promise(_table(error), 1e-3, ["a cap: 600 rows", "a cap: 600 rows", "slow"])
    assert kept.at == pytest.approx((-0.1, 0.2))
    assert kept.text.endswith("largest 0.2 at u = -0.1, v = 0.2; tolerance 0.001 missed (a cap: 600 rows; slow)")


@pytest.mark.parametrize(("size", "met"), [(1e-4, 1), (1e-2, 0)])
def test_file_line_and_exit_code(size, met, tmp_path, capsys):
    out = tmp_path / "t.h5"
    table = promised(_table(np.full((5, 4), size)), 1e-3, [] if met else ["a cap: 600 rows"])
    if met:
        finish(table, out)
    else:
        with pytest.raises(SystemExit) as ended:
            finish(table, out)
        assert ended.value.code == MISSED
        finish(table, out, accept_missed=True)
    line = capsys.readouterr().out.splitlines()[0]
    assert line.startswith(f"{out}: 5 × 4 directions, error {size:.2g} at 99 %")
    assert line.endswith(f"tolerance 0.001 {'met' if met else 'missed (a cap: 600 rows)'}; 2 CPU s")
    read = PressureTable.read(out)
    assert read.attrs["tolerance_met"] == met
    assert read.attrs["missed_because"] == ("" if met else "a cap: 600 rows")
    assert read_promise(read).text == read_promise(table).text


def test_a_table_without_promise_is_refused():
    with pytest.raises(InputError, match="make it again"):
        read_promise(_table(np.full((3, 3), 1e-3)))
