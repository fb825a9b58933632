"""Response of a grating over directions by the modal method: pressure, absorptance, efficiencies of its orders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from optics.modal import lamellar, thick_amplitudes
from optics.modal.scattering import NEGLIGIBLE
from optics.modal.steps import ModalCell
from optics.waves.incidence import electric_vector, order_cosines, stokes, wave_vector
from optics.waves.momentum import pressure

# Directions that are worked on at a time.
_BLOCK = 256


@dataclass(frozen=True)
class Response:
    """What the cell does with light from n_u × n_v directions.

    For the cell's own polarisation: q (n_u, n_v, 3) in (g, r, n); absorptance (n_u, n_v); reflected, transmitted
    (n_u, n_v, 2N + 1): efficiencies of the orders −N … N, zero for evanescent ones. q_stokes (n_u, n_v, 4, 3) and
    absorptance_stokes (n_u, n_v, 4): coefficients of the Stokes components (1, s₁, s₂, s₃) of
    `optics.waves.incidence.stokes`, to be summed.
    """

    q: Floats
    absorptance: Floats
    reflected: Floats
    transmitted: Floats
    q_stokes: Floats
    absorptance_stokes: Floats


def parts_of(
    axis: str, stack: lamellar.Stack, u: Floats, v: Floats, reflected: Floats, transmitted: Floats
) -> tuple[Floats, ...]:
    """The parts of a `Response` for directions u, v (n_d) from what orders, evanescent ones too, seem to carry.

    reflected, transmitted (n_d, 4, 2N + 1) of the orders −N … N for the Stokes components.
    """
    order = reflected.shape[-1] // 2
    orders = np.arange(-order, order + 1)
    u_m, w_front = order_cosines(u, v, stack.pitch, orders, stack.front_index)
    _, w_back = order_cosines(u, v, stack.pitch, orders, float(np.sqrt(stack.back).real))
    reflected = np.where(w_front.real[:, None] > 0, reflected, 0.0)
    # What enters an absorbing half-space stays there.
    transmitted = np.where((w_back.real[:, None] > 0) & (stack.back.imag == 0), transmitted, 0.0)
    w = wave_vector(u, v, stack.front_index)[:, 2, None]
    light = np.array([1.0, 0.0, 0.0, 0.0])
    q, absorptance = pressure(
        u[:, None],
        v[:, None],
        w,
        u_m=u_m[:, None],
        w_front=w_front[:, None],
        w_back=w_back[:, None],
        reflected=reflected,
        transmitted=transmitted,
        light=light,
    )
    s = stokes(u, v, electric_vector(u, v, axis, stack.front_index), stack.front_index)
    nominal = [np.einsum("ds,ds...->d...", s, part) for part in (q, absorptance, reflected, transmitted)]
    return (*nominal, q, absorptance)


def _solve_block(
    axis: str, stack: lamellar.Stack, u: Floats, v: Floats, order: int, negligible: float
) -> tuple[Floats, ...]:
    """The parts of a `Response` for directions u, v (n_d)."""
    solver = thick_amplitudes.efficiencies if stack.averaged else lamellar.efficiencies
    return parts_of(axis, stack, u, v, *solver(stack, u, v, order, negligible))


def solve(
    cell: ModalCell,
    u: NDArray[np.float64],
    v: NDArray[np.float64],
    order: int,
    negligible: float = NEGLIGIBLE,
) -> Response:
    """Response over directions u (n_u) × v (n_v) with diffraction orders −order … order (see `optics.modal.lamellar`).

    Modes that decay by more than `negligible` across their layer are taken not to see its far side; q moves by less
    than that.
    """
    stack = lamellar.prepare(cell)
    u, v = np.asarray(u, float), np.asarray(v, float)
    blocks_of_u = np.array_split(u, max(1, min(u.size, u.size * v.size // _BLOCK)))
    done = [
        _solve_block(cell.electric_axis, stack, np.repeat(part, v.size), np.tile(v, part.size), order, negligible)
        for part in blocks_of_u
    ]
    parts = [np.concatenate(part) for part in zip(*done, strict=True)]
    return Response(*(part.reshape(u.size, v.size, *part.shape[1:]) for part in parts))
