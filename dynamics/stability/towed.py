"""First-order motion of a sail with point masses on tethers: `linear.LinearModel`, with their motion beside its own.

The sail pushes or tows masses that lie on its axis, at the accelerated equilibrium in which each tether carries its
share of m a, a = F_z/(1 + Σ m). A tether from a on the sail to its mass at b has length ℓ, direction ê, tension T; with
K = k ê êᵀ + (T/ℓ)(1 − ê êᵀ) and C = k τ ê êᵀ it pulls the sail by K s + C ṡ more when its ends part by s, in axes that
turn with the sail, in which its length does not feel the turn. State: the sail's 8 numbers, then lateral position (2)
and velocity (2) of each mass. Normalised units of `dynamics.rigid.body`, the mass of the sail is 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import brentq

from beamrider.arrays import Complexes, Floats
from beamrider.io.files import InputError
from dynamics.rigid.body import RigidBody
from dynamics.rigid.towing import NOTHING, Towing
from dynamics.scene.schema import Scene
from dynamics.stability.linear import QUARTER, LinearModel

#: Share of the load by which the tethers of a mass may pull aside or turn the sail, and still count as symmetric.
BALANCED = 1e-9
#: How far along the axis an equilibrium is looked for, in distances or lengths at the start, and at how many places.
FARTHEST, GRID = 16.0, 1601


@dataclass(frozen=True)
class Rig:
    """Linear tethers of masses (b,): forces and torques on the sail of displacements, and of their rates.

    stiffness, damping (2 + 2 + 2b, 2 + 2 + 2b): generalised forces on (sail, its lateral torque, masses) by lateral
    displacement of the sail, tilt (roll, pitch) and lateral displacement of the masses; symmetric. tension (k,), and
    depth (b,): where the masses hang along the axis.
    """

    mass: Floats
    stiffness: Floats
    damping: Floats
    tension: Floats
    depth: Floats


def _axial(towing: Towing, body: int, depth: Floats) -> Floats:
    """Force (n,) along +z of its tethers on a mass on the axis at depths (n,) from the sail."""
    lines = towing.body == body
    length = np.hypot(np.linalg.norm(towing.arm[lines, :2], axis=1), depth[:, None])
    tension = towing.stiffness[lines] * (length - towing.length[lines])
    tension = np.where(towing.pushes[lines] == 0.0, np.maximum(tension, 0.0), tension)
    return np.asarray(-(tension * depth[:, None] / np.maximum(length, 1e-300)).sum(axis=1))


def depth_of(towing: Towing, body: int, start: float, load: float) -> float:
    """Where a mass on the axis hangs under a load m a, on the side of the sail where it starts; ValueError if nowhere.

    Behind the sail tethers hold it, where they are taut; ahead only struts do.
    """
    reach = FARTHEST * max(abs(start), float(towing.length[towing.body == body].max()), 1e-6)
    near, far = (0.0, -reach) if start <= 0.0 else (reach, 0.0)

    def left(depth: float) -> float:
        return float(_axial(towing, body, np.array([depth]))[0] - load)

    grid = np.linspace(near, far, GRID)
    values = _axial(towing, body, grid) - load
    crossings = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    if crossings.size == 0:
        raise ValueError("its tethers do not hold it there")
    nearest = crossings[np.argmin(np.abs(grid[crossings] - start))]
    return float(brentq(left, grid[nearest], grid[nearest + 1], xtol=1e-15, rtol=1e-15))


def rig(towing: Towing, start: Floats, thrust: float) -> Rig:
    """Tethers linearised at the equilibrium under a thrust; start (b,): depths of the masses at the start.

    ValueError where a mass has no equilibrium, or where its tethers pull the sail aside.
    """
    load = thrust / (1.0 + towing.mass.sum()) * towing.mass
    depth = np.array([depth_of(towing, b, float(start[b]), float(load[b])) for b in range(towing.mass.size)])
    size = 4 + 2 * towing.mass.size
    stiffness, damping = np.zeros((size, size)), np.zeros((size, size))
    tension, pull, twist = np.zeros(towing.body.size), np.zeros(3), np.zeros(3)
    for k, body in enumerate(towing.body):
        away = np.array([0.0, 0.0, depth[body]]) - towing.arm[k]
        length = float(np.linalg.norm(away))
        along = away / length
        tension[k] = towing.stiffness[k] * (length - towing.length[k])
        tension[k] = tension[k] if towing.pushes[k] else max(tension[k], 0.0)
        if tension[k] == 0.0 and not towing.pushes[k]:
            raise ValueError(f"tether {k} of all is slack, at the edge of which its force is not linear")
        pull, twist = pull + tension[k] * along, twist + np.cross(towing.arm[k], tension[k] * along)
        parting = _parting(towing.arm[k], int(body), size)
        through = np.outer(along, along)
        matrix = towing.stiffness[k] * through + tension[k] / length * (np.eye(3) - through)
        stiffness -= parting.T @ matrix @ parting
        damping -= towing.stiffness[k] * towing.retardation[k] * parting.T @ through @ parting
        stiffness[2:4, 2:4] += _turned_arm(towing.arm[k], tension[k] * along)
    if max(np.abs(pull[:2]).max(), np.abs(twist).max()) > BALANCED * max(float(np.abs(load).sum()), 1e-300):
        raise ValueError("its tethers pull the sail aside: set them evenly round the axis")
    return Rig(towing.mass, stiffness, damping, tension, depth)


def _parting(arm: Floats, body: int, size: int) -> Floats:
    """How a tether's ends part (3, size) by lateral motion of the sail, its tilt, and lateral motion of the masses."""
    out = np.zeros((3, size))
    out[0, 0] = out[1, 1] = -1.0
    # −α × a of a tilt α = (roll, pitch, 0)
    out[:, 2] = -np.cross([1.0, 0.0, 0.0], arm)
    out[:, 3] = -np.cross([0.0, 1.0, 0.0], arm)
    out[0, 4 + 2 * body] = out[1, 5 + 2 * body] = 1.0
    return out


