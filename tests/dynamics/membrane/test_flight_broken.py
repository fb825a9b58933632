"""The flight file of a sail that tears: VTK and h5py show what failed, what was removed, and when."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkDataObject
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkFiltersCore import vtkThreshold
from vtkmodules.vtkIOHDF import vtkHDFReader

from dynamics.membrane.flight import Flight
from dynamics.membrane.output.flight_file import write_flight
from dynamics.membrane.summary import attributes
from tests.membranes import dark

POINTS, CELLS = {"velocity", "temperature"}, {"temperature", "strain", "sector", "failed", "slack"}


def torn(folder: Path, on_failure: str) -> tuple[Flight, Path]:
    """A sail whose halves fly apart, and its file."""
    scene = dark(
        6,
        effects={"emission": False},
        flight={
            "on_failure": on_failure,
            "duration_s": 3e-4,
            "snapshot_every_s": 3e-5,
            "series_every": 1,
        },
    )
    flight = Flight(scene, {}, folder / "journal")
    x = flight.model.rest
    flight.state.v[0] = 900.0 * np.sign(np.round(x[0], 9))
    end = flight.fly()
    assert end.reason == "finished"
    path = folder / "flight.vtkhdf"
    write_flight(path, flight.membrane.mesh, flight.frames(), flight.columns(), attributes(flight, end, {}))
    return flight, path


@pytest.mark.parametrize("on_failure", ["record", "remove"])
def test_vtk_and_h5py_show_every_step_of_a_sail_that_tears(tmp_path: Path, on_failure: str):
    flight, path = torn(tmp_path, on_failure)
    mesh, reader = flight.membrane.mesh, vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    frames = list(flight.frames())
    failed = []
    with h5py.File(path) as file:
        grid = file["VTKHDF"]
        assert grid["Steps"].attrs["NSteps"] == len(times) == len(frames) > 8
        assert np.array_equal(times, [frame.time for frame in frames])
        assert np.array_equal(grid["Steps/Values"], times)
        n, t = len(mesh.nodes), len(mesh.triangles)
        for k, (time, frame) in enumerate(zip(times, frames, strict=True)):
            reader.UpdateTimeStep(time)
            data = reader.GetOutput()
            points, cells = data.GetPointData(), data.GetCellData()
            assert {points.GetArrayName(i) for i in range(points.GetNumberOfArrays())} == POINTS
            assert {cells.GetArrayName(i) for i in range(cells.GetNumberOfArrays())} == CELLS
            assert (data.GetNumberOfPoints(), data.GetNumberOfCells()) == (n, t)
            corners = vtk_to_numpy(data.GetCells().GetConnectivityArray()).reshape(-1, 3)
            assert np.array_equal(corners, mesh.triangles)
            assert np.array_equal(vtk_to_numpy(data.GetPoints().GetData()), frame.points)
            for name, given, size, want in (
                ("PointData/velocity", points, n, frame.velocity),
                ("CellData/strain", cells, t, frame.strain),
                ("PointData/temperature", points, n, frame.temperature),
                ("CellData/failed", cells, t, frame.failed),
                ("CellData/slack", cells, t, frame.slack),
            ):
                seen = vtk_to_numpy(given.GetArray(name.split("/")[1]))
                assert np.array_equal(seen, want.astype(seen.dtype), equal_nan=True)
                offset = grid["Steps/" + name.replace("Data/", "DataOffsets/")][k]
                assert np.array_equal(grid[name][offset : offset + size], seen, equal_nan=True)
            failed.append(int(vtk_to_numpy(cells.GetArray("failed")).sum()))
        series = file["series"]
        at = np.searchsorted(series["time"][()], np.array(times) - 1e-12)
        assert np.array_equal(failed, series["failed_tensile"][()][at])
        assert series.attrs["first_failure"] == "tensile_failure"
        areas = mesh.areas / mesh.areas.sum()
        slack = [float(frame.slack @ areas) for frame in frames if frame.time >= 0 and frame.slack is not None]
        assert series.attrs["slack_area"] == pytest.approx(max(slack), rel=1e-12)
        assert series["time"][np.argmax(series["failed_tensile"][()] > 0)] >= series.attrs["first_failure_time"] >= 0
    assert failed[0] == 0 < failed[-1]
    assert np.isnan(frames[-1].strain).sum() == (failed[-1] if on_failure == "remove" else 0)


def test_what_is_left_of_the_sail_can_be_cut_out_by_failed(tmp_path: Path):
    """As for a picture of a torn sail: a threshold on `failed`."""
    flight, path = torn(tmp_path, "remove")
    reader, left = vtkHDFReader(), vtkThreshold()
    reader.SetFileName(str(path))
    left.SetInputConnection(reader.GetOutputPort())
    left.SetInputArrayToProcess(0, 0, 0, vtkDataObject.FIELD_ASSOCIATION_CELLS, "failed")
    left.SetThresholdFunction(vtkThreshold.THRESHOLD_LOWER)
    left.SetLowerThreshold(0.5)
    left.UpdateTimeStep(list(flight.frames())[-1].time)
    assert left.GetOutput().GetNumberOfCells() == 216 - int(flight.work.effects.tearing.gone.sum())
