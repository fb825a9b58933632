"""One row of numbers about the whole sail, for the series of the flight file."""

from __future__ import annotations

import math

import numba
import numpy as np

from beamrider.arrays import Floats
from dynamics.membrane.arrays import Model, Work
from dynamics.membrane.effects import failure, reflections, sheet, tearing, tethers, thermal
from dynamics.membrane.effects import springs as elastic
from dynamics.membrane.effects.light_pressure import Light, LightWork, force
from dynamics.membrane.layout import rows as stencil
from dynamics.membrane.layout.rows import Stencil
from dynamics.membrane.layout.streams import streams
from dynamics.membrane.layout.triangles import Triangles, total
from dynamics.membrane.state import State

#: Where each quantity of a row starts. `fit` is Σ m (x − c) X₀ᵀ (3, 3); `angular_momentum`, `inertia` (xx, yy, zz, xy,
#: xz, yz) are about the centre of mass; `impulse` is the time integral of the optical force since the start;
#: `power_reflected` leaves the sail in traced rays, 0 where reflections are off. Temperatures are those of the nodes,
#: which failure tests; `temperature_max_triangles` (published) is the largest mean of three corners.
COLUMNS = {
    "time": 0, "position": 1, "velocity": 4, "fit": 7, "angular_momentum": 16, "inertia": 19, "temperature_max": 25,
    "temperature_min": 26, "temperature_mean": 27, "strain_max": 28, "strain_min": 29, "energy_kinetic": 30,
    "energy_elastic": 31, "power_incident": 32, "power_absorbed": 33, "power_radiated": 34, "force": 35, "torque": 38,
    "impulse": 41, "outside_table": 44, "power_reflected": 45, "failed_tensile": 46,
    "failed_thermal": 47, "temperature_max_triangles": 48,
}
WIDTH = 49


@numba.njit(cache=True, error_model="numpy")
def centre(masses: Floats, values: Floats, out: Floats) -> None:
    """Out (3,) = mass-weighted mean of values (3, n)."""
    whole = total(masses, masses.size)
    for c in range(3):
        s = 0.0
        for i in range(masses.size):
            s += masses[i] * values[c, i]
        out[c] = s / whole


@streams()
def motion(masses: Floats, rest: Floats, x: Floats, v: Floats, row: Floats) -> None:
    """Centre of mass, its velocity, fit, angular momentum, inertia and kinetic energy into row (WIDTH,) of zeros."""
    centre(masses, x, row[1:4])
    centre(masses, v, row[4:7])
    for i in range(masses.size):
        m = masses[i]
        d0, d1, d2 = x[0, i] - row[1], x[1, i] - row[2], x[2, i] - row[3]
        w0, w1, w2 = v[0, i] - row[4], v[1, i] - row[5], v[2, i] - row[6]
        for c in range(3):
            r = m * rest[c, i]
            row[7 + c] += d0 * r
            row[10 + c] += d1 * r
            row[13 + c] += d2 * r
        row[16] += m * (d1 * w2 - d2 * w1)
        row[17] += m * (d2 * w0 - d0 * w2)
        row[18] += m * (d0 * w1 - d1 * w0)
        row[19] += m * (d1 * d1 + d2 * d2)
        row[20] += m * (d0 * d0 + d2 * d2)
        row[21] += m * (d0 * d0 + d1 * d1)
        row[22] -= m * d0 * d1
        row[23] -= m * d0 * d2
        row[24] -= m * d1 * d2
        row[30] += 0.5 * m * (v[0, i] * v[0, i] + v[1, i] * v[1, i] + v[2, i] * v[2, i])


@numba.njit(cache=True, error_model="numpy")
def warmth(triangles: Triangles, temperature: Floats, row: Floats) -> None:
    """Largest, smallest and mass-weighted mean temperature of the nodes, and the largest of the triangles' means, K."""
    row[25], row[26], row[48] = -np.inf, np.inf, -np.inf
    for i in range(temperature.size):
        row[25] = max(row[25], temperature[i])
        row[26] = min(row[26], temperature[i])
    corners, masses = triangles.corners, triangles.masses
    for i in range(masses.size):
        mean = (temperature[corners[0, i]] + temperature[corners[1, i]] + temperature[corners[2, i]]) / 3.0
        row[48] = max(row[48], mean)
        row[27] += masses[i] * mean
    row[27] /= total(masses, masses.size)


