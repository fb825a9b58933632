"""Fourier modal method for stacks of lamellar layers: fast, and exact in the limit of many diffraction orders.

The structure does not change along r, so every field is a sum of modes with E_g = 0 and modes with H_g = 0 (Li 1993,
J. Mod. Opt. 40, 553; here x = g, y = r, z = n and k₀ = 1, h = Z₀H, time factor exp(−iωt)). With ⟦ε⟧ the Toeplitz matrix
of the Fourier coefficients of ε and K = diag(u_m), their profiles along g obey eigenproblems that know neither v nor
the thickness:

    E_g = 0:  (⟦ε⟧ − K²) ψ = β² ψ,             H_g = 0:  (1 − K ⟦ε⟧⁻¹ K) φ = β² ⟦1/ε⟧ φ.

The second holds Li's inverse rule (Li 1996, J. Opt. Soc. Am. A 13, 1870). For every v the modes are the same and
k_z² = β² − v². The tangential fields of a mode that runs along +z (along −z: h reversed) are

    E_g = 0:  E_y = k_z ψ, h_x = −β² ψ, h_y = v K ψ;    H_g = 0:  E_x = β² ⟦1/ε⟧ φ, E_y = −v ⟦ε⟧⁻¹ K φ, h_y = k_z φ.

Layers are joined through the waves f± = ẑ × E ± h that run towards and away from what lies behind, f₋ = ρ f₊: ρ is
bounded for every passive structure, also where an admittance or an impedance has a pole, and a layer adds decaying
exponentials only, so that nothing grows with thickness. Both polarisations are solved at once: efficiencies are
Hermitian forms in the incident Jones vector, given by their values for the four Stokes components.

Where there are orders enough the basis is plane waves along a stretched coordinate (`optics.modal.stretch`), in which
these equations look the same and converge far faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import eigh

from beamrider.arrays import Complexes, Floats
from optics.cells.outline import polygons
from optics.cells.schema import LamellarStack, as_stack
from optics.modal.scattering import NEGLIGIBLE, LayerModes, joints, scatter
from optics.modal.slabs import climb_slabs, slabs
from optics.modal.slanted import climb_steps, products, steps
from optics.modal.steps import ModalCell, Slanted
from optics.modal.stretch import Basis, Mesh, Stretch, basis, fourier_coefficients, mesh, stretch, toeplitz_matrix
from optics.waves.incidence import polarisation_basis, wave_vector

# A mode exactly at its cut-off (k_z = 0) is moved off it by this much: q moves by as little, and no matrix is singular.
_CUTOFF = 1e-8
# A wave whose decay is less than this share of its phase counts as running.
_REAL = 1e-6


def square_root(square: Complexes) -> Complexes:
    """√ (...) with the sign of a wave that decays or else runs along +z; kept off zero by `_CUTOFF`."""
    root = np.sqrt(square)
    # Plasmons may run backwards (Re < 0) while they decay; a root that is real but for rounding runs forwards.
    real = np.abs(root.imag) <= _REAL * np.abs(root)
    root = np.where(np.where(real, root.real, root.imag) < 0, -root, root)
    return np.where(np.abs(root) < _CUTOFF, _CUTOFF * np.exp(0.25j * np.pi), root)


@dataclass(frozen=True)
class Lamella:
    """A layer in solver units: thickness in radians of vacuum (2π h/λ), permittivity of the gaps, ridges in periods."""

    thickness: float
    background: complex
    ridges: tuple[tuple[float, float, complex], ...]

    @property
    def lossless(self) -> bool:
        """Whether nothing in it absorbs or is metal: its modes are then those of Hermitian matrices."""
        return all(value.imag == 0 and value.real > 0 for value in (self.background, *(x[2] for x in self.ridges)))

    def contrast(self, within: Stretch | None, n: int, inverse: bool) -> Complexes:
        """⟦f (ε − ε_gap)⟧ or ⟦f (1/ε − 1/ε_gap)⟧ (n, n)."""
        gap = self.background
        pieces = tuple((start, width, 1 / e - 1 / gap if inverse else e - gap) for start, width, e in self.ridges)
        return toeplitz_matrix(fourier_coefficients(within, pieces, n - 1))

    def matrices(self, over: Basis) -> tuple[Complexes, Complexes]:
        """⟦ε⟧ and ⟦1/ε⟧ (n, n) in a basis."""
        n = over.cosines.size
        epsilon, inverse = (over.take(part) for part in _contrasts(self, over.stretch, n))
        return self.background * np.eye(n) + epsilon, 1 / self.background * np.eye(n) + inverse


@lru_cache(maxsize=64)
def _contrasts(layer: Lamella, within: Stretch | None, n: int) -> tuple[Complexes, Complexes]:
    """Both contrasts of a layer: the same for every direction."""
    return layer.contrast(within, n, False), layer.contrast(within, n, True)


def lamellae(stack: LamellarStack) -> list[Lamella]:
    """The layers of a stack in solver units; ridges of the gaps' own material are left out."""
    out = []
    for layer in stack.layers:
        background = layer.index.permittivity
        ridges = tuple(
            (ridge.start_nm / stack.period_nm, ridge.width_nm / stack.period_nm, ridge.index.permittivity)
            for ridge in layer.ridges
            if ridge.index.permittivity != background
        )
        out.append(Lamella(2 * np.pi * layer.thickness_nm / stack.wavelength_nm, background, ridges))
    return out


