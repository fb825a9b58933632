"""Derivatives of force and torque at the centred, level sail, from the response of its cells around normal incidence.

They are linear in that response: every sector adds its q and ∂q/∂(u, v), weighted with moments of the light on it. So
errors of a table, and thousands of designs, cost as much as a sum. Normalised units of `dynamics.rigid.body`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from beamrider.arrays import Floats
from dynamics.rigid.body import RigidBody
from dynamics.scene import schema as scenes
from optics.table.normal_incidence import NormalResponse, constant_response, table_response
from optics.table.pressure_table import PressureTable

ROWS = ("F_x", "F_y", "tau_x", "tau_y")
COLUMNS = ("x", "y", "roll", "pitch")


@dataclass(frozen=True)
class Moments:
    """Moments of e = exp(−2ρ²/w²) over each of n_s sectors, batches in front: ∫e dA, ∫e X_i dA, ∫e X_i X_j dA.

    radius (...,): of the beam, in the unit of length of the moments.
    """

    zeroth: Floats
    first: Floats
    second: Floats
    radius: Floats


def moments(start: Floats, stop: Floats, sail_radius: Floats | float, beam_radius: Floats | float) -> Moments:
    """Moments over sectors from polar angle start to stop (..., n_s) of a disc with the beam on its middle.

    Closed forms of ∫ rᵏ exp(−2r²/w²) dr, k = 1, 2, 3, by parts, times integrals over the angle.
    """
    edge, w = (np.asarray(x, float)[..., None] for x in (sail_radius, beam_radius))
    end = np.exp(-2.0 * edge**2 / w**2)
    area = w**2 / 4.0 * (1.0 - end)
    lever = w**2 / 4.0 * (w * np.sqrt(np.pi / 8.0) * erf(np.sqrt(2.0) * edge / w) - edge * end)
    square = w**2 / 4.0 * (2.0 * area - edge**2 * end)
    span, double = stop - start, (np.sin(2.0 * stop) - np.sin(2.0 * start)) / 2.0
    mixed = np.sin(stop) ** 2 - np.sin(start) ** 2
    first = np.stack([np.sin(stop) - np.sin(start), np.cos(start) - np.cos(stop)], axis=-1)
    second = np.stack([span + double, mixed, mixed, span - double], axis=-1).reshape(*span.shape, 2, 2) / 2.0
    return Moments(
        area * span, lever[..., None] * first, square[..., None, None] * second, np.asarray(beam_radius, float)
    )


def body_moments(body: RigidBody) -> Moments:
    """Moments of a rigid body's sectors and beam, in its units."""
    sectors, unit = body.shape.sectors, body.units.length
    start, stop = (np.array([getattr(s, name) for s in sectors]) for name in ("start", "stop"))
    return moments(start, stop, body.shape.radius / unit, body.light.radius)


def derivatives(g: Floats, q: Floats, gradient: Floats, light: Moments) -> tuple[Floats, Floats]:
    """(∂(F_x, F_y, τ_x, τ_y)/∂(x, y, roll, pitch) (..., 4, 4), thrust (...,)) from the response of each sector.

    g (..., n_s, 2): direction across the ridges in body x, y; q (..., n_s, 3) and gradient (..., n_s, 3, 2) over
    (u, v), in (g, r, n). The light on a tilted sail comes along k = (−pitch, roll, 1) in body components; the force,
    which turns with the sail, tilts its thrust; intensity falls off as −4X/w² e (Gao, Kelzenberg & Atwater,
    supplementary text). Force in lab components, torque in body components.
    """
    frame = np.stack([g, np.stack([-g[..., 1], g[..., 0]], axis=-1)], axis=-2)  # rows g and r
    turned = np.einsum("...sij,...sjt->...sit", gradient, np.stack([frame[..., 1], -frame[..., 0]], axis=-1))
    lateral = np.einsum("...sk,...ski->...si", q[..., :2], frame)
    lateral_tilt = np.einsum("...skt,...ski->...sit", turned[..., :2, :], frame)
    fall = -4.0 / light.radius[..., None, None] ** 2
    about = np.array([[0.0, 1.0], [-1.0, 0.0]])  # τ = (Y, −X) q_n
    out = np.zeros((*np.broadcast_shapes(q.shape[:-2], light.zeroth.shape[:-1]), 4, 4))
    out[..., :2, :2] = fall * np.einsum("...si,...sj->...ij", lateral, light.first)
    out[..., 2:, :2] = fall * np.einsum("ki,...sij,...s->...kj", about, light.second, q[..., 2])
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


def linearise(scene: scenes.Scene, tables: dict[str, PressureTable], body: RigidBody) -> tuple[Floats, float]:
    """(jacobian (4, 4), thrust) of a scene's body."""
    cells = responses(scene, tables)
    q, gradient = np.array([cell.q for cell in cells]), np.array([cell.gradient for cell in cells])
    jacobian, thrust = derivatives(body.sail.g, q, gradient, body_moments(body))
    return jacobian, float(thrust)


def error_modes(
    scene: scenes.Scene, tables: dict[str, PressureTable], body: RigidBody
) -> list[tuple[Floats, float]]:
    """What the tables' errors do to (jacobian (4, 4), thrust): one entry for each number that may be wrong."""
    light = body_moments(body)
    out = []
    for design in scene.sail.designs:
        mine = np.array([sector.design == design for sector in scene.sail.sectors], float)
        for q, gradient in _errors(table_response(tables[design])):
            jacobian, thrust = derivatives(body.sail.g, np.outer(mine, q), mine[:, None, None] * gradient, light)
            out.append((jacobian, float(thrust)))
    return out


def _errors(response: NormalResponse) -> Iterator[tuple[Floats, Floats]]:
    """(q, gradient) that hold one error each."""
    for k in np.flatnonzero(response.q_error):
        yield np.where(np.arange(3) == k, response.q_error, 0.0), np.zeros((3, 2))
    for k, t in np.argwhere(response.gradient_error):
        alone = np.zeros((3, 2))
        alone[k, t] = response.gradient_error[k, t]
        yield np.zeros(3), alone


def imbalance(scene: scenes.Scene, tables: dict[str, PressureTable], body: RigidBody) -> float:
    """How far the centred, level sail is from equilibrium: largest of |F_x|, |F_y|, |τ_x|, |τ_y|, |τ_z| over F_z.

    Or the distance of the centre of mass from the middle of the disc, if that is larger.
    """
    light, g = body_moments(body), body.sail.g
    q = np.array([cell.q for cell in responses(scene, tables)])
    lateral = q[:, :1] * g + q[:, 1:2] * np.stack([-g[:, 1], g[:, 0]], axis=1)
    force = light.zeroth @ np.column_stack([lateral, q[:, 2]])
    torque = (light.first * q[:, 2:]).sum(axis=0)
    twist = (light.first[:, 0] * lateral[:, 1] - light.first[:, 1] * lateral[:, 0]).sum()
    load = float(np.abs([*force[:2], *torque, twist]).max() / (abs(force[2]) or 1.0))
    return max(load, float(np.hypot(*body.shape.centre)) / body.units.length)
