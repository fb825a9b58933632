"""What the stated errors of pressure tables do to a motion: the largest met on the way, and its share of the thrust."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats
from dynamics.light import spots
from dynamics.sail.masses import designed
from dynamics.sail.mesh import Mesh
from dynamics.sail.regions import directions
from dynamics.sail.sectors import SectorShape, sail_shape
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable

_MOST_ROWS, _MOST_FRAMES = 2000, 200  # of a flight that are looked at
_RADII, _ANGLES = 6, 12  # places in a sector


@dataclass(frozen=True)
class Seen:
    """What p places of one region see at n moments: k·g, k·r, k·n (n, p) of the light, and its power (n, p) on them.

    The power may be in any unit. design: of the region's table; where it has none its reflectance counts.
    """

    design: str | None
    reflectance: float
    u: Floats
    v: Floats
    w: Floats
    power: Floats


@dataclass(frozen=True)
class TableErrors:
    """Errors of the tables along a motion.

    largest: stated error of q, of the table of `design` at direction `at`; 0 where no table was read. share: largest
    error of the force over the thrust of any moment, were q everywhere as wrong as stated, and all to one side. missed:
    designs whose tables missed their tolerance.
    """

    largest: float
    design: str
    at: tuple[float, float]
    share: float
    missed: tuple[str, ...]

    def attributes(self) -> dict[str, Any]:
        """As attributes of a file."""
        return {
            "table_error_largest": self.largest,
            "table_error_design": self.design,
            "table_error_at": list(self.at),
            "force_error_over_thrust": self.share,
            "tables_missed": ", ".join(self.missed),
        }

    @property
    def text(self) -> str:
        """In words, empty where no table was read."""
        if not self.design:
            return ""
        return (
            f"tables err by at most {self.largest:.2g}, the force by {self.share:.2g} of the thrust"
            f"{said_missed(self.missed)}"
        )


def missed(tables: Mapping[str, PressureTable]) -> tuple[str, ...]:
    """Designs whose tables missed their tolerance."""
    return tuple(name for name, table in tables.items() if not table.attrs.get("tolerance_met", 1))


def said_missed(names: Iterable[str]) -> str:
    """The end of a line that names tables which missed their tolerance; empty if none did."""
    names = tuple(names)
    return f"; table of {', '.join(names)} MISSED its tolerance" if names else ""


def collect(seen: Iterable[Seen], tables: Mapping[str, PressureTable], polarised: bool = False) -> TableErrors:
    """Errors of all that is seen, at the same moments. `polarised`: in whichever polarisation they are largest."""
    largest, design, at = 0.0, "", (0.0, 0.0)
    error: Floats | float = 0.0
    thrust: Floats | float = 0.0
    for one in seen:
        if one.design is None:
            thrust = thrust + (one.power * 2.0 * one.reflectance * one.w).sum(axis=-1)
            continue
        table = tables[one.design]
        stated = table.stated_error(one.u, one.v, polarised)
        error = error + (one.power * stated).sum(axis=-1)
        thrust = thrust + (one.power * table.q(*table.nearest(one.u, one.v))[..., 2]).sum(axis=-1)
        if stated.size and stated.max() > largest:
            i = np.unravel_index(int(stated.argmax()), stated.shape)
            largest, design, at = float(stated[i]), one.design, (float(one.u[i]), float(one.v[i]))
    if not design:
        return TableErrors(0.0, "", at, 0.0, missed(tables))
    lit = np.asarray(error) > 0.0
    share = np.asarray(error)[lit] / np.abs(np.asarray(thrust)[lit])
    return TableErrors(largest, design, at, float(share.max(initial=0.0)), missed(tables))


def _yaw_blind(normal: Floats) -> Floats:
    """Direction (..., 3) of the light by the lab pitch and roll of a normal (..., 3), as the published runs take it.

    With sin θ = n_x and tan φ = −n_y/n_z it is (−sin θ cos φ, sin φ, cos θ cos φ).
    """
    flat = np.hypot(normal[..., 1], normal[..., 2])
    return np.stack([-normal[..., 0] * normal[..., 2] / flat, -normal[..., 1] / flat, normal[..., 2]], axis=-1)


def _spread(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` of `count` things, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def rigid_errors(scene: Scene, tables: dict[str, PressureTable], position: Floats, turn: Floats) -> TableErrors:
    """Along a rigid flight with its centre of mass at position (n, 3) in m and rotations (n, 3, 3) from body to lab."""
    shape, some = sail_shape(designed(scene, tables).sail), _spread(len(position), _MOST_ROWS)
    turn = turn[some]
    position = position[some] - turn[:, :, :2] @ shape.centre
    k = _yaw_blind(turn[:, :, 2]) if scene.incidence == "yaw_blind" else turn[:, 2]
    return collect(
        (_sector_seen(scene, sector, position, turn, k) for sector in shape.sectors),
        tables,
        scene.beam.polarisation != "sail",
    )


def _sector_seen(scene: Scene, sector: SectorShape, position: Floats, turn: Floats, k: Floats) -> Seen:
    """What a sector of a rigid sail sees: one direction, and the power on it by midpoints in radius² and angle."""
    radius = sector.radius * np.sqrt((np.arange(_RADII) + 0.5) / _RADII)
    angle = sector.start + (sector.stop - sector.start) * (np.arange(_ANGLES) + 0.5) / _ANGLES
    points = np.stack([np.outer(radius, f(angle)).ravel() for f in (np.cos, np.sin)], axis=-1)
    lateral = position[:, None, :2] + np.einsum("nij,pj->npi", turn[:, :2, :2], points)
    light = spots.share(scene.beam.spots, lateral[..., 0], lateral[..., 1]).mean(axis=1)
    u, v = (k[:, :2] @ axis for axis in (sector.g, sector.r))
    power = (light * sector.area * turn[:, 2, 2])[:, None]
    return Seen(sector.design, sector.reflectance, u[:, None], v[:, None], k[:, 2, None], power)


def membrane_errors(
    scene: Scene, tables: Mapping[str, PressureTable], mesh: Mesh, points: Sequence[Floats]
) -> TableErrors:
    """Along a flexible flight with its nodes at `points` (n, 3) in m of each snapshot; some of them are looked at."""
    frames = [_triangles_seen(scene, mesh, points[i]) for i in _spread(len(points), _MOST_FRAMES)]
    u, v, w, power = np.moveaxis(np.array(frames).reshape(-1, 4, len(mesh.triangles)), 1, 0)
    return collect(
        (
            Seen(region.design, region.reflectance or 0.0, *(part[:, mesh.sector == i] for part in (u, v, w, power)))
            for i, region in enumerate(scene.sail.regions)
        ),
        tables,
        scene.beam.polarisation != "sail",
    )


def _triangles_seen(scene: Scene, mesh: Mesh, nodes: Floats) -> Floats:
    """k·g, k·r, k·n and power (4, t) of the triangles with their nodes (n, 3) in m."""
    a, b, c = np.moveaxis(nodes[mesh.triangles], 1, 0)
    across = np.cross(b - a, c - a)
    double = np.linalg.norm(across, axis=1)
    normal, first = across / double[:, None], (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    if scene.incidence == "yaw_blind":
        g = directions(mesh.nodes[mesh.triangles].mean(axis=1), mesh.sector, scene.sail)
        k = _yaw_blind(normal)
        u, v = k[:, 0] * g[:, 0] + k[:, 1] * g[:, 1], k[:, 1] * g[:, 0] - k[:, 0] * g[:, 1]
    else:
        aside = np.cross(normal, first)[:, 2]
        u = first[:, 2] * mesh.cos_across + aside * mesh.sin_across
        v = aside * mesh.cos_across - first[:, 2] * mesh.sin_across
    lateral = (a + b + c)[:, :2] / 3.0
    light = spots.share(scene.beam.spots, lateral[:, 0], lateral[:, 1])
    return np.stack([u, v, normal[:, 2], light * 0.5 * double * np.abs(normal[:, 2])])
