"""The spinning sail's motion near the beam axis, to first order: derivatives of force and torque, and the equations.

State (8,): lateral position (2), lateral velocity (2), tilt δ = (roll, pitch) of the normal (2), lateral angular
velocity in body axes (2). Normalised units of `dynamics.rigid_body`. Batches of models stand in front: (..., 8, 8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.linalg import expm

from dynamics.attitude import rotation_from_angles
from dynamics.rigid_body import RigidBody

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

TILT_STEP = np.radians(0.1)
SHIFT_STEP = 2.5e-4  # of the beam radius: (step/w)² is then a part in 10⁷, rounding one in 10¹²
ROWS = ("F_x", "F_y", "tau_x", "tau_y")
COLUMNS = ("x", "y", "roll", "pitch")
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # a quarter turn about +z: e_z × ·


@dataclass(frozen=True)
class LinearModel:
    """First-order motion of a lamina that spins at `spin` (rad per unit time).

    jacobian (..., 4, 4): ∂(F_x, F_y, τ_x, τ_y)/∂(x, y, roll, pitch) at the centred, level sail at yaw 0, total force in
    lab and torque in body components. thrust (...,): F_z. inertia (2, 2): lateral part of the inertia tensor; the mass
    is 1. With `yaw_blind` the optical response follows the lab tilt whatever the yaw.
    """

    jacobian: Floats
    thrust: Floats
    inertia: Floats
    spin: float
    yaw_blind: bool

    @property
    def period(self) -> float:
        """Time of one turn; one unit of time for a sail that doesn't spin."""
        return 2.0 * np.pi / abs(self.spin) if self.spin else 1.0

    def corotating(self) -> Floats:
        """Constant generator (..., 8, 8) in axes that turn with the sail, for the true incidence.

        Every vector gets −Ω e_z × ·; the gyroscopic torque of a lamina is Ω e_z × ω because I_z = I_x + I_y.
        """
        force, torque = self.jacobian[..., :2, :], np.linalg.solve(self.inertia, self.jacobian[..., 2:, :])
        out = np.zeros((*self.jacobian.shape[:-2], 8, 8))
        for k in (0, 2, 4):
            out[..., k : k + 2, k : k + 2] = -self.spin * QUARTER
        out[..., 0:2, 2:4] = out[..., 4:6, 6:8] = np.eye(2)
        out[..., 2:4, 0:2], out[..., 2:4, 4:6] = force[..., :2], force[..., 2:]
        out[..., 6:8, 0:2], out[..., 6:8, 4:6] = torque[..., :2], torque[..., 2:]
        out[..., 6:8, 6:8] = self.spin * QUARTER
        return out

    def lab(self, t: float) -> Floats:
        """Generator (..., 8, 8) in the lab at time t, when the yaw is Ωt; periodic in a turn.

        True incidence: the response turns with the sail, R F Rᵀ. Yaw-blind: the tilt enters the response unturned; of
        the force's tilt derivative, the turning of the thrust with the normal, F_z (pitch, −roll), is geometry and
        stays.
        """
        cosine, sine = np.cos(self.spin * t), np.sin(self.spin * t)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        force, torque = turn @ self.jacobian[..., :2, :], np.linalg.solve(self.inertia, self.jacobian[..., 2:, :])
        out = np.zeros((*self.jacobian.shape[:-2], 8, 8))
        out[..., 0:2, 2:4], out[..., 4:6, 6:8] = np.eye(2), turn
        out[..., 2:4, 0:2], out[..., 6:8, 0:2] = force[..., :2] @ turn.T, torque[..., :2] @ turn.T
        out[..., 6:8, 6:8] = self.spin * QUARTER
        if self.yaw_blind:
            swing = -np.asarray(self.thrust)[..., None, None] * QUARTER
            out[..., 2:4, 4:6], out[..., 6:8, 4:6] = force[..., 2:] - turn @ swing + swing, torque[..., 2:]
        else:
            out[..., 2:4, 4:6], out[..., 6:8, 4:6] = force[..., 2:] @ turn.T, torque[..., 2:] @ turn.T
        return out

    def monodromy(self, tolerance: float = 1e-13) -> Floats:
        """Φ(T) (..., 8, 8) of Φ̇ = J(t) Φ, Φ(0) = 1, in the lab (Hale, Ordinary Differential Equations, §III.7)."""
        shape = (*self.jacobian.shape[:-2], 8, 8)
        start = np.broadcast_to(np.eye(8), shape).ravel()

        def slope(t: float, y: Floats) -> Floats:
            return np.asarray(self.lab(t) @ y.reshape(shape)).ravel()

        solver = DOP853(slope, 0.0, start, self.period, rtol=tolerance, atol=tolerance, max_step=self.period / 16)
        while solver.status == "running":
            solver.step()
        if solver.status == "failed":
            raise ArithmeticError("the monodromy matrix could not be integrated over a turn")
        return np.asarray(solver.y).reshape(shape)

    def turn_matrix(self) -> Floats:
        """exp(A T) (..., 8, 8) in co-rotating axes: the monodromy matrix, as the axes come back after a turn."""
        return np.asarray(expm(self.corotating() * self.period))


def linearise(body: RigidBody) -> tuple[Floats, float]:
    """(jacobian (4, 4), thrust) in normalised units by central differences: 0.1° in tilt, a small step in position."""
    shift = SHIFT_STEP * body.light.radius
    columns = []
    for axis, step in enumerate((shift, shift, TILT_STEP, TILT_STEP)):
        move = np.zeros(4)
        move[axis] = step
        columns.append((_load(body, move) - _load(body, -move)) / (2.0 * step))
    jacobian = np.array(columns).T[[0, 1, 3, 4]]
    return jacobian, float(_load(body, np.zeros(4))[2])


def imbalance(body: RigidBody) -> float:
    """Largest of |F_x|, |F_y|, |τ_x|, |τ_y|, |τ_z| over F_z at the centred, level sail: 0 in equilibrium."""
    load = _load(body, np.zeros(4))
    return float(np.abs(load[[0, 1, 3, 4, 5]]).max() / (abs(load[2]) or 1.0))


def _load(body: RigidBody, move: Floats) -> Floats:
    """(force in the lab, torque in the body) (6,) at (x, y, roll, pitch), normalised."""
    position = np.array([move[0], move[1], 0.0]) * body.units.length
    force, torque, _ = body.load(position, rotation_from_angles(move[2], move[3], 0.0))
    return np.concatenate([force / body.units.force, torque / body.units.torque])
