"""HDF5 files are read and written where the file system has no locks."""

import errno
import sys

import h5py
import pytest

from beamrider.io.hdf5 import read_hdf5
from dynamics.membrane import stage
from optics.table.pressure_table import PressureTable
from tests.membranes import small, write_inputs
from tests.processes import run, without_locks
from tests.synthetic import smooth_tables


def read(kind):
    """A stage that prints the largest q of the table named on its command line."""

    def main() -> None:
        path = sys.argv[1]
        if kind == "table":
            print(PressureTable.read(path).q_nodes.max())
        else:
            with read_hdf5(path) if kind == "ours" else h5py.File(path, "r") as file:
                print(file["q"][()].max())

    return main


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "te.h5"
    smooth_tables()["mark1e_te"].write(path)
    return path


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS])
@pytest.mark.parametrize("kind", ["table", "ours"])
def test_a_table_is_read_without_locks(table, number, kind):
    with_locks = run(read(kind), [str(table)])
    assert with_locks[0] == 0
    assert run(read(kind), [str(table)], without_locks(number)) == with_locks


def test_hdf5_itself_would_refuse(table):
    code, said = run(read("plain"), [str(table)], without_locks(errno.ENOLCK))
    assert code != 0
    assert "37" in said
    assert run(read("plain"), [str(table)])[0] == 0


def test_a_flight_flies_and_is_read_without_locks(tmp_path):
    scene = small(rings=4, flight={"duration_s": 2e-4, "snapshot_every_s": 1e-4, "series_every": 4})
    assert run(stage.main, write_inputs(tmp_path, scene), without_locks(errno.ENOLCK))[0] == 0
    with read_hdf5(tmp_path / "out/flight.vtkhdf") as file:
        assert file["series"].attrs["end_reason"] == "finished"
