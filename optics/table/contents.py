"""What a file of a pressure table holds: names, dimensions and order of its numbers, to and fro."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from beamrider.arrays import Floats
from beamrider.provenance.record import NAME
from optics.table.films import from_rows
from optics.table.pole_tracks import Resonances
from optics.table.strips import Curves
from optics.table.thick_membranes import read_thick

COMPONENTS = ("g", "r", "n")
STOKES = ("1", "s1", "s2", "s3")
FIELDS = ("re_s", "im_s", "re_p", "im_p", "a_s", "a_p")
PROPERTIES = ("n", "k", "phase_depth", "coherent")
# Under v → −v: q_g, q_n and the absorptance are even, q_r is odd; light of s2 and s3 becomes that of −s2 and −s3.
PARITY = np.array([1.0, -1.0, 1.0, 1.0])
STOKES_PARITY = np.array([1.0, 1.0, -1.0, -1.0])
REQUIRED = ("u", "v", "q", "absorptance", "error")
#: Quantities of the cell's own polarisation.
OWN_QUANTITIES = 4
_POLE_HEIGHTS = ("pole_q", "pole_absorptance", "pole_q_stokes", "pole_absorptance_stokes")

Variables = dict[str, tuple[tuple[str, ...], Floats, str]]


@dataclass(frozen=True)
class Cutoffs:
    """The response exactly on the Rayleigh cut-offs, at (u_c(v), v) of every stored v.

    curves (n): which they are. q (3, n, n_v), absorptance (n, n_v), NaN where a curve is outside the table. For the
    Stokes components, if the table has them: q_stokes (4, 3, n, n_v), absorptance_stokes (4, n, n_v).
    """

    curves: Curves
    q: Floats
    absorptance: Floats
    q_stokes: Floats | None = None
    absorptance_stokes: Floats | None = None


def cutoff_variables(c: Cutoffs) -> dict[str, tuple[tuple[str, ...], Any, str]]:
    """What a file holds of the response on Rayleigh cut-offs: dims, array (None where there is none), long name."""
    return {
        "cutoff_order": (("cutoff",), c.curves.order, "order m that grazes at u = sign √(index² − v²) − shift"),
        "cutoff_sign": (("cutoff",), c.curves.sign, "sign of that order's u"),
        "cutoff_index": (("cutoff",), c.curves.index, "refractive index of its half-space"),
        "cutoff_offset": (("cutoff",), c.curves.offset, "distance in u of a line of nodes beside the cut-off"),
        "cutoff_shift": (("cutoff",), c.curves.shift, "m λ/d − offset"),
        "cutoff_q": (("component", "cutoff", "v"), c.q, "q on the cut-off; NaN outside the table"),
        "cutoff_absorptance": (("cutoff", "v"), c.absorptance, "likewise"),
        "cutoff_q_stokes": (("stokes", "component", "cutoff", "v"), c.q_stokes, "likewise"),
        "cutoff_absorptance_stokes": (("stokes", "cutoff", "v"), c.absorptance_stokes, "likewise"),
    }


def pole_variables(found: Resonances) -> Variables:
    """What a file holds of narrow resonances."""
    along = ("pole", "pole_v")
    shape = found.p.shape
    parts = np.stack([found.h.real, found.h.imag])
    own, every = parts[:, :OWN_QUANTITIES], parts[:, OWN_QUANTITIES:].reshape(2, -1, OWN_QUANTITIES, *shape)
    text = "real and imaginary part h: they add Re[h γ / (u − p)]"
    heights = own[:, :3], own[:, 3], every[:, :, :3], every[:, :, 3]
    dims = ("component",), (), ("stokes", "component"), ("stokes",)
    return {
        "pole_v": (("pole_v",), found.v, "v of the nodes of narrow resonances"),
        "pole_u": (("part", *along), np.stack([found.p.real, found.p.imag]), "p = x + iγ: place and half width in u"),
        **{
            name: (("part", *dim, *along), height, text)
            for name, dim, height in zip(_POLE_HEIGHTS, dims, heights, strict=True)
        },
    }


def _resonances(v: Floats, p: Floats, q: Floats, absorptance: Floats, q_stokes: Floats, a_stokes: Floats) -> Resonances:
    """Narrow resonances from what a file holds of them."""
    own = np.concatenate([q, absorptance[:, None]], axis=1)
    every = np.concatenate([q_stokes, a_stokes[:, :, None]], axis=2)
    h = np.concatenate([own, every.reshape(2, -1, *p.shape[1:])], axis=1)
    parity = np.concatenate([PARITY, np.outer(STOKES_PARITY, PARITY).ravel()])
    return Resonances(v, p[0] + 1j * p[1], h[0] + 1j * h[1], parity)


def contents(data: xr.Dataset) -> dict[str, Any]:
    """Fields of the table in a data set; KeyError, ValueError or TypeError where one is missing or no number."""

    def numbers(*names: str) -> list[Floats]:
        if wrong := [name for name in names if data[name].dtype.kind not in "fiu"]:
            raise TypeError(f"{wrong[0]} must hold real numbers")
        return [np.asarray(data[name].values, float) for name in names]

    attrs = {key: decode(value) for key, value in data.attrs.items() if key not in ("schema", "digest", NAME)}
    mirror_v, axisymmetric = (bool(int(attrs.pop(name))) for name in ("mirror_v", "axisymmetric"))
    pair = ("q_stokes", "absorptance_stokes")
    stokes: list[Any] = numbers(*pair) if any(name in data for name in pair) else [None, None]
    cutoffs = None
    if any(str(name).startswith("cutoff_") for name in data.variables):
        order, *rest = numbers("cutoff_order", "cutoff_sign", "cutoff_index", "cutoff_shift", "cutoff_offset")
        found = stokes[0] is not None
        on_them: list[Any] = numbers(*(f"cutoff_{name}" for name in pair)) if found else [None, None]
        curves = Curves(order.astype(np.int64), *rest)
        cutoffs = Cutoffs(curves, *numbers("cutoff_q", "cutoff_absorptance"), *on_them)
    u, v, q, absorptance, error = numbers(*REQUIRED)
    worst = numbers("error_stokes")[0] if "error_stokes" in data else None
    amplitudes = numbers("amplitude")[0] if "amplitude" in data else None
    resonances = None
    if any(str(name).startswith("pole_") for name in data.variables):
        resonances = _resonances(*numbers("pole_v", "pole_u", *_POLE_HEIGHTS))
    film = from_rows(numbers("film")[0], float(data["film_p_share"])) if "film" in data else None
    thick = read_thick(numbers, cutoffs is not None, "thick_pole_v" in data) if "thick_parts" in data else None
    return {
        "u": u,
        "v": v,
        "q_nodes": q,
        "absorptance_nodes": absorptance,
        "error": error,
        "mirror_v": mirror_v,
        "axisymmetric": axisymmetric,
        "attrs": attrs,
        "cutoffs": cutoffs,
        "q_stokes": stokes[0],
        "absorptance_stokes": stokes[1],
        "error_stokes": worst,
        "amplitudes": amplitudes,
        "resonances": resonances,
        "film": film,
        "thick": thick,
    }


def encode(value: Any) -> Any:
    """Attribute values: numbers and text as they are, anything nested as JSON text."""
    return value if isinstance(value, str | int | float) else json.dumps(value)


def decode(value: Any) -> Any:
    """The same, to what they were."""
    if isinstance(value, str) and value[:1] in ("{", "["):
        return json.loads(value)
    return value.item() if isinstance(value, np.generic) else value
