"""Constant-strain triangles: plane stress in a thin sheet without bending stiffness, exact for any triangle.

With the squared sides q_i = ℓ_i² of a triangle, d_i = q_i − λ²L_i² and c_i the cotangent of the rest angle opposite
side i, its Green strain relative to the free, thermally expanded triangle has

    tr E = c·d/(4A),  det E = (2(d₀d₁ + d₁d₂ + d₂d₀) − d·d)/(64A²),

and the St Venant–Kirchhoff energy U = A h Y/(1 − ν²) ½[(tr E)² − 2(1 − ν) det E] has ∂U/∂q_i as a linear function of d:
forces act along the sides, as in springs (Delingette, IEEE Trans. Vis. Comput. Graphics 14 (2008) 329). So momentum and
angular momentum are kept to rounding. Nothing is divided by a length: a triangle may shrink to nothing or turn over.
The forces are in `stencil`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.bodies import free_squares
from dynamics.membrane.effects import springs
from dynamics.membrane.effects.interface import (
    Decision,
    Plan,
    Setup,
    hook,
    needs_heat,
    only_if,
    own,
    slots,
    starts,
    unsigned,
)
from dynamics.membrane.effects.springs import REFERENCE_TEMPERATURE
from dynamics.membrane.lattice import cotangents, per_triangle, sheet_modulus
from dynamics.membrane.layout import rows
from dynamics.membrane.layout.rows import Stencil
from dynamics.membrane.layout.triangles import Patch, sides
from dynamics.membrane.state import State
from dynamics.scene.schema import Scene

NAME = "sheet"
COST = "a pass over all triangles in each step; expansion new free lengths whenever temperatures change"
#: Of triangles, or of the springs that stand for them.
COLUMNS = {"strain_max": (1, "1"), "strain_min": (1, "1"), "energy_elastic": (1, "J")}
_STRAIN_MAX, _STRAIN_MIN, _ENERGY = starts(COLUMNS)


def _expansion(scene: Scene, so_far: Plan) -> Decision:
    """Do triangles or springs expand with temperature."""
    given = scene.flight.expansion_1_K
    materials = [region.properties for region in scene.sail.regions]
    expands = given != 0 if given is not None else any(m.highest("expansion_1_K") > 0 for m in materials)
    return Decision(on=expands, reason="expansion coefficient given" if expands else "expansion zero")


PLAN = {"expansion": needs_heat(_expansion)}


class Sheet(NamedTuple):
    """Triangles as elastic elements, all arrays empty where springs carry the load.

    sides (3t,): edges of the sides 01, then 12, then 20 of all triangles. rest (3t,): their squared rest lengths in m²,
    free (3t,): the squared free ones at 300 K, the same but for a sail under a tension of its own.
    cotangent (3t,): of the opposite rest angles. area (t,): 4A in m². modulus (t,): h Y/(8(1 − ν²)A) in N/m³; shear
    (t,): modulus · (1 − ν). poisson (t,). slots (2, e): positions, in [the 3t sides, 0], of the tensions of each edge,
    empty without damping and where no triangle is removed.
    limit (t,): 4A(1 − ν²)σ/Y in m², σ the tensile strength; empty where nothing tears. expansion (t,): thermal
    expansion in 1/K, empty where it is off.
    """

    sides: Indices
    rest: Floats
    free: Floats
    cotangent: Floats
    area: Floats
    modulus: Floats
    shear: Floats
    poisson: Floats
    slots: Indices
    limit: Floats
    expansion: Floats


class SheetWork(NamedTuple):
    """Modulus, shear and limit (t,) as they are now: 0, 0 and ∞ where a triangle has been removed.

    They are the sheet's own arrays where none can be.
    """

    modulus: Floats
    shear: Floats
    limit: Floats


def build(setup: Setup) -> Sheet:
    """The triangles of the mesh; empty where springs carry the load."""
    scene, mesh, sail = setup.scene, setup.mesh, setup.scene.sail
    on, t = scene.flight.stiffness == "triangles", len(mesh.triangles)
    poisson, young = per_triangle(sail, mesh, "poisson"), per_triangle(sail, mesh, "young_Pa")
    limit = 4.0 * mesh.areas * (1.0 - poisson**2) * per_triangle(sail, mesh, "strength_Pa") / young
    expansion = per_triangle(sail, mesh, "expansion_1_K")
    if scene.flight.expansion_1_K is not None:
        expansion = np.full(t, scene.flight.expansion_1_K)
    of_edges = mesh.triangle_edges.T.ravel()
    lists = np.empty((2, 0), np.uint32)
    if on and (setup.on("damping") or scene.flight.on_failure == "remove"):
        lists = slots(of_edges, len(mesh.edges), np.arange(3 * t), 3 * t)
    modulus, rest = sheet_modulus(sail, mesh), only_if(on, mesh.lengths[of_edges] ** 2)
    return Sheet(
        sides=unsigned(of_edges if on else []),
        rest=rest,
        free=free_squares(scene, mesh, rest),
        cotangent=only_if(on, cotangents(mesh).T.ravel()),
        area=only_if(on, 4.0 * mesh.areas),
        modulus=only_if(on, modulus),
        shear=only_if(on, modulus * (1.0 - poisson)),
        poisson=only_if(on, poisson),
        slots=lists,
        limit=only_if(on and setup.on("tensile_failure"), limit),
        expansion=only_if(on and setup.on("expansion"), expansion),
    )


def work(model: Model) -> SheetWork:
    """What all triangles carry when none is torn."""
    sheet, tearing = model.effects.sheet, model.effects.tearing
    return SheetWork(
        modulus=own(sheet.modulus, tearing.removed > 0),
        shear=own(sheet.shear, tearing.removed > 0),
        limit=own(sheet.limit, tearing.counted > 0),
    )


@hook
def lengthen(model: Model, work: WorkSpace, temperature: Floats) -> None:
    """Free lengths at temperature (n,), where triangles expand."""
    grow(model.effects.sheet, model.stencil, model.triangles.corners, temperature, work.stencil.free)


@hook
def write(model: Model, work: WorkSpace, state: State, centre: Floats, row: Floats) -> None:
    """Largest and smallest strain and elastic energy, of triangles or springs."""
    if model.effects.sheet.modulus.size > 0:
        row[_STRAIN_MAX], row[_STRAIN_MIN], row[_ENERGY] = strain_and_energy(
            model.effects.sheet,
            work.effects.sheet,
            model.stencil,
            work.stencil.free,
            model.triangles.corners,
            state.x,
            rows.patch(work.stencil.scratch, 0),
        )
    else:
        row[_STRAIN_MAX], row[_STRAIN_MIN], row[_ENERGY] = springs.strain_and_energy(
            model.effects.springs, state.x, work.effects.springs.free
        )


#: Squared sides 01, 12, 20 of a triangle less the free ones, d in m².
Excess = tuple[float, float, float]


@numba.njit(cache=True, error_model="numpy")
def grow(sheet: Sheet, layout: Stencil, corners: Indices, temperature: Floats, out: Floats) -> None:
    """Squared free lengths λ²L², λ = 1 + α(T − 300 K) at the mean of the corners' T (n,), where triangles expand.

    out (f, 3, p): as in `StencilWork.free`.
    """
    alpha, rest, slots, free = sheet.expansion, sheet.free, layout.slots, out.reshape(-1)
    t = alpha.size
    c0, c1, c2 = corners[0], corners[1], corners[2]
    for i in range(t):
        mean = (temperature[c0[i]] + temperature[c1[i]] + temperature[c2[i]]) / 3.0
        stretch = 1.0 + alpha[i] * (mean - REFERENCE_TEMPERATURE)
        square = stretch * stretch
        free[slots[i]] = square * rest[i]
        free[slots[t + i]] = square * rest[t + i]
        free[slots[2 * t + i]] = square * rest[2 * t + i]


@numba.njit(cache=True, inline="always")
def _square(x: Floats, a: int, b: int) -> float:
    d0, d1, d2 = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
    return d0 * d0 + d1 * d1 + d2 * d2


@numba.njit(cache=True, inline="always")
def excess(layout: Stencil, free: Floats, corners: Indices, x: Floats, i: int) -> Excess:
    """Squared sides less the free ones, of triangle i at nodes x (3, n); free (f, 3, p)."""
    flat, slots, t = free.reshape(-1), layout.slots, corners.shape[1]
    a, b, c = corners[0, i], corners[1, i], corners[2, i]
    return (
        _square(x, a, b) - flat[slots[i]],
        _square(x, b, c) - flat[slots[t + i]],
        _square(x, c, a) - flat[slots[2 * t + i]],
    )


@numba.njit(cache=True, inline="always")
def _trace(sheet: Sheet, d: Excess, i: int) -> float:
    """4A tr E = c·d of triangle i in m²."""
    c, t = sheet.cotangent, sheet.modulus.size
    return c[i] * d[0] + c[t + i] * d[1] + c[2 * t + i] * d[2]


@numba.njit(cache=True, inline="always")
def holds(trace: float, spread: float, poisson: float, limit: float) -> bool:
    """Whether the larger principal stress is below the strength: given 4A tr E, `spread` and the scaled strength.

    The principal strains are (trace ± √spread)/(8A), spread = 16A²((tr E)² − 4 det E). The larger principal stress is
    Y/(1 − ν²) times ½(1 + ν) tr E + ½(1 − ν)√spread/(4A); no root is needed to compare it. False for NaN.
    """
    margin = limit - 0.5 * (1.0 + poisson) * trace
    share = 0.5 * (1.0 - poisson)
    return share * share * spread <= margin * abs(margin)


@numba.njit(cache=True, inline="always")
def _spread(sheet: Sheet, d: Excess, trace: float, i: int) -> float:
    """16A²((tr E)² − 4 det E) of triangle i; nothing cancels, as the equal part is taken out."""
    t, equal = sheet.modulus.size, trace / sheet.area[i]
    p, q, r = d[0] - equal * sheet.rest[i], d[1] - equal * sheet.rest[t + i], d[2] - equal * sheet.rest[2 * t + i]
    return 2.0 * (p * p + q * q + r * r) - (p + q + r) * (p + q + r)


@numba.njit(cache=True, inline="always")
def _stretch(green: float) -> float:
    """Relative change of length √(1 + 2E) − 1 of a Green strain E."""
    return 2.0 * green / (1.0 + math.sqrt(max(1.0 + 2.0 * green, 0.0)))


@numba.njit(cache=True, inline="always")
def _green(sheet: Sheet, d: Excess, i: int) -> tuple[float, float]:
    """Larger and smaller principal Green strain of triangle i."""
    trace = _trace(sheet, d, i)
    root, double = math.sqrt(max(_spread(sheet, d, trace, i), 0.0)), 2.0 * sheet.area[i]
    return (trace + root) / double, (trace - root) / double


@numba.njit(cache=True, error_model="numpy")
def _excesses(layout: Stencil, free: Floats, corners: Indices, x: Floats, begin: int, n: int, patch: Patch) -> None:
    """`excess` of n triangles from `begin` on, into the first three lines of the patch's frame."""
    sides(x, corners, begin, n, 0, patch.sides)
    flat, slots, t, e = free.reshape(-1), layout.slots, corners.shape[1], patch.sides
    d0, d1, d2 = patch.frame[0], patch.frame[1], patch.frame[2]
    for i in range(n):
        d0[i] = flat[slots[begin + i]]
        d1[i] = flat[slots[t + begin + i]]
        d2[i] = flat[slots[2 * t + begin + i]]
    a0, a1, a2, b0, b1, b2 = e[0], e[1], e[2], e[3], e[4], e[5]
    for i in range(n):
        c0, c1, c2 = b0[i] - a0[i], b1[i] - a1[i], b2[i] - a2[i]
        d0[i] = a0[i] * a0[i] + a1[i] * a1[i] + a2[i] * a2[i] - d0[i]
        d1[i] = c0 * c0 + c1 * c1 + c2 * c2 - d1[i]
        d2[i] = b0[i] * b0[i] + b1[i] * b1[i] + b2[i] * b2[i] - d2[i]