def modes(layer: Lamella, over: Basis) -> LayerModes:
    """Both families of modes of a layer in the plane waves of one u."""
    u_m = over.cosines
    if not layer.ridges:
        one, k = np.eye(u_m.size, dtype=complex), np.diag(u_m).astype(complex)
        beta2: Complexes = np.asarray(layer.background - u_m**2, complex)
        # At β = 0 a mode's E and h, which hold k_z and β², would not belong together once k_z is moved off zero.
        beta2 = np.asarray(np.where(np.abs(beta2) < _CUTOFF**2, 1j * _CUTOFF**2, beta2), complex)
        return LayerModes(beta2, one, k, beta2, one, np.diag(beta2) / layer.background, k / layer.background)
    epsilon, inverse = layer.matrices(over)
    inverse_epsilon_k = np.linalg.inv(epsilon) * u_m  # ⟦ε⟧⁻¹ K
    electric, magnetic = epsilon - np.diag(u_m**2), np.eye(u_m.size) - u_m[:, None] * inverse_epsilon_k
    if layer.lossless:
        (beta2_s, psi), (beta2_p, phi) = eigh(electric), eigh(magnetic, inverse)
    else:
        (beta2_s, psi), (beta2_p, phi) = np.linalg.eig(electric), np.linalg.eig(np.linalg.solve(inverse, magnetic))
    return LayerModes(
        beta2_s + 0j, psi, u_m[:, None] * psi, beta2_p + 0j, phi, inverse @ phi * beta2_p, inverse_epsilon_k @ phi
    )


# --- homogeneous parts: order by order, s and p apart -----------------------------------------------------------------


def half_space(u_m: Floats, v: Floats, permittivity: complex) -> tuple[Complexes, Complexes]:
    """k_z and the admittances of s and p (2, n_d, n) of outgoing plane waves."""
    k_t, index = np.hypot(u_m, v[:, None]), np.sqrt(complex(permittivity))
    k_z = square_root((index - k_t) * (index + k_t))  # a product keeps its digits at glancing light
    return k_z, np.stack([k_z, permittivity / k_z])


def tail(layers: list[Lamella], permittivity: complex, u_m: Floats, v: Floats) -> tuple[Complexes, Complexes]:
    """What lies behind the last patterned layer: homogeneous `layers` and a half-space.

    Returns ρ (2, n_d, n) for s and p, and the tangential ẑ × E (2, n_d, n) in the half-space per f₊ at the top.
    """
    _, y = half_space(u_m, v, permittivity)
    rho, through = (1 - y) / (1 + y), 1 / (1 + y)
    for layer in reversed(layers):
        k_z, y = half_space(u_m, v, layer.background)
        x = np.exp(1j * k_z * layer.thickness)
        bounce = (rho * (1 + y) - (1 - y)) * x / ((1 + y) - rho * (1 - y))
        top = (1 + y) + (1 - y) * x * bounce
        rho, through = ((1 - y) + (1 + y) * x * bounce) / top, through * ((1 + y) * x + (1 - y) * bounce) / top
    return rho, through


def blocks(values: Complexes, u_m: Floats, v: Floats) -> Complexes:
    """Blocks (n_d, n, 2, 2) in (x, y) of an operator on f, from its values (2, n_d, n) for s and p.

    f = ẑ × E ± h lies along k_t for s and across it for p.
    """
    k_t = np.hypot(u_m, v[:, None])
    safe = np.where(k_t > 0, k_t, 1.0)
    a, b = np.where(k_t > 0, u_m / safe, 1.0), np.where(k_t > 0, v[:, None] / safe, 0.0)
    s, p = values
    cross = a * b * (s - p)
    rows = [np.stack([s * a * a + p * b * b, cross], -1), np.stack([cross, s * b * b + p * a * a], -1)]
    return np.stack(rows, -2)


