"""How many diffraction orders and slices a table needs, and the error that is left, from rates that are measured.

Few directions are solved with ever more orders, rung by rung of a ladder. Changes e_j from rung j to j + 1 fall as
C N_j^−p; p is fitted over at least three changes, four rungs. Beyond the last rung M, errors that add up come to

    Σ e = e_M / (1 − r^−p),   e_M = e_j (N_j / M)^p,   r the step of the ladder,

taken from the larger of the last two changes of each direction and enlarged by the scatter of the fit. A coarser rung
errs by its distance from the last one more. A table's own directions are solved with two coarser rungs; their
differences give the error by a factor that is calibrated on the few directions, where the error is known.

Walls that are slanted are taken in steps (`optics.modal.slanted`), whose error is of fourth order. Rounded corners are
cut into slices, each as the outline is at its middle: second order, so that what is found with all and with half of
them is extrapolated, q + (q − q_half)/3. The more orders, the more steps they need: orders are counted with twice as
many.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError, progress
from optics.cells.outline import Grating, is_upright, polygons
from optics.modal.core import Core, Cores
from optics.modal.limit import refuse_without_limit
from optics.modal.response import Response, solve
from optics.modal.scattering import NEGLIGIBLE
from optics.modal.steps import ModalCell, Slanted, modal_cell, source
from optics.waves.incidence import worst_polarisation

LADDER = (8, 10, 12, 15, 18, 22, 27, 33, 40, 50, 60, 75, 90, 110, 135, 165, 200, 245, 300, 365, 440)
# Beyond this a ladder only goes where orders that run need it.
_HIGHEST = 100
_BELOW = (5, 6)  # coarser than the ladder, to compare with
SLICES = (8, 16, 32, 64, 128, 256)
# Shares of the tolerance for the error of orders and of slices; the share of directions that has to keep it.
_SHARE, _QUANTILE = 0.25, 0.99
# What may be stated of it, which is more, of orders and of both: the rest is for interpolation.
_STATED, _STATED_BOTH = 0.4, 0.5
# Steep falls before the slow rate of edges sets in are not carried on.
_RATES = (0.3, 3.0)
_FITTED = 4  # changes
# The calibrated factor covers this share of the directions that it is calibrated on, with room for others.
_COVERED, _SAFETY = 0.97, 1.5
# An error that falls to a quarter or less with twice the steps is at most this times its change.
_LEFT_OF_STEPS = 1.33
_LEAST = 1e-12


class Forces(NamedTuple):
    """What of a `Response` errors are told of: q (n_u, n_v, 3), q_stokes (n_u, n_v, 4, 3)."""

    q: Floats
    q_stokes: Floats


def change(a: Forces | Response, b: Forces | Response) -> tuple[Floats, Floats]:
    """Largest difference (n_u, n_v) of q in the cell's own polarisation, and in any."""
    own = np.abs(a.q - b.q).max(axis=-1)
    return own, worst_polarisation(np.moveaxis(a.q_stokes - b.q_stokes, -2, 0)).max(axis=-1)


def fitted_rate(rungs: Sequence[int], changes: Sequence[Floats]) -> tuple[float, float]:
    """Rate p of changes (...) C N^−p from the lower of two rungs each, and the scatter of their logarithms about it."""
    x = np.log(np.array(rungs[: len(changes)], float))[-_FITTED:]
    y = np.log([max(float(np.quantile(part, 0.9)), 1e-15) for part in changes[-_FITTED:]])
    slope, constant = np.polyfit(x, y, 1)
    scatter = float(np.std(y - constant - slope * x))
    return float(np.clip(-slope, *_RATES)), scatter


def remaining(rungs: Sequence[int], changes: Sequence[Floats]) -> Floats:
    """Error (...) of the last of the rungs in each direction, from the changes (...) between rungs."""
    rate, scatter = fitted_rate(rungs, changes)
    last, step = rungs[-1], rungs[-1] / rungs[-2]
    recent = [part * (n / last) ** rate for n, part in zip(rungs[-3:-1], changes[-2:], strict=True)]
    return np.asarray(np.max(recent, axis=0) * np.exp(scatter) / (1.0 - step**-rate))


