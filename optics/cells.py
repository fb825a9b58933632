"""What a sail's surface is made of: `Metagrating` and `ThinFilm`, read strictly from YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from optics.files import InputError, Name, NonNegative, Pair, Positive, Strict, load_yaml, validate


class Index(Strict):
    """Complex refractive index n + ik (time factor exp(−iωt): k > 0 absorbs)."""

    n: Positive
    k: NonNegative = 0.0

    @property
    def permittivity(self) -> complex:
        """Relative permittivity (n + ik)²."""
        return complex(self.n, self.k) ** 2


class Surroundings(Strict):
    """Real refractive indices of the lossless half-spaces in front of (light side) and behind the cell."""

    front: Positive = 1.0
    back: Positive = 1.0


class Metagrating(Strict):
    """Ridges of one height on a membrane, periodic along g and endless along r. Light falls on the ridges.

    Lengths in nm. `ridges_nm` holds [start, width] along +g within one period. `electric_axis` is the direction of E at
    normal incidence: 'r' (TE) or 'g' (TM).
    """

    kind: Literal["metagrating"]
    name: Name
    wavelength_nm: Positive
    electric_axis: Literal["g", "r"]
    period_nm: Positive
    ridges_nm: Annotated[list[Pair], Field(min_length=1)]
    ridge_height_nm: Positive
    membrane_nm: NonNegative
    index: Index
    surroundings: Surroundings = Surroundings()

    @model_validator(mode="after")
    def _ridges_fit(self) -> Metagrating:
        end = 0.0
        for i, (start, width) in enumerate(self.ridges_nm):
            if width <= 0:
                raise ValueError(f"ridges_nm[{i}] = [{start:g}, {width:g}]: the width must be greater than 0")
            if start < end:
                what = "overlaps the ridge before it" if i else "starts left of the cell"
                raise ValueError(f"ridges_nm[{i}] = [{start:g}, {width:g}] {what}: its start must be at least {end:g}")
            end = start + width
        if end > self.period_nm:
            raise ValueError(f"ridges_nm: the last ridge ends at {end:g}, beyond period_nm = {self.period_nm:g}")
        return self

    @property
    def pitch(self) -> float:
        """λ/d, the step in u between diffraction orders."""
        return self.wavelength_nm / self.period_nm

    @property
    def fill(self) -> float:
        """Share of the period that ridges cover."""
        return sum(width for _, width in self.ridges_nm) / self.period_nm

    @property
    def mean_thickness_nm(self) -> float:
        """Thickness of the plain film of equal mass, in nm."""
        return self.membrane_nm + self.ridge_height_nm * self.fill


class Layer(Strict):
    """One homogeneous layer of a film, listed from the light side."""

    thickness_nm: NonNegative
    index: Index


class ThinFilm(Strict):
    """A stack of homogeneous layers. 'mean' averages s and p (unpolarised light)."""

    kind: Literal["thin_film"]
    name: Name
    wavelength_nm: Positive
    polarisation: Literal["s", "p", "mean"] = "mean"
    layers: Annotated[list[Layer], Field(min_length=1)]
    surroundings: Surroundings = Surroundings()


Cell = Metagrating | ThinFilm
KINDS: dict[str, type[Metagrating] | type[ThinFilm]] = {"metagrating": Metagrating, "thin_film": ThinFilm}


def read_cell(path: str | Path) -> Cell:
    """The cell described by a YAML file; InputError names the file, the field and what is allowed."""
    data = load_yaml(path)
    kind = data.get("kind") if isinstance(data, dict) else None
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"{path}: kind = {kind!r}: must be one of {', '.join(KINDS)}")
    return validate(data, KINDS[kind], path)


def read_metagrating(path: str | Path) -> Metagrating:
    """Like `read_cell`, for stages that take gratings only."""
    cell = read_cell(path)
    if not isinstance(cell, Metagrating):
        raise InputError(f"{path}: kind = {cell.kind!r}: must be metagrating; use optics.thin_film for films")
    return cell