@streams()
def push(light: Light, layout: Stencil, held: Floats, x: Floats, gain: float, row: Floats) -> None:
    """Optical force in N and its torque about the centre of mass in N m, a third at each corner, of the held light."""
    corners, third = light.corners, gain / 3.0
    for i in range(corners.shape[1]):
        p, q, s = corners[0, i], corners[1, i], corners[2, i]
        f0, f1, f2 = force(light, layout, held, x, i)
        f0, f1, f2 = third * f0, third * f1, third * f2
        d0 = x[0, p] + x[0, q] + x[0, s] - 3.0 * row[1]
        d1 = x[1, p] + x[1, q] + x[1, s] - 3.0 * row[2]
        d2 = x[2, p] + x[2, q] + x[2, s] - 3.0 * row[3]
        row[35] += 3.0 * f0
        row[36] += 3.0 * f1
        row[37] += 3.0 * f2
        row[38] += d1 * f2 - d2 * f1
        row[39] += d2 * f0 - d0 * f2
        row[40] += d0 * f1 - d1 * f0


@numba.njit(cache=True, error_model="numpy")
def illumination(
    light: Light, work: LightWork, layout: Stencil, held: Floats, x: Floats, gain: float, row: Floats
) -> None:
    """Incident and absorbed power in W, force and torque of the light at ramp `gain`."""
    size = light.corners.shape[1]
    row[32] = gain * total(work.incident, size)
    row[33] = gain * total(work.absorbed, size)
    row[44] = work.outside[0]
    push(light, layout, held, x, gain, row)


@numba.njit(cache=True, error_model="numpy")
def write_row(model: Model, state: State, work: Work, n: int, row: Floats) -> int:
    """One row (WIDTH,), longer for a payload, about the state at step n; INTACT, FLY_AWAY or NON_FINITE."""
    layout, corners, patch = model.stencil, model.triangles.corners, stencil.patch(work.stencil.scratch, 0)
    for i in range(row.size):
        row[i] = 0.0
    row[0] = (n - model.release) * model.dt
    motion(model.masses, model.rest, state.x, state.v, row)
    if model.sheet.modulus.size > 0:
        row[28], row[29], row[31] = sheet.strain_and_energy(
            model.sheet, work.sheet, layout, work.stencil.free, corners, state.x, patch
        )
    else:
        row[28], row[29], row[31] = elastic.strain_and_energy(model.springs, state.x, work.free)
    if model.warm:
        warmth(model.triangles, state.temperature, row)
        row[34] = thermal.radiated(
            work.heat.emission, state.x, corners, patch, state.temperature, model.heat.background
        )
    if work.gain[0] > 0.0:
        illumination(model.light, work.light, layout, work.stencil.held, state.x, work.gain[0], row)
        row[45] = work.gain[0] * work.mirror.account[reflections.LEAVES]
    for c in range(3):
        row[41 + c] = state.impulse[c]
    row[44] = work.light.outside[0]
    if row.size > WIDTH:
        tethers.note(work.tethers, row[WIDTH:])
    row[46], row[47] = work.broken.tally[tearing.BY_STRESS], work.broken.tally[tearing.BY_HEAT]
    for i in range(row.size):
        if not math.isfinite(row[i]):
            return failure.NON_FINITE
    if row[46] + row[47] > model.most_broken:
        return failure.BROKEN
    return failure.FLY_AWAY if math.hypot(row[1], row[2]) > model.fly_away else failure.INTACT


@numba.njit(cache=True, error_model="numpy")
def write_due(
    model: Model, state: State, work: Work, n: int, fresh: bool, rows: Floats, written: int
) -> tuple[int, int]:
    """A row about the state at step n after the `written` ones, if one is due; (failure code, rows written).

    At the release it is due once: `fresh`, with the light on.
    """
    due = (n - model.release) % model.series_every == 0 or n == model.end
    if not due or (n == model.release and not fresh):
        return failure.INTACT, written
    return write_row(model, state, work, n, rows[written]), written + 1


@numba.njit(cache=True, error_model="numpy")
def write_last(model: Model, state: State, work: Work, n: int, code: int, rows: Floats, written: int) -> int:
    """Rows written, with one about the state that failed at step n, unless it has one or its numbers failed."""
    if code in (failure.INTACT, failure.FLY_AWAY, failure.BROKEN, failure.NON_FINITE):
        return written
    return written + (write_row(model, state, work, n, rows[written]) != failure.NON_FINITE)
