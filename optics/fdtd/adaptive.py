"""Directions for a response that is known only by solving it: halving intervals in u, nested nodes in v²."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from beamrider.arrays import Floats
from optics.refinement.directions import even_nodes, fill

# Values (n, k) of directions (n, 2) of u, v.
Response = Callable[[Floats], Floats]

# What is narrower than 1/8 of the range and lies between two first nodes can be missed, as by any sampling.
_FIRST_INTERVALS = 8
_V_COUNTS = (3, 5, 9, 17)
_WITNESSES = 5
# Share of a spline's error in the middle of an interval that is left once the value there is a node: a sixteenth where
# the response is smooth. On the paper's cells 5e-3 and 1e-2 are met with this, and a fifth of the directions saved.
_LEFT = 0.25


def adapt(response: Response, u_max: float, v_max: float, tolerance: float) -> tuple[Floats, Floats, float]:
    """Tensor nodes u (n_u), v (n_v ≥ 0) from which `fill` gives a response even in v to about `tolerance`.

    And the error that was found between those in v.

    Each interval of u is halved until the spline through all nodes so far predicts the value found at its middle so
    well that, with that value among the nodes, `tolerance` is met, or until it is 1/64 of the first ones. Then nodes
    between those in v are solved at a few u; where the polynomial in v² through the old ones misses them, they are
    taken everywhere. What is solved once is asked for again only by the same numbers.
    """
    for count, more in pairwise(_V_COUNTS):
        u, values = _halve(response, u_max, even_nodes(v_max, count), tolerance)
        error = _v_error(response, u, values, even_nodes(v_max, count), even_nodes(v_max, more))
        if error <= tolerance:
            break
    return u, even_nodes(v_max, count), error


def _at(response: Response, u: Floats, v: Floats) -> Floats:
    """Values (n_u, n_v, k) over u × v."""
    directions = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    return response(directions.reshape(-1, 2)).reshape(u.size, v.size, -1)


def _halve(response: Response, u_max: float, v: Floats, tolerance: float) -> tuple[Floats, Floats]:
    """Nodes u (n_u) and the values (n_u, n_v, k) there."""
    u = np.linspace(-u_max, u_max, _FIRST_INTERVALS + 1)
    values = _at(response, u, v)
    smallest = (u[1] - u[0]) / 64
    still = np.ones(u.size - 1, bool)  # intervals whose middle is to be looked at
    while still.any():
        middle = ((u[1:] + u[:-1]) / 2)[still]
        found = _at(response, middle, v)
        error = np.abs(CubicSpline(u, values, axis=0)(middle) - found).max(axis=(1, 2))
        places = np.flatnonzero(still) + 1
        again = np.insert(np.zeros(still.size, bool), places, False)
        u, values = np.insert(u, places, middle), np.insert(values, places, found, axis=0)
        for x, bad in zip(middle, _LEFT * error > tolerance, strict=True):
            at = int(np.searchsorted(u, x))
            again[[at - 1, at]] = bad
        still = again & (np.diff(u) > smallest)
    return u, values


def _v_error(response: Response, u: Floats, values: Floats, v: Floats, more: Floats) -> float:
    """How far the polynomial through nodes v misses what is found at the nodes `more`, at a few u."""
    bend = np.abs(np.diff(np.diff(values, axis=0) / np.diff(u)[:, None, None], axis=0)).max(axis=(1, 2))
    chosen = np.unique([*np.linspace(0, u.size - 1, _WITNESSES).round().astype(int), 1 + int(bend.argmax())])
    new = more[1::2]
    guess = fill(u, v, values, u[chosen], new)
    return float(np.abs(guess - _at(response, u[chosen], new)).max())
