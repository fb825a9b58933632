"""Reflection, transmission, absorption and radiation pressure of plane films, all angles and wavelengths at once.

The two tangential fields are carried from the back to the front (Macleod, Thin-Film Optical Filters, ch. 2), scaled by
each layer's decay, so nothing overflows, whatever the thickness. `stack` takes arrays; `solve` and `pressure` a cell.

    python -m optics.thin_film --cell workflow/designs/si43.yaml --out table.h5
    python -m pytest -s -k thousand_angles tests/hard/test_thin_film.py      (speed beside the package tmm)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import guvectorize, njit
from numpy.typing import ArrayLike

from optics.cells import ThinFilm, read_cell
from optics.command import check_range, table_arguments
from optics.files import InputError, Stopwatch, run_stage, versions
from optics.incidence import Complexes, Floats
from optics.sampling import refine
from optics.table import PressureTable

P_SHARE = {"s": 0.0, "p": 1.0, "mean": 0.5}
# At one interface: fields f and g, flux sent on and loss so far, in one arbitrary scale. s: f = E across the plane of
# incidence, g ∝ H; p: f = H across it, g ∝ E along the layer. Flux = Re(f g*); a wave along +n has g = y f. H rather
# than E for p keeps y = k_z/ε finite where k_z = 0.
Light = tuple[complex, complex, float, float]
Crossing = tuple[complex, float, float, complex]  # see _crossing
RESCALE_EVERY = 8  # layers: even contrasts of 1e9 a layer stay far from overflow


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


@njit(cache=True)
def _square(z: complex) -> float:
    """|z|², without the root of abs."""
    return z.real * z.real + z.imag * z.imag


@njit(cache=True)
def _normal(n: complex, s: float) -> complex:
    """k_z/k₀ = √((n − s)(n + s)) with both parts ≥ 0; the product keeps digits as s → n.

    Where k_z = 0 it is 1e-100 instead: the limit, as everything that follows is smooth there.
    """
    square = (n - s) * (n + s)
    if n.imag == 0:
        root = max(math.sqrt(abs(square.real)), 1e-100)
        return complex(0.0, root) if square.real < 0 else complex(root, 0.0)
    larger = max(math.sqrt((math.sqrt(_square(square)) + abs(square.real)) / 2), 1e-100)
    smaller = square.imag / (2 * larger)
    return complex(smaller, larger) if square.real < 0 else complex(larger, smaller)


@njit(cache=True)
def _face(n: complex, s: float, p: bool) -> complex:
    """Admittance y of a half-space: g = y f of a wave along +n, for s or p light."""
    return _normal(n, s) / (n * n) if p else _normal(n, s)


@njit(cache=True)
def _crossing(k_z: complex, depth: float) -> Crossing:
    """Of φ = k_z d: h = (1 − exp(2iφ))/2, |exp(iφ)|², and two means over the layer that give its loss.

    Those are of the decay, and of the two waves' interference (complex). 1e-300 stands for 0: sin φ/φ has its limit.
    """
    real, imag = max(k_z.real * depth, 1e-300), 2 * max(k_z.imag * depth, 1e-300)
    sine, cosine = math.sin(real), math.cos(real)
    if k_z.imag == 0:
        return complex(sine * sine, -sine * cosine), 1.0, 1.0, 0j
    if imag < 0.7:  # each of the two from the function that keeps its digits
        drop = -math.expm1(-imag)
        decay = 1 - drop
    else:
        decay = math.exp(-imag)
        drop = 1 - decay
    half = complex(sine * sine + drop * (0.5 - sine * sine), -decay * sine * cosine)
    return half, decay, drop / imag, decay * sine / real * complex(cosine, -sine)


@njit(cache=True)
def _through(light: Light, y: complex, z: complex, loss_of_g: float, loss_of_f: float, crossing: Crossing) -> Light:
    """The light at the front of a layer with admittance y = 1/z, from the light at its back; scaled by |exp(iφ)|.

    cos φ and −i sin φ, scaled, are 1 − h and h: a layer of no depth changes no bit. The layer loses its mean of
    loss_of_g |g|² + loss_of_f |f|²; f = a exp(iφ) + b exp(−iφ) makes that two decays and their interference.
    """
    f, g, flux, loss = light
    half, decay, fading, mixing = crossing
    h = z * g
    loss *= decay
    if loss_of_f > 0 or loss_of_g > 0:
        plus, minus = f + h, f - h
        apart = fading * (_square(plus) + decay * _square(minus)) / 4
        mixed = (mixing * plus * minus.conjugate()).real / 2
        loss += loss_of_f * (apart + mixed) + loss_of_g * _square(y) * (apart - mixed)
    return f + half * (h - f), g + half * (y * f - g), decay * flux, loss


@njit(cache=True)
def _through_both(
    of_s: Light, of_p: Light, n: complex, depth: float, s: float, is_s: bool, is_p: bool
) -> tuple[Light, Light]:
    """`_through` a layer of depth k₀d for s and p light. Loss is Im ε ∫ |E|²; E of p light is g along, s f/ε across."""
    k_z, permittivity = _normal(n, s), n * n
    inverse = k_z.conjugate() * (1 / _square(k_z))
    crossing = _crossing(k_z, depth)
    loss = permittivity.imag * depth
    if is_s:
        of_s = _through(of_s, k_z, inverse, 0.0, loss, crossing)
    if is_p:
        size = 1 / _square(permittivity)
        y, across = k_z * permittivity.conjugate() * size, loss * s * s * size
        of_p = _through(of_p, y, inverse * permittivity, loss, across, crossing)
    return of_s, of_p


@njit(cache=True)
def _rescaled(light: Light) -> Light:
    """The same light with fields of about 1, so that a long stack neither overflows nor underflows before it must."""
    f, g, flux, loss = light
    scale = 1 / (abs(f.real) + abs(f.imag) + abs(g.real) + abs(g.imag))
    return f * scale, g * scale, flux * scale * scale, loss * scale * scale


@njit(cache=True)
def _outside(light: Light, y: float) -> tuple[float, float, float]:
    """R, T, A from the light at the front face and the admittance in front."""
    f, g, flux, loss = _rescaled(light)
    sent = _square(y * f + g)
    return _square(y * f - g) / sent, 4 * y * flux / sent, 4 * y * loss / sent


@njit(cache=True)
def _to_front(index: Complexes, depth: Floats, s: float, is_s: bool, is_p: bool) -> tuple[Light, Light]:
    """Light of s and of p at the front face of a stack (media, depths k₀d)."""
    back_s, back_p = _face(index[-1], s, False), _face(index[-1], s, True)
    of_s, of_p = (1 + 0j, back_s, back_s.real, 0.0), (1 + 0j, back_p, back_p.real, 0.0)
    for i in range(depth.size, 0, -1):
        of_s, of_p = _through_both(of_s, of_p, index[i], depth[i - 1], s, is_s, is_p)
        if i % RESCALE_EVERY == 0:
            of_s, of_p = _rescaled(of_s), _rescaled(of_p)
    return of_s, of_p


@guvectorize(["void(c16[:], f8[:], f8, c16[:], c16[:])"], "(m),(l),()->(),()", nopython=True, cache=True)
def _reflect(index, depth, s, r_s, r_p):  # type: ignore[no-untyped-def]
    """Amplitudes r of one stack for one direction; broadcasts as a NumPy function."""
    of_s, of_p = _to_front(index, depth, s, True, True)
    y_s, y_p = _face(index[0], s, False), _face(index[0], s, True)
    r_s[0] = (y_s * of_s[0] - of_s[1]) / (y_s * of_s[0] + of_s[1])
    r_p[0] = (y_p * of_p[0] - of_p[1]) / (y_p * of_p[0] + of_p[1])


@guvectorize(
    ["void(c16[:], f8[:], f8, f8, f8[:], f8[:], f8[:])"], "(m),(l),(),()->(),(),()", nopython=True, cache=True
)
def _respond(index, depth, s, share, reflectance, transmittance, absorptance):  # type: ignore[no-untyped-def]
    """R, T, A of one stack (media, depths k₀d) for one direction; broadcasts as a NumPy function."""
    of_s, of_p = _to_front(index, depth, s, share < 1, share > 0)
    r_s, t_s, a_s = _outside(of_s, _face(index[0], s, False).real)
    r_p, t_p, a_p = _outside(of_p, _face(index[0], s, True).real)
    reflectance[0] = (1 - share) * r_s + share * r_p
    transmittance[0] = (1 - share) * t_s + share * t_p
    absorptance[0] = (1 - share) * a_s + share * a_p


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
    index: ArrayLike, thickness: ArrayLike, wavelength: ArrayLike, s: ArrayLike, p_share: ArrayLike = 0.5
) -> FilmResponse:
    """Response (...) of any stack of layers; all arguments broadcast, the first two on the axes before their last.

    index (..., layers + 2): n + ik from the lossless half-space in front to the one behind, which may absorb (T is then
    the flux just inside). thickness (..., layers) in the unit of the vacuum wavelength (...). s (...): k_t/k₀, the sine
    of incidence in vacuum, |s| ≤ n in front. p_share (...): part of the power polarised p (0 s, 1 p, ½ unpolarised).
    For a table over wavelengths and angles: index (w, 1, layers + 2), thickness (layers,), wavelength (w, 1), s (a,).
    Raises ValueError for shapes or values outside these.
    """
    index, thickness = np.asarray(index, complex), np.asarray(thickness, float)
    wavelength, s, share = (np.asarray(a, float) for a in (wavelength, s, p_share))
    _check(index, thickness, wavelength, s)
    depth = 2 * np.pi * thickness / wavelength[..., None]
    return FilmResponse(*_respond(index, depth, s, share))


def amplitudes(
    index: ArrayLike, thickness: ArrayLike, wavelength: ArrayLike, s: ArrayLike
) -> tuple[Complexes, Complexes]:
    """Complex r_s, r_p (...) of the reflected field at the front face; arguments as for `stack`.

    Along the axes ŝ = k × n/|k × n| and p̂ = ŝ × k/|k|, those of k before and after: then r_p is the ratio of the
    magnetic fields, and r_p = −r_s at normal incidence (Born & Wolf, Principles of Optics, §1.6.2).
    """
    index, thickness = np.asarray(index, complex), np.asarray(thickness, float)
    wavelength, s = np.asarray(wavelength, float), np.asarray(s, float)
    _check(index, thickness, wavelength, s)
    r_s, r_p = _reflect(index, 2 * np.pi * thickness / wavelength[..., None], s)
    return r_s, r_p


def momentum(
    index: ArrayLike, thickness: ArrayLike, wavelength: ArrayLike, u: ArrayLike, v: ArrayLike,
    p_share: ArrayLike = 0.5, *, from_back: bool = False,
) -> tuple[Floats, FilmResponse]:
    """Pressure coefficients q (..., 3) in (g, r, n) of a film tilted any way, and the response they follow from.

    Arguments as for `stack`, with the direction cosines u, v of the light (times the index it travels in). From the
    back the light runs along −n: q_n turns negative. Momentum balance as in `optics.momentum` with the specular order
    alone: q_t = A k_t, q_n = w(1 + R) − w' T. Both half-spaces must be lossless (ValueError): how deep an absorbing one
    reaches would have to be said; give it as a layer.
    """
    index, thickness = np.asarray(index, complex), np.asarray(thickness, float)
    if np.any(index[..., [0, -1]].imag):
        raise ValueError("index: momentum needs lossless half-spaces; give an absorbing one as a thick layer")
    if from_back:
        index, thickness = index[..., ::-1], thickness[..., ::-1]
    u, v = np.asarray(u, float), np.asarray(v, float)
    s = np.hypot(u, v)
    response = stack(index, thickness, wavelength, s, p_share)
    near, far = index[..., 0].real, index[..., -1].real
    w, w_far = (np.sqrt(np.maximum((n - s) * (n + s), 0.0)) for n in (near, far))
    q_n = w * (1 + response.reflectance) - w_far * response.transmittance
    a = response.absorptance
    return np.stack([a * u, a * v, -q_n if from_back else q_n], -1), response


def _arrays(cell: ThinFilm) -> tuple[Complexes, Floats, float]:
    """Indices (layers + 2,), thicknesses (layers,) and wavelength of a cell, in nm."""
    around = cell.surroundings
    index = [around.front, *(complex(layer.index.n, layer.index.k) for layer in cell.layers), around.back]
    return np.array(index, complex), np.array([layer.thickness_nm for layer in cell.layers]), cell.wavelength_nm


def solve(cell: ThinFilm, s: Floats) -> FilmResponse:
    """Response at k_t/k₀ = s (...), the sine of incidence in vacuum, for the cell's polarisation."""
    return stack(*_arrays(cell), s, P_SHARE[cell.polarisation])


