"""Light that one part of a specular sail throws on another: rays from every lit triangle, traced from hit to hit.

A ray of power P and unit direction d that meets a triangle of normal n at the cosine |d·n|, from whichever side, gives

    F = (P/c)(2R (d·n) n + a d),  heat = a P,

and goes on from there with R P along d − 2(d·n)n. What passes through is dropped. R and a are means over polarisation,
or those of the ray's own field, which is then followed from hit to hit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Integers
from beamrider.io.files import InputError
from beamrider.machine_code.standalone import standalone
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects import polarisation, tearing
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, starts
from dynamics.membrane.effects.light_pressure import HeldLight, LightPressure
from dynamics.membrane.effects.polarisation import Polariser
from dynamics.membrane.effects.tables import table
from dynamics.membrane.effects.tree import Tree, build_tree, nearest, refit
from dynamics.membrane.layout import rows
from dynamics.membrane.layout.triangles import Patch
from dynamics.membrane.state import State
from dynamics.sail.shapes import rim_slope
from dynamics.scene.schema import Scene
from optics.table.pressure_table import lookup

NAME = "reflections"
COST = "a search of the triangle that each ray hits, for all rays of all triangles, every flight.optics_every steps"
#: What leaves the sail in traced rays; 0 where reflections are off.
COLUMNS = {"power_reflected": (1, "W")}
(_REFLECTED,) = starts(COLUMNS)


def _reflections(scene: Scene, so_far: Plan) -> Decision:
    """Whether light along the axis can meet the sail twice.

    Off a slope s it leaves at 2s from where it came; the rest of the sail lies at most by the steepest slope S above
    the horizon, so 3S > 90° is needed, and a tilt adds to S.
    """
    steep = math.degrees(rim_slope(scene.sail)) + math.hypot(scene.release.pitch_deg, scene.release.roll_deg)
    bright = any(region.design or region.reflectance for region in scene.sail.regions)
    if not (scene.beam.intensity_W_m2 > 0 and bright):
        return Decision(on=False, reason="nothing reflects light")
    if scene.reflections.polarisation == "tracked":
        return Decision(on=True, reason="the light's polarisation is tracked, from its first hit on")
    if scene.sail.profile == "flat":
        return Decision(on=False, reason="a flat sail does not reflect onto itself")
    if steep <= 30.0:
        return Decision(on=False, reason=f"slopes of {steep:.3g}°, up to 30° no light meets the sail twice")
    return Decision(on=True, reason=f"slopes of {steep:.3g}°, above 30°, and reflecting")


PLAN = {"reflections": _reflections}

#: Entries of the account of a trace: power in W that leaves, passes through at a hit, is absorbed at a hit, is left in
#: rays that were given up, and how many hits; then the momentum flow in N that leaves (three components).
LEAVES, THROUGH, ABSORBED, GIVEN_UP, HITS, MOMENTUM = range(6)


class Mirror(NamedTuple):
    """The sail as mirrors; no triangles where reflections are off.

    kind (t,): table of each triangle, or −1 for constant response. last: largest sine in each table. bounces: hits of a
    ray, at most. rays: sub-triangles a side, each of which sends a ray. cutoff: share of the first power below which a
    ray is given up. least: distance in m that a ray must go between hits. polariser: the field of the rays.
    """

    tree: Tree
    kind: Integers
    last: Floats
    bounces: int
    rays: int
    cutoff: float
    least: float
    polariser: Polariser


class MirrorWork(NamedTuple):
    """Work space: boxes of the tree, force (3, t) in N, heat (t,) in W, the account (8,) of a trace.

    ray (3, 3): origin, direction and inverse direction of the ray under way; stack: of the search. field (2, 3): real
    and imaginary part of the field of the ray under way; first (2, 3): of all rays of a triangle as they leave it.
    """

    boxes: Floats
    force: Floats
    heat: Floats
    stack: Integers
    ray: Floats
    field: Floats
    first: Floats
    account: Floats


def build(setup: Setup) -> Mirror:
    """The sail as mirrors; InputError where a region is a grating, which throws light in more than one direction."""
    scene, mesh = setup.scene, setup.mesh
    on, given, designs = setup.on("light") and setup.on("reflections"), scene.reflections, scene.sail.designs
    gratings = [design for design in designs if on and not setup.tables[design].axisymmetric]
    if gratings:
        raise InputError(
            f"{scene.name}.yaml: effects.reflections: '{gratings[0]}' is a grating; only light from specular films is "
            "traced: set effects.reflections: false"
        )
    kinds = np.array([designs.index(r.design) if r.design else -1 for r in scene.sail.regions])[mesh.sector]
    centres = mesh.nodes[mesh.triangles].mean(axis=1)
    return Mirror(
        tree=build_tree(centres if on else centres[:0]),
        kind=kinds if on else kinds[:0],
        last=np.array([setup.tables[design].u[-1] for design in designs] if on else [], float),
        bounces=given.bounces,
        rays=given.rays_a_side,
        cutoff=given.cutoff,
        least=1e-9 * float(np.ptp(mesh.nodes, axis=0).max()),
        polariser=polarisation.polariser(setup, on),
    )


def work(model: Model) -> MirrorWork:
    """Work space for tracing rays; next to nothing where that is off."""
    mirror = model.effects.reflections
    t, leaves = mirror.kind.size, mirror.tree.bounds.size - 1
    return MirrorWork(
        boxes=np.zeros((2 * leaves - 1 if t else 0, 6)),
        force=np.zeros((3, t)),
        heat=np.zeros(t),
        stack=np.zeros(64 if t else 0, np.int64),
        ray=np.zeros((3, 3)),
        field=np.zeros((2, 3)),
        first=np.zeros((2, 3)),
        account=np.zeros(8),
    )


@hook
def relight(model: Model, work: WorkSpace, x: Floats, t: float) -> None:
    """Add the light reflected within the sail of nodes x (3, n) at time t in s."""
    if model.effects.reflections.kind.size > 0:
        patch = rows.patch(work.stencil.scratch, 0)
        bounce(
            model.effects.reflections,
            work.effects.reflections,
            model.effects.light,
            work.effects.light,
            patch,
            x,
            work.effects.tearing.gone,
            t,
        )
        rows.hold(model.stencil, patch.response, 0, 0, model.stencil.cells.size, work.stencil.held)
        tearing.remove_all_light(work.effects.tearing, work.effects.light, model.stencil, work.stencil.held)


@hook
def write(model: Model, work: WorkSpace, state: State, centre: Floats, row: Floats) -> None:
    """Power that leaves the sail after its last hit."""
    if work.gain[0] > 0.0:
        row[_REFLECTED] = work.gain[0] * work.effects.reflections.account[LEAVES]


@numba.njit(cache=True, error_model="numpy")
def response(mirror: Mirror, light: LightPressure, absorptance: Floats, i: int, cosine: float) -> tuple[float, float]:
    """Reflectance and absorptance of triangle i for light at that cosine of incidence; see `light_pressure` for films.

    absorptance (t,): as it is now, −f for f times the table's. A film's table holds q_n = (2R + a) cos and, along the
    light, a sin.
    """
    kind = mirror.kind[i]
    if kind < 0:
        return light.reflectance[i], absorptance[i]
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    last = mirror.last[kind]
    along, _, normal, absorbed, _ = lookup(table(light.tables, kind), sine, 0.0)
    loss = along / min(sine, last) if sine > 1e-6 else absorbed
    heat = absorptance[i] if absorptance[i] >= 0.0 else -absorptance[i] * absorbed
    # Beyond the table's last sine the ratio would no longer be that of one direction
    at = max(cosine, math.sqrt(max(1.0 - last * last, 1e-12)))
    return min(max(0.5 * (normal / at - loss), 0.0), 1.0 - heat), heat


@numba.njit(cache=True, error_model="numpy")
def _shares(
    mirror: Mirror,
    work: MirrorWork,
    light: LightPressure,
    held: HeldLight,
    frame: Floats,
    j: int,
    direction: Floats,
    cosine: float,
) -> tuple[float, float]:
    """Share of a ray's power that triangle j reflects and absorbs; turns the field where that is tracked."""
    if not mirror.polariser.tracked:
        return response(mirror, light, held.absorptance, j, cosine)
    last = mirror.last[mirror.kind[j]] if mirror.kind[j] >= 0 else 1.0
    found = polarisation.film(mirror.polariser, light, mirror.kind[j], last, held.absorptance[j], j, cosine)
    return polarisation.reflect(found, direction, frame[:3, j], work.field)


