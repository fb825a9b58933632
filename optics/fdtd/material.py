"""The permittivity that an FDTD grid sees: chosen so that errors are small and fall smoothly with the pixel squared.

A jump of ε within a pixel is replaced by a tensor that is the mean of ε for E along the face and the harmonic mean
across it (Farjadpour et al. 2006, Opt. Lett. 31, 2972). The means are taken with a quadratic B-spline, three pixels
wide. Meep's own averaging takes a box of one pixel: that keeps the area but not its first moment, and the error then
depends on where within a pixel a face happens to lie, which spoils Richardson's extrapolation. For a layer that
dependence is a second-order term 20 times smaller with the spline (5 times smaller than with a hat of two pixels).

Light in a material is too slow on the grid. Yee's scheme obeys ε sin²(ωΔt/2)/Δt² = Σ sin²(k_i h/2)/h² (Taflove &
Hagness, Computational Electrodynamics, §4.3); to second order, and on average over the directions of k (⟨c⁴ + s⁴⟩ = ¾),
the wave has its true length if ε is lowered by the factor of `on_grid`. Resonances then lie about where they should.

In metals and other absorbers the same means are taken of complex permittivities: each is that of a passive medium
(Deinega & Valuev 2007, Opt. Lett. 32, 3429), which `fdtd_poles` makes for the one frequency that is looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from beamrider.arrays import Complexes, Floats
from optics.cells.outline import Grating, depth_nm, polygons, staircase
from optics.cells.schema import LamellarStack, Metagrating
from optics.fdtd.grid import Layout, half_spaces

_SLICES_PER_PIXEL, _FEWEST_SLICES = 8, 16
_WEAK_ABSORPTION, _STRONG_ABSORPTION = 1e-3, 0.2
_DEEP = 1e3  # periods: deeper than any grid

Kernel = Callable[[Floats], Floats]


def spline(t: Floats) -> Floats:
    """The quadratic B-spline at t (...): 0 beyond |t| = 3/2."""
    t = np.abs(t)
    return np.where(t < 0.5, 0.75 - t**2, np.clip(1.5 - t, 0, None) ** 2 / 2)


def spline_integral(t: Floats) -> Floats:
    """∫ of the quadratic B-spline from −∞ to t (...)."""
    size = np.clip(np.abs(t), 0, 1.5)
    half = np.where(size < 0.5, 0.75 * size - size**3 / 3, 0.5 - (1.5 - size) ** 3 / 6)
    return 0.5 + np.sign(t) * half


def on_grid(epsilon: Complexes, phase: float, courant: float) -> Complexes:
    """Permittivity (...) with which waves keep their length on a grid; phase: light's in vacuum over a pixel, ωh/c."""
    return epsilon * (1 - phase**2 / 12 * (0.75 * epsilon - courant**2))


class Averages(NamedTuple):
    """What a grid point sees (...): mean and harmonic mean of ε, and the unit normal of the face along X and Y."""

    mean: Complexes
    harmonic: Complexes
    n_x: Floats
    n_y: Floats

    def tensor(self) -> Complexes:
        """ε_XX, ε_YY, ε_ZZ and ε_XY (..., 4)."""
        return tensor(self.mean, self.harmonic, self.n_x, self.n_y)


def tensor(along: Any, across: Any, n_x: Any, n_y: Any) -> Any:
    """XX, YY, ZZ and XY (..., 4) of what is `across` along the normal and `along` at right angles to it."""
    change = across - along
    return np.stack([along + change * n_x**2, along + change * n_y**2, along, change * n_x * n_y], axis=-1)


