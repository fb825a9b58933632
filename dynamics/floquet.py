"""Linear stability of the spinning sail on the beam axis: Floquet multipliers two ways, and a verdict with a tolerance.

    python -m dynamics.floquet --scene workflow/scenes/fig6.yaml --tables te.h5 tm.h5 --out floquet.json

Multipliers are the factors by which small motions grow in one turn. A sail without losses can at best be marginally
stable: its motion is reversible, multipliers come in pairs λ, 1/λ, and all lie on the unit circle or some lie outside.
A simple pair on the circle stays on it under any small error of the tables; near-double ones may leave it, as the
square root of the error. The verdict therefore comes from the multipliers of many models within the tables' errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from dynamics import scene as scenes
from dynamics.command import stage_arguments
from dynamics.linear import COLUMNS, ROWS, LinearModel, imbalance, linearise
from dynamics.rigid_body import RigidBody, rigid_body
from dynamics.sail import load_tables, provenance
from optics.files import InputError, run_stage, versions, write_json
from optics.table import PressureTable

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

RESOLUTION = 1e-4  # growth a turn that counts as none: e-fold in 10⁴ turns, beyond any flight here
ERROR_SCALE = np.sin(np.radians(5.0))  # direction cosine over which solver errors vary, as resonances shift
SAMPLES = 256


@dataclass(frozen=True)
class Stability:
    """Outcome of the analysis.

    monodromy, corotating (8,): multipliers by the two routes; corotating is None with yaw-blind incidence, whose system
    is periodic in any axes. exponents (8,): growth rates in 1/s of a sail that doesn't spin, else None. spread: how far
    the largest modulus moves within the errors of the tables. Without spin the modulus is that over one time unit t₀.
    """

    model: LinearModel
    monodromy: Complexes
    corotating: Complexes | None
    max_modulus: float
    spread: float

    @property
    def multipliers(self) -> Complexes:
        """The multipliers (8,), from the co-rotating route where there is one: it has no integration error."""
        return self.monodromy if self.corotating is None else self.corotating

    @property
    def route_difference(self) -> float | None:
        """Largest distance between multipliers of the two routes, paired off."""
        return None if self.corotating is None else distance(self.monodromy, self.corotating)

    @property
    def tolerance(self) -> float:
        """How far above 1 the largest modulus may lie and still mean nothing."""
        return RESOLUTION + self.spread

    @property
    def verdict(self) -> str:
        """'unstable' or 'marginally_stable' when every model within the tables' errors is; otherwise 'undecided'."""
        if self.max_modulus > 1.0 + self.tolerance:
            return "unstable"
        return "marginally_stable" if self.max_modulus + self.spread <= 1.0 + RESOLUTION else "undecided"


def distance(a: Complexes, b: Complexes) -> float:
    """Largest distance between two sets of numbers (n,), paired off so that the sum of distances is least."""
    gaps = np.abs(a[:, None] - b[None, :])
    return float(gaps[linear_sum_assignment(gaps)].max())


def eigenvalues(matrix: Floats) -> Complexes:
    """Eigenvalues (n,) of a real matrix (n, n): conjugate pairs together, largest angle first."""
    values = np.linalg.eigvals(matrix).astype(complex)
    return values[np.lexsort((-values.imag, -np.abs(values), -np.abs(np.angle(values)).round(9)))]


def analyse(scene: scenes.Scene, tables: dict[str, PressureTable]) -> Stability:
    """Multipliers and verdict for a scene with the pressure table of each of its designs.

    InputError where the centred, level sail is not in equilibrium, or where there is no light.
    """
    body = rigid_body(scene, tables, lookup="smooth")
    _check(scene, body)
    jacobian, thrust = linearise(body)
    inertia = body.sail.inertia[:2, :2]
    spin = 2.0 * np.pi * scene.release.spin_Hz * body.units.time
    model = LinearModel(jacobian, np.array(thrust), inertia, spin, scene.incidence == "yaw_blind" and spin != 0.0)
    monodromy = eigenvalues(model.monodromy())
    corotating = None if model.yaw_blind else eigenvalues(model.turn_matrix())
    nominal = float(np.abs(monodromy if corotating is None else corotating).max())
    return Stability(model, monodromy, corotating, nominal, _spread(model, nominal, error_modes(scene, tables)))


def _check(scene: scenes.Scene, body: RigidBody) -> None:
    if scene.beam.intensity_W_m2 == 0.0:
        raise InputError(f"{scene.name}.yaml: beam.intensity_W_m2 = 0: must be above 0 for a stability analysis")
    share = imbalance(body)
    if share > 1e-6:
        raise InputError(
            f"{scene.name}.yaml: sail.sectors: force or torque on the centred, level sail is {share:.2g} of the "
            "thrust; it must vanish for a stability analysis (give the sail a two-fold symmetry)"
        )


def error_modes(scene: scenes.Scene, tables: dict[str, PressureTable]) -> list[tuple[Floats, float]]:
    """What the tables' errors do to (jacobian (4, 4), thrust): one entry for each way a table can be wrong.

    Near normal incidence q may be off by a constant, and by a slope that makes up the same error over `ERROR_SCALE`.
    Ridges look the same both ways along themselves, so q_g and q_n are even in v, and q_r is odd. Force and torque are
    linear in q: the effect follows from a table that holds the error alone.
    """
    modes = []
    for design, table in tables.items():
        for error in _error_tables(table):
            dark = {name: _affine(other.axisymmetric, np.zeros((3, 3))) for name, other in tables.items()}
            wrong = rigid_body(_without_films(scene), {**dark, design: error}, lookup="smooth")
            modes.append(linearise(wrong))
    return modes


