"""What thick layers, and all behind them, return of the light at one direction, for all orders followed; compiled.

f± as in `optics.modal.parts`: ρ is f₋ per f₊. Of homogeneous layers it is known for each order, s and p apart
(`optics.modal.lamellar.tail`). A patterned part B behind them, seen through layers that reflect r, send on t and
reflect r'
from behind, returns ρ = r + t B (1 − r' B)⁻¹ t.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Complexes, Floats, Integers
from optics.waves.small_matrices import eliminate, product, unit

# As in `optics.modal.lamellar`: a wave at its cut-off is moved off it by this; one that decays so little counts as
# running.
_CUTOFF, _REAL = 1e-8, 1e-6


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
    media: Complexes
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
def setup(numbers: Floats, flags: Integers) -> Setup:
    """From numbers (n,): pitch, front, index as Re and Im, depth; and flags (m,): how many media, then as `Setup`."""
    m = flags[0]
    return Setup(
        numbers[0],
        numbers[1],
        numbers[2 : 2 + 2 * m].view(np.complex128),
        numbers[2 + 2 * m : 1 + 3 * m],
        flags[1],
        flags[2],
        flags[3],
        flags[4],
        flags[5],
        flags[6],
        flags[7] != 0,
        flags[8] != 0,
        flags[9] != 0,
        flags[10],
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
def admittance(index: complex, k_z: complex, p: bool) -> complex:
    """Of s or p waves, h per ẑ × E."""
    return index * index / k_z if p else k_z


@numba.njit(cache=True, error_model="numpy")
def _returned(s: Setup, k_t: float, p: bool) -> tuple[complex, complex]:
    """ρ of all layers and the half-space, and ẑ × E in that per f₊: as in `optics.modal.lamellar.tail`."""
    last = s.media.size - 1
    y = admittance(s.media[last], wave_number(s.media[last], k_t), p)
    rho, through = (1 - y) / (1 + y), 1 / (1 + y)
    for i in range(last - 1, -1, -1):
        k_z = wave_number(s.media[i], k_t)
        y, x = admittance(s.media[i], k_z, p), np.exp(1j * k_z * s.depth[i])
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
        y, x = admittance(s.media[i], k_z, p), np.exp(1j * k_z * s.depth[i])
        whole = 1 / ((1 + y) * (1 + y) - (1 - y) * (1 - y) * x * x)
        r_1, t_1 = (1 - y * y) * (1 - x * x) * whole, 4 * y * x * whole
        d = 1 / (1 - back * r_1)
        r, back, t = r + t * t * r_1 * d, r_1 + t_1 * t_1 * back * d, t * t_1 * d
    return r, t, back


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def turn(u_m: float, v: float) -> tuple[float, float, float]:
    """k_t, and its direction: f of s waves lies along it, that of p waves across."""
    k_t = np.sqrt(u_m * u_m + v * v)
    return (k_t, u_m / k_t, v / k_t) if k_t > 0.0 else (0.0, 1.0, 0.0)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _put(out: Complexes, m: int, a: float, b: float, of_s: complex, of_p: complex) -> None:
    """The block of one order, from what it is for s and p."""
    c = out.shape[0] // 2
    cross = a * b * (of_s - of_p)
    out[m, m], out[m, c + m] = of_s * a * a + of_p * b * b, cross
    out[c + m, m], out[c + m, c + m] = cross, of_s * b * b + of_p * a * a


# --- all orders -------------------------------------------------------------------------------------------------------


@numba.njit(cache=True, error_model="numpy")
def matrix(x: Floats, at: int, rows: int, columns: int, first: int, count: int) -> Complexes:
    """Columns first … first + count, (rows, count), of a matrix held as Re and Im, row by row, from x[at] on."""
    out = np.empty((rows, count), np.complex128)
    for i in range(rows):
        for j in range(count):
            k = at + 2 * (i * columns + first + j)
            out[i, j] = complex(x[k], x[k + 1])
    return out


@numba.njit(cache=True, error_model="numpy")
def back_at(s: Setup) -> int:
    """Where the part behind begins."""
    front = 2 * (s.n + s.n_out) * (s.n + 2)
    return front + (s.n + 2) * (s.n + 2) if s.lossy_front else front


@numba.njit(cache=True, error_model="numpy")
def homogeneous(s: Setup, u: float, v: float) -> tuple[Complexes, Complexes]:
    """ρ (n, n) of homogeneous layers and a half-space, and ẑ × E in that (n, n), for all orders followed."""
    c = s.n // 2
    rho, through = np.zeros((s.n, s.n), np.complex128), np.zeros((s.n, s.n), np.complex128)
    for m in range(c):
        k_t, a, b = turn(u + (s.first + m) * s.pitch, v)
        r_s, t_s = _returned(s, k_t, False)
        r_p, t_p = _returned(s, k_t, True)
        _put(rho, m, a, b, r_s, r_p)
        _put(through, m, a, b, t_s, t_p)
    return rho, through


@numba.njit(cache=True, error_model="numpy")
def patterned(s: Setup, x: Floats, u: float, v: float) -> tuple[Complexes, Complexes]:
    """ρ (n, n) of the layers with a patterned part behind them, and f₊ (n, n) that falls on that, per f₊."""
    r, t, back = unit(s.n), unit(s.n), unit(s.n)
    for m in range(s.n // 2):
        k_t, a, b = turn(u + (s.first + m) * s.pitch, v)
        of_s, of_p = _crossed(s, k_t, False), _crossed(s, k_t, True)
        _put(r, m, a, b, of_s[0], of_p[0])
        _put(t, m, a, b, of_s[1], of_p[1])
        _put(back, m, a, b, of_s[2], of_p[2])
    part = matrix(x, back_at(s), s.n, s.n, 0, s.n)
    falling = t.copy()
    eliminate(unit(s.n) - product(back, part), falling)
    return r + product(t, product(part, falling)), falling