@dataclass(frozen=True)
class Climb:
    """A ladder climbed: its rungs, what was found on each, the rung chosen and its error (n_directions, measured)."""

    rungs: tuple[int, ...]
    found: tuple[Response, ...]
    chosen: int
    error: Floats
    met: bool

    @property
    def rung(self) -> int:
        """The rung chosen."""
        return self.rungs[self.chosen]

    def onwards(self) -> Iterator[Climb]:
        """The climb itself, then the same with each of the higher rungs chosen that it holds."""
        own, last = change(self.found[self.chosen], self.found[-1])[1], self.found[-1]
        for k in range(self.chosen, len(self.rungs)):
            yield replace(self, chosen=k, error=self.error - own + change(self.found[k], last)[1])

    def typical(self) -> float:
        """Error at 99 % of the directions."""
        return float(np.quantile(self.error, _QUANTILE))


def climb(at: Callable[[int], Response], ladder: Sequence[int], goal: float, what: str) -> Climb:
    """The first rung whose error is below `goal`, seen from the rungs above it; the last one where none is."""
    found: list[Response] = []
    changes: list[Floats] = []
    for i, rung in enumerate(progress(ladder, what, unit="rung")):
        found.append(at(rung))
        if i:
            changes.append(change(found[-1], found[-2])[1])
        if len(changes) < _FITTED - 1:
            continue
        left = remaining(ladder[: i + 1], changes)
        for k in range(i + 1):
            error = left + change(found[k], found[i])[1]
            if np.quantile(error, _QUANTILE) <= goal:
                return Climb(tuple(ladder[: i + 1]), tuple(found), k, error, True)
    return Climb(tuple(ladder), tuple(found), len(ladder) - 1, left, False)


@dataclass(frozen=True)
class Gauge:
    """Error of a rung from the differences to coarser ones: factor × Σ weight × difference."""

    coarser: tuple[int, ...]
    weights: tuple[float, ...]
    factor: float

    def read(self, fine: Forces | Response, coarse: Sequence[Response]) -> tuple[Floats, Floats]:
        """Errors (n_u, n_v) in the cell's own polarisation and in any."""
        parts = [change(fine, other) for other in coarse]
        own, every = (sum(w * part[i] for w, part in zip(self.weights, parts, strict=True)) for i in (0, 1))
        return np.maximum(self.factor * own, _LEAST), np.maximum(self.factor * every, _LEAST)


def gauge(up: Climb, at: Callable[[int], Response], below: Sequence[int]) -> Gauge:
    """How the error of a climb's rung shows in its differences to the two rungs below it, as `at` gives them."""
    ladder = [*below, *up.rungs]
    place = len(below) + up.chosen
    coarser = tuple(ladder[max(0, place - 2) : place][::-1])
    fine = at(up.rung)
    parts = [change(fine, at(n))[1] for n in coarser]
    sizes = [max(float(np.median(part)), _LEAST) for part in parts]
    weights = tuple(sizes[0] / size for size in sizes)
    total = np.sum([w * part for w, part in zip(weights, parts, strict=True)], axis=0)
    factor = _SAFETY * float(np.quantile(up.error / np.maximum(total, _LEAST), _COVERED))
    return Gauge(coarser, weights, factor)


def extrapolated(fine: Response, half: Response) -> Response:
    """What infinitely many slices give, from some and half of them, to second order."""
    parts = ((getattr(fine, field.name), getattr(half, field.name)) for field in fields(Response))
    return Response(*(a + (a - b) / 3 for a, b in parts))


