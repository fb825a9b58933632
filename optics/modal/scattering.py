"""Light through a stack of patterned layers, from the modes of each: compiled functions for `optics.modal.lamellar`.

Towards both half-spaces fields are held as f± = ẑ × E ± h, stacked as 2n numbers: x components of n orders, then y
components. Between two layers they are held by the modes themselves, whose overlaps know neither v nor the thicknesses:
with amplitudes a± of modes, electric amplitudes e = (k_z,s (a₊ + a₋)_s, (a₊ + a₋)_p) and magnetic ones
h = ((a₊ − a₋)_s, k_z,p (a₊ − a₋)_p), continuous E and h give

    e = [[C, v E], [0, A]] e',    h = [[B, 0], [v G, F]] h'

from one patterned layer to the next, so that what returns at a joint, a₋ = Γ a₊, takes one solution of linear
equations. In homogeneous layers both families of an order with β² = 0 are one and the same wave: there the modes are
plane waves, held by the components of ẑ × E, and joints are made through f±.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Complexes, Floats

# Modes that decay by more than this across their layer do not see the far side.
NEGLIGIBLE = 1e-9


class LayerModes(NamedTuple):
    """Modes of a layer at one u, of n orders: β² (n,), profiles ψ, φ (n, n) and what their fields need.

    Fields as in `optics.modal.lamellar`: k_psi = K ψ, displaced_phi = β² ⟦1/ε⟧ φ, k_phi = ⟦ε⟧⁻¹ K φ. For several layers
    every array has one more axis in front.
    """

    beta2_s: Complexes
    psi: Complexes
    k_psi: Complexes
    beta2_p: Complexes
    phi: Complexes
    displaced_phi: Complexes
    k_phi: Complexes


@numba.njit(cache=True, error_model="numpy")
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


@numba.njit(cache=True, error_model="numpy")
def _plane_waves(epsilon: complex, u_m: Floats, v: float, k_z: Complexes, plus: Complexes, minus: Complexes) -> None:
    """f₊ and f₋ (2n, 2n) of the plane waves of a homogeneous layer, for each component of ẑ × E; as `_waves`."""
    n = u_m.size
    plus[:], minus[:] = 0.0, 0.0
    for i in range(n):
        k_t = np.hypot(u_m[i], v)
        a, b = (u_m[i] / k_t, v / k_t) if k_t > 0 else (1.0, 0.0)
        s, p = k_z[i], epsilon / k_z[i]
        xx, xy, yy = s * a * a + p * b * b, a * b * (s - p), s * b * b + p * a * a
        plus[i, i], plus[i, n + i], plus[n + i, i], plus[n + i, n + i] = 1.0 + xx, xy, xy, 1.0 + yy
        minus[i, i], minus[i, n + i], minus[n + i, i], minus[n + i, n + i] = 1.0 - xx, -xy, -xy, 1.0 - yy


@numba.njit(cache=True, error_model="numpy")
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


@numba.njit(cache=True, error_model="numpy")
def _reaching(x: Complexes, negligible: float) -> NDArray[np.int64]:
    """Modes whose decay x leaves more than `negligible`."""
    return np.flatnonzero(np.abs(x) > negligible)


@numba.njit(cache=True, error_model="numpy")
def _returned(bounce: Complexes, reach: NDArray[np.int64], x: Complexes) -> Complexes:
    """The part (n_reach, n_reach) of a bounce that is felt at the top again, decayed."""
    out = np.empty((reach.size, reach.size), np.complex128)
    for i in range(reach.size):
        for j in range(reach.size):
            out[i, j] = x[reach[i]] * bounce[reach[i], j]
    return out


@numba.njit(cache=True, error_model="numpy")
def _subtract(a: Complexes, product: Complexes, reach: NDArray[np.int64]) -> None:
    """Columns `reach` of A less those of a product."""
    for i in range(a.shape[0]):
        for c in range(reach.size):
            a[i, reach[c]] -= product[i, c]


@numba.njit(cache=True, error_model="numpy")
def _seen_from_above(
    plus: Complexes, minus: Complexes, part: Complexes, reach: NDArray[np.int64], top: Complexes
) -> Complexes:
    """ρ of a layer and what lies behind: f₋ f₊⁻¹ with f₊ = F₊ + F₋ x b, which goes into `top`, and f₋ = F₋ + F₊ x b."""
    top[:] = plus
    away = minus.copy()
    _subtract(top, -minus[:, reach] @ part, reach)
    _subtract(away, -plus[:, reach] @ part, reach)
    return np.ascontiguousarray(np.linalg.solve(np.ascontiguousarray(top.T), np.ascontiguousarray(away.T)).T)


class Joints(NamedTuple):
    """Overlaps (n_l − 1, n, n) of the modes of each layer with those of the next; zeros beside homogeneous layers.

    A = X⁻¹ X', B = (ψ β²)⁻¹ ψ' β'², C = ψ⁻¹ ψ', E = ψ⁻¹ (K_φ A − K_φ'), F = φ⁻¹ φ', G = φ⁻¹ (K ψ' − K ψ B) with
    X = β² ⟦1/ε⟧ φ and K_φ = ⟦ε⟧⁻¹ K φ.
    """

    a: Complexes
    b: Complexes
    c: Complexes
    e: Complexes
    f: Complexes
    g: Complexes


def joints(t: LayerModes, epsilon: Complexes) -> Joints:
    """The overlaps of neighbours among layers of permittivities `epsilon` (n_l), NaN for patterned ones."""
    n_l, n, _ = t.psi.shape
    out = np.zeros((6, n_l - 1, n, n), complex)
    both = np.flatnonzero(np.isnan(epsilon[:-1]) & np.isnan(epsilon[1:]))
    if both.size:
        above, below = (LayerModes(*(part[both + k] for part in t)) for k in (0, 1))
        a = np.linalg.solve(above.displaced_phi, below.displaced_phi)
        along = np.concatenate([below.psi, above.k_phi @ a - below.k_phi], axis=-1)
        c, e = np.split(np.linalg.solve(above.psi, along), 2, axis=-1)
        b = c * below.beta2_s[:, None] / above.beta2_s[:, :, None]
        across = np.concatenate([below.phi, below.k_psi - above.k_psi @ b], axis=-1)
        f, g = np.split(np.linalg.solve(above.phi, across), 2, axis=-1)
        out[:, both] = a, b, c, e, f, g
    return Joints(*out)


@numba.njit(cache=True, error_model="numpy")
def _joined(
    t: Joints,
    i: int,
    v: float,
    k_z: Complexes,
    k_next: Complexes,
    part: Complexes,
    reach: NDArray[np.int64],
    total: Complexes,
    apart: Complexes,
) -> None:
    """2 a₊ and 2 a₋ (2n, 2n) above joint i, per a₊ at the top of the layer below, of which `part` returns there."""
    m = k_z.size
    n = m // 2
    electric, magnetic = np.zeros((m, m), np.complex128), np.zeros((m, m), np.complex128)
    for r in range(reach.size):
        for c in range(reach.size):
            electric[reach[r], reach[c]] = part[r, c]
            magnetic[reach[r], reach[c]] = -part[r, c]
    for j in range(m):
        electric[j, j] += 1.0
        magnetic[j, j] += 1.0
    for j in range(n):
        electric[j] *= k_next[j]
        magnetic[n + j] *= k_next[n + j]
    es, ep = t.c[i] @ electric[:n] + v * (t.e[i] @ electric[n:]), t.a[i] @ electric[n:]
    hs, hp = t.b[i] @ magnetic[:n], v * (t.g[i] @ magnetic[:n]) + t.f[i] @ magnetic[n:]
    for r in range(n):
        inverse_s, inverse_p = 1.0 / k_z[r], 1.0 / k_z[n + r]
        for c in range(m):
            x, y = es[r, c] * inverse_s, hs[r, c]
            total[r, c], apart[r, c] = x + y, x - y
            x, y = ep[r, c], hp[r, c] * inverse_p
            total[n + r, c], apart[n + r, c] = x + y, x - y


@numba.njit(cache=True, error_model="numpy")
def _columns(whole: Complexes, reach: NDArray[np.int64], x: Complexes) -> Complexes:
    """The columns `reach` of a matrix, given transposed, times the decays x."""
    out = np.empty((whole.shape[1], reach.size), np.complex128)
    for c in range(reach.size):
        out[:, c] = whole[reach[c]] * x[reach[c]]
    return out


@numba.njit(cache=True, error_model="numpy")
def _bounces(
    joints: Joints,
    epsilon: Complexes,
    v: float,
    k_z: Complexes,
    x: Complexes,
    back: Complexes,
    negligible: float,
    plus: Complexes,
    minus: Complexes,
    total: Complexes,
) -> list[Complexes]:
    """Amplitudes (2n, n_reach) that return at the bottom of each layer, per amplitude at its top, last layer first.

    total (n_l − 1, 2n, 2n) of joints: 2 a₊ above, or f₊ beside homogeneous layers, per a₊ at the top of the next layer.
    """
    n_l, m = x.shape
    a, b = np.empty((m, m), np.complex128), np.empty((m, m), np.complex128)
    reach = _reaching(x[-1], negligible)
    _ends(back, plus[-1], minus[-1], np.arange(m), a, b)
    out = [np.ascontiguousarray(np.linalg.solve(a, b[:, reach] * x[-1][reach]))]
    for i in range(n_l - 2, -1, -1):
        part = _returned(out[-1], reach, x[i + 1])
        if np.isnan(epsilon[i].real) and np.isnan(epsilon[i + 1].real):
            _joined(joints, i, v, k_z[i], k_z[i + 1], part, reach, total[i], a)
            reach = _reaching(x[i], negligible)
            whole = np.linalg.solve(np.ascontiguousarray(total[i].T), np.ascontiguousarray(a.T))
            out.append(_columns(whole, reach, x[i]))
        else:
            rho = _seen_from_above(plus[i + 1], minus[i + 1], part, reach, total[i])
            reach = _reaching(x[i], negligible)
            a[:] = plus[i] - rho @ minus[i]
            b[:] = rho @ plus[i] - minus[i]
            out.append(np.ascontiguousarray(np.linalg.solve(a, b[:, reach] * x[i][reach])))
    return out


@numba.njit(cache=True, error_model="numpy")
def _amplitudes(
    front: Complexes,
    source: Complexes,
    x: Complexes,
    negligible: float,
    plus: Complexes,
    minus: Complexes,
    bounce: Complexes,
) -> NDArray[Any]:
    """Amplitudes (2n, 2) that the light drives at the top of the first layer."""
    m, reach = plus.shape[0], _reaching(x, negligible)
    a, b = np.empty((m, m), np.complex128), np.empty((m, reach.size), np.complex128)
    _ends(front, plus, minus, reach, a, b)
    _subtract(a, b @ _returned(bounce, reach, x), reach)
    return np.linalg.solve(a, source)


@numba.njit(cache=True, error_model="numpy")
def scatter(
    modes: LayerModes,
    joints: Joints,
    epsilon: Complexes,
    u_m: Floats,
    v: Floats,
    k_z: Complexes,
    x: Complexes,
    front: Complexes,
    back: Complexes,
    source: Complexes,
    negligible: float,
    outer: Complexes,
    inner: Complexes,
) -> None:
    """f₊ and f₋ at the top (outer (n_v, 2, 2n, 2)) and f₊ at the bottom (inner (n_v, 2n, 2)) of n_l layers for each v.

    epsilon (n_l): permittivities of homogeneous layers, NaN for patterned ones. k_z, x (n_v, n_l, 2n): wave numbers and
    decays of the modes. front, back (n_v, n, 2, 2): ρ seen from the layers. source (n_v, 2n, 2): f₊ − ρ_front f₋ of the
    incident light for each of two polarisations. Modes that decay below `negligible` do not see the far side of their
    layer.
    """
    n_l, m = modes.psi.shape[0], 2 * modes.psi.shape[1]
    plus, minus = np.empty((n_l, m, m), np.complex128), np.empty((n_l, m, m), np.complex128)
    total, patterned = np.empty((n_l - 1, m, m), np.complex128), np.isnan(epsilon.real)
    for p in range(v.size):
        for i in range(n_l):
            if not patterned[i]:
                _plane_waves(epsilon[i], u_m, v[p], k_z[p, i], plus[i], minus[i])
            elif i == 0 or i == n_l - 1 or not (patterned[i - 1] and patterned[i + 1]):
                _waves(modes, i, v[p], k_z[p, i], plus[i], minus[i])
        bounces = _bounces(joints, epsilon, v[p], k_z[p], x[p], back[p], negligible, plus, minus, total)
        down = _amplitudes(front[p], source[p], x[p, 0], negligible, plus[0], minus[0], bounces[-1])
        for i in range(n_l):
            decay = x[p, i].copy().reshape(m, 1)
            up = bounces[n_l - 1 - i] @ np.ascontiguousarray(down[_reaching(x[p, i], negligible)])
            if i == 0:
                outer[p, 0] = plus[0] @ down + minus[0] @ (decay * up)
                outer[p, 1] = minus[0] @ down + plus[0] @ (decay * up)
            if i == n_l - 1:
                inner[p] = plus[i] @ (decay * down) + minus[i] @ up
            elif patterned[i] and patterned[i + 1]:
                down = 2.0 * np.linalg.solve(total[i], decay * down)
            else:
                down = np.linalg.solve(total[i], plus[i] @ (decay * down) + minus[i] @ up)