def _without_films(scene: scenes.Scene) -> scenes.Scene:
    """The scene with sectors of constant reflectance made perfectly transparent, as they have no table to be wrong."""
    sectors = [
        s if s.design else s.model_copy(update={
            "reflectance": 0.0, "material": s.properties.model_copy(update={"absorptance": 0.0}),
        })
        for s in scene.sail.sectors
    ]
    return scene.model_copy(update={"sail": scene.sail.model_copy(update={"sectors": sectors})})


def _error_tables(table: PressureTable) -> list[PressureTable]:
    """Tables that hold an error each, of the size estimated next to normal incidence."""
    near = (np.abs(table.u) <= 0.02)[:, None] & (np.abs(table.v) <= 0.02)[None, :]
    near[np.abs(table.u).argmin(), np.abs(table.v).argmin()] = True
    size = float(table.error[near].max())
    # rows: q_g, q_r, q_n; columns: constant, slope along u, slope along v
    terms = [(0, 1), (2, 0)] if table.axisymmetric else [(0, 0), (0, 1), (1, 2), (2, 0), (2, 1)]
    out = []
    for component, term in terms:
        coefficients = np.zeros((3, 3))
        coefficients[component, term] = size if term == 0 else size / ERROR_SCALE
        out.append(_affine(table.axisymmetric, coefficients))
    return out


def _affine(axisymmetric: bool, coefficients: Floats) -> PressureTable:
    """A table whose q is affine in u and v, with coefficients (3, 3) of (1, u, v) for each component."""
    u = np.array([0.0, 0.1]) if axisymmetric else np.array([-0.1, 0.1])
    v = np.zeros(1) if axisymmetric else u
    basis = np.stack([np.ones((u.size, v.size)), *np.meshgrid(u, v, indexing="ij")])
    q = np.einsum("ct,tuv->cuv", coefficients, basis)
    return PressureTable(u, v, q, np.zeros(q.shape[1:]), np.ones(q.shape[1:]), axisymmetric=axisymmetric)


def _spread(model: LinearModel, nominal: float, modes: list[tuple[Floats, float]]) -> float:
    """Largest change of the largest modulus over random mixtures of the errors, each within its size."""
    if not modes:
        return 0.0
    share = np.random.default_rng(0).uniform(-1.0, 1.0, (SAMPLES, len(modes)))
    jacobian = model.jacobian + np.einsum("sm,mij->sij", share, np.array([mode[0] for mode in modes]))
    thrust = model.thrust + share @ np.array([mode[1] for mode in modes])
    near = replace(model, jacobian=jacobian, thrust=thrust)
    if model.yaw_blind:
        growth = np.abs(np.linalg.eigvals(near.monodromy(1e-10))).max(axis=1)
    else:
        growth = np.exp(np.linalg.eigvals(near.corotating()).real.max(axis=1) * model.period)
    return float(np.abs(growth - nominal).max())


def report(scene: scenes.Scene, tables: dict[str, PressureTable], stability: Stability) -> dict[str, Any]:
    """The outcome as JSON: complex numbers as [re, im], derivatives in SI."""
    spins = stability.model.spin != 0.0
    units = rigid_body(scene, tables).units
    rows = np.array([units.force] * 2 + [units.torque] * 2)
    jacobian = stability.model.jacobian * rows[:, None] / np.array([units.length, units.length, 1.0, 1.0])
    exponents = eigenvalues(stability.model.corotating()) / units.time
    routes = {"monodromy": stability.monodromy, "corotating": stability.corotating}
    return {
        "scene": scene.name, "incidence": scene.incidence, "spin_Hz": scene.release.spin_Hz,
        "multipliers": pairs(stability.multipliers) if spins else [],
        "max_modulus": stability.max_modulus if spins else None,
        "exponents_1_s": None if spins else pairs(exponents),
        "tolerance": stability.tolerance, "verdict": stability.verdict,
        "resolution": RESOLUTION, "spread_from_table_errors": stability.spread,
        "routes": {key: None if values is None or not spins else pairs(values) for key, values in routes.items()},
        "route_difference": stability.route_difference,
        "jacobian": {
            f"{row}_{column}": float(jacobian[i, j]) for i, row in enumerate(ROWS) for j, column in enumerate(COLUMNS)
        },
        "jacobian_units": {"F": "N/m, N/rad", "tau": "N, N m/rad"},
        "thrust_N": float(stability.model.thrust) * units.force,
        "tables": provenance(tables), "versions": versions("numpy", "scipy", "numba"),
    }


def pairs(values: Complexes) -> list[list[float]]:
    """Complex numbers (n,) as [[re, im], …]."""
    return [[float(value.real), float(value.imag)] for value in values]


def main() -> None:
    """Decide the linear stability of a scene's sail on the beam axis."""
    arguments = stage_arguments("dynamics.floquet", main.__doc__, "JSON file to write")
    scene = scenes.read_scene(arguments.scene)
    tables = load_tables(arguments.tables, scene)
    stability = analyse(scene, tables)
    write_json(arguments.out, report(scene, tables, stability))
    print(f"{scene.name}: {stability.verdict}, largest |λ| = {stability.max_modulus:.6f} ± {stability.spread:.1g}")


if __name__ == "__main__":
    run_stage(main)