@numba.njit(cache=True, error_model="numpy")
def _strains(
    sheet: Sheet,
    work: SheetWork,
    layout: Stencil,
    free: Floats,
    corners: Indices,
    x: Floats,
    begin: int,
    n: int,
    patch: Patch,
) -> None:
    """Principal Green strains and energy in J of n triangles from `begin` on, into lines 3, 4 and 5 of the frame."""
    _excesses(layout, free, corners, x, begin, n, patch)
    d0, d1, d2, first, second, energy = (
        patch.frame[0],
        patch.frame[1],
        patch.frame[2],
        patch.frame[3],
        patch.frame[4],
        patch.frame[5],
    )
    for i in range(n):
        d = (d0[i], d1[i], d2[i])
        trace = _trace(sheet, d, begin + i)
        first[i], second[i] = _green(sheet, d, begin + i)
        energy[i] = _energy(work, d, trace, begin + i)


@numba.njit(cache=True, error_model="numpy")
def principal(
    sheet: Sheet, work: SheetWork, layout: Stencil, free: Floats, corners: Indices, x: Floats, patch: Patch, out: Floats
) -> None:
    """Larger and smaller principal elastic strain of all triangles, as relative change of length, into out (2, t).

    x (3, n): nodes; free (f, 3, p): as in the stencil; patch: to work in.
    """
    begin = 0
    while begin < out.shape[1]:
        n = min(patch.sides.shape[1], out.shape[1] - begin)
        _strains(sheet, work, layout, free, corners, x, begin, n, patch)
        for i in range(n):
            out[0, begin + i], out[1, begin + i] = _stretch(patch.frame[3, i]), _stretch(patch.frame[4, i])
        begin += n


