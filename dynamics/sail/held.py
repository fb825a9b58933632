"""What holds a sail: which nodes, and how stiffly; the tension that its rim takes up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamrider.arrays import Floats, Integers
from beamrider.io.files import InputError
from dynamics.sail.mesh import Mesh
from dynamics.scene.body_schema import Held, HeldPart


@dataclass(frozen=True)
class Supports:
    """Nodes that are held fast (k,); nodes on springs (s,), their stiffness (s,) in N/m and share of the rim (s,) in m.

    The share is 0 for nodes of a part; a node of the rim and a part has two entries.
    """

    fixed: Integers
    sprung: Integers
    stiffness: Floats
    rim: Floats


def rim_lengths(mesh: Mesh) -> Floats:
    """Length (n,) in m of rim that belongs to each node: half of its edges on the rim, 0 within the sail."""
    edges = mesh.edges[mesh.rim]
    half = np.repeat(0.5 * mesh.lengths[mesh.rim], 2)
    return np.asarray(np.bincount(edges.ravel(), half, minlength=len(mesh.nodes)), dtype=float)


def nodes_of(part: HeldPart, mesh: Mesh) -> Integers:
    """Nodes (k,) of a held part: those within its radius, seen along z, or else the nearest one."""
    away = np.linalg.norm(mesh.nodes[:, :2] - np.array(part.at_m), axis=1)
    near = np.flatnonzero(away <= part.radius_m)
    return near if near.size else np.array([int(np.argmin(away))])


def supports(held: Held, mesh: Mesh) -> Supports:
    """The supports of a mesh. A node that is held fast by one of them is so whatever the others say."""
    lengths = rim_lengths(mesh)
    rim, none = np.flatnonzero(lengths > 0.0), np.zeros(0, np.int64)
    fixed = [rim if held.rim == "clamped" else none]
    sprung, stiffness, shares = [none], [np.zeros(0)], [np.zeros(0)]
    if held.rim_stiffness_N_m2 is not None:
        sprung, stiffness, shares = [rim], [held.rim_stiffness_N_m2 * lengths[rim]], [lengths[rim]]
    for part in held.parts:
        nodes = nodes_of(part, mesh)
        if part.stiffness_N_m is None:
            fixed.append(nodes)
        else:
            sprung.append(nodes)
            stiffness.append(np.full(nodes.size, part.stiffness_N_m / nodes.size))
            shares.append(np.zeros(nodes.size))
    fast, springs = np.unique(np.concatenate(fixed)), np.concatenate(sprung)
    left = ~np.isin(springs, fast)
    return Supports(fast, springs[left], np.concatenate(stiffness)[left], np.concatenate(shares)[left])


def area_slopes(mesh: Mesh) -> Floats:
    """∂A/∂x (n, 3) in m of the sail's area by its nodes: the force of a unit isotropic tension, outwards at the rim."""
    x = mesh.nodes[mesh.triangles]
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    normal = across / np.linalg.norm(across, axis=1, keepdims=True)
    found = np.zeros_like(mesh.nodes)
    for corner in range(3):
        opposite = x[:, (corner + 2) % 3] - x[:, (corner + 1) % 3]
        np.add.at(found, mesh.triangles[:, corner], 0.5 * np.cross(normal, opposite))
    return found


def free_share(tension: float, poisson: Floats, membrane: Floats, where: str) -> Floats:
    """λ² (t,): squared free lengths over those of the mesh, at which its triangles are under an isotropic tension.

    With the Green strain (1 − λ²)/2 of a sheet of stiffness h Y (t,) in N/m that tension is N = h Y/(1 − ν) (1 − λ²)/2
    in N/m (plane stress; Timoshenko & Goodier, Theory of Elasticity, §9). InputError where none is left.
    """
    share = 1.0 - 2.0 * tension * (1.0 - poisson) / membrane
    if np.any(share <= 0.5):
        most = float((0.25 * membrane / (1.0 - poisson)).min())
        raise InputError(f"{where}: held.tension_N_m = {tension:g}: must be below {most:.3g}, a strain of a quarter")
    return np.asarray(share)
