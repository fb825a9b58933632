"""Derivatives of force and torque at the centred, level sail, from the response of its cells around normal incidence.

They are linear in that response: every sector adds its q and ∂q/∂(u, v), weighted with moments of the light on it. So
errors of a table, and thousands of designs, cost as much as a sum. Normalised units of `dynamics.rigid.body`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.light.moments import Moments, beam_moments
from dynamics.light.rules import TooSteep
from dynamics.rigid.body import RigidBody
from dynamics.scene import schema as scenes
from optics.table.normal_incidence import NormalResponse, constant_response, table_response
from optics.table.pressure_table import PressureTable

ROWS = ("F_x", "F_y", "tau_x", "tau_y")
COLUMNS = ("x", "y", "roll", "pitch")


#: Numbers of yaws at which the derivatives are found in a beam that is not round, until its waves fall to `_TAIL`.
_YAWS, _MOST_YAWS, _TAIL = 32, 1024, 1e-9


def body_moments(scene: scenes.Scene, body: RigidBody, yaw: Floats | float = 0.0) -> Moments:
    """Moments of a rigid body's sectors and beam at yaws (...) in rad, in its units; InputError where too steep."""
    spans = tuple((float(s.start), float(s.stop)) for s in body.shape.sectors)
    unit = body.units.length
    try:
        found = beam_moments(scene.beam.spots, spans, body.shape.radius, np.asarray(yaw, float))
    except TooSteep as refusal:
        raise InputError(f"{scene.name}.yaml: beam.profile: {refusal}") from None
    return Moments(found.zeroth / unit**2, found.first / unit**3, found.slope / unit, found.slopes / unit**2)


def derivatives(g: Floats, q: Floats, gradient: Floats, light: Moments) -> tuple[Floats, Floats]:
    """(∂(F_x, F_y, τ_x, τ_y)/∂(x, y, roll, pitch) (..., 4, 4), thrust (...,)) from the response of each sector.

    g (..., n_s, 2): direction across the ridges in body x, y; q (..., n_s, 3) and gradient (..., n_s, 3, 2) over
    (u, v), in (g, r, n). The light on a tilted sail comes along k = (−pitch, roll, 1) in body components; the force,
    which turns with the sail, tilts its thrust (Gao, Kelzenberg & Atwater, supplementary text). Force in lab
    components, torque in body components.
    """
    frame = np.stack([g, np.stack([-g[..., 1], g[..., 0]], axis=-1)], axis=-2)  # rows g and r
    turned = np.einsum("...sij,...sjt->...sit", gradient, np.stack([frame[..., 1], -frame[..., 0]], axis=-1))
    lateral = np.einsum("...sk,...ski->...si", q[..., :2], frame)
    lateral_tilt = np.einsum("...skt,...ski->...sit", turned[..., :2, :], frame)
    about = np.array([[0.0, 1.0], [-1.0, 0.0]])  # τ = (Y, −X) q_n
    out = np.zeros((*np.broadcast_shapes(q.shape[:-2], light.zeroth.shape[:-1]), 4, 4))
    out[..., :2, :2] = np.einsum("...si,...sj->...ij", lateral, light.slope)
    out[..., 2:, :2] = np.einsum("ki,...sij,...s->...kj", about, light.slopes, q[..., 2])
    out[..., :2, 2:] = np.einsum("...s,...sit->...it", light.zeroth, lateral_tilt)
    out[..., 2:, 2:] = np.einsum("ki,...si,...st->...kt", about, light.first, turned[..., 2, :])
    thrust = np.einsum("...s,...s->...", light.zeroth, q[..., 2])
    out[..., 0, 3] += thrust
    out[..., 1, 2] -= thrust
    return out, thrust


def responses(scene: scenes.Scene, tables: dict[str, PressureTable]) -> list[NormalResponse]:
    """The response of each sector of a scene."""
    found = {design: table_response(tables[design]) for design in scene.sail.designs}
    return [
        found[s.design] if s.design else constant_response(s.reflectance or 0.0, s.properties.absorptance)
        for s in scene.sail.sectors
    ]


class Lit(NamedTuple):
    """The light on a body: at yaw 0, or at the yaws of a turn (n,) evenly if a turn changes it."""

    moments: Moments
    turning: bool


