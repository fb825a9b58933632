"""Linear stability of the spinning sail on the beam axis: Floquet multipliers two ways, a margin, and a verdict.

    python -m dynamics.floquet --scene workflow/scenes/fig6.yaml --tables te.h5 tm.h5 --out floquet.json

Multipliers are the factors by which small motions grow in one turn. A sail without losses can at best be marginally
stable: its motion is reversible, multipliers come in pairs λ, 1/λ, and all lie on the unit circle or some lie outside.
A simple pair on the circle stays on it under any small error of the tables; near-double ones may leave it, as the
square root of the error. The verdict therefore comes from the multipliers of many models within the tables' errors; the
margin (`dynamics.stability.linear`) says how far the sail is from the other verdict.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from beamrider.arrays import Complexes, Floats
from beamrider.io.arguments import stage_arguments
from beamrider.io.files import InputError, finish, versions, write_json
from beamrider.machine_code.notice import compiling
from dynamics.rigid.body import rigid_body
from dynamics.sail.sectors import load_tables, provenance, require_own_polarisation
from dynamics.sail.table_error import missed, said_missed
from dynamics.scene import schema as scenes
from dynamics.stability.derivatives import COLUMNS, ROWS, error_modes, imbalance, linearise
from dynamics.stability.linear import RESOLUTION, LinearModel, growth, margin, over_a_turn
from dynamics.stability.towed import towed
from optics.table.normal_incidence import table_response
from optics.table.pressure_table import PressureTable

SAMPLES = 128
SLOWEST = 1000.0  # units of time in a turn: a sail moves through hundreds of oscillations, or grows beyond all numbers
DEFECTIVE = 1e7  # condition of the eigenvectors beyond which two of them are one, within rounding
MOST_SWING = 1e-3  # of the spin within a turn, which is taken as constant
BETTER = (0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4)  # shares of the tables' errors with which a verdict is tried


@dataclass(frozen=True)
class Stability:
    """Outcome of the analysis.

    monodromy, corotating (8,), longer with a payload: multipliers by the two routes; corotating is None where the
    system is periodic in any axes: with yaw-blind incidence, or a sail that turns in a beam that is not round.
    max_modulus: the largest modulus, and modulus_range its lowest and highest value within the errors of the tables;
    without spin over one time unit t₀. margin, margin_range in 1/s, alike, of a damped sail the rate of decay.
    condition: of the eigenvectors; a defective sail's motion grows as t even with every modulus 1.
    """

    model: LinearModel
    monodromy: Complexes
    corotating: Complexes | None
    max_modulus: float
    modulus_range: tuple[float, float]
    margin: float
    margin_range: tuple[float, float]
    condition: float

    @property
    def multipliers(self) -> Complexes:
        """The multipliers (8,), from the co-rotating route where there is one: it has no integration error."""
        return self.monodromy if self.corotating is None else self.corotating

    @property
    def route_difference(self) -> float | None:
        """Largest distance between multipliers of the two routes, paired off, over the largest (at least 1)."""
        if self.corotating is None:
            return None
        return distance(self.monodromy, self.corotating) / max(1.0, self.max_modulus)

    @property
    def spread(self) -> float:
        """How far the largest modulus moves within the errors of the tables."""
        return max(self.modulus_range[1] - self.max_modulus, self.max_modulus - self.modulus_range[0])

    @property
    def tolerance(self) -> float:
        """How far above 1 the largest modulus may lie and still not mean growth, within the errors of the tables."""
        return RESOLUTION + self.max_modulus - self.modulus_range[0]

    @property
    def verdict(self) -> str:
        """'unstable' or 'marginally_stable' when every model within the tables' errors is; otherwise 'undecided'.

        So is a sail on the very edge, whose eigenvectors coincide. 'asymptotically_stable' where damping makes every
        motion die away.
        """
        if self.model.damped and self.modulus_range[1] < 1.0 - RESOLUTION:
            return "asymptotically_stable"
        if self.max_modulus > 1.0 + self.tolerance:
            return "unstable"
        calm = self.modulus_range[1] <= 1.0 + RESOLUTION and self.condition < DEFECTIVE
        return "marginally_stable" if calm else "undecided"


@dataclass(frozen=True)
class Doubt:
    """Why a verdict is undecided. share: of the tables' errors with which it would be decided, None if none helps."""

    share: float | None

    def text(self, tables: dict[str, PressureTable]) -> str:
        """Cause and cure. Costs of a table are taken to grow as the inverse of its tolerance, as they do about."""
        if self.share is None:
            return "on the very edge of stability: no better table decides"
        known = [table for table in tables.values() if "settings" in table.attrs and "cpu_seconds" in table.attrs]
        if not known:
            return f"table errors; tables with {self.share:g} of their errors would decide"
        tolerance = self.share * min(float(table.attrs["settings"]["tolerance"]) for table in known)
        seconds = sum(float(table.attrs["cpu_seconds"]) for table in known) / self.share
        return f"table errors; --tolerance {tolerance:.1g} would decide, about {seconds:.2g} s"


