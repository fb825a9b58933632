"""The flight file: VTK opens it as a time series, /series holds SI columns, a killed one resumes to the same bits."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader

from beamrider.io.files import InputError, run_stage
from dynamics import mesh as mesh_command
from dynamics.membrane import flight as membrane
from dynamics.membrane import stage
from dynamics.scene.materials import MATERIALS
from tests.membranes import dark, small, write_inputs
from tests.synthetic import smooth_tables

FLIGHT = {"duration_s": 5e-4, "snapshot_every_s": 1e-4, "series_every": 4, "checkpoint_every_s": 1e-3}
SCENE = small(rings=4, release={"spin_Hz": -120.0}, flight=FLIGHT)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short flight's file, written by the command line."""
    folder = tmp_path_factory.mktemp("flight")
    arguments = write_inputs(folder, SCENE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["membrane", *arguments, "--plan", str(folder / "out" / "plan.json")])
        run_stage(stage.main)
    return folder / "out" / "flight.vtkhdf"


def test_vtk_reads_the_flight_as_a_time_series(flown: Path):
    reader = vtkHDFReader()
    reader.SetFileName(str(flown))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    with h5py.File(flown) as file:
        grid = file["VTKHDF"]
        assert np.array_equal(times, grid["Steps/Values"])
        n = int(grid["NumberOfPoints"][0])
        for step in (0, len(times) // 2, len(times) - 1):
            reader.UpdateTimeStep(times[step])
            data = reader.GetOutput()
            points = vtk_to_numpy(data.GetPoints().GetData())
            assert np.array_equal(points, grid["Points"][step * n : (step + 1) * n])
            assert data.GetNumberOfCells() == 6 * SCENE.sail.rings**2
            heat = vtk_to_numpy(data.GetCellData().GetArray("temperature"))
            nodes = vtk_to_numpy(data.GetPointData().GetArray("temperature"))
            cells = grid["Connectivity"][()].reshape(-1, 3)
            assert np.allclose(heat, nodes[cells].mean(axis=1), rtol=1e-6)
            assert set(vtk_to_numpy(data.GetCellData().GetArray("sector"))) == {0, 1, 2, 3}
            assert data.GetPointData().HasArray("velocity")
            assert data.GetCellData().HasArray("strain")


def test_series_hold_si_columns_that_fit_the_snapshots(flown: Path):
    with h5py.File(flown) as file:
        series = file["series"]
        columns = {name: data[()] for name, data in series.items()}
        assert {name: series[name].attrs["units"] for name in ("time", "position", "velocity", "pitch", "spin")} == {
            "time": "s",
            "position": "m",
            "velocity": "m/s",
            "pitch": "rad",
            "spin": "Hz",
        }
        assert series.attrs["end_reason"] == "finished"
        grid = file["VTKHDF"]
        points = grid["Points"][grid["Steps/PointOffsets"][-1] :]
        strain = grid["CellData/strain"][grid["Steps/CellDataOffsets/strain"][-1] :]
        last = grid["Steps/Values"][-1]
    assert len({len(values) for values in columns.values()}) == 1
    assert np.all(np.diff(columns["time"]) > 0)
    assert columns["time"][-1] == last == pytest.approx(5e-4, abs=1e-5)
    masses = membrane.build(SCENE, smooth_tables()).lattice.masses
    assert np.allclose(columns["position"][-1], masses @ points / masses.sum(), rtol=1e-12)
    assert columns["strain_max"][-1] == pytest.approx(strain.max(), rel=1e-4)


def test_the_plan_is_written_beside(flown: Path):
    assert '"light"' in (flown.parent / "plan.json").read_text(encoding="utf-8")


def test_snapshots_come_at_the_scene_s_interval_and_hold_t_zero(flown: Path):
    with h5py.File(flown) as file:
        times = file["VTKHDF/Steps/Values"][()]
    assert 0.0 in times
    assert np.allclose(np.diff(times[times >= 0])[:-1], 1e-4, atol=1e-5)


def test_nothing_is_left_beside_a_finished_flight(flown: Path):
    assert not (flown.parent / "flight.vtkhdf.partial").exists()


def same_numbers(a: Path, b: Path) -> bool:
    """Are all data sets of two flight files equal to the bit."""
    with h5py.File(a) as one, h5py.File(b) as two:
        names: list[str] = []
        one.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        return len(names) > 40 and all(np.array_equal(one[name][()], two[name][()], equal_nan=True) for name in names)


def test_a_killed_flight_resumes_to_the_same_bits(flown: Path, tmp_path: Path):
    arguments = [sys.executable, "-m", "dynamics.membrane", *write_inputs(tmp_path, SCENE)]
    checkpoint = tmp_path / "out" / "flight.vtkhdf.partial" / "checkpoint.npz"
    process = subprocess.Popen(arguments, stderr=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + 60
    while not checkpoint.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(1e-3)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert checkpoint.exists()
    assert not (tmp_path / "out" / "flight.vtkhdf").exists()
    again = subprocess.run(arguments, capture_output=True, text=True, check=True)
    assert "going on from step" in again.stderr
    assert same_numbers(flown, tmp_path / "out" / "flight.vtkhdf")


def test_a_checkpoint_of_another_flight_is_not_taken(tmp_path: Path):
    first = membrane.Flight(dark(2), {}, tmp_path)
    first.advance()
    first.checkpoint()
    assert membrane.Flight(dark(2), {}, tmp_path).resume()
    assert not membrane.Flight(dark(2, flight={"duration_s": 0.2}), {}, tmp_path).resume()
    assert not (tmp_path / "rows").exists()


def test_a_checkpoint_from_before_an_edit_of_a_material_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The scene only names the material: its file says the same before and after."""
    sector = {"from_deg": 0.0, "material": "nitride_te", "reflectance": 0.5}
    scene = dark(2, sail={"sectors": [sector]})
    first = membrane.Flight(scene, {}, tmp_path)
    first.advance()
    first.checkpoint()
    assert membrane.Flight(scene, {}, tmp_path).resume()
    heavier = MATERIALS["nitride_te"].model_copy(update={"density_kg_m3": 2700.0001})
    monkeypatch.setitem(MATERIALS, "nitride_te", heavier)
    assert not membrane.Flight(scene, {}, tmp_path).resume()


def spoil(name: str, checkpoint: Path) -> None:
    """Damage the files of a flight in progress in one of the ways files are damaged."""
    content = checkpoint.read_bytes()
    if name == "archive without names":
        np.savez(checkpoint, other=np.zeros(2))
    elif name == "plain array":
        with open(checkpoint, "wb") as stream:
            np.save(stream, np.zeros(3))
    elif name == "flipped bits":
        middle = len(content) // 2
        checkpoint.write_bytes(
            content[:middle] + bytes(255 - b for b in content[middle : middle + 64]) + content[middle + 64 :]
        )
    elif name == "frames lost":
        checkpoint.with_name("frames").unlink()
    else:
        left = {"empty": b"", "text": b"not a checkpoint", "cut off": content[: len(content) // 2]}
        checkpoint.write_bytes(left[name])


@pytest.mark.parametrize(
    "damage", ["empty", "text", "cut off", "flipped bits", "archive without names", "plain array", "frames lost"]
)
def test_an_unreadable_checkpoint_counts_as_none(tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str):
    first = membrane.Flight(dark(2), {}, tmp_path)
    first.advance()
    first.checkpoint()
    spoil(damage, tmp_path / "checkpoint.npz")
    again = membrane.Flight(dark(2), {}, tmp_path)
    assert not again.resume()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{tmp_path / 'checkpoint.npz'}: not a readable checkpoint")
    assert again.step == 0
    assert np.array_equal(again.state.x, again.model.rest)
    assert not (tmp_path / "frames").exists()


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path):
    place = tmp_path / "flight.vtkhdf.partial"
    place.write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="must be a folder, for the flight in progress, or absent"):
        membrane.Flight(dark(2), {}, place)
    assert place.read_text(encoding="utf-8") == "mine"


def test_paraview_can_look_at_the_mesh_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    scene = tmp_path / "fig6.yaml"
    scene.write_text(yaml.safe_dump(SCENE.model_dump()), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["mesh", "--scene", str(scene), "--out", str(tmp_path / "mesh.vtkhdf")])
    run_stage(mesh_command.main)
    reader = vtkHDFReader()
    reader.SetFileName(str(tmp_path / "mesh.vtkhdf"))
    reader.Update()
    cells = reader.GetOutput().GetCellData()
    assert set(vtk_to_numpy(cells.GetArray("thickness"))) == {400e-9, 1240e-9 / 3}
    assert vtk_to_numpy(cells.GetArray("sector")).size == 6 * SCENE.sail.rings**2
