"""Fourier modal method for ridges on a film: fast, and exact in the limit of many diffraction orders.

The structure does not change along r, so every field is a sum of modes with E_g = 0 and modes with H_g = 0 (Li 1993,
J. Mod. Opt. 40, 553; here x = g, y = r, z = n and k₀ = 1, h = Z₀H, time factor exp(−iωt)). With ⟦ε⟧ the Toeplitz matrix
of the Fourier coefficients of ε and K = diag(u_m), their profiles along g obey eigenproblems that know neither v nor
the thickness:

    E_g = 0:  (⟦ε⟧ − K²) ψ = β² ψ,             H_g = 0:  (1 − K ⟦ε⟧⁻¹ K) φ = β² ⟦1/ε⟧ φ.

The second holds Li's inverse rule (Li 1996, J. Opt. Soc. Am. A 13, 1870). For every v the modes are the same and
k_z² = β² − v². The tangential fields of a mode that runs along +z (along −z: h reversed) are

    E_g = 0:  E_y = k_z ψ, h_x = −β² ψ, h_y = v K ψ;    H_g = 0:  E_x = β² ⟦1/ε⟧ φ, E_y = −v ⟦ε⟧⁻¹ K φ, h_y = k_z φ.

Layers are joined from the back by their surface admittance h_t = Y E_t and reflection matrices of decaying waves only,
so that nothing grows with thickness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz

from optics.cells import Metagrating
from optics.incidence import Complexes, Floats, electric_vector, order_cosines, wave_vector
from optics.momentum import pressure

# A mode exactly at its cut-off (k_z = 0) is moved off it by this much: q moves by as little, and no matrix is singular.
_CUTOFF = 1e-8
# Modes that decay by more than this across the ridges do not see the far side.
_NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class Response:
    """What the cell does with light from n_u × n_v directions.

    q (n_u, n_v, 3) in (g, r, n); absorptance (n_u, n_v); reflected, transmitted (n_u, n_v, 2N + 1): efficiencies of the
    orders −N … N, zero for evanescent ones.
    """

    q: Floats
    absorptance: Floats
    reflected: Floats
    transmitted: Floats


@dataclass(frozen=True)
class _Modes:
    """Modes of the ridge layer at one u: β² (n,), profiles (n, n) and what their fields need; n = 2N + 1 orders."""

    beta2_s: Complexes
    psi: Complexes
    k_psi: Complexes
    beta2_p: Complexes
    phi: Complexes
    displaced_phi: Complexes
    k_phi: Complexes


def fourier_coefficients(cell: Metagrating, inside: complex, outside: complex, count: int) -> Complexes:
    """Fourier coefficients −count … count of a function that is `inside` on ridges and `outside` elsewhere."""
    m = np.arange(-count, count + 1)
    total = np.where(m == 0, outside, 0.0).astype(complex)
    for start, width in cell.ridges_nm:
        centre, share = (start + width / 2) / cell.period_nm, width / cell.period_nm
        total += (inside - outside) * share * np.sinc(m * share) * np.exp(-2j * np.pi * m * centre)
    return total


def _toeplitz(coefficients: Complexes) -> Complexes:
    n = coefficients.size // 2
    return np.asarray(toeplitz(coefficients[n:], coefficients[n::-1]))


def _root(square: Complexes) -> Complexes:
    """√ with the sign of a wave that runs or decays along +z; kept off zero by `_CUTOFF`."""
    root = np.sqrt(square)
    root = np.where(root.real + root.imag < 0, -root, root)
    return np.where(np.abs(root) < _CUTOFF, _CUTOFF * np.exp(0.25j * np.pi), root)


def _ridge_modes(cell: Metagrating, u_m: Floats) -> _Modes:
    """Both families of modes of the ridge layer for order cosines u_m (n,)."""
    ridge, gap = cell.index.permittivity, complex(cell.surroundings.front) ** 2
    epsilon = _toeplitz(fourier_coefficients(cell, ridge, gap, u_m.size - 1))
    inverse = _toeplitz(fourier_coefficients(cell, 1 / ridge, 1 / gap, u_m.size - 1))
    beta2_s, psi = np.linalg.eig(epsilon - np.diag(u_m**2))
    k_inverse_epsilon = np.linalg.solve(epsilon.T, np.diag(u_m).astype(complex)).T  # K ⟦ε⟧⁻¹
    inverse_epsilon_k = np.linalg.solve(epsilon, np.diag(u_m).astype(complex))  # ⟦ε⟧⁻¹ K
    operator = np.linalg.solve(inverse, np.eye(u_m.size) - k_inverse_epsilon * u_m)
    beta2_p, phi = np.linalg.eig(operator)
    return _Modes(
        beta2_s, psi, u_m[:, None] * psi, beta2_p, phi, inverse @ phi * beta2_p, inverse_epsilon_k @ phi
    )


def _columns(modes: _Modes, v: Floats) -> tuple[Complexes, Complexes, Complexes]:
    """Tangential E and h (n_v, 2n, 2n) of all modes running along +z, and their k_z (n_v, 2n)."""
    n = modes.beta2_s.size
    k_z = _root(np.concatenate([modes.beta2_s, modes.beta2_p]) - v[:, None] ** 2)
    e = np.zeros((v.size, 2 * n, 2 * n), complex)
    h = np.zeros_like(e)
    e[:, :n, n:] = modes.displaced_phi
    e[:, n:, :n] = modes.psi * k_z[:, None, :n]
    e[:, n:, n:] = -v[:, None, None] * modes.k_phi
    h[:, :n, :n] = -modes.psi * modes.beta2_s
    h[:, n:, :n] = v[:, None, None] * modes.k_psi
    h[:, n:, n:] = modes.phi * k_z[:, None, n:]
    return e, h, k_z


def _tensor(s: Complexes, p: Complexes, u_m: Floats, v: Floats) -> Complexes:
    """Blocks (n_v, n, 2, 2) giving [h_x, h_y] from [E_x, E_y], of each order's admittances s and p (n_v, n)."""
    k_t = np.hypot(u_m, v[:, None])
    safe = np.where(k_t > 0, k_t, 1.0)
    a, b = np.where(k_t > 0, u_m / safe, 1.0), np.where(k_t > 0, v[:, None] / safe, 0.0)
    cross = a * b * (p - s)
    rows = [np.stack([-cross, -(p * b * b + s * a * a)], -1), np.stack([p * a * a + s * b * b, cross], -1)]
    return np.stack(rows, -2)


