"""Amplitudes of the parts of a grating between thick layers, and their power balance (`optics.modal.power_balance`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from beamrider.arrays import Complexes, Floats, Integers
from optics.modal import lamellar
from optics.modal.power_balance import (
    Medium,
    Part,
    amplitudes,
    coherency,
    join,
    medium,
    running,
    stokes_powers,
    unit_waves,
)
from optics.modal.stretch import Basis


@dataclass(frozen=True)
class _Solver:
    """What all parts of a cell share: plane waves of the directions u, v (n_d) and how far modes are followed."""

    stack: lamellar.Stack
    bases: list[Basis]
    starts: list[int]
    u_m: Floats
    v: Floats
    negligible: float

    def waves(
        self, layers: list[lamellar.Lamella], front: complex, back: complex, incoming: Complexes
    ) -> tuple[Complexes, Complexes]:
        """ẑ × E (n_d, 2n, k) reflected and sent on by layers between two media, of that of waves from the first."""
        layers, u_m, v = layers or [lamellar.Lamella(0.0, front, ())], self.u_m, self.v
        last = max((i for i, layer in enumerate(layers) if layer.ridges), default=0)
        y = lamellar.half_space(u_m, v, front)[1]
        rho_front = lamellar.blocks((1 - y) / (1 + y), u_m, v)
        rho, through = lamellar.tail(layers[last + 1 :], back, u_m, v)
        h = lamellar.apply_blocks(lamellar.blocks(y, u_m, v), incoming)
        source = incoming + h - lamellar.apply_blocks(rho_front, incoming - h)
        part = replace(self.stack, patterned=layers[: last + 1])
        top, bottom = lamellar.through_layers(
            part, self.bases, self.starts, v, rho_front, lamellar.blocks(rho, u_m, v), source, self.negligible
        )
        sent = lamellar.apply_blocks(lamellar.blocks(through, u_m, v), bottom)
        return (top[:, 0] + top[:, 1]) / 2 - incoming, sent

    def medium(self, permittivity: complex, depth: float) -> Medium:
        """The waves of a medium."""
        k_z, y = lamellar.half_space(self.u_m, self.v, permittivity)
        return medium(self.u_m, self.v, k_z, y, depth)

    def powers(
        self, layers: list[lamellar.Lamella], near: _Side, far: _Side, incoming: Complexes
    ) -> tuple[Complexes, Complexes]:
        """What a part makes of the coherency of waves (n_d, 2n, 2k) from the near side: reflected and sent on."""
        reflected, sent = self.waves(layers, near.permittivity, far.permittivity, incoming)
        return coherency(amplitudes(near.waves, near.orders, reflected)), coherency(
            amplitudes(far.waves, far.orders, sent)
        )


class _Side(NamedTuple):
    """A medium beside a part, and the orders that are followed in it."""

    permittivity: complex
    waves: Medium
    orders: Integers


def efficiencies(stack: lamellar.Stack, u: Floats, v: Floats, order: int, negligible: float) -> tuple[Floats, Floats]:
    """As `lamellar.efficiencies`, with the fringes of the layers `stack.averaged` averaged."""
    solver = _Solver(stack, *lamellar.plane_waves(stack, u, order), v, negligible)
    layers = [*stack.patterned, *stack.behind]
    thick = [layers[i] for i in stack.averaged]
    between = [layers[i + 1 : j] for i, j in pairwise([-1, *stack.averaged, len(layers)])]
    inside = [(layer.background, solver.medium(layer.background, layer.thickness)) for layer in thick]
    every = np.arange(2 * order + 1)
    outside = [_Side(e, solver.medium(e, 0.0), every) for e in (complex(stack.front_index) ** 2, stack.back)]
    sides = [outside[0], *(_Side(e, waves, running(waves)) for e, waves in inside), outside[1]]
    e_in, h_in = lamellar.incident_light(u, v, order, stack.front_index)
    parts = []
    for i, (part, (near, far)) in enumerate(zip(between, pairwise(sides), strict=True)):
        incoming = e_in if i == 0 else unit_waves(near.waves, near.orders)
        ahead = solver.powers(part, near, far, incoming)
        last = far is sides[-1]
        back = ahead if last else solver.powers(part[::-1], far, near, unit_waves(far.waves, far.orders))
        parts.append(Part(*ahead, *back))
    decays = [side.waves.decay[:, side.orders] for side in sides[1:-1]]
    reflected, sent = join(parts, decays)
    power = lamellar.flux(e_in, h_in)[:, :1, order, None]
    return stokes_powers(reflected) / power, stokes_powers(sent) / power
