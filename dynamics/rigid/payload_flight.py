"""What a rigid flight says of its payload."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamrider.arrays import Floats
from dynamics.rigid.body import RigidBody
from dynamics.rigid.equations import STATE
from dynamics.rigid.towing import line
from dynamics.sail.attitude import rotation_from_quaternion


@dataclass(frozen=True)
class TowedFlight:
    """b masses (b,) in kg: position, velocity (n, b, 3) in m, m/s in the lab; k tethers: tension (n, k) in N.

    snapped (n, k): 1 for tethers that are gone. energy_elastic (n,): of the tethers in J.
    """

    mass: Floats
    position: Floats
    velocity: Floats
    tension: Floats
    snapped: Floats
    energy_elastic: Floats

    @property
    def energy_kinetic(self) -> Floats:
        """Kinetic energy (n,) of the masses in J."""
        return np.asarray(0.5 * np.sum(self.mass[:, None] * self.velocity**2, axis=(1, 2)))

    def columns(self) -> dict[str, tuple[Floats, str]]:
        """Columns, each (n,) or longer, and units of the flight's file."""
        return {
            "payload_position": (self.position, "m"),
            "payload_velocity": (self.velocity, "m/s"),
            "payload_energy_kinetic": (self.energy_kinetic, "J"),
            "tether_tension": (self.tension, "N"),
            "tether_energy": (self.energy_elastic, "J"),
            "tethers_snapped": (self.snapped, "1"),
        }


def towed(body: RigidBody, states: Floats, si: Floats) -> TowedFlight | None:
    """The payload's part of states (n, m) in normalised units, `si` (n, m) in SI; None where there is none."""
    given, towing = body.payload, body.sail.towing
    b, k, n = given.mass.size, given.body.size, len(states)
    if b == 0:
        return None
    tension, arm, away = np.zeros((n, k)), np.empty(3), np.empty(3)
    for row, turn in enumerate(rotation_from_quaternion(states[:, 6:10])):
        for j in range(k):
            if states[row, STATE + 6 * b + j]:
                tension[row, j] = line(towing, STATE, np.ascontiguousarray(turn), states[row], j, arm, away)
    position, velocity = si[:, STATE : STATE + 3 * b].reshape(n, b, 3), si[:, STATE + 3 * b : STATE + 6 * b]
    snapped, force = 1.0 - si[:, STATE + 6 * b :], tension * body.units.force
    return TowedFlight(
        given.mass, position, velocity.reshape(n, b, 3), force, snapped, _elastic(body, states, position, si)
    )


def _elastic(body: RigidBody, states: Floats, position: Floats, si: Floats) -> Floats:
    """Energy ½ k (ℓ − L)² (n,) in J of the tethers that are not slack, nor gone."""
    given, towing, unit = body.payload, body.sail.towing, body.units.length
    turns = rotation_from_quaternion(states[:, 6:10])
    ends = si[:, None, :3] + np.einsum("nij,kj->nki", turns, towing.arm * unit)
    stretch = np.linalg.norm(position[:, given.body] - ends, axis=2) - towing.length * unit
    stretch = np.where((given.pushes == 0.0) & (stretch < 0.0), 0.0, stretch) * states[:, STATE + 6 * given.mass.size :]
    return np.asarray(0.5 * (stretch**2) @ given.stiffness)
