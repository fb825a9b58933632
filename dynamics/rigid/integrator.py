"""Compiled flight of a rigid sail: adaptive steps, dense output at the rows asked for, events, knots of the ramp.

The explicit Runge–Kutta method of order 8(5,3) of Dormand & Prince with its dense output of order 7 (Hairer, Nørsett &
Wanner, Solving Ordinary Differential Equations I, §II.5, §II.6 and §II.10; "Hairer" below). SciPy keeps the tableau.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from beamrider.arrays import Floats
from beamrider.machine_code.standalone import standalone
from dynamics.rigid.equations import INSIDE, LIT_FROM_BEHIND, MOTION, STATE, Light, RigidSail, derivative, rotation
from dynamics.rigid.towing import moving, overload
from optics.table.pressure_table import TableArrays

Tables = tuple[TableArrays, ...]

STAGES = 12
# Rows: stages of the step, slope at its end, stages of the dense output; the sums that give each stage's state
A = np.zeros((16, 16))
A[:12, :12], A[12, :12], A[13:] = DOP853.A, DOP853.B, DOP853.A_EXTRA
C = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])
E3, E5, D = (np.array(getattr(DOP853, name)) for name in ("E3", "E5", "D"))

FLYING, FINISHED, FLY_AWAY, LEFT_TABLE, TURNED_OVER, NON_FINITE, STEP_TOO_SMALL, TOO_MANY_STEPS = range(8)
T, H, T_OLD, SPAN = range(4)  # of `clock`
REASON, STEPS, EVALUATIONS, REJECTED, CLAMPED, ROW, KNOT, FRESH, DENSE, BAD = range(10)  # of `counts`
_SCAN = 16  # places within a step where an event is looked for
_LOOKS = 4  # places within a step where tethers are looked at


class Terms(NamedTuple):
    """What governs a flight, in normalised units.

    tolerance: relative and absolute. limit: distance from the axis that ends the flight. clamp: fly on outside a table.
    most_steps: after which a flight is given up. stops (n,): ends of the smooth pieces, the end of the flight last.
    rows (n,): ascending times of the output.
    """

    tolerance: float
    limit: float
    clamp: bool
    most_steps: int
    stops: Floats
    rows: Floats


class Work(NamedTuple):
    """All that a flight knows, so that it may be flown in portions: same bits, however it is cut.

    clock: time, size of the next step, time before the last step and its size. y, y_old (17,): states there; slope
    (16, 17): of the stages, slope[0] that at `y_old`. dense (7, 17): interpolant of the last step. counts: reason to
    end, steps, …, row and stop that come next, component that was not finite. extremes (2,): largest distance from the
    axis and tilt of the normal against it, in rad, at the steps so far. states (n, 17): at the rows. All are longer by
    the numbers of a payload.
    """

    clock: Floats
    y: Floats
    y_old: Floats
    slope: Floats
    dense: Floats
    trial: Floats
    counts: NDArray[np.int64]
    extremes: Floats
    states: Floats


def start(state: Floats, rows: int) -> Work:
    """A flight at time 0 in a state (17,), longer by its payload."""
    count = np.zeros(10, np.int64)
    count[FRESH], count[BAD] = 1, -1
    return Work(
        np.zeros(4),
        state.copy(),
        state.copy(),
        np.zeros((16, state.size)),
        np.zeros((7, state.size)),
        np.zeros(state.size),
        count,
        np.zeros(2),
        np.full((rows, state.size), np.nan),
    )


@numba.njit(cache=True, error_model="numpy")
def fly(sail: RigidSail, tables: Tables, light: Light, terms: Terms, work: Work, portion: int) -> None:
    """Fly on for at most `portion` steps, or until there is a reason to end."""
    last = work.counts[STEPS] + portion
    while work.counts[REASON] == FLYING and work.counts[STEPS] < last:
        if work.counts[FRESH]:
            _widen(work.y, work.extremes)
            _begin(sail, tables, light, terms, work)
        if work.counts[REASON] == FLYING:
            flag = _advance(sail, tables, light, terms, work)
        if work.counts[REASON] == FLYING:
            _end_step(sail, tables, light, terms, work, flag)


@numba.njit(cache=True, error_model="numpy")
def _begin(sail: RigidSail, tables: Tables, light: Light, terms: Terms, work: Work) -> None:
    """Slope and size of the first step from here to the next stop (Hairer, §II.4)."""
    count, y, slope = work.counts, work.y, work.slope
    t = work.clock[T]
    flag = derivative(sail, tables, light, t, y, slope[12])
    count[EVALUATIONS] += 2
    count[FRESH] = 0
    if not _finite(slope[12], y.size, count):
        count[REASON] = NON_FINITE
        return
    count[REASON] = _reason(terms, y, flag)
    span = terms.stops[count[KNOT]] - t
    last = moving(sail.towing, STATE)
    size, speed = _norm(y, y, terms.tolerance, last), _norm(slope[12], y, terms.tolerance, last)
    first = min(span, 1e-6 if size < 1e-5 or speed < 1e-5 else 0.01 * size / speed)
    for i in range(y.size):
        work.trial[i] = y[i] + first * slope[12, i]
    derivative(sail, tables, light, t + first, work.trial, slope[1])
    for i in range(y.size):
        slope[1, i] -= slope[12, i]
    most = max(speed, _norm(slope[1], y, terms.tolerance, last) / first)
    second = max(1e-6, first * 1e-3) if most <= 1e-15 else (0.01 / most) ** (1.0 / 8.0)
    work.clock[H] = min(100.0 * first, second)


@numba.njit(cache=True, error_model="numpy")
def _norm(x: Floats, y: Floats, tolerance: float, last: int) -> float:
    """Root mean square of x in units of the tolerated error at y; what the light has done has no say in the steps.

    last: end of the numbers that move.
    """
    total = 0.0
    for i in range(MOTION):
        total += (x[i] / (tolerance * (1.0 + abs(y[i])))) ** 2
    for i in range(STATE, last):
        total += (x[i] / (tolerance * (1.0 + abs(y[i])))) ** 2
    return math.sqrt(total / (MOTION + last - STATE))


@numba.njit(cache=True, error_model="numpy")
def _finite(x: Floats, size: int, count: NDArray[np.int64]) -> bool:
    """Are states of so many numbers, one after the other, finite; notes which number is not."""
    for i in range(x.size):
        if not math.isfinite(x[i]):
            count[BAD] = i % size
            return False
    return True


@numba.njit(cache=True, error_model="numpy")
def _reason(terms: Terms, y: Floats, flag: int) -> int:
    """Reason to end in a state, by the flag of the light there."""
    if flag == LIT_FROM_BEHIND:
        return TURNED_OVER
    if flag != INSIDE and not terms.clamp:
        return LEFT_TABLE
    return FLY_AWAY if math.hypot(y[0], y[1]) > terms.limit else FLYING


@numba.njit(cache=True, error_model="numpy")
def _stage(sail: RigidSail, tables: Tables, light: Light, work: Work, t: float, h: float, k: int, state: Floats) -> int:
    """Write the state of stage k and its slope; flag of the light there."""
    state[:] = 0.0
    for j in range(k):
        if A[k, j] != 0.0:
            for i in range(state.size):
                state[i] += A[k, j] * work.slope[j, i]
    for i in range(state.size):
        state[i] = work.y_old[i] + h * state[i]
    work.counts[EVALUATIONS] += 1
    return derivative(sail, tables, light, t + C[k] * h, state, work.slope[k])


@numba.njit(cache=True, error_model="numpy")
def _advance(sail: RigidSail, tables: Tables, light: Light, terms: Terms, work: Work) -> int:
    """One accepted step, however often it must be tried; the worst flag of its stages."""
    clock, count = work.clock, work.counts
    work.y_old[:], work.slope[0] = work.y, work.slope[12]
    _renormalise(work.y_old, work.slope[0])
    t, stop, grow = clock[T], terms.stops[count[KNOT]], 10.0
    while True:
        if not clock[H] >= 10.0 * np.spacing(t):
            count[REASON] = STEP_TOO_SMALL if count[BAD] < 0 else NON_FINITE
            return INSIDE
        h = clock[H] if t + 1.0001 * clock[H] < stop else stop - t
        flag = INSIDE
        for k in range(1, STAGES):
            flag = max(flag, _stage(sail, tables, light, work, t, h, k, work.trial))
        ending = _stage(sail, tables, light, work, t, h, STAGES, work.trial)
        error = _error(work, h, terms.tolerance, moving(sail.towing, STATE))
        count[BAD] = -1
        if error < 1.0:
            break
        count[REJECTED] += 1
        finite = _finite(work.slope[:13].ravel(), work.y.size, count)
        clock[H] = h * (max(0.2, 0.9 * error ** (-1.0 / 8.0)) if finite else 0.2)
        grow = 1.0
    clock[H] = h * (grow if error == 0.0 else min(grow, max(0.2, 0.9 * error ** (-1.0 / 8.0))))
    clock[T_OLD], clock[T], clock[SPAN] = t, (stop if h == stop - t else t + h), h
    work.y[:] = work.trial
    count[STEPS] += 1
    count[CLAMPED] += ending != INSIDE
    count[DENSE] = 0
    return max(flag, ending)


@numba.njit(cache=True, error_model="numpy")
def _renormalise(y: Floats, slope: Floats) -> None:
    """Unit quaternion. q̇ is linear in q and nothing else depends on |q|, so the slope at hand scales too."""
    norm = math.sqrt(y[6] * y[6] + y[7] * y[7] + y[8] * y[8] + y[9] * y[9])
    for i in range(6, 10):
        y[i] /= norm
        slope[i] /= norm


@numba.njit(cache=True, error_model="numpy")
def _error(work: Work, h: float, tolerance: float, last: int) -> float:
    """Error of a step in units of the tolerance (Hairer, §II.10, the combination of orders 5 and 3); last: as above."""
    fifth, third = 0.0, 0.0
    for i in range(last):
        if MOTION <= i < STATE:
            continue
        five, three = 0.0, 0.0
        for k in range(13):
            five += E5[k] * work.slope[k, i]
            three += E3[k] * work.slope[k, i]
        scale = tolerance * (1.0 + max(abs(work.y_old[i]), abs(work.trial[i])))
        fifth += (five / scale) ** 2
        third += (three / scale) ** 2
    if fifth == 0.0 and third == 0.0:
        return 0.0
    return h * fifth / math.sqrt((fifth + 0.01 * third) * (MOTION + last - STATE))


@numba.njit(cache=True, error_model="numpy")
def _end_step(sail: RigidSail, tables: Tables, light: Light, terms: Terms, work: Work, flag: int) -> None:
    """After a step: events within it, rows, the next stop."""
    clock, count = work.clock, work.counts
    if sail.towing.snaps:
        _snap(sail, tables, light, work)
    if _reason(terms, work.y, flag) != FLYING:
        _search(sail, tables, light, terms, work)
    _widen(work.y, work.extremes)
    while count[ROW] < terms.rows.size and terms.rows[count[ROW]] <= clock[T]:
        _interpolate(sail, tables, light, work, terms.rows[count[ROW]], work.states[count[ROW]])
        count[ROW] += 1
    if count[REASON] != FLYING:
        return
    if clock[T] >= terms.stops[count[KNOT]]:
        count[KNOT] += 1
        count[FRESH] = 1
        if count[KNOT] == terms.stops.size:
            count[REASON] = FINISHED
    elif count[STEPS] >= terms.most_steps:
        count[REASON] = TOO_MANY_STEPS


@numba.njit(cache=True, error_model="numpy")
def _widen(y: Floats, extremes: Floats) -> None:
    """Largest distance and tilt so far; the normal is the third column of the rotation (Goldstein, §4.5)."""
    extremes[0] = max(extremes[0], math.hypot(y[0], y[1]))
    across = 2.0 * math.hypot(y[7] * y[9] + y[6] * y[8], y[8] * y[9] - y[6] * y[7])
    along = y[6] * y[6] - y[7] * y[7] - y[8] * y[8] + y[9] * y[9]
    extremes[1] = max(extremes[1], math.atan2(across, along))


@numba.njit(cache=True, error_model="numpy")
def _search(sail: RigidSail, tables: Tables, light: Light, terms: Terms, work: Work) -> None:
    """Move the end of the flight back to the first reason to end within the last step, if there is one."""
    clock, t_old, t = work.clock, work.clock[T_OLD], work.clock[T]
    before = t_old
    for k in range(1, _SCAN + 1):
        after = t if k == _SCAN else t_old + (t - t_old) * k / _SCAN
        if _reason_at(sail, tables, light, terms, work, after) != FLYING:
            break
        if k == _SCAN:
            return
        before = after
    for _ in range(60):
        middle = 0.5 * (before + after)
        if _reason_at(sail, tables, light, terms, work, middle) != FLYING:
            after = middle
        else:
            before = middle
    work.counts[REASON] = _reason_at(sail, tables, light, terms, work, after)
    _interpolate(sail, tables, light, work, after, work.y)
    clock[T] = after


@standalone()
def _snap(sail: RigidSail, tables: Tables, light: Light, work: Work) -> None:
    """Move the end of the last step back to where a tether first is above its strength, if one is, and snap that."""
    clock, t_old, t = work.clock, work.clock[T_OLD], work.clock[T]
    before, k = t_old, -1
    for i in range(1, _LOOKS + 1):
        after = t if i == _LOOKS else t_old + (t - t_old) * i / _LOOKS
        k = _overload_at(sail, tables, light, work, after)
        if k >= 0:
            break
        before = after
    if k < 0:
        return
    for _ in range(60):
        middle = 0.5 * (before + after)
        found = _overload_at(sail, tables, light, work, middle)
        if found >= 0:
            after, k = middle, found
        else:
            before = middle
    if after < t:
        _interpolate(sail, tables, light, work, after, work.y)
        clock[T] = after
    work.y[moving(sail.towing, STATE) + k] = 0.0
    work.counts[FRESH] = 1


@numba.njit(cache=True, error_model="numpy")
def _overload_at(sail: RigidSail, tables: Tables, light: Light, work: Work, t: float) -> int:
    """The first tether above its strength at a time within the last step, −1 if none is."""
    state, turn = np.empty(work.y.size), np.empty((3, 3))
    _interpolate(sail, tables, light, work, t, state)
    rotation(state[6:10], turn)
    return overload(sail.towing, STATE, turn, state)


@numba.njit(cache=True, error_model="numpy")
def _reason_at(sail: RigidSail, tables: Tables, light: Light, terms: Terms, work: Work, t: float) -> int:
    """Reason to end at a time within the last step."""
    state, slope = np.empty(work.y.size), np.empty(work.y.size)
    _interpolate(sail, tables, light, work, t, state)
    return _reason(terms, state, derivative(sail, tables, light, t, state, slope))


@numba.njit(cache=True, error_model="numpy")
def _interpolate(sail: RigidSail, tables: Tables, light: Light, work: Work, t: float, out: Floats) -> None:
    """Write the state (17,) at a time within the last step."""
    if not work.counts[DENSE]:
        _prepare(sail, tables, light, work)
    x = (t - work.clock[T_OLD]) / work.clock[SPAN]
    for i in range(out.size):
        value = 0.0
        for k in range(6, -1, -1):
            value = (value + work.dense[k, i]) * (x if k % 2 == 0 else 1.0 - x)
        out[i] = work.y_old[i] + value


@numba.njit(cache=True, error_model="numpy")
def _prepare(sail: RigidSail, tables: Tables, light: Light, work: Work) -> None:
    """The interpolant of the last step, from three more stages (Hairer, §II.6)."""
    h = work.clock[SPAN]
    for k in range(13, 16):
        _stage(sail, tables, light, work, work.clock[T_OLD], h, k, work.trial)
    for i in range(work.y.size):
        rise = work.y[i] - work.y_old[i]
        work.dense[0, i] = rise
        work.dense[1, i] = h * work.slope[0, i] - rise
        work.dense[2, i] = 2.0 * rise - h * (work.slope[12, i] + work.slope[0, i])
        for m in range(4):
            value = 0.0
            for k in range(16):
                value += D[m, k] * work.slope[k, i]
            work.dense[3 + m, i] = h * value
    work.counts[DENSE] = 1