@dataclass(frozen=True)
class Chosen:
    """A cell as the modal method takes it, its orders and slices, and how to tell their errors.

    half: the cell with half the slices, None where its walls are upright. reasons: why a tolerance is missed. cores: of
    the many directions that will be asked for, if there are.
    """

    cell: ModalCell
    order: int
    gauge: Gauge
    slices: int | None = None
    half: ModalCell | None = None
    slice_factor: float = 0.0
    reasons: tuple[str, ...] = ()
    cores: Cores | None = None

    def within(self, reach: tuple[float, float], tolerance: float, go_on: Callable[[], None]) -> Chosen:
        """The same, to be asked for many directions |u|, |v| ≤ reach: `optics.modal.core`."""
        return replace(self, cores=Cores(reach, tolerance, go_on))

    @property
    def fast(self) -> bool:
        """Whether directions cost the same with any number of orders."""
        return self.cores is not None and self.cores.of(self.scout.cell, self.order) is not None

    def _core(self, cell: ModalCell, u: Floats, v: Floats, order: int) -> Core | None:
        core = self.cores.of(cell, order) if self.cores else None
        return core if core and core.holds(u, v) else None

    def _solve(self, cell: ModalCell, u: Floats, v: Floats, order: int, negligible: float) -> Response:
        core = self._core(cell, u, v, order)
        return core.solve(u, v) if core else self._direct(cell, u, v, order, negligible)

    def _direct(self, cell: ModalCell, u: Floats, v: Floats, order: int, negligible: float) -> Response:
        of = replace(cell, reach=self.cores.reach) if isinstance(cell, Slanted) and self.cores else cell
        return solve(of, u, v, order, negligible)

    def _each(self, cell: ModalCell, u: Floats, v: Floats, order: int, negligible: float) -> Response:
        core = self._core(cell, u, v, order)
        if core:
            return core.solve_each(u, v)
        found = [self._direct(cell, u[i : i + 1], v[i : i + 1], order, negligible) for i in range(u.size)]
        return Response(
            *(np.concatenate([getattr(one, part.name) for one in found], axis=1) for part in fields(Response))
        )

    @property
    def settings(self) -> dict[str, int]:
        """Orders and, where there are any, slices, as a table notes them."""
        return {"orders": self.order} | ({} if self.slices is None else {"slices": self.slices})

    def solve(self, u: Floats, v: Floats, negligible: float = NEGLIGIBLE, order: int | None = None) -> Response:
        """Response over u (n_u,) × v (n_v,) with the orders chosen, or others; extrapolated where there are slices."""
        fine = self._solve(self.cell, u, v, order or self.order, negligible)
        if self.half is None or isinstance(self.cell, Slanted):
            return fine
        return extrapolated(fine, self._solve(self.half, u, v, order or self.order, negligible))

    def solve_each(self, u: Floats, v: Floats, negligible: float, order: int) -> Response:
        """The same at single directions u, v (n): arrays (1, n, ...)."""
        fine = self._each(self.cell, u, v, order, negligible)
        if self.half is None or isinstance(self.cell, Slanted):
            return fine
        return extrapolated(fine, self._each(self.half, u, v, order, negligible))

    @property
    def scout(self) -> Chosen:
        """The same with half of the slices: resonances are there, if not quite where they belong."""
        return replace(self, cell=self.half or self.cell, half=None)

    def errors(
        self, u: Floats, v: Floats, fine: Forces | Response, negligible: float = NEGLIGIBLE
    ) -> tuple[Floats, Floats]:
        """Error (n_u, n_v) of what was found from orders and slices, in the cell's own polarisation and in any."""
        as_it_is = self.half is None or isinstance(self.cell, Slanted)
        base = fine if as_it_is else self._solve(self.cell, u, v, self.order, negligible)
        own, every = self.gauge.read(base, [self._solve(self.cell, u, v, n, negligible) for n in self.gauge.coarser])
        if self.half is None:
            return own, every
        more = change(fine, self._solve(self.half, u, v, self.order, negligible))
        return own + self.slice_factor * more[0], every + self.slice_factor * more[1]


def propagating(cell: Grating, u_max: float) -> int:
    """Highest diffraction order that may leave the cell for |u| ≤ u_max; InputError beyond what can be solved."""
    reach = max(cell.surroundings.front, cell.surroundings.back) + u_max
    if reach > LADDER[-4] * cell.pitch:
        raise InputError(
            f"{cell.name}: period_nm = {cell.period_nm:g}: must be at most "
            f"{LADDER[-4] * cell.wavelength_nm / reach:g}; more than ±{LADDER[-4]} diffraction orders would propagate"
        )
    return int(reach / cell.pitch)


def rungs(cell: Grating, u_max: float) -> tuple[int, ...]:
    """The ladder of orders for a cell: from the first that holds all orders that run, four rungs at least."""
    least = propagating(cell, u_max)
    first = next(i for i, n in enumerate(LADDER) if n >= least)
    last = max(next(i for i, n in enumerate(LADDER) if n >= _HIGHEST), first + 4)
    return LADDER[first:last]