def lit(scene: scenes.Scene, body: RigidBody) -> Lit:
    """The light on a scene's centred, level body, over a turn where it spins in a beam that is not round.

    Yaws are as close as the waves of the moments over a turn ask for: the highest are below `_TAIL` of the power.
    """
    if scene.beam.round or scene.release.spin_Hz == 0.0:
        return Lit(body_moments(scene, body), False)
    count = _YAWS
    while True:
        found = body_moments(scene, body, 2.0 * np.pi * np.arange(count) / count)
        tails = [
            np.abs(np.fft.rfft(part, axis=0)[3 * count // 8 :]).max() / count
            for part in (found.zeroth, found.first, found.slope, found.slopes)
        ]
        if max(tails) <= _TAIL * found.zeroth.sum(axis=-1).max():
            return Lit(found, True)
        count *= 2
        if count > _MOST_YAWS:
            raise InputError(
                f"{scene.name}.yaml: beam.profile: changes too sharply as the sail turns for a stability analysis"
            )


def linearise(scene: scenes.Scene, tables: dict[str, PressureTable], body: RigidBody) -> tuple[Floats, float]:
    """(jacobian (4, 4), thrust) of a scene's body; jacobian (n, 4, 4) at the yaws of `lit` if a turn changes it."""
    cells = responses(scene, tables)
    q, gradient = np.array([cell.q for cell in cells]), np.array([cell.gradient for cell in cells])
    jacobian, thrust = derivatives(body.sail.g, q, gradient, lit(scene, body).moments)
    return jacobian, float(np.mean(thrust))


def error_modes(scene: scenes.Scene, tables: dict[str, PressureTable], body: RigidBody) -> list[tuple[Floats, float]]:
    """What the tables' errors do to (jacobian, thrust) of `linearise`: one entry for each number that may be wrong."""
    light = lit(scene, body).moments
    out = []
    for design in scene.sail.designs:
        mine = np.array([sector.design == design for sector in scene.sail.sectors], float)
        for q, gradient in _errors(table_response(tables[design])):
            jacobian, thrust = derivatives(body.sail.g, np.outer(mine, q), mine[:, None, None] * gradient, light)
            out.append((jacobian, float(np.mean(thrust))))
    return out


def _errors(response: NormalResponse) -> Iterator[tuple[Floats, Floats]]:
    """(q, gradient) that hold one error each."""
    for k in np.flatnonzero(response.q_error):
        yield np.where(np.arange(3) == k, response.q_error, 0.0), np.zeros((3, 2))
    for k, t in np.argwhere(response.gradient_error):
        alone = np.zeros((3, 2))
        alone[k, t] = response.gradient_error[k, t]
        yield np.zeros(3), alone


def imbalance(scene: scenes.Scene, tables: dict[str, PressureTable], body: RigidBody) -> tuple[float, float]:
    """How far the centred, level sail is from equilibrium: largest of |F_x|, |F_y|, |τ_x|, |τ_y|, |τ_z| over F_z.

    Or the distance of the centre of mass from the middle of the disc, if that is larger. Where the sail turns in a beam
    that is not round, |τ_z| is that of the mean over a turn; by how much the rest makes the spin swing comes second, as
    a share of it: |τ_z|/(2 I_z Ω²), as that of a beam with two planes of symmetry goes with twice the yaw.
    """
    (light, turning), g = lit(scene, body), body.sail.g
    q = np.array([cell.q for cell in responses(scene, tables)])
    lateral = q[:, :1] * g + q[:, 1:2] * np.stack([-g[:, 1], g[:, 0]], axis=1)
    force = light.zeroth @ np.column_stack([lateral, q[:, 2]])
    torque = (light.first * q[:, 2:]).sum(axis=-2)
    twist = (light.first[..., 0] * lateral[:, 1] - light.first[..., 1] * lateral[:, 0]).sum(axis=-1)
    largest = max(np.abs(force[..., :2]).max(), np.abs(torque).max(), abs(np.mean(twist)))
    load, swing = float(largest / (np.abs(force[..., 2]).max() or 1.0)), 0.0
    if turning:
        spin = 2.0 * np.pi * scene.release.spin_Hz * body.units.time
        swing = float(np.abs(twist - np.mean(twist)).max() / (2.0 * body.sail.inertia[2, 2] * spin**2))
    return max(load, float(np.hypot(*body.shape.centre)) / body.units.length), swing
