"""Outlines and profiles of sails: nodes ring by ring from the apex, and the triangles that stitch rings together.

The apex lies downstream at the origin, all else at z ≤ 0: the concave side faces the beam (a negative depth turns that
round). Seed radii x_n of ring n and heights z(r) for nominal radius R, N rings, a = R/N and depth setting α ≥ 0:

    flat        n a                                             0
    paraboloid  x_{n−1} + a ℓ/√(ℓ² + 2x_{n−1}²), ℓ = R/α         −α r²/R
    cone        n a/√(1 + α²)                                   −α r
    sphere      R_s sin(nβ/N), β = π/2 − asin(1 − α), R_s = R/β  −R_s (1 − √(1 − r²/R_s²))
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from beamrider.arrays import Floats, Integers

if TYPE_CHECKING:
    from dynamics.scene.sail_schema import Sail


#: Sides of an outline, and hops on a side of ring n in multiples of n.
SIDES = {"round": (6, 1), "hexagonal": (6, 1), "square": (4, 2)}


def seed_radii(sail: Sail) -> Floats:
    """Radii (n + 1,) in m of the rings, from 0: of the circle, the corners of the hexagon, the half-width."""
    n, radius, depth = np.arange(sail.rings + 1), sail.radius_m, abs(sail.depth or 0.0)
    even = n * radius / sail.rings
    if sail.profile == "flat" or depth == 0:
        return np.asarray(even)
    if sail.profile == "cone":
        return np.asarray(even / np.sqrt(1.0 + depth**2))
    if sail.profile == "sphere":
        ball, arc = _ball(radius, depth)
        return np.asarray(ball * np.sin(n * arc / sail.rings))
    x, focal = np.zeros(sail.rings + 1), radius / depth
    for k in range(sail.rings):
        x[k + 1] = x[k] + radius / sail.rings * focal / np.sqrt(focal**2 + 2.0 * x[k] ** 2)
    return x


def _ball(radius: float, depth: float) -> tuple[float, float]:
    """Radius of the sphere in m and the half angle of its cap, whose arc from apex to rim has length `radius`."""
    arc = np.pi / 2 - np.arcsin(1.0 - depth)
    return radius / arc, arc


def height(sail: Sail, r: Floats) -> Floats:
    """Height z (...) ≤ 0 in m of the profile of |depth| at distance r (...) in m from the axis."""
    depth = abs(sail.depth or 0.0)
    if sail.profile == "flat" or depth == 0:
        return 0.0 * r
    if sail.profile == "paraboloid":
        return -depth * r**2 / sail.radius_m
    if sail.profile == "cone":
        return -depth * r
    ball, _ = _ball(sail.radius_m, depth)
    return np.asarray(-ball * (1.0 - np.sqrt(np.maximum(1.0 - (r / ball) ** 2, 0.0))))


def rim_slope(sail: Sail) -> float:
    """Steepest slope in rad of the profile against the beam's cross-section: that at the rim."""
    depth = abs(sail.depth or 0.0)
    if sail.profile == "flat" or depth == 0:
        return 0.0
    if sail.profile == "sphere":
        return _ball(sail.radius_m, depth)[1]
    steep = depth if sail.profile == "cone" else 2.0 * depth * seed_radii(sail)[-1] / sail.radius_m
    return float(np.arctan(steep))


def _ring(outline: str, n: int, x: float) -> Floats:
    """Points (·, 2) of ring n with seed radius x. Polygons start one hop after the first corner, which comes last."""
    sides, hops = SIDES[outline][0], SIDES[outline][1] * n
    if outline == "round":
        angle = 2.0 * np.pi * np.arange(sides * hops) / (sides * hops)
        return x * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corner = 2.0 * np.pi * (np.arange(sides + 1) - (0.5 if outline == "square" else 0.0)) / sides
    corners = x * (np.sqrt(2.0) if outline == "square" else 1.0) * np.stack([np.cos(corner), np.sin(corner)], axis=1)
    share = np.arange(1, hops + 1)[:, None] / hops
    return np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(corners)])


