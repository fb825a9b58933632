"""One direction by FDTD at rising resolutions: the extrapolated pressure and the error to expect of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError, Stopwatch
from optics.cells.outline import Grating
from optics.fdtd.efficiencies import Efficiencies, efficiencies
from optics.fdtd.grid import FdtdSettings, narrowest, periods, rungs
from optics.fdtd.material import second_order, weakly_absorbing
from optics.fdtd.orders import grazing, least_in_window
from optics.fdtd.run import Decay
from optics.waves.incidence import wave_vector
from optics.waves.momentum import pressure

# No direction is better than this, whatever two resolutions say: what absorbers and the rest of the pulse leave.
_ERROR_FLOOR = 2e-4
# Closer to a cut-off light leaves so slowly that runs are cut off before it has (at |w| = 0.1 after 600 periods).
_GRAZING = 0.1
# A pulse this wide, of its frequency, leaves sharp resonances at other frequencies dark, which ring without end.
_NARROW = 0.04
# Orders at less than this need more of an absorber, up to twice.
_STEEP = 0.5
# Covers each of 48 triples on the paper's TM cell, where errors fall slowest, by 16 % at least; 2 and 2.5 miss some.
_FOURTH_ORDER = 3.0
# What a second-order extrapolation misses of a first-order error, per change from the pair before (ratios of √2).
_FIRST_ORDER = 2.5
_UNSTEADY = 2.0
# Pieces below two pixels are seen through means only: of 56 random cells, about half of them with such pieces, the
# stated error missed three, all absorbing, by factors of up to 1.4.
_RESOLVED, _UNRESOLVED = 2.0, 2.0
# Extrapolation triples what is missing of either resolution (2 b − a for a ratio of √2).
_RESIDUAL_SHARE = 3.0


@dataclass(frozen=True)
class DirectionResult:
    """One direction solved.

    q (3,) in (g, r, n); absorptance; error: estimated absolute error of q, not below `stress`; energy_imbalance:
    1 − R − T of the finest run, less what its fields lose; stress: largest difference of q_g and q_n from those by
    Maxwell's stress; residual: relative change of the fields that was still to come when the run was stopped; capped:
    it was stopped by the longest time allowed; seconds: CPU time; resolutions: pixels
    per wavelength in the densest material; grazing: smallest |w| of any order.
    """

    q: Floats
    absorptance: float
    error: float
    energy_imbalance: float
    stress: float
    residual: float
    capped: bool
    seconds: float
    resolutions: tuple[float, ...]
    grazing: float


def check_cell(cell: Grating, u: float, v: float) -> None:
    """Refuse what this solver can't do."""
    front = cell.surroundings.front
    if front < 1:
        raise InputError(f"{cell.name}: surroundings.front = {front:g}: must be at least 1 for FDTD; take optics.modal")
    if not u**2 + v**2 < front**2:
        raise InputError(
            f"{cell.name}: direction u = {u:g}, v = {v:g} is evanescent: u² + v² must be below {front**2:g}"
        )


def check_grazing(cell: Grating, u: float, v: float) -> None:
    """Refuse a direction with an order so close to its cut-off that its light takes too long to leave."""
    smallest = grazing(cell, u, v)
    if smallest < _GRAZING:
        raise InputError(
            f"{cell.name} at u = {u:g}, v = {v:g}: a diffraction order grazes, |w| = {smallest:.2g}: must be at least "
            f"{_GRAZING:g}, its light takes too long to leave; choose other directions, or use optics.modal"
        )


def check_window(cell: Grating, u: Floats, v: Floats) -> None:
    """Refuse a table over u (n_u) × v (n_v ≥ 0) with directions this solver can't do, at its nodes or between."""
    check_cell(cell, float(np.abs(u).max()), float(v[-1]))
    smallest = least_in_window(cell, u, float(v[-1]))
    if smallest < _GRAZING:
        raise InputError(
            f"{cell.name}: u = {u[0]:g} … {u[-1]:g}, |v| ≤ {v[-1]:g}: there are directions where a diffraction order "
            f"grazes, |w| down to {smallest:.2g}: must be at least {_GRAZING:g}; take a smaller range, or use "
            "optics.modal"
        )


def values(cell: Grating, u: float, v: float, result: Efficiencies) -> Floats:
    """[q_g, q_n, absorptance, and q_g, q_n from the stress] (5,).

    The absorptance of weak absorption comes from the field energy.
    """
    w = wave_vector(u, v, cell.surroundings.front)[2]
    u_m, w_front, w_back = result.orders
    q, lost = pressure(
        u, v, w, u_m=u_m, w_front=w_front, w_back=w_back, reflected=result.reflected, transmitted=result.transmitted
    )
    absorptance = result.absorptance if weakly_absorbing(cell) else float(lost)
    return np.array([q[0], q[2], absorptance, *result.stress])


