"""The triangulated sail: nodes, triangles, edges, sectors and the direction across the ridges.

    python -m dynamics.mesh --scene workflow/scenes/s3.yaml --out mesh.vtkhdf

writes the mesh for ParaView. Triangles run counter-clockwise seen from +z (downstream), so that normals point to +z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynamics.command import stage_arguments
from dynamics.scene import Sail, read_scene
from optics.files import run_stage

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Mesh:
    """A sail at rest: nodes (n, 3) in m, triangles (t, 3) of node indices, sector (t,) of each triangle, ascending.

    cos_across, sin_across (t,): direction g across the ridges, stored against the first side ê₁ of the triangle as
    g = ê₁ cos β + (n × ê₁) sin β, so that it follows the deformation. reference_node defines yaw 0 at the release.
    """

    nodes: Floats
    triangles: Integers
    sector: Integers
    cos_across: Floats
    sin_across: Floats
    reference_node: int

    @cached_property
    def _sides(self) -> tuple[Integers, Integers]:
        """Edges (e, 2), and for the sides (01, 12, 20) of each triangle their edge (t, 3)."""
        sides = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, which = np.unique(sides, axis=0, return_inverse=True)
        return edges, which.reshape(-1, 3)

    @property
    def edges(self) -> Integers:
        """Node pairs (e, 2), each with the lower index first, in lexical order."""
        return self._sides[0]

    @property
    def triangle_edges(self) -> Integers:
        """Edges (t, 3) of the sides 01, 12, 20 of each triangle."""
        return self._sides[1]

    @cached_property
    def edge_triangles(self) -> Integers:
        """Triangles (e, 2) beside each edge, the lower index first; −1 where a rim edge has no second one."""
        found = np.full((len(self.edges), 2), -1)
        for triangle, edges in enumerate(self.triangle_edges):
            for edge in edges:
                found[edge, 0 if found[edge, 0] < 0 else 1] = triangle
        return found

    @property
    def rim(self) -> NDArray[np.bool_]:
        """True (e,) for edges with one triangle."""
        return np.asarray(self.edge_triangles[:, 1] < 0)

    @cached_property
    def lengths(self) -> Floats:
        """Rest lengths (e,) of the edges in m."""
        a, b = self.nodes[self.edges.T]
        return np.asarray(np.linalg.norm(b - a, axis=1))

    @cached_property
    def areas(self) -> Floats:
        """Rest areas (t,) of the triangles in m²."""
        return triangle_areas(self.nodes, self.triangles)


def triangle_areas(nodes: Floats, triangles: Integers) -> Floats:
    """Areas (t,) of triangles of nodes (n, 3)."""
    a, b, c = (nodes[triangles[:, i]] for i in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def ring_nodes(radius: float, rings: int, rotation: float = 0.0) -> Floats:
    """Nodes (1 + 3N + 3N², 3) of a flat disc: the centre, then 6n nodes at polar angles 2πj/6n + rotation on ring n."""
    points = [np.zeros((1, 3))]
    for n in range(1, rings + 1):
        angle = 2.0 * np.pi * np.arange(6 * n) / (6 * n) + rotation
        points.append(radius * n / rings * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    return np.concatenate(points)


def _ring_start(n: int) -> int:
    """Index of the first node of ring n."""
    return 1 + 3 * n * (n - 1) if n > 0 else 0


def _stitch(n: int) -> Integers:
    r"""Triangles (6(2n − 1), 3) between ring n − 1 and ring n, sextant by sextant.

    o0──o1──o2──o3    ring n: n + 1 nodes a sextant
      \ / \ / \ /
      i0──i1──i2      ring n − 1: n nodes
    """
    sextant, i = np.divmod(np.arange(6 * n), n)
    inner = _ring_start(n - 1) + ((sextant * (n - 1) + i) % (6 * (n - 1)) if n > 1 else 0 * i)
    inner_next = _ring_start(n - 1) + ((sextant * (n - 1) + i + 1) % (6 * (n - 1)) if n > 1 else 0 * i)
    outer = _ring_start(n) + np.arange(6 * n)
    outer_next = _ring_start(n) + (np.arange(6 * n) + 1) % (6 * n)
    wide = np.stack([inner, outer, outer_next], axis=1)
    narrow = np.stack([inner, outer_next, inner_next], axis=1)[i < n - 1]
    return np.concatenate([wide, narrow])


def polar_sector(points: Floats, starts_deg: list[float]) -> Integers:
    """Sector (t,) of points (t, 3) by polar angle: the last start not above it; below the first start, the last one."""
    angle = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360.0
    return np.asarray((np.searchsorted(starts_deg, angle, side="right") - 1) % len(starts_deg))


def across_angle(nodes: Floats, triangles: Integers, direction: Floats) -> tuple[Floats, Floats]:
    """Cos β and sin β (t,) of `direction` (t, 3), projected into each triangle, against the triangle's first side."""
    a, b, c = (nodes[triangles[:, i]] for i in range(3))
    first = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.sum(direction * first, axis=1)
    aside = np.sum(direction * np.cross(normal, first), axis=1)
    size = np.hypot(along, aside)
    return along / size, aside / size


def sail_mesh(sail: Sail) -> Mesh:
    """The mesh of a round flat sail: 1 + 3N + 3N² nodes, 6N² triangles, 9N² + 3N edges, 6N of them on the rim."""
    nodes = ring_nodes(sail.radius_m, sail.rings, np.radians(sail.rotation_deg))
    triangles = np.concatenate([_stitch(n) for n in range(1, sail.rings + 1)])
    sector = polar_sector(nodes[triangles].mean(axis=1), [s.from_deg for s in sail.sectors])
    order = np.argsort(sector, kind="stable")
    triangles, sector = triangles[order], sector[order]
    across = np.array([[*s.g, 0.0] for s in sail.sectors])[sector]
    cos_across, sin_across = across_angle(nodes, triangles, across)
    return Mesh(nodes, triangles, sector, cos_across, sin_across, _ring_start(sail.rings))


def main() -> None:
    """Write the mesh of a scene's sail for ParaView."""
    arguments = stage_arguments("dynamics.mesh", main.__doc__, "VTKHDF file to write", tables=False)
    from dynamics.flight import write_mesh

    sail = read_scene(arguments.scene).sail
    mesh = sail_mesh(sail)
    thickness = np.array([s.properties.thickness_m for s in sail.sectors])[mesh.sector]
    write_mesh(arguments.out, mesh, {"sector": mesh.sector, "thickness": thickness})


if __name__ == "__main__":
    run_stage(main)
