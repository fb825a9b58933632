"""Fringes of thick homogeneous layers in gratings: can samples hold them, told before any of it is solved."""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from optics.cells.outline import Grating, upright
from optics.cells.schema import LamellarStack, Metagrating, Profile, as_stack
from optics.modal.response import solve
from optics.modal.steps import Slanted, modal_cell

# What a table holds at most (`optics.refinement`).
MOST_ROWS, MOST_LINES = 600, 160
# Rows for one fringe: cubic pieces of an eighth of it err by a thousandth of its height.
_A_FRINGE = 8
_PHASES = 8  # thicknesses within half a wavelength at which a layer's fringes are seen
_MORE_ORDERS = 6
_GRID = 401
# Layers that would take more than this part of the directions that a table holds count as thick.
_THICK = 0.3
# Orders that are followed in thick layers, at most: their matrices hold 8 times the square of as many numbers.
MOST_ORDERS = 21


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


def least_thickness(cell: Grating, u_max: float, v_max: float, tolerance: float) -> float:
    """Thickness in nm from which layers are too thick to have their fringes sampled; infinite where none is.

    In a second: a layer is, where its fringes would take a good part of what a table holds and are higher than the
    tolerance. InputError where such fringes cannot be told apart from the rest either.
    """
    stack = as_stack(upright(cell))
    u, v = np.linspace(-u_max, u_max, _GRID), np.linspace(0.0, v_max, _GRID)
    found = np.inf
    for i, layer in enumerate(stack.layers):
        if layer.ridges or not layer.coherent:
            continue
        halves = 2 * layer.thickness_nm / stack.wavelength_nm
        along_u, along_v = _fringes(layer.index.n, stack.pitch, u, v)
        excess = halves * _A_FRINGE * max(along_u / MOST_ROWS, along_v / MOST_LINES)
        decay = np.exp(-4 * np.pi * layer.index.k * layer.thickness_nm / stack.wavelength_nm)
        if excess <= _THICK or decay <= tolerance or _height(stack, i, u_max, v_max) <= tolerance:
            continue
        found = min(found, layer.thickness_nm)
        why = "walls are slanted" if isinstance(modal_cell(cell, 8), Slanted) else _inseparable(stack, found, u_max)
        if excess > 1 and why:
            field, cure = _names(cell, i)
            raise InputError(
                f"{cell.name}: {field} = {layer.thickness_nm:g}: makes {halves * along_u:.0f} fringes along u and "
                f"{halves * along_v:.0f} along v, more than {MOST_ROWS} × {MOST_LINES} directions hold, and {why}; "
                f"must be at most {layer.thickness_nm / excess:.3g}, or {cure}, or narrow --u-max and --v-max"
            )
        found = np.inf if why else found
    return found


def thick_range(stack: LamellarStack, least_nm: float) -> tuple[int, int] | None:
    """The first and the last homogeneous layer that is at least so thick; None where there is none."""
    at = [i for i, layer in enumerate(stack.layers) if not layer.ridges and layer.thickness_nm >= least_nm]
    return (at[0], at[-1]) if at else None


def _inseparable(stack: LamellarStack, least_nm: float, u_max: float) -> str:
    """Why layers of at least so much cannot be parted from the rest of the stack; empty where they can."""
    first, last = thick_range(stack, least_nm) or (0, 0)
    if not all(layer.coherent for layer in stack.layers):
        return "other layers have theirs averaged"
    if any(layer.ridges for layer in stack.layers[first:last]):
        return "there are ridges between two such layers"
    count = 1 + 2 * int((max(stack.layers[i].index.n for i in (first, last)) + u_max) / stack.pitch)
    return f"{count} diffraction orders run in it, more than {MOST_ORDERS}" if count > MOST_ORDERS else ""
