"""What a sail's surface is made of: metagratings, lamellar stacks, any profile, films, read strictly from YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from beamrider.io.files import InputError, Name, Pair, Strict, read_mapping, validate
from beamrider.io.wording import brief
from optics.cells.cross_section import cross_section

ElectricAxis = Literal["g", "r"]

# Wide enough for every cell, narrow enough for every number that follows to stay finite.
Refraction = Annotated[float, Field(gt=0, le=1e6)]
Extinction = Annotated[float, Field(ge=0, le=1e6)]
Length = Annotated[float, Field(gt=0, le=1e12)]
Thickness = Annotated[float, Field(ge=0, le=1e12)]
Wavelength = Annotated[float, Field(ge=1e-3, le=1e12)]
# Starts and widths are decimals: their sums may miss each other by this share of the period.
_ROUNDING = 1e-12


class Index(Strict):
    """Complex refractive index n + ik (time factor exp(−iωt): k > 0 absorbs)."""

    n: Refraction
    k: Extinction = 0.0

    @property
    def permittivity(self) -> complex:
        """Relative permittivity (n + ik)²."""
        return complex(self.n, self.k) ** 2


class Surroundings(Strict):
    """Refractive indices of the half-spaces in front of (light side) and behind the cell.

    The one behind may absorb (back_k > 0); light that enters it then counts as absorbed.
    """

    front: Refraction = 1.0
    back: Refraction = 1.0
    back_k: Extinction = 0.0


class _Periodic(Strict):
    """What gratings share."""

    name: Name
    wavelength_nm: Wavelength
    electric_axis: ElectricAxis
    period_nm: Length

    @property
    def pitch(self) -> float:
        """λ/d, the step in u between diffraction orders."""
        return self.wavelength_nm / self.period_nm


class Metagrating(_Periodic):
    """Ridges of one height on a membrane, periodic along g and endless along r. Light falls on the ridges.

    Lengths in nm. `ridges_nm` holds [start, width] along +g within one period. `electric_axis` is the direction of E at
    normal incidence: 'r' (TE) or 'g' (TM). `corner_radius_nm` rounds the two outer corners of each ridge, those that
    the light reaches first; the inner ones at its foot stay sharp. `membrane_coherent: false` averages the fringes of
    the membrane, as for one that is uneven by wavelengths.
    """

    kind: Literal["metagrating"]
    ridges_nm: Annotated[list[Pair], Field(min_length=1)]
    ridge_height_nm: Length
    membrane_nm: Thickness
    index: Index
    surroundings: Surroundings = Surroundings()
    corner_radius_nm: Thickness = 0.0
    membrane_coherent: bool = True

    @model_validator(mode="after")
    def _ridges_fit(self) -> Metagrating:
        end, near = 0.0, _ROUNDING * self.period_nm
        for i, (start, width) in enumerate(self.ridges_nm):
            if width <= 0:
                raise ValueError(f"ridges_nm[{i}] = [{start:g}, {width:g}]: the width must be greater than 0")
            if start < end - near:
                what = "overlaps the ridge before it" if i else "starts left of the cell"
                raise ValueError(f"ridges_nm[{i}] = [{start:g}, {width:g}] {what}: its start must be at least {end:g}")
            end = start + width
        if end > self.period_nm + near:
            raise ValueError(f"ridges_nm: the last ridge ends at {end:g}, beyond period_nm = {self.period_nm:g}")
        return self

    @model_validator(mode="after")
    def _corners_fit(self) -> Metagrating:
        most = min([self.ridge_height_nm, *(width / 2 for _, width in self.ridges_nm)])
        if self.corner_radius_nm > most:
            raise ValueError(
                f"corner_radius_nm = {self.corner_radius_nm:g}: must be at most {most:g}, the height of the ridges and "
                "half their width"
            )
        if not self.membrane_coherent:
            _check_averaged("membrane_coherent", self.membrane_nm, self.index, self.wavelength_nm)
        if self.corner_radius_nm > 0 and not self.membrane_coherent:
            raise ValueError(
                f"membrane_coherent = false with corner_radius_nm = {self.corner_radius_nm:g}: must be true; or give "
                "the cell as kind: lamellar, with layers in place of the corners"
            )
        return self

    @property
    def fill(self) -> float:
        """Share of the period that ridges cover."""
        return sum(width for _, width in self.ridges_nm) / self.period_nm

    @property
    def mean_thickness_nm(self) -> float:
        """Thickness of the plain film of equal mass, in nm."""
        return 1e9 * cross_section(self.model_dump()).mean_m


def _check_averaged(where: str, thickness_nm: float, index: Index, wavelength_nm: float) -> None:
    """ValueError for a layer too thin to have fringes that could be averaged."""
    if thickness_nm * index.n < wavelength_nm / 2:
        raise ValueError(
            f"{where} = false with a thickness of {thickness_nm:g} nm: must be true below "
            f"{wavelength_nm / index.n / 2:g}, half a wavelength within"
        )


class Layer(Strict):
    """One homogeneous layer of a film, listed from the light side.

    `coherent: false` averages its fringes, as for a layer that is uneven, or light less coherent, by a wavelength.
    """

    thickness_nm: Thickness
    index: Index
    coherent: bool = True


class ThinFilm(Strict):
    """A stack of homogeneous layers. 'mean' averages s and p (unpolarised light)."""

    kind: Literal["thin_film"]
    name: Name
    wavelength_nm: Wavelength
    polarisation: Literal["s", "p", "mean"] = "mean"
    layers: Annotated[list[Layer], Field(min_length=1)]
    surroundings: Surroundings = Surroundings()

    @model_validator(mode="after")
    def _averaged_are_thick(self) -> ThinFilm:
        for i, layer in enumerate(self.layers):
            if not layer.coherent:
                _check_averaged(f"layers[{i}].coherent", layer.thickness_nm, layer.index, self.wavelength_nm)
        return self


class Ridge(Strict):
    """A ridge within a lamellar layer: where it starts along +g, its width, and what it is made of."""

    start_nm: Thickness
    width_nm: Length
    index: Index


class LamellarLayer(Strict):
    """A layer whose index changes along g only: `index` with ridges in it that don't overlap.

    `coherent: false` averages the fringes of a layer without ridges, as for one that is uneven by wavelengths.
    """

    thickness_nm: Thickness
    index: Index
    ridges: list[Ridge] = []
    coherent: bool = True


class LamellarStack(_Periodic):
    """Any stack of lamellar layers with a common period, listed from the light side; `electric_axis` as above."""

    kind: Literal["lamellar"]
    layers: Annotated[list[LamellarLayer], Field(min_length=1)]
    surroundings: Surroundings = Surroundings()

    @model_validator(mode="after")
    def _ridges_fit(self) -> LamellarStack:
        near = _ROUNDING * self.period_nm
        for i, layer in enumerate(self.layers):
            end = 0.0
            if layer.ridges and not layer.coherent:
                raise ValueError(f"layers[{i}].coherent = false: must be true for a layer with ridges")
            if not layer.coherent:
                _check_averaged(f"layers[{i}].coherent", layer.thickness_nm, layer.index, self.wavelength_nm)
            for j, ridge in enumerate(layer.ridges):
                where = f"layers[{i}].ridges[{j}]"
                if ridge.start_nm < end - near:
                    raise ValueError(f"{where}.start_nm = {ridge.start_nm:g}: must be at least {end:g}")
                end = ridge.start_nm + ridge.width_nm
                if end > self.period_nm + near:
                    raise ValueError(f"{where} ends at {end:g}, beyond period_nm = {self.period_nm:g}")
        return self


def as_stack(cell: Metagrating | LamellarStack) -> LamellarStack:
    """The cell as a stack of lamellar layers. InputError for rounded corners: see `optics.cells.outline.staircase`."""
    if isinstance(cell, LamellarStack):
        return cell
    if cell.corner_radius_nm > 0:
        raise InputError(f"{cell.name}: corner_radius_nm = {cell.corner_radius_nm:g}: must be 0 for a lamellar layer")
    ridges = [Ridge(start_nm=start, width_nm=width, index=cell.index) for start, width in cell.ridges_nm]
    front = Index(n=cell.surroundings.front)
    return LamellarStack(
        kind="lamellar", name=cell.name, wavelength_nm=cell.wavelength_nm, electric_axis=cell.electric_axis,
        period_nm=cell.period_nm, surroundings=cell.surroundings,
        layers=[
            LamellarLayer(thickness_nm=cell.ridge_height_nm, index=front, ridges=ridges),
            LamellarLayer(thickness_nm=cell.membrane_nm, index=cell.index, coherent=cell.membrane_coherent),
        ],
    )


class Polygon(Strict):
    """A polygon of one material; vertices [g, n] in nm, either way round."""

    index: Index
    vertices_nm: Annotated[list[Pair], Field(min_length=3)]


class Profile(_Periodic):
    """Any cross-section: polygons in 0 … period along g and 0 … depth along n, later ones over earlier ones.

    n = 0 is the plane that the light reaches first; what no polygon covers has the index in front. A polygon across
    the edge of the period is given in two parts.
    """

    kind: Literal["profile"]
    depth_nm: Length
    polygons: Annotated[list[Polygon], Field(min_length=1)]
    surroundings: Surroundings = Surroundings()

    @model_validator(mode="after")
    def _polygons_fit(self) -> Profile:
        for i, polygon in enumerate(self.polygons):
            for j, (g, n) in enumerate(polygon.vertices_nm):
                if not (0 <= g <= self.period_nm and 0 <= n <= self.depth_nm):
                    raise ValueError(
                        f"polygons[{i}].vertices_nm[{j}] = [{g:g}, {n:g}]: must lie within 0 … {self.period_nm:g} by "
                        f"0 … {self.depth_nm:g}"
                    )
        return self


Cell = Metagrating | ThinFilm | LamellarStack | Profile


def is_coherent(cell: Cell) -> bool:
    """Are all layers of the cell coherent."""
    if isinstance(cell, Metagrating):
        return cell.membrane_coherent
    return isinstance(cell, Profile) or all(layer.coherent for layer in cell.layers)


def require_coherent(cell: Cell, solver: str) -> None:
    """InputError where a layer's fringes are averaged, for solvers that know fields alone."""
    if not is_coherent(cell):
        field = "membrane_coherent" if isinstance(cell, Metagrating) else "coherent"
        raise InputError(f"{cell.name}: {field} = false: must be true for {solver}; optics.modal averages fringes")


