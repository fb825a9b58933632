"""Light between the parts of a grating on thick layers: scattering matrices joined at one direction; compiled.

With f± as in `optics.modal.parts`, the front part F, and ρ what the thick layers and all behind them return, f₋ = ρ f₊,

    f₊ = F_light a + F_back f₋  →  (1 − F_back ρ) f₊ = F_light a.

Powers are Hermitian forms of the two polarisations of the light, given for its four Stokes components as in
`optics.modal.lamellar.flux`. What is absorbed is summed from what each part takes: it keeps its digits where it is
small.
"""

from __future__ import annotations

import numba
import numpy as np

from beamrider.arrays import Complexes, Floats
from beamrider.machine_code.standalone import standalone
from optics.waves.small_matrices import eliminate, norm, product, unit
from optics.waves.thick_layers import Setup, admittance, back_at, homogeneous, matrix, patterned, turn, wave_number

QUANTITIES = 16


@numba.njit(cache=True, error_model="numpy")
def _closed(up: Complexes, rho: Complexes, blocks: bool) -> Complexes:
    """1 − F_back ρ, ρ of one block for each order or full."""
    if not blocks:
        return unit(up.shape[0]) - product(up, rho)
    n, c = up.shape[0], up.shape[0] // 2
    out = np.empty((n, n), np.complex128)
    for i in range(n):
        for m in range(c):
            out[i, m] = -(up[i, m] * rho[m, m] + up[i, c + m] * rho[c + m, m])
            out[i, c + m] = -(up[i, m] * rho[m, c + m] + up[i, c + m] * rho[c + m, c + m])
        out[i, i] += 1.0
    return out


# --- powers -----------------------------------------------------------------------------------------------------------


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _stokes(aa: float, bb: float, ab: complex) -> tuple[float, float, float, float]:
    """A Hermitian form for the Stokes components of the light."""
    return (aa + bb) / 2, (aa - bb) / 2, ab.real, -ab.imag


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _squares(waves: Complexes, i: int) -> tuple[float, float, complex]:
    """|a|², |b|² and a b* of row i (., 2)."""
    a, b = waves[i, 0], waves[i, 1]
    return a.real * a.real + a.imag * a.imag, b.real * b.real + b.imag * b.imag, a * b.conjugate()


@numba.njit(cache=True, error_model="numpy")
def _take(out: Floats, waves: Complexes, i: int, weight: float, u_m: float, w: float, absorbed: float) -> None:
    """Add the force of a wave that leaves with u_m and w, and `absorbed` times its power to what is absorbed."""
    aa, bb, ab = _squares(waves, i)
    for k, power in enumerate(_stokes(weight * aa, weight * bb, weight * ab)):
        out[4 * k] -= power * u_m
        out[4 * k + 2] += power * w
        out[4 * k + 3] += power * absorbed


@numba.njit(cache=True, error_model="numpy")
def _turn_order(fields: Complexes, m: int, a: float, b: float, out: Complexes) -> None:
    """The s and p components (2, 2) of order m of fields (2 count, 2), whose k_t points along (a, b)."""
    c = fields.shape[0] // 2
    for i in range(2):
        out[0, i] = a * fields[m, i] + b * fields[c + m, i]
        out[1, i] = a * fields[c + m, i] - b * fields[m, i]


@numba.njit(cache=True, error_model="numpy")
def _leaving(
    out: Floats, waves: Complexes, s: Setup, first: int, index: complex, u: float, v: float, sign: float
) -> None:
    """Add the force of outgoing f (2 count, 2) in a lossless half-space, sign −1 behind the cell."""
    c, turned = waves.shape[0] // 2, np.empty((2, 2), np.complex128)
    for m in range(c):
        u_m = u + (first + m) * s.pitch
        k_t, a, b = turn(u_m, v)
        if k_t >= index.real:
            continue
        _turn_order(waves, m, a, b, turned)
        w = wave_number(index, k_t).real
        for p in range(2):
            y = admittance(index, complex(w, 0.0), p == 1).real
            _take(out, turned, p, y / ((1 + y) * (1 + y)), u_m, sign * w, 0.0)


@numba.njit(cache=True, error_model="numpy")
def _sent(out: Floats, fields: Complexes, s: Setup, u: float, v: float) -> None:
    """Add the force of ẑ × E (n, 2) in the half-space behind homogeneous layers; what leaves is not absorbed."""
    index, c, turned = s.media[s.media.size - 1], s.n // 2, np.empty((2, 2), np.complex128)
    for m in range(c if index.imag == 0.0 else 0):
        u_m = u + (s.first + m) * s.pitch
        k_t, a, b = turn(u_m, v)
        if k_t >= index.real:
            continue
        _turn_order(fields, m, a, b, turned)
        w = wave_number(index, k_t).real
        for p in range(2):
            _take(out, turned, p, admittance(index, complex(w, 0.0), p == 1).real, u_m, -w, -1.0)


@numba.njit(cache=True, error_model="numpy")
def _flow(out: Floats, down: Complexes, up: Complexes, sign: float) -> None:
    """Add the power (|f₊|² − |f₋|²)/4 that flows into what lies behind to what is absorbed, or take it away."""
    for i in range(down.shape[0]):
        _take(out, down, i, 0.25, 0.0, 0.0, sign)
        _take(out, up, i, 0.25, 0.0, 0.0, -sign)


