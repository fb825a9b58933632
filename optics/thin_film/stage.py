"""Reflection, transmission, absorption and radiation pressure of plane films, all angles and wavelengths at once.

What is compiled is in `optics.waves.plane_stack`. `stack` takes arrays; `solve` and `pressure` a cell. The table of a
film with few fringes is sampled; any other holds the stack, which look-ups then solve (`optics.table.films`): exact,
whatever its thickness, and no resonance is missed.

    python -m optics.thin_film --cell workflow/designs/si43.yaml --out table.h5
    python -m pytest -s -k thousand_angles tests/hard/test_thin_film.py      (speed beside the package tmm)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beamrider.arrays import Complexes, Floats, Integers
from beamrider.io.arguments import table_arguments
from beamrider.io.files import InputError, Stopwatch, versions
from optics.cells.schema import ThinFilm, read_cell
from optics.refinement.directions import refine
from optics.table.films import Film
from optics.table.pressure_table import PressureTable
from optics.table.promise import finish, promised
from optics.thin_film.fringes import carries_waves, fringes
from optics.waves import plane_stack as transfer
from optics.waves.incidence import check_range

#: What tables are made for where nothing else is asked for: error of q, largest sine of the angle of incidence.
TOLERANCE, U_MAX = 1e-6, 0.999
P_SHARE = {"s": 0.0, "p": 1.0, "mean": 0.5}
# A film is sampled from this many nodes on: a resonance as wide as half their distance cannot fall between them.
_NODES = 33
# Errors between the places where `refine` looks are at most so much larger (by 0.08 in 150 random films).
_BETWEEN = 1.25


@dataclass(frozen=True)
class FilmResponse:
    """Reflectance, transmittance and absorptance (...) over directions and whatever else varies.

    Absorptance is summed from what each layer dissipates: its digits are its own, not what 1 − R − T leaves.
    """

    reflectance: Floats
    transmittance: Floats
    absorptance: Floats

    @property
    def imbalance(self) -> Floats:
        """R + T + A − 1 (...): rounding, as the three are computed apart."""
        return self.reflectance + self.transmittance + self.absorptance - 1.0


def _rows(leading: tuple[int, ...], shape: tuple[int, ...]) -> Integers:
    """For every place of `shape`, flat (n,), the row of an array whose axes but the last are `leading`, broadcast."""
    rows = np.arange(math.prod(leading)).reshape(leading)
    return np.ascontiguousarray(np.broadcast_to(rows, shape).ravel())


def _respond(index: Complexes, depth: Floats, coherent: Integers, s: Floats, share: Floats) -> Floats:
    """R, T, A (3, ...) of stacks of media (..., l + 2), depths k₀d (..., l), broadcast with s and share (...)."""
    shape = np.broadcast_shapes(index.shape[:-1], depth.shape[:-1], s.shape, share.shape)
    out = np.empty((3, math.prod(shape)))
    transfer.respond_many(
        np.ascontiguousarray(index).reshape(-1, index.shape[-1]),
        _rows(index.shape[:-1], shape),
        np.ascontiguousarray(depth).reshape(-1, depth.shape[-1]),
        _rows(depth.shape[:-1], shape),
        np.ascontiguousarray(coherent),
        np.ascontiguousarray(np.broadcast_to(s, shape)).ravel(),
        np.ascontiguousarray(np.broadcast_to(share, shape)).ravel(),
        out,
    )
    return out.reshape(3, *shape)


def _reflect(index: Complexes, depth: Floats, s: Floats) -> Complexes:
    """Amplitudes r_s, r_p (2, ...), as `_respond`."""
    shape = np.broadcast_shapes(index.shape[:-1], depth.shape[:-1], s.shape)
    out = np.empty((2, math.prod(shape)), complex)
    transfer.reflect_many(
        np.ascontiguousarray(index).reshape(-1, index.shape[-1]),
        _rows(index.shape[:-1], shape),
        np.ascontiguousarray(depth).reshape(-1, depth.shape[-1]),
        _rows(depth.shape[:-1], shape),
        np.ascontiguousarray(np.broadcast_to(s, shape)).ravel(),
        out,
    )
    return out.reshape(2, *shape)


def _check(index: Complexes, thickness: Floats, wavelength: Floats, s: Floats) -> None:
    """ValueError, with what is allowed, for stacks or light that don't exist."""
    if index.shape[-1] != thickness.shape[-1] + 2:
        raise ValueError(f"{index.shape[-1]} indices, {thickness.shape[-1]} thicknesses: must be two more indices")
    if not (np.all(index.real > 0) and np.all(index.imag >= 0)):
        raise ValueError("index: n must be above 0 and k at least 0")
    if np.any(index[..., 0].imag):
        raise ValueError("index: the half-space that the light comes from must be lossless")
    if not (np.all(thickness >= 0) and np.all(np.isfinite(thickness)) and np.all(wavelength > 0)):
        raise ValueError("thickness must be finite and at least 0, wavelength above 0")
    if not np.all(np.abs(s) <= index[..., 0].real):
        raise ValueError("s: k_t/k₀ of the light must not exceed the index of the front half-space")