def doubt(stability: Stability, modes: list[tuple[Floats, float]]) -> Doubt | None:
    """Why the verdict on a model with those errors (n, n) is undecided; None where it is not."""
    if stability.verdict != "undecided":
        return None
    for share in BETTER:
        if assess(stability.model, [(share * one, share * other) for one, other in modes]).verdict != "undecided":
            return Doubt(share)
    return Doubt(None)


def distance(a: Complexes, b: Complexes) -> float:
    """Largest distance between two sets of numbers (n,), paired off so that the sum of distances is least."""
    gaps = np.abs(a[:, None] - b[None, :])
    return float(gaps[linear_sum_assignment(gaps)].max())


def eigenvalues(matrix: Floats) -> Complexes:
    """Eigenvalues (n,) of a real matrix (n, n): conjugate pairs together, largest angle first."""
    values = np.linalg.eigvals(matrix).astype(complex)
    return values[np.lexsort((-values.imag, -np.abs(values), -np.abs(np.angle(values)).round(9)))]


def analyse(scene: scenes.Scene, tables: dict[str, PressureTable]) -> Stability:
    """Multipliers, margin and verdict for a scene with the pressure table of each of its designs.

    InputError where the centred, level sail is not in equilibrium, or where there is no light.
    """
    if scene.beam.intensity_W_m2 == 0.0:
        raise InputError(f"{scene.name}.yaml: beam.intensity_W_m2 = 0: must be above 0 for a stability analysis")
    require_own_polarisation(scene, "a stability analysis")
    body = rigid_body(scene, tables, lookup="smooth", quadrature=None)
    _require_steady(scene)
    share, swing = imbalance(scene, tables, body)
    if share > 1e-6:
        raise InputError(
            f"{scene.name}.yaml: sail.sectors: force or torque on the centred, level sail is {share:.2g} of the "
            "thrust; it must vanish for a stability analysis (give sail and beam a two-fold symmetry)"
        )
    if swing > MOST_SWING:
        raise InputError(
            f"{scene.name}.yaml: beam: as the sail turns in it, its spin would swing by {swing:.2g} of itself: must be "
            f"below {MOST_SWING:g} for a stability analysis; spin faster or take a rounder beam"
        )
    jacobian, thrust = linearise(scene, tables, body)
    if scene.release.spin_Hz and abs(scene.release.spin_Hz) * body.units.time * SLOWEST < 1.0:
        raise InputError(
            f"{scene.name}.yaml: release.spin_Hz = {scene.release.spin_Hz:g}: must be 0, or fast enough for "
            f"multipliers of a turn: at least {1.0 / (SLOWEST * body.units.time):.3g}"
        )
    spin = 2.0 * np.pi * scene.release.spin_Hz * body.units.time
    yaw_blind = scene.incidence == "yaw_blind" and spin != 0.0
    turning = jacobian.ndim > 2
    if yaw_blind and turning:
        raise InputError(f"{scene.name}.yaml: beam: must be round for a stability analysis with incidence: yaw_blind")
    mean, waves = over_a_turn(jacobian) if turning else (jacobian, np.zeros((0, 4, 4), complex))
    model = LinearModel(mean, np.array(thrust), body.sail.inertia[:2, :2], spin, yaw_blind, waves)
    if scene.carried:
        if turning:
            raise InputError(f"{scene.name}.yaml: beam: must be round for a stability analysis with payload")
        model = towed(body, jacobian, thrust, spin, scene)
    return assess(model, error_modes(scene, tables, body), body.units.time)


def _require_steady(scene: scenes.Scene) -> None:
    """InputError where the beam goes somewhere: no place is an equilibrium then. Noise about a place is left out."""
    if scene.beam.pointing.path is not None:
        raise InputError(f"{scene.name}.yaml: beam.pointing.path: a beam that moves has no equilibrium to analyse")


def assess(model: LinearModel, modes: list[tuple[Floats, float]], unit: float = 1.0) -> Stability:
    """The outcome for a model that may be off by any mixture of `modes` (n, n); `unit` is the unit of time in s."""
    monodromy = model.monodromy()
    rate = float(model.period) * unit
    exponents = model.exponents()
    largest, room = float(np.exp(growth(exponents))), float(_room(model, exponents)) / rate
    moduli, rooms = np.array([largest]), np.array([room])
    if modes:
        varied = _within_errors(model, modes)
        exponents = varied.exponents()
        moduli = np.append(moduli, np.exp(growth(exponents)))
        rooms = np.append(rooms, _room(varied, exponents) / rate)
    return Stability(
        model,
        eigenvalues(monodromy),
        None if model.periodic else eigenvalues(model.turn_matrix()),
        largest,
        (float(moduli.min()), float(moduli.max())),
        room,
        (float(rooms.min()), float(rooms.max())),
        _condition(model),
    )


def _room(model: LinearModel, exponents: list[Complexes]) -> Floats:
    """Margins (...,) a turn: of a damped sail the rate at which the slowest motion dies away."""
    return -growth(exponents) if model.damped else margin(exponents, model.periodic)


