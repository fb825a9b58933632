"""Point masses on tethers to the sail, which live beside its nodes.

A tether without mass ends on a triangle, whose corners share its force as their places make up that of its end:
momentum and angular momentum are kept to rounding. Its tension is k (ℓ − L + τ dℓ/dt), never negative but for struts;
once above its strength it is gone for ever.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Indices
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.bodies import inertial, mounted
from dynamics.membrane.effects.held import Holder, field
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, only_if, unsigned
from dynamics.sail import payload
from dynamics.scene.schema import Scene

NAME = "tethers"
COST = "a sum over the tethers in each step; steps are taken one at a time"


def _payload(scene: Scene, so_far: Plan) -> Decision:
    return Decision(on=bool(scene.payload), reason=f"{len(scene.payload)} point masses on tethers")


PLAN = {"payload": _payload}


class Tethers(NamedTuple):
    """b masses (b,) in kg, at `start` (3, b) in m before the spin-up, and k tethers; none where there is no payload.

    body (k,): their masses. corners, weights (3, k): nodes that share their ends, and their shares. stiffness (k,) in
    N/m, length (k,) in m, retardation (k,) in s, strength (k,) in N; pushes (k,): 1 for struts, else 0.
    per_mass (n,) in 1/kg of the nodes, 0 where they are held fast.
    """

    mass: Floats
    start: Floats
    body: Indices
    corners: Indices
    weights: Floats
    stiffness: Floats
    length: Floats
    retardation: Floats
    strength: Floats
    pushes: Floats
    per_mass: Floats


class TetherWork(NamedTuple):
    """The masses' x, v in m, m/s and acceleration (3, b); tension (k,) in N; snapped (k,): 1 for tethers that are gone.

    force (3, b) in N: of the tethers on the masses.
    """

    x: Floats
    v: Floats
    acceleration: Floats
    force: Floats
    tension: Floats
    snapped: NDArray[np.int64]


def build(setup: Setup) -> Tethers:
    """The payload of a scene; InputError where a tether misses the sail."""
    scene, mesh, masses = setup.scene, setup.mesh, setup.lattice.masses
    found = payload.tethers(scene.carried)
    corners, weights = payload.on_mesh(found.to, mesh, f"{scene.name}.yaml")
    ends = np.einsum("kj,kjc->kc", weights, mesh.nodes[corners])
    middle = masses @ mesh.nodes / masses.sum()
    return Tethers(
        mass=found.mass,
        start=np.ascontiguousarray(mounted(scene, (found.position - middle).T)),
        body=unsigned(found.body),
        corners=unsigned(corners.T),
        weights=np.ascontiguousarray(weights.T),
        stiffness=found.stiffness,
        length=found.lengths(ends),
        retardation=found.retardation,
        strength=found.strength,
        pushes=found.pushes,
        per_mass=only_if(found.mass.size > 0, 1.0 / inertial(scene, mesh, masses)),
    )


def work(model: Model) -> TetherWork:
    """The masses at rest where they start."""
    lines = model.effects.tethers
    b, k = lines.mass.size, lines.body.size
    v, acceleration, force = np.zeros((3, 3, b))
    return TetherWork(lines.start.copy(), v, acceleration, force, np.zeros(k), np.zeros(k, np.int64))


@hook
def acts_each_step(model: Model) -> bool:
    """Its masses move beside the nodes, which no sweep over rows knows."""
    return model.effects.tethers.mass.size > 0


@hook
def accelerate(model: Model, work: WorkSpace, x: Floats, v: Floats, t: float) -> None:
    """Add the pull of the tethers; theirs on the masses goes to its own work arrays."""
    if model.effects.tethers.mass.size > 0:
        tie(model.effects.tethers, work.effects.tethers, model.effects.held, x, v, t, work.acceleration)


@numba.njit(cache=True, error_model="numpy")
def _end(values: Floats, corners: Indices, weights: Floats, k: int, c: int) -> float:
    """Component c of values (3, n) at the end of tether k."""
    return (
        weights[0, k] * values[c, corners[0, k]]
        + weights[1, k] * values[c, corners[1, k]]
        + weights[2, k] * values[c, corners[2, k]]
    )


@numba.njit(cache=True, error_model="numpy")
def _stretch(tethers: Tethers, work: TetherWork, x: Floats, v: Floats, k: int, away: Floats) -> float:
    """Tension in N of tether k, whose unit vector from the sail to its mass goes to away (3,)."""
    length, rate, body = 0.0, 0.0, tethers.body[k]
    for c in range(3):
        away[c] = work.x[c, body] - _end(x, tethers.corners, tethers.weights, k, c)
        length += away[c] * away[c]
        rate += away[c] * (work.v[c, body] - _end(v, tethers.corners, tethers.weights, k, c))
    length = math.sqrt(length)
    per_length = 1.0 / length if length > 0.0 else 0.0
    for c in range(3):
        away[c] *= per_length
    tension = tethers.stiffness[k] * (length - tethers.length[k] + tethers.retardation[k] * rate * per_length)
    slack = tethers.pushes[k] == 0.0 and (length <= tethers.length[k] or tension < 0.0)
    return 0.0 if slack else tension


@standalone()
def tie(
    tethers: Tethers, work: TetherWork, holder: Holder, x: Floats, v: Floats, t: float, acceleration: Floats
) -> None:
    """Add the tethers' pull on nodes x, v (3, n) to acceleration (3, n); that of the masses, at t in s, to `work`."""
    away = np.empty(3)
    work.force[...] = 0.0
    for k in range(tethers.body.size):
        tension = 0.0
        if work.snapped[k] == 0:
            tension = _stretch(tethers, work, x, v, k, away)
            if tension > tethers.strength[k]:
                work.snapped[k], tension = 1, 0.0
        work.tension[k] = tension
        if tension == 0.0:
            continue
        for c in range(3):
            work.force[c, tethers.body[k]] -= tension * away[c]
            for j in range(3):
                i = tethers.corners[j, k]
                acceleration[c, i] += tethers.weights[j, k] * tension * away[c] * tethers.per_mass[i]
    for c in range(3):
        for b in range(tethers.mass.size):
            work.acceleration[c, b] = work.force[c, b] / tethers.mass[b]
            if holder.acts:
                work.acceleration[c, b] += field(holder, t, c) - holder.drag * work.v[c, b]