def apply_blocks(tensor: Complexes, columns: Complexes) -> Complexes:
    """Blocks (n_d, n, 2, 2) on stacked components [x (n), y (n)] of columns (n_d, 2n, k)."""
    n = tensor.shape[1]
    x, y = columns[:, :n], columns[:, n:]
    return np.concatenate([tensor[..., i, 0, None] * x + tensor[..., i, 1, None] * y for i in (0, 1)], axis=1)


# --- the response -----------------------------------------------------------------------------------------------------


def _turned(field: Complexes) -> Complexes:
    """ẑ × of stacked tangential components [x (n), y (n)] along axis −2."""
    n = field.shape[-2] // 2
    return np.concatenate([-field[..., n:, :], field[..., :n, :]], axis=-2)


def flux(turned_e: Complexes, h: Complexes) -> Floats:
    """Power along +z (n_d, 4, n) of each order for the Stokes components, from ẑ × E and h (n_d, 2n, 2).

    With two unit polarisations a and b the power is P_aa |a|² + P_bb |b|² + 2 Re(P_ab a b*).
    """
    n = h.shape[1] // 2
    power = turned_e[:, :n, :, None] * h[:, :n, None].conj() + turned_e[:, n:, :, None] * h[:, n:, None].conj()
    aa, bb = power[..., 0, 0].real, power[..., 1, 1].real
    ab = (power[..., 0, 1] + power[..., 1, 0].conj()) / 2
    return np.stack([(aa + bb) / 2, (aa - bb) / 2, ab.real, -ab.imag], axis=1)


@dataclass(frozen=True)
class Stack:
    """A cell prepared for the solver: pitch λ/d, patterned layers, homogeneous layers behind them, permittivities.

    Its walls, or None for plain plane waves. averaged: which of all layers have their fringes averaged. slanted: taken
    in steps instead of patterned layers.
    """

    pitch: float
    patterned: list[Lamella]
    behind: list[Lamella]
    front_index: float
    back: complex
    walls: Mesh | None
    averaged: tuple[int, ...] = ()
    slanted: Slanted | None = None

    @property
    def densest(self) -> float:
        """Largest refractive index of the half-spaces and in the layers."""
        layers = [*self.patterned, *self.behind]
        within = [x for layer in layers for x in (layer.background, *(ridge[2] for ridge in layer.ridges))]
        steps = [epsilon for _, epsilon in polygons(self.slanted.profile)] if self.slanted else []
        return max(np.sqrt(complex(x)).real for x in (self.front_index**2, self.back, *within, *steps))

    def stretch(self, order: int) -> Stretch | None:
        """How x is stretched for so many orders."""
        return stretch(self.walls, order) if self.walls else None


def _prepare_steps(cell: Slanted) -> Stack:
    behind = [
        Lamella(2 * np.pi * part.thickness_nm / cell.wavelength_nm, part.index.permittivity, ()) for part in cell.behind
    ]
    around = cell.surroundings
    return Stack(cell.pitch, [], behind, around.front, complex(around.back, around.back_k) ** 2, None, slanted=cell)


def prepare(cell: ModalCell, stretched: bool = True) -> Stack:
    """The cell in solver units; `stretched=False` for plane waves along x itself."""
    if isinstance(cell, Slanted):
        return _prepare_steps(cell)
    stack = as_stack(cell)
    layers = lamellae(stack)
    last = max((i for i, layer in enumerate(layers) if layer.ridges), default=0)
    around = stack.surroundings
    back = complex(around.back, around.back_k) ** 2
    averaged = tuple(i for i, layer in enumerate(stack.layers) if not layer.coherent)
    patterned = [layer for layer in layers if layer.ridges]
    every = [back, around.front**2, *(x for layer in layers for x in (layer.background, *(r[2] for r in layer.ridges)))]
    densest = max(np.sqrt(max(x.real, 1.0)) for x in every) / stack.pitch
    metal = any(x.real < 0 for x in every)
    walls = mesh([(layer.background, layer.ridges) for layer in patterned], densest, metal) if stretched else None
    return Stack(stack.pitch, layers[: last + 1], layers[last + 1 :], around.front, back, walls, averaged)


def incident_light(u: Floats, v: Floats, order: int, index: float) -> tuple[Complexes, Complexes]:
    """ẑ × E and h (n_d, 2n, 2) of unit light in the zeroth order, polarised along each of the two basis vectors."""
    n = 2 * order + 1
    e, h = np.zeros((2, v.size, 2 * n, 2), complex)
    k = wave_vector(u, v, index)
    for c, field in enumerate(polarisation_basis(u, v, index)):
        magnetic = np.cross(k, field)
        e[:, order, c], e[:, n + order, c] = field[:, 0], field[:, 1]
        h[:, order, c], h[:, n + order, c] = magnetic[:, 0], magnetic[:, 1]
    return _turned(e), h


