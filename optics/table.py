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
from typing import Any, NamedTuple

import numba
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from optics.files import InputError, atomic

Floats = NDArray[np.float64]

SCHEMA = 1
COMPONENTS = ("g", "r", "n")
_BUCKETS_PER_NODE = 4


class OutsideTable(InputError):
    """A direction was asked for that the table does not hold."""


class TableArrays(NamedTuple):
    """Plain arrays of a table for compiled kernels; see `lookup`.

    u (n_u), v (n_v): ascending nodes. bucket_u, bucket_v: node at or left of the start of each of the equal buckets.
    coefficients (n_u, n_v, 4, 4): for q_g, q_r, q_n and absorptance the value and its ∂u, ∂v, ∂u∂v.
    axisymmetric: v is collapsed, u is the sine of the angle of incidence. nearest: return the nearest node's value.
    """

    u: Floats
    v: Floats
    bucket_u: NDArray[np.int64]
    bucket_v: NDArray[np.int64]
    coefficients: Floats
    axisymmetric: bool
    nearest: bool


@numba.njit(cache=True, inline="always")
def _locate(nodes: Floats, buckets: NDArray[np.int64], x: float) -> int:
    """Index i of the interval nodes[i] ≤ x ≤ nodes[i + 1]; x must lie within the nodes."""
    span = nodes[-1] - nodes[0]
    b = min(max(int((x - nodes[0]) / span * buckets.size), 0), buckets.size - 1)
    i = buckets[b]
    while i < nodes.size - 2 and x >= nodes[i + 1]:
        i += 1
    while i > 0 and x < nodes[i]:
        i -= 1
    return i


@numba.njit(cache=True, inline="always")
def _hermite(s: float, h: float) -> tuple[float, float, float, float]:
    """Cubic Hermite weights of (value left, value right, slope left, slope right) at s in [0, 1] of a step h."""
    r = 1.0 - s
    return (1.0 + 2.0 * s) * r * r, s * s * (3.0 - 2.0 * s), h * s * r * r, -h * s * s * r


@numba.njit(cache=True, inline="always")
def _hermite_slope(s: float, h: float) -> tuple[float, float, float, float]:
    """Derivatives of the `_hermite` weights by x."""
    r = 1.0 - s
    return -6.0 * s * r / h, 6.0 * s * r / h, r * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)


@numba.njit(cache=True, inline="always")
def _patch(
    c: Floats, i: int, j: int, k: int,
    a: tuple[float, float, float, float], b: tuple[float, float, float, float],
) -> float:
    """Tensor Hermite sum of quantity k over the patch (i, j) with weights a along u and b along v."""
    total = 0.0
    for p in range(2):
        for q in range(2):
            f = c[i + p, j + q, k]
            total += a[p] * (b[q] * f[0] + b[q + 2] * f[2]) + a[p + 2] * (b[q] * f[1] + b[q + 2] * f[3])
    return total