@numba.njit(cache=True, error_model="numpy")
def _strike(
    mirror: Mirror,
    work: MirrorWork,
    light: LightPressure,
    held: HeldLight,
    frame: Floats,
    j: int,
    direction: Floats,
    power: float,
) -> float:
    """Force and heat of a ray on triangle j; turns the direction and returns the power that goes on."""
    n0, n1, n2 = frame[0, j], frame[1, j], frame[2, j]
    across = direction[0] * n0 + direction[1] * n1 + direction[2] * n2
    share, loss = _shares(mirror, work, light, held, frame, j, direction, min(abs(across), 1.0))
    scale, push = power / LIGHT_SPEED, 2.0 * share * across
    work.force[0, j] += scale * (push * n0 + loss * direction[0])
    work.force[1, j] += scale * (push * n1 + loss * direction[1])
    work.force[2, j] += scale * (push * n2 + loss * direction[2])
    work.heat[j] += loss * power
    work.account[ABSORBED] += loss * power
    work.account[THROUGH] += (1.0 - share - loss) * power
    work.account[HITS] += 1.0
    direction[0] -= 2.0 * across * n0
    direction[1] -= 2.0 * across * n1
    direction[2] -= 2.0 * across * n2
    return share * power


@numba.njit(cache=True, error_model="numpy")
def _follow(
    mirror: Mirror,
    work: MirrorWork,
    light: LightPressure,
    held: HeldLight,
    frame: Floats,
    x: Floats,
    i: int,
    power: float,
    gone: Integers,
) -> None:
    """One ray from triangle i until it leaves, has hit often enough, or is too weak."""
    weakest, own = mirror.cutoff * power, i
    origin, direction = work.ray[0], work.ray[1]
    for _ in range(mirror.bounces):
        j, distance = nearest(
            mirror.tree,
            work.boxes,
            x,
            light.corners,
            origin,
            direction,
            own,
            mirror.least,
            gone,
            work.stack,
            work.ray[2],
        )
        if j < 0:
            work.account[LEAVES] += power
            for c in range(3):
                work.account[MOMENTUM + c] += power * direction[c] / LIGHT_SPEED
            return
        for c in range(3):
            origin[c] += distance * direction[c]
        power = _strike(mirror, work, light, held, frame, j, direction, power)
        own = j
        if power <= weakest:
            break
    work.account[GIVEN_UP] += power


