"""Gratings with thick homogeneous layers whose fringes are averaged: powers of the orders to and fro, not fields.

Such layers part the stack. Each part is solved coherently from both sides, for every order that runs in the layers
beside it. In a thick layer waves of different orders, and any two that have gone to and fro differently, add as powers.
The two polarisations of one order have the same phase everywhere in it and stay coherent: an order is a coherency
matrix J = ⟨A A†⟩ (Born & Wolf, §10.9) of its s and p wave of unit power, held as J_ss, J_sp, J_ps, J_pp. Amplitudes S
turn J into S J S†, in these four numbers S ⊗ S*. For films that is the incoherent mode of `tmm`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamrider.arrays import Complexes, Floats, Integers


class Medium(NamedTuple):
    """Waves of n orders in a homogeneous medium: see `medium`."""

    turn: Floats
    scale: Floats
    decay: Floats


def medium(u_m: Floats, v: Floats, k_z: Complexes, y: Complexes, depth: float) -> Medium:
    """The waves of orders u_m (n_d, n) in a medium with k_z (n_d, n), admittances y (2, n_d, n) and k₀ × thickness.

    turn (n_d, n, 2, 2): ẑ × E of the s and the p wave (last axis) in x, y. scale (n_d, n, 2): root of the power of unit
    ẑ × E; 0 for orders that decay faster than they run. decay (n_d, n): of power, once through.
    """
    k_t = np.hypot(u_m, v[:, None])
    safe = np.where(k_t > 0, k_t, 1.0)
    a, b = np.where(k_t > 0, u_m / safe, 1.0), np.where(k_t > 0, v[:, None] / safe, 0.0)
    turn = np.stack([np.stack([a, -b], -1), np.stack([b, a], -1)], -2)
    runs = k_z.real > k_z.imag
    scale = np.where(runs, np.sqrt(np.maximum(y.real, 0.0)), 0.0)
    return Medium(turn, np.moveaxis(scale, 0, -1), np.where(runs, np.exp(-2.0 * k_z.imag * depth), 0.0))


def running(of: Medium) -> Integers:
    """The orders (k,) that run at one of the directions at least."""
    return np.flatnonzero(of.scale.any(axis=(0, 2)))


def unit_waves(of: Medium, orders: Integers) -> Complexes:
    """ẑ × E (n_d, 2n, 2k) of waves of unit power of some orders k, s and p; 0 for those that don't run."""
    n_d, n = of.decay.shape
    out = np.zeros((n_d, 2, n, orders.size, 2), complex)
    power = np.where(of.scale > 0, 1.0 / np.where(of.scale > 0, of.scale, 1.0), 0.0)
    for i, m in enumerate(orders):
        out[:, :, m, i] = of.turn[:, m] * power[:, m, None]
    return out.reshape(n_d, 2 * n, -1)


def amplitudes(of: Medium, orders: Integers, waves: Complexes) -> Complexes:
    """Amplitudes (n_d, k, 2, columns) of unit-power s and p waves of orders k, from ẑ × E (n_d, 2n, columns)."""
    n_d, n = of.decay.shape
    parts = waves.reshape(n_d, 2, n, -1)[:, :, orders]
    turned = np.einsum("dkxs,dxkc->dksc", of.turn[:, orders], parts)
    return np.asarray(turned * of.scale[:, orders, :, None])


def coherency(amplitudes: Complexes) -> Complexes:
    """S ⊗ S* (n_d, 4k, 4j) from S (n_d, k, 2, 2j): each pair of orders on its own."""
    n_d, k, _, columns = amplitudes.shape
    s = amplitudes.reshape(n_d, k, 2, columns // 2, 2)
    both = np.einsum("dkajb,dkAjB->dkaAjbB", s, s.conj())
    return np.asarray(both.reshape(n_d, 4 * k, 2 * columns))


class Part(NamedTuple):
    """What a part makes of coherencies that come from the front and from the back: reflected and sent on."""

    reflected: Complexes
    sent: Complexes
    back_reflected: Complexes
    back_sent: Complexes


def join(parts: list[Part], decays: list[Floats]) -> tuple[Complexes, Complexes]:
    """Coherencies reflected and sent on by parts with thick layers between them, decay (n_d, k) of each once through.

    Of the last part only the front matters. With V at the front of a layer and R behind it, V = T + R_b P R P V.
    """
    behind, sent = parts[-1].reflected, parts[-1].sent
    for part, decay in zip(parts[-2::-1], reversed(decays), strict=True):
        once = np.repeat(decay, 4, axis=1)
        returned = once[:, :, None] * behind * once[:, None]
        one = np.eye(once.shape[1])
        there = np.linalg.solve(one - part.back_reflected @ returned, part.sent)
        behind = part.reflected + part.back_sent @ (returned @ there)
        sent = sent @ (once[:, :, None] * there)
    return behind, sent


def stokes_powers(coherencies: Complexes) -> Floats:
    """Power (n_d, 4, k) of each order for the Stokes components of the light, from its coherency (n_d, 4k, 4)."""
    n_d = len(coherencies)
    power = coherencies.reshape(n_d, -1, 4, 4)[:, :, [0, 3]].sum(axis=2)
    aa, ab, bb = power[..., 0].real, power[..., 1], power[..., 3].real
    return np.stack([(aa + bb) / 2, (aa - bb) / 2, ab.real, -ab.imag], axis=1)