@numba.njit(cache=True, inline="always")
def _energy(work: SheetWork, d: Excess, trace: float, i: int) -> float:
    """Elastic energy of triangle i in J."""
    p, q, r = d
    total = p + q + r
    form = total * total - 2.0 * (p * p + q * q + r * r)
    return 0.25 * (work.modulus[i] * trace * trace - 0.5 * work.shear[i] * form)


@standalone()
def strain_and_energy(
    sheet: Sheet, work: SheetWork, layout: Stencil, free: Floats, corners: Indices, x: Floats, patch: Patch
) -> tuple[float, float, float]:
    """Largest and smallest principal strain, and elastic energy in J, at nodes x (3, n); otherwise as `principal`."""
    largest, smallest, total, begin = -np.inf, np.inf, 0.0, 0
    while begin < sheet.modulus.size:
        n = min(patch.sides.shape[1], sheet.modulus.size - begin)
        _strains(sheet, work, layout, free, corners, x, begin, n, patch)
        for i in range(n):
            if work.modulus[begin + i] > 0.0:
                largest = max(largest, patch.frame[3, i])
                smallest = min(smallest, patch.frame[4, i])
                total += patch.frame[5, i]
        begin += n
    if largest < smallest:
        return 0.0, 0.0, 0.0  # no triangle is left
    return _stretch(largest), _stretch(smallest), total


@numba.njit(cache=True, inline="always")
def tears(sheet: Sheet, work: SheetWork, d: Excess, i: int) -> bool:
    """Is triangle i above its strength."""
    trace = _trace(sheet, d, i)
    return sheet.limit.size > 0 and not holds(trace, _spread(sheet, d, trace, i), sheet.poisson[i], work.limit[i])


@numba.njit(cache=True, error_model="numpy")
def first_torn(
    sheet: Sheet, work: SheetWork, layout: Stencil, free: Floats, corners: Indices, x: Floats
) -> tuple[int, bool]:
    """Lowest triangle above its strength, or one that is not finite, which wins; is it finite. −1 if there is none.

    Corners (3, triangles), nodes x (3, n) in m.
    """
    torn = -1
    for i in range(sheet.modulus.size):
        d = excess(layout, free, corners, x, i)
        if not abs(_trace(sheet, d, i)) < np.inf:
            return i, False
        if torn < 0 and tears(sheet, work, d, i):
            torn = i
    return torn, True
