"""Part files of the FDTD stage: rows of solved directions, kept as they come, and merged into a pressure table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import Akima1DInterpolator, BarycentricInterpolator

from beamrider.arrays import Floats
from beamrider.io.files import InputError, Strict, reading, versions
from beamrider.io.hdf5 import new_hdf5, read_hdf5, real
from optics.cells.outline import Grating
from optics.fdtd.grid import TABLE, FdtdSettings, step_of_time
from optics.fdtd.medium import fit_error
from optics.refinement.directions import fill
from optics.table.pressure_table import PressureTable
from optics.table.promise import promised
from optics.waves.incidence import cutoffs

_COLUMNS = (
    "u",
    "v",
    "q_g",
    "q_r",
    "q_n",
    "absorptance",
    "error",
    "energy_imbalance",
    "stress",
    "residual",
    "capped",
    "seconds",
    "grazing",
    "finest",
)
_U_SPACING, _V_SPACING = 0.0025, 0.0075


class Solved(Protocol):
    """What a row needs to know of a solved direction (see `optics.fdtd.direction.DirectionResult`)."""

    @property
    def q(self) -> Floats: ...  # noqa: D102
    @property
    def absorptance(self) -> float: ...  # noqa: D102
    @property
    def error(self) -> float: ...  # noqa: D102
    @property
    def energy_imbalance(self) -> float: ...  # noqa: D102
    @property
    def stress(self) -> float: ...  # noqa: D102
    @property
    def residual(self) -> float: ...  # noqa: D102
    @property
    def capped(self) -> bool: ...  # noqa: D102
    @property
    def seconds(self) -> float: ...  # noqa: D102
    @property
    def grazing(self) -> float: ...  # noqa: D102
    @property
    def resolutions(self) -> tuple[float, ...]: ...  # noqa: D102


@dataclass(frozen=True)
class Rows:
    """Solved directions: values (n, 14) in the order of the columns."""

    values: Floats

    @classmethod
    def empty(cls) -> Rows:
        """No row yet."""
        return cls(np.zeros((0, len(_COLUMNS))))

    def column(self, name: str) -> Floats:
        """One column (n,)."""
        return np.asarray(self.values[:, _COLUMNS.index(name)])

    def find(self, u: float, v: float) -> int | None:
        """Index of the row of a direction."""
        at = np.flatnonzero((np.abs(self.values[:, 0] - u) < 1e-12) & (np.abs(self.values[:, 1] - v) < 1e-12))
        return int(at[0]) if at.size else None

    def added(self, u: float, v: float, solved: Solved) -> Rows:
        """With one more row."""
        row = [
            u,
            v,
            *solved.q,
            solved.absorptance,
            solved.error,
            solved.energy_imbalance,
            solved.stress,
            solved.residual,
            float(solved.capped),
            solved.seconds,
            solved.grazing,
            solved.resolutions[-1],
        ]
        return Rows(np.vstack([self.values, row]))

    def selected(self, directions: Floats) -> Rows:
        """The rows of `directions` (n, 2) in that order; InputError names the first that is missing."""
        found = [self.find(u, v) for u, v in directions]
        for (u, v), at in zip(directions, found, strict=True):
            if at is None:
                raise InputError(f"direction u = {u:.6g}, v = {v:.6g} is in none of the part files")
        return Rows(self.values[np.array(found, int)])


def block(u: Floats, v: Floats, i: int, n: int) -> Floats:
    """The i-th of n blocks (1 ≤ i ≤ n) of the directions u × v, (k, 2): every n-th one, so that all cost the same."""
    directions = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    order = np.lexsort((directions[:, 0], directions[:, 1]))  # in-plane directions, which are cheap, first
    return directions[order][i - 1 :: n]


def _stamp(cell: Grating, settings: Strict) -> dict[str, str]:
    """What rows must have in common to be kept or merged."""
    return {
        "cell": json.dumps(cell.model_dump(), sort_keys=True),
        "settings": json.dumps(settings.model_dump(mode="json"), sort_keys=True),
    }


def write_rows(path: Path, cell: Grating, settings: Strict, rows: Rows) -> None:
    """Write a part file, atomically: a killed stage leaves the rows it had."""
    with new_hdf5(path) as file:
        for name in _COLUMNS:
            file[name] = rows.column(name)
        file.attrs.update(_stamp(cell, settings))


def read_rows(path: Path, cell: Grating, settings: Strict) -> Rows:
    """The rows of a part file; InputError where it is none, or is of another cell or other settings."""
    if not path.exists():
        raise InputError(f"{path}: no such part file; make it with python -m optics.fdtd --part")
    with reading(path, "a readable part file"), read_hdf5(path) as file:
        values = np.stack([real(file[name]) for name in _COLUMNS], axis=-1).reshape(-1, len(_COLUMNS))
        stamp = {name: str(file.attrs.get(name)) for name in ("cell", "settings")}
    for name, text in _stamp(cell, settings).items():
        if stamp[name] != text:
            raise InputError(f"{path}: holds rows of other '{name}' than asked for; remove it or choose another --out")
    if not np.all(np.isfinite(values)):
        raise InputError(f"{path}: holds values that are not finite; make it again")
    return Rows(values)


def _interpolation_error(u_nodes: Floats, q: Floats, u: Floats) -> Floats:
    """Difference (n_u, n_v) of two interpolants along u, a cubic spline and Akima's: how much the nodes leave open."""
    spline = fill(u_nodes, np.zeros(1), q.reshape(u_nodes.size, 1, -1), u, np.zeros(1))[:, 0]
    akima = Akima1DInterpolator(u_nodes, q.reshape(u_nodes.size, -1))(u)
    return np.asarray(np.abs(spline - akima).reshape(u.size, *q.shape[1:]).max(axis=-1))


