"""Springs along the edges: no damping, no bending stiffness. Their forces are in `stencil`.

Passes over lists of edges are plain loops: gather, arithmetic on contiguous rows (which the compiler turns into vector
code), then a sum over the padded list of edges that meet at each node, in a fixed order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects.interface import Setup, hook, only_if, slots, unsigned
from dynamics.membrane.layout import rows

NAME = "springs"
COST = "a pass over all edges in each step"

#: Temperature in K at which edges have their rest length.
REFERENCE_TEMPERATURE = 300.0


class Springs(NamedTuple):
    """Edges (e,) from node `start` to node `end`, with stiffness in N/m and rest length in m, empty for triangles.

    slots (d, n): positions, in the concatenation [pull, −pull, 0] over edges, of the forces on each node, for damping.
    stretch (e,): ℓ/L at which an edge tears. expansion (e,): thermal expansion in 1/K. All are empty where the effect
    is off.
    """

    start: Indices
    end: Indices
    stiffness: Floats
    rest: Floats
    slots: Indices
    stretch: Floats
    expansion: Floats


class SpringsWork(NamedTuple):
    """free (e,): stress-free lengths in m as they are now; empty where triangles carry the load."""

    free: Floats


def build(setup: Setup) -> Springs:
    """The edges of the mesh, as springs unless triangles carry the load."""
    mesh, lattice, joined = setup.mesh, setup.lattice, setup.lattice.stiffness.size > 0
    m, lists = len(mesh.edges), np.empty((0, 0), np.uint32)
    if setup.on("damping"):
        lists = slots(mesh.edges.ravel(), len(mesh.nodes), (np.arange(m)[:, None] + np.array([0, m])).ravel(), 2 * m)
    return Springs(
        start=unsigned(mesh.edges[:, 0]),
        end=unsigned(mesh.edges[:, 1]),
        stiffness=lattice.stiffness,
        rest=only_if(joined, mesh.lengths),
        slots=lists,
        stretch=only_if(setup.on("tensile_failure") and joined, 1.0 + lattice.limit_strain),
        expansion=only_if(setup.on("expansion") and joined, lattice.expansion),
    )


def work(model: Model) -> SpringsWork:
    """Free lengths at rest."""
    springs = model.effects.springs
    return SpringsWork(springs.rest[: springs.stiffness.size].copy())


@hook
def lengthen(model: Model, work: WorkSpace, temperature: Floats) -> None:
    """Free lengths (e,) at temperature (n,), where edges are springs that expand."""
    if model.effects.springs.expansion.size > 0:
        free_lengths(model.effects.springs, temperature, work.effects.springs.free)
        rows.put(work.effects.springs.free, model.stencil.joins, work.stencil.lengths)


@numba.njit(cache=True, error_model="numpy")
def separations(x: Floats, start: Indices, end: Indices, out: Floats) -> None:
    """Vectors out (3, ≥ e) in m from start to end of each edge, x (3, n)."""
    x0, x1, x2 = x[0], x[1], x[2]
    d0, d1, d2 = out[0], out[1], out[2]
    for i in range(start.size):
        a = start[i]
        b = end[i]
        d0[i] = x0[b] - x0[a]
        d1[i] = x1[b] - x1[a]
        d2[i] = x2[b] - x2[a]


@numba.njit(cache=True, error_model="numpy")
def free_lengths(springs: Springs, temperature: Floats, free: Floats) -> None:
    """Stress-free lengths (e,) L (1 + α (½(T_a + T_b) − 300 K)) of the edges, where they expand."""
    start, end, rest, alpha = springs.start, springs.end, springs.rest, springs.expansion
    for i in range(alpha.size):
        mean = 0.5 * (temperature[start[i]] + temperature[end[i]])
        free[i] = rest[i] * (1.0 + alpha[i] * (mean - REFERENCE_TEMPERATURE))


@numba.njit(cache=True, error_model="numpy")
def negate(values: Floats, m: int) -> None:
    """values[m + i] = −values[i] for i < m; values (2 m,)."""
    for i in range(m):
        values[m + i] = -values[i]


@numba.njit(cache=True, error_model="numpy")
def collect(pull: Floats, slots: Indices, force: Floats) -> None:
    """Force (3, n) = sums of the columns of pull (3, ·) listed in slots (d, n)."""
    p0, p1, p2 = pull[0], pull[1], pull[2]
    f0, f1, f2 = force[0], force[1], force[2]
    for i in range(slots.shape[1]):
        s0 = 0.0
        s1 = 0.0
        s2 = 0.0
        for j in range(slots.shape[0]):
            e = slots[j, i]
            s0 += p0[e]
            s1 += p1[e]
            s2 += p2[e]
        f0[i] = s0
        f1[i] = s1
        f2[i] = s2


@numba.njit(cache=True, error_model="numpy")
def strain_and_energy(springs: Springs, x: Floats, free: Floats) -> tuple[float, float, float]:
    """Largest and smallest strain ℓ/L − 1, elastic energy Σ ½k(ℓ − L)² in J; x (3, n), free lengths (edges,) in m."""
    largest = -np.inf
    smallest = np.inf
    energy = 0.0
    for i in range(springs.start.size):
        a = springs.start[i]
        b = springs.end[i]
        d0, d1, d2 = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
        length = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        strain = length / free[i] - 1.0
        largest = max(largest, strain)
        smallest = min(smallest, strain)
        energy += 0.5 * springs.stiffness[i] * (length - free[i]) ** 2
    return largest, smallest, energy