@numba.njit(cache=True, error_model="numpy")
def _first(
    mirror: Mirror, work: MirrorWork, light: LightPressure, held: HeldLight, frame: Floats, i: int, angle: float
) -> float:
    """Reflected share of the beam on triangle i; where polarisation is tracked, also the field its rays begin with.

    The held light has force and heat of the mean over polarisation: what the field at `angle` changes of that is added.
    """
    across = frame[2, i]
    mean, lost = response(mirror, light, held.absorptance, i, abs(across))
    if not mirror.polariser.tracked:
        return mean
    beam, field = work.ray[1], work.field
    beam[0], beam[1], beam[2] = 0.0, 0.0, 1.0
    field[0, 0], field[0, 1], field[0, 2] = math.cos(angle), math.sin(angle), 0.0
    field[1, 0], field[1, 1], field[1, 2] = 0.0, 0.0, 0.0
    share, loss = _shares(mirror, work, light, held, frame, i, beam, min(abs(across), 1.0))
    scale = held.incident[i] / LIGHT_SPEED
    for c in range(3):
        work.force[c, i] += scale * (2.0 * (share - mean) * across * frame[c, i] + (loss - lost) * beam[c])
    work.heat[i] += (loss - lost) * held.incident[i]
    work.first[...] = field
    return share


