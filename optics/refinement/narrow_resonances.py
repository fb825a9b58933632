"""Refinement of a table whose response has narrow resonances: these are found and taken out, then the rest is refined.

The rest is smooth; rows and lines follow it as they do without resonances.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from beamrider.arrays import Complexes, Floats
from beamrider.io.files import progress
from optics.refinement.regions import Measures, Refined, refine, together
from optics.refinement.samples import Samples, Solve
from optics.table.pole_tracks import Followed, Resonances, difference, follow
from optics.table.resonances import Along, LinePoles, Window, find_poles
from optics.table.verification import beside_poles, raise_beside

# Shares of the tolerance: heights that are left alone, and errors of the sum over poles between its lines of v.
_LOWEST, _BETWEEN = 0.05, 0.2
_SCOUTED = 9  # lines on which resonances are looked for first
# Against 1.5 times the orders, which have 0.3 to 0.45 of the error, this times the difference is at least the error.
_SEEN = 2.0
# Errors are seen against FINER times the orders. Those are raised until more change resonances by less than this share.
FINER, _SETTLED = 1.5, 0.15


def _along(solve: Solve) -> Along:
    """Solutions along a line of v."""
    return lambda u, v: solve(u, np.array([v]))[:, :, 0]


def _lines(solve: Solve, samples: Samples, window: Window, v: Floats, lowest: float, name: str) -> list[LinePoles]:
    """Poles on lines v; the rows of all are solved together."""
    nodes = solve(samples.u, v)
    return [
        find_poles(_along(solve), window, samples.u, float(y), lowest, nodes[:, :, j])
        for j, y in enumerate(progress(v, f"{name}: any resonances", unit="line"))
    ]


def _look(samples: Samples, window: Window, tolerance: float, name: str) -> Followed:
    """The narrow resonances of the response on all lines of the samples, followed in between."""
    lowest = _LOWEST * tolerance

    def find(v: float, known: Complexes) -> LinePoles:
        return find_poles(_along(samples.solve), window, samples.u, v, lowest, known=known)

    lines = [
        find_poles(_along(samples.solve), window, samples.u, float(v), lowest, samples.nodes[:, :, j])
        for j, v in enumerate(progress(samples.v, f"{name}: resonances", unit="line"))
    ]
    return follow(find, lines, window, samples.parity, samples.leading, _BETWEEN * tolerance, name)


def are_there(scout: Solve, samples: Samples, window: Window, tolerance: float, name: str = "table") -> bool:
    """Whether there are any resonances to be taken out, as seen by a solver of few orders on some lines."""
    v = samples.v[np.unique(np.linspace(0, samples.v.size - 1, _SCOUTED).round().astype(int))]
    return any(line.p.size for line in _lines(scout, samples, window, v, _LOWEST * tolerance, name))


def enough_orders(
    solver: Callable[[int], Solve],
    rungs: Sequence[int],
    samples: Samples,
    window: Window,
    tolerance: float,
    name: str = "table",
) -> int:
    """The first rung, or the last, with which resonances on a few lines are settled to a share of the tolerance."""
    v = samples.v[[0, samples.v.size // 2, -1]]
    lines = _lines(solver(rungs[0]), samples, window, v, _LOWEST * tolerance, name)
    for order, finer in pairwise(rungs):
        more = _lines(solver(finer), samples, window, v, _LOWEST * tolerance, name)
        apart = max(difference(a, b, window, samples.leading) for a, b in zip(lines, more, strict=True))
        if apart <= _SETTLED * tolerance:
            return order
        lines = more
    return rungs[-1]


def _added(samples: Samples, resonances: Resonances, sign: float) -> Samples:
    """The samples with resonances added, or taken away."""
    solve = samples.solve

    def changed(u: Floats, v: Floats) -> Floats:
        return solve(u, v) + sign * resonances.on(u[:, None], v)

    return replace(
        samples,
        solve=changed,
        nodes=samples.nodes + sign * resonances.on(samples.u[:, None], samples.v),
        on_curves=samples.on_curves + sign * resonances.on(samples.curves.u(samples.v), samples.v),
    )


def refine_with_resonances(
    samples: Samples, window: Window, finer: Solve, tolerance: float, measures: Measures, name: str = "table"
) -> Refined:
    """`refine` of the response less its narrow resonances; `finer` solves with more orders.

    The samples that are returned hold the whole response at their nodes.
    """
    followed = _look(samples, window, tolerance, name)
    found = followed.resonances
    reasons = [
        f"a search for resonances near u = {u:.4g}, v = {line.v:.4g} did not converge ({error:.1g})"
        for line in followed.missed
        for u, error in line.missed
    ] + [
        f"a resonance that changes too fast with v near v = {v:.5g} to be followed, known to {error:.1g}"
        for v, error in followed.left
        if error > tolerance
    ]
    if not found.count:
        refined = refine(samples, tolerance, measures, name)
        return replace(refined, reasons=(*refined.reasons, *reasons))
    refined = refine(_added(samples, found, -1.0), tolerance, measures, name)
    rest, whole = refined.samples, _added(refined.samples, found, 1.0)
    errors, more = _stated(rest, found, finer, refined.errors, tolerance, measures)
    return Refined(whole, errors, found, (*refined.reasons, *reasons, *more))


def _stated(
    rest: Samples, found: Resonances, finer: Solve, errors: Floats, tolerance: float, measures: Measures
) -> tuple[Floats, list[str]]:
    """Errors (m, n_u, n_v) raised beside the resonances to what is found there, and which of these are too large."""
    k, window = rest.parity.size, (float(rest.u[0]), float(rest.u[-1]))
    arrays = rest.arrays(k)

    def whole(u: Floats, v: Floats) -> Floats:
        return finer(u, v) - found.on(u[:, None], v)

    reasons = []
    for solve, weight in ((rest.solve, 1.0), (whole, _SEEN)):
        beside = [
            (pole, v, weight * worst)
            for pole, v, worst in beside_poles(solve, arrays, k, together(measures), found, window)
        ]
        errors = raise_beside(errors, rest.u, rest.v, found, beside)
        for pole, v, worst in beside:
            at = int(worst[0].argmax())
            if worst[0, at] > tolerance:
                p = found.place(pole, v[at])
                reasons.append(
                    f"a resonance of half width {p.imag:.2g} at u = {p.real:.6g}, v = {v[at]:.4g}, "
                    f"known to {worst[0, at]:.2g}"
                )
    return errors, reasons
