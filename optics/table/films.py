"""Films in pressure tables: the stack itself, and its closed form in place of interpolation; compiled.

Fringes of a thick film are too many to be sampled, and resonances of a cavity may lie between any samples. The table of
such a film holds the stack; a look-up then carries the light through it (`optics.waves.plane_stack`), whatever its
thickness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from beamrider.arrays import Floats, Integers
from optics.table.locate import TableArrays, clamp
from optics.waves import plane_stack as transfer

Complexes = transfer.Complexes

# What a look-up gives: interpolated values; q and absorptance; r_s and r_p; absorptance of s and of p light.
SAMPLED, PRESSURE, FIELDS, LOSSES = range(4)
# Where the header of the places says so, where the numbers and the flags of the stack begin, how many media there are;
# and where that of the numbers says how far the table reaches.
KIND, NUMBERS, FLAGS, MEDIA = 15, 14, 13, 12
_FIRST, _LAST = 2, 3


@dataclass(frozen=True)
class Film:
    """A stack: index (m,) from the half-space in front to the one behind, depth k₀d (m − 2,) of the layers.

    coherent (m − 2,): 1 or, where fringes are averaged, 0. share: which part of the light is polarised p.
    """

    index: Complexes
    depth: Floats
    coherent: Integers
    share: float

    def as_rows(self) -> Floats:
        """n, k, depth and whether coherent (m, 4): how a file holds it; half-spaces have no depth."""
        around = np.zeros((self.index.size, 2))
        around[1:-1] = np.column_stack([self.depth, self.coherent])
        return np.column_stack([self.index.real, self.index.imag, around])


def from_rows(rows: Floats, share: float) -> Film:
    """The film of the rows (n, 4) of `Film.as_rows`."""
    coherent = (rows[1:-1, 3] != 0.0).astype(np.int64)
    return Film(rows[:, 0] + 1j * rows[:, 1], rows[1:-1, 2].copy(), coherent, share)


def with_film(t: TableArrays, film: Film, kind: int) -> TableArrays:
    """The arrays of a table in which a look-up goes by the stack."""
    places = np.append(t.places, film.coherent)
    places[[KIND, NUMBERS, FLAGS, MEDIA]] = kind, t.numbers.size, t.places.size, film.index.size
    index = np.ascontiguousarray(film.index, complex).view(float)
    return t._replace(numbers=np.concatenate([t.numbers, index, film.depth, [film.share]]), places=places)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def is_film(t: TableArrays) -> bool:
    """Does a look-up go by the stack."""
    return bool(t.places[KIND] != SAMPLED)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _film(t: TableArrays) -> tuple[Complexes, Floats, Integers, float]:
    """The stack in a table: index, depth, coherent, share."""
    at, flags, m = t.places[NUMBERS], t.places[FLAGS], t.places[MEDIA]
    index, depth = t.numbers[at : at + 2 * m].view(np.complex128), t.numbers[at + 2 * m : at + 3 * m - 2]
    return index, depth, t.places[flags : flags + m - 2], t.numbers[at + 3 * m - 2]


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _response(
    kind: int, index: Complexes, depth: Floats, coherent: Integers, share: float, s: float
) -> tuple[float, float, float, float]:
    """Four numbers of one direction, by kind."""
    if kind == PRESSURE:
        along, across, loss = transfer.pressure(index, depth, coherent, s, share)
        return along, 0.0, across, loss
    if kind == FIELDS:
        r_s, r_p = transfer.reflected(index, depth, s)
        return r_s.real, r_s.imag, r_p.real, r_p.imag
    a_s = transfer.pressure(index, depth, coherent, s, 0.0)[2]
    return a_s, transfer.pressure(index, depth, coherent, s, 1.0)[2], 0.0, 0.0


@numba.njit(cache=True, error_model="numpy")
def look_up(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """As `optics.table.lookup.lookup`, by the stack."""
    index, depth, coherent, share = _film(t)
    s = np.sqrt(u * u + v * v) if t.axisymmetric else u
    held = clamp(s, t.numbers[_FIRST], t.numbers[_LAST])
    q0, q1, q2, q3 = _response(t.places[KIND], index, depth, coherent, share, held)
    if t.axisymmetric:
        q0, q1 = (q0 * u / s, q0 * v / s) if s > 0.0 else (0.0, 0.0)
    return q0, q1, q2, q3, bool(held == s)


@numba.njit(cache=True, error_model="numpy")
def look_up_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> tuple[int, int]:
    """As `optics.table.lookup.lookup_many`, by the stack."""
    index, depth, coherent, share = _film(t)
    kind, low, high, count, first = t.places[KIND], t.numbers[_FIRST], t.numbers[_LAST], 0, -1
    for i in range(u.size):
        s = np.sqrt(u[i] * u[i] + v[i] * v[i]) if t.axisymmetric else u[i]
        held = clamp(s, low, high)
        q0, q1, q2, q3 = _response(kind, index, depth, coherent, share, held)
        if t.axisymmetric:
            q0, q1 = (q0 * u[i] / s, q0 * v[i] / s) if s > 0.0 else (0.0, 0.0)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = q0, q1, q2, q3
        if held != s:
            count += 1
            first = i if first < 0 else first
    return count, first
