"""The flight file: VTKHDF that ParaView opens as a time series, with the numbers of the whole sail in group /series.

/VTKHDF is a transient unstructured grid of fixed triangles (VTK file format documentation, "VTKHDF"): points and the
node data temperature and velocity, the cell data temperature, strain (the larger principal one; of springs that of the
longest of the three sides), slack (1 where the smaller principal stress is a pressure, which no membrane bears; not of
springs) and sector.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from beamrider.io.checksum import append_checksum
from beamrider.io.files import atomic
from beamrider.io.hdf5 import new_hdf5
from beamrider.provenance.record import as_attribute
from dynamics.membrane.output.record import COLUMNS, SIZES, WIDTH
from dynamics.sail.attitude import angles_from_rotation
from dynamics.sail.mesh import Mesh

TRIANGLE = 5  # VTK's number for the cell type
_PACKED = {"compression": "gzip", "compression_opts": 4, "shuffle": True}

#: Columns of the rows that don't go to /series: attitude and spin follow from them.
_INNER = ("fit", "inertia")


@dataclass(frozen=True)
class Frame:
    """A snapshot: time in s, points and velocity (n, 3), node temperature (n,) in K, strain (t,) of each triangle.

    failed (t,): 1 for failed triangles; None where the first failure ends the flight. slack (t,): 1 for slack ones;
    None of springs.
    """

    time: float
    points: Floats
    velocity: Floats
    temperature: Floats
    strain: Floats
    _: KW_ONLY
    failed: Floats | None = None
    slack: Floats | None = None


def attitude(fit: Floats) -> Floats:
    """Rotations Q (k, 3, 3), body to lab, that fit the sail best in the mass-weighted least-squares sense.

    fit (k, 3, 3) = Σ m (x − c) X₀ᵀ; Kabsch's solution from its singular vectors (Acta Cryst. A32 (1976) 922).
    """
    left, _, right = np.linalg.svd(fit)
    sign = np.ones(fit.shape[:-1])
    sign[:, 2] = np.linalg.det(left @ right)
    return np.asarray(left @ (sign[:, :, None] * right))


def spin_rate(turn: Floats, momentum: Floats, inertia: Floats) -> Floats:
    """Spin (k,) in turns a second about the normal Qẑ, from angular momentum (k, 3) and inertia (k, 6) in the lab."""
    xx, yy, zz, xy, xz, yz = inertia.T
    tensor = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    omega = np.linalg.solve(tensor, momentum[:, :, None])[:, :, 0]
    return np.sum(omega * turn[:, :, 2], axis=1) / (2.0 * np.pi)


def series(
    rows: Floats, start_temperature: float | None = None, more: Mapping[str, tuple[int, str]] | None = None
) -> dict[str, tuple[Floats, str]]:
    """Columns and units of /series from the rows (k, WIDTH), at a constant `start_temperature` if it is given.

    more: widths and units of columns behind WIDTH, by name; vectors stay one after the other.
    """

    def column(name: str, width: int) -> Floats:
        values = rows[:, COLUMNS[name] : COLUMNS[name] + width]
        return values[:, 0] if width == 1 else values

    result = {name: (column(name, width), unit) for name, (width, unit) in SIZES.items() if name not in _INNER}
    if start_temperature is not None:
        for name in [name for name in result if name.startswith("temperature_")]:
            result[name] = (np.full(len(rows), start_temperature), "K")
    turn = attitude(column("fit", 9).reshape(-1, 3, 3))
    for name, angle in zip(("roll", "pitch", "yaw"), angles_from_rotation(turn), strict=True):
        result[name] = (angle, "rad")
    result["spin"] = (spin_rate(turn, column("angular_momentum", 3), column("inertia", 6)), "Hz")
    begin = WIDTH
    for name, (width, unit) in (more or {}).items():
        result[name] = (rows[:, begin : begin + width], unit)
        begin += width
    return result


class _Grid:
    """Appends frames to group /VTKHDF of an open file."""

    def __init__(self, file: h5py.File, mesh: Mesh, cells: Mapping[str, NDArray[Any]]) -> None:
        self._group = file.create_group("VTKHDF", track_order=True)
        self._mesh = mesh
        self._group.attrs["Version"] = np.array([2, 2])
        self._group.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        n, t = len(mesh.nodes), len(mesh.triangles)
        for name, values in (
            ("NumberOfPoints", [n]),
            ("NumberOfCells", [t]),
            ("NumberOfConnectivityIds", [3 * t]),
            ("Connectivity", mesh.triangles.ravel()),
            ("Offsets", 3 * np.arange(t + 1)),
        ):
            self._group[name] = np.asarray(values, dtype=np.int64)
        self._group["Types"] = np.full(t, TRIANGLE, dtype=np.uint8)
        for name, values in cells.items():
            self._group[f"CellData/{name}"] = values

    def append(self, name: str, values: NDArray[Any]) -> None:
        """Rows (k, ...) at the end of a dataset, one chunk a call."""
        if name not in self._group:
            shape = values.shape[1:]
            self._group.create_dataset(
                name, shape=(0, *shape), maxshape=(None, *shape), chunks=values.shape, dtype=values.dtype, **_PACKED
            )
        data = self._group[name]
        data.resize(len(data) + len(values), axis=0)
        data[-len(values) :] = values

    def frame(self, frame: Frame) -> None:
        """One snapshot."""
        self.append("Points", frame.points)
        self.append("PointData/velocity", frame.velocity.astype(np.float32))
        self.append("PointData/temperature", frame.temperature.astype(np.float32))
        corners = frame.temperature[self._mesh.triangles].mean(axis=1)
        self.append("CellData/temperature", corners.astype(np.float32))
        self.append("CellData/strain", frame.strain.astype(np.float32))
        if frame.failed is not None:
            self.append("CellData/failed", frame.failed.astype(np.uint8))
        if frame.slack is not None:
            self.append("CellData/slack", frame.slack.astype(np.uint8))

    def steps(self, times: list[float]) -> None:
        """Group Steps: where each time finds its numbers. Cells and the sector are those of every step."""
        steps = self._group.create_group("Steps")
        count, n, t = len(times), len(self._mesh.nodes), len(self._mesh.triangles)
        none, place = np.zeros(count, dtype=np.int64), np.arange(count)
        steps.attrs["NSteps"] = count
        steps["Values"] = np.array(times)
        steps["PartOffsets"], steps["NumberOfParts"], steps["PointOffsets"] = none, none + 1, n * place
        steps["CellOffsets"], steps["ConnectivityIdOffsets"] = none[:, None], none[:, None]
        for name in ("velocity", "temperature"):
            steps[f"PointDataOffsets/{name}"] = n * place
        more = [name for name in ("failed", "slack") if f"CellData/{name}" in self._group]
        for name in ("temperature", "strain", *more):
            steps[f"CellDataOffsets/{name}"] = t * place
        steps["CellDataOffsets/sector"] = none


def reserve(path: Path, size: int) -> None:
    """OSError if the disk of an empty file has no room for `size` bytes.

    HDF5 does not outlive a full disk: it ends the process where it closes the file (version 1.14).
    """
    try:
        with open(path, "r+b") as stream:
            os.posix_fallocate(stream.fileno(), 0, size)
            stream.truncate(0)
    except OSError as error:
        raise OSError(error.errno, f"{error.strerror}: {size / 1e6:.3g} MB are needed", str(path.parent)) from None


def write_flight(
    path: str | Path,
    mesh: Mesh,
    frames: Iterable[Frame],
    columns: Mapping[str, tuple[Floats, str]],
    attributes: Mapping[str, Any],
    size: int = 0,
) -> None:
    """Write a flight atomically: snapshots, columns (rows, ...) with units, attributes of /series (end reason, …).

    slack_area is the largest share of the sail's area that is slack in a snapshot from the release on.
    size: bytes of frames and columns. OSError if they, with a margin, do not fit on the disk.
    """
    with atomic(path) as temporary:
        reserve(temporary, size + size // 8 + 100 * len(mesh.triangles) + 500_000)
        _write_flight(temporary, mesh, frames, columns, attributes)
        append_checksum(temporary)


def _write_flight(
    path: Path,
    mesh: Mesh,
    frames: Iterable[Frame],
    columns: Mapping[str, tuple[Floats, str]],
    attributes: Mapping[str, Any],
) -> None:
    with h5py.File(path, "w", locking=False) as file:
        grid = _Grid(file, mesh, {"sector": mesh.sector.astype(np.int32)})
        times, slack = [], []
        for frame in frames:
            grid.frame(frame)
            times.append(frame.time)
            if frame.slack is not None and frame.time >= 0.0:
                slack.append(float(frame.slack @ mesh.areas / mesh.areas.sum()))
        grid.steps(times)
        group = file.create_group("series")
        for name, (values, unit) in columns.items():
            group.create_dataset(name, data=values, chunks=True, **_PACKED).attrs["units"] = unit
        group.attrs.update(attributes)
        file.attrs.update(as_attribute())
        if slack:
            group.attrs["slack_area"] = max(slack)


def write_mesh(path: str | Path, mesh: Mesh, cells: Mapping[str, NDArray[Any]]) -> None:
    """Write a mesh with data (t,) of its triangles as VTKHDF, atomically."""
    with new_hdf5(path) as file:
        grid = _Grid(file, mesh, cells)
        grid.append("Points", mesh.nodes)
