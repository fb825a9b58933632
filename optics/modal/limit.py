"""Gratings whose fields have no limit: edges between a metal and a dielectric that hold light without end.

Beside an edge of 90° between permittivities ε₁ and ε₂ fields across the ridges go as r^(τ−1) with

    cos(πτ/2) = ±(ε₁ − ε₂) / (2 (ε₁ + ε₂))

(Meixner 1972, IEEE Trans. Antennas Propag. 20, 442). For a real ratio within (−3, −1/3) τ is imaginary: fields
oscillate ever faster towards the edge, and no number of orders converges (Li & Granet 2011, J. Opt. Soc. Am. A 28,
738). Absorption makes Re τ > 0: convergence returns, slowly where it is weak.
"""

from __future__ import annotations

import cmath
import math

from beamrider.io.files import InputError
from optics.cells.outline import Grating, upright
from optics.cells.schema import LamellarStack, Metagrating, as_stack
from optics.modal.lamellar import lamellae

# Edges with less than this Re τ count as having no limit: errors would fall as N^(−10 τ) at best.
_WEAKEST = 0.03


def edge_exponent(a: complex, b: complex) -> float:
    """Re τ ≥ 0 of the fields at an edge of 90° between two permittivities; 1 where there is no edge."""
    if a + b == 0:
        return 0.0
    cosine = (a - b) / (2 * (a + b))
    return min(abs((2 / math.pi * cmath.acos(sign * cosine)).real) for sign in (1, -1))


def weakest_edge(stack: Metagrating | LamellarStack) -> tuple[float, complex]:
    """Smallest exponent of the edges of a cell with upright walls, and the ratio of permittivities there."""
    found = [(1.0, 1.0 + 0j)]
    for layer in lamellae(as_stack(stack)):
        found += [(edge_exponent(value, layer.background), value / layer.background) for _, _, value in layer.ridges]
    return min(found, key=lambda edge: edge[0])


def without_limit(stack: Metagrating | LamellarStack) -> bool:
    """Whether no number of orders would do."""
    return weakest_edge(stack)[0] < _WEAKEST


def refuse_without_limit(cell: Grating) -> None:
    """InputError where no number of orders would do."""
    exponent, ratio = weakest_edge(upright(cell, 4))
    if exponent < _WEAKEST:
        raise InputError(
            f"{cell.name}: permittivity of ridges over that of gaps = {ratio.real:.3g}{ratio.imag:+.2g}i: must be "
            "outside −3 … −1/3 or absorb more: fields at such edges have no limit, more orders would not help"
        )
