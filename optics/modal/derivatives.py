"""First derivatives of q in the direction of light and in the geometry, from the Fourier modal solution itself.

The equations are those of `optics.modal.lamellar`, with every layer in its modes, carried with their derivatives.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from beamrider.arrays import Complexes, Floats
from beamrider.io.files import InputError
from optics.cells.schema import LamellarStack, Metagrating, as_stack, require_coherent
from optics.modal import dual
from optics.modal.dual import Dual
from optics.modal.lamellar import Lamella, lamellae, prepare, square_root
from optics.modal.stretch import THINNEST, Piece, Stretch, exact, fourier_coefficients, toeplitz_matrix, weight
from optics.waves.incidence import AXES

# A YAML field of a stack: layers[0].thickness_nm, layers[0].ridges[1].start_nm, layers[0].ridges[1].width_nm
_FIELD = re.compile(r"layers\[(\d+)\]\.(?:(thickness_nm)|ridges\[(\d+)\]\.(start_nm|width_nm))$")
_GRATING = {"ridge_height_nm": "layers[0].thickness_nm", "membrane_nm": "layers[1].thickness_nm"}
# A homogeneous layer in which k_z² of an order is less than this is made denser by as much: q moves by a tenth of it,
# and derivatives, which lose digits as 1/k_z², keep six behind the point.
_ALONG = 1e-6
# Step of a wall, in periods, of differences of the matrices.
_STEP = 1e-5
_RIDGE = re.compile(r"ridges_nm\[(\d+)\]\[([01])\]$")


@dataclass(frozen=True)
class Derivatives:
    """q (3,) in (g, r, n), absorptance, and their derivatives by n parameters: q_dot (n, 3), absorptance_dot (n,)."""

    q: Floats
    absorptance: float
    q_dot: Floats
    absorptance_dot: Floats


def stack_field(name: str) -> str:
    """The field of a stack that a field of a metagrating becomes; other names stay as they are."""
    ridge = _RIDGE.match(name)
    if ridge:
        return f"layers[0].ridges[{ridge[1]}].{('start_nm', 'width_nm')[int(ridge[2])]}"
    return _GRATING.get(name, name)


def derivatives(
    cell: Metagrating | LamellarStack, u: float, v: float, order: int, parameters: Sequence[str] = ("u", "v")
) -> Derivatives:
    """Derivatives of q at one direction by 'u', 'v', 'period_nm' and fields of the cell as its YAML names them.

    Fields: `layers[i].thickness_nm`, `layers[i].ridges[j].start_nm` or `.width_nm`; of a metagrating
    `ridge_height_nm`, `membrane_nm`, `ridges_nm[j][0]` (start) and `[1]` (width). Per nm for lengths. InputError for
    other names. At a Rayleigh cut-off itself q has no derivative.
    """
    require_coherent(cell, "derivatives")
    stack = as_stack(cell)
    seeds = _Seeds(stack, parameters)
    u_dual, v_dual = seeds.scalar(u, "u"), seeds.scalar(v, "v")
    pitch = seeds.scalar(stack.pitch, "period_nm", -stack.pitch / stack.period_nm)
    over = _basis(seeds, prepare(cell).stretch(order), u_dual + pitch * np.arange(-order, order + 1.0))
    u_m = over.cosines
    back = _back(stack)
    rho = _reflection(u_m, v_dual, back)
    f_plus = []
    layers = lamellae(stack)
    waves = [_waves(seeds, i, layer, over, v_dual) for i, layer in enumerate(layers)]
    bounces: list[Dual] = []
    for plus, minus, x in reversed(waves):
        bounce = dual.solve(plus - rho @ minus, (rho @ plus - minus) * x)
        inside = _column(x) * bounce
        top = plus + minus @ inside
        rho = dual.transpose(dual.solve(dual.transpose(top), dual.transpose(minus + plus @ inside)))
        f_plus.append(top)
        bounces.append(bounce)
    q, absorptance = _pressure(
        stack, u_dual, v_dual, u_m=u_m, order=order, rho=rho, waves=waves, tops=f_plus[::-1], bounces=bounces[::-1]
    )
    return Derivatives(q.value, float(absorptance.value), q.dot, absorptance.dot)


class _Seeds:
    """Which parameter moves what: the derivatives that every input of the solution starts with."""

    def __init__(self, stack: LamellarStack, names: Sequence[str]) -> None:
        self.stack, self.names = stack, [stack_field(name) for name in names]
        for name, field in zip(names, self.names, strict=True):
            if field not in ("u", "v", "period_nm") and not self._exists(field):
                raise InputError(f"{stack.name}: no derivative by '{name}': must be u, v or a length of the cell")

    def _exists(self, name: str) -> bool:
        """Whether the stack has that length."""
        field = _FIELD.match(name)
        if field is None or int(field[1]) >= len(self.stack.layers):
            return False
        return bool(field[2]) or int(field[3]) < len(self.stack.layers[int(field[1])].ridges)

    def scalar(self, value: float, name: str, rate: float = 1.0) -> Dual:
        """A number that moves at `rate` with the parameter `name` and with no other."""
        return Dual(np.array(value), np.array([rate if name == own else 0.0 for own in self.names]))

    def thickness(self, i: int, layer: Lamella) -> Dual:
        """Thickness of layer i in radians."""
        return self.scalar(layer.thickness, f"layers[{i}].thickness_nm", 2 * np.pi / self.stack.wavelength_nm)

    def pieces(self, i: int, inverse: bool, t: int = 0, step: float = 0.0) -> tuple[Piece, ...]:
        """Ridges of layer i with their contrasts to the gaps, once parameter t has moved by a step."""
        gap = self.stack.layers[i].index.permittivity
        found = []
        for j, ridge in enumerate(self.stack.layers[i].ridges):
            inside = ridge.index.permittivity
            start, end = self.ends(i, j) + step * self.rates(i, j)[:, t]
            found.append((float(start), float(end - start), 1 / inside - 1 / gap if inverse else inside - gap))
        return tuple(found)

    @property
    def ridges(self) -> list[tuple[int, int]]:
        """Layer and number of each ridge."""
        return [(i, j) for i, layer in enumerate(self.stack.layers) for j in range(len(layer.ridges))]

    def ends(self, i: int, j: int) -> Floats:
        """Where ridge j of layer i starts and ends, in periods (2,)."""
        ridge = self.stack.layers[i].ridges[j]
        return np.array([ridge.start_nm, ridge.start_nm + ridge.width_nm]) / self.stack.period_nm

    def rates(self, i: int, j: int) -> Floats:
        """Derivatives (2, n_parameters) of `ends`."""
        period, (start, end) = self.stack.period_nm, self.ends(i, j)
        field = f"layers[{i}].ridges[{j}]"
        moves = {
            f"{field}.start_nm": (1.0, 1.0),
            f"{field}.width_nm": (0.0, 1.0),
            "period_nm": (-start, -end),
        }
        return np.array([moves.get(name, (0.0, 0.0)) for name in self.names]).reshape(-1, 2).T / period

    def moved(self, of: Stretch, t: int, step: float) -> Stretch:
        """The stretch, once parameter t has moved by a step: its walls follow the ridges."""
        old = np.array(of.x)
        x = old.copy()
        for i, j in self.ridges:
            for end, rate in zip(self.ends(i, j), self.rates(i, j)[:, t], strict=True):
                here = np.abs((old - end + 0.5) % 1.0 - 0.5) < THINNEST
                x[here] = old[here] + step * rate
        return replace(of, x=tuple(x.tolist()))

    def matrix(self, of: Callable[[int, float], Complexes]) -> Dual:
        """A matrix and its derivatives, by differences of fourth order; of(t, step): where parameter t has moved."""
        value, period = of(0, 0.0), self.stack.period_nm
        dot = np.zeros((len(self.names), *value.shape), complex)
        for t in range(len(self.names)):
            if any(self.rates(i, j)[:, t].any() for i, j in self.ridges):
                h = _STEP * period
                near, far = (of(t, k * h) - of(t, -k * h) for k in (1, 2))
                dot[t] = (8 * near - far) / (12 * h)
        return Dual(value, dot)

    def contrast(self, i: int, over: _Basis, inverse: bool) -> Dual:
        """⟦ε⟧ or ⟦1/ε⟧ (n, n) of layer i less that of its gaps."""
        n, within = over.cosines.value.size, over.stretch

        def raw(t: int, step: float) -> Complexes:
            moved = self.moved(within, t, step) if within else None
            return toeplitz_matrix(fourier_coefficients(moved, self.pieces(i, inverse, t, step), n - 1))

        return over.take(self.matrix(raw))


@dataclass(frozen=True)
class _Basis:
    """`optics.modal.stretch.Basis` with its derivatives."""

    stretch: Stretch | None
    cosines: Dual
    columns: Dual | None

    def take(self, matrix: Dual) -> Dual:
        """Wᴴ M W of a matrix over exp(iα_m ξ)."""
        if self.columns is None:
            return matrix
        return dual.transpose(self.columns.conj) @ (matrix @ self.columns)


def _basis(seeds: _Seeds, of: Stretch | None, u_m: Dual) -> _Basis:
    """Plane waves and how they change: K w = κ F w with wᴴ F w = 1, by perturbation."""
    if of is None:
        return _Basis(None, u_m, None)
    n = u_m.value.size
    f = seeds.matrix(lambda t, step: weight(seeds.moved(of, t, step), n))
    kappa, w = eigh(np.diag(u_m.value), f.value)
    k_dot = u_m.dot[:, :, None] * np.eye(n)
    turns, norms = w.conj().T @ k_dot @ w, w.conj().T @ f.dot @ w
    turns = turns - norms * kappa
    gaps = kappa - kappa[:, None] + np.eye(n)
    mixing = np.where(np.eye(n) > 0, -norms / 2, turns / gaps)
    own = exact(of, n)
    cosines = Dual(np.where(own, u_m.value, kappa), np.where(own, u_m.dot, np.einsum("tii->ti", turns).real))
    return _Basis(of, cosines, Dual(w.astype(complex), w @ mixing))


def _back(stack: LamellarStack) -> complex:
    """Permittivity of the half-space behind."""
    return complex(stack.surroundings.back, stack.surroundings.back_k) ** 2


def _column(x: Dual) -> Dual:
    return Dual(x.value[:, None], x.dot[:, :, None])


def _waves(seeds: _Seeds, i: int, layer: Lamella, over: _Basis, v: Dual) -> tuple[Dual, Dual, Dual]:
    """f₊, f₋ (2n, 2n) of the modes of layer i running along +z, and their decay (2n,)."""
    u_m, one = over.cosines, np.eye(over.cosines.value.size)
    if not layer.ridges:
        return _plane_waves(layer.background, u_m, v, seeds.thickness(i, layer))
    k = dual.diagonal(u_m)
    epsilon = seeds.contrast(i, over, False) + layer.background * one
    inverse = seeds.contrast(i, over, True) + one / layer.background
    beta2_s, psi = dual.eig(epsilon - k @ k)
    inverse_epsilon_k = dual.solve(epsilon, k)
    beta2_p, phi = dual.eig(dual.solve(inverse, one - k @ inverse_epsilon_k))
    displaced, k_phi = inverse @ phi * beta2_p, inverse_epsilon_k @ phi
    k_s, k_p = (dual.sqrt(beta2 - v * v, square_root) for beta2 in (beta2_s, beta2_p))
    electric, magnetic, across = psi * k_s, psi * beta2_s, v * (_column(u_m) * psi)
    s_plus = dual.concatenate([-electric - magnetic, across], 0)
    s_minus = dual.concatenate([magnetic - electric, -across], 0)
    electric, magnetic, across = displaced, phi * k_p, v * k_phi
    p_plus = dual.concatenate([across, electric + magnetic], 0)
    p_minus = dual.concatenate([across, electric - magnetic], 0)
    x = dual.exp(1j * dual.concatenate([k_s, k_p], 0) * seeds.thickness(i, layer))
    return dual.concatenate([s_plus, p_plus], 1), dual.concatenate([s_minus, p_minus], 1), x


def _plane_waves(permittivity: complex, u_m: Dual, v: Dual, thickness: Dual) -> tuple[Dual, Dual, Dual]:
    """`_waves` of a homogeneous layer, for each component of ẑ × E: f± = (1 ± y) ẑ × E, y_p − y_s = k_t²/k_z."""
    # An order along the layer (k_z = 0) is no cut-off, but its two waves are one there.
    if np.abs(permittivity - u_m.value**2 - v.value**2).min() < _ALONG:
        permittivity += _ALONG
    k_z = _k_z(u_m, v, permittivity)
    y, one = _tensor(k_z, 1.0 / k_z, u_m, v), np.eye(2 * u_m.value.size)
    return one + y, one - y, dual.exp(1j * dual.concatenate([k_z, k_z], 0) * thickness)


def _k_z(u_m: Dual, v: Dual, permittivity: complex) -> Dual:
    return dual.sqrt(permittivity - u_m * u_m - v * v + 0j, square_root)


def _tensor(diagonal: Dual, rest: Dual, u_m: Dual, v: Dual) -> Dual:
    """`diagonal` on all of f plus `rest` times the dyad of (−v, u), as a matrix (2n, 2n): regular at k_t = 0."""
    cross = dual.diagonal(-(rest * u_m * v))
    xx, yy = dual.diagonal(diagonal + rest * v * v), dual.diagonal(diagonal + rest * u_m * u_m)
    return dual.concatenate([dual.concatenate([xx, cross], 1), dual.concatenate([cross, yy], 1)], 0)


def _reflection(u_m: Dual, v: Dual, permittivity: complex) -> Dual:
    """ρ of a half-space: (1 − k_z)/(1 + k_z) for s; p differs by k_t² times `rest`, as y_s − y_p = −k_t²/k_z."""
    k_z = _k_z(u_m, v, permittivity)
    rest = -2.0 / (k_z * (1.0 + k_z) * (1.0 + permittivity / k_z))
    return _tensor((1.0 - k_z) / (1.0 + k_z), rest, u_m, v)


def _pressure(
    stack: LamellarStack,
    u: Dual,
    v: Dual,
    *,
    u_m: Dual,
    order: int,
    rho: Dual,
    waves: list[tuple[Dual, Dual, Dual]],
    tops: list[Dual],
    bounces: list[Dual],
) -> tuple[Dual, Dual]:
    """Force and absorptance: q (3,) from ρ of all layers, and the way of f₊ through them."""
    front, back = complex(stack.surroundings.front) ** 2, _back(stack)
    w = dual.sqrt(front.real - u * u - v * v)
    e_in, h_in = _incident(stack, u, v, w, order)
    outside = _reflection(u_m, v, front)
    source = e_in + h_in - outside @ (e_in - h_in)
    one = np.eye(source.value.shape[0])
    f = dual.solve(one - outside @ rho, source)
    g = rho @ f
    reflected = -1.0 * _flux((f + g) / 2.0 - e_in, (f - g) / 2.0 - h_in)
    for (plus, minus, x), top, bounce in zip(waves, tops, bounces, strict=True):
        down = dual.solve(top, f)
        f = plus @ (_column(x) * down) + minus @ (bounce @ down)
    g = _reflection(u_m, v, back) @ f
    transmitted = _flux((f + g) / 2.0, (f - g) / 2.0)
    incident = _flux(e_in, h_in)[order]
    w_front, w_back = (_k_z(u_m, v, value) for value in (front, back))
    reflected = (reflected / incident).where(w_front.value.real > 1e-7)
    transmitted = (transmitted / incident).where((w_back.value.real > 1e-7) & (back.imag == 0))
    lost = reflected + transmitted
    absorptance = 1.0 - lost.sum()
    q_g = u - (lost * u_m).sum()
    q_n = w + (reflected * w_front.real - transmitted * w_back.real).sum()
    return dual.stack([q_g, v * absorptance, q_n]), absorptance


def _incident(stack: LamellarStack, u: Dual, v: Dual, w: Dual, order: int) -> tuple[Dual, Dual]:
    """ẑ × E and h (2n, 1) of the incident light, polarised along the cell's own axis."""
    index = stack.surroundings.front
    k = [u, v, w]
    along = k[AXES[stack.electric_axis]]
    field = [-1.0 * part * along / index**2 for part in k]
    field[AXES[stack.electric_axis]] = field[AXES[stack.electric_axis]] + 1.0
    magnetic = [v * field[2] - w * field[1], w * field[0] - u * field[2]]
    n = 2 * order + 1
    return _placed([-1.0 * field[1], field[0]], order, n), _placed(magnetic, order, n)


def _placed(pair: list[Dual], order: int, n: int) -> Dual:
    """Column (2n, 1) that holds two numbers in the zeroth order of its two halves."""
    value, dot = np.zeros((2 * n, 1), complex), np.zeros((pair[0].dot.shape[0], 2 * n, 1), complex)
    for place, part in zip((order, n + order), pair, strict=True):
        value[place, 0], dot[:, place, 0] = part.value, part.dot
    return Dual(value, dot)


def _flux(turned_e: Dual, h: Dual) -> Dual:
    """Power along +z (n,) of each order."""
    product = (turned_e * h.conj).real
    n = product.value.shape[0] // 2
    return product[:n, 0] + product[n:, 0]
