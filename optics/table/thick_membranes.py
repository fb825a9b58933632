"""Gratings on thick layers in pressure tables: scattering matrices, interpolated, joined by the layers' exact phases.

A table of such a grating holds what lies before and behind its thick layers (`optics.modal.parts`), sampled. A look-up
interpolates these matrices and solves for the light between them (`optics.waves.joined_parts`), whatever the thickness;
compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers
from beamrider.machine_code.standalone import standalone
from optics.table.films import KIND, NUMBERS
from optics.table.hermite import Values, make_patches
from optics.table.layout import pack
from optics.table.locate import Parts, TableArrays, find_place, fold, is_inside, is_turned, roots, unpack
from optics.table.patch_sum import read, values
from optics.table.pole_sum import pole_values
from optics.table.pole_tracks import Resonances, without
from optics.table.strips import Curves, lay_out
from optics.waves.joined_parts import QUANTITIES, gain, own_light, respond
from optics.waves.thick_layers import Setup, setup

# What a look-up gives, beyond the kinds of `optics.table.films`: q and absorptance of the cell's own polarisation;
# those of the Stokes components; how much errors of the parts grow.
OWN, STOKES, GAIN = range(4, 7)
_FLAGS = 11
# Slopes are taken over such a share of the shortest fringe: phases there change by about this.
_STEP = 1e-4


@dataclass(frozen=True)
class Layers:
    """Thick layers, and what look-ups know of the parts around them: see `optics.waves.thick_layers.Setup`.

    index (m,), depth (m − 1,): n + ik and k₀d, the half-space last. pitch: λ/d. front: index in front. flags (10).
    """

    index: NDArray[np.complex128]
    depth: Floats
    pitch: float
    front: float
    flags: Integers

    @property
    def numbers(self) -> Floats:
        """Numbers (n,) as `optics.waves.thick_layers.setup` takes them."""
        index = np.ascontiguousarray(self.index, complex).view(float)
        return np.concatenate([[self.pitch, self.front], index, self.depth])

    @property
    def whole(self) -> Integers:
        """Flags (n,) as `optics.waves.thick_layers.setup` takes them."""
        return np.array([self.index.size, *self.flags], dtype=np.int64)

    def join(self, u: Floats, v: Floats, parts: Floats) -> Floats:
        """Quantities (20, n) as in `optics.modal.quantities` at directions u, v (n), the parts there (k, n) given."""
        out = np.empty((u.size, 4 + QUANTITIES))
        _join_many(self.numbers, self.whole, np.ascontiguousarray(parts.T), u, v, out)
        return out.T


@dataclass(frozen=True)
class Thick:
    """What a look-up joins: sampled parts, and the layers between them.

    nodes (k, n_u, n_v), on_curves (k, n_curves, n_v): the parts, as `optics.modal.parts.scattering` gives them, with
    their parity (k) under v → −v; NaN on curves outside the table. error, error_stokes (n_u, n_v): errors of the parts,
    which times `optics.waves.joined_parts.gain` cover that of q. resonances: of the parts, too narrow for the nodes, as
    in a table.
    """

    nodes: Floats
    on_curves: Floats
    parity: Floats
    error: Floats
    error_stokes: Floats
    layers: Layers
    resonances: Resonances | None = None

    def arrays(self, curves: Curves, u: Floats, v: Floats) -> TableArrays:
        """The parts between rows u (n,) and lines v (m,) and on cut-offs, to be interpolated."""
        values = Values(u, v, self.nodes, self.on_curves, self.parity)
        if self.resonances:
            values = without(values, curves, self.resonances)
        layout = lay_out(curves, u[0], u[-1], v)
        return pack(layout, values, make_patches(layout, values), False, False, self.resonances)


def with_thick(t: TableArrays, thick: Thick, kind: int) -> TableArrays:
    """The arrays of the interpolated parts made into those of a table in which a look-up joins them."""
    places = np.append(t.places, thick.layers.whole)
    places[[KIND, NUMBERS]] = kind, t.numbers.size
    return t._replace(numbers=np.concatenate([t.numbers, thick.layers.numbers]), places=places)


def thick_variables(of: Thick) -> dict[str, tuple[tuple[str, ...], Floats, str]]:
    """What a file holds of them: dims, array (...), long name."""
    own = of.layers
    media = np.column_stack([own.index.real, own.index.imag, np.append(own.depth, 0.0)])
    on_them = {"thick_cutoff_parts": (("amplitude", "cutoff", "v"), of.on_curves, "likewise, on the cut-offs")}
    return {
        "thick_parts": (("amplitude", "u", "v"), of.nodes, "scattering before and behind thick layers"),
        **(on_them if of.on_curves.shape[1] else {}),
        "thick_parity": (("amplitude",), of.parity, "of each under v → −v"),
        "thick_error": (("u", "v"), of.error, "error of the parts; times their gain it covers that of q"),
        "thick_error_stokes": (("u", "v"), of.error_stokes, "likewise, in any polarisation"),
        "thick_media": (("thick_medium", "wave"), media, "n, k and phase depth of thick layers, half-space last"),
        "thick_numbers": (("thick_number",), np.array([own.pitch, own.front]), "λ/d and the index in front"),
        **_poles(of.resonances),
        "thick_flags": (("thick_flag",), own.flags.astype(float), "orders followed, in front, behind; what parts hold"),
    }


def _poles(found: Resonances | None) -> dict[str, tuple[tuple[str, ...], Floats, str]]:
    """What a file holds of the narrow resonances of the parts."""
    if not found:
        return {}
    p, h = (np.stack([x.real, x.imag]) for x in (found.p, found.h))
    dims = "thick_pole", "thick_pole_v"
    return {
        "thick_pole_v": (("thick_pole_v",), found.v, "v of the nodes of narrow resonances of the parts"),
        "thick_pole_u": (("part", *dims), p, "p = x + iγ: place and half width in u"),
        "thick_pole_parts": (("part", "amplitude", *dims), h, "h: they add Re[h γ / (u − p)]"),
    }


def read_thick(numbers: Callable[..., list[Floats]], curves: bool, poles: bool) -> Thick:
    """From what a file holds: `numbers` gives its arrays (...) by name; has it cut-offs, and narrow resonances."""
    names = ("parts", "parity", "error", "error_stokes", "media", "numbers", "flags")
    nodes, signs, error, worst, media, both, flags = numbers(*(f"thick_{name}" for name in names))
    on_them = numbers("thick_cutoff_parts")[0] if curves else np.empty((len(nodes), 0, nodes.shape[2]))
    layers = Layers(
        media[:, 0] + 1j * media[:, 1], media[:-1, 2].copy(), float(both[0]), float(both[1]), flags.astype(np.int64)
    )
    found = None
    if poles:
        at, p, h = numbers("thick_pole_v", "thick_pole_u", "thick_pole_parts")
        found = Resonances(at, p[0] + 1j * p[1], h[0] + 1j * h[1], signs)
    return Thick(nodes, on_them, signs, error, worst, layers, found)


@numba.njit(cache=True, error_model="numpy")
def _join_many(numbers: Floats, flags: Integers, parts: Floats, u: Floats, v: Floats, out: Floats) -> None:
    """`Layers.join`."""
    s = setup(numbers, flags)
    for i in range(u.size):
        respond(s, parts[i], u[i], v[i], out[i, 4:])
        own = out[i, 4:].copy()
        own_light(s, own, u[i], v[i])
        out[i, :4] = own[:4]


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def is_thick(t: TableArrays) -> bool:
    """Does a look-up join parts."""
    return bool(t.places[KIND] >= OWN)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _setup(t: TableArrays) -> Setup:
    """The layers of a table."""
    return setup(t.numbers[t.places[NUMBERS] :], t.places[t.places.size - _FLAGS :])


@numba.njit(cache=True, error_model="numpy")
def _interpolate(p: Parts, u: float, v: float, x: Floats) -> None:
    """The parts (k,) at one direction."""
    folded, turned = fold(p, v), is_turned(p, v)
    root_0, root_1 = roots(p, folded)
    at = find_place(p, u, folded, root_0, root_1)
    for c in range(0, p.k, 4):
        x[c], x[c + 1], x[c + 2], x[c + 3] = values(
            p.n, at.start + 4 * c, at.row, 4 * p.k, at.s, at.h, at.r, at.g, p.parity + c, turned
        )
    for c in range(0, p.k if p.poles else 0, 4):
        more = pole_values(p.n, p.pole_at, p.pole_nodes, p.poles, p.k, c, u, folded)
        for i in range(4):
            x[c + i] += more[i] * (read(p.n, p.parity + c + i) if turned else 1.0)


@standalone()
def _one(t: TableArrays, s: Setup, p: Parts, u: float, v: float, x: Floats, out: Floats) -> bool:
    """Look up one direction into out (16,), by the kind of the table; is it inside. x (k,) is overwritten."""
    inside = is_inside(p, u, v)
    u = min(max(u, p.u_first), p.u_last)
    v = min(max(v, -p.v_last if p.mirror else p.v_first), p.v_last)
    _interpolate(p, u, v, x)
    kind = t.places[KIND]
    if kind == GAIN:
        out[:4] = 0.0
        out[0] = gain(s, x, u, v)
        return inside
    respond(s, x, u, v, out)
    if kind == OWN:
        own_light(s, out, u, v)
    return inside


@numba.njit(cache=True, error_model="numpy")
def look_up(t: TableArrays, u: float, v: float) -> tuple[float, float, float, float, bool]:
    """As `optics.table.lookup.lookup`."""
    p, out = unpack(t), np.empty(QUANTITIES)
    inside = _one(t, _setup(t), p, u, v, np.empty(p.k), out)
    return out[0], out[1], out[2], out[3], inside


@numba.njit(cache=True, error_model="numpy")
def look_up_many(t: TableArrays, u: Floats, v: Floats, out: Floats) -> tuple[int, int]:
    """As `optics.table.lookup.lookup_many`."""
    p, s, one, count, first = unpack(t), _setup(t), np.empty(QUANTITIES), 0, -1
    x = np.empty(p.k)
    for i in range(u.size):
        inside = _one(t, s, p, u[i], v[i], x, one)
        for k in range(out.shape[1]):
            out[i, k] = one[k]
        if not inside:
            count += 1
            first = i if first < 0 else first
    return count, first


@numba.njit(cache=True, error_model="numpy")
def look_up_slopes(t: TableArrays, u: float, v: float, out: Floats) -> bool:
    """As `optics.table.lookup.lookup_slopes`: differences within a small part of a fringe, one-sided at an edge."""
    p, s, k = unpack(t), _setup(t), out.shape[1]
    x, low, high = np.empty(p.k), np.empty(QUANTITIES), np.empty(QUANTITIES)
    inside = _one(t, s, p, u, v, x, low)
    out[0] = low[:k]
    step = _STEP / max(1.0, s.depth.sum())
    for row in (1, 2):
        du, dv = (step, 0.0) if row == 1 else (0.0, step)
        left = 0.0 if row == 1 and u - du < p.u_first else 1.0
        right = 0.0 if row == 1 and u + du > p.u_last else 1.0
        left = 0.0 if row == 2 and v - dv < (-p.v_last if p.mirror else p.v_first) else left
        right = 0.0 if row == 2 and v + dv > p.v_last else right
        _one(t, s, p, u - left * du, v - left * dv, x, low)
        _one(t, s, p, u + right * du, v + right * dv, x, high)
        out[row] = (high[:k] - low[:k]) / ((left + right) * step)
    return inside