def finer_rungs(order: int) -> list[int]:
    """Orders from a rung on, each about half as many more than the one before, as far as resonances may need them."""
    return [order, *[n for n in LADDER if order < n <= _HIGHEST][1::2]]


def with_order(chosen: Chosen, order: int) -> Chosen:
    """The same with a higher rung; its error shows in the rungs below it as that of the other did in those."""
    below = tuple([n for n in (*_BELOW, *LADDER) if n < order][: -len(chosen.gauge.coarser) - 1 : -1])
    return replace(chosen, order=order, gauge=replace(chosen.gauge, coarser=below))


def choose(
    cell: Grating, u_max: float, v_max: float, tolerance: float, go_on: Callable[[], None] = lambda: None
) -> Chosen:
    """Fewest orders, and for walls that are not upright slices, whose error is a part of `tolerance`.

    InputError where there is no limit (`optics.modal.limit`). `go_on` is asked before every solution and may refuse.
    """
    refuse_without_limit(cell)
    u, v = np.linspace(-u_max, 0.93 * u_max, 16), v_max * np.array([0.03, 0.5, 0.97])
    ladder = rungs(cell, u_max)

    def solved(of: ModalCell, few_u: Floats, few_v: Floats, order: int) -> Response:
        go_on()
        return solve(of, few_u, few_v, order)

    if is_upright(cell):
        at = cache(partial(solved, cell, u, v))
        return _orders(cell, at, at, ladder, tolerance)
    plain = cache(lambda count, order: solved(modal_cell(cell, count), u[::2], v[::2], order))
    return _with_slices(cell, plain, ladder, tolerance)


def _orders(
    stack: ModalCell,
    at: Callable[[int], Response],
    told: Callable[[int], Response],
    ladder: Sequence[int],
    tolerance: float,
) -> Chosen:
    """Orders of a cell, whose responses are `at`; their error is to be told from those that `told` gives."""
    up = climb(at, ladder, _SHARE * tolerance, f"modal {stack.name}: orders")
    below = [n for n in (*_BELOW, *LADDER) if n < ladder[0]][-2:]
    metal = any(epsilon.real < 0 for _, epsilon in polygons(source(stack)))
    for one in up.onwards():
        found = gauge(one, told, below)
        own, _ = found.read(told(one.rung), [told(n) for n in found.coarser])
        # On metals the gauge of higher rungs overstates more than it gains.
        if metal or np.quantile(own, _QUANTILE) <= _STATED * tolerance:
            break
    return Chosen(stack, one.rung, found, reasons=_why(one, "diffraction orders", "±"))


def _why(up: Climb, what: str, sign: str = "") -> tuple[str, ...]:
    return () if up.met else (f"slow convergence: error {up.typical():.1g} at {sign}{up.rung} {what}",)


def _with_slices(
    cell: Grating, plain: Callable[[int, int], Response], ladder: Sequence[int], tolerance: float
) -> Chosen:
    """Slices or steps at few orders; orders with twice as many; and what is left of the former's error with these.

    plain: what so many slices and orders give.
    """
    in_steps = isinstance(modal_cell(cell), Slanted)  # right to more than second order as they are

    def best(count: int, order: int) -> Response:
        if in_steps:
            return plain(count, order)
        return extrapolated(plain(count, order), plain(count // 2, order))

    what = f"modal {cell.name}: slices"
    up = climb(lambda count: best(count, ladder[1]), SLICES, _SHARE * tolerance, what)
    for count in [n for n in SLICES if n >= up.rung]:
        found = _orders(modal_cell(cell, count), partial(best, 2 * count), partial(plain, count), ladder, tolerance)
        fine = best(count, found.order)
        left = _LEFT_OF_STEPS * change(best(2 * count, found.order), fine)[1]
        own, seen = change(fine, plain(count // 2, found.order))
        factor = _SAFETY * float(np.quantile(left / np.maximum(seen, _LEAST), _COVERED))
        of_orders, _ = found.gauge.read(plain(count, found.order), [plain(count, n) for n in found.gauge.coarser])
        if np.quantile(of_orders + factor * own, _QUANTILE) <= _STATED_BOTH * tolerance:
            break
    return replace(
        found,
        slices=count,
        half=modal_cell(cell, count // 2),
        slice_factor=factor,
        reasons=_why(up, "slices") + found.reasons,
    )
