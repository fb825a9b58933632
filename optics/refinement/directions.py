"""Which directions to solve, how to interpolate between them, and how large the interpolation error is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BarycentricInterpolator, CubicHermiteSpline, CubicSpline

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from optics.table.hermite import slope_matrix

Response = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Refined:
    """Nodes (n,) chosen by `refine`, and the interpolation error (n, k) of each value found beside them.

    missed_because: why it stopped before the tolerance was met; empty where it is met.
    """

    nodes: Floats
    error: Floats
    missed_because: str


def refine(response: Response, start: Floats, tolerance: float, smallest: float, most: int = 600) -> Refined:
    """Halve intervals until the table's own interpolation is good to `tolerance` at three places in each.

    `response` maps points (n,) to values (n, k). Intervals are left alone once narrower than `smallest` (at a kink no
    spacing is fine enough) or when `most` nodes are reached; the error that remains there is reported, with the reason.
    """
    nodes = np.unique(start)
    values = response(nodes)
    while True:
        error = np.max([_error(response, nodes, values, share) for share in (0.25, 0.5, 0.75)], axis=0)
        split = (error.max(axis=1) > tolerance) & (np.diff(nodes) > smallest)
        full = nodes.size + int(split.sum()) > most
        if not split.any() or full:
            break
        at, middle = np.flatnonzero(split) + 1, ((nodes[1:] + nodes[:-1]) / 2)[split]
        nodes, values = np.insert(nodes, at, middle), np.insert(values, at, response(middle), axis=0)
    none = np.zeros((1, error.shape[1]))
    beside = np.maximum(np.concatenate([error, none]), np.concatenate([none, error]))
    reason = f"more than {most} nodes" if full else f"intervals narrower than {smallest:g}"
    return Refined(nodes, beside, reason if error.max() > tolerance else "")


def _error(response: Response, nodes: Floats, values: Floats, share: float) -> Floats:
    """Error (n − 1, k) of the table at the same place in every interval."""
    places = nodes[:-1] + share * np.diff(nodes)
    guess = CubicHermiteSpline(nodes, values, slope_matrix(nodes) @ values)(places)
    return np.asarray(np.abs(guess - response(places)))


def chebyshev(low: float, high: float, count: int) -> Floats:
    """`count` Chebyshev-Lobatto points (count,), ends included, ascending."""
    if count == 1:
        return np.array([low])
    x = -np.cos(np.pi * np.arange(count) / (count - 1))
    return low + (high - low) * (x + 1) / 2


def even_nodes(v_max: float, count: int) -> Floats:
    """Nodes (count,) in v ≥ 0 for a response even in v: Chebyshev-Lobatto in v², v = 0 among them."""
    return np.sqrt(np.maximum(chebyshev(0.0, v_max**2, count), 0.0))


def fill(u_nodes: Floats, v_nodes: Floats, values: Floats, u: Floats, v: Floats) -> Floats:
    """Values (n_u, n_v, k) at u × v from values at u_nodes × v_nodes of a response that is even in v.

    A cubic spline in u (the resonances are in u) and the polynomial in v² through all v_nodes.
    """
    along = CubicSpline(u_nodes, values, axis=0)(u)
    if v_nodes.size == 1:
        return np.repeat(along, np.size(v), axis=1)
    polynomial = BarycentricInterpolator(v_nodes**2, np.swapaxes(along, 0, 1), axis=0, rng=0)
    return np.swapaxes(polynomial(np.asarray(v) ** 2), 0, 1)


def choose_nodes(
    u: Floats, v: Floats, values: Floats, tolerance: float, most_u: int = 81, most_v: int = 8
) -> tuple[Floats, Floats]:
    """Fewest tensor nodes from which `fill` reproduces a known response to `tolerance`.

    `values` (n_u, n_v, k) is the known response (of the modal solver) on a fine grid u × v, v ≥ 0 with v[0] = 0. Nodes
    in u are added where the error is largest; nodes in v² are Chebyshev points. Each axis gets half of the tolerance.
    """
    for count in range(2, most_v + 1):
        v_nodes = even_nodes(float(v[-1]), count)
        at_nodes = CubicSpline(v, values, axis=1)(v_nodes)
        if np.abs(fill(u, v_nodes, at_nodes, u, v) - values).max() <= tolerance / 2:
            break
    else:
        raise InputError(f"tolerance = {tolerance:g}: more than {most_v} nodes in v would be needed; allow more")
    chosen = [0, u.size // 4, u.size // 2, 3 * u.size // 4, u.size - 1]
    while len(chosen) <= most_u:
        error = np.abs(CubicSpline(u[chosen], values[chosen], axis=0)(u) - values).max(axis=(1, 2))
        worst = int(error.argmax())
        if error[worst] <= tolerance / 2:
            return u[chosen], v_nodes
        chosen = sorted([*chosen, worst])
    raise InputError(f"tolerance = {tolerance:g}: more than {most_u} nodes in u would be needed; allow more")
