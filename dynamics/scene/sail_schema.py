"""The sail of a scene file: its shape, its mesh, and the regions it is made of."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from beamrider.io.files import DIMENSIONLESS, Name, Number, Pair, Strict
from dynamics.scene.materials import MATERIALS, Fraction, Material

MOST_RINGS = 1000
SHALLOWEST = 1e-9  # least depth of a curved profile, whose focal length has a square
Metres = Annotated[float, Field(ge=1e-9, le=1e9)]
Thickness = Annotated[float, Field(ge=1e-12, le=1e3)]
Angle = Annotated[float, Field(ge=0, lt=360)]


class Region(Strict):
    """A part of the sail of one material, thickness and optical response.

    The optical response is either a pressure table of `design`, or constant `reflectance` and the material's
    absorptance.
    """

    material: str | Material
    """Name of a material of the library (`dynamics/scene/materials.py`), or a material in full."""
    thickness_m: Thickness | None = None
    """Thickness of the plain film of equal mass, in place of the material's; it must not contradict a design's own."""
    membrane_m: Thickness | None = None
    """Thickness that carries tension and heat in the sail's plane.

    Null for that of all that is continuous in the design, or for a plain film.
    """
    design: Name | None = None
    """Design whose pressure table the region responds with."""
    reflectance: Fraction | None = None
    """Constant reflectance of a region without a design."""
    g: Annotated[
        Pair | Literal["radial", "-radial", "tangential", "-tangential"], Field(json_schema_extra=DIMENSIONLESS)
    ] = [1.0, 0.0]
    """Direction across the ridges (for a film it only labels the axes): a unit vector fixed in the body's x and y.

    Or 'radial' (outward), 'tangential' (counter-clockwise seen from +z) or the negatives of these, in each triangle
    projected into its plane.
    """

    @model_validator(mode="after")
    def _consistent(self) -> Region:
        if isinstance(self.material, str) and self.material not in MATERIALS:
            raise ValueError(f"material = '{self.material}': must be one of {', '.join(MATERIALS)}, or given in full")
        if (self.design is None) == (self.reflectance is None):
            raise ValueError("give either design (a pressure table) or reflectance (constant), not both")
        if self.design is None and self.properties.thickness_m is None:
            raise ValueError("thickness_m: must be given, in the material or beside it, where there is no design")
        if not isinstance(self.g, str) and not math.isclose(math.hypot(*self.g), 1.0, rel_tol=1e-9):
            raise ValueError(f"g = {self.g}: must be a unit vector")
        return self

    @property
    def given_m(self) -> float | None:
        """Thickness in m that the scene gives, beside the material or in one that it gives in full."""
        if self.thickness_m is None and isinstance(self.material, Material):
            return self.material.thickness_m
        return self.thickness_m

    @property
    def nominal_m(self) -> float | None:
        """Nominal thickness in m of a material of the library."""
        return MATERIALS[self.material].thickness_m if isinstance(self.material, str) else None

    @property
    def properties(self) -> Material:
        """The region's material, at its thickness: that of a design is known in scenes from `designs.designed`."""
        material = MATERIALS[self.material] if isinstance(self.material, str) else self.material
        return material.model_copy(update={"thickness_m": self.given_m or self.nominal_m})

    @property
    def carries_m(self) -> float:
        """Thickness in m that carries tension and heat in the plane."""
        return self.membrane_m or self.properties.thickness_m or math.nan

    @property
    def fixed(self) -> Pair | None:
        """The direction across the ridges in the body's x and y, None where it differs from place to place."""
        return None if isinstance(self.g, str) else self.g


class Sector(Region):
    """A region from its starting polar angle to the start of the next sector."""

    from_deg: Angle
    """Polar angle at which it starts, from x towards y; those of a list ascend."""


def _ascending(sectors: list[Sector]) -> None:
    starts = [sector.from_deg for sector in sectors]
    if any(b <= a for a, b in itertools.pairwise(starts)):
        raise ValueError(f"sectors: from_deg must ascend, not {starts}")


class Rim(Strict):
    """Sectors of their own from a distance from the axis on, instead of those within."""

    from_m: Metres
    """Distance from the axis from which on they count."""
    sectors: Annotated[list[Sector], Field(min_length=1)]
    """The sectors out there."""

    @model_validator(mode="after")
    def _consistent(self) -> Rim:
        _ascending(self.sectors)
        return self


