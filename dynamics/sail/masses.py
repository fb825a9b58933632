"""What a design says of the regions that are made of it: mass, and what carries tension and heat in the plane.

A region is of one material. Its areal mass is density × cross-section of the cell, ridges and membrane alike, and so is
its heat capacity. In the plane it is an isotropic membrane as thick as all that is continuous in the cell: ridges are
cut off from one another across g, where they carry next to nothing, so that tension and heat go through what is below
them. Along r they would carry their share; what is said of strains is on the safe side there. Films are continuous.
Published runs took the plain film of equal mass instead (`flight.in_plane: mass_equivalent`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

from beamrider.io.files import InputError
from dynamics.scene.sail_schema import Grid, Region, Rim, Sail
from dynamics.scene.schema import Scene
from optics.cells.cross_section import Section
from optics.table.pressure_table import PressureTable

#: Share by which a thickness given in the scene may differ from that of the design: it may be rounded to three digits.
AGREES = 1e-3


def designed(scene: Scene, tables: dict[str, PressureTable]) -> Scene:
    """The scene with the thicknesses of every region, from the tables of its designs.

    InputError where a thickness contradicts the design, or where it takes one that is not given.
    """

    def known(where: str, region: Region) -> Region:
        section = tables[region.design].section if region.design in tables else None
        try:
            return _known(region, section, scene.flight.in_plane == "membrane")
        except ValueError as refusal:
            raise InputError(f"{scene.name}.yaml: sail.{where}.{refusal}") from None

    return scene.model_copy(update={"sail": _each(scene.sail, known)})


def _known(region: Region, section: Section | None, membrane: bool) -> Region:
    """The region with its thicknesses; ValueError where they are contradicted or missing."""
    mean = _mean(region, section)
    carries = region.membrane_m
    if carries is None:
        carries = _continuous(region, section, mean) if membrane and section else mean
    if carries > mean * (1.0 + AGREES):
        raise ValueError(f"membrane_m = {carries:g}: must be at most {mean:.6g}, the thickness of all of the solid")
    return region.model_copy(update={"thickness_m": mean, "membrane_m": carries})


def _mean(region: Region, section: Section | None) -> float:
    """Thickness in m of the plain film of equal mass; as given where that agrees with the design's."""
    given = region.given_m
    if section is None or (given is not None and section.materials > 1):
        found = given if given is not None else region.nominal_m
        if found is None:
            raise ValueError(
                f"thickness_m: must be given, as the table of design '{region.design}' does not hold its cell"
            )
        return found
    if section.materials > 1:
        raise ValueError(
            f"thickness_m: must be given: design '{region.design}' is of {section.materials} materials, a region of "
            "one; give the areal mass over the density of the region's material"
        )
    if given is None:
        return section.mean_m
    if not math.isclose(given, section.mean_m, rel_tol=AGREES):
        raise ValueError(
            f"thickness_m = {given:g}: must be {section.mean_m:.6g} m, the cross-section of design '{region.design}' "
            "over its period; leave it out"
        )
    return given


def _continuous(region: Region, section: Section, mean: float) -> float:
    """Thickness in m of what is continuous, in proportion where the scene's thickness stands for several materials."""
    if section.membrane_m == 0.0:
        raise ValueError(
            f"membrane_m: must be given: nothing in design '{region.design}' is continuous across its ridges"
        )
    return section.membrane_m * (mean / section.mean_m if section.materials > 1 else 1.0)


def _each(sail: Sail, change: Callable[[str, Region], Region]) -> Sail:
    """The sail with every region changed; `change` is told where in the scene it stands."""

    def all_of(where: str, regions: list) -> list:
        return [change(f"{where}[{i}]", region) if region is not None else None for i, region in enumerate(regions)]

    update: dict[str, object] = {"sectors": all_of("sectors", sail.sectors)}
    if isinstance(sail.rim, Rim):
        update["rim"] = sail.rim.model_copy(update={"sectors": all_of("rim.sectors", sail.rim.sectors)})
    if isinstance(sail.grid, Grid):
        rows = [all_of(f"grid.regions[{i}]", row) for i, row in enumerate(sail.grid.regions)]
        update["grid"] = sail.grid.model_copy(update={"regions": rows})
    return sail.model_copy(update=update)