def solve_direction(
    cell: Grating, u: float, v: float, settings: FdtdSettings, solved: Callable[[int], None] = lambda rung: None
) -> DirectionResult:
    """Solve one direction with rising resolution until the error estimated meets the tolerance.

    `solved` is told the number of each resolution, from 0 on, once it is done.
    """
    check_cell(cell, u, v)
    check_grazing(cell, u, v)
    thicker = float(np.clip(_STEEP / grazing(cell, u, v), 1.0, 2.0))
    watch, smooth = Stopwatch(), second_order(cell)
    done: list[tuple[int, Floats]] = []
    decay = Decay(0.0, False)
    for rung, n_x in enumerate(rungs(cell, settings)):
        result = efficiencies(cell, u, v, n_x, settings, thicker)
        if _rings(result.decay, settings) and settings.pulse_width > _NARROW >= 16 / settings.longest:
            settings = settings.model_copy(update={"pulse_width": _NARROW})
            result = efficiencies(cell, u, v, n_x, settings, thicker)
        decay = decay.worse(result.decay)
        _refuse_ringing(cell, u, v, result.decay, settings)
        done.append((n_x, values(cell, u, v, result)))
        _refuse_nan(cell, u, v, *done[-1])
        solved(rung)
        if len(done) < min(3, len(settings.pixels_per_wavelength)):
            continue
        seen = narrowest(cell) * n_x >= _RESOLVED
        best, error = estimate(done, periods(cell)) if smooth and seen else cautious_estimate(done)
        error *= 1.0 if seen else _UNRESOLVED
        stress = float(np.abs(best[:2] - best[3:]).max())
        error = max(error, stress) + _RESIDUAL_SHARE * decay.residual
        if error <= settings.tolerance:
            break
    return DirectionResult(
        q=np.array([best[0], v * best[2], best[1]]),
        absorptance=float(best[2]),
        error=error,
        energy_imbalance=result.imbalance,
        stress=stress,
        residual=decay.residual,
        capped=decay.capped,
        seconds=watch.cpu_seconds,
        resolutions=tuple(n / periods(cell) for n, _ in done),
        grazing=grazing(cell, u, v),
    )


def _refuse_nan(cell: Grating, u: float, v: float, n_x: int, found: Floats) -> None:
    """InputError where a run gave no number: one would be missed by every comparison that follows."""
    if not np.all(np.isfinite(found)):
        raise InputError(
            f"{cell.name} at u = {u:g}, v = {v:g}: FDTD with {n_x} pixels a period gave {found}, not numbers; lower "
            "'courant', or use optics.modal"
        )


def _rings(decay: Decay, settings: FdtdSettings) -> bool:
    """Whether a run was cut off so early that what it misses exceeds the tolerance."""
    return decay.capped and _RESIDUAL_SHARE * decay.residual > settings.tolerance


def _refuse_ringing(cell: Grating, u: float, v: float, decay: Decay, settings: FdtdSettings) -> None:
    """InputError where a run was cut off so early that what it misses exceeds the tolerance."""
    if _rings(decay, settings):
        raise InputError(
            f"{cell.name} at u = {u:g}, v = {v:g}: the fields still ring after {settings.longest:g} periods (longest): "
            f"residual {decay.residual:.2g}, allowed {settings.tolerance / _RESIDUAL_SHARE:.2g}; a sharp resonance: "
            "raise 'longest', or use optics.modal"
        )


def estimate(done: Sequence[tuple[int, Floats]], waves: float) -> tuple[Floats, float]:
    """Extrapolated value (k,) of the finest of two or more (pixels, values), and the error of the first two of them.

    `waves`: wavelengths in the densest material per period. Of one pair the error is taken to be the correction that it
    applies. From three resolutions on it is the change from one pair's value to the next pair's, two to three times
    what is left of an error of third or fourth order. Two pairs may agree by chance: the error is not less than
    `_FOURTH_ORDER` times what a term of fourth order should be, the correction times the square of the phase of a wave
    over a pixel.
    """
    best, correction = extrapolate(done[-2], done[-1])
    error = float(correction[:2].max())
    if len(done) > 2:
        change = float(np.abs(best - extrapolate(done[-3], done[-2])[0])[:2].max())
        left = _FOURTH_ORDER * (2 * np.pi * waves / done[-1][0]) ** 2
        error = min(error, max(change, left * error))
    return best, max(error, _ERROR_FLOOR)


def cautious_estimate(done: Sequence[tuple[int, Floats]]) -> tuple[Floats, float]:
    """Like `estimate`, for metals and strong absorbers, where errors need not fall with the square of the pixel.

    At their edges fields are singular, and the faces' own waves come out at a pixel's size. Where three resolutions
    approach a limit steadily, the extrapolated value is taken: if the order was one, not two, it misses 2.4 times the
    change from the pair before, and its error is not less than its correction. Where they do not, the finest value is
    taken as it is, with an error of `_UNSTEADY` times the largest of the two steps.
    """
    (_, a), (_, b), (_, c) = done[-3:] if len(done) > 2 else (done[0], *done)
    before, after = b - a, c - b
    best, correction = extrapolate(done[-2], done[-1])
    change = np.abs(best - extrapolate(done[-3], done[-2])[0]) if len(done) > 2 else correction
    steady = (before * after > 0) & (np.abs(after) < np.abs(before))
    steps = _UNSTEADY * np.maximum(np.abs(before), np.abs(after))
    error = np.where(steady, np.maximum(np.minimum(_FIRST_ORDER * change, steps), correction), steps)
    return np.where(steady, best, c), max(float(error[:2].max()), _ERROR_FLOOR)


def extrapolate(coarse: tuple[int, Floats], fine: tuple[int, Floats]) -> tuple[Floats, Floats]:
    """Richardson's second-order value (k,) from two (pixels, values), and the size (k,) of its correction."""
    (n, a), (m, b) = coarse, fine
    correction = (b - a) * n**2 / (m**2 - n**2)
    return b + correction, np.abs(correction)
