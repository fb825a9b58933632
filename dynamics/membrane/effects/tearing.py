"""Triangles that fail while the flight goes on: recorded, or removed from the sail with all they do."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Indices
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects import sheet
from dynamics.membrane.effects.failure import INTACT, NON_FINITE, hot_corner
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, needs_heat, only_if, starts
from dynamics.membrane.effects.light_pressure import HeldLight
from dynamics.membrane.effects.sheet import Sheet, SheetWork
from dynamics.membrane.effects.springs import Springs
from dynamics.membrane.effects.thermal import Heat, HeatWork
from dynamics.membrane.layout import rows
from dynamics.membrane.layout.rows import Stencil, StencilWork
from dynamics.membrane.state import State
from dynamics.scene.schema import Scene

NAME = "tearing"
COST = "a test of each element in every step, of each node whenever temperatures change"
COLUMNS = {"failed_tensile": (1, "1"), "failed_thermal": (1, "1")}
_TENSILE, _THERMAL = starts(COLUMNS)


def _tensile(scene: Scene, so_far: Plan) -> Decision:
    return Decision(on=True, reason="every material has a strength")


def _thermal(scene: Scene, so_far: Plan) -> Decision:
    return Decision(on=True, reason="every material has a failure temperature")


PLAN = {"tensile_failure": _tensile, "thermal_failure": needs_heat(_thermal)}

#: Entries of `Broken.tally`: failures by stress and by heat, the first triangle to fail, and its kind (0 or 1).
BY_STRESS, BY_HEAT, FIRST, KIND = range(4)


class Tearing(NamedTuple):
    """What becomes of a triangle that fails.

    counted, removed: of how many triangles it is noted that they failed, or that they are gone; 0 where the first
    failure ends the flight, or where none is removed. most: failed triangles that a flight outlives. shares (3t,): what
    each triangle gives its sides 01, then 12, then 20 of their conductance in W/K; empty where none is removed.
    """

    counted: int
    removed: int
    most: int
    shares: Floats


class Broken(NamedTuple):
    """Failed triangles; no arrays where the first failure ends the flight.

    failed (t,): 1 once a triangle has failed. gone (t,): 1 once it is removed; empty where none is. tally (4,): see
    above. first (4,): time in s and place in m of the first failure. conductance (3t,): what each triangle gives its
    sides in W/K, side by side as in `Sheet.sides`; empty where nothing is removed or conducts, or where conductivity
    changes with temperature, as conductance is then summed anew at every update.
    """

    failed: NDArray[np.int64]
    gone: NDArray[np.int64]
    tally: NDArray[np.int64]
    first: Floats
    conductance: Floats


def build(setup: Setup) -> Tearing:
    """What the scene makes of a failure."""
    given, t = setup.scene.flight, len(setup.mesh.triangles)
    removes = given.on_failure == "remove"
    return Tearing(
        counted=t if given.on_failure != "stop" else 0,
        removed=t if removes else 0,
        most=math.floor(given.broken_fraction * t),
        shares=only_if(removes, setup.lattice.conductance_shares.T.ravel()),
    )


def work(model: Model) -> Broken:
    """Nothing failed yet."""
    tearing, effects = model.effects.tearing, model.effects
    conducts = effects.heat.conductance.size > 0 and effects.properties.conduction.region.size == 0
    return Broken(
        failed=np.zeros(tearing.counted, np.int64),
        gone=np.zeros(tearing.removed, np.int64),
        tally=np.zeros(4, np.int64),
        first=np.zeros(4),
        conductance=tearing.shares if conducts else np.empty(0),
    )


@hook
def write(model: Model, work: WorkSpace, state: State, centre: Floats, row: Floats) -> None:
    """How many triangles have failed so far, by stress and by heat."""
    row[_TENSILE], row[_THERMAL] = work.effects.tearing.tally[BY_STRESS], work.effects.tearing.tally[BY_HEAT]


@numba.njit(cache=True, error_model="numpy")
def failures(broken: Broken) -> int:
    """How many triangles have failed."""
    return broken.tally[BY_STRESS] + broken.tally[BY_HEAT]


@numba.njit(cache=True, error_model="numpy")
def _note(broken: Broken, i: int, kind: int, t: float, x: Floats, springs: Springs, side: int) -> None:
    """Count the failure of triangle i, and keep time and place (the middle of a side) of the first."""
    if failures(broken) == 0:
        broken.tally[FIRST], broken.tally[KIND], broken.first[0] = i, kind, t
        for c in range(3):
            broken.first[1 + c] = 0.5 * (x[c, springs.start[side]] + x[c, springs.end[side]])
    broken.tally[kind] += 1
    broken.failed[i] = 1


@numba.njit(cache=True, error_model="numpy")
def _remove(
    broken: Broken,
    model: Sheet,
    work: SheetWork,
    heat: HeatWork,
    light: HeldLight,
    layout: Stencil,
    held: Floats,
    i: int,
) -> None:
    """Take triangle i out: it carries, absorbs, reflects, emits and conducts nothing any more."""
    size = model.modulus.size
    broken.gone[i] = 1
    work.modulus[i], work.shear[i] = 0.0, 0.0
    if heat.emission.size > 0:
        heat.emission[i] = 0.0
    if broken.conductance.size > 0:
        for c in range(3):
            side = model.sides[c * size + i]
            heat.conductance[side] = 0.0
            for place in model.slots[:, side]:
                if place < 3 * size and broken.gone[place % size] == 0:
                    heat.conductance[side] += broken.conductance[place]
    remove_light(broken, light, layout, held, i)


@numba.njit(cache=True, error_model="numpy")
def remove_light(broken: Broken, light: HeldLight, layout: Stencil, held: Floats, i: int) -> None:
    """No light on triangle i, where there is light and the triangle is gone; held (f, 3, p) as in the stencil."""
    if light.incident.size > 0 and broken.gone[i] != 0:
        light.incident[i], light.absorbed[i] = 0.0, 0.0
        rows.drop(layout, i, held)


@numba.njit(cache=True, error_model="numpy")
def remove_all_light(broken: Broken, light: HeldLight, layout: Stencil, held: Floats) -> None:
    """No light on all triangles that are gone; held (3, padded) is what the light gives."""
    for i in range(broken.gone.size):
        remove_light(broken, light, layout, held, i)


@standalone()
def tear(
    broken: Broken,
    model: Sheet,
    work: SheetWork,
    heat: HeatWork,
    light: HeldLight,
    layout: Stencil,
    space: StencilWork,
    springs: Springs,
    corners: Indices,
    x: Floats,
    t: float,
) -> tuple[int, int, int]:
    """Note, and where asked remove, every triangle above its strength at nodes x (3, n) and time t in s.

    Returns (NON_FINITE, triangle, 0) if one is not finite, else INTACT, −1 and how many they were.
    """
    bad, finite = sheet.first_torn(model, work, layout, space.free, corners, x)
    if not finite:
        return NON_FINITE, bad, 0
    torn = 0
    for i in range(work.limit.size):
        if sheet.tears(model, work, sheet.excess(layout, space.free, corners, x, i), i):
            work.limit[i] = np.inf
            torn += 1
            if broken.failed[i] == 0:
                _note(broken, i, BY_STRESS, t, x, springs, model.sides[i])
            if broken.gone.size > 0:
                _remove(broken, model, work, heat, light, layout, space.held, i)
    return INTACT, -1, torn


@standalone()
def burn(
    broken: Broken,
    model: Sheet,
    work: SheetWork,
    limits: Heat,
    heat: HeatWork,
    light: HeldLight,
    layout: Stencil,
    held: Floats,
    springs: Springs,
    corners: Indices,
    x: Floats,
    temperature: Floats,
    t: float,
) -> None:
    """The same for triangles with a node above their limit; the place is the middle of the side that starts there.

    Nodes x (3, n) in m, temperature (n,) in K.
    """
    size = model.modulus.size
    for i in range(limits.limit.size):
        c = hot_corner(corners, limits.limit, temperature, i)
        if broken.failed[i] == 0 and c >= 0:
            _note(broken, i, BY_HEAT, t, x, springs, model.sides[c * size + i])
            if broken.gone.size > 0:
                if work.limit.size > 0:
                    work.limit[i] = np.inf
                _remove(broken, model, work, heat, light, layout, held, i)
