"""One row of numbers about the whole sail, for the series of the flight file."""

from __future__ import annotations

import math
from itertools import accumulate

from beamrider.arrays import Floats
from beamrider.machine_code.standalone import standalone
from beamrider.machine_code.streams import streams, uncounted
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects import failure, tearing, tethers
from dynamics.membrane.effects.composition import columns_from, writing
from dynamics.membrane.layout.triangles import total
from dynamics.membrane.state import State

#: Columns of the motion, with their length and unit. `fit` is Σ m (x − c) X₀ᵀ (3, 3); `angular_momentum`, `inertia`
#: (xx, yy, zz, xy, xz, yz) are about the centre of mass; `impulse` is the time integral of the optical force since the
#: start.
MOTION = {
    "time": (1, "s"),
    "position": (3, "m"),
    "velocity": (3, "m/s"),
    "impulse": (3, "N s"),
    "energy_kinetic": (1, "J"),
    "fit": (9, "kg m²"),
    "angular_momentum": (3, "kg m²/s"),
    "inertia": (6, "kg m²"),
}
#: Length and unit of each column of a row: of the motion, then of the effects, which say what they are.
SIZES = columns_from(MOTION)
_STARTS = [*accumulate((length for length, _ in SIZES.values()), initial=0)]
#: Where each column of a row begins, and how many numbers a row has.
COLUMNS, WIDTH = dict(zip(SIZES, _STARTS, strict=False)), _STARTS[-1]

TIME, POSITION, VELOCITY, IMPULSE, KINETIC, FIT, SPIN, INERTIA = (COLUMNS[name] for name in MOTION)
_write_effects = writing(sum(length for length, _ in MOTION.values()))


@uncounted()
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
    centre(masses, x, row[POSITION : POSITION + 3])
    centre(masses, v, row[VELOCITY : VELOCITY + 3])
    for i in range(masses.size):
        m = masses[i]
        d0, d1, d2 = x[0, i] - row[POSITION], x[1, i] - row[POSITION + 1], x[2, i] - row[POSITION + 2]
        w0, w1, w2 = v[0, i] - row[VELOCITY], v[1, i] - row[VELOCITY + 1], v[2, i] - row[VELOCITY + 2]
        for c in range(3):
            r = m * rest[c, i]
            row[FIT + c] += d0 * r
            row[FIT + 3 + c] += d1 * r
            row[FIT + 6 + c] += d2 * r
        row[SPIN] += m * (d1 * w2 - d2 * w1)
        row[SPIN + 1] += m * (d2 * w0 - d0 * w2)
        row[SPIN + 2] += m * (d0 * w1 - d1 * w0)
        row[INERTIA] += m * (d1 * d1 + d2 * d2)
        row[INERTIA + 1] += m * (d0 * d0 + d2 * d2)
        row[INERTIA + 2] += m * (d0 * d0 + d1 * d1)
        row[INERTIA + 3] -= m * d0 * d1
        row[INERTIA + 4] -= m * d0 * d2
        row[INERTIA + 5] -= m * d1 * d2
        row[KINETIC] += 0.5 * m * (v[0, i] * v[0, i] + v[1, i] * v[1, i] + v[2, i] * v[2, i])


@standalone(_nrt=False)
def write_row(model: Model, state: State, work: WorkSpace, n: int, row: Floats) -> int:
    """One row (WIDTH,), longer with a payload, about the state at step n; INTACT, FLY_AWAY, BROKEN or NON_FINITE."""
    for i in range(row.size):
        row[i] = 0.0
    row[TIME] = (n - model.release) * model.dt
    motion(model.masses, model.rest, state.x, state.v, row)
    for c in range(3):
        row[IMPULSE + c] = state.impulse[c]
    _write_effects(model, work, state, row[POSITION : POSITION + 3], row)
    if row.size > WIDTH:
        tethers.note(work.effects.tethers, row[WIDTH:])
    for i in range(row.size):
        if not math.isfinite(row[i]):
            return failure.NON_FINITE
    if tearing.failures(work.effects.tearing) > model.effects.tearing.most:
        return failure.BROKEN
    away = math.hypot(row[POSITION], row[POSITION + 1])
    return failure.FLY_AWAY if away > model.fly_away else failure.INTACT


@uncounted()
def write_due(
    model: Model, state: State, work: WorkSpace, n: int, fresh: bool, rows: Floats, written: int
) -> tuple[int, int]:
    """A row of rows (k, WIDTH) about the state at step n, if one is due; (failure code, rows written).

    At the release it is due once: `fresh`, with the light on.
    """
    due = (n - model.release) % model.series_every == 0 or n == model.end
    if not due or (n == model.release and not fresh):
        return failure.INTACT, written
    return write_row(model, state, work, n, rows[written]), written + 1


@uncounted()
def write_last(model: Model, state: State, work: WorkSpace, n: int, code: int, rows: Floats, written: int) -> int:
    """Rows of (k, WIDTH) written, with one about the state that failed at step n, unless it has one or is no number."""
    if code in (failure.INTACT, failure.FLY_AWAY, failure.BROKEN, failure.NON_FINITE):
        return written
    return written + (write_row(model, state, work, n, rows[written]) != failure.NON_FINITE)
