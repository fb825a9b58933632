"""The response of a cell around normal incidence over a band of wavelengths: what stability on the way asks for.

A sail that moves away sees its laser's light at longer wavelengths. Between the wavelengths of a file the response
follows not-a-knot cubic splines (de Boor, A Practical Guide to Splines, chapter IV).

Files are HDF5 in the netCDF-4 layout: `xarray.open_dataset(path, engine="h5netcdf")` reads them without this module.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from beamrider.arrays import Floats
from beamrider.io.files import InputError, reading, require_whole
from beamrider.io.hdf5 import write_hdf5
from beamrider.provenance.record import NAME, as_attribute
from optics.table.contents import COMPONENTS, decode, encode
from optics.table.normal_incidence import NormalResponse

DIRECTIONS = ("u", "v")
_FEWEST, _ROUNDING = 4, 1e-9
_TEXTS = {
    "q": "force × c / incident power",
    "gradient": "slope of q over the direction cosines",
    "q_error": "estimated absolute error of q",
    "gradient_error": "estimated absolute error of the slope",
}


@dataclass(frozen=True)
class BandResponse:
    """Response at normal incidence over wavelengths (n,) in m, ascending, at least 4.

    q (n, 3) and gradient (n, 3, 2) over (u, v), components g, r, n, with their absolute errors, alike; those hold
    between the wavelengths too. attrs: what made it (name, cell, …).
    """

    wavelength: Floats
    q: Floats
    gradient: Floats
    q_error: Floats
    gradient_error: Floats
    attrs: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        x = self.wavelength
        if x.ndim != 1 or x.size < _FEWEST or not (x[0] > 0 and np.all(np.diff(x) > 0) and np.all(np.isfinite(x))):
            raise InputError(f"wavelength must hold at least {_FEWEST} ascending values above 0")
        for name, shape in (("q", (3,)), ("gradient", (3, 2)), ("q_error", (3,)), ("gradient_error", (3, 2))):
            values = getattr(self, name)
            if values.shape != (want := (x.size, *shape)):
                raise InputError(f"{name} has shape {values.shape}; must be {want}")
            if not np.all(np.isfinite(values)):
                raise InputError(f"{name} holds values that are not finite")

    @property
    def name(self) -> str:
        """Name of the cell it belongs to."""
        return str(self.attrs.get("name", ""))

    @cached_property
    def _splines(self) -> tuple[CubicSpline, CubicSpline]:
        return CubicSpline(self.wavelength, self.q), CubicSpline(self.wavelength, self.gradient)

    def at(self, wavelength: Floats | float) -> NormalResponse:
        """The response at wavelengths (...) in m, its numbers (..., 3) and (..., 3, 2); InputError outside the band."""
        x, given = self.wavelength, np.asarray(wavelength, float)
        off = ~((given >= x[0] * (1 - _ROUNDING)) & (given <= x[-1] * (1 + _ROUNDING)))
        if np.any(off):
            raise InputError(
                f"wavelength {given[off].flat[0] * 1e9:.9g} nm is outside the band of '{self.name}': "
                f"{x[0] * 1e9:.9g} … {x[-1] * 1e9:.9g} nm"
            )
        k = np.clip(np.searchsorted(x, given) - 1, 0, x.size - 2)
        errors = [np.maximum(part[k], part[k + 1]) for part in (self.q_error, self.gradient_error)]
        return NormalResponse(*(np.asarray(spline(given)) for spline in self._splines), *errors)

    def write(self, path: str | Path) -> None:
        """Write it as netCDF-4/HDF5, atomically."""
        dims = {"q": ("wavelength", "component"), "gradient": ("wavelength", "component", "direction")}
        data = xr.Dataset(
            {
                name: (dims[name.removesuffix("_error")], getattr(self, name), {"units": "1", "long_name": text})
                for name, text in _TEXTS.items()
            },
            coords={
                "wavelength": ("wavelength", self.wavelength, {"units": "m", "long_name": "wavelength in vacuum"}),
                "component": list(COMPONENTS),
                "direction": list(DIRECTIONS),
            },
            attrs={**as_attribute(), **{key: encode(value) for key, value in self.attrs.items()}},
        )
        write_hdf5(path, data.to_netcdf(engine="h5netcdf"))

    @classmethod
    def read(cls, path: str | Path) -> BandResponse:
        """The response in a file; InputError says why one is refused."""
        if not Path(path).exists():
            raise InputError(f"{path}: no such file; make it with optics.band")
        require_whole(path)
        with reading(path, "a response over a band of wavelengths"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with xr.open_dataset(path, engine="h5netcdf", decode_cf=False, driver_kwds={"locking": False}) as data:
                    data.load()
            x, q, gradient, *errors = (np.asarray(data[name].values, float) for name in ("wavelength", *_TEXTS))
            attrs = {key: decode(value) for key, value in data.attrs.items() if key != NAME}
            return cls(x, q, gradient, errors[0], errors[1], attrs)
