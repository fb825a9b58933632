"""The flat sail as sectors: areas, mass, inertia, frames, and the optical response of each sector.

Body frame: the sail lies in z = 0, its normal n = +z points downstream. A sector has g (across the ridges) and
r = n × g (along them), so that g × r = n:

          y
          │  r = −x ← sector g = +y          seen against +z
          │
    ──────┼────── x   sector g = +x, r = +y
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.sail.attitude import rotation_from_angles
from dynamics.scene import schema as scenes
from optics.table.pressure_table import OutsideTable, PressureTable


@dataclass(frozen=True)
class SectorShape:
    """One sector: polar angles `start` < `stop` in rad, radius in m, areal mass in kg/m², g and r (2,) in body x, y.

    `design` names a pressure table; without one the sector reflects and absorbs the constant fractions given.
    """

    start: float
    stop: float
    radius: float
    areal_mass: float
    g: Floats
    design: str | None
    reflectance: float
    absorptance: float

    @property
    def r(self) -> Floats:
        """Direction (2,) along the ridges, n × g, in body x, y."""
        return np.array([-self.g[1], self.g[0]])

    @property
    def area(self) -> float:
        """Area in m²."""
        return 0.5 * self.radius**2 * (self.stop - self.start)

    @property
    def first_moment(self) -> Floats:
        """(∫X dA, ∫Y dA), (2,), in m³."""
        a, b = self.start, self.stop
        return self.radius**3 / 3.0 * np.array([np.sin(b) - np.sin(a), np.cos(a) - np.cos(b)])

    @property
    def second_moment(self) -> Floats:
        """[[∫X² dA, ∫XY dA], [∫XY dA, ∫Y² dA]], (2, 2), in m⁴."""
        a, b = self.start, self.stop
        span, double = b - a, 0.5 * (np.sin(2 * b) - np.sin(2 * a))
        mixed = np.sin(b) ** 2 - np.sin(a) ** 2
        return self.radius**4 / 8.0 * np.array([[span + double, mixed], [mixed, span - double]])


@dataclass(frozen=True)
class SailShape:
    """A flat round sail made of sectors. Moments follow from each sector's areal mass by closed formulas."""

    radius: float
    sectors: tuple[SectorShape, ...]

    @property
    def diameter(self) -> float:
        """Diameter in m."""
        return 2.0 * self.radius

    @property
    def mass(self) -> float:
        """Mass in kg."""
        return float(sum(s.areal_mass * s.area for s in self.sectors))

    @property
    def centre(self) -> Floats:
        """Centre of mass (2,) in m from the middle of the disc."""
        return np.asarray(sum(s.areal_mass * s.first_moment for s in self.sectors) / self.mass)

    @property
    def inertia(self) -> Floats:
        """Inertia tensor (3, 3) about the centre of mass in kg m². A thin lamina: I_zz = I_xx + I_yy.

        Goldstein, Classical Mechanics, §5.3; moved to the centre of mass by the parallel axis theorem.
        """
        moment = sum(s.areal_mass * s.second_moment for s in self.sectors)
        moment = moment - self.mass * np.outer(self.centre, self.centre)
        tensor = np.zeros((3, 3))
        tensor[:2, :2] = np.trace(moment) * np.eye(2) - moment
        tensor[2, 2] = np.trace(moment)
        return tensor


def sail_shape(sail: scenes.Sail) -> SailShape:
    """The sectors of a scene's sail; a sector ends where the next one starts, the last one where the first does.

    InputError where the sail is more than a flat disc of sectors.
    """
    if sail.beyond_rigid is not None:
        raise InputError(f"sail.{sail.beyond_rigid}: the rigid model flies flat round sails of plain sectors only")
    starts = [np.radians(sector.from_deg) for sector in sail.sectors]
    stops = [*starts[1:], starts[0] + 2.0 * np.pi]
    shapes = []
    for i, (sector, start, stop) in enumerate(zip(sail.sectors, starts, stops, strict=True)):
        material = sector.properties
        reflectance = sector.reflectance or 0.0
        if sector.design is None and reflectance + material.absorptance > 1.0:
            raise InputError(
                f"sail.sectors[{i}].reflectance = {reflectance:g}: with the material's absorptance "
                f"{material.absorptance:g} it must not exceed 1"
            )
        shapes.append(
            SectorShape(
                start,
                stop,
                sail.radius_m,
                material.areal_mass,
                np.array(sector.g),
                sector.design,
                reflectance,
                material.absorptance,
            )
        )
    return SailShape(sail.radius_m, tuple(shapes))