@numba.njit(cache=True, error_model="numpy")
def _lost(out: Floats, x: Floats, at: int, waves: Complexes) -> None:
    """Add a Hermitian form, held from x[at] on, of waves (n, 2) to what is absorbed."""
    n = waves.shape[0]
    aa, bb, ab = 0.0, 0.0, 0j
    for i in range(n):
        of_a, of_b = 0j, 0j
        for j in range(n):
            low, high = min(i, j), max(i, j)
            imag = 0.0 if i == j else x[at + high * n + low]
            h = complex(x[at + low * n + high], imag if i < j else -imag)
            of_a += h * waves[j, 0]
            of_b += h * waves[j, 1]
        aa += (waves[i, 0].conjugate() * of_a).real
        bb += (waves[i, 1].conjugate() * of_b).real
        ab += waves[i, 1].conjugate() * of_a
    for k, power in enumerate(_stokes(aa, bb, ab)):
        out[4 * k + 3] += power


@numba.njit(cache=True, error_model="numpy")
def _with_light(up: Complexes) -> Complexes:
    """Light of both polarisations, each of 1, above f₋: what falls on the front part."""
    out = np.zeros((2 + up.shape[0], 2), np.complex128)
    out[0, 0], out[1, 1] = 1.0, 1.0
    out[2:] = up
    return out


@standalone()
def respond(s: Setup, x: Floats, u: float, v: float, out: Floats) -> None:
    """Write q_g, q_r, q_n and the absorptance for each Stokes component into out (16,), the parts held in x."""
    out[:QUANTITIES] = 0.0
    part, columns = back_at(s), s.n + 2
    rho, onwards = patterned(s, x, u, v) if s.patterned else homogeneous(s, u, v)
    down = matrix(x, 0, s.n, columns, 0, 2)
    eliminate(_closed(matrix(x, 0, s.n, columns, 2, s.n), rho, not s.patterned), down)
    up = product(rho, down)
    falling = _with_light(up)
    back = product(matrix(x, 2 * s.n * columns, s.n_out, columns, 0, columns), falling)
    _leaving(out, back, s, s.first_out, complex(s.front, 0.0), u, v, 1.0)
    if s.lossy_front:
        _lost(out, x, 2 * (s.n + s.n_out) * columns, falling)
    _flow(out, down, up, 1.0)
    ahead = product(onwards, down)
    if s.patterned:
        returned = product(matrix(x, part, s.n, s.n, 0, s.n), ahead)
        _flow(out, ahead, returned, -1.0)
        index = s.media[s.media.size - 1]
        if index.imag == 0.0:
            sent = product(matrix(x, part + 2 * s.n * s.n, s.n_sent, s.n, 0, s.n), ahead)
            _leaving(out, sent, s, s.first_sent, index, u, v, -1.0)
        if s.lossy_back:
            _lost(out, x, part + 2 * (s.n + s.n_sent) * s.n, ahead)
    else:
        _sent(out, ahead, s, u, v)
    _balance(out, s.front, u, v)


@numba.njit(cache=True, error_model="numpy")
def _balance(out: Floats, front: float, u: float, v: float) -> None:
    """From forces and losses of the light's field of 1 to coefficients, the momentum of the light itself among them."""
    w = wave_number(complex(front, 0.0), np.sqrt(u * u + v * v)).real
    for k in range(QUANTITIES):
        out[k] /= w
    out[0] += u
    out[2] += w
    for k in range(0, QUANTITIES, 4):
        out[k + 1] = v * out[k + 3]


@numba.njit(cache=True, error_model="numpy")
def own_light(s: Setup, out: Floats, u: float, v: float) -> None:
    """Contract the Stokes components (16,) with those of the cell's own polarisation, into out[:4].

    E along g, projected, has the components −ab and −c along the two basis vectors (`optics.waves.incidence`), in units
    of √(1 − a²) √(1 − b²), for light of the unit vector (a, b, c).
    """
    along, across = 1.0, 0.0
    if s.axis == 0:
        a, b = u / s.front, v / s.front
        c = np.sqrt(max((1.0 - a) * (1.0 + a) - b * b, 0.0))
        size = np.sqrt((1.0 - a) * (1.0 + a) * ((1.0 - b) * (1.0 + b)))
        along, across = -a * b / size, -c / size
    s1, s2 = along * along - across * across, 2.0 * along * across
    for k in range(4):
        out[k] += s1 * out[4 + k] + s2 * out[8 + k]


@numba.njit(cache=True, error_model="numpy")
def gain(s: Setup, x: Floats, u: float, v: float) -> float:
    """How much errors of the parts grow in the light between them: (1 + |(1 − F_back ρ)⁻¹|) (1 + |f₋|), to first order.

    x (size,): numbers of the parts. With a patterned part behind, (1 + |f₊ on it|)² on top of that.
    """
    columns = s.n + 2
    rho, onwards = patterned(s, x, u, v) if s.patterned else homogeneous(s, u, v)
    system = _closed(matrix(x, 0, s.n, columns, 2, s.n), rho, not s.patterned)
    inverse = unit(s.n)
    eliminate(system, inverse)
    down = product(inverse, matrix(x, 0, s.n, columns, 0, 2))
    found = (1.0 + norm(inverse)) * (1.0 + norm(product(rho, down)))
    return found * (1.0 + norm(onwards)) ** 2 if s.patterned else found
