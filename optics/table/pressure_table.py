"""The pressure table: the one contract between optics and motion.

A table belongs to one cell, one polarisation and one wavelength. It holds q (force × c per incident power, in the cell
frame g, r, n) and the absorptance on a grid of direction cosines, with an error estimate for every direction, and
exactly on the Rayleigh cut-offs where there are any. Between them it is interpolated by bicubic Hermite patches that
end at the cut-offs (`optics.table.strips`): continuous everywhere, with continuous slopes off the cut-offs.

Files are HDF5 in the netCDF-4 layout: `xarray.open_dataset(path, engine="h5netcdf")` reads them without this module.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from beamrider.arrays import Floats
from beamrider.io.files import InputError, reading, require_whole
from beamrider.io.hdf5 import write_hdf5
from beamrider.io.wording import brief
from beamrider.provenance.record import as_attribute
from optics.cells.cross_section import Section, cross_section
from optics.table.contents import (
    COMPONENTS,
    FIELDS,
    OWN_QUANTITIES,
    PARITY,
    PROPERTIES,
    REQUIRED,
    STOKES,
    STOKES_PARITY,
    Cutoffs,
    Variables,
    contents,
    cutoff_variables,
    encode,
    pole_variables,
)
from optics.table.films import FIELDS as FIELDS_OF_FILM
from optics.table.films import KIND, LOSSES, PRESSURE, Film, with_film
from optics.table.hermite import Values, make_patches
from optics.table.lookup import TableArrays, lookup_many, lookup_slopes_many, pack
from optics.table.lookup import lookup as lookup
from optics.table.pole_tracks import Resonances, without
from optics.table.strips import Curves, lay_out, no_curves
from optics.table.thick_membranes import GAIN, OWN, Thick, thick_variables, with_thick
from optics.table.thick_membranes import STOKES as STOKES_OF_THICK

SCHEMA = 2
_UNLOCKED = {"locking": False}  # see `beamrider.io.hdf5`


class OutsideTable(InputError):
    """A direction was asked for that the table does not hold."""


@dataclass(frozen=True)
class PressureTable:
    """Pressure coefficients of one cell over direction cosines.

    u (n_u), v (n_v): ascending, in the cell frame. q_nodes (3, n_u, n_v): components g, r, n. absorptance_nodes, error
    (n_u, n_v): absorbed fraction and estimated absolute error of q. With `mirror_v` only v ≥ 0 is stored (q_g, q_n and
    the absorptance are even in v, q_r is odd). An axisymmetric table (a film) has v = [0] and u from 0.
    `attrs`: what made the table (name, cell, solver, settings, versions, cpu_seconds, energy_imbalance, cutoffs).
    `cutoffs`: values on the Rayleigh cut-offs; None for a response without any.

    All polarisations, where they are known: q_stokes (4, 3, n_u, n_v) and absorptance_stokes (4, n_u, n_v). For light
    of normalised Stokes vector (1, s1, s2, s3), q is the sum of them times its four entries. s1 = +1 is E along e1, the
    projection of r perpendicular to k, s1 = −1 is E along e2 = k × e1/|k|; s2 = ±1 is E along (e1 ± e2)/√2, s3 = ±1 is
    circular, e1 ∓ i e2. The nodes are chosen for the cell's own polarisation, and `error` is that of it alone;
    `error_stokes` (n_u, n_v) is that of q in whichever polarisation it is largest.

    `resonances`: guided-mode resonances too narrow for the nodes, over the same v, whose heights h are those of q and
    the absorptance (4), then of the same for each Stokes component (16). The nodes hold the response itself; what is
    interpolated between them is the rest of it, to which the look-up adds the resonances at the direction asked for.

    Of films: amplitudes (6, n_u, 1), real and imaginary part of r_s, those of r_p, and the absorptance of s and of p
    light; r as in `optics.thin_film.amplitudes`, with r_p = −r_s at normal incidence. film: the stack itself, where
    samples would miss fringes or resonances; values are then those of the stack at every direction.

    Of gratings on thick layers: thick, the parts before and behind these, which look-ups join. `error` is then the
    largest found around a node; `stated_error` tells that of a direction.
    """

    u: Floats
    v: Floats
    q_nodes: Floats
    absorptance_nodes: Floats
    error: Floats
    _: KW_ONLY
    mirror_v: bool = False
    axisymmetric: bool = False
    attrs: dict[str, Any] = field(default_factory=dict)
    cutoffs: Cutoffs | None = None
    q_stokes: Floats | None = None
    absorptance_stokes: Floats | None = None
    error_stokes: Floats | None = None
    amplitudes: Floats | None = None
    resonances: Resonances | None = None
    film: Film | None = None
    thick: Thick | None = None

    def __post_init__(self) -> None:
        self._check_axes()
        sizes = {"component": 3, "stokes": 4, "field": 6, "cutoff": len(self._curves)}
        sizes |= {"u": self.u.size, "v": self.v.size, "property": 4, "medium": self.film.index.size if self.film else 0}
        if self.resonances:
            self._check_resonances(self.resonances)
            sizes |= {"part": 2, "pole": self.resonances.count, "pole_v": self.resonances.v.size}
        if self.thick:
            sizes |= {"amplitude": self.thick.parity.size, "thick_medium": self.thick.layers.index.size, "wave": 3}
            sizes |= {"thick_number": 2, "thick_flag": self.thick.layers.flags.size, "part": 2}
            if found := self.thick.resonances:
                sizes |= {"thick_pole": found.count, "thick_pole_v": found.v.size}
        for name, (dims, array, _) in self._variables().items():
            if array.shape != (want := tuple(sizes[dim] for dim in dims)):
                raise InputError(f"{name} has shape {array.shape}; must be {want}")
            held = self._on_curves if dims[-2:] == ("cutoff", "v") else True
            if not np.all(np.isfinite(array) == held):
                raise InputError(f"{name} holds values that are not finite")
        for name in ("error", "error_stokes"):
            if (error := getattr(self, name)) is not None and not np.all(error > 0):
                raise InputError(f"{name} must be greater than 0 everywhere")
        partly = self.q_stokes is None, self.absorptance_stokes is None
        if (self.amplitudes is not None or self.film) and not self.axisymmetric:
            raise InputError("amplitudes, film: only an axisymmetric table, that of a film, may hold them")
        curves = self.cutoffs
        if len({*partly, *((curves.q_stokes is None, curves.absorptance_stokes is None) if curves else ())}) > 1:
            raise InputError("q_stokes and absorptance_stokes, also on the cut-offs, must be given together")

    def _check_resonances(self, found: Resonances) -> None:
        v = found.v
        if not self.mirror_v:
            raise InputError("a table with resonances must have mirror_v")
        if v.ndim != 1 or v.size < 2 or not np.all(np.diff(v) > 0) or v[0] != 0.0 or v[-1] != self.v[-1]:
            raise InputError("pole_v must ascend from 0 to the largest v")
        if found.p.shape != (len(found.p), v.size) or not np.all(found.p.imag > 0):
            raise InputError("pole_u must have an imaginary part above 0 at every pole_v")

    def _check_axes(self) -> None:
        for name, nodes, least in (("u", self.u, 2), ("v", self.v, 1 if self.axisymmetric else 2)):
            if nodes.ndim != 1 or nodes.size < least or not np.all(np.diff(nodes) > 0):
                raise InputError(f"{name} must hold at least {least} ascending values")
        if not (np.all(np.isfinite(self.u)) and np.all(np.isfinite(self.v))):
            raise InputError("u and v must be finite")
        if self.axisymmetric and self.v.tolist() != [0.0]:
            raise InputError("an axisymmetric table must have v = [0]")
        if self.mirror_v and self.v[0] != 0:
            raise InputError("a table with mirror_v must start at v = 0")
        if self.cutoffs is None:
            return
        if not self.mirror_v:
            raise InputError("a table with cut-offs must have mirror_v")
        if not (np.all(np.isin(self._curves.sign, (-1, 1))) and np.all(self._curves.index > self.v[-1])):
            raise InputError("cutoff_sign must be ±1 and cutoff_index above the largest v")
        try:
            lay_out(self._curves, self.u[0], self.u[-1], self.v)
        except ValueError as missing:
            raise InputError(str(missing)) from None

    @property
    def _curves(self) -> Curves:
        return self.cutoffs.curves if self.cutoffs else no_curves()

    @cached_property
    def _on_curves(self) -> Any:
        return self._curves.inside(self.v, self.u[0], self.u[-1])

    @property
    def name(self) -> str:
        """Name of the cell the table belongs to."""
        return str(self.attrs.get("name", ""))

    @cached_property
    def section(self) -> Section | None:
        """Cross-section of the cell the table was made for; None where the table does not hold the cell."""
        return cross_section(self.attrs["cell"]) if "cell" in self.attrs else None

    def _variables(self) -> Variables:
        """Every number of the table, as it is named in a file: dims, array, long name."""
        found: dict[str, tuple[tuple[str, ...], Any, str]] = {
            "u": (("u",), self.u, "direction cosine of incidence across the ridges"),
            "v": (("v",), self.v, "direction cosine of incidence along the ridges"),
            "q": (("component", "u", "v"), self.q_nodes, "force × c / incident power"),
            "absorptance": (("u", "v"), self.absorptance_nodes, "absorbed share of the power"),
            "error": (("u", "v"), self.error, "estimated absolute error of q"),
            "q_stokes": (("stokes", "component", "u", "v"), self.q_stokes, "q for each Stokes component"),
            "absorptance_stokes": (("stokes", "u", "v"), self.absorptance_stokes, "likewise"),
            "error_stokes": (("u", "v"), self.error_stokes, "estimated absolute error of q in any polarisation"),
            "amplitude": (("field", "u", "v"), self.amplitudes, "reflected field and absorbed share of s and p light"),
        }
        if self.film:
            rows, share = self.film.as_rows(), np.array(self.film.share)
            found["film"] = ("medium", "property"), rows, "the stack that values between nodes follow from"
            found["film_p_share"] = (), share, "part of the light that is polarised p"
        if self.cutoffs:
            found |= cutoff_variables(self.cutoffs)
        if self.resonances:
            found |= pole_variables(self.resonances)
        if self.thick:
            found |= thick_variables(self.thick)
        return {name: (dims, array, text) for name, (dims, array, text) in found.items() if array is not None}

    def _values(self, stokes: bool) -> Values:
        """The quantities to be interpolated: q and absorptance, or those of the four Stokes components."""
        c, u, v = self.cutoffs, self.u, self.v
        q: Floats | None = self.q_nodes[None]
        a: Floats | None = self.absorptance_nodes[None]
        if stokes:
            q, a = self.q_stokes, self.absorptance_stokes
        if q is None or a is None:
            raise InputError(f"table '{self.name}' holds no Stokes components")
        nodes, on_curves = _stack(q, a), np.empty((4 * len(q), 0, v.size))
        if c:
            on_curves = _stack(*((c.q_stokes, c.absorptance_stokes) if stokes else (c.q[None], c.absorptance[None])))
        if self.axisymmetric:
            v, nodes = np.array([0.0, 1.0]), np.repeat(nodes, 2, axis=2)
        parity = np.outer(STOKES_PARITY[: len(q)], PARITY).ravel()
        return Values(u, v, nodes, on_curves, parity if self.mirror_v else None)

    def arrays(self, nearest: bool = False, stokes: bool = False) -> TableArrays:
        """The table as plain arrays for compiled kernels, which give q and absorptance.

        With `stokes` they give 16 quantities, q_g, q_r, q_n and absorptance for each of the Stokes components.
        """
        if self.thick and not nearest:
            return self._joined(STOKES_OF_THICK if stokes else OWN)
        values, found = self._values(stokes), None
        if self.resonances:
            found = self.resonances.take(slice(OWN_QUANTITIES, None) if stokes else slice(0, OWN_QUANTITIES))
            values = without(values, self._curves, found)
        layout = lay_out(self._curves, values.u[0], values.u[-1], values.v)
        arrays = pack(layout, values, make_patches(layout, values), self.axisymmetric, nearest, found)
        return with_film(arrays, self.film, PRESSURE) if self.film and not nearest else arrays

    def amplitude_arrays(self) -> tuple[TableArrays, TableArrays]:
        """A film's amplitudes for compiled kernels, to be looked up at u = the sine and v = 0.

        The first gives Re r_s, Im r_s, Re r_p, Im r_p, the second a_s, a_p, 0, 0. InputError where there are none.
        """
        if self.amplitudes is None:
            raise InputError(
                f"table '{self.name}' holds no amplitudes of s and p light: make it with optics.thin_film, all layers "
                "coherent"
            )
        pairs = np.repeat(np.concatenate([self.amplitudes, np.zeros((2, self.u.size, 1))]), 2, axis=2)
        layout, packed = lay_out(no_curves(), self.u[0], self.u[-1], np.array([0.0, 1.0])), []
        for part in (pairs[:4], pairs[4:]):
            values = Values(self.u, np.array([0.0, 1.0]), part, np.empty((4, 0, 2)), None)
            packed.append(pack(layout, values, make_patches(layout, values), False, False))
        if self.film:
            return with_film(packed[0], self.film, FIELDS_OF_FILM), with_film(packed[1], self.film, LOSSES)
        return packed[0], packed[1]

    @cached_property
    def _arrays(self) -> TableArrays:
        return self.arrays()

    @cached_property
    def _parts(self) -> TableArrays:
        """A grating on thick layers, in which a look-up joins the interpolated parts."""
        assert self.thick is not None
        return with_thick(self.thick.arrays(self._curves, self.u, self.v), self.thick, OWN)

    def _joined(self, kind: int) -> TableArrays:
        """The same numbers, for another kind of look-up."""
        places = self._parts.places.copy()
        places[KIND] = kind
        return self._parts._replace(places=places)

    def _gain(self, u: Floats, v: Floats) -> Floats:
        """How much errors (...) of the parts grow at directions u, v (...) within the table."""
        out = np.empty((u.size, 4))
        lookup_many(self._joined(GAIN), u.flatten(), v.flatten(), out)
        return out[:, 0].reshape(u.shape)

    def _look_up(self, u: Any, v: Any) -> tuple[Floats, tuple[int, ...]]:
        uu, vv = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        out = np.empty((uu.size, 4))
        flat_u, flat_v = np.ascontiguousarray(uu).ravel(), np.ascontiguousarray(vv).ravel()
        count, p = lookup_many(self._arrays, flat_u, flat_v, out)
        if count:
            raise OutsideTable(
                f"direction u = {flat_u[p]:.6g}, v = {flat_v[p]:.6g} is outside table '{self.name}': "
                f"allowed {self.limits}"
            )
        return out, uu.shape

    @property
    def limits(self) -> str:
        """The range of directions, in words."""
        if self.axisymmetric:
            return f"√(u² + v²) ≤ {self.u[-1]:.6g}"
        first = -self.v[-1] if self.mirror_v else self.v[0]
        return f"u {self.u[0]:.6g} … {self.u[-1]:.6g}, v {first:.6g} … {self.v[-1]:.6g}"

    def q(self, u: Any, v: Any) -> Floats:
        """Q (..., 3) at direction cosines u, v (broadcast)."""
        out, shape = self._look_up(u, v)
        return out[:, :3].reshape(*shape, 3)

    def absorptance(self, u: Any, v: Any) -> Floats:
        """Absorptance (...) at direction cosines u, v (broadcast)."""
        out, shape = self._look_up(u, v)
        return out[:, 3].reshape(shape)

    def nearest(self, u: Any, v: Any) -> tuple[Floats, Floats]:
        """Directions u, v (broadcast), those outside the table brought to its edge; of a film along their azimuth."""
        u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        if self.axisymmetric:
            shorter = np.minimum(1.0, self.u[-1] / np.maximum(np.hypot(u, v), 1e-300) * (1.0 - 1e-15))
            return u * shorter, v * shorter
        return np.clip(u, *self.u[[0, -1]]), np.clip(v, -self.v[-1] if self.mirror_v else self.v[0], self.v[-1])

    def stated_error(self, u: Any, v: Any, polarised: bool = False) -> Floats:
        """Stated error (...) of q at direction cosines u, v (broadcast), the largest of the nodes around.

        That of the cell's own polarisation, or (`polarised`) of any, if the table knows it. Outside the table that of
        its edge.
        """
        error = self.error_stokes if polarised and self.error_stokes is not None else self.error
        u, v = self.nearest(u, v)
        gain: Floats | float = 1.0
        if self.thick:
            error, gain = (self.thick.error_stokes if polarised else self.thick.error), self._gain(u, v)
        if self.axisymmetric:
            u, v = np.hypot(u, v), np.zeros_like(u)
        rows, lines = _around(self.u, u), _around(self.v, np.abs(v) if self.mirror_v else v)
        return np.asarray(gain * np.max([error[i, j] for i in rows for j in lines], axis=0))

    def gradient(self, u: Any, v: Any) -> Floats:
        """∂(q_g, q_r, q_n)/∂(u, v) (..., 3, 2) at direction cosines u, v of a table that is not axisymmetric."""
        if self.axisymmetric:
            raise InputError(f"table '{self.name}' is axisymmetric: gradient is not defined in u, v")
        self._look_up(u, v)
        uu, vv = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
        out = np.empty((uu.size, 3, 4))
        lookup_slopes_many(self._arrays, uu.ravel(), vv.ravel(), out)
        return out[:, 1:, :3].swapaxes(1, 2).reshape(*uu.shape, 3, 2)

    def write(self, path: str | Path) -> None:
        """Write the table as netCDF-4/HDF5, atomically."""
        data = xr.Dataset(
            {
                name: (dims, array, {"units": "1", "long_name": text})
                for name, (dims, array, text) in self._variables().items()
            },
            coords={"component": list(COMPONENTS)}
            | ({} if self.q_stokes is None else {"stokes": list(STOKES)})
            | ({} if self.amplitudes is None else {"field": list(FIELDS)})
            | ({"property": list(PROPERTIES)} if self.film else {}),
            attrs={
                "schema": SCHEMA,
                "mirror_v": int(self.mirror_v),
                "axisymmetric": int(self.axisymmetric),
                "digest": self.digest,
                **as_attribute(),
                **{key: encode(value) for key, value in self.attrs.items()},
            },
        )
        write_hdf5(path, data.to_netcdf(engine="h5netcdf"))

    @property
    def digest(self) -> str:
        """SHA-256 of the numbers and of all attributes but the time it took, to notice an edited file."""
        attrs = sorted((key, encode(value)) for key, value in self.attrs.items() if not key.endswith("_seconds"))
        belongs = [self.mirror_v, self.axisymmetric, attrs]
        sums = hashlib.sha256(json.dumps(belongs).encode())
        for name, (_, array, _) in self._variables().items():
            sums.update(name.encode() + np.ascontiguousarray(array, "<f8").tobytes())
        return sums.hexdigest()

    @classmethod
    def read(cls, path: str | Path) -> PressureTable:
        """The table in a file; InputError says why a missing, foreign, truncated or edited file is refused."""
        if not os.path.exists(path):
            raise InputError(f"{path}: no such pressure table; make it with optics.modal, fdtd or thin_film")
        require_whole(path)
        with reading(path, "a readable HDF5 table"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of netCDF about data of other programs, which are refused below
            with xr.open_dataset(path, engine="h5netcdf", decode_cf=False, driver_kwds=_UNLOCKED) as data:
                data.load()
        for name in REQUIRED:
            if name not in data.variables:
                raise InputError(f"{path}: not a pressure table: '{name}' is missing")
        if str(data.attrs.get("schema")) != str(SCHEMA):
            given = brief(data.attrs.get("schema"))
            raise InputError(f"{path}: schema = {given}: must be {SCHEMA}; make the table again")
        with reading(path, "a pressure table"):
            try:
                table = cls(**contents(data))
            except InputError as refusal:
                raise InputError(f"{path}: {refusal}") from None
            digest = table.digest
        if digest != str(data.attrs.get("digest")):
            raise InputError(f"{path}: it was changed after it was made (digest differs); make it again")
        return table


def _stack(q: Floats | None, absorptance: Floats | None) -> Floats:
    """Quantities (4 s, ...) from q (s, 3, ...) and absorptance (s, ...): of one Stokes component after the other."""
    assert q is not None
    assert absorptance is not None
    both = np.concatenate([q, absorptance[:, None]], axis=1)
    return both.reshape(-1, *both.shape[2:])


def _around(nodes: Floats, x: Floats) -> tuple[Any, Any]:
    """Indices of the nodes left and right of x (...), both the same where there is but one."""
    right = np.clip(np.searchsorted(nodes, x), min(1, nodes.size - 1), nodes.size - 1)
    return np.maximum(right - 1, 0), right