def load_tables(given: Iterable[str | Path | PressureTable], scene: scenes.Scene) -> dict[str, PressureTable]:
    """The pressure table of each design of the scene, in the scene's order of designs, from files or as they are.

    A file belongs to the design its attribute `name` says. InputError when a file can't be read, belongs to no design
    of the scene, comes twice, was made for another wavelength than the others, or when a design has none.
    """
    found: dict[str, tuple[str, PressureTable]] = {}
    for one in given:
        table = one if isinstance(one, PressureTable) else PressureTable.read(one)
        path = "a table" if isinstance(one, PressureTable) else str(one)
        if table.name not in scene.sail.designs:
            allowed = ", ".join(scene.sail.designs) or "none: no sector has a design"
            raise InputError(
                f"{path}: name = '{table.name}': not a design of scene '{scene.name}' (allowed: {allowed})"
            )
        if table.name in found:
            raise InputError(
                f"{path}: name = '{table.name}': {found[table.name][0]} is already the table of that design"
            )
        found[table.name] = (path, table)
    missing = [design for design in scene.sail.designs if design not in found]
    if missing:
        these = ", ".join(f"'{design}'" for design in missing)
        those = ", ".join(f"'{name}' ({path})" for name, (path, _) in found.items()) or "none"
        raise InputError(
            f"{scene.name}.yaml: sail.sectors: no pressure table of design {these} (given: {those}); add its file to "
            "--tables"
        )
    _one_wavelength(found)
    return {design: found[design][1] for design in scene.sail.designs}


def check_release(scene: scenes.Scene, tables: dict[str, PressureTable]) -> None:
    """Refuse a release whose tilt lies outside a table: the flight would end before it began."""
    if scene.outside_table == "clamp":
        return
    release = scene.release
    for design, u, v in release_directions(scene):
        try:
            tables[design].q(u, v)
        except OutsideTable:
            raise InputError(
                f"{scene.name}.yaml: release.pitch_deg = {release.pitch_deg:g}, roll_deg = {release.roll_deg:g}: light "
                f"from u = {u:.4g}, v = {v:.4g} is outside table '{design}' (allowed {tables[design].limits}); tilt "
                "less, make a wider table or set outside_table: clamp"
            ) from None


def release_directions(scene: scenes.Scene) -> Iterator[tuple[str, float, float]]:
    """Design and direction cosines u, v of the light, at release, of each sector of a flat sail that has a design."""
    release = scene.release
    turn = rotation_from_angles(np.radians(release.roll_deg), np.radians(release.pitch_deg), 0.0)
    for sector in scene.sail.sectors if scene.sail.profile == "flat" else ():
        if sector.design is not None and sector.fixed is not None:
            along = np.array([-sector.fixed[1], sector.fixed[0]])
            yield sector.design, float(turn[2, :2] @ sector.fixed), float(turn[2, :2] @ along)


def check_place(scene: scenes.Scene, place: Floats) -> None:
    """Refuse a centre of mass (2,) at release that is as far from the axis as where flights end."""
    away = float(np.hypot(*place))
    if away >= scene.fly_away:
        raise InputError(
            f"{scene.name}.yaml: release.offset_m = {scene.release.offset_m}: the centre of mass is {away:g} m from "
            f"the axis: must be below {scene.fly_away:g} m, where a flight ends; release it nearer or set "
            "flight.fly_away_m"
        )


def _one_wavelength(found: dict[str, tuple[str, PressureTable]]) -> None:
    """Refuse tables of different wavelengths: one beam lights the whole sail."""
    known = [(path, wavelength(table)) for path, table in found.values() if wavelength(table) is not None]
    for path, value in known[1:]:
        if not math.isclose(value, known[0][1], rel_tol=1e-9):
            raise InputError(
                f"{path}: wavelength_m = {value:g}: must be {known[0][1]:g}, as in {known[0][0]}: "
                "one beam lights the whole sail"
            )


def require_own_polarisation(scene: scenes.Scene, stage: str) -> None:
    """Refuse a beam whose polarisation doesn't turn with the sail, for the stages that know no other."""
    if scene.beam.polarisation != "sail":
        raise InputError(
            f"{scene.name}.yaml: beam.polarisation = '{scene.beam.polarisation}': must be 'sail' for {stage}; rigid "
            "flight knows the others"
        )


def wavelength(table: PressureTable) -> Any:
    """Wavelength in m that a table was made for, None where it doesn't say."""
    return table.attrs.get("wavelength_m")


def provenance(tables: dict[str, PressureTable]) -> dict[str, dict[str, Any]]:
    """For each design: which solver made its table, and the digest of its numbers."""
    return {
        design: {"solver": str(table.attrs.get("solver", "unknown")), "digest": table.digest}
        for design, table in tables.items()
    }
