"""The response of a cell around normal incidence: all of its optics that linear stability asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from optics.table.hermite import slope_matrix
from optics.table.pressure_table import PressureTable

# Direction cosine over which the errors of a table vary, as resonances shift: a table that errs by e has slopes that
# err by e over this much.
ERROR_SCALE = float(np.sin(np.radians(5.0)))
NEAR = 0.02
ATTRIBUTE = "normal_incidence"
# Ridges look the same both ways along themselves: q_g and q_n are even in v, q_r is odd: these slopes may not be 0.
ALLOWED = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])


@dataclass(frozen=True)
class NormalResponse:
    """q (3,) and its gradient (3, 2) over (u, v) at u = v = 0, rows g, r, n, with their absolute errors, alike."""

    q: Floats
    gradient: Floats
    q_error: Floats
    gradient_error: Floats

    def as_dict(self) -> dict[str, Any]:
        """The numbers as lists, for an attribute of a table."""
        return {name: values.tolist() for name, values in vars(self).items()}


def constant_response(reflectance: float, absorptance: float) -> NormalResponse:
    """Of a mirror that reflects and absorbs fixed fractions, F = (P/c)(2R (k·n) n + a k): exact."""
    slopes = absorptance * np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    return NormalResponse(np.array([0.0, 0.0, 2.0 * reflectance + absorptance]), slopes, np.zeros(3), np.zeros((3, 2)))


def table_response(table: PressureTable) -> NormalResponse:
    """Of the cell of a table: as its solver noted it, else from the table's own slopes and errors.

    The error of a slope is then that of the table over `ERROR_SCALE`, plus half the step of a kink at the origin. Of
    q_r = v a it is at most that of an absorptance twice as large or none: momentum along the ridges is lost to
    absorption alone. InputError where the cell has no slopes, at a Rayleigh cut-off.
    """
    noted = table.attrs.get(ATTRIBUTE)
    if noted is not None:
        found = NormalResponse(*(np.array(noted[name], float) for name in NormalResponse.__dataclass_fields__))
        if not np.all(np.isfinite(found.gradient)):
            raise InputError(f"table '{table.name}': an order grazes at normal incidence, where q has no slope")
        return found
    error = _error_near(table)
    slope_error = error / ERROR_SCALE * ALLOWED
    slope_error[1, 1] = min(slope_error[1, 1], abs(float(table.absorptance(0.0, 0.0))))
    q_error = error * np.array([0.0 if table.axisymmetric else 1.0, 0.0, 1.0])
    if table.film is not None:
        # q_t = a k_t and q_n even in it: no samples, which may be far apart on the scale of fringes, are asked.
        allowed = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
        slopes = float(table.absorptance(0.0, 0.0)) * allowed
        return NormalResponse(table.q(0.0, 0.0), slopes, q_error, error * allowed)
    if table.axisymmetric:
        slope = float(slope_matrix(table.u)[0] @ table.q_nodes[0, :, 0])
        kink = np.zeros((3, 2))
        kink[2] = np.abs(_one_sided(table.u, lambda s: table.q(s, 0.0))[2])
        allowed = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
        slope_error = error / ERROR_SCALE * allowed
        return NormalResponse(table.q(0.0, 0.0), slope * allowed, q_error, slope_error + kink)
    v = np.unique([*table.v, *-table.v]) if table.mirror_v else table.v
    kinks = np.stack([_kink(table.u, lambda u: table.q(u, 0.0)), _kink(v, lambda v: table.q(0.0, v))], axis=1)
    return NormalResponse(table.q(0.0, 0.0), table.gradient(0.0, 0.0) * ALLOWED, q_error, slope_error + kinks)


def _error_near(table: PressureTable) -> float:
    """Largest error estimated next to normal incidence."""
    near = (np.abs(table.u) <= NEAR)[:, None] & (np.abs(table.v) <= NEAR)[None, :]
    near[np.abs(table.u).argmin(), np.abs(table.v).argmin()] = True
    return float(table.error[near].max())


def _one_sided(nodes: Floats, values: Callable[[Floats], Floats]) -> Floats:
    """Derivative (3,) at 0 of the parabola through the three nodes ≥ 0 that are nearest (fewer: a line, or none)."""
    x = nodes[nodes >= 0.0][:3]
    if x.size < 2:
        return np.zeros(3)
    return np.asarray(np.polyfit(x, values(x), x.size - 1)[-2])


def _kink(nodes: Floats, values: Callable[[Floats], Floats]) -> Floats:
    """Half the step (3,) of the derivative across 0: of third order in the spacing of a smooth response."""
    right = _one_sided(nodes, values)
    left = -_one_sided(-nodes[::-1], lambda x: values(-x))
    return np.abs(right - left) / 2.0