def _condition(model: LinearModel) -> float:
    """Condition of the eigenvectors, each of length 1, of the matrix whose eigenvalues decide."""
    matrix = model.monodromy() if model.periodic else model.corotating()
    scale = np.ones(8) if model.periodic else np.tile(np.repeat([1.0, _rate(matrix)], 2), model.size // 4)
    return float(np.linalg.cond(np.linalg.eig(matrix * (scale / scale[:, None]))[1]))


def _rate(matrix: Floats) -> float:
    """A typical rate of a generator, to measure velocities in; 1 where nothing moves."""
    return float(np.abs(np.linalg.eigvals(matrix)).max()) or 1.0


def _within_errors(model: LinearModel, modes: list[tuple[Floats, float]]) -> LinearModel:
    """Models with random mixtures of the errors, each within its size; in every other one each at its full size."""
    share = np.random.default_rng(0).uniform(-1.0, 1.0, (SAMPLES, len(modes)))
    share[::2] = np.sign(share[::2])
    moved, waves = np.tensordot(share, np.array([mode[0] for mode in modes]), 1), model.waves
    if moved.ndim > 3:
        moved, more = over_a_turn(moved)
        waves = waves + more
    thrust = model.thrust + share @ np.array([mode[1] for mode in modes])
    return replace(model, jacobian=model.jacobian + moved, thrust=thrust, waves=waves)


def table_errors(tables: dict[str, PressureTable]) -> dict[str, Any]:
    """Of each design the errors of q and its slopes at normal incidence, and whether its table met its tolerance."""
    found = {name: (table_response(table), table.attrs.get("tolerance_met")) for name, table in tables.items()}
    return {
        name: {
            "q_error": float(response.q_error.max()),
            "gradient_error": float(response.gradient_error.max()),
            "tolerance_met": met,
        }
        for name, (response, met) in found.items()
    }


def report(scene: scenes.Scene, tables: dict[str, PressureTable], stability: Stability) -> dict[str, Any]:
    """The outcome as JSON: complex numbers as [re, im], derivatives in SI."""
    spins = stability.model.spin != 0.0
    units = rigid_body(scene, tables, quadrature=None).units
    rows = np.array([units.force] * 2 + [units.torque] * 2)
    jacobian = stability.model.jacobian * rows[:, None] / np.array([units.length, units.length, 1.0, 1.0])
    exponents = eigenvalues(stability.model.corotating()) / units.time
    why = doubt(stability, error_modes(scene, tables, rigid_body(scene, tables, quadrature=None)))
    routes = {"monodromy": stability.monodromy, "corotating": stability.corotating}
    return {
        "scene": scene.name,
        "incidence": scene.incidence,
        "spin_Hz": scene.release.spin_Hz,
        "multipliers": pairs(stability.multipliers) if spins else [],
        "max_modulus": stability.max_modulus if spins else None,
        "exponents_1_s": None if spins else pairs(exponents),
        "tolerance": stability.tolerance,
        "verdict": stability.verdict,
        "undecided_because": why.text(tables) if why else "",
        "left_out": "" if scene.beam.steady else "jitter and fluctuations of the beam, which is taken at its mean",
        "margin_1_s": stability.margin,
        "margin_range_1_s": list(stability.margin_range),
        "table_errors": table_errors(tables),
        "tables_missed": list(missed(tables)),
        "resolution": RESOLUTION,
        "spread_from_table_errors": stability.spread,
        "eigenvector_condition": stability.condition,
        "routes": {key: None if values is None or not spins else pairs(values) for key, values in routes.items()},
        "route_difference": stability.route_difference,
        "jacobian": {
            f"{row}_{column}": float(jacobian[i, j]) for i, row in enumerate(ROWS) for j, column in enumerate(COLUMNS)
        },
        "jacobian_units": {"F": "N/m, N/rad", "tau": "N, N m/rad"},
        "thrust_N": float(stability.model.thrust) * units.force,
        "tables": provenance(tables),
        "versions": versions("numpy", "scipy", "numba"),
    }


def pairs(values: Complexes) -> list[list[float]]:
    """Complex numbers (n,) as [[re, im], …]."""
    return [[float(value.real), float(value.imag)] for value in values]


def main() -> None:
    """Decide the linear stability of a scene's sail on the beam axis."""
    arguments = stage_arguments("dynamics.floquet", main.__doc__, "JSON file to write")
    scene = scenes.read_scene(arguments.scene)
    tables = load_tables(arguments.tables, scene)
    with compiling("10 s"):
        stability = analyse(scene, tables)
    found = report(scene, tables, stability)
    write_json(arguments.out, found)
    low, high = stability.margin_range
    why = f" ({found['undecided_because']})" if found["undecided_because"] else ""
    worst = max((one["q_error"] for one in found["table_errors"].values()), default=0.0)
    finish(
        arguments.out,
        arguments.watch,
        f"{stability.verdict}{why}, largest |λ| = {stability.max_modulus:.6f} ± {stability.spread:.1g}, "
        f"margin {stability.margin:.3g} 1/s ({low:.3g} … {high:.3g})",
        [f"tables err by at most {worst:.2g} at normal incidence{said_missed(missed(tables))}"] if tables else [],
    )
