"""Point masses on tethers: where their ends are, how long they are; of rigid and of flexible sails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamrider.arrays import Floats, Integers
from beamrider.io.files import InputError
from dynamics.sail.mesh import Mesh
from dynamics.scene.body_schema import Payload

#: How far outside of a triangle, in its own coordinates, a place still counts as on it.
EDGE = 1e-9


@dataclass(frozen=True)
class Tethers:
    """b point masses of `mass` (b,) in kg at `position` (b, 3) in m, and their k tethers.

    body (k,): the mass of each; to (k, 2): its place on the sail in m; stiffness (k,) in N/m; given (k,): free length
    in m, NaN for the distance at the start; retardation (k,) in s; strength (k,) in N, ∞ for never; pushes (k,): 1 for
    struts, else 0. Lengths are from the middle of the sail.
    """

    mass: Floats
    position: Floats
    body: Integers
    to: Floats
    stiffness: Floats
    given: Floats
    retardation: Floats
    strength: Floats
    pushes: Floats

    def lengths(self, ends: Floats) -> Floats:
        """Free lengths (k,) in m, given the ends (k, 3) in m on the sail at rest."""
        return np.where(np.isnan(self.given), np.linalg.norm(self.position[self.body] - ends, axis=1), self.given)


def tethers(payload: list[Payload]) -> Tethers:
    """The payload of a scene as arrays; none is allowed."""
    lines = [(i, line) for i, body in enumerate(payload) for line in body.tethers]

    def column(name: str, missing: float) -> Floats:
        values = [getattr(line, name) for _, line in lines]
        return np.array([missing if value is None else float(value) for value in values], dtype=float)

    return Tethers(
        mass=np.array([body.mass_kg for body in payload], float),
        position=np.array([body.position_m for body in payload], float).reshape(-1, 3),
        body=np.array([i for i, _ in lines], np.int64),
        to=np.array([line.to_m for _, line in lines], float).reshape(-1, 2),
        stiffness=column("stiffness_N_m", 0.0),
        given=column("length_m", np.nan),
        retardation=column("damping_s", 0.0),
        strength=column("strength_N", np.inf),
        pushes=column("pushes", 0.0),
    )


def on_mesh(places: Floats, mesh: Mesh, where: str) -> tuple[Integers, Floats]:
    """Nodes (k, 3) and weights (k, 3) of places (k, 2) in m on a mesh, seen along z: those of their triangles' corners.

    InputError where a place is not on the sail.
    """
    a, b, c = (mesh.nodes[mesh.triangles[:, i], :2] for i in range(3))
    one, other = b - a, c - a
    area = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    corners, weights = np.zeros((len(places), 3), np.int64), np.zeros((len(places), 3))
    for k, place in enumerate(places):
        away = place - a
        second = (away[:, 0] * other[:, 1] - away[:, 1] * other[:, 0]) / area
        third = (one[:, 0] * away[:, 1] - one[:, 1] * away[:, 0]) / area
        shares = np.stack([1.0 - second - third, second, third], axis=1)
        best = int(np.argmax(shares.min(axis=1)))
        if shares[best].min() < -EDGE:
            raise InputError(f"{where}: payload: tether to_m = {place.tolist()}: must be on the sail's mesh")
        corners[k], weights[k] = mesh.triangles[best], shares[best]
    return corners, weights


def on_disc(places: Floats, radius: float, where: str) -> Floats:
    """Places (k, 3) in m on a flat disc of that radius in m, of (k, 2); InputError where one is beside it."""
    for place in places:
        if np.hypot(*place) > radius * (1.0 + EDGE):
            raise InputError(f"{where}: payload: tether to_m = {place.tolist()}: must be at most {radius:g} m away")
    return np.column_stack([places, np.zeros(len(places))])