KINDS: dict[str, type[Cell]] = {
    "metagrating": Metagrating, "thin_film": ThinFilm, "lamellar": LamellarStack, "profile": Profile,
}


def read_cell(path: str | Path, wavelength_nm: float | None = None) -> Cell:
    """The cell described by a YAML file; InputError names the file, the field and what is allowed.

    `wavelength_nm` replaces the file's own wavelength, as for a sail that moves away from its laser. An index may be
    dispersive: `index: {table: [[wavelength_nm, n, k], ...]}`, interpolated linearly.
    """
    data = read_mapping(path)
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        given = f"kind = {brief(kind)}: must be" if "kind" in data else "missing kind,"
        raise InputError(f"{path}: {given} one of {', '.join(KINDS)}")
    if wavelength_nm is not None:
        data["wavelength_nm"] = wavelength_nm
    return validate(_resolved(data, data.get("wavelength_nm"), path, ""), KINDS[kind], path)


def _resolved(data: Any, wavelength: Any, path: str | Path, where: str) -> Any:
    """The data with every index table replaced by its n and k at the wavelength."""
    if isinstance(data, list):
        return [_resolved(item, wavelength, path, f"{where}[{i}]") for i, item in enumerate(data)]
    if not isinstance(data, dict):
        return data
    if set(data) == {"table"} and where.rsplit(".", 1)[-1] == "index":
        return _interpolated(data["table"], wavelength, f"{path}: {where}.table")
    below = f"{where}." if where else ""
    return {key: _resolved(item, wavelength, path, f"{below}{key}") for key, item in data.items()}


def _interpolated(table: Any, wavelength: Any, where: str) -> dict[str, float]:
    """N and k at a wavelength, from rows [wavelength, n, k]."""
    try:
        rows = np.asarray(table, float)
    except (TypeError, ValueError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) < 2 or np.any(np.diff(rows[:, 0]) <= 0):
        raise InputError(f"{where}: must be two or more rows [wavelength_nm, n, k] with ascending wavelengths")
    if not isinstance(wavelength, int | float) or not rows[0, 0] <= wavelength <= rows[-1, 0]:
        raise InputError(f"{where}: wavelength_nm = {wavelength}: must be within {rows[0, 0]:g} … {rows[-1, 0]:g}")
    n, k = (float(np.interp(wavelength, rows[:, 0], column)) for column in rows.T[1:])
    return {"n": n, "k": k}


def read_metagrating(path: str | Path) -> Metagrating:
    """Like `read_cell`, for stages that take gratings only."""
    cell = read_cell(path)
    if not isinstance(cell, Metagrating):
        raise InputError(f"{path}: kind = {cell.kind!r}: must be metagrating; use optics.thin_film for films")
    return cell
