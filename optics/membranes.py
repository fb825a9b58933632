"""Fringes of thick homogeneous layers in gratings: can a table hold them, told before any of it is solved."""

from __future__ import annotations

import numpy as np

from optics.cells import LamellarStack, Metagrating, Profile, as_stack
from optics.files import InputError
from optics.incidence import Floats
from optics.lamellar import solve
from optics.outline import Grating, upright

# What a table holds at most (`optics.refinement`).
MOST_ROWS, MOST_LINES = 600, 160
# Rows for one fringe: cubic pieces of an eighth of it err by a thousandth of its height.
_A_FRINGE = 8
_PHASES = 8  # thicknesses within half a wavelength at which a layer's fringes are seen
_MORE_ORDERS = 6
_GRID = 401


def _fringes(index: float, pitch: float, u: Floats, v: Floats) -> tuple[float, float]:
    """Most fringes along u at any v, and along v at any u, of any order that runs, per half wavelength of thickness.

    An order's phase there and back is 2 k_z h: its fringes are the total change of k_z, with k₀ = 1, over π/h.
    """
    most = int((index + np.abs(u).max()) / pitch) + 1
    u_m = u[:, None, None] + pitch * np.arange(-most, most + 1)
    square = index**2 - u_m**2 - (v**2)[:, None]
    k_z = np.sqrt(np.maximum(square, 0.0))
    along_u, along_v = (np.abs(np.diff(k_z, axis=axis)).sum(axis=axis).max() for axis in (0, 1))
    return float(along_u), float(along_v)


def _height(stack: LamellarStack, i: int, u_max: float, v_max: float) -> float:
    """How far q departs from its mean while layer i grows by half a wavelength, at the worst of some directions."""
    layer = stack.layers[i]
    order = int((layer.index.n + u_max) / stack.pitch) + _MORE_ORDERS
    u, v = u_max * np.array([-0.83, -0.37, 0.11, 0.59]), v_max * np.array([0.07, 0.61])
    q = []
    for share in np.arange(_PHASES) / _PHASES:
        thicker = layer.thickness_nm + share * stack.wavelength_nm / (2 * layer.index.n)
        layers = [*stack.layers[:i], layer.model_copy(update={"thickness_nm": thicker}), *stack.layers[i + 1 :]]
        q.append(solve(stack.model_copy(update={"layers": layers}), u, v, order).q)
    return float(np.abs(np.array(q) - np.mean(q, axis=0)).max())


def _names(cell: Grating, i: int) -> tuple[str, str]:
    """The field that holds the thickness of a layer, and how its fringes are averaged."""
    if isinstance(cell, Metagrating):
        return "membrane_nm", "set membrane_coherent: false to average them"
    if isinstance(cell, Profile):
        return f"layer {i} of its staircase, thickness in nm", "give it as kind: lamellar with coherent: false"
    return f"layers[{i}].thickness_nm", "set its coherent: false to average them"


def check_fringes(cell: Grating, u_max: float, v_max: float, tolerance: float) -> None:
    """InputError where a layer's fringes are too fine for any table and higher than the tolerance; in a second."""
    stack = as_stack(upright(cell))
    u, v = np.linspace(-u_max, u_max, _GRID), np.linspace(0.0, v_max, _GRID)
    for i, layer in enumerate(stack.layers):
        if layer.ridges or not layer.coherent:
            continue
        halves = 2 * layer.thickness_nm / stack.wavelength_nm
        along_u, along_v = _fringes(layer.index.n, stack.pitch, u, v)
        excess = halves * _A_FRINGE * max(along_u / MOST_ROWS, along_v / MOST_LINES)
        decay = np.exp(-4 * np.pi * layer.index.k * layer.thickness_nm / stack.wavelength_nm)
        if excess <= 1 or decay <= tolerance or _height(stack, i, u_max, v_max) <= tolerance:
            continue
        field, cure = _names(cell, i)
        raise InputError(
            f"{cell.name}: {field} = {layer.thickness_nm:g}: makes {halves * along_u:.0f} fringes along u and "
            f"{halves * along_v:.0f} along v, more than {MOST_ROWS} × {MOST_LINES} directions hold; must be at most "
            f"{layer.thickness_nm / excess:.3g}, or {cure}, or narrow --u-max and --v-max"
        )