def _half_space(u_m: Floats, v: Floats, permittivity: complex) -> tuple[Complexes, Complexes, Complexes]:
    """k_z and the admittances for s and p (n_v, n) of outgoing plane waves."""
    k_t, index = np.hypot(u_m, v[:, None]), np.sqrt(complex(permittivity))
    k_z = _root((index - k_t) * (index + k_t))  # a product keeps its digits at glancing light
    return k_z, k_z, permittivity / k_z


@dataclass(frozen=True)
class _Back:
    """Membrane and half-space behind the ridges: admittance blocks seen from the ridges, and field transmission."""

    admittance: Complexes
    transfer: Complexes
    half_space: Complexes


def _back(cell: Metagrating, u_m: Floats, v: Floats) -> _Back:
    """The homogeneous part, order by order. transfer (n_v, n, 2, 2) takes tangential E from its top to its bottom."""
    film = cell.index.permittivity
    _, s_out, p_out = _half_space(u_m, v, complex(cell.surroundings.back) ** 2)
    k_z, s_in, p_in = _half_space(u_m, v, film)
    x = np.exp(1j * k_z * 2 * np.pi * cell.membrane_nm / cell.wavelength_nm)
    top, through = [], []
    for inner, outer in ((s_in, s_out), (p_in, p_out)):
        r = (inner - outer) / (inner + outer)
        top.append(inner * (1 - r * x * x) / (1 + r * x * x))
        through.append((1 + r) * x / (1 + r * x * x))
    # Transmission acts along t (p) and across it (s): the admittance tensor turned back by a quarter turn.
    turned = _tensor(through[0], through[1], u_m, v)
    transfer = np.stack([turned[..., 1, :], -turned[..., 0, :]], -2)
    return _Back(_tensor(top[0], top[1], u_m, v), transfer, _tensor(s_out, p_out, u_m, v))


