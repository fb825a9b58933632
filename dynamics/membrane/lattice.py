"""The mesh as a lattice: point masses joined by springs and heat links, and the longest stable time step.

Lumping gives every node one third of its triangles. Stiffness and conductance are sums over the triangles beside an
edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.linalg import eigsh

from beamrider.arrays import Floats, Integers
from dynamics.sail.mesh import Mesh
from dynamics.scene.sail_schema import Sail
from dynamics.scene.schema import Flight


def per_triangle(sail: Sail, mesh: Mesh, quantity: str) -> Floats:
    """A material property (t,) of each triangle by its name in `Material`."""
    return np.array([float(getattr(region.properties, quantity)) for region in sail.regions])[mesh.sector]


def membrane_thickness(sail: Sail, mesh: Mesh) -> Floats:
    """Thickness (t,) in m of what carries tension and heat in the plane of each triangle."""
    return np.array([region.carries_m for region in sail.regions])[mesh.sector]


def lump(mesh: Mesh, per_area: Floats) -> Floats:
    """Node sums (n,): one third of `per_area` (t,) times the rest area of the adjoining triangles."""
    share = np.repeat(per_area * mesh.areas / 3.0, 3)
    return np.asarray(np.bincount(mesh.triangles.ravel(), share, minlength=len(mesh.nodes)), dtype=float)


def over_edges(mesh: Mesh, contribution: Floats) -> Floats:
    """Sums (e,) over the triangles beside each edge of `contribution` (t, 3) for the sides 01, 12, 20."""
    sums = np.bincount(mesh.triangle_edges.ravel(), contribution.ravel(), minlength=len(mesh.edges))
    return np.asarray(sums, dtype=float)


def _half_cotangent(mesh: Mesh) -> Floats:
    """½ cot (t, 3) of the angle opposite each side 01, 12, 20, with its sign: half the dot over the cross product."""
    x = mesh.nodes[mesh.triangles]
    dots = [np.sum((x[:, i] - x[:, k]) * (x[:, j] - x[:, k]), axis=1) for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))]
    return np.asarray(np.stack(dots, axis=1) / (4.0 * mesh.areas[:, None]))


def stiffness(sail: Sail, mesh: Mesh, form: str, rim_factor: float = 1.0) -> Floats:
    """Spring constants (e,) in N/m of the edges.

    'van_gelder': E h (A/(L²(1 + ν)) + ν/(1 − ν²) · ½ cot) summed over both triangles (Van Gelder, J. Graphics Tools 3
    (1998) 21, with the angle opposite the edge). 'lattice': E h A/L², exact for an equilateral lattice with ν = 1/3.
    """
    membrane = per_triangle(sail, mesh, "young_Pa") * membrane_thickness(sail, mesh)
    poisson = per_triangle(sail, mesh, "poisson")[:, None]
    area_term = mesh.areas[:, None] / mesh.lengths[mesh.triangle_edges] ** 2
    if form == "van_gelder":
        area_term = area_term / (1.0 + poisson) + poisson / (1.0 - poisson**2) * _half_cotangent(mesh)
    k = over_edges(mesh, membrane[:, None] * area_term)
    return np.asarray(np.where(mesh.rim, rim_factor, 1.0) * k)


def cotangents(mesh: Mesh) -> Floats:
    """Cotangents (t, 3) of the angles opposite the sides 01, 12, 20."""
    return 2.0 * _half_cotangent(mesh)


def side_moduli(sail: Sail, mesh: Mesh) -> Floats:
    """Second derivatives ∂²U/∂q∂q (t, 3, 3) in N/m³ of the energy of each triangle by its squared sides q.

    h Y/(16A(1 − ν²)) (c cᵀ − ½(1 − ν)Q), plane stress; c the cotangents, Q = [[−1, 1, 1], [1, −1, 1], [1, 1, −1]]
    (Delingette, IEEE Trans. Vis. Comput. Graphics 14 (2008) 329).
    """
    poisson = per_triangle(sail, mesh, "poisson")[:, None, None]
    c = cotangents(mesh)
    form = c[:, :, None] * c[:, None, :] - 0.5 * (1.0 - poisson) * (1.0 - 2.0 * np.eye(3))
    return np.asarray(0.5 * sheet_modulus(sail, mesh)[:, None, None] * form)


def sheet_modulus(sail: Sail, mesh: Mesh) -> Floats:
    """Stiffness h Y/(8(1 − ν²)A) (t,) in N/m³ of each triangle."""
    membrane = per_triangle(sail, mesh, "young_Pa") * membrane_thickness(sail, mesh)
    return np.asarray(membrane / (8.0 * (1.0 - per_triangle(sail, mesh, "poisson") ** 2) * mesh.areas))


def centred(mesh: Mesh, masses: Floats) -> Floats:
    """Rest nodes (n, 3) in m about the centre of mass."""
    return np.asarray(mesh.nodes - masses @ mesh.nodes / masses.sum())


def conductance(sail: Sail, mesh: Mesh, form: str) -> Floats:
    """Heat conductances (t, 3) in W/K that each triangle gives its sides 01, 12, 20; an edge has those of both.

    'cotangent': κ h ½ cot, Fourier's law for linear fields (Pinkall & Polthier, Exp. Math. 2 (1993) 15). 'area':
    κ h A/L². 'first_triangle' (published): the same, but nothing from the second triangle of an edge.
    """
    sheet = per_triangle(sail, mesh, "conductivity_W_mK") * membrane_thickness(sail, mesh)
    if form == "cotangent":
        return np.asarray(sheet[:, None] * _half_cotangent(mesh))
    share = sheet[:, None] * mesh.areas[:, None] / mesh.lengths[mesh.triangle_edges] ** 2
    if form == "area":
        return np.asarray(share)
    first = mesh.edge_triangles[:, 0][mesh.triangle_edges] == np.arange(len(share))[:, None]
    return np.where(first, share, 0.0)


def over_adjacent(mesh: Mesh, values: Floats, how: str) -> Floats:
    """Minimum or mean (e,) of `values` (t,) over the triangles beside each edge."""
    first, second = mesh.edge_triangles.T
    pair = np.stack([values[first], values[np.where(second < 0, first, second)]])
    return np.asarray(pair.min(axis=0) if how == "min" else pair.mean(axis=0))


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """Node masses (n,) kg and heat capacities (n,) J/K; spring constants, conductances, expansion and limits (e,).

    Where triangles carry the load, the spring constants are empty. conductance_shares (t, 3): of the conductances, what
    each triangle gives its sides 01, 12, 20.
    """

    masses: Floats
    heat_capacities: Floats
    stiffness: Floats
    conductance: Floats
    conductance_shares: Floats
    expansion: Floats
    limit_strain: Floats


def lattice(sail: Sail, mesh: Mesh, flight: Flight) -> Lattice:
    """Lumped masses, springs and heat links of a sail, in the forms the scene asks for."""
    areal_mass = per_triangle(sail, mesh, "areal_mass")
    expansion = over_adjacent(mesh, per_triangle(sail, mesh, "expansion_1_K"), "mean")
    if flight.expansion_1_K is not None:
        expansion = np.full_like(expansion, flight.expansion_1_K)
    triangles = flight.stiffness == "triangles"
    springs = np.empty(0) if triangles else stiffness(sail, mesh, flight.stiffness, flight.rim_factor)
    shares = conductance(sail, mesh, flight.conductance)
    return Lattice(
        masses=lump(mesh, areal_mass),
        heat_capacities=lump(mesh, areal_mass * per_triangle(sail, mesh, "heat_capacity_J_kgK")),
        stiffness=springs,
        conductance=over_edges(mesh, shares),
        conductance_shares=shares,
        expansion=expansion,
        limit_strain=over_adjacent(mesh, per_triangle(sail, mesh, "limit_strain"), "min"),
    )


def _assemble(blocks: Floats, nodes: Integers, size: int) -> csr_matrix:
    """Sum (3·size, 3·size) of element matrices blocks (k, 3m, 3m) over nodes (k, m)."""
    freedoms = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
    rows = np.broadcast_to(freedoms[:, :, None], blocks.shape)
    columns = np.broadcast_to(freedoms[:, None, :], blocks.shape)
    shape = (3 * size, 3 * size)
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsr()


def stiffness_matrix(mesh: Mesh, k: Floats) -> csr_matrix:
    """K (3n, 3n) in N/m of springs k (e,) about the rest shape: each resists along its own direction only."""
    a, b = mesh.edges.T
    direction = (mesh.nodes[b] - mesh.nodes[a]) / mesh.lengths[:, None]
    stretch = np.concatenate([-direction, direction], axis=1)
    return _assemble(k[:, None, None] * stretch[:, :, None] * stretch[:, None, :], mesh.edges, len(mesh.nodes))


def sheet_matrix(sail: Sail, mesh: Mesh) -> csr_matrix:
    """K (3n, 3n) in N/m of constant-strain triangles about the rest shape."""
    x = mesh.nodes[mesh.triangles]
    change = np.zeros((len(x), 3, 3, 3))  # of the squared sides 01, 12, 20 with the three corners
    for side in range(3):
        a, b = side, (side + 1) % 3
        change[:, side, a], change[:, side, b] = 2.0 * (x[:, a] - x[:, b]), 2.0 * (x[:, b] - x[:, a])
    rows = change.reshape(len(x), 3, 9)
    blocks = np.einsum("tip,tij,tjq->tpq", rows, side_moduli(sail, mesh), rows)
    return _assemble(blocks, mesh.triangles, len(mesh.nodes))


def highest_frequency(matrix: csr_matrix, masses: Floats) -> float:
    """ω_max in rad/s: the root of the largest eigenvalue of M⁻¹K by Lanczos iteration; K (3n, 3n), masses (n,)."""
    scale = np.repeat(1.0 / np.sqrt(masses), 3)
    scaled = matrix.multiply(scale[:, None]).multiply(scale[None, :]).tocsr()
    start = np.random.default_rng(0).standard_normal(scale.size)
    largest = eigsh(scaled, k=1, which="LA", v0=start, return_eigenvectors=False, tol=1e-10)
    return float(np.sqrt(largest[0]))


#: Δt ω_max at which each integrator turns unstable (Hairer, Lubich & Wanner, Geometric Numerical Integration, §I).
STABILITY = {"semi_implicit_euler": 2.0, "verlet": 2.0, "rk4": 2.0 * np.sqrt(2.0)}
