"""Light through a stack of patterned layers, from the modes of each: compiled functions for `optics.lamellar`.

Fields are held as f± = ẑ × E ± h, stacked as 2n numbers: x components of n orders, then y components.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from optics.incidence import Complexes, Floats

# Modes that decay by more than this across their layer do not see the far side.
NEGLIGIBLE = 1e-9


class LayerModes(NamedTuple):
    """Modes of a layer at one u, of n orders: β² (n,), profiles ψ, φ (n, n) and what their fields need.

    Fields as in `optics.lamellar`: k_psi = K ψ, displaced_phi = β² ⟦1/ε⟧ φ, k_phi = ⟦ε⟧⁻¹ K φ. For several layers every
    array has one more axis in front.
    """

    beta2_s: Complexes
    psi: Complexes
    k_psi: Complexes
    beta2_p: Complexes
    phi: Complexes
    displaced_phi: Complexes
    k_phi: Complexes


@numba.njit(cache=True)
def _waves(t: LayerModes, layer: int, v: float, k_z: Complexes, plus: Complexes, minus: Complexes) -> None:
    """f₊ and f₋ (2n, 2n) of all modes of a layer running along +z; along −z the two are exchanged."""
    psi, k_psi, beta2_s = t.psi[layer], t.k_psi[layer], t.beta2_s[layer]
    phi, displaced_phi, k_phi = t.phi[layer], t.displaced_phi[layer], t.k_phi[layer]
    n = psi.shape[0]
    for i in range(n):
        for j in range(n):
            electric, magnetic = psi[i, j] * k_z[j], psi[i, j] * beta2_s[j]
            across = v * k_psi[i, j]
            plus[i, j], minus[i, j] = -electric - magnetic, magnetic - electric
            plus[n + i, j], minus[n + i, j] = across, -across
            electric, magnetic = displaced_phi[i, j], phi[i, j] * k_z[n + j]
            across = v * k_phi[i, j]
            plus[i, n + j], minus[i, n + j] = across, across
            plus[n + i, n + j], minus[n + i, n + j] = electric + magnetic, electric - magnetic


@numba.njit(cache=True)
def _ends(
    rho: Complexes, plus: Complexes, minus: Complexes, reach: NDArray[np.int64], a: Complexes, b: Complexes
) -> None:
    """A = f₊ − ρ f₋ and the columns `reach` of B = ρ f₊ − f₋, with ρ (n, 2, 2) in blocks."""
    n = rho.shape[0]
    for i in range(n):
        xx, xy, yx, yy = rho[i, 0, 0], rho[i, 0, 1], rho[i, 1, 0], rho[i, 1, 1]
        for j in range(2 * n):
            a[i, j] = plus[i, j] - xx * minus[i, j] - xy * minus[n + i, j]
            a[n + i, j] = plus[n + i, j] - yx * minus[i, j] - yy * minus[n + i, j]
        for c in range(reach.size):
            j = reach[c]
            b[i, c] = xx * plus[i, j] + xy * plus[n + i, j] - minus[i, j]
            b[n + i, c] = yx * plus[i, j] + yy * plus[n + i, j] - minus[n + i, j]


@numba.njit(cache=True)
def _reaching(x: Complexes, negligible: float) -> NDArray[np.int64]:
    """Modes whose decay x leaves more than `negligible`."""
    return np.flatnonzero(np.abs(x) > negligible)


@numba.njit(cache=True)
def _returned(bounce: Complexes, reach: NDArray[np.int64], x: Complexes) -> Complexes:
    """The part (n_reach, n_reach) of a bounce that is felt at the top again, decayed."""
    out = np.empty((reach.size, reach.size), np.complex128)
    for i in range(reach.size):
        for j in range(reach.size):
            out[i, j] = x[reach[i]] * bounce[reach[i], j]
    return out


@numba.njit(cache=True)
def _subtract(a: Complexes, product: Complexes, reach: NDArray[np.int64]) -> None:
    """Columns `reach` of A less those of a product."""
    for i in range(a.shape[0]):
        for c in range(reach.size):
            a[i, reach[c]] -= product[i, c]


@numba.njit(cache=True)
def _seen_from_above(
    plus: Complexes, minus: Complexes, x: Complexes, reach: NDArray[np.int64], bounce: Complexes, top: Complexes
) -> Complexes:
    """ρ of a layer and what lies behind: f₋ f₊⁻¹ with f₊ = F₊ + F₋ x b, which goes into `top`, and f₋ = F₋ + F₊ x b."""
    part = _returned(bounce, reach, x)
    top[:] = plus
    away = minus.copy()
    _subtract(top, -minus[:, reach] @ part, reach)
    _subtract(away, -plus[:, reach] @ part, reach)
    return np.ascontiguousarray(np.linalg.solve(np.ascontiguousarray(top.T), np.ascontiguousarray(away.T)).T)


@numba.njit(cache=True)
def _bounces(
    x: Complexes, back: Complexes, negligible: float, plus: Complexes, minus: Complexes, top: Complexes
) -> list[Complexes]:
    """Amplitudes (2n, n_reach) that return at the bottom of each layer, per amplitude at its top, last layer first."""
    n_l, m = plus.shape[0], plus.shape[1]
    a = np.empty((m, m), np.complex128)
    out: list[Complexes] = []
    for layer in range(n_l - 1, -1, -1):
        reach = _reaching(x[layer], negligible)
        b = np.empty((m, reach.size), np.complex128)
        if layer == n_l - 1:
            _ends(back, plus[layer], minus[layer], reach, a, b)
        else:
            i = layer + 1
            rho = _seen_from_above(plus[i], minus[i], x[i], _reaching(x[i], negligible), out[-1], top[i])
            a[:] = plus[layer] - rho @ minus[layer]
            b[:] = (rho @ plus[layer] - minus[layer])[:, reach]
        for c in range(reach.size):
            b[:, c] *= x[layer, reach[c]]
        out.append(np.ascontiguousarray(np.linalg.solve(a, b)))
    return out


@numba.njit(cache=True)
def _amplitudes(
    front: Complexes, source: Complexes, x: Complexes, negligible: float, plus: Complexes, minus: Complexes,
    bounce: Complexes,
) -> Complexes:
    """Amplitudes (2n, 2) that the light drives at the top of the first layer."""
    m, reach = plus.shape[0], _reaching(x, negligible)
    a, b = np.empty((m, m), np.complex128), np.empty((m, reach.size), np.complex128)
    _ends(front, plus, minus, reach, a, b)
    _subtract(a, b @ _returned(bounce, reach, x), reach)
    return np.linalg.solve(a, source)


@numba.njit(cache=True)
def scatter(
    modes: LayerModes, v: Floats, k_z: Complexes, x: Complexes, front: Complexes, back: Complexes, source: Complexes,
    negligible: float, outer: Complexes, inner: Complexes,
) -> None:
    """f₊ and f₋ at the top (outer (n_v, 2, 2n, 2)) and f₊ at the bottom (inner (n_v, 2n, 2)) of n_l layers for each v.

    k_z, x (n_v, n_l, 2n): wave numbers and decays of the modes. front, back (n_v, n, 2, 2): ρ seen from the layers.
    source (n_v, 2n, 2): f₊ − ρ_front f₋ of the incident light for each of two polarisations. Modes that decay below
    `negligible` do not see the far side of their layer.
    """
    n_l, m = modes.psi.shape[0], 2 * modes.psi.shape[1]
    plus, minus = np.empty((n_l, m, m), np.complex128), np.empty((n_l, m, m), np.complex128)
    top = np.empty((n_l, m, m), np.complex128)
    for p in range(v.size):
        for layer in range(n_l):
            _waves(modes, layer, v[p], k_z[p, layer], plus[layer], minus[layer])
        bounces = _bounces(x[p], back[p], negligible, plus, minus, top)
        down = _amplitudes(front[p], source[p], x[p, 0], negligible, plus[0], minus[0], bounces[-1])
        for layer in range(n_l):
            decay = x[p, layer].copy().reshape(m, 1)
            if layer > 0:
                down = np.linalg.solve(top[layer], inner[p])
            up = bounces[n_l - 1 - layer] @ np.ascontiguousarray(down[_reaching(x[p, layer], negligible)])
            if layer == 0:
                outer[p, 0] = plus[0] @ down + minus[0] @ (decay * up)
                outer[p, 1] = minus[0] @ down + plus[0] @ (decay * up)
            inner[p] = plus[layer] @ (decay * down) + minus[layer] @ up