def stack(
    index: ArrayLike,
    thickness: ArrayLike,
    wavelength: ArrayLike,
    s: ArrayLike,
    p_share: ArrayLike = 0.5,
    coherent: ArrayLike = True,
) -> FilmResponse:
    """Response (...) of any stack of layers; all arguments broadcast, the first two on the axes before their last.

    index (..., layers + 2): n + ik from the lossless half-space in front to the one behind, which may absorb (T is then
    the flux just inside). thickness (..., layers) in the unit of the vacuum wavelength (...). s (...): k_t/k₀, the sine
    of incidence in vacuum, |s| ≤ n in front. p_share (...): part of the power polarised p (0 s, 1 p, ½ unpolarised).
    coherent (layers,) or for all: False averages the fringes of a layer, as over thicknesses within half a wavelength.
    For a table over wavelengths and angles: index (w, 1, layers + 2), thickness (layers,), wavelength (w, 1), s (a,).
    Raises ValueError for shapes or values outside these.
    """
    index, thickness = np.asarray(index, complex), np.asarray(thickness, float)
    wavelength, s, share = (np.asarray(a, float) for a in (wavelength, s, p_share))
    _check(index, thickness, wavelength, s)
    depth = 2 * np.pi * thickness / wavelength[..., None]
    flags = np.broadcast_to(np.asarray(coherent, np.int64), thickness.shape[-1:])
    return FilmResponse(*(part[()] for part in _respond(index, depth, flags, s, share)))


def amplitudes(
    index: ArrayLike, thickness: ArrayLike, wavelength: ArrayLike, s: ArrayLike
) -> tuple[Complexes, Complexes]:
    """Complex r_s, r_p (...) of the reflected field at the front face; arguments as for `stack`, all coherent.

    Along the axes ŝ = k × n/|k × n| and p̂ = ŝ × k/|k|, those of k before and after: then r_p is the ratio of the
    magnetic fields, and r_p = −r_s at normal incidence (Born & Wolf, Principles of Optics, §1.6.2).
    """
    index, thickness = np.asarray(index, complex), np.asarray(thickness, float)
    wavelength, s = np.asarray(wavelength, float), np.asarray(s, float)
    _check(index, thickness, wavelength, s)
    r_s, r_p = _reflect(index, 2 * np.pi * thickness / wavelength[..., None], s)
    return r_s, r_p


def momentum(
    index: ArrayLike,
    thickness: ArrayLike,
    wavelength: ArrayLike,
    u: ArrayLike,
    v: ArrayLike,
    *,
    p_share: ArrayLike = 0.5,
    coherent: ArrayLike = True,
    from_back: bool = False,
) -> tuple[Floats, FilmResponse]:
    """Pressure coefficients q (..., 3) in (g, r, n) of a film tilted any way, and the response they follow from.

    Arguments as for `stack`, with the direction cosines u, v of the light (times the index it travels in). From the
    back the light runs along −n: q_n turns negative. Momentum balance as in `optics.waves.momentum` with the specular
    order alone: q_t = A k_t, q_n = w(1 + R) − w' T. What enters an absorbing half-space stays there, its power and its
    momentum: q_t = (A + T) k_t, q_n = w(1 + R).
    """
    index, thickness = np.asarray(index, complex), np.asarray(thickness, float)
    coherent = np.broadcast_to(np.asarray(coherent, bool), thickness.shape[-1:])
    if from_back:
        index, thickness, coherent = index[..., ::-1], thickness[..., ::-1], coherent[::-1]
    u, v = np.asarray(u, float), np.asarray(v, float)
    s = np.hypot(u, v)
    response = stack(index, thickness, wavelength, s, p_share, coherent)
    near, far = index[..., 0].real, index[..., -1].real
    w, w_far = (np.sqrt(np.maximum((n - s) * (n + s), 0.0)) for n in (near, far))
    a = taken(index, response)
    q_n = w * (1 + response.reflectance) - np.where(index[..., -1].imag > 0, 0.0, w_far * response.transmittance)
    return np.stack([a * u, a * v, -q_n if from_back else q_n], -1), response


def taken(index: Complexes, response: FilmResponse) -> Floats:
    """Share (...) of the light that the film absorbs, the half-space behind it included where that absorbs."""
    behind = np.where(index[..., -1].imag > 0, response.transmittance, 0.0)
    return np.asarray(response.absorptance + behind)


def _arrays(cell: ThinFilm) -> tuple[Complexes, Floats, float]:
    """Indices (layers + 2,), thicknesses (layers,) and wavelength of a cell, in nm."""
    around = cell.surroundings
    layers = (complex(layer.index.n, layer.index.k) for layer in cell.layers)
    index = np.array([around.front, *layers, complex(around.back, around.back_k)])
    return index, np.array([layer.thickness_nm for layer in cell.layers]), cell.wavelength_nm


