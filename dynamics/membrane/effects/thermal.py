"""Heat of the nodes: absorbed light, emission from both faces, conduction along the edges."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices
from beamrider.machine_code.standalone import standalone
from dynamics.membrane.arrays import Model, WorkSpace
from dynamics.membrane.effects import properties
from dynamics.membrane.effects.interface import Decision, Plan, Setup, hook, needs_heat, only_if, own, starts
from dynamics.membrane.effects.springs import Springs
from dynamics.membrane.lattice import per_triangle
from dynamics.membrane.layout import rows
from dynamics.membrane.layout.triangles import Patch, Triangles, sides, total, weighted_areas
from dynamics.membrane.state import State
from dynamics.scene.schema import Scene

NAME = "heat"
COST = "a pass over all nodes, triangles or edges whenever temperatures change, every flight.heat_every steps"
#: Temperatures are those of the nodes, which failure tests; `temperature_max_triangles` (published) is the largest mean
#: of three corners.
COLUMNS = {
    "temperature_max": (1, "K"),
    "temperature_min": (1, "K"),
    "temperature_mean": (1, "K"),
    "temperature_max_triangles": (1, "K"),
    "power_radiated": (1, "W"),
}
_HOTTEST, _COLDEST, _MEAN, _HOTTEST_TRIANGLE, _RADIATED = starts(COLUMNS)


def _absorption(scene: Scene, so_far: Plan) -> Decision:
    heated = scene.beam.intensity_W_m2 > 0 and any(
        scene.tabled(region) or region.properties.highest("absorptance") > 0 for region in scene.sail.regions
    )
    return Decision(on=heated, reason="light on an absorber" if heated else "nothing absorbs light")


def _emission(scene: Scene, so_far: Plan) -> Decision:
    materials = [region.properties for region in scene.sail.regions]
    emits = any(m.highest("emissivity_front") + m.highest("emissivity_back") > 0 for m in materials)
    return Decision(on=emits, reason="emissivity above zero" if emits else "emissivity zero everywhere")


def _conduction(scene: Scene, so_far: Plan) -> Decision:
    conducts = any(region.properties.highest("conductivity_W_mK") > 0 for region in scene.sail.regions)
    return Decision(on=conducts, reason="conductivity above zero" if conducts else "no conductivity")


PLAN = {"absorption": _absorption, "emission": _emission, "conduction": needs_heat(_conduction)}


class Heat(NamedTuple):
    """Heat links of the lattice; what is off has no array.

    per_capacity (n,): thermal rate factor over heat capacity, K/J. absorbs: is the absorbed light counted. emission
    (t,): one third of σ_SB (ε_front + ε_back), W/(m² K⁴); background: T_bg⁴ in K⁴. conductance (e,) in W/K. limit (t,):
    failure temperature of the triangles in K, lowest: the lowest of them. every: steps between updates.
    """

    per_capacity: Floats
    absorbs: bool
    emission: Floats
    background: float
    conductance: Floats
    limit: Floats
    lowest: float
    every: int


class HeatWork(NamedTuple):
    """Work space: rate (n,) in K/s; emission (t,), conductance (e,) and per_capacity (n,) as they are now.

    The last three are the model's own arrays where nothing can change them. Of what has been removed there is neither
    emission nor conductance, but nodes keep the heat capacity that they had.
    """

    rate: Floats
    emission: Floats
    conductance: Floats
    per_capacity: Floats


def build(setup: Setup) -> Heat:
    """Heat links of the lattice, with those that are on."""
    scene, mesh, flight = setup.scene, setup.mesh, setup.scene.flight
    faces = per_triangle(scene.sail, mesh, "emissivity_front") + per_triangle(scene.sail, mesh, "emissivity_back")
    limits = per_triangle(scene.sail, mesh, "failure_temperature_K")
    return Heat(
        per_capacity=only_if(setup.warm, flight.thermal_rate / setup.lattice.heat_capacities),
        absorbs=setup.on("absorption"),
        emission=only_if(setup.on("emission"), flight.stefan_boltzmann * faces / 3.0),
        background=flight.background_temperature_K**4,
        conductance=only_if(setup.on("conduction"), setup.lattice.conductance),
        limit=only_if(setup.on("thermal_failure"), limits),
        lowest=float(limits.min()),
        every=flight.heat_every,
    )


def work(model: Model) -> HeatWork:
    """No heating yet, nothing removed."""
    heat, curves, removes = model.effects.heat, model.effects.properties, model.effects.tearing.removed > 0
    return HeatWork(
        rate=np.zeros(model.masses.size if model.warm else 0),
        emission=own(heat.emission, removes or curves.emission.region.size > 0),
        conductance=own(heat.conductance, removes or curves.conduction.region.size > 0),
        per_capacity=own(heat.per_capacity, curves.capacity.region.size > 0),
    )


@hook
def heat(model: Model, work: WorkSpace, x: Floats, temperature: Floats) -> None:
    """Absorbed, emitted and conducted heat, of properties as they are at temperature (n,)."""
    properties.update(
        model.effects.properties,
        model.triangles.corners,
        temperature,
        work.effects.tearing.gone,
        work.effects.heat.emission,
        work.effects.heat.conductance,
        work.effects.heat.per_capacity,
    )
    add_flows(
        model.effects.heat,
        work.effects.heat,
        model.effects.springs,
        model.triangles.corners,
        rows.patch(work.stencil.scratch, 0),
        x,
        temperature,
        work.effects.light.absorbed,
        work.gain[0],
    )


@hook
def write(model: Model, work: WorkSpace, state: State, centre: Floats, row: Floats) -> None:
    """Temperatures and net power emitted; zeros where there is no heat."""
    if model.warm:
        _write_temperatures(model.triangles, state.temperature, row)
        row[_RADIATED] = radiated(
            work.effects.heat.emission,
            state.x,
            model.triangles.corners,
            rows.patch(work.stencil.scratch, 0),
            state.temperature,
            model.effects.heat.background,
        )


@numba.njit(cache=True, error_model="numpy")
def _write_temperatures(triangles: Triangles, temperature: Floats, row: Floats) -> None:
    """Largest, smallest and mass-weighted mean temperature of the nodes, and the largest of the triangles' means, K."""
    row[_HOTTEST], row[_COLDEST], row[_HOTTEST_TRIANGLE] = -np.inf, np.inf, -np.inf
    for i in range(temperature.size):
        row[_HOTTEST] = max(row[_HOTTEST], temperature[i])
        row[_COLDEST] = min(row[_COLDEST], temperature[i])
    corners, masses = triangles.corners, triangles.masses
    for i in range(masses.size):
        mean = (temperature[corners[0, i]] + temperature[corners[1, i]] + temperature[corners[2, i]]) / 3.0
        row[_HOTTEST_TRIANGLE] = max(row[_HOTTEST_TRIANGLE], mean)
        row[_MEAN] += masses[i] * mean
    row[_MEAN] /= total(masses, masses.size)