@numba.njit(cache=True, error_model="numpy")
def drift(work: TetherWork, kick: float, dt: float) -> None:
    """The masses to the end of a step of dt in s, the present forces acting over `kick` in s, as the nodes move."""
    for c in range(3):
        for b in range(work.x.shape[1]):
            work.v[c, b] += kick * work.acceleration[c, b]
            work.x[c, b] += dt * work.v[c, b]


@numba.njit(cache=True, error_model="numpy")
def settle(work: TetherWork, dt: float) -> None:
    """The second half kick of a step by velocity Verlet."""
    for c in range(3):
        for b in range(work.x.shape[1]):
            work.v[c, b] += 0.5 * dt * work.acceleration[c, b]


@numba.njit(cache=True, error_model="numpy")
def turn_on(work: TetherWork, turn: float) -> None:
    """The spin-up's change `turn` in rad/s of the turn about z, as `spin.kick` gives the nodes."""
    for b in range(work.x.shape[1]):
        work.v[0, b] -= turn * work.x[1, b]
        work.v[1, b] += turn * work.x[0, b]


def payload_columns(masses: int, lines: int) -> dict[str, tuple[int, str]]:
    """Names, widths and units of what `note` writes about so many masses and tethers."""
    if masses == 0:
        return {}
    return {
        "payload_position": (3 * masses, "m"),
        "payload_velocity": (3 * masses, "m/s"),
        "tether_tension": (lines, "N"),
        "tethers_snapped": (lines, "1"),
    }


def width(masses: int, lines: int) -> int:
    """How many numbers a row has about the payload."""
    return 6 * masses + 2 * lines if masses else 0


@numba.njit(cache=True, error_model="numpy")
def note(work: TetherWork, row: Floats) -> None:
    """The numbers of `payload_columns` into row (width,)."""
    masses, lines = work.x.shape[1], work.tension.size
    for b in range(masses):
        for c in range(3):
            row[3 * b + c] = work.x[c, b]
            row[3 * masses + 3 * b + c] = work.v[c, b]
    for k in range(lines):
        row[6 * masses + k] = work.tension[k]
        row[6 * masses + lines + k] = work.snapped[k]
