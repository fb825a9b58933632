"""The pressure table: the one contract between optics and motion.

A table belongs to one cell, one polarisation and one wavelength. It holds q (force × c per incident power, in the cell
frame g, r, n) and the absorptance on a grid of direction cosines, with an error estimate for every direction. It is
read back with a C¹ bicubic Hermite interpolation whose slopes come from local five-point differences.

Files are HDF5 in the netCDF-4 layout: `xarray.open_dataset(path, engine="h5netcdf")` reads them without this module.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numba
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from optics.files import InputError, atomic
from optics.interpolation import Floats, TableArrays, lookup_gradient, lookup_many
from optics.interpolation import lookup as lookup

SCHEMA = 1
COMPONENTS = ("g", "r", "n")
_BUCKETS_PER_NODE = 4


class OutsideTable(InputError):
    """A direction was asked for that the table does not hold."""


@numba.njit(cache=True)
def _gradient_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> None:
    for p in range(u.size):
        lookup_gradient(t, u[p], v[p], out[p])


def slope_matrix(nodes: Floats) -> Floats:
    """Matrix (n, n) giving the derivative at each node from the five (or all, if fewer) nearest nodes."""
    n = nodes.size
    width = min(5, n)
    matrix = np.zeros((n, n))
    for i in range(n):
        start = min(max(i - width // 2, 0), n - width)
        near = np.arange(start, start + width)
        x = nodes[near] - nodes[i]
        scale = np.abs(x).max() or 1.0
        powers = np.vander(x / scale, increasing=True).T
        rhs = np.zeros(width)
        rhs[1] = 1.0 / scale
        matrix[i, near] = np.linalg.solve(powers, rhs)
    return matrix


def _buckets(nodes: Floats) -> NDArray[np.int64]:
    edges = np.linspace(nodes[0], nodes[-1], _BUCKETS_PER_NODE * nodes.size, endpoint=False)
    return np.clip(np.searchsorted(nodes, edges, side="right") - 1, 0, nodes.size - 2)


@dataclass(frozen=True)
class PressureTable:
    """Pressure coefficients of one cell over direction cosines.

    u (n_u), v (n_v): ascending, in the cell frame. q_nodes (3, n_u, n_v): components g, r, n. absorptance_nodes, error
    (n_u, n_v): absorbed fraction and estimated absolute error of q. With `mirror_v` only v ≥ 0 is stored (q_g, q_n and
    the absorptance are even in v, q_r is odd). An axisymmetric table (a film) has v = [0] and u from 0.
    `attrs`: what made the table (name, cell, solver, settings, versions, wall_seconds, energy_imbalance, cutoffs).
    """

    u: Floats
    v: Floats
    q_nodes: Floats
    absorptance_nodes: Floats
    error: Floats
    mirror_v: bool = False
    axisymmetric: bool = False
    attrs: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shape = (self.u.size, self.v.size)
        for name, array, want in (
            ("q", self.q_nodes, (3, *shape)), ("absorptance", self.absorptance_nodes, shape),
            ("error", self.error, shape),
        ):
            if array.shape != want:
                raise InputError(f"{name} has shape {array.shape}; must be {want}")
            if not np.all(np.isfinite(array)):
                raise InputError(f"{name} holds values that are not finite")
        for name, nodes, least in (("u", self.u, 2), ("v", self.v, 1 if self.axisymmetric else 2)):
            if nodes.size < least or np.any(np.diff(nodes) <= 0):
                raise InputError(f"{name} must hold at least {least} ascending values")
        if not (np.all(np.isfinite(self.u)) and np.all(np.isfinite(self.v))):
            raise InputError("u and v must be finite")
        if self.axisymmetric and self.v.tolist() != [0.0]:
            raise InputError("an axisymmetric table must have v = [0]")
        if not np.all(self.error > 0):
            raise InputError("error must be greater than 0 everywhere")
        if self.mirror_v and self.v[0] != 0:
            raise InputError("a table with mirror_v must start at v = 0")

    @property
    def name(self) -> str:
        """Name of the cell the table belongs to."""
        return str(self.attrs.get("name", ""))

    @cached_property
    def _full(self) -> tuple[Floats, Floats]:
        """V (n_v) over both signs, or [0, 1] for a film, and values (4, n_u, n_v) of q and absorptance."""
        values = np.concatenate([self.q_nodes, self.absorptance_nodes[None]])
        if self.axisymmetric:
            return np.array([0.0, 1.0]), np.repeat(values, 2, axis=2)
        if not self.mirror_v:
            return self.v, values
        odd = np.array([1.0, -1.0, 1.0, 1.0])[:, None, None]
        return np.concatenate([-self.v[:0:-1], self.v]), np.concatenate([odd * values[:, :, :0:-1], values], axis=2)

    def arrays(self, nearest: bool = False) -> TableArrays:
        """The table as plain arrays for compiled kernels."""
        v, f = self._full
        du, dv = slope_matrix(self.u), slope_matrix(v)
        f_u = np.einsum("ij,kjl->kil", du, f)
        c = np.concatenate([f, f_u, f @ dv.T, f_u @ dv.T])
        return TableArrays(
            np.ascontiguousarray(self.u), np.ascontiguousarray(v), _buckets(self.u), _buckets(v),
            np.ascontiguousarray(np.moveaxis(c, 0, 2)), self.axisymmetric, nearest,
        )

    @cached_property
    def _arrays(self) -> TableArrays:
        return self.arrays()

    def _look_up(self, u: Any, v: Any) -> tuple[Floats, tuple[int, ...]]:
        uu, vv = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        out = np.empty((uu.size, 4))
        flat_u, flat_v = np.ascontiguousarray(uu).ravel(), np.ascontiguousarray(vv).ravel()
        count, p = lookup_many(self._arrays, flat_u, flat_v, out)
        if count:
            raise OutsideTable(
                f"direction u = {flat_u[p]:.6g}, v = {flat_v[p]:.6g} is outside table '{self.name}': "
                f"allowed {self.limits}"
            )
        return out, uu.shape

    @property
    def limits(self) -> str:
        """The range of directions, in words."""
        if self.axisymmetric:
            return f"√(u² + v²) ≤ {self.u[-1]:.6g}"
        v = self._full[0]
        return f"u {self.u[0]:.6g} … {self.u[-1]:.6g}, v {v[0]:.6g} … {v[-1]:.6g}"

    def q(self, u: Any, v: Any) -> Floats:
        """Q (..., 3) at direction cosines u, v (broadcast)."""
        out, shape = self._look_up(u, v)
        return out[:, :3].reshape(*shape, 3)

    def absorptance(self, u: Any, v: Any) -> Floats:
        """Absorptance (...) at direction cosines u, v (broadcast)."""
        out, shape = self._look_up(u, v)
        return out[:, 3].reshape(shape)

    def gradient(self, u: Any, v: Any) -> Floats:
        """∂(q_g, q_r, q_n)/∂(u, v) (..., 3, 2) at direction cosines u, v of a table that is not axisymmetric."""
        if self.axisymmetric:
            raise InputError(f"table '{self.name}' is axisymmetric: gradient is not defined in u, v")
        self._look_up(u, v)
        uu, vv = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        out = np.empty((uu.size, 4, 2))
        _gradient_many(self._arrays, uu.ravel(), vv.ravel(), out)
        return out[:, :3].reshape(*uu.shape, 3, 2)

    def write(self, path: str | Path) -> None:
        """Write the table as netCDF-4/HDF5, atomically."""
        data = xr.Dataset(
            {
                "q": (("component", "u", "v"), self.q_nodes, {"units": "1", "long_name": "force × c / incident power"}),
                "absorptance": (("u", "v"), self.absorptance_nodes, {"units": "1"}),
                "error": (("u", "v"), self.error, {"units": "1", "long_name": "estimated absolute error of q"}),
            },
            coords={
                "component": list(COMPONENTS),
                "u": ("u", self.u, {"long_name": "direction cosine of incidence across the ridges"}),
                "v": ("v", self.v, {"long_name": "direction cosine of incidence along the ridges"}),
            },
            attrs={
                "schema": SCHEMA, "mirror_v": int(self.mirror_v), "axisymmetric": int(self.axisymmetric),
                "digest": self.digest, **{key: _encode(value) for key, value in self.attrs.items()},
            },
        )
        with atomic(path) as temporary:
            data.to_netcdf(temporary, engine="h5netcdf")

    @property
    def digest(self) -> str:
        """SHA-256 of the numbers and of what they belong to, to notice an edited file."""
        belongs = [self.mirror_v, self.axisymmetric, self.name, self.attrs.get("wavelength_m")]
        sums = hashlib.sha256(json.dumps(belongs).encode())
        for array in (self.u, self.v, self.q_nodes, self.absorptance_nodes, self.error):
            sums.update(np.ascontiguousarray(array, "<f8").tobytes())
        return sums.hexdigest()

    @classmethod
    def read(cls, path: str | Path) -> PressureTable:
        """The table in a file; InputError says why a missing, foreign, truncated or edited file is refused."""
        if not os.path.exists(path):
            raise InputError(f"{path}: no such pressure table; make it with optics.modal, fdtd or thin_film")
        try:
            with xr.open_dataset(path, engine="h5netcdf", decode_cf=False) as data:
                data.load()
        except Exception as refusal:
            raise InputError(f"{path}: not a readable HDF5 table ({_one_line(refusal)})") from None
        for name in ("u", "v", "q", "absorptance", "error"):
            if name not in data.variables:
                raise InputError(f"{path}: not a pressure table: '{name}' is missing")
        if str(data.attrs.get("schema")) != str(SCHEMA):
            raise InputError(f"{path}: schema = {data.attrs.get('schema')}: must be {SCHEMA}; make the table again")
        try:
            table = cls._from_dataset(data)
        except InputError as refusal:
            raise InputError(f"{path}: {refusal}") from None
        except (ValueError, TypeError) as refusal:
            raise InputError(f"{path}: not a pressure table ({_one_line(refusal)})") from None
        if table.digest != data.attrs.get("digest"):
            raise InputError(f"{path}: it was changed after it was made (digest differs); make it again")
        return table

    @classmethod
    def _from_dataset(cls, data: xr.Dataset) -> PressureTable:
        """The table in a data set; ValueError or TypeError where a number is none."""
        u, v, q, absorptance, error = (
            np.asarray(data[name].values, float) for name in ("u", "v", "q", "absorptance", "error")
        )
        attrs = {key: _decode(value) for key, value in data.attrs.items() if key not in ("schema", "digest")}
        mirror_v, axisymmetric = (bool(int(attrs.pop(name))) for name in ("mirror_v", "axisymmetric"))
        return cls(u, v, q, absorptance, error, mirror_v, axisymmetric, attrs)


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def _encode(value: Any) -> Any:
    """Attribute values: numbers and text as they are, anything nested as JSON text."""
    return value if isinstance(value, str | int | float) else json.dumps(value)


def _decode(value: Any) -> Any:
    if isinstance(value, str) and value[:1] in ("{", "["):
        return json.loads(value)
    return value.item() if isinstance(value, np.generic) else value
