"""Amplitudes of the parts of a grating between thick layers, and their power balance (`optics.power_balance`)."""

from __future__ import annotations

import numpy as np

from optics import lamellar
from optics.incidence import Complexes, Floats
from optics.power_balance import (
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


def _waves(
    layers: list[lamellar.Lamella], front: complex, back: complex, u_m: Floats, v: Floats, incoming: Complexes,
    negligible: float,
) -> tuple[Complexes, Complexes]:
    """ẑ × E reflected and sent on (n_d, 2n, k) by layers between two media, of waves ẑ × E (n_d, 2n, k) in the first."""
    layers = layers or [lamellar.Lamella(0.0, front, ())]
    last = max((i for i, layer in enumerate(layers) if layer.ridges), default=0)
    y = lamellar.blocks(lamellar.half_space(u_m, v, front)[1], u_m, v)
    ratio = lamellar.half_space(u_m, v, front)[1]
    rho_front = lamellar.blocks((1 - ratio) / (1 + ratio), u_m, v)
    rho, through = lamellar.tail(layers[last + 1 :], back, u_m, v)
    h = lamellar.apply_blocks(y, incoming)
    source = incoming + h - lamellar.apply_blocks(rho_front, incoming - h)
    stack = lamellar.Stack(1.0, layers[: last + 1], [], 1.0, back)
    top, bottom = lamellar.through_layers(
        stack, u_m, v, rho_front, lamellar.blocks(rho, u_m, v), source, negligible
    )
    return (top[:, 0] + top[:, 1]) / 2 - incoming, lamellar.apply_blocks(lamellar.blocks(through, u_m, v), bottom)


def _medium(permittivity: complex, depth: float, u_m: Floats, v: Floats) -> Medium:
    k_z, y = lamellar.half_space(u_m, v, permittivity)
    return medium(u_m, v, k_z, y, depth)


def _mueller(
    layers: list[lamellar.Lamella], front: complex, back: complex, u_m: Floats, v: Floats, incoming: Complexes,
    to_front: tuple[Medium, Floats], to_back: tuple[Medium, Floats], negligible: float,
) -> tuple[Complexes, Complexes]:
    """What a part makes of the coherency of incoming waves (n_d, 2n, 2k): reflected and sent on."""
    reflected, sent = _waves(layers, front, back, u_m, v, incoming, negligible)
    return coherency(amplitudes(*to_front, reflected)), coherency(amplitudes(*to_back, sent))


def efficiencies(
    stack: lamellar.Stack, u: Floats, v: Floats, order: int, negligible: float
) -> tuple[Floats, Floats]:
    """As `lamellar.efficiencies`, with the fringes of the layers `stack.averaged` averaged."""
    u_m = u[:, None] + stack.pitch * np.arange(-order, order + 1)
    layers = [*stack.patterned, *stack.behind]
    cuts = [-1, *stack.averaged, len(layers)]
    epsilon = [complex(stack.front_index) ** 2, *(layers[i].background for i in stack.averaged), stack.back]
    depths = [0.0, *(layers[i].thickness for i in stack.averaged), 0.0]
    media = [_medium(e, d, u_m, v) for e, d in zip(epsilon, depths, strict=True)]
    sides = [(of, np.arange(2 * order + 1) if i in (0, len(media) - 1) else running(of)) for i, of in enumerate(media)]
    e_in, h_in = lamellar.incident(u, v, order, stack.front_index)
    parts = []
    for i in range(len(cuts) - 1):
        between, near, far = layers[cuts[i] + 1 : cuts[i + 1]], sides[i], sides[i + 1]
        incoming = e_in if i == 0 else unit_waves(*near)
        ahead = _mueller(between, epsilon[i], epsilon[i + 1], u_m, v, incoming, near, far, negligible)
        back = ahead
        if i < len(cuts) - 2:
            back = _mueller(
                between[::-1], epsilon[i + 1], epsilon[i], u_m, v, unit_waves(*far), far, near, negligible
            )
        parts.append(Part(*ahead, *back))
    decays = [of.decay[:, orders] for of, orders in sides[1:-1]]
    reflected, sent = join(parts, decays)
    power = lamellar.flux(e_in, h_in)[:, :1, order, None]
    return stokes_powers(reflected) / power, stokes_powers(sent) / power