@dataclass(frozen=True)
class Material:
    """A cross-section as rectangles on a grid, and the half-spaces.

    spans (n, 4): x₁, x₂, y₁, y₂ in µm, Meep's X and Y; epsilon, inverse (n,): what each adds to the grid's ε and 1/ε of
    that below it; front, back: the grid's ε in the half-spaces.
    """

    spans: Floats
    epsilon: Complexes
    inverse: Complexes
    front: complex
    back: complex
    period: float
    pixel: float

    def weights(self, x: Floats, y: Floats, across: Kernel, along: Kernel) -> tuple[Floats, Floats]:
        """What a kernel at x (k) and y (l) finds of each rectangle's extent: (n, k) and (n, l)."""
        x1, x2, y1, y2 = self.spans.T[:, :, None]
        ends = [[(end + shift * self.period - x) / self.pixel for end in (x1, x2)] for shift in (-1, 0, 1)]
        width = np.sum([across(b) - across(a) for a, b in ends], axis=0)
        return width, along((y2 - y) / self.pixel) - along((y1 - y) / self.pixel)

    def averages(self, x: Floats, y: Floats) -> Averages:
        """What the grid points at x (k), y (l) see, arrays (k, l)."""
        width, height = self.weights(x, y, spline_integral, spline_integral)
        slope_x = self.weights(x, y, spline, spline_integral)[0]
        slope_y = self.weights(x, y, spline_integral, spline)[1]
        mean = self.front + (width * self.epsilon[:, None]).T @ height
        harmonic = 1 / (1 / self.front + (width * self.inverse[:, None]).T @ height)
        jump = self.epsilon.real[:, None]
        normal = np.stack([(slope_x * jump).T @ height, (width * jump).T @ slope_y])
        size = np.hypot(*normal)
        n_x, n_y = np.where(size > 1e-9, normal / np.where(size > 1e-9, size, 1.0), 0.0)
        return Averages(mean, harmonic, n_x, n_y)


def material(cell: Grating, grid: Layout, courant: float) -> Material:
    """The cell on a grid; slanted and round walls as a staircase of an eighth of a pixel."""
    depth = depth_nm(cell) / 1000
    stack = staircase(cell, max(_FEWEST_SLICES, int(np.ceil(_SLICES_PER_PIXEL * depth / grid.pixel))))
    front, back = half_spaces(cell)
    spans, inside, around = _rectangles(stack, front, back)
    left, top = -grid.period / 2, grid.y_bottom + depth
    placed = np.stack([left + spans[:, 0], left + spans[:, 1], top - spans[:, 3], top - spans[:, 2]], axis=-1)
    phase = 2 * np.pi * grid.pixel * 1000 / cell.wavelength_nm
    # Vacuum is left as it is: the waves that leave must stay those of their diffraction orders.
    new, old, ends = (
        np.where(e == 1, e, on_grid(e, phase, courant)) for e in (inside, around, np.array([front, back]))
    )
    inverse = np.divide(1, new) - np.divide(1, old)
    return Material(placed, new - old, inverse, complex(ends[0]), complex(ends[1]), grid.period, grid.pixel)


def _rectangles(stack: LamellarStack, front: complex, back: complex) -> tuple[Floats, Complexes, Complexes]:
    """g₁, g₂, n₁, n₂ (n, 4) in µm of layers, the ridges in them and what lies behind, ε (n,) in each and around it."""
    spans, inside, around, top = [], [], [], 0.0
    for layer in stack.layers:
        bottom = top + layer.thickness_nm
        spans.append((0.0, stack.period_nm, top, bottom))
        spans += [(ridge.start_nm, ridge.start_nm + ridge.width_nm, top, bottom) for ridge in layer.ridges]
        inside += [layer.index.permittivity, *(ridge.index.permittivity for ridge in layer.ridges)]
        around += [front, *(layer.index.permittivity for _ in layer.ridges)]
        top = bottom
    spans.append((0.0, stack.period_nm, top, top + _DEEP * stack.period_nm))
    return np.array(spans) / 1000, np.array([*inside, back], complex), np.array([*around, front], complex)


def weakly_absorbing(cell: Grating) -> bool:
    """Whether absorption is so small that it must come from first-order perturbation theory, not from 1 − R − T.

    A metal's never is, nor that of a half-space, which takes all that enters it.
    """
    return half_spaces(cell)[1].imag == 0 and all(
        epsilon.imag <= _WEAK_ABSORPTION * epsilon.real for _, epsilon in polygons(cell)
    )


def nearly_transparent(cell: Grating) -> bool:
    """Whether no part of the cell is a metal or absorbs within a few wavelengths."""
    every = (half_spaces(cell)[1], *(epsilon for _, epsilon in polygons(cell)))
    return all(epsilon.real >= 1 and epsilon.imag <= _STRONG_ABSORPTION * epsilon.real for epsilon in every)


def second_order(cell: Grating) -> bool:
    """Whether errors fall with the square of the pixel: no metal, and no absorber with slanted faces (see `Media`)."""
    return nearly_transparent(cell) and (
        weakly_absorbing(cell)
        or isinstance(cell, LamellarStack)
        or (isinstance(cell, Metagrating) and cell.corner_radius_nm == 0)
    )


def lossless(cell: Grating) -> bool:
    """Whether no part of the cell absorbs."""
    return half_spaces(cell)[1].imag == 0 and all(epsilon.imag == 0 for _, epsilon in polygons(cell))
