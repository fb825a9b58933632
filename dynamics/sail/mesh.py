"""The triangulated sail: nodes, triangles, edges, sectors and the direction across the ridges.

    python -m dynamics.mesh --scene workflow/scenes/s3.yaml --out mesh.vtkhdf

writes the mesh for ParaView. Triangles run counter-clockwise seen from +z (downstream), so that normals point to +z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers
from dynamics.sail.regions import directions, region_of
from dynamics.sail.shapes import reference_node, shape_nodes, shape_triangles
from dynamics.scene.sail_schema import Sail


@dataclass(frozen=True)
class Mesh:
    """A sail at rest: nodes (n, 3) in m, triangles (t, 3) of node indices, sector (t,), ascending: index of its region.

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
    """The mesh of a sail with N rings.

    Round and hexagonal: 1 + 3N + 3N² nodes, 6N² triangles. Square: (2N + 1)² nodes, 8N² triangles.
    """
    nodes, triangles = shape_nodes(sail), shape_triangles(sail)
    region = region_of(nodes[triangles].mean(axis=1), sail)
    order = np.argsort(region, kind="stable")
    triangles, region = triangles[order], region[order]
    across = directions(nodes[triangles].mean(axis=1), region, sail)
    return Mesh(nodes, triangles, region, *across_angle(nodes, triangles, across), reference_node(sail))
