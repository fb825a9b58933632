"""Directions for a grating's table: rows, lines and cut-offs, refined until the table's own interpolation is good.

Every test compares the table, as it would be read, with the solver between its nodes: halfway between rows on some of
the lines, halfway between lines on some of the rows, and beside the cut-offs. What is not good enough is halved. The
errors found go into the table's error estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import progress
from optics.refinement.samples import Samples, solve_each
from optics.table.lookup import TableArrays, lookup_many
from optics.table.pole_tracks import Resonances, no_resonances
from optics.table.strips import NEAR, Curves
from optics.table.verification import cover, errors_at, spread_evenly, stated

# From errors of the k quantities (k, n, m) to one error (n, m).
Measure = Callable[[Floats], Floats]
Measures = Sequence[Measure]

# Narrower intervals in √|u − u_c| beside cut-offs are not halved.
_SMALLEST_ROOT = 4e-3
_ROUNDS = 10
_TEST_LINES, _TEST_ROWS, _TEST_BESIDE = 9, 32, 5
_TEST_NARROW = (0.2, 0.5, 0.8)  # places in narrow strips
# The tolerance is taken to this share of itself, one after the other, until the error that is stated of the
# interpolation is within its part of the budget; the rest is for the orders.
_PASSES, _BUDGET = (1.0, 0.6, 0.36, 0.2), 0.6
# No error is stated as less than this share of the tolerance.
_LEAST = 0.03
_WORTH = 0.9  # a pass that leaves more than this of the error is the last one


def first_lines(at: Floats, count: int) -> Floats:
    """About `count` lines (n,) over the `breaks` at (m,), even in v² but denser beside those where cut-offs meet."""
    lines = [at]
    for low, high in pairwise(at):
        x = np.linspace(0.0, 1.0, 1 + max(2, int(np.ceil(count * (high**2 - low**2) / at[-1] ** 2))))
        left, right = (x if low > 0.0 else 0.0 * x + 1.0), (1.0 - x if high < at[-1] else 0.0 * x + 1.0)
        if low > 0.0 and high < at[-1]:
            x = left**2 / (left**2 + right**2)
        elif low > 0.0:
            x = left**2
        elif high < at[-1]:
            x = 1.0 - right**2
        lines.append(np.sqrt(low**2 + (high**2 - low**2) * x[1:-1]))
    return np.unique(np.concatenate(lines))


def _differences(samples: Samples, arrays: TableArrays, n: int, u: Floats, v: Floats) -> Floats:
    """Errors (n, n_u, n_v) of a table of the first n quantities at directions u × v."""
    if u.size * v.size == 0:
        return np.empty((n, u.size, v.size))
    out = np.empty((u.size * v.size, n))
    lookup_many(arrays, np.repeat(u, v.size), np.tile(v, u.size), out)
    return np.asarray(samples.solve(u, v)[:n] - out.T.reshape(n, u.size, v.size))


def _error(samples: Samples, arrays: TableArrays, u: Floats, v: Floats) -> Floats:
    """Largest error (n_u, n_v) of the leading quantities at directions u × v."""
    return np.asarray(np.abs(_differences(samples, arrays, samples.leading, u, v)).max(axis=0))


def _error_at(samples: Samples, arrays: TableArrays, u: Floats, v: Floats) -> float:
    """Largest error of the table at single directions u, v (n)."""
    n = samples.leading
    guess = np.empty((u.size, n))
    lookup_many(arrays, u, v, guess)
    exact = solve_each(samples.solve, u, v, len(samples.nodes))[:n].T
    return float(np.abs(exact - guess).max(initial=0.0))


def _narrow_error(samples: Samples, arrays: TableArrays, v: float) -> float:
    """Largest error of the table on the line v in strips too narrow for a test row to fall into them."""
    cut = samples.curves.take(samples.curves.offset == 0.0)
    at = cut.u(np.array([v]))[:, 0]
    edges = np.unique([samples.u[0], samples.u[-1], *at[(at > samples.u[0]) & (at < samples.u[-1])]])
    widths = np.diff(edges)
    narrow = (widths > NEAR) & (widths < 2.0 * (samples.u[-1] - samples.u[0]) / _TEST_ROWS)
    u = (edges[:-1, None] + widths[:, None] * np.array(_TEST_NARROW))[narrow].ravel()
    return _error_at(samples, arrays, u, np.full(u.size, v))


def _some(nodes: Floats, count: int) -> Floats:
    """About `count` of the nodes, first and last among them."""
    return nodes[np.unique(np.linspace(0, nodes.size - 1, count).round().astype(int))]


class _Found:
    """Errors already found halfway between neighbours on one axis, for each of the test places on the other."""

    def __init__(self) -> None:
        self._errors: dict[tuple[float, float], Floats] = {}

    def unknown(self, nodes: Floats) -> Floats:
        """Midpoints (m,) of the intervals between nodes (n,) that have not been tested."""
        return np.array([(a + b) / 2 for a, b in pairwise(nodes.tolist()) if (a, b) not in self._errors])

    def note(self, nodes: Floats, errors: Floats) -> None:
        """Errors (n_unknown, n_tests) at the midpoints that were unknown."""
        rest = iter(errors)
        for pair in pairwise(nodes.tolist()):
            if pair not in self._errors:
                self._errors[pair] = next(rest)

    def all(self, nodes: Floats) -> Floats:
        """Errors (k, n_tests) of all k = n − 1 intervals between nodes (n,)."""
        return np.array([self._errors[pair] for pair in pairwise(nodes.tolist())])


@dataclass(frozen=True)
class _Axis:
    """How far an axis may be refined: its name, the narrowest interval that is halved and the most nodes."""

    name: str
    smallest: float
    most: int

    def split(self, nodes: Floats, errors: Floats, tolerance: float) -> Floats:
        """Midpoints (m,) of the intervals with too large an error, the worst of them where there are too many.

        nodes (n,) and the errors (n_intervals, n_tests) between them.
        """
        worst = errors.max(axis=1)
        bad = np.flatnonzero((worst > tolerance) & (np.diff(nodes) > self.smallest))
        bad = bad[np.argsort(-worst[bad], kind="stable")][: max(0, self.most - nodes.size)]
        return _between(nodes)[np.sort(bad)]

    def reasons(self, nodes: Floats, errors: Floats, tolerance: float) -> list[str]:
        """Why intervals between nodes (n,) are left with too large an error (n_intervals, n_tests)."""
        worst = errors.max(axis=1)
        if not (worst > tolerance).any():
            return []
        at = f"{self.name} = {_between(nodes)[worst.argmax()]:.6g}"
        if nodes.size >= self.most:
            return [f"more than {self.most} nodes in {self.name} would be needed, most near {at}"]
        if np.diff(nodes)[worst.argmax()] <= self.smallest:
            return [f"the response changes within {self.smallest:g} in {self.name} near {at}"]
        return [f"{_ROUNDS} rounds of refinement did not suffice near {at}"]


_ROWS, _LINES = _Axis("u", 2.5e-4, 600), _Axis("v", 2e-3, 160)


def _beside(curves: Curves, c: int, side: float, reach: float) -> Floats:
    """Roots √|offset| of nodes beside cut-off c on one side, from 0 to `reach`, where the rows take over."""
    same = (curves.order == curves.order[c]) & (curves.sign == curves.sign[c]) & (curves.index == curves.index[c])
    offsets = curves.offset[same] * side
    return np.unique([0.0, reach, *np.sqrt(offsets[offsets > 0])])


def _test_beside(
    samples: Samples, arrays: TableArrays, v: Floats, reach: float, found: dict[tuple[int, float, float], float]
) -> list[tuple[int, float, float, float]]:
    """Cut-off, side, root and interval in the root of new places tested beside cut-offs; errors go to `found`."""
    tested = []
    for c in np.flatnonzero(samples.curves.offset == 0.0):
        for side in (-1.0, 1.0):
            roots = _beside(samples.curves, int(c), side, reach)
            for t, step in zip((roots[1:] + roots[:-1]) / 2, np.diff(roots), strict=True):
                if (int(c), side, t) in found:
                    continue
                u = samples.curves.take([int(c)]).u(v)[0] + side * t * t
                held = (u > samples.u[0]) & (u < samples.u[-1])
                found[int(c), side, t] = _error_at(samples, arrays, u[held], v[held])
                tested.append((int(c), side, float(t), float(step)))
    return tested


@dataclass(frozen=True)
class Refined:
    """Samples whose table is good, and its largest error (m, n_u, n_v) around each node by each of the m measures.

    resonances: those that `solve` of the samples leaves out, while their nodes hold everything. reasons: what ended the
    refinement before it was good.
    """

    samples: Samples
    errors: Floats
    resonances: Resonances
    reasons: tuple[str, ...] = ()


def _refine_rows(samples: Samples, tolerance: float, name: str) -> tuple[Samples, list[str]]:
    """Refine rows and the surroundings of cut-offs on the lines there are."""
    rows = _Found()
    beside: dict[tuple[int, float, float], float] = {}
    test_v, near_v = _some(samples.v, _TEST_LINES), _some(samples.v, _TEST_BESIDE)
    reach = float(np.sqrt(np.diff(samples.u).max()))
    for _ in progress(range(_ROUNDS), f"{name}: rows", unit="round"):
        arrays = samples.arrays(samples.leading)
        rows.note(samples.u, _error(samples, arrays, rows.unknown(samples.u), test_v))
        tested = _test_beside(samples, arrays, near_v, reach, beside)
        more = _ROWS.split(samples.u, rows.all(samples.u), tolerance)
        bad = [place for place in tested if beside[place[:3]] > tolerance]
        close = [(c, side * t * t) for c, side, t, step in bad if step > _SMALLEST_ROOT]
        reasons = _ROWS.reasons(samples.u, rows.all(samples.u), tolerance)
        if len(close) < len(bad):
            reasons.append(f"the response changes within {_SMALLEST_ROOT**2:.1g} in u beside a cut-off")
        if not (close or more.size):
            break
        if close:
            which, offset = zip(*close, strict=True)
            samples = samples.with_curves(samples.curves.take(list(which)).beside(np.array(offset)))
        if more.size:
            samples = samples.with_rows(more)
    return samples, reasons


def _refine_lines(samples: Samples, tolerance: float, name: str) -> tuple[Samples, list[str]]:
    """Refine lines on the rows there are."""
    lines, test_u = _Found(), _some(samples.u, _TEST_ROWS)
    for _ in progress(range(_ROUNDS), f"{name}: lines", unit="round"):
        arrays, unknown = samples.arrays(samples.leading), lines.unknown(samples.v)
        narrow = [_narrow_error(samples, arrays, v) for v in unknown]
        lines.note(samples.v, np.column_stack([_error(samples, arrays, test_u, unknown).T, narrow]))
        more = _LINES.split(samples.v, lines.all(samples.v), tolerance)
        reasons = _LINES.reasons(samples.v, lines.all(samples.v), tolerance)
        if not more.size:
            break
        samples = samples.with_lines(more)
    return samples, reasons


def refine(samples: Samples, tolerance: float, measures: Measures, name: str = "table") -> Refined:
    """Refine rows and surroundings of cut-offs, then lines, until the stated error is good at 99 % of directions."""
    at_99 = np.inf
    for share in _PASSES:
        tests = _some(samples.v, _TEST_LINES)
        samples, reasons = _refine_rows(samples, share * tolerance, name)
        samples, more = _refine_lines(samples, share * tolerance, name)
        errors = _errors_around(samples, _some(samples.u, _TEST_ROWS), tests, measures)
        errors = _verified(samples, errors, measures, _LEAST * tolerance)
        before, at_99 = at_99, _at_99(samples, errors[0])
        if at_99 <= _BUDGET * tolerance or at_99 > _WORTH * before:
            break
    return Refined(samples, errors, no_resonances(samples.parity), tuple([*reasons, *more]))


def _at_99(samples: Samples, error: Floats) -> float:
    """Stated error at 99 % of the directions, from that at the nodes (n_u, n_v)."""
    u, v = spread_evenly(samples.u, samples.v)
    return float(np.quantile(stated(error[None], samples.u, samples.v, np.repeat(u, v.shape[1]), v.ravel()), 0.99))


def _verified(samples: Samples, errors: Floats, measures: Measures, least: float) -> Floats:
    """Errors (m, n_u, n_v) raised where random directions show them to be too small, to `least` at least."""
    (u, v), k = spread_evenly(samples.u, samples.v), samples.parity.size
    truth = errors_at(samples.solve, samples.arrays(k), k, together(measures), u, v).reshape(len(errors), -1)
    return cover(errors, samples.u, samples.v, np.repeat(u, v.shape[1]), v.ravel(), truth, least)


def together(measures: Measures) -> Measure:
    """All measures (m, ...) at once."""
    return lambda differences: np.stack([measure(differences) for measure in measures])


def _errors_around(samples: Samples, test_u: Floats, test_v: Floats, measures: Measures) -> Floats:
    """Errors (m, n_u, n_v) of the table as it is now around each node: errors found on the way are of coarser ones."""
    n = samples.parity.size
    arrays = samples.arrays(n)
    along_u = _differences(samples, arrays, n, _between(samples.u), test_v)[..., _closest(test_v, samples.v)]
    along_v = _differences(samples, arrays, n, test_u, _between(samples.v))[:, _closest(test_u, samples.u)]
    return np.stack([_spread(measure(along_u)) + _spread(measure(along_v).T).T for measure in measures])


def _between(nodes: Floats) -> Floats:
    return np.asarray((nodes[1:] + nodes[:-1]) / 2)


def _closest(places: Floats, at: Floats) -> Floats:
    return np.abs(places[:, None] - at).argmin(axis=0)


def _spread(errors: Floats) -> Floats:
    """Errors (n, m) at nodes from those of the intervals (n − 1, m) between them."""
    none = np.zeros((1, errors.shape[1]))
    return np.maximum(np.concatenate([errors, none]), np.concatenate([none, errors]))