def _apply(blocks: Complexes, columns: Complexes) -> Complexes:
    """Blocks (n_v, n, 2, 2) on stacked components [x (n), y (n)] of columns (n_v, 2n, k)."""
    n = blocks.shape[1]
    x, y = columns[:, :n], columns[:, n:]
    rows = [blocks[..., i, 0, None] * x + blocks[..., i, 1, None] * y for i in (0, 1)]
    return np.concatenate(rows, axis=1)


def _flux(e: Complexes, h: Complexes) -> Floats:
    """Power along +z (n_v, n) of each order from stacked tangential fields (n_v, 2n, 1)."""
    n = e.shape[1] // 2
    return np.asarray((e[:, :n] * h[:, n:].conj() - e[:, n:] * h[:, :n].conj()).real[..., 0])


def _solve_row(cell: Metagrating, u: float, v: Floats, order: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Efficiencies, q and absorptance for one u and all v (n_v)."""
    orders = np.arange(-order, order + 1)
    n = orders.size
    front_index, back_index = cell.surroundings.front, cell.surroundings.back
    u_m = u + cell.pitch * orders
    e, h, k_z = _columns(_ridge_modes(cell, u_m), v)
    back = _back(cell, u_m, v)
    x = np.exp(1j * k_z * 2 * np.pi * cell.ridge_height_nm / cell.wavelength_nm)
    reach = np.flatnonzero(np.abs(x).max(axis=0) > _NEGLIGIBLE)
    y_e = _apply(back.admittance, e)
    # Amplitudes (n_v, 2n, modes that reach so far) turned back by all that lies behind the ridges.
    bounce = np.linalg.solve(h + y_e, (h - y_e)[:, :, reach]) * x[:, None, reach]

    front = _tensor(*_half_space(u_m, v, complex(front_index) ** 2)[1:], u_m, v)
    y_e = _apply(front, e)
    k = wave_vector(u, v, front_index)
    field = electric_vector(u, v, cell.electric_axis, front_index)
    magnetic = np.cross(k, field)
    e_in, h_in = np.zeros((2, v.size, 2 * n, 1), complex)
    e_in[:, order, 0], e_in[:, n + order, 0] = field[:, 0], field[:, 1]
    h_in[:, order, 0], h_in[:, n + order, 0] = magnetic[:, 0], magnetic[:, 1]
    matrix = h + y_e
    matrix[:, :, reach] -= (h - y_e)[:, :, reach] @ (x[:, reach, None] * bounce[:, reach])
    down = np.linalg.solve(matrix, 2 * h_in)
    up = bounce @ down[:, reach]

    e_r = e @ (down + x[:, :, None] * up) - e_in
    e_t = _apply(back.transfer, e @ (x[:, :, None] * down + up))
    incident = _flux(e_in, h_in)[:, order, None]
    reflected = _flux(e_r, _apply(front, e_r)) / incident
    transmitted = _flux(e_t, _apply(back.half_space, e_t)) / incident
    _, w_front = order_cosines(u, v, cell.pitch, orders, front_index)
    _, w_back = order_cosines(u, v, cell.pitch, orders, back_index)
    reflected = np.where(w_front.real > 0, reflected, 0.0)
    transmitted = np.where(w_back.real > 0, transmitted, 0.0)
    q, absorptance = pressure(u, v, k[:, 2], u_m, w_front, w_back, reflected, transmitted)
    return q, absorptance, reflected, transmitted


def solve(cell: Metagrating, u: NDArray[np.float64], v: NDArray[np.float64], order: int) -> Response:
    """Response over directions u (n_u) × v (n_v) with diffraction orders −order … order (see the module docstring)."""
    rows = [_solve_row(cell, float(x), np.asarray(v, float), order) for x in np.asarray(u, float)]
    return Response(*(np.stack(part) for part in zip(*rows, strict=True)))