def _coherent(cell: ThinFilm) -> NDArray[np.bool_]:
    """Which layers are coherent (layers,)."""
    return np.array([layer.coherent for layer in cell.layers])


def film(cell: ThinFilm) -> Film:
    """The cell for look-ups."""
    index, thickness, wavelength = _arrays(cell)
    return Film(
        np.asarray(index, complex),
        2 * np.pi * thickness / wavelength,
        _coherent(cell).astype(np.int64),
        P_SHARE[cell.polarisation],
    )


def solve(cell: ThinFilm, s: Floats) -> FilmResponse:
    """Response at k_t/k₀ = s (...), the sine of incidence in vacuum, for the cell's polarisation."""
    return stack(*_arrays(cell), s, P_SHARE[cell.polarisation], _coherent(cell))


def pressure(
    cell: ThinFilm, u: Floats, v: Floats | float = 0.0, *, from_back: bool = False
) -> tuple[Floats, FilmResponse]:
    """Q (..., 3) of the cell for light k/k₀ = (u, v, ·), and the response it follows from; see `momentum`."""
    return momentum(
        *_arrays(cell), u, v, p_share=P_SHARE[cell.polarisation], coherent=_coherent(cell), from_back=from_back
    )


def polarised(cell: ThinFilm, s: Floats) -> Floats | None:
    """What `PressureTable.amplitudes` holds, (6, n), at sines s (n,), whatever the cell's own polarisation.

    None where a layer is not coherent: the reflected light then has no phase.
    """
    if not _coherent(cell).all():
        return None
    arrays = _arrays(cell)
    r_s, r_p = amplitudes(*arrays, s)
    a_s, a_p = (taken(arrays[0], stack(*arrays, s, share)) for share in (0.0, 1.0))
    return np.stack([r_s.real, r_s.imag, r_p.real, r_p.imag, a_s, a_p])


def is_smooth(stack: Film, s_max: float) -> bool:
    """Is every resonance of the film over sines 0 … s_max so wide that nodes of a first grid see it."""
    s = np.linspace(0.0, s_max, _NODES)
    return carries_waves(stack, s_max) and bool(np.all(fringes(stack, s).width > s[1] / 2))


def make_table(cell: ThinFilm, s_max: float, tolerance: float) -> PressureTable:
    """Axisymmetric pressure table over sines 0 … s_max: samples that meet `tolerance`, or the stack."""
    watch, own = Stopwatch(), film(cell)

    def response(s: Floats) -> Floats:
        q, found = pressure(cell, s)
        fields = polarised(cell, s)
        values = [q, taken(own.index, found)[:, None], *([] if fields is None else [fields.T])]
        return np.concatenate(values, axis=1)

    for share in (1.0, 1.0 / _BETWEEN):
        found = refine(response, np.linspace(0.0, s_max, _NODES), share * tolerance, 1e-5)
        error = _BETWEEN * found.error[:, :4].max(axis=1)
        if error.max() <= tolerance:
            break
    sampled = is_smooth(own, s_max) and not found.missed_because and bool(error.max() <= tolerance)
    s = found.nodes
    values, light = response(s).T[..., None], solve(cell, s)
    rounding = fringes(own, s).rounding
    attrs = {
        "name": cell.name,
        "solver": "thin_film",
        "cell": cell.model_dump(),
        "wavelength_m": cell.wavelength_nm * 1e-9,
        "settings": {"s_max": s_max, "tolerance": tolerance},
        "cutoffs": [],
        "between_nodes": "interpolated" if sampled else "the stack solved",
        "energy_imbalance": float(np.abs(light.imbalance).max()),
        "cpu_seconds": watch.cpu_seconds,
        "versions": versions("numpy", "scipy"),
    }
    # Closed form: what error there is comes from interpolation and rounding.
    error = rounding + (error if sampled else 0.0)
    table = PressureTable(
        s,
        np.zeros(1),
        values[:3],
        values[3],
        error[:, None],
        axisymmetric=True,
        attrs=attrs,
        amplitudes=values[4:] if len(values) > 4 else None,
        film=None if sampled else own,
    )
    return promised(table, tolerance, ["rounding"])


def main() -> None:
    """Command line: see the module docstring."""
    arguments = table_arguments("optics.thin_film", "Pressure table of a plane film", TOLERANCE, U_MAX, v_max=False)
    cell = read_cell(arguments.cell, arguments.wavelength_nm)
    if not isinstance(cell, ThinFilm):
        raise InputError(f"{arguments.cell}: kind = {cell.kind!r}: must be thin_film; use optics.modal for gratings")
    check_range(cell.surroundings.front, arguments.u_max)
    finish(make_table(cell, arguments.u_max, arguments.tolerance), arguments.out, arguments.accept_missed)
