"""What a mesh must be to fly: one piece without holes, no slivers, nothing that hides behind another part."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from beamrider.arrays import Floats, Integers
from beamrider.io.files import InputError
from dynamics.sail.mesh import Mesh

#: Least height of a triangle in units of its longest side: below, steps get short and errors large.
SLENDER = 0.02


def heights(mesh: Mesh) -> Floats:
    """Height (t,) of each triangle over its longest side."""
    longest = mesh.lengths[mesh.triangle_edges].max(axis=1)
    return np.asarray(2.0 * mesh.areas / longest**2)


def _pieces(size: int, pairs: Integers) -> int:
    """Connected parts of a graph of `size` nodes with edges pairs (k, 2)."""
    ones = np.ones(len(pairs))
    return int(connected_components(coo_matrix((ones, pairs.T), shape=(size, size)), directed=False)[0])


def _rims(mesh: Mesh) -> int:
    """How many closed rims a mesh has."""
    nodes, pairs = np.unique(mesh.edges[mesh.rim], return_inverse=True)
    return _pieces(len(nodes), pairs.reshape(-1, 2))


def check_mesh(mesh: Mesh, where: str) -> None:
    """InputError, beginning with `where`, for a mesh in pieces, with holes, slivers or parts that shade others."""
    slender = heights(mesh)
    worst = int(np.argmin(slender))
    if slender[worst] < SLENDER:
        raise InputError(
            f"{where}: triangle {worst} is a sliver, {slender[worst]:.2g} as high as long: must be at least "
            f"{SLENDER:g}; make the sail less deep or change its rings"
        )
    pieces = _pieces(len(mesh.nodes), mesh.edges)
    if pieces > 1:
        raise InputError(f"{where}: the mesh is in {pieces} pieces that share no side: must be one")
    if _rims(mesh) > 1:
        raise InputError(f"{where}: the mesh has {_rims(mesh) - 1} holes: must have none")
    a, b, c = (mesh.nodes[mesh.triangles[:, i], :2] for i in range(3))
    facing = np.cross(b - a, c - a) / (2.0 * mesh.areas)
    if facing.min() <= 1e-9:
        raise InputError(f"{where}: triangle {int(np.argmin(facing))} turns away from the beam: the sail shades itself")


def check_shadow(mesh: Mesh, turn: Floats, where: str) -> None:
    """InputError where a sail turned by `turn` (3, 3) has parts lit from behind, which then shade others."""
    a, b, c = (mesh.nodes[mesh.triangles[:, i]] for i in range(3))
    facing = np.cross(b - a, c - a) @ turn[2]
    if facing.min() <= 0:
        raise InputError(
            f"{where}: tilted like this, triangle {int(np.argmin(facing))} is lit from behind and the sail shades "
            "itself: tilt it less or make it less deep"
        )