def through_layers(
    stack: Stack,
    bases: list[Basis],
    starts: list[int],
    v: Floats,
    front: Complexes,
    back: Complexes,
    source: Complexes,
    negligible: float,
    known: list[list[LayerModes]] | None = None,
) -> tuple[Complexes, Complexes]:
    """`scatter` for n_d directions, those of one u and basis from `starts` on: f± (n_d, 2, 2n, columns), f₊ below.

    known: the modes of every patterned layer in each basis, if they are.
    """
    top, bottom = np.empty((v.size, 2, *source.shape[1:]), complex), np.empty_like(source)
    thickness = np.array([layer.thickness for layer in stack.patterned])[:, None]
    epsilon = np.array([np.nan if layer.ridges else layer.background for layer in stack.patterned])
    every = known or [[modes(layer, over) for layer in stack.patterned] for over in bases]
    for over, layers, begin, end in zip(bases, every, starts, [*starts[1:], v.size], strict=True):
        stacked = LayerModes(*(np.stack(part) for part in zip(*layers, strict=True)))
        beta2, part = np.concatenate([stacked.beta2_s, stacked.beta2_p], axis=1), slice(begin, end)
        k_z = square_root(np.subtract(beta2, v[part, None, None] ** 2))
        for i in np.flatnonzero(~np.isnan(epsilon)):
            k_z[:, i] = np.tile(half_space(over.cosines, v[part], epsilon[i])[0], 2)
        scatter(
            stacked,
            joints(stacked, epsilon),
            epsilon,
            over.cosines,
            v[part],
            k_z,
            np.exp(1j * k_z * thickness),
            front[part],
            back[part],
            source[part],
            negligible,
            top[part],
            bottom[part],
        )
    return top, bottom


def plane_waves(stack: Stack, u: Floats, order: int) -> tuple[list[Basis], list[int], Floats]:
    """The basis of each run of equal u (n_d), where the runs start, and the cosines (n_d, 2N + 1) of all directions."""
    starts = [0, *(np.flatnonzero(np.diff(u)) + 1).tolist()]
    bases = [basis(stack.stretch(order), u_i, stack.pitch, order) for u_i in u[starts].tolist()]
    return bases, starts, np.repeat([over.cosines for over in bases], np.diff([*starts, u.size]), axis=0)


def outgoing(
    stack: Stack, u_m: Floats, v: Floats, light: tuple[Complexes, Complexes], top: Complexes, e_t: Complexes
) -> tuple[Floats, Floats]:
    """Reflected and transmitted efficiencies (n_d, 4, n) of orders u_m (n_d, n), the middle one that of the light.

    light: its ẑ × E and h (n_d, 2n, 2). top (n_d, 2, 2n, 2): f± in front; e_t (n_d, 2n, 2): ẑ × E behind.
    """
    e_in, h_in = light
    e_r, h_r = (top[:, 0] + top[:, 1]) / 2 - e_in, (top[:, 0] - top[:, 1]) / 2 - h_in
    h_t = apply_blocks(blocks(half_space(u_m, v, stack.back)[1], u_m, v), e_t)
    power = flux(e_in, h_in)[:, :1, u_m.shape[1] // 2, None]
    return -flux(e_r, h_r) / power, flux(e_t, h_t) / power


def efficiencies(
    stack: Stack, u: Floats, v: Floats, order: int, negligible: float = NEGLIGIBLE
) -> tuple[Floats, Floats]:
    """Reflected and transmitted efficiencies (n_d, 4, n) of the orders for the Stokes components, for u, v (n_d).

    The modes are found once for neighbours of equal u.
    """
    bases, starts, u_m = plane_waves(stack, u, order)
    _, y_front = half_space(u_m, v, complex(stack.front_index) ** 2)
    front = blocks((1 - y_front) / (1 + y_front), u_m, v)
    rho, through = tail(stack.behind, stack.back, u_m, v)
    e_in, h_in = incident_light(u, v, order, stack.front_index)
    source = e_in + h_in - apply_blocks(front, e_in - h_in)
    top: Complexes
    bottom: Complexes
    if stack.slanted:
        top, bottom = np.empty((v.size, 2, *source.shape[1:]), complex), np.empty_like(source)
        joined = slabs(stack.slanted, order) if stack.slanted.holds(u, v) else None
        around = front, blocks(rho, u_m, v), source, top, bottom
        if joined:
            climb_slabs(joined, u, v, *around)
        else:
            climb_steps(steps(stack.slanted, order), products(stack.slanted, order), u_m, v, *around)
    else:
        top, bottom = through_layers(stack, bases, starts, v, front, blocks(rho, u_m, v), source, negligible)

    return outgoing(stack, u_m, v, (e_in, h_in), top, apply_blocks(blocks(through, u_m, v), bottom))
