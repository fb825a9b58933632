"""The interpolation error that a table states: measured between its nodes, and beside its narrow resonances.

Errors found halfway between nodes are those of few lines. Random directions, evenly spread, say how much of the truth
they cover: they are raised until 99 % of such directions are covered, and around those that are not.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from beamrider.arrays import Floats, Integers
from optics.table.lookup import TableArrays, lookup_many
from optics.table.pole_tracks import Resonances

# Quantities (k, n_u, n_v) at u × v, and from errors of the quantities (k, n) to errors (m, n).
Solve = Callable[[Floats, Floats], Floats]
Measures = Callable[[Floats], Floats]

# Directions: places in u and at each of them in v; of a pole: lines of v and places on each, in half widths.
_IN_U, _IN_V, _POLE_LINES = 96, 4, 16
_POLE_PLACES = np.array([-25.0, -6.0, -1.7, -0.6, 0.0, 0.5, 1.4, 5.0, 30.0])
# Stated errors are scaled up until this share of directions is covered.
_COVERED = 0.985
# Where all are covered, stated errors are this times the largest ratio of true to stated ones, at least this share.
_MARGIN, _LOWEST = 1.4, 0.3
_WIDTHS = 5.0  # half widths on both sides of a pole to which its error belongs


def errors_at(solve: Solve, arrays: TableArrays, k: int, measures: Measures, u: Floats, v: Floats) -> Floats:
    """Errors (m, n_u, n_v) of a table of k quantities at u (n_u), each with its own v (n_u, n_v)."""
    guess, found = np.empty((v.size, k)), []
    lookup_many(arrays, np.repeat(u, v.shape[1]), v.ravel(), guess)
    for i in range(u.size):
        found.append(solve(u[i : i + 1], v[i])[:k, 0])
    exact = np.stack(found, axis=1)
    return measures(exact - guess.T.reshape(k, *v.shape))


def spread_evenly(u: Floats, v: Floats, rows: int = _IN_U, on_row: int = _IN_V) -> tuple[Floats, Floats]:
    """Random directions u (rows), v (rows, on_row) spread evenly over the window of the nodes; always the same."""
    rng = np.random.default_rng(0)
    places = u[0] + (u[-1] - u[0]) * (np.arange(rows) + rng.random(rows)) / rows
    return places, v[-1] * (np.arange(on_row) + rng.random((rows, on_row))) / on_row


def _cell(nodes: Floats, at: Floats) -> Integers:
    """The interval of the nodes that holds each place."""
    return np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, nodes.size - 2)


def stated(errors: Floats, u: Floats, v: Floats, at_u: Floats, at_v: Floats) -> Floats:
    """Stated errors (m, ...) between nodes: the largest of the four around, from errors (m, n_u, n_v) at the nodes."""
    i, j = _cell(u, at_u), _cell(v, at_v)
    return np.max([errors[:, i + a, j + b] for a in (0, 1) for b in (0, 1)], axis=0)


def cover(errors: Floats, u: Floats, v: Floats, at_u: Floats, at_v: Floats, truth: Floats, least: float) -> Floats:
    """Errors (m, n_u, n_v) scaled until they cover the true ones (m, n) found at random directions (n), then raised.

    Where they are larger than all true ones by far they are scaled down; none is less than `least`.
    """
    errors = np.maximum(errors, least)
    ratio = truth / stated(errors, u, v, at_u, at_v)
    factor = np.maximum(np.quantile(ratio, _COVERED, axis=1), 1.0)
    factor = np.where(ratio.max(axis=1) < 1.0, np.clip(_MARGIN * ratio.max(axis=1), _LOWEST, 1.0), factor)
    errors = np.maximum(errors * factor[:, None, None], least)
    left = truth - stated(errors, u, v, at_u, at_v)
    reach = (u[-1] - u[0]) / _IN_U / 2, v[-1] / _IN_V / 8
    for p in np.flatnonzero((left > 0).any(axis=0)):
        part = (_around(u, at_u[p] - reach[0], at_u[p] + reach[0]), _around(v, at_v[p] - reach[1], at_v[p] + reach[1]))
        errors[:, part[0], part[1]] = np.maximum(errors[:, part[0], part[1]], truth[:, p, None, None])
    return errors


def _around(nodes: Floats, low: float, high: float) -> slice:
    """The nodes of all intervals that low … high touches."""
    first, last = _cell(nodes, np.array([low, high]))
    return slice(int(first), int(last) + 2)


def beside_poles(
    solve: Solve, arrays: TableArrays, k: int, measures: Measures, resonances: Resonances, window: tuple[float, float]
) -> list[tuple[int, Floats, Floats]]:
    """For each pole its number, lines v (n) between its nodes and the largest errors (m, n) beside it there."""
    rng, out = np.random.default_rng(0), []
    for pole in range(resonances.count):
        v = _pole_lines(resonances.v[resonances.felt[pole]], rng)
        p = resonances.place(pole, v)
        worst = []
        for x, y in zip(p, v, strict=True):
            u = np.clip(x.real + x.imag * (_POLE_PLACES + 0.3 * rng.random(_POLE_PLACES.size)), *window)
            worst.append(errors_at(solve, arrays, k, measures, u, np.full((u.size, 1), y)).max(axis=(1, 2)))
        out.append((pole, v, np.array(worst).T))
    return out


def _pole_lines(nodes: Floats, rng: np.random.Generator) -> Floats:
    """Random v spread evenly over the nodes of a pole, and as many over their numbers where some places have many."""
    shares = (np.arange(_POLE_LINES) + rng.random(_POLE_LINES)) / _POLE_LINES
    v = nodes[0] + (nodes[-1] - nodes[0]) * shares
    if nodes.size > 2 * _POLE_LINES:
        v = np.append(v, np.interp(shares * (nodes.size - 1), np.arange(nodes.size), nodes))
    return np.sort(v)


def raise_beside(
    errors: Floats, u: Floats, v: Floats, resonances: Resonances, found: list[tuple[int, Floats, Floats]]
) -> Floats:
    """Errors (m, n_u, n_v) of the nodes around each pole raised to those found beside it."""
    errors = errors.copy()
    fine = np.unique(np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(v)]))
    for pole, lines, worst in found:
        right = np.clip(np.searchsorted(lines, fine), 1, max(lines.size - 1, 1))
        here = np.maximum(worst[:, right - 1], worst[:, np.minimum(right, lines.size - 1)])
        p = resonances.place(pole, fine)
        for k, y in enumerate(fine):
            reach = _WIDTHS * p[k].imag
            if p[k].real + reach < u[0] or p[k].real - reach > u[-1]:
                continue
            part = _around(u, p[k].real - reach, p[k].real + reach), _around(v, y, y)
            errors[:, part[0], part[1]] = np.maximum(errors[:, part[0], part[1]], here[:, k, None, None])
    return errors
