"""Gratings on thick layers, whose fringes are kept: what lies before and behind these, as scattering matrices.

Thick homogeneous layers part a stack. What lies in front of them, and what lies behind, scatters smoothly in u and v,
but for Rayleigh cut-offs; all fast phases are those of the thick layers, known in closed form. A table samples the
scattering matrices, and `optics.table.thick_membranes` joins them at each direction. (The scattering-matrix way to
treat layered gratings: Li 1996, J. Opt. Soc. Am. A 13, 1024.)

Beside a thick layer fields are held as f± = ẑ × E ± h (`optics.modal.lamellar`): waves of a medium whose admittance is
1 for every order and polarisation. There matrices are bounded by 1, as the parts are passive, and know nothing of the
cut-offs of the layer itself, where admittances vanish or have poles. Only orders that cross a thick layer somewhere in
the window are followed (`Parted.channels`); for all others the layer has no far side.

    front part:  [f₊ behind, f₋ in front] = F [light, f₋ behind],     back part:  [f₋, f₊ behind it] = B f₊
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamrider.arrays import Complexes, Floats, Integers
from optics.modal import lamellar
from optics.modal.stretch import Basis
from optics.waves.incidence import wave_vector

# Orders that decay to less than this across a thick layer are not followed in it.
_LEFT = 1e-9
# Light in front of the cell is held in two polarisations.
POLARISATIONS = 2


@dataclass(frozen=True)
class Orders:
    """Consecutive diffraction orders, from `first` on."""

    first: int
    count: int

    def among(self, order: int) -> Integers:
        """Where they are among the orders −order … order: their x components, then their y components, (2 count)."""
        one = self.first + order + np.arange(self.count)
        return np.concatenate([one, one + 2 * order + 1])

    @property
    def highest(self) -> int:
        """The largest |m|."""
        return max(abs(self.first), abs(self.first + self.count - 1))


def orders_within(pitch: float, reach: float, u_max: float) -> Orders:
    """Orders with |u + m λ/d| ≤ reach at some |u| ≤ u_max."""
    most = int(np.floor((reach + u_max) / pitch))
    return Orders(-most, 2 * most + 1)


@dataclass(frozen=True)
class Parted:
    """A stack parted by thick layers, in solver units.

    front: layers before the first thick one; chain: from there to the last thick one; behind: homogeneous layers behind
    that, or, if there are ridges in it, `patterned_behind`. channels: orders that are followed in the chain; outputs,
    sent: orders that may run in front of the cell and behind it.
    """

    stack: lamellar.Stack
    front: list[lamellar.Lamella]
    chain: list[lamellar.Lamella]
    behind: list[lamellar.Lamella]
    channels: Orders
    outputs: Orders
    sent: Orders

    @property
    def patterned_behind(self) -> bool:
        """Is there anything but homogeneous layers behind the chain."""
        return any(layer.ridges for layer in self.behind)

    @property
    def lossless(self) -> tuple[bool, bool]:
        """Is nothing lost in the part in front of the chain, and in the one behind."""
        back = self.stack.back.imag == 0.0
        return all(layer.lossless for layer in self.front), all(layer.lossless for layer in self.behind) and back


def part(stack: lamellar.Stack, first: int, last: int, u_max: float) -> Parted:
    """A stack with thick layers `first` … `last` (all homogeneous) parted there, for |u| ≤ u_max."""
    layers = [*stack.patterned, *stack.behind]
    chain, reach = layers[first : last + 1], 0.0
    for layer in (chain[0], chain[-1]):
        # k_z = i √(u² − ε) decays to `_LEFT` at this u; an absorbing order that runs decays as well, but is kept.
        decay = -np.log(_LEFT) / max(layer.thickness, 1e-300)
        reach = max(reach, float(np.sqrt(max(layer.background.real, 0.0) + decay**2)))
    pitch, back = stack.pitch, float(np.sqrt(stack.back).real)
    return Parted(
        stack,
        layers[:first],
        chain,
        layers[last + 1 :],
        orders_within(pitch, reach, u_max),
        orders_within(pitch, stack.front_index, u_max),
        orders_within(pitch, back, u_max),
    )


def phases(bases: list[Basis], counts: Integers, order: int) -> Complexes:
    """Phases (n_d, 2N + 1) of the plane waves of stretched bases, which eigenvectors leave open.

    Where x = ξ, at the first wall, the plane wave of order m is exp(2πi m x).
    """
    m = np.arange(-order, order + 1)
    found = []
    for over in bases:
        if over.stretch is None or over.columns is None:
            found.append(np.ones(m.size, complex))
            continue
        wave = np.exp(2j * np.pi * m * over.stretch.x[0])
        held = (wave @ over.columns) * wave.conj()
        found.append(held / np.abs(held))
    return np.repeat(found, counts, axis=0)


def unit(orders: Orders, order: int, count: int) -> Complexes:
    """f₊ (count, 2n, 2 orders) of waves of 1 in each component of some orders among −order … order."""
    out = np.zeros((count, 4 * order + 2, 2 * orders.count), complex)
    out[:, orders.among(order), np.arange(2 * orders.count)] = 1.0
    return out


@dataclass(frozen=True)
class _Solver:
    """A parted stack in the plane waves of directions u_m (n_d, 2N + 1), v (n_d)."""

    of: Parted
    bases: list[Basis]
    starts: list[int]
    u_m: Floats
    v: Floats
    order: int
    negligible: float

    def half_space(self, permittivity: complex) -> Complexes:
        """ρ (n_d, n, 2, 2) of a half-space."""
        y = lamellar.half_space(self.u_m, self.v, permittivity)[1]
        return lamellar.blocks((1 - y) / (1 + y), self.u_m, self.v)

    def inside(self, permittivity: complex) -> Complexes:
        """ρ (n_d, n, 2, 2) of a thick layer: 0 for the orders that are followed, which have the admittance 1."""
        y = lamellar.half_space(self.u_m, self.v, permittivity)[1]
        rho = (1 - y) / (1 + y)
        rho[:, :, self.of.channels.among(self.order)[: self.of.channels.count]] = 0.0
        return lamellar.blocks(rho, self.u_m, self.v)

    def through(
        self, layers: list[lamellar.Lamella], near: Complexes, far: Complexes, source: Complexes
    ) -> tuple[Complexes, Complexes]:
        """f₋ at the near side and f₊ at the far side (n_d, 2n, columns) of layers between two ρ, driven by `source`."""
        stack = replace(self.of.stack, patterned=layers or [lamellar.Lamella(0.0, 1.0, ())])
        top, bottom = lamellar.through_layers(
            stack, self.bases, self.starts, self.v, near, far, source, self.negligible
        )
        return top[:, 1], bottom

    def unit(self, orders: Orders) -> Complexes:
        """f₊ (n_d, 2n, 2 count) of waves of 1 in each component of each order."""
        return unit(orders, self.order, self.v.size)

    def weights(self, orders: Orders, permittivity: complex) -> Complexes:
        """Power of outgoing f (n_d, count, 2, 2) in a lossless half-space: Re y/|1 + y|² of waves that run."""
        at = orders.among(self.order)[: orders.count]
        u_m = self.u_m[:, at]
        k_z, y = lamellar.half_space(u_m, self.v, permittivity)
        runs = np.abs(k_z.imag) < np.abs(k_z.real)
        return lamellar.blocks(np.where(runs, y.real / np.abs(1 + y) ** 2, 0.0), u_m, self.v)


def _power(weights: Complexes, waves: Complexes) -> Complexes:
    """Hermitian form (n_d, columns, columns) of the power of waves (n_d, 2 count, columns)."""
    return np.asarray(np.swapaxes(waves.conj(), 1, 2) @ lamellar.apply_blocks(weights, waves))


def _squares(waves: Complexes) -> Complexes:
    """Hermitian form (n_d, columns, columns) of the power of f, (n_d, 2 count, columns), beside a thick layer."""
    return np.asarray(np.swapaxes(waves.conj(), 1, 2) @ waves / 4)


def _front(at: _Solver, phase: Complexes, u: Floats) -> tuple[Complexes, Complexes]:
    """F (n_d, channels + outputs, light + channels) and what the part takes from such light, a Hermitian form."""
    of, order = at.of, at.order
    inside, outside = at.inside(of.chain[0].background), at.half_space(complex(of.stack.front_index) ** 2)
    e, h = lamellar.incident_light(u, at.v, order, of.stack.front_index)
    source = e + h - lamellar.apply_blocks(outside, e - h)
    back, sent = at.through(of.front, outside, inside, source)
    up, out = at.through(of.front[::-1], inside, outside, at.unit(of.channels))
    c, o = of.channels.among(order), of.outputs.among(order)
    own = phase[:, [order]]
    light = np.concatenate([sent[:, c], (back - (e - h))[:, o]], axis=1) / own[:, None]
    waves = np.concatenate([up[:, c], out[:, o]], axis=1) / phase[:, None, c]
    found = np.concatenate([phase[:, c], phase[:, o]], axis=1)[:, :, None] * np.concatenate([light, waves], axis=2)
    w = wave_vector(u, at.v, of.stack.front_index)[:, 2, None]
    given = np.concatenate([np.repeat(w, POLARISATIONS, axis=1), np.full((u.size, c.size), 0.25)], axis=1)
    weights = at.weights(of.outputs, complex(of.stack.front_index) ** 2)
    kept = _squares(found[:, : c.size]) + _power(weights, found[:, c.size :])
    return found, given[:, :, None] * np.eye(given.shape[1]) - kept


def _back(at: _Solver, phase: Complexes) -> tuple[Complexes, Complexes]:
    """B (n_d, channels + sent, channels) and what the part takes, the half-space behind it included if that absorbs."""
    of, order = at.of, at.order
    inside, outside = at.inside(of.chain[-1].background), at.half_space(of.stack.back)
    up, out = at.through(of.behind, inside, outside, at.unit(of.channels))
    c, o = of.channels.among(order), of.sent.among(order)
    found = np.concatenate([up[:, c], out[:, o]], axis=1) / phase[:, None, c]
    found = np.concatenate([phase[:, c], phase[:, o]], axis=1)[:, :, None] * found
    kept = _squares(found[:, : c.size])
    if of.stack.back.imag == 0.0:
        kept = kept + _power(at.weights(of.sent, of.stack.back), found[:, c.size :])
    return found, np.eye(c.size) / 4 - kept


def _real(matrices: Complexes) -> Floats:
    """Real and imaginary parts (2 rows columns, n_d) of matrices (n_d, rows, columns)."""
    return np.ascontiguousarray(matrices.reshape(len(matrices), -1)).view(float).T


def _hermitian(matrices: Complexes) -> Floats:
    """Hermitian forms as reals (n² , n_d): Re on and above the diagonal, Im of what is above it below it."""
    held = np.triu(matrices.real) + np.tril(np.swapaxes(matrices.imag, 1, 2), -1)
    return np.asarray(held.reshape(len(matrices), -1).T)


def scattering(of: Parted, u: Floats, v: Floats, order: int, negligible: float) -> Floats:
    """The parts (k, n_d) at directions u, v (n_d): F as Re and Im, row by row, and what it loses; then those of B.

    Losses are left out where there are none. Zeros fill up to a multiple of four.
    """
    bases, starts, u_m = lamellar.plane_waves(of.stack, u, order)
    at = _Solver(of, bases, starts, u_m, v, order, negligible)
    phase = np.tile(phases(bases, np.diff([*starts, u.size]), order), 2)
    parts = [_front(at, phase, u), *([_back(at, phase)] if of.patterned_behind else [])]
    flat = np.concatenate(
        [
            held
            for (found, loss), lossless in zip(parts, of.lossless, strict=False)
            for held in (_real(found), *([] if lossless else [_hermitian(loss)]))
        ]
    )
    return np.concatenate([flat, np.zeros((-len(flat) % 4, u.size))])


def parity(of: Parted) -> Floats:
    """Of each of the quantities of `scattering` under v → −v (k): x components and light along the ridges are odd."""
    channels, outputs, sent = (np.repeat([-1.0, 1.0], x.count) for x in (of.channels, of.outputs, of.sent))
    given = np.concatenate([[-1.0, 1.0], channels])
    sides = [(np.concatenate([channels, outputs]), given), (np.concatenate([channels, sent]), channels)]
    flat = []
    for (found, light), lossless in zip(sides[: 1 + of.patterned_behind], of.lossless, strict=False):
        flat += [np.repeat(np.outer(found, light).ravel(), 2), *([] if lossless else [np.outer(light, light).ravel()])]
    every = np.concatenate(flat)
    return np.concatenate([every, np.ones(-every.size % 4)])
