"""What holds a sail and what it carries, for its set-up: mounting, masses, free lengths, time step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags, eye, kron

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.membrane.lattice import highest_frequency, membrane_thickness, per_triangle
from dynamics.sail import payload
from dynamics.sail.attitude import rotation_from_angles
from dynamics.sail.held import free_share, supports
from dynamics.sail.mesh import Mesh
from dynamics.scene.schema import Scene

#: Largest product of the drag and the time step, so that no step takes away more than a tenth of the velocity.
MOST_DRAG = 0.1


def mounted(scene: Scene, points: Floats) -> Floats:
    """Points (3, k) in m of a sail that is held, as it is mounted in the beam; of others a copy, as they are."""
    if scene.holding is None:
        return points.copy()
    given = scene.release
    tilt = rotation_from_angles(np.radians(given.roll_deg), np.radians(given.pitch_deg), 0.0)
    return np.asarray(tilt @ points + np.array([*given.offset_m, 0.0])[:, None])


def inertial(scene: Scene, mesh: Mesh, masses: Floats) -> Floats:
    """Masses (n,) in kg by which forces are divided: those of nodes that are held fast are infinite."""
    if scene.holding is None:
        return masses
    out = masses.copy()
    out[supports(scene.holding, mesh).fixed] = math.inf
    return out


def free_squares(scene: Scene, mesh: Mesh, rest: Floats) -> Floats:
    """Squared free lengths (3t,) in m² at 300 K of all sides, at rest `rest` (3t,); empty for springs.

    The same array where the sail is under no tension of its own.
    """
    held = scene.holding
    if held is None or held.tension_N_m == 0.0 or rest.size == 0:
        return rest
    membrane = per_triangle(scene.sail, mesh, "young_Pa") * membrane_thickness(scene.sail, mesh)
    share = free_share(held.tension_N_m, per_triangle(scene.sail, mesh, "poisson"), membrane, f"{scene.name}.yaml")
    return np.asarray(rest * np.tile(share, 3))


def _links(scene: Scene, mesh: Mesh, each: Floats) -> csr_matrix:
    """Matrix (n + b, n + b) of links of `each` (k,) between the n nodes and b masses that the tethers join."""
    tethers = payload.tethers(scene.carried)
    corners, weights = payload.on_mesh(tethers.to, mesh, f"{scene.name}.yaml")
    n, b, k = len(mesh.nodes), tethers.mass.size, tethers.body.size
    rows = np.concatenate([corners.T, n + tethers.body[None]])
    shares = np.concatenate([weights.T, -np.ones((1, k))])
    line = np.broadcast_to(np.arange(k), rows.shape)
    along = csr_matrix((shares.ravel(), (line.ravel(), rows.ravel())), shape=(k, n + b))
    return (along.T @ diags(each) @ along).tocsr()


def stiffened(scene: Scene, mesh: Mesh, matrix: csr_matrix, masses: Floats) -> tuple[csr_matrix, Floats]:
    """K (m, m) in N/m with springs and tethers, m = 3(n + b), and all n + b masses in kg, for the time step.

    matrix (3n, 3n): of the sail alone; masses (n,): its nodes'.

    As if each resisted in every direction, and nothing were held fast: that only raises the frequencies (Horn &
    Johnson, Matrix Analysis, §4.3).
    """
    if scene.holding is None and not scene.carried:
        return matrix, masses
    tethers = payload.tethers(scene.carried)
    n, b = masses.size, tethers.mass.size
    extra = np.zeros(n + b)
    if scene.holding is not None:
        found = supports(scene.holding, mesh)
        np.add.at(extra, found.sprung, found.stiffness)
    links = _links(scene, mesh, tethers.stiffness) + diags(extra)
    grown = csr_matrix(
        (matrix.data, matrix.indices, np.append(matrix.indptr, np.full(3 * b, matrix.indptr[-1]))),
        shape=(3 * (n + b), 3 * (n + b)),
    )
    return (grown + kron(links, eye(3))).tocsr(), np.append(masses, tethers.mass)


def loss_rate(scene: Scene, mesh: Mesh, masses: Floats) -> float:
    """Largest eigenvalue in 1/s of M⁻¹C, C the damping of the tethers as if each resisted in every direction.

    masses (n,) in kg: of the sail's nodes.
    """
    tethers = payload.tethers(scene.carried)
    losses = tethers.stiffness * tethers.retardation
    if not losses.any():
        return 0.0
    return highest_frequency(kron(_links(scene, mesh, losses), eye(3)).tocsr(), np.append(masses, tethers.mass)) ** 2


def check_bodies(scene: Scene) -> None:
    """InputError where a scheme or element does not know what holds a sail or what it carries."""
    flight: Any = scene.flight
    names = [name for name, given in (("held", scene.holding), ("payload", scene.carried)) if given]
    if names and flight.integrator not in ("verlet", "semi_implicit_euler"):
        raise InputError(
            f"{scene.name}.yaml: flight.integrator = '{flight.integrator}': must be verlet or semi_implicit_euler "
            f"with {' and '.join(names)}"
        )
    if scene.holding is not None and scene.holding.tension_N_m > 0.0 and flight.stiffness != "triangles":
        raise InputError(
            f"{scene.name}.yaml: flight.stiffness = '{flight.stiffness}': must be triangles with held.tension_N_m"
        )


def check_drag(scene: Scene, dt: float) -> None:
    """InputError where steps of dt in s are too long for the drag."""
    held = scene.holding
    if held is not None and held.drag_1_s * dt > MOST_DRAG:
        raise InputError(
            f"{scene.name}.yaml: held.drag_1_s = {held.drag_1_s:g}: must be at most {MOST_DRAG / dt:.3g}, a tenth over "
            f"the time step {dt:.3g} s"
        )