@numba.njit(cache=True, error_model="numpy")
def _absorb(corners: Indices, absorbed: Floats, gain: float, rate: Floats) -> None:
    """One third of the power absorbed in each triangle to each corner."""
    c0, c1, c2 = corners[0], corners[1], corners[2]
    for i in range(absorbed.size):
        third = absorbed[i] * gain / 3.0
        rate[c0[i]] += third
        rate[c1[i]] += third
        rate[c2[i]] += third


@numba.njit(cache=True, error_model="numpy")
def _emitting(emission: Floats, x: Floats, corners: Indices, patch: Patch, begin: int) -> tuple[int, Floats]:
    """Emission × current area of the triangles from `begin` on that fill a patch: how many, and the array."""
    n, out = min(patch.sides.shape[1], emission.size - begin), patch.frame[0]
    sides(x, corners, begin, n, 0, patch.sides)
    weighted_areas(patch.sides, emission[begin : begin + n], out)
    return n, out


@numba.njit(cache=True, error_model="numpy")
def _emit(
    emission: Floats, x: Floats, corners: Indices, patch: Patch, temperature: Floats, background: float, rate: Floats
) -> None:
    """Stefan–Boltzmann emission σ (ε_f + ε_b) A (T⁴ − T_bg⁴) with one third of the current areas at each node."""
    begin = 0
    while begin < emission.size:
        n, share = _emitting(emission, x, corners, patch, begin)
        for i in range(n):
            for c in range(3):
                node = corners[c, begin + i]
                square = temperature[node] * temperature[node]
                rate[node] -= share[i] * (square * square - background)
        begin += n


@numba.njit(cache=True, error_model="numpy")
def _conduct(conductance: Floats, springs: Springs, temperature: Floats, rate: Floats) -> None:
    """Flow G (T_b − T_a) along each edge into its start, and out of its end."""
    start, end = springs.start, springs.end
    for e in range(conductance.size):
        a, b = start[e], end[e]
        flow = conductance[e] * (temperature[b] - temperature[a])
        rate[a] += flow
        rate[b] -= flow


@standalone()
def add_flows(
    heat: Heat,
    work: HeatWork,
    springs: Springs,
    corners: Indices,
    patch: Patch,
    x: Floats,
    temperature: Floats,
    absorbed: Floats,
    gain: float,
) -> None:
    """Add what nodes x (3, n) at `temperature` (n,) take up, in W, to work.rate (n,).

    corners (3, t): nodes of the triangles; patch: to work in; absorbed (t,) in W at full ramp.
    """
    if heat.absorbs and gain > 0.0:
        _absorb(corners, absorbed, gain, work.rate)
    if heat.emission.size > 0:
        _emit(work.emission, x, corners, patch, temperature, heat.background, work.rate)
    if heat.conductance.size > 0:
        _conduct(work.conductance, springs, temperature, work.rate)


@numba.njit(cache=True, error_model="numpy")
def begin(work: HeatWork) -> None:
    """No heat yet."""
    for i in range(work.rate.size):
        work.rate[i] = 0.0


@numba.njit(cache=True, error_model="numpy")
def end(work: HeatWork) -> None:
    """From the heat that nodes take up, in W, to the rate of their temperatures in K/s."""
    for i in range(work.rate.size):
        work.rate[i] *= work.per_capacity[i]


@numba.njit(cache=True, error_model="numpy")
def hottest(temperature: Floats) -> float:
    """Largest value of temperature (n,); NaN if one of them is NaN."""
    largest = -np.inf
    for i in range(temperature.size):
        if not temperature[i] <= largest:
            largest = temperature[i]
    return largest


@standalone()
def radiated(
    emission: Floats, x: Floats, corners: Indices, patch: Patch, temperature: Floats, background: float
) -> float:
    """Net power in W that the sail emits at temperatures (n,) in K."""
    power, begin = 0.0, 0
    while begin < emission.size:
        n, share = _emitting(emission, x, corners, patch, begin)
        for i in range(n):
            for c in range(3):
                square = temperature[corners[c, begin + i]] * temperature[corners[c, begin + i]]
                power += share[i] * (square * square - background)
        begin += n
    return power