@numba.njit(cache=True, error_model="numpy")
def _send(
    mirror: Mirror,
    work: MirrorWork,
    light: LightPressure,
    held: HeldLight,
    frame: Floats,
    x: Floats,
    i: int,
    power: float,
    gone: Integers,
) -> None:
    """Rays of equal power from the centres of the rays² equal parts of triangle i, for light along +z."""
    m, n2 = mirror.rays, frame[2, i]
    origin, direction = work.ray[0], work.ray[1]
    p, q, s = light.corners[0, i], light.corners[1, i], light.corners[2, i]
    for a in range(m):
        for b in range(2 * (m - a) - 1):
            # Rows of triangles, every second one upside down
            up = b % 2 == 0
            u, v = (a + (1.0 if up else 2.0) / 3.0) / m, (b // 2 + (1.0 if up else 2.0) / 3.0) / m
            for c in range(3):
                origin[c] = x[c, p] + u * (x[c, q] - x[c, p]) + v * (x[c, s] - x[c, p])
                direction[c] = -2.0 * n2 * frame[c, i]
            direction[2] += 1.0
            work.field[...] = work.first
            _follow(mirror, work, light, held, frame, x, i, power / (m * m), gone)


@numba.njit(cache=True, error_model="numpy")
def _hold(work: MirrorWork, held: HeldLight, patch: Patch) -> None:
    """Add force and heat to those held in the frame of each triangle: F = c₁ e₁ + c₂ e₂ + c₃ e₁ × e₂."""
    e, out = patch.sides, patch.response
    for i in range(work.heat.size):
        a0, a1, a2, b0, b1, b2 = e[0, i], e[1, i], e[2, i], e[3, i], e[4, i], e[5, i]
        n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        f0, f1, f2 = work.force[0, i], work.force[1, i], work.force[2, i]
        square = n0 * n0 + n1 * n1 + n2 * n2
        out[i, 0] += ((f1 * b2 - f2 * b1) * n0 + (f2 * b0 - f0 * b2) * n1 + (f0 * b1 - f1 * b0) * n2) / square
        out[i, 1] += ((a1 * f2 - a2 * f1) * n0 + (a2 * f0 - a0 * f2) * n1 + (a0 * f1 - a1 * f0) * n2) / square
        out[i, 2] += (f0 * n0 + f1 * n1 + f2 * n2) / square
        held.absorbed[i] += work.heat[i]


@standalone()
def bounce(
    mirror: Mirror,
    work: MirrorWork,
    light: LightPressure,
    held: HeldLight,
    patch: Patch,
    x: Floats,
    gone: Integers,
    t: float,
) -> None:
    """Add the light reflected within the sail, right after `respond`, to the coefficients in a patch of it all.

    x (3, n): nodes; gone (t,): not 0 for removed triangles, or empty. t: time in s of these positions.
    """
    refit(mirror.tree, x, light.corners, work.boxes)
    for i in range(work.heat.size):
        work.heat[i] = 0.0
        for c in range(3):
            work.force[c, i] = 0.0
    for k in range(work.account.size):
        work.account[k] = 0.0
    angle = polarisation.azimuth(mirror.polariser, x, t)
    for i in range(work.heat.size):
        power = _first(mirror, work, light, held, patch.frame, i, angle) * held.incident[i]
        if power > 0.0:
            _send(mirror, work, light, held, patch.frame, x, i, power, gone)
    _hold(work, held, patch)