def _turned_arm(arm: Floats, force: Floats) -> Floats:
    """Lateral torque (2, 2) of a force that stays as its arm turns with a tilt: (α × a) × f."""
    columns = [np.cross(np.cross(axis, arm), force)[:2] for axis in np.eye(3)[:2]]
    return np.column_stack(columns)


@dataclass(frozen=True)
class TowedModel(LinearModel):
    """`LinearModel` of a sail with a payload.

    towing: its tethers; start (b,): depths of the masses at the start. Their tension follows each model's thrust.
    """

    towing: Towing = NOTHING
    start: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 8 + 4 * self.towing.mass.size

    @property
    def damped(self) -> bool:
        """Does a tether take up energy."""
        return bool((self.towing.retardation > 0.0).any())

    def corotating(self) -> Floats:
        """Constant generator (..., m, m) in axes that turn with the sail, m = 8 + 4b."""
        alone, batch = super().corotating(), self.jacobian.shape[:-2]
        thrust, size = np.broadcast_to(self.thrust, batch), self.size
        out = np.zeros((*batch, size, size))
        for index in np.ndindex(*batch):
            out[index] = self._extended(alone[index], rig(self.towing, self.start, float(thrust[index])), size)
        return out

    def _extended(self, alone: Floats, tethers: Rig, size: int) -> Floats:
        """The generator of one model from that of the sail alone."""
        masses, spin = tethers.mass.size, float(self.spin)
        out = np.zeros((size, size))
        out[:8, :8] = alone
        places, rates = [0, 1, 4, 5], [2, 3, 6, 7]
        for b in range(masses):
            at = 8 + 4 * b
            out[at : at + 2, at : at + 2] = out[at + 2 : at + 4, at + 2 : at + 4] = -spin * QUARTER
            out[at : at + 2, at + 2 : at + 4] = np.eye(2)
            places, rates = [*places, at, at + 1], [*rates, at + 2, at + 3]
        weights = block_diag(np.eye(2), np.linalg.inv(self.inertia), *(np.eye(2) / mass for mass in tethers.mass))
        # Rates of the coordinates in turning axes: those of the state, with the turn of the axes
        moved = out[places]
        out[rates] += weights @ tethers.damping @ moved
        out[np.ix_(rates, places)] += weights @ tethers.stiffness
        return out

    @cached_property
    def _generator(self) -> Floats:
        return self.corotating()

    def lab(self, t: float) -> Floats:
        """Generator (m, m) in lab axes at time t, m = 8 + 4b, angular velocity in them, too."""
        cosine, sine = np.cos(self.spin * t), np.sin(self.spin * t)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        half = np.eye(self.size // 2)
        whole, rate = np.kron(half, turn), float(self.spin) * np.kron(half, QUARTER)
        return np.asarray(whole @ self._generator @ whole.T + rate)

    def exponents(self) -> list[Complexes]:
        """Exponents of a turn (..., m), m = 8 + 4b."""
        return [np.linalg.eigvals(self.corotating() * np.asarray(self.period)[..., None, None]).astype(complex)]


def towed(body: RigidBody, jacobian: Floats, thrust: Any, spin: float, scene: Scene) -> TowedModel:
    """The model of a body with a payload, from derivatives (4, 4) of the light's load in its units.

    InputError where the payload is not on the axis, or has no equilibrium.
    """
    where = f"{scene.name}.yaml"
    if scene.incidence == "yaw_blind":
        raise InputError(f"{where}: incidence = 'yaw_blind': must be sail_frame for a stability analysis with payload")
    towing, start = body.sail.towing, body.payload.position
    for b, place in enumerate(start):
        if np.hypot(*place[:2]) > 0.0:
            raise InputError(f"{where}: payload[{b}].position_m = {place.tolist()}: must be on the sail's axis")
    depths = start[:, 2] / body.units.length
    try:
        rig(towing, depths, float(thrust))
    except ValueError as error:
        raise InputError(f"{where}: payload: no equilibrium for a stability analysis: {error}") from None
    return TowedModel(jacobian, np.array(thrust), body.sail.inertia[:2, :2], spin, False, towing=towing, start=depths)