@numba.njit(cache=True)
def _lookup_plain(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """(q_g, q_r, q_n, absorptance, inside) on the (u, v) grid itself, clamped to its edge when outside."""
    uu = min(max(u, t.u[0]), t.u[-1])
    vv = min(max(v, t.v[0]), t.v[-1])
    inside = uu == u and vv == v
    i = _locate(t.u, t.bucket_u, uu)
    j = _locate(t.v, t.bucket_v, vv)
    hu = t.u[i + 1] - t.u[i]
    hv = t.v[j + 1] - t.v[j]
    s = (uu - t.u[i]) / hu
    r = (vv - t.v[j]) / hv
    c = t.coefficients
    if t.nearest:
        f = c[i + (1 if s > 0.5 else 0), j + (1 if r > 0.5 else 0)]
        return f[0, 0], f[1, 0], f[2, 0], f[3, 0], inside
    a = _hermite(s, hu)
    b = _hermite(r, hv)
    q_g, q_r, q_n = _patch(c, i, j, 0, a, b), _patch(c, i, j, 1, a, b), _patch(c, i, j, 2, a, b)
    return q_g, q_r, q_n, _patch(c, i, j, 3, a, b), inside


@numba.njit(cache=True)
def lookup(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """(q_g, q_r, q_n, absorptance, inside) of one direction; outside the table the edge value with inside = False."""
    if not t.axisymmetric:
        return _lookup_plain(t, u, v)
    s = np.sqrt(u * u + v * v)
    along, _, q_n, a, inside = _lookup_plain(t, s, 0.0)
    if s == 0.0:
        return 0.0, 0.0, q_n, a, inside
    return along * u / s, along * v / s, q_n, a, inside


@numba.njit(cache=True)
def lookup_gradient(t: TableArrays, u: float, v: float, out: Floats) -> bool:
    """Write ∂(q_g, q_r, q_n, absorptance)/∂(u, v) into out (4, 2); returns inside. Not for axisymmetric tables."""
    uu = min(max(u, t.u[0]), t.u[-1])
    vv = min(max(v, t.v[0]), t.v[-1])
    i = _locate(t.u, t.bucket_u, uu)
    j = _locate(t.v, t.bucket_v, vv)
    hu = t.u[i + 1] - t.u[i]
    hv = t.v[j + 1] - t.v[j]
    s = (uu - t.u[i]) / hu
    r = (vv - t.v[j]) / hv
    a = _hermite(s, hu)
    b = _hermite(r, hv)
    da = _hermite_slope(s, hu)
    db = _hermite_slope(r, hv)
    for k in range(4):
        out[k, 0] = _patch(t.coefficients, i, j, k, da, b)
        out[k, 1] = _patch(t.coefficients, i, j, k, a, db)
    return bool(uu == u and vv == v)


@numba.njit(cache=True)
def _lookup_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> None:
    for p in range(u.size):
        g, r, n, a, inside = lookup(t, u[p], v[p])
        out[p, 0], out[p, 1], out[p, 2], out[p, 3], out[p, 4] = g, r, n, a, 1.0 if inside else 0.0


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
        c = np.stack([f, f_u, f @ dv.T, f_u @ dv.T], axis=-1)
        return TableArrays(
            np.ascontiguousarray(self.u), np.ascontiguousarray(v), _buckets(self.u), _buckets(v),
            np.ascontiguousarray(np.moveaxis(c, 0, 2)), self.axisymmetric, nearest,
        )

    @cached_property
    def _arrays(self) -> TableArrays:
        return self.arrays()

    def _look_up(self, u: Any, v: Any) -> tuple[Floats, tuple[int, ...]]:
        uu, vv = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        out = np.empty((uu.size, 5))
        _lookup_many(self._arrays, uu.ravel(), vv.ravel(), out)
        bad = np.flatnonzero(out[:, 4] == 0)
        if bad.size:
            p = bad[0]
            raise OutsideTable(
                f"direction u = {uu.ravel()[p]:.6g}, v = {vv.ravel()[p]:.6g} is outside table '{self.name}': "
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
        """SHA-256 of the numbers, to notice an edited file."""
        sums = hashlib.sha256()
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
            raise InputError(f"{path}: not a readable HDF5 table ({type(refusal).__name__}: {refusal})") from None
        for name in ("u", "v", "q", "absorptance", "error"):
            if name not in data.variables:
                raise InputError(f"{path}: not a pressure table: '{name}' is missing")
        if int(data.attrs.get("schema", -1)) != SCHEMA:
            raise InputError(f"{path}: schema = {data.attrs.get('schema')}: must be {SCHEMA}; make the table again")
        attrs = dict(data.attrs)
        flags = {name: bool(attrs.pop(name, 0)) for name in ("mirror_v", "axisymmetric")}
        digest = attrs.pop("digest", "")
        del attrs["schema"]
        u, v, q, absorptance, error = (
            np.asarray(data[name].values, float) for name in ("u", "v", "q", "absorptance", "error")
        )
        try:
            table = cls(
                u, v, q, absorptance, error, flags["mirror_v"], flags["axisymmetric"],
                {key: _decode(value) for key, value in attrs.items()},
            )
        except InputError as refusal:
            raise InputError(f"{path}: {refusal}") from None
        if table.digest != digest:
            raise InputError(f"{path}: numbers were changed after it was made (digest differs); make it again")
        return table


def _encode(value: Any) -> Any:
    """Attribute values: numbers and text as they are, anything nested as JSON text."""
    return value if isinstance(value, str | int | float) else json.dumps(value)


def _decode(value: Any) -> Any:
    if isinstance(value, str) and value[:1] in ("{", "["):
        return json.loads(value)
    return value.item() if isinstance(value, np.generic) else value
