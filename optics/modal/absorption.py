"""Light that a grating's own fields lose inside it: the integral of Im ε |E|² over its layers.

Energy that the orders carry away is told by fields outside; what the layers take up is told by fields within. Both
together are the light that came in where fields and modes are right: R + T + A = 1 to rounding, with however many
orders, as ⟦ε⟧ and ⟦1/ε⟧ conserve energy at any truncation. It is a check of the solution, not of its convergence.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamrider.arrays import Complexes, Floats
from optics.cells.schema import LamellarStack, Metagrating, as_stack
from optics.modal.lamellar import (
    Lamella,
    blocks,
    half_space,
    incident_light,
    lamellae,
    modes,
    plane_waves,
    prepare,
    square_root,
    tail,
)
from optics.modal.slanted import Steps, generator, step_up, steps, unmixed
from optics.modal.steps import ModalCell, Slanted
from optics.modal.stretch import Basis, basis

# The (2, 2) Padé approximant of a step is Gauss's method of two stages: these make its energy balance exact.
_GAUSS = np.array([[1 / 4, 1 / 4 - np.sqrt(3) / 6], [1 / 4 + np.sqrt(3) / 6, 1 / 4]])


def imbalance(cell: ModalCell, u: Floats, v: Floats, order: int) -> float:
    """Largest |R + T + A − 1| at directions u, v (n,), light polarised along r and along g."""
    return max(
        float(np.abs(_of_steps(cell, x, y, order) if isinstance(cell, Slanted) else _one(cell, x, y, order)).max())
        for x, y in zip(u.tolist(), v.tolist(), strict=True)
    )


def _of_steps(cell: Slanted, u: float, v: float, order: int) -> Floats:
    """R + T + A − 1 (2,) of a profile taken in steps; layers behind them, which are homogeneous, take up the rest."""
    stack, of, vs = prepare(cell), steps(cell, order), np.array([v])
    u_m = plane_waves(stack, np.array([u]), order)[2]
    n = u_m.shape[1]
    y = half_space(u_m, vs, complex(stack.front_index) ** 2)[1]
    front = _matrix(blocks((1 - y) / (1 + y), u_m, vs)[0])
    rho = _matrix(blocks(tail(stack.behind, stack.back, u_m, vs)[0], u_m, vs)[0])
    matrix, seen, down = np.empty((4 * n, 4 * n), complex), [rho], []
    for i in reversed(range(of.thickness.size)):
        generator(of, i, u_m[0], v, matrix)
        rho, through = step_up(matrix, 12.0 * np.eye(4 * n) + matrix @ matrix, rho)
        seen.append(rho)
        down.append(through)
    e_in, h_in = (part[0] for part in incident_light(np.array([u]), vs, order, stack.front_index))
    f = _driven(front, rho, e_in, h_in)
    entering, lost = _power(f, rho @ f), np.zeros(2)
    for i, (above, through) in enumerate(zip(seen[:0:-1], down[::-1], strict=True)):
        fields: Complexes = np.asarray(np.concatenate([f + above @ f, f - above @ f]) / 2, complex)
        lost += _lost_in_step(of, i, u_m[0], v, fields)
        f = np.asarray(through @ f, complex)
    return np.asarray((lost + _power(f, seen[0] @ f) - entering) / (e_in * h_in.conj()).sum(axis=0).real)


def _lost_in_step(of: Steps, i: int, u_m: Floats, v: float, top: Complexes) -> Floats:
    """∫ Eᴴ Im(Q) E dz (2,) over a step from the fields (4n, 2) at its top."""
    n, total = u_m.size, np.zeros(2)
    matrix = np.empty((4 * n, 4 * n), complex)
    generator(of, i, u_m, v, matrix)
    stages = np.split(np.linalg.solve(np.eye(8 * n) - np.kron(_GAUSS, matrix), np.concatenate([top, top])), 2)
    for share, one in unmixed(of, i):
        z, z_x, q_zz = one.z[0], one.z_x[0], np.linalg.inv(one.z[0])
        q_xz = q_zz @ z_x
        q_xx = one.p[0] + q_xz @ z_x
        for turned_x, e_x, h_x, h_y in (np.split(stage, 4) for stage in stages):
            e_y, e_z = -turned_x, z @ (v * h_x - u_m[:, None] * h_y) - z_x @ e_x
            d_x, d_y, d_z = q_xx @ e_x + q_xz @ e_z, one.epsilon[0] @ e_y, q_xz @ e_x + q_zz @ e_z
            total += share * (e_x.conj() * d_x + e_y.conj() * d_y + e_z.conj() * d_z).sum(axis=0).imag / 2
    return np.asarray(of.thickness[i] * total)


def _driven(front: Complexes, rho: Complexes, e_in: Complexes, h_in: Complexes) -> Complexes:
    """f₊ (2n, 2) at the top of the first layer, driven by light with the fields e_in and h_in (2n, 2)."""
    source = e_in + h_in - front @ (e_in - h_in)
    return np.asarray(np.linalg.solve(np.eye(len(front)) - front @ rho, source), complex)


def _one(cell: Metagrating | LamellarStack, u: float, v: float, order: int) -> Floats:
    """R + T + A − 1 (2,) of both polarisations; R and T are the power through the first plane and the last."""
    stack = prepare(cell)
    over = basis(stack.stretch(order), u, stack.pitch, order)
    u_m, vs = over.cosines[None], np.array([v])
    layers = lamellae(as_stack(cell))
    waves = [_waves(layer, over, v) for layer in layers]
    front, back = (
        _matrix(blocks((1 - y) / (1 + y), u_m, vs)[0])
        for y in (half_space(u_m, vs, e)[1] for e in (complex(stack.front_index) ** 2, stack.back))
    )
    rho: Complexes = back
    tops: list[Complexes] = []
    bounces: list[Complexes] = []
    for plus, minus, x, *_ in reversed(waves):
        bounce = np.asarray(np.linalg.solve(plus - rho @ minus, (rho @ plus - minus) * x), complex)
        top = np.asarray(plus + minus @ (x[:, None] * bounce), complex)
        rho = np.asarray(np.linalg.solve(top.T, (minus + plus @ (x[:, None] * bounce)).T).T, np.complex128)
        tops.append(top)
        bounces.append(bounce)
    e_in, h_in = (part[0] for part in incident_light(np.array([u]), vs, order, stack.front_index))
    f = _driven(front, rho, e_in, h_in)
    entering, lost = _power(f, rho @ f), np.zeros(2)
    for wave, entry, turn, layer in zip(waves, tops[::-1], bounces[::-1], layers, strict=True):
        down = np.asarray(np.linalg.solve(entry, f), complex)
        up = np.asarray(turn @ down, complex)
        lost += _loss(wave, down, up, layer.thickness)
        f = np.asarray(wave.plus @ (wave.x[:, None] * down) + wave.minus @ up, complex)
    power = (e_in * h_in.conj()).sum(axis=0).real
    return np.asarray((lost + _power(f, back @ f) - entering) / power)


def _matrix(tensor: Complexes) -> Complexes:
    """Blocks (n, 2, 2) as a matrix (2n, 2n)."""
    return np.block([[np.diag(tensor[:, i, j]) for j in (0, 1)] for i in (0, 1)])


def _power(plus: Complexes, minus: Complexes) -> Floats:
    """Power along +z (2,) of f₊ and f₋ (2n, 2)."""
    return np.asarray((((plus + minus) / 2) * ((plus - minus) / 2).conj()).sum(axis=0).real)


class _Waves(NamedTuple):
    """f₊, f₋ (2n, 2n) of the modes of a layer, their decays and wave numbers (2n,), and matrices of what they lose.

    across, along (2n, 2n): fields Fᴴ M F of pairs of modes, of E_x and E_y, which keep their sign where a wave runs
    back, and of E_z, which changes it.
    """

    plus: Complexes
    minus: Complexes
    x: Complexes
    k_z: Complexes
    across: Complexes
    along: Complexes


def _waves(layer: Lamella, over: Basis, v: float) -> _Waves:
    t = modes(layer, over)
    k_z = square_root(np.asarray(np.concatenate([t.beta2_s, t.beta2_p]) - v**2, complex))
    k_s, k_p = np.split(k_z, 2)
    none = np.zeros_like(t.psi)
    e_x, d_x = np.hstack([none, t.displaced_phi]), np.hstack([none, t.phi * t.beta2_p])
    e_y, e_z = np.hstack([t.psi * k_s, -v * t.k_phi]), np.hstack([-v * t.psi, -t.k_phi * k_p])
    h = np.vstack([np.hstack([-t.psi * t.beta2_s, none]), np.hstack([v * t.k_psi, t.phi * k_p])])
    turned = np.vstack([-e_y, e_x])
    epsilon, inverse = (_imaginary(part) for part in layer.matrices(over))
    across = e_y.conj().T @ epsilon @ e_y - d_x.conj().T @ inverse @ d_x
    return _Waves(turned + h, turned - h, np.exp(1j * k_z * layer.thickness), k_z, across, e_z.conj().T @ epsilon @ e_z)


def _imaginary(matrix: Complexes) -> Complexes:
    return np.asarray((matrix - matrix.conj().T) / 2j)


def _loss(of: _Waves, down: Complexes, up: Complexes, thickness: float) -> Floats:
    """∫ Im ε |E|² dz (2,) of amplitudes (2n, 2) from the top down and from the bottom up."""
    start, end = of.k_z.conj()[:, None], of.k_z[None]
    same = _over(end - start, thickness, np.asarray(np.exp(1j * (end - start) * thickness) - 1.0, complex), thickness)
    cross = _over(start + end, thickness, of.x - of.x.conj()[:, None], thickness * of.x[None])

    def pairs(a: Complexes, matrix: Complexes, b: Complexes) -> Complexes:
        return np.asarray(np.einsum("pc,pq,qc->c", a.conj(), matrix, b))

    total = pairs(down, (of.across + of.along) * same, down) + pairs(up, (of.across + of.along) * same, up)
    return np.asarray((total + 2 * pairs(down, (of.across - of.along) * cross, up).real).real)


def _over(a: Complexes, thickness: float, numerator: Complexes, limit: Complexes | float) -> Complexes:
    """Numerator / (i a), or its limit where a vanishes."""
    small = np.abs(a * thickness) < 1e-7
    return np.asarray(np.where(small, limit, numerator / np.where(small, 1.0, 1j * a)))