class Grid(Strict):
    """Regions in cells between ascending cuts in x and y, laid over the sectors."""

    x_m: list[Number] = []
    """Cuts in x, ascending."""
    y_m: list[Number] = []
    """Cuts in y, ascending."""
    regions: list[list[Region | None]]
    """A row for each interval of y, with one entry more than there are cuts in x; null leaves a cell to the sectors."""

    @model_validator(mode="after")
    def _consistent(self) -> Grid:
        for name, cuts in (("x_m", self.x_m), ("y_m", self.y_m)):
            if any(b <= a for a, b in itertools.pairwise(cuts)):
                raise ValueError(f"{name}: cuts must ascend, not {cuts}")
        rows, columns = len(self.y_m) + 1, len(self.x_m) + 1
        if [len(row) for row in self.regions] != [columns] * rows:
            raise ValueError(f"regions: must be {rows} rows (intervals of y) of {columns} entries (intervals of x)")
        return self


class Sail(Strict):
    """The shape of a sail, its mesh, and its regions."""

    outline: Literal["round", "hexagonal", "square"] = "round"
    """Outline seen along the beam."""
    profile: Literal["flat", "paraboloid", "cone", "sphere"] = "flat"
    """Shape along the beam."""
    surface: Literal["smooth", "faceted"] = "smooth"
    """On polygons: the nodes lie on the surface of revolution ('smooth') or rings are plane ('faceted')."""
    depth: Annotated[float, Field(ge=-100, le=100, json_schema_extra=DIMENSIONLESS)] | None = None
    """Setting α of curved profiles, and for them only, apex downstream; negative turns the sail round."""
    rescale: bool = False
    """Stretch a curved sail until its rim has the radius given."""
    radius_m: Metres
    """Radius of the disc, centre to corner of the hexagon, half the width of the square.

    Of curved sails along the slope, more or less, unless `rescale` is true.
    """
    rings: Annotated[int, Field(ge=1, le=MOST_RINGS, json_schema_extra={"unit": "rings"})]
    """Rings of triangles of the mesh."""
    rotation_deg: Annotated[float, Field(ge=-1e9, le=1e9)] = 0.0
    """Angle by which the mesh is turned about z."""
    sectors: Annotated[list[Sector], Field(min_length=1)]
    """Sectors, each up to the start of the next; the last one up to the start of the first."""
    rim: Rim | None = None
    """Other sectors towards the rim."""
    grid: Grid | None = None
    """Regions in x and y, over the sectors."""

    @model_validator(mode="after")
    def _consistent(self) -> Sail:
        _ascending(self.sectors)
        if (self.depth is None) != (self.profile == "flat"):
            raise ValueError("depth: must be given for curved profiles, and for them only")
        if 0.0 < abs(self.depth or 0.0) < SHALLOWEST:
            raise ValueError(f"depth = {self.depth:g}: must be 0 or at least {SHALLOWEST:g}, up or down")
        if self.profile == "sphere" and not 0 < abs(self.depth or 0.0) <= 0.8:
            raise ValueError(f"depth = {self.depth}: must be from -0.8 to 0.8 and not 0 for a sphere")
        return self

    @property
    def regions(self) -> list[Region]:
        """All regions: the sectors, those of the rim, those of the grid row by row."""
        rim = self.rim.sectors if self.rim is not None else []
        rows = self.grid.regions if self.grid is not None else []
        return [*self.sectors, *rim, *(region for row in rows for region in row if region is not None)]

    @property
    def beyond_rigid(self) -> str | None:
        """What keeps the sail from the rigid model, which flies flat round sails of sectors; None if nothing does."""
        for name, plain in (("outline", "round"), ("profile", "flat"), ("rim", None), ("grid", None)):
            value = getattr(self, name)
            if value != plain:
                return f"{name} = '{value}'" if isinstance(value, str) else name
        special = [f"sectors[{i}].g = '{s.g}'" for i, s in enumerate(self.sectors) if isinstance(s.g, str)]
        return special[0] if special else None

    @property
    def designs(self) -> list[str]:
        """Names of the designs whose pressure tables the sail needs, in order of first use."""
        return list(dict.fromkeys(s.design for s in self.regions if s.design))