def pressure(
    cell: ThinFilm, u: Floats, v: Floats | float = 0.0, *, from_back: bool = False
) -> tuple[Floats, FilmResponse]:
    """Q (..., 3) of the cell for light k/k₀ = (u, v, ·), and the response it follows from; see `momentum`."""
    return momentum(*_arrays(cell), u, v, P_SHARE[cell.polarisation], from_back=from_back)


def polarised(cell: ThinFilm, s: Floats) -> Floats:
    """What `PressureTable.amplitudes` holds, (6, n), at sines s (n,), whatever the cell's own polarisation."""
    arrays = _arrays(cell)
    r_s, r_p = amplitudes(*arrays, s)
    a_s, a_p = (stack(*arrays, s, share).absorptance for share in (0.0, 1.0))
    return np.stack([r_s.real, r_s.imag, r_p.real, r_p.imag, a_s, a_p])


def make_table(cell: ThinFilm, s_max: float, tolerance: float) -> PressureTable:
    """Axisymmetric pressure table over sines 0 … s_max, refined until interpolation meets `tolerance`."""
    watch = Stopwatch()

    def response(s: Floats) -> Floats:
        q, film = pressure(cell, s)
        return np.column_stack([q, film.absorptance, polarised(cell, s).T])

    nodes = refine(response, np.linspace(0.0, s_max, 33), tolerance, 1e-5)
    q, film = pressure(cell, nodes.nodes)
    attrs = {
        "name": cell.name, "solver": "thin_film", "cell": cell.model_dump(), "wavelength_m": cell.wavelength_nm * 1e-9,
        "settings": {"s_max": s_max, "tolerance": tolerance}, "cutoffs": [],
        "energy_imbalance": float(np.abs(film.imbalance).max()), "cpu_seconds": watch.cpu_seconds,
        "versions": versions("numpy", "scipy"),
    }
    # Closed form: what error there is comes from interpolation and rounding.
    error = nodes.error[:, :4].max(axis=1) + 1e-14
    return PressureTable(
        nodes.nodes, np.zeros(1), q.T[..., None], film.absorptance[:, None], error[:, None],
        axisymmetric=True, attrs=attrs, amplitudes=polarised(cell, nodes.nodes)[..., None],
    )


def main() -> None:
    """Command line: see the module docstring."""
    arguments = table_arguments("optics.thin_film", "Pressure table of a plane film", 1e-6, 0.999, v_max=False)
    cell = read_cell(arguments.cell, arguments.wavelength_nm)
    if not isinstance(cell, ThinFilm):
        raise InputError(f"{arguments.cell}: kind = {cell.kind!r}: must be thin_film; use optics.modal for gratings")
    check_range(cell.surroundings.front, arguments.u_max)
    make_table(cell, arguments.u_max, arguments.tolerance).write(arguments.out)


if __name__ == "__main__":
    run_stage(main)