def shape_nodes(sail: Sail) -> Floats:
    """Nodes (n, 3) in m of a sail at rest: the apex, then ring by ring, turned by its rotation about z."""
    radii = seed_radii(sail)
    rings = [np.zeros((1, 2)), *(_ring(sail.outline, n, radii[n]) for n in range(1, sail.rings + 1))]
    plane = np.concatenate(rings)
    if sail.outline == "round" or sail.surface == "faceted":
        r = np.repeat(radii, [len(ring) for ring in rings])
    else:
        wide = np.sqrt(2.0) if sail.outline == "square" and sail.profile == "sphere" else 1.0
        r = np.linalg.norm(plane, axis=1) / wide
    nodes = np.column_stack([plane, height(sail, r) * (-1.0 if (sail.depth or 0.0) < 0 else 1.0)])
    if sail.rescale:
        nodes *= sail.radius_m / radii[-1]
    return _turned(nodes, np.radians(sail.rotation_deg))


def _turned(nodes: Floats, angle: float) -> Floats:
    """Nodes (n, 3) turned about z by an angle in rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * nodes[:, 0] - s * nodes[:, 1], s * nodes[:, 0] + c * nodes[:, 1], nodes[:, 2]])


def ring_start(outline: str, n: int) -> int:
    """Index of the first node of ring n."""
    sides, hops = SIDES[outline]
    return 1 + sides * hops * n * (n - 1) // 2 if n > 0 else 0


def _on_ring(outline: str, n: int, place: Integers) -> Integers:
    """Nodes (...) of ring n that many hops (...) after its first corner."""
    sides, hops = SIDES[outline]
    if n == 0:
        return 0 * place
    first = 0 if outline == "round" else 1
    return ring_start(outline, n) + (place - first) % (sides * hops * n)


def lattice_points(outline: str, rings: int) -> Integers:
    """Whole coordinates (n, 2) of the nodes in a lattice of triangles, or of squares, whose neighbours are theirs."""
    corners = np.array([(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1), (1, 0)])
    if outline == "square":
        corners = np.array([(1, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)])
    sides, hops = SIDES[outline]
    points = np.zeros((ring_start(outline, rings + 1), 2), dtype=np.int64)
    for n in range(1, rings + 1):
        place = np.arange(sides * hops * n)
        side, j = np.divmod(place, hops * n)
        hop = (corners[1:] - corners[:-1]) // hops
        points[_on_ring(outline, n, place)] = n * corners[side] + j[:, None] * hop[side]
    return points


def _stitch(outline: str, n: int) -> Integers:
    r"""Triangles (·, 3) between ring n − 1 and ring n, side by side.

    o0──o1──o2──o3    ring n                          o0──o1──o2──o3──o4
      \ / \ / \ /                                       \ │ \ │ / │ /     squares: the diagonals
      i0──i1──i2      ring n − 1                         i0──i1──i2       lean to the corners
    """
    sides, hops = SIDES[outline]
    side, j = np.divmod(np.arange(sides * hops * n), hops * n)
    if outline == "square":
        return _stitch_square(n, side, j)
    inner, outer = j + side * (n - 1), j + side * n
    a, b = _on_ring(outline, n - 1, inner), _on_ring(outline, n - 1, inner + 1)
    o, p = _on_ring(outline, n, outer), _on_ring(outline, n, outer + 1)
    return np.concatenate([np.stack([a, o, p], axis=1), np.stack([a, p, b], axis=1)[j < n - 1]])


def _stitch_square(n: int, side: Integers, j: Integers) -> Integers:
    """Triangles (16n − 8, 3) between square rings n − 1 and n: hop j of each side."""

    def ring(m: int, place: Integers) -> Integers:
        return _on_ring("square", m, place + 2 * m * side)

    most = max(2 * n - 2, 0)
    before, here = ring(n - 1, np.clip(j - 1, 0, most)), ring(n - 1, np.clip(j, 0, most))
    o, p = ring(n, j), ring(n, j + 1)
    wide = np.stack([np.where(j < n, here, before), o, p], axis=1)
    inner = (j >= 1) & (j <= 2 * n - 2)
    narrow = np.where((j < n)[:, None], np.stack([before, o, here], axis=1), np.stack([before, p, here], axis=1))
    return np.concatenate([wide, narrow[inner]])


def shape_triangles(sail: Sail) -> Integers:
    """Triangles (t, 3) of node indices, counter-clockwise seen from +z."""
    return np.concatenate([_stitch(sail.outline, n) for n in range(1, sail.rings + 1)])


def reference_node(sail: Sail) -> int:
    """The node whose azimuth defines yaw 0: the first of the outer ring, on polygons the last, a corner."""
    last = ring_start(sail.outline, sail.rings + 1) - 1
    return ring_start(sail.outline, sail.rings) if sail.outline == "round" else last