def _dense(nodes: Floats, spacing: float) -> Floats:
    count = max(nodes.size, 1 + int(np.ceil((nodes[-1] - nodes[0]) / spacing)))
    return np.linspace(nodes[0], nodes[-1], count)


def merge(
    cell: Grating,
    settings: FdtdSettings,
    u_nodes: Floats,
    v_nodes: Floats,
    between: float | None,
    parts: Sequence[Path],
) -> PressureTable:
    """The pressure table, with its promise, from part files that together hold all of u_nodes (n,) × v_nodes (m,).

    Its error is that of the nodes (the largest of those around) plus the interpolation's: along u as the nodes show it,
    and no less than `between`, what was found when they were chosen; where that is not known, what the nodes in v show.
    """
    everything = Rows(np.concatenate([read_rows(part, cell, settings).values for part in parts]))
    directions = np.stack(np.meshgrid(u_nodes, v_nodes, indexing="ij"), axis=-1).reshape(-1, 2)
    rows = everything.selected(directions)
    shape = (u_nodes.size, v_nodes.size)
    node_values = np.stack([rows.column(name).reshape(shape) for name in ("q_g", "q_n", "absorptance")], axis=-1)
    u, v = _dense(u_nodes, _U_SPACING), _dense(v_nodes, _V_SPACING)
    q_g, q_n, absorptance = np.moveaxis(fill(u_nodes, v_nodes, node_values, u, v), -1, 0)
    known = _error_along_v(v_nodes, node_values[..., :2]) if between is None else between
    interpolated = np.maximum(_along_v(v_nodes, _interpolation_error(u_nodes, node_values[..., :2], u), v), known)
    fit = fit_error(cell, step_of_time(cell, settings))
    error = _nearby(u_nodes, v_nodes, rows.column("error").reshape(shape), u, v) + interpolated + fit
    q = np.stack([q_g, v * absorptance, q_n])
    attrs = _attrs(cell, settings, rows, u_nodes, v_nodes) | {
        "interpolation_error": float(interpolated.max()),
        "permittivity_error": fit,
    }
    table = PressureTable(u, v, q, absorptance, error, mirror_v=True, attrs=attrs)
    return promised(table, TABLE * settings.tolerance, _causes(settings, rows, interpolated))


def _causes(settings: FdtdSettings, rows: Rows, interpolated: Floats) -> list[str]:
    """What kept the error above the tolerance."""
    errors, found = rows.column("error"), []
    if (above := errors > settings.tolerance).any():
        found.append(
            f"slow convergence: {above.sum()} of {above.size} directions stand at {errors.max():.2g} with "
            f"{rows.column('finest')[above].max():.3g} pixels per wavelength in the densest material"
        )
    if (capped := rows.column("capped") > 0).any():
        found.append(f"{capped.sum()} directions still ring after {settings.longest:g} periods")
    if interpolated.max() > (TABLE - 1) * settings.tolerance:
        found.append(f"directions too far apart: {interpolated.max():.2g} between them; make nodes for less")
    return found


def _error_along_v(v_nodes: Floats, values: Floats) -> float:
    """How far each inner node (or of two the last) is from the polynomial in v² through all others of (n_u, n_v, k)."""
    inner = range(1, v_nodes.size - 1) if v_nodes.size > 2 else [1]
    missed = []
    for i in inner:
        others = np.delete(values, i, axis=1), np.delete(v_nodes, i)
        guess = BarycentricInterpolator(others[1] ** 2, np.swapaxes(others[0], 0, 1), axis=0, rng=0)(v_nodes[i] ** 2)
        missed.append(np.abs(guess - values[:, i]).max())
    return float(max(missed))


def _along_v(v_nodes: Floats, values: Floats, v: Floats) -> Floats:
    """Values (n_u, n_nodes) carried to v (n_v): the larger of the two neighbouring nodes'."""
    right = np.clip(np.searchsorted(v_nodes, v), 1, v_nodes.size - 1)
    return np.asarray(np.maximum(values[:, right - 1], values[:, right]))


def _nearby(u_nodes: Floats, v_nodes: Floats, error: Floats, u: Floats, v: Floats) -> Floats:
    """Largest error (n_u, n_v) of the four nodes around each point."""
    return _along_v(v_nodes, _along_v(u_nodes, error.T, u).T, v)


def _attrs(cell: Grating, settings: FdtdSettings, rows: Rows, u_nodes: Floats, v_nodes: Floats) -> dict[str, Any]:
    finest, counts = np.unique(rows.column("finest"), return_counts=True)
    return {
        "name": cell.name,
        "solver": "fdtd",
        "cell": cell.model_dump(),
        "wavelength_m": cell.wavelength_nm * 1e-9,
        "settings": settings.model_dump(mode="json")
        | {
            "tolerance": TABLE * settings.tolerance,
            "tolerance_of_a_direction": settings.tolerance,
        },
        "nodes_u": u_nodes.tolist(),
        "nodes_v": v_nodes.tolist(),
        "directions_by_pixels_per_wavelength": {f"{key:.3g}": int(n) for key, n in zip(finest, counts, strict=True)},
        "cutoffs": sorted(
            {
                x
                for n in (cell.surroundings.front, cell.surroundings.back)
                for x in cutoffs(cell.pitch, float(np.abs(u_nodes).max()), index=n)
            }
        ),
        "energy_imbalance": float(np.abs(rows.column("energy_imbalance")).max()),
        "stress_difference": float(rows.column("stress").max()),
        "capped": int(rows.column("capped").sum()),
        "residual": float(rows.column("residual").max()),
        "grazing": float(rows.column("grazing").min()),
        "cpu_seconds": float(rows.column("seconds").sum()),
        "versions": versions("numpy", "scipy", "h5py"),
    }
