"""Light through a profile whose walls are not upright, by the differential method in steps along z.

A staircase gets the walls' normals wrong: in TM light its fields are singular at every corner, and what it tends to
depends on whether orders or steps are raised first (Popov et al. 2002, J. Opt. Soc. Am. A 19, 33). Here products are
factorised along the wall's own normal (fast Fourier factorisation, Popov & Nevière 2001, J. Opt. Soc. Am. A 18, 2886):
with Δ = ⟦1/ε⟧⁻¹ − ⟦ε⟧, smooth functions c(x), s(x) that are the normal's components on the walls, and K = diag(u_m),

    D_x = Q_xx E_x + Q_xz E_z,   Q_xx = ⟦ε⟧ + Δ⟦c²⟧,   D_y = ⟦ε⟧ E_y,
    D_z = Q_xz E_x + Q_zz E_z,   Q_zz = ⟦ε⟧ + Δ⟦s²⟧,   Q_xz = Δ⟦c s⟧,

products made Hermitian, so that energy is conserved. In the units of `optics.modal.lamellar`, with Ê = ẑ × E and
E_z = Q_zz⁻¹ (v h_x − K h_y − Q_xz E_x), Maxwell's equations are ∂_z X = i M X, X = (Ê_x, Ê_y, h_x, h_y):

    ∂_z Ê_x = i [v Z_x Ê_y + (1 − v² Z) h_x + v Z K h_y],
    ∂_z Ê_y = i [−K Z_x Ê_y + v K Z h_x + (1 − K Z K) h_y],
    ∂_z h_x = i [(⟦ε⟧ − K²) Ê_x − v K Ê_y],
    ∂_z h_y = i [−v K Ê_x + (P − v²) Ê_y + v X_z h_x − X_z K h_y],

Z = Q_zz⁻¹, Z_x = Z Q_xz, X_z = Q_xz Z, P = Q_xx − Q_xz Z Q_xz, all of which know neither u nor v. Two steps of h/2 with
mixtures (1/2 ± 1/√3) of M at the two Gauss points of h are right to fourth order (the commutator-free Magnus method:
Blanes & Moan 2006, Appl. Numer. Math. 56, 1519). The exponential is taken by its (2, 2) Padé approximant, which
conserves energy where M does. The reflection ρ, f₋ = ρ f₊, is carried upwards step by step and stays bounded.

The approximant holds M and M². With K = u + G and

    S₁ = Z_x K Z_x − Z K P,    S₂ = Z_x K Z + Z K X_z,    S₃ = P K Z − X_z K X_z,    S₄ = P K Z_x + X_z K P,

linear in u, what is left of the sixteen blocks of M² is

    ⟦ε⟧ − K² − v² Z⟦ε⟧    −v (S₁ + K)           v² S₂                 v (Z_x − S₂ K)
    v (K Z⟦ε⟧ − K)        P − v² + K S₁         v (X_z − K S₂)        K S₂ K − K Z_x − X_z K
    0                     v ⟦ε⟧Z_x              ⟦ε⟧ − K² − v² ⟦ε⟧Z    v (⟦ε⟧Z K − K)
    v X_z⟦ε⟧              −S₄                   v (S₃ − K)            P − v² − S₃ K

whose products of two matrices are the same for every direction.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Complexes, Floats
from optics.modal.steps import Slanted, Walls
from optics.modal.stretch import fourier_coefficients, toeplitz_matrix

_NEAR = 0.5 + 1 / np.sqrt(3.0)


class Steps(NamedTuple):
    """Steps through a profile: thickness (n_s,) in radians of vacuum, and ⟦ε⟧, Z, Z_x, X_z, P (n_s, n, n)."""

    thickness: Floats
    epsilon: Complexes
    z: Complexes
    z_x: Complexes
    x_z: Complexes
    p: Complexes


def _even(walls: Walls, values: Floats, count: int) -> Complexes:
    """Fourier coefficients −count … count of the continuous function that is linear between values on the walls."""
    m = np.arange(-count, count + 1)
    ends, after = np.append(walls.x, walls.x[0] + 1.0), np.append(values, values[0])
    slopes = np.diff(after) / np.diff(ends)
    phases = np.exp(-2j * np.pi * np.outer(ends, m))
    total = -(slopes @ (phases[:-1] - phases[1:])) / np.where(m == 0, 1.0, 4 * np.pi**2 * m**2)
    total[count] = np.diff(ends) @ (after[:-1] + after[1:]) / 2
    return np.asarray(total)


def _factors(walls: Walls, order: int) -> tuple[Complexes, ...]:
    """⟦ε⟧, Z, Z_x, X_z and P (n, n) between walls."""
    n, gap = 2 * order + 1, walls.epsilon[0]
    if walls.x.size == 0:
        one = np.eye(n, dtype=complex)
        return gap * one, one / gap, np.zeros_like(one), np.zeros_like(one), gap * one
    spans = list(zip(walls.x.tolist(), np.diff([*walls.x, walls.x[0] + 1.0]).tolist(), walls.epsilon, strict=True))
    direct, inverse = (
        toeplitz_matrix(fourier_coefficients(None, tuple((a, w, f(e)) for a, w, e in spans), n - 1))
        for f in (lambda e: e, lambda e: 1 / e)
    )
    delta = np.linalg.inv(inverse) - direct
    double = [toeplitz_matrix(_even(walls, part, n - 1)) for part in (walls.cos_2, walls.sin_2)]
    cos_2, sin_2 = ((delta @ part + part @ delta) / 2 for part in double)
    q_xx, q_zz, q_xz = direct + (delta + cos_2) / 2, direct + (delta - cos_2) / 2, sin_2 / 2
    z = np.linalg.inv(q_zz)
    return tuple(np.asarray(part, complex) for part in (direct, z, z @ q_xz, q_xz @ z, q_xx - q_xz @ z @ q_xz))


@lru_cache(maxsize=4)
def steps(cell: Slanted, order: int) -> Steps:
    """The steps of a profile with diffraction orders −order … order: the same for every direction."""
    thickness, parts = [], []
    for whole, above, below in cell.pairs():
        first, second = _factors(above, order), _factors(below, order)
        for near, far in ((first, second), (second, first)):
            thickness.append(np.pi / cell.wavelength_nm * whole)
            parts.append([_NEAR * a + (1 - _NEAR) * b for a, b in zip(near, far, strict=True)])
    return Steps(np.array(thickness), *(np.stack(part) for part in zip(*parts, strict=True)))


class Products(NamedTuple):
    """What M² of steps is made of: Z⟦ε⟧, ⟦ε⟧Z, ⟦ε⟧Z_x, X_z⟦ε⟧ (4, n_s, n, n), S₁ … S₄ at u = 0, their ∂u."""

    plain: Complexes
    start: Complexes
    slope: Complexes


@lru_cache(maxsize=3)
def products(cell: Slanted, order: int) -> Products:
    """Of the steps of a profile."""
    return products_of(steps(cell, order), cell.pitch * np.arange(-order, order + 1.0))


def products_of(of: Steps, g: Floats) -> Products:
    """Of steps in the plane waves u + g (n,)."""
    z, z_x, x_z, p, epsilon = of.z, of.z_x, of.x_z, of.p, of.epsilon

    def sandwiches(k: Floats) -> Complexes:
        return np.stack(
            [
                (z_x * k) @ z_x - (z * k) @ p,
                (z_x * k) @ z + (z * k) @ x_z,
                (p * k) @ z - (x_z * k) @ x_z,
                (p * k) @ z_x + (x_z * k) @ p,
            ]
        )

    plain = np.stack([z @ epsilon, epsilon @ z, epsilon @ z_x, x_z @ epsilon])
    return Products(plain, sandwiches(g), sandwiches(np.ones(g.size)))


def upside_down(of: Steps) -> Steps:
    """The steps seen from behind: z is −z, so that what couples E_x and E_z changes its sign."""
    z_x, x_z = -of.z_x[::-1], -of.x_z[::-1]
    parts = (of.epsilon[::-1], of.z[::-1], z_x, x_z, of.p[::-1])
    return Steps(np.ascontiguousarray(of.thickness[::-1]), *(np.asarray(part, complex) for part in parts))


def unmixed(of: Steps, i: int) -> list[tuple[float, Steps]]:
    """The two structures that step i mixes, each with its share and as a step of its own."""
    own, other = (Steps(of.thickness[[k]], *(part[[k]] for part in of[1:])) for k in (i, i ^ 1))
    out = []
    for share, a, b in ((_NEAR, own, other), (1 - _NEAR, other, own)):
        parts = [(_NEAR * x - (1 - _NEAR) * y) / (2 * _NEAR - 1) for x, y in zip(a[1:], b[1:], strict=True)]
        out.append((share, Steps(own.thickness, *parts)))
    return out


@numba.njit(cache=True, error_model="numpy")
def generator(of: Steps, i: int, u_m: Floats, v: float, out: Complexes) -> None:
    """The matrix i h M (4n, 4n) of step i, in blocks for Ê_x, Ê_y, h_x, h_y."""
    n, scale = u_m.size, 1j * of.thickness[i]
    out[:] = 0.0
    for a in range(n):
        for b in range(n):
            z, z_x, x_z = of.z[i, a, b], of.z_x[i, a, b], of.x_z[i, a, b]
            out[a, n + b], out[a, 2 * n + b], out[a, 3 * n + b] = v * z_x, -v * v * z, v * z * u_m[b]
            out[n + a, n + b], out[n + a, 2 * n + b] = -u_m[a] * z_x, v * u_m[a] * z
            out[n + a, 3 * n + b] = -u_m[a] * z * u_m[b]
            out[2 * n + a, b], out[3 * n + a, n + b] = of.epsilon[i, a, b], of.p[i, a, b]
            out[3 * n + a, 2 * n + b], out[3 * n + a, 3 * n + b] = v * x_z, -x_z * u_m[b]
        out[a, 2 * n + a] += 1.0
        out[n + a, 3 * n + a] += 1.0
        out[2 * n + a, a] -= u_m[a] * u_m[a]
        out[3 * n + a, n + a] -= v * v
        out[2 * n + a, n + a] -= v * u_m[a]
        out[3 * n + a, a] -= v * u_m[a]
    out *= scale


@numba.njit(cache=True, error_model="numpy")
def even_part(of: Steps, by: Products, i: int, u_m: Floats, v: float, out: Complexes) -> None:
    """12 + B² (4n, 4n) of step i, B as `generator` makes it."""
    n, v2, scale, u = u_m.size, v * v, of.thickness[i] ** 2, u_m[u_m.size // 2]
    for a in range(n):
        for b in range(n):
            s_1, s_2 = by.start[0, i, a, b] + u * by.slope[0, i, a, b], by.start[1, i, a, b] + u * by.slope[1, i, a, b]
            s_3, s_4 = by.start[2, i, a, b] + u * by.slope[2, i, a, b], by.start[3, i, a, b] + u * by.slope[3, i, a, b]
            z_x, x_z, p, epsilon = of.z_x[i, a, b], of.x_z[i, a, b], of.p[i, a, b], of.epsilon[i, a, b]
            k_a, k_b = u_m[a], u_m[b]
            out[a, b], out[a, n + b] = epsilon - v2 * by.plain[0, i, a, b], -v * s_1
            out[a, 2 * n + b], out[a, 3 * n + b] = v2 * s_2, v * (z_x - s_2 * k_b)
            out[n + a, b], out[n + a, n + b] = v * k_a * by.plain[0, i, a, b], p + k_a * s_1
            out[n + a, 2 * n + b], out[n + a, 3 * n + b] = v * (x_z - k_a * s_2), k_a * (s_2 * k_b - z_x) - x_z * k_b
            out[2 * n + a, b], out[2 * n + a, n + b] = 0.0, v * by.plain[2, i, a, b]
            out[2 * n + a, 2 * n + b] = epsilon - v2 * by.plain[1, i, a, b]
            out[2 * n + a, 3 * n + b] = v * by.plain[1, i, a, b] * k_b
            out[3 * n + a, b], out[3 * n + a, n + b] = v * by.plain[3, i, a, b], -s_4
            out[3 * n + a, 2 * n + b], out[3 * n + a, 3 * n + b] = v * s_3, p - s_3 * k_b
        for first in (0, 2 * n):  # the same for Ê and h
            out[first + a, first + a] -= u_m[a] * u_m[a]
            out[first + n + a, first + n + a] -= v2
            out[first + a, first + n + a] -= v * u_m[a]
            out[first + n + a, first + a] -= v * u_m[a]
    for j in range(4 * n):
        for k in range(4 * n):
            out[j, k] *= -scale
        out[j, j] += 12.0


@numba.njit(cache=True, error_model="numpy")
def step_up(matrix: Complexes, even: Complexes, rho: Complexes) -> tuple[NDArray[Any], NDArray[Any]]:
    """ρ at the top of a step and f₊ (m, m) below it per f₊ above, from its B and 12 + B² (2m, 2m) and ρ (m, m) below.

    X above is exp(−B) X below = −X + 2 (12 + 6 B + B²)⁻¹ (12 + B²) X.
    """
    m = rho.shape[0]
    above = np.linalg.solve(even + 6.0 * matrix, even[:, :m] + even[:, m:] + (even[:, :m] - even[:, m:]) @ rho)
    above[:m] -= 0.5 * rho
    above[m:] += 0.5 * rho
    for j in range(m):
        above[j, j] -= 0.5
        above[m + j, j] -= 0.5
    plus, minus = above[:m] + above[m:], above[:m] - above[m:]
    through = np.linalg.inv(plus)
    return minus @ through, through


@numba.njit(cache=True, error_model="numpy")
def transfer(matrix: Complexes, even: Complexes) -> NDArray[Any]:
    """What takes X (2m) from below a step to above it, from its B and 12 + B² (2m, 2m): as in `step_up`."""
    out = 2.0 * np.linalg.solve(even + 6.0 * matrix, even)
    for j in range(matrix.shape[0]):
        out[j, j] -= 1.0
    return out


@numba.njit(cache=True, error_model="numpy")
def full_matrix(blocks: Complexes) -> Complexes:
    """Blocks (n, 2, 2) as a matrix (2n, 2n)."""
    n = blocks.shape[0]
    out = np.zeros((2 * n, 2 * n), np.complex128)
    for j in range(n):
        out[j, j], out[j, n + j] = blocks[j, 0, 0], blocks[j, 0, 1]
        out[n + j, j], out[n + j, n + j] = blocks[j, 1, 0], blocks[j, 1, 1]
    return out


@numba.njit(cache=True, error_model="numpy")
def climb_steps(
    of: Steps,
    by: Products,
    u_m: Floats,
    v: Floats,
    front: Complexes,
    back: Complexes,
    source: Complexes,
    outer: Complexes,
    inner: Complexes,
) -> None:
    """f₊ and f₋ at the top (outer (n_d, 2, 2n, 2)) and f₊ at the bottom (inner (n_d, 2n, 2)) for n_d directions.

    u_m (n_d, n), v (n_d); front, back (n_d, n, 2, 2): ρ seen from the steps. source (n_d, 2n, 2): f₊ − ρ_front f₋
    of the incident light for each of two polarisations.
    """
    n_s, m = of.thickness.size, source.shape[1]
    through, (matrix, even) = np.empty((n_s, m, m), np.complex128), np.empty((2, 2 * m, 2 * m), np.complex128)
    for d in range(v.size):
        rho = full_matrix(back[d])
        for i in range(n_s - 1, -1, -1):
            generator(of, i, u_m[d], v[d], matrix)
            even_part(of, by, i, u_m[d], v[d], even)
            rho, through[i] = step_up(matrix, even, rho)
        field = np.linalg.solve(np.eye(m) - full_matrix(front[d]) @ rho, np.ascontiguousarray(source[d]))
        outer[d, 0], outer[d, 1] = field, rho @ field
        for i in range(n_s):
            field = through[i] @ np.ascontiguousarray(field)
        inner[d] = field
