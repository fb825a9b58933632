"""The spinning sail's motion near the beam axis, to first order: its equations, and how far they are from instability.

State (8,): lateral position (2), lateral velocity (2), tilt δ = (roll, pitch) of the normal (2), lateral angular
velocity in body axes (2). Normalised units of `dynamics.rigid.body`. Batches of models stand in front: (..., 8, 8);
thrust, inertia and spin may be batches alike.

The margin tells how far a model is from the edge of stability. The exponents s = iω of a lossless sail come in pairs
±s, so that they leave the imaginary axis only where two of them meet (Krein collision; Arnold, Mathematical Methods of
Classical Mechanics, §42 and App. 29; for reversible systems Sevryuk, Lecture Notes in Mathematics 1211): near there
s² = s₀² ± √δ, with δ > 0 before and δ < 0 after. Hence the margin: half the smallest distance between two exponents
while all are imaginary, and minus the growth rate once one is not; both go as √|δ|. Not every pair that meets leaves
the axis, so that the margin of a stable sail is on the safe side. The multipliers of yaw-blind incidence collide on the
unit circle alike.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.linalg import expm

from beamrider.arrays import Complexes, Floats

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # a quarter turn about +z: e_z × ·
RESOLUTION = 1e-4  # growth a turn that counts as none: e-fold in 10⁴ turns, beyond any flight here


@dataclass(frozen=True)
class LinearModel:
    """First-order motion of a lamina that spins at `spin` (rad per unit time).

    jacobian (..., 4, 4): ∂(F_x, F_y, τ_x, τ_y)/∂(x, y, roll, pitch) at the centred, level sail at yaw 0, total force in
    lab and torque in body components. thrust (...,): F_z. inertia (2, 2): lateral part of the inertia tensor; the mass
    is 1. With `yaw_blind` the optical response follows the lab tilt whatever the yaw. waves (..., n, 4, 4): of a beam
    that is not round, so that the jacobian at yaw ψ is `jacobian` + 2 Re Σ waves_k exp(ikψ), k = 1 … n.
    """

    jacobian: Floats
    thrust: Floats
    inertia: Floats
    spin: float | Floats
    yaw_blind: bool
    waves: Complexes = field(default_factory=lambda: np.zeros((0, 4, 4), complex))

    @property
    def periodic(self) -> bool:
        """Is it periodic in any axes, so that it has no constant generator."""
        return self.yaw_blind or self.waves.shape[-3] > 0

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 8

    @property
    def damped(self) -> bool:
        """Does anything take up energy, so that motions may die away."""
        return False

    @property
    def period(self) -> Any:
        """Time (...,) of one turn; one unit of time for a sail that doesn't spin."""
        spin = np.abs(self.spin)
        return np.where(spin > 0.0, 2.0 * np.pi / np.where(spin > 0.0, spin, 1.0), 1.0)[()]

    def corotating(self) -> Floats:
        """Constant generator (..., 8, 8) in axes that turn with the sail, for the true incidence.

        Every vector gets −Ω e_z × ·; the gyroscopic torque of a lamina is Ω e_z × ω because I_z = I_x + I_y.
        """
        force, torque = self.jacobian[..., :2, :], np.linalg.solve(self.inertia, self.jacobian[..., 2:, :])
        spin = np.asarray(self.spin)[..., None, None]
        out = np.zeros((*self.jacobian.shape[:-2], 8, 8))
        for k in (0, 2, 4):
            out[..., k : k + 2, k : k + 2] = -spin * QUARTER
        out[..., 0:2, 2:4] = out[..., 4:6, 6:8] = np.eye(2)
        out[..., 2:4, 0:2], out[..., 2:4, 4:6] = force[..., :2], force[..., 2:]
        out[..., 6:8, 0:2], out[..., 6:8, 4:6] = torque[..., :2], torque[..., 2:]
        out[..., 6:8, 6:8] = spin * QUARTER
        return out

    def lab(self, t: float) -> Floats:
        """Generator (..., 8, 8) in the lab at time t, when the yaw is Ωt; periodic in a turn.

        True incidence: the response turns with the sail, R F Rᵀ. Yaw-blind: the tilt enters the response unturned; of
        the force's tilt derivative, the turning of the thrust with the normal, F_z (pitch, −roll), is geometry and
        stays.
        """
        cosine, sine = np.cos(self.spin * t), np.sin(self.spin * t)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        jacobian = self.jacobian
        if self.waves.shape[-3] > 0:
            phases = 2.0 * np.exp(1j * self.spin * t * np.arange(1, self.waves.shape[-3] + 1))
            jacobian = jacobian + np.einsum("k,...kij->...ij", phases, self.waves).real
        force, torque = turn @ jacobian[..., :2, :], np.linalg.solve(self.inertia, jacobian[..., 2:, :])
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
        shape = (*self.jacobian.shape[:-2], self.size, self.size)
        start = np.broadcast_to(np.eye(self.size), shape).ravel()

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

    def exponents(self) -> list[Complexes]:
        """Exponents of a turn (..., n), the logarithms of the multipliers, apart for motions that don't interact.

        From the co-rotating generator, where logarithms are known whole; from the lab where there is none.
        """
        if self.periodic:
            return [np.log(np.linalg.eigvals(self.monodromy(1e-11)).astype(complex))]
        generator = self.corotating() * np.asarray(self.period)[..., None, None]
        alone = not (np.any(self.spin) or np.any(self.jacobian[..., CROSSED[0], CROSSED[1]]))
        blocks = AXES if alone else [np.arange(8)]
        return [np.linalg.eigvals(generator[..., block[:, None], block]).astype(complex) for block in blocks]


def over_a_turn(jacobian: Floats) -> tuple[Floats, Complexes]:
    """Mean (..., 4, 4) and waves (..., n, 4, 4) of derivatives (..., m, 4, 4) at m yaws evenly over a turn."""
    count = jacobian.shape[-3]
    waves = np.fft.rfft(jacobian, axis=-3) / count
    return waves[..., 0, :, :].real, waves[..., 1 : (count + 1) // 2, :, :]


def growth(exponents: list[Complexes]) -> Floats:
    """Growth (...,) a turn of the fastest motion: logarithm of the largest modulus."""
    return np.asarray(np.max([part.real.max(axis=-1) for part in exponents], axis=0))


def margin(exponents: list[Complexes], periodic: bool = False) -> Floats:
    """Margins (...,) a turn; see the top of the module."""
    return np.asarray(np.min([_margin(part, 2.0 * np.pi if periodic else np.inf) for part in exponents], axis=0))


# A sail with two mirror planes that doesn't spin: x with pitch and y with roll, which know nothing of each other.
AXES = [np.array([0, 2, 5, 7]), np.array([1, 3, 4, 6])]
CROSSED = (np.array([0, 0, 1, 1, 2, 2, 3, 3]), np.array([1, 2, 0, 3, 1, 2, 0, 3]))


def _margin(exponents: Complexes, turn: float) -> Floats:
    """Margins (...,) of sets of exponents (..., n) of a turn; imaginary parts that differ by `turn` are the same.

    Growth up to `RESOLUTION` counts as none.
    """
    one, other = np.triu_indices(exponents.shape[-1], 1)
    apart = exponents[..., one] - exponents[..., other]
    if np.isfinite(turn):
        apart = apart.real + 1j * (apart.imag - turn * np.round(apart.imag / turn))
    growth = exponents.real.max(axis=-1)
    return np.asarray(np.where(growth > RESOLUTION, -growth, np.abs(apart).min(axis=-1) / 2.0))
