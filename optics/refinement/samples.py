"""What a solver has found of a grating's response: on rows, on lines and on cut-offs, and the table that it makes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from beamrider.arrays import Floats
from optics.table.hermite import Values, make_patches
from optics.table.lookup import TableArrays, pack
from optics.table.strips import Curves, lay_out

# k quantities (k, n_u, n_v) at directions u (n_u) × v (n_v).
Solve = Callable[[Floats, Floats], Floats]

_FIRST_BESIDE = 0.03


@dataclass(frozen=True)
class Samples:
    """What the solver found: `nodes` (k, n_u, n_v) on rows u × lines v, `on_curves` (k, n_curves, n_v).

    `on_curves` is NaN where a curve is outside the window. `parity` (k): of each quantity under v → −v. The first
    `leading` of them are to be interpolated well; the others come along.
    """

    solve: Solve
    parity: Floats
    leading: int
    u: Floats
    v: Floats
    curves: Curves
    nodes: Floats
    on_curves: Floats

    def arrays(self, n: int) -> TableArrays:
        """The table that the samples make of the first n quantities, a multiple of 4."""
        layout = lay_out(self.curves, self.u[0], self.u[-1], self.v)
        values = Values(self.u, self.v, self.nodes[:n], self.on_curves[:n], self.parity[:n])
        return pack(layout, values, make_patches(layout, values), False, False)

    def with_rows(self, u: Floats) -> Samples:
        """More rows u (n,)."""
        order = np.argsort(every := np.concatenate([self.u, u]))
        nodes = np.concatenate([self.nodes, self.solve(u, self.v)], axis=1)[:, order]
        return replace(self, u=every[order], nodes=nodes)

    def with_lines(self, v: Floats) -> Samples:
        """More lines v (n,)."""
        order = np.argsort(every := np.concatenate([self.v, v]))
        nodes = np.concatenate([self.nodes, self.solve(self.u, v)], axis=2)[..., order]
        more = on_curves(self.solve, self.curves, v, self.u[0], self.u[-1], len(self.nodes))
        on_them = np.concatenate([self.on_curves, more], axis=2)[..., order]
        return replace(self, v=every[order], nodes=nodes, on_curves=on_them)

    def with_curves(self, curves: Curves) -> Samples:
        """More lines of nodes beside cut-offs."""
        more = on_curves(self.solve, curves, self.v, self.u[0], self.u[-1], len(self.nodes))
        together = Curves(
            *(
                np.concatenate(pair)
                for pair in zip(
                    vars(self.curves).values(),
                    vars(curves).values(),
                    strict=True,
                )
            )
        )
        return replace(self, curves=together, on_curves=np.concatenate([self.on_curves, more], axis=1))


def solve_each(solve: Solve, u: Floats, v: Floats, k: int) -> Floats:
    """Quantities (k, n) at single directions u, v (n): all at once by solvers that can, which have a method for it."""
    at_once: Solve | None = getattr(solve, "each", None)
    if at_once and u.size:
        return at_once(u, v)
    found = [solve(u[i : i + 1], v[i : i + 1])[:, 0, 0] for i in range(u.size)]
    return np.array(found).reshape(-1, k).T


def on_curves(solve: Solve, curves: Curves, v: Floats, u_min: float, u_max: float, k: int) -> Floats:
    """Quantities (k, n_curves, n_v) on curves at v (n_v); NaN outside the window."""
    out = np.full((k, len(curves), v.size), np.nan)
    where = np.nonzero(curves.inside(v, u_min, u_max))
    out[:, where[0], where[1]] = solve_each(solve, np.clip(curves.u(v), u_min, u_max)[where], v[where[1]], k)
    return out


def start(solve: Solve, curves: Curves, u: Floats, v: Floats, parity: Floats, leading: int) -> Samples:
    """Samples on rows u (n,), lines v (m,) and curves, with one more line of nodes on both sides of each curve."""
    both = [curves.beside(np.full(len(curves), side * _FIRST_BESIDE**2)) for side in (-1.0, 1.0)]
    nodes = solve(u, v)
    samples = Samples(solve, parity, leading, u, v, curves.take([]), nodes, np.empty((len(nodes), 0, v.size)))
    for more in (curves, *both):
        samples = samples.with_curves(more)
    return samples
