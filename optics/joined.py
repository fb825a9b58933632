"""Light between the parts of a grating on thick layers: scattering matrices joined at one direction; compiled.

With f± as in `optics.parts`, the front part F, and ρ what the thick layers and all behind them return, f₋ = ρ f₊,

    f₊ = F_light a + F_back f₋  →  (1 − F_back ρ) f₊ = F_light a.

ρ of homogeneous layers is known for each order, s and p apart (`optics.lamellar.tail`). A patterned part B behind them,
seen through layers that reflect r, send on t and reflect r' from behind, returns ρ = r + t B (1 − r' B)⁻¹ t.

Powers are Hermitian forms of the two polarisations of the light, given for its four Stokes components as in
`optics.lamellar.flux`. What is absorbed is summed from what each part takes: it keeps its digits where it is small.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from optics.small_matrices import Matrix, eliminate, norm, product, unit

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

# As in `optics.lamellar`: a wave at its cut-off is moved off it by this; one that decays so little counts as running.
_CUTOFF, _REAL = 1e-8, 1e-6
QUANTITIES = 16


class Setup(NamedTuple):
    """The layers of a grating, in solver units.

    pitch: λ/d. front: index in front. media (m,), depth (m − 1,): index and k₀d of the thick layers and what lies
    behind them, the half-space last; with a patterned part behind them of the thick layers alone, and the half-space.
    first, n: the first order that is followed in the thick layers, and how many components all of them have; likewise
    for those in front of the cell and behind it. lossy_*: do the parts hold what they take. axis: 0 for light along g,
    1 along r.
    """

    pitch: float
    front: float
    media: Matrix
    depth: Floats
    first: int
    n: int
    first_out: int
    n_out: int
    first_sent: int
    n_sent: int
    patterned: bool
    lossy_front: bool
    lossy_back: bool
    axis: int


@numba.njit(cache=True, error_model="numpy")
def setup(numbers: Floats, flags: Indices) -> Setup:
    """From numbers (pitch, front, index as Re and Im, depth) and flags: how many media, then as in `Setup`."""
    m = flags[0]
    return Setup(
        numbers[0], numbers[1], numbers[2 : 2 + 2 * m].view(np.complex128), numbers[2 + 2 * m : 1 + 3 * m], flags[1],
        flags[2], flags[3], flags[4], flags[5], flags[6], flags[7] != 0, flags[8] != 0, flags[9] != 0, flags[10],
    )


# --- one order in the layers ------------------------------------------------------------------------------------------


@numba.njit(cache=True, error_model="numpy")
def wave_number(index: complex, k_t: float) -> complex:
    """k_z/k₀, with the sign of a wave that decays or else runs along +z; kept off zero."""
    root = np.sqrt((index - k_t) * (index + k_t))
    size = abs(root)
    if size < _CUTOFF:
        return complex(_CUTOFF * np.sqrt(0.5), _CUTOFF * np.sqrt(0.5))
    direction = root.real if abs(root.imag) <= _REAL * size else root.imag
    return -root if direction < 0.0 else root


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _admittance(index: complex, k_z: complex, p: bool) -> complex:
    return index * index / k_z if p else k_z


@numba.njit(cache=True, error_model="numpy")
def _returned(s: Setup, k_t: float, p: bool) -> tuple[complex, complex]:
    """ρ of all layers and the half-space, and ẑ × E in that per f₊: as in `optics.lamellar.tail`."""
    last = s.media.size - 1
    y = _admittance(s.media[last], wave_number(s.media[last], k_t), p)
    rho, through = (1 - y) / (1 + y), 1 / (1 + y)
    for i in range(last - 1, -1, -1):
        k_z = wave_number(s.media[i], k_t)
        y, x = _admittance(s.media[i], k_z, p), np.exp(1j * k_z * s.depth[i])
        bounce = (rho * (1 + y) - (1 - y)) * x / ((1 + y) - rho * (1 - y))
        top = (1 + y) + (1 - y) * x * bounce
        rho, through = ((1 - y) + (1 + y) * x * bounce) / top, through * ((1 + y) * x + (1 - y) * bounce) / top
    return rho, through


@numba.njit(cache=True, error_model="numpy")
def _crossed(s: Setup, k_t: float, p: bool) -> tuple[complex, complex, complex]:
    """What the layers alone make of f: reflected from the front, sent on, reflected from behind."""
    r, t, back = 0j, 1 + 0j, 0j
    for i in range(s.media.size - 1):
        k_z = wave_number(s.media[i], k_t)
        y, x = _admittance(s.media[i], k_z, p), np.exp(1j * k_z * s.depth[i])
        whole = 1 / ((1 + y) * (1 + y) - (1 - y) * (1 - y) * x * x)
        r_1, t_1 = (1 - y * y) * (1 - x * x) * whole, 4 * y * x * whole
        d = 1 / (1 - back * r_1)
        r, back, t = r + t * t * r_1 * d, r_1 + t_1 * t_1 * back * d, t * t_1 * d
    return r, t, back


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _turn(u_m: float, v: float) -> tuple[float, float, float]:
    """k_t, and its direction: f of s waves lies along it, that of p waves across."""
    k_t = np.sqrt(u_m * u_m + v * v)
    return (k_t, u_m / k_t, v / k_t) if k_t > 0.0 else (0.0, 1.0, 0.0)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _put(out: Matrix, m: int, a: float, b: float, of_s: complex, of_p: complex) -> None:
    """The block of one order, from what it is for s and p."""
    c = out.shape[0] // 2
    cross = a * b * (of_s - of_p)
    out[m, m], out[m, c + m] = of_s * a * a + of_p * b * b, cross
    out[c + m, m], out[c + m, c + m] = cross, of_s * b * b + of_p * a * a


# --- all orders -------------------------------------------------------------------------------------------------------


@numba.njit(cache=True, error_model="numpy")
def matrix(x: Floats, at: int, rows: int, columns: int, first: int, count: int) -> Matrix:
    """Columns first … first + count of a matrix held as Re and Im, row by row, from x[at] on."""
    out = np.empty((rows, count), np.complex128)
    for i in range(rows):
        for j in range(count):
            k = at + 2 * (i * columns + first + j)
            out[i, j] = complex(x[k], x[k + 1])
    return out


@numba.njit(cache=True, error_model="numpy")
def _back_at(s: Setup) -> int:
    """Where the part behind begins."""
    front = 2 * (s.n + s.n_out) * (s.n + 2)
    return front + (s.n + 2) * (s.n + 2) if s.lossy_front else front


@numba.njit(cache=True, error_model="numpy")
def _homogeneous(s: Setup, u: float, v: float) -> tuple[Matrix, Matrix]:
    """ρ (n, n) of homogeneous layers and a half-space, and ẑ × E in that (n, n), for all orders followed."""
    c = s.n // 2
    rho, through = np.zeros((s.n, s.n), np.complex128), np.zeros((s.n, s.n), np.complex128)
    for m in range(c):
        k_t, a, b = _turn(u + (s.first + m) * s.pitch, v)
        r_s, t_s = _returned(s, k_t, False)
        r_p, t_p = _returned(s, k_t, True)
        _put(rho, m, a, b, r_s, r_p)
        _put(through, m, a, b, t_s, t_p)
    return rho, through


@numba.njit(cache=True, error_model="numpy")
def _patterned(s: Setup, x: Floats, u: float, v: float) -> tuple[Matrix, Matrix]:
    """ρ (n, n) of the layers with a patterned part behind them, and f₊ (n, n) that falls on that, per f₊."""
    r, t, back = unit(s.n), unit(s.n), unit(s.n)
    for m in range(s.n // 2):
        k_t, a, b = _turn(u + (s.first + m) * s.pitch, v)
        of_s, of_p = _crossed(s, k_t, False), _crossed(s, k_t, True)
        _put(r, m, a, b, of_s[0], of_p[0])
        _put(t, m, a, b, of_s[1], of_p[1])
        _put(back, m, a, b, of_s[2], of_p[2])
    part = matrix(x, _back_at(s), s.n, s.n, 0, s.n)
    falling = t.copy()
    eliminate(unit(s.n) - product(back, part), falling)
    return r + product(t, product(part, falling)), falling


@numba.njit(cache=True, error_model="numpy")
def _closed(up: Matrix, rho: Matrix, blocks: bool) -> Matrix:
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
def _squares(waves: Matrix, i: int) -> tuple[float, float, complex]:
    """|a|², |b|² and a b* of row i (., 2)."""
    a, b = waves[i, 0], waves[i, 1]
    return a.real * a.real + a.imag * a.imag, b.real * b.real + b.imag * b.imag, a * b.conjugate()


@numba.njit(cache=True, error_model="numpy")
def _take(out: Floats, waves: Matrix, i: int, weight: float, u_m: float, w: float, absorbed: float) -> None:
    """Add the force of a wave that leaves with u_m and w, and `absorbed` times its power to what is absorbed."""
    aa, bb, ab = _squares(waves, i)
    for k, power in enumerate(_stokes(weight * aa, weight * bb, weight * ab)):
        out[4 * k] -= power * u_m
        out[4 * k + 2] += power * w
        out[4 * k + 3] += power * absorbed


@numba.njit(cache=True, error_model="numpy")
def _leaving(out: Floats, waves: Matrix, s: Setup, first: int, index: complex, u: float, v: float, sign: float) -> None:
    """Add the force of outgoing f (2 count, 2) in a lossless half-space, sign −1 behind the cell."""
    c, turned = waves.shape[0] // 2, np.empty((2, 2), np.complex128)
    for m in range(c):
        u_m = u + (first + m) * s.pitch
        k_t, a, b = _turn(u_m, v)
        if k_t >= index.real:
            continue
        for i in range(2):
            turned[0, i] = a * waves[m, i] + b * waves[c + m, i]
            turned[1, i] = a * waves[c + m, i] - b * waves[m, i]
        w = wave_number(index, k_t).real
        for p in range(2):
            y = _admittance(index, complex(w, 0.0), p == 1).real
            _take(out, turned, p, y / ((1 + y) * (1 + y)), u_m, sign * w, 0.0)


@numba.njit(cache=True, error_model="numpy")
def _sent(out: Floats, fields: Matrix, s: Setup, u: float, v: float) -> None:
    """Add the force of ẑ × E (n, 2) in the half-space behind homogeneous layers; what leaves is not absorbed."""
    index, c, turned = s.media[s.media.size - 1], s.n // 2, np.empty((2, 2), np.complex128)
    for m in range(c if index.imag == 0.0 else 0):
        u_m = u + (s.first + m) * s.pitch
        k_t, a, b = _turn(u_m, v)
        if k_t >= index.real:
            continue
        for i in range(2):
            turned[0, i] = a * fields[m, i] + b * fields[c + m, i]
            turned[1, i] = a * fields[c + m, i] - b * fields[m, i]
        w = wave_number(index, k_t).real
        for p in range(2):
            _take(out, turned, p, _admittance(index, complex(w, 0.0), p == 1).real, u_m, -w, -1.0)


@numba.njit(cache=True, error_model="numpy")
def _flow(out: Floats, down: Matrix, up: Matrix, sign: float) -> None:
    """Add the power (|f₊|² − |f₋|²)/4 that flows into what lies behind to what is absorbed, or take it away."""
    for i in range(down.shape[0]):
        _take(out, down, i, 0.25, 0.0, 0.0, sign)
        _take(out, up, i, 0.25, 0.0, 0.0, -sign)


@numba.njit(cache=True, error_model="numpy")
def _lost(out: Floats, x: Floats, at: int, waves: Matrix) -> None:
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
def _with_light(up: Matrix) -> Matrix:
    """Light of both polarisations, each of 1, above f₋: what falls on the front part."""
    out = np.zeros((2 + up.shape[0], 2), np.complex128)
    out[0, 0], out[1, 1] = 1.0, 1.0
    out[2:] = up
    return out


@numba.njit(cache=True, error_model="numpy")
def respond(s: Setup, x: Floats, u: float, v: float, out: Floats) -> None:
    """Write q_g, q_r, q_n and the absorptance for each Stokes component into out (16,), the parts held in x."""
    out[:QUANTITIES] = 0.0
    part, columns = _back_at(s), s.n + 2
    rho, onwards = _patterned(s, x, u, v) if s.patterned else _homogeneous(s, u, v)
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

    E along g, projected, has the components −ab and −c along the two basis vectors (`optics.incidence`), in units of
    √(1 − a²) √(1 − b²), for light of the unit vector (a, b, c).
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

    With a patterned part behind, (1 + |f₊ on it|)² on top of that.
    """
    columns = s.n + 2
    rho, onwards = _patterned(s, x, u, v) if s.patterned else _homogeneous(s, u, v)
    system = _closed(matrix(x, 0, s.n, columns, 2, s.n), rho, not s.patterned)
    inverse = unit(s.n)
    eliminate(system, inverse)
    down = product(inverse, matrix(x, 0, s.n, columns, 0, 2))
    found = (1.0 + norm(inverse)) * (1.0 + norm(product(rho, down)))
    return found * (1.0 + norm(onwards)) ** 2 if s.patterned else found
