"""Linear stability of sails by the thousand, from the response of their cells around normal incidence.

    python -m dynamics.screening --scene workflow/scenes/fig6.yaml --members members.parquet --cells block*.parquet \
        --by margin_1_s --at-least thrust_N --out screened.parquet

Members are sails with the four sectors of the scene, two of each of two cells; their other parameters are columns
(`workflow.family`). True incidence; margins as in `dynamics.stability.linear`. Columns added: mass, thrust,
acceleration, growth, margin and its lowest and highest value within the errors of the cells, verdict, normalised
derivatives, and the rank among survivors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from beamrider.arrays import Floats
from beamrider.io.arguments import parser
from beamrider.io.files import InputError, Stopwatch, finish, progress, take_out
from beamrider.io.parquet import read_parquet, rows_of, write_parquet
from beamrider.provenance.record import as_attribute
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.light.moments import Moments, round_moments
from dynamics.light.profile import Profile
from dynamics.sail.forecast import require_members, say_members
from dynamics.scene import schema as scenes
from dynamics.stability.derivatives import derivatives
from dynamics.stability.linear import RESOLUTION, LinearModel, growth, margin

CHUNK = 2048
TRIAL = 64  # members whose time is taken
SAMPLES = 16
GROUPS = ("te", "tm")
NUMBERS = ("q_g", "q_n", "q_g_u", "q_n_u", "absorptance")
ERRORS = ("q_error", "q_error", "gradient_error", "gradient_error", "absorptance_error")
MEASURES = ("margin_1_s", "thrust_N", "acceleration_m_s2")


@dataclass(frozen=True)
class Sails:
    """n sails of four sectors in normalised units of each: models without their derivatives.

    g (4, 2), light, inertia (n, 2, 2), spin (n,), time, mass, force (n,): what counts as one in s, kg, N. group (4,):
    which of the two cells a sector is made of.
    """

    g: Floats
    group: NDArray[np.int64]
    light: Moments
    inertia: Floats
    spin: Floats
    time: Floats
    mass: Floats
    force: Floats


def sails(scene: scenes.Scene, members: pd.DataFrame, areal_mass: Floats) -> Sails:
    """The sails of members with the areal masses (n, 2) in kg/m² of their cells."""
    group = _groups(scene)
    half = np.radians(members["sail.sector_deg"].to_numpy()) / 2.0
    start = np.stack([half, np.pi - half, np.pi + half, 2.0 * np.pi - half], axis=1)
    stop = np.concatenate([start[:, 1:], start[:, :1] + 2.0 * np.pi], axis=1)
    radius, areal = scene.sail.radius_m, areal_mass[:, group]
    mass = (areal * radius**2 / 2.0 * (stop - start)).sum(axis=1)
    double = (np.sin(2.0 * stop) - np.sin(2.0 * start)) / 2.0
    shared = areal * radius**4 / 8.0
    about = [(shared * (stop - start - double)).sum(axis=1), (shared * (stop - start + double)).sum(axis=1)]
    inertia = np.zeros((len(members), 2, 2))
    inertia[:, 0, 0], inertia[:, 1, 1] = (value / (mass * 4.0 * radius**2) for value in about)
    time = np.sqrt(mass * LIGHT_SPEED / (scene.beam.intensity_W_m2 * 2.0 * radius))
    width = members["sail.beam_radius_m"].to_numpy() / (2.0 * radius)
    force = np.full(len(members), scene.beam.intensity_W_m2 * 4.0 * radius**2 / LIGHT_SPEED)
    spin = 2.0 * np.pi * members["sail.spin_Hz"].to_numpy() * time
    g = np.array([sector.g for sector in scene.sail.sectors])
    light = round_moments(_profile(scene), start, stop, 0.5, width)
    return Sails(g, group, light, inertia, spin, time, mass, force)


def _profile(scene: scenes.Scene) -> Profile:
    """The profile of the beam, whose radius is the members'; InputError where it is not one round spot that stays."""
    spots = scene.beam.spots
    if len(spots) > 1 or not spots[0].round:
        raise InputError(f"{scene.name}.yaml: beam.profile: screening needs one round spot")
    if scene.beam.pointing.path is not None:
        raise InputError(f"{scene.name}.yaml: beam.pointing.path: a beam that moves has no equilibrium to analyse")
    return spots[0].profile


def _groups(scene: scenes.Scene) -> NDArray[np.int64]:
    """For each of four sectors 0 or 1: is it of the cell of the last sector, or of the other one."""
    designs = [sector.design for sector in scene.sail.sectors]
    if len(designs) != 4 or None in designs or len(set(designs)) != 2:
        raise InputError(f"{scene.name}.yaml: sail.sectors: screening needs four sectors of two designs")
    return np.array([0 if design == designs[-1] else 1 for design in designs])


def models(which: Sails, numbers: Floats) -> LinearModel:
    """Linear models (...) of sails from the numbers (..., 2, 5) of their cells, in the order of `NUMBERS`."""
    cells = numbers[..., which.group, :]
    zero = np.zeros(cells.shape[:-1])
    q = np.stack([cells[..., 0], zero, cells[..., 1]], axis=-1)
    along_u = np.stack([cells[..., 2], zero, cells[..., 3]], axis=-1)
    along_v = np.stack([zero, cells[..., 4], zero], axis=-1)
    jacobian, thrust = derivatives(which.g, q, np.stack([along_u, along_v], axis=-1), which.light)
    return LinearModel(jacobian, thrust, which.inertia, which.spin, False)


def _within_errors(model: LinearModel, which: Sails, errors: Floats) -> list[LinearModel]:
    """Models with every number of every cell (n, 2, 5) off by its error, up or down by chance (the same for all)."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (SAMPLES, 2, len(NUMBERS)))
    out = []
    for sign in signs:
        off = models(which, sign * errors)
        out.append(replace(model, jacobian=model.jacobian + off.jacobian, thrust=model.thrust + off.thrust))
    return out


def assess(scene: scenes.Scene, members: pd.DataFrame, cells: pd.DataFrame) -> pd.DataFrame:
    """What is found out about members whose cells are all known, one row each, in their order."""
    rows = [cells.loc[members[f"{group}_cell"]] for group in GROUPS]
    density = [_density(scene, k) for k in range(2)]
    thickness = np.stack([row["mean_thickness_m"].to_numpy() for row in rows], axis=1)
    which = sails(scene, members, thickness * density)
    numbers = np.stack([row[list(NUMBERS)].to_numpy() for row in rows], axis=1)
    errors = np.stack([np.stack([row[name].to_numpy() for name in ERRORS], axis=-1) for row in rows], axis=1)
    model = models(which, numbers)
    exponents = [m.exponents() for m in (model, *_within_errors(model, which, errors))]
    growths, rooms = (np.array([f(e) for e in exponents]) for f in (growth, margin))
    rate = np.asarray(model.period) * which.time
    stable, unstable = (growths <= RESOLUTION).all(axis=0), (growths > RESOLUTION).all(axis=0)
    thrust = np.asarray(model.thrust) * which.force
    return pd.DataFrame(
        {
            "mass_kg": which.mass,
            "thrust_N": thrust,
            "acceleration_m_s2": thrust / which.mass,
            "growth_1_s": growths[0] / rate,
            "margin_1_s": rooms[0] / rate,
            "margin_low_1_s": rooms.min(axis=0) / rate,
            "margin_high_1_s": rooms.max(axis=0) / rate,
            "verdict": np.select([stable, unstable], ["marginally_stable", "unstable"], "undecided"),
            "F_x_x": model.jacobian[:, 0, 0],
            "F_y_y": model.jacobian[:, 1, 1],
            "tau_x_roll": model.jacobian[:, 2, 2],
            "tau_y_pitch": model.jacobian[:, 3, 3],
        },
        index=members.index,
    )


def _density(scene: scenes.Scene, group: int) -> float:
    """Density in kg/m³ of the material of the sectors of one cell."""
    sectors = scene.sail.sectors
    return next(s.properties.density_kg_m3 for s, k in zip(sectors, _groups(scene), strict=True) if k == group)


def screen(scene: scenes.Scene, members: pd.DataFrame, cells: pd.DataFrame) -> pd.DataFrame:
    """Members with all that is found out about them.

    'impossible' where a cell is none or has no derivative, 'unresolved' where its orders did not resolve it: then
    neither its numbers nor their errors decide anything, and it is never ranked.
    """
    if scene.carried:
        raise InputError(f"{scene.name}.yaml: payload: must be left out, or effects.payload be false, for a screening")
    known = cells.dropna().set_index("cell").sort_index()
    numbers = members[[f"{group}_cell" for group in GROUPS]]
    missing = set(np.unique(numbers)) - set(cells["cell"]) - {-1}
    if missing:
        raise InputError(f"--cells: cell {min(missing)} is missing; give every block of the family's cells")
    possible = members[numbers.isin(known.index).all(axis=1)]
    chunks = [possible.iloc[i : i + CHUNK] for i in range(0, len(possible), CHUNK)]
    if chunks:
        say_members(scene, len(possible), _trial(scene, possible, known) * len(possible))
    found = [assess(scene, chunk, known) for chunk in progress(chunks, "screening", unit="chunk")]
    out = members.join(pd.concat(found)) if found else members.assign(verdict="impossible")
    # As an array: of a Series pandas compares only rows of the same index.
    resolved = numbers.isin(cells.loc[cells["resolved"], "cell"].to_numpy()).all(axis=1)
    verdict = out["verdict"].fillna("impossible")
    return out.assign(verdict=verdict.where(resolved | (verdict == "impossible"), "unresolved"))


def _trial(scene: scenes.Scene, members: pd.DataFrame, known: pd.DataFrame) -> float:
    """Wall time in s a member, of some of them."""
    some = members.iloc[:: max(1, len(members) // TRIAL)].iloc[:TRIAL]
    watch = Stopwatch()
    assess(scene, some, known)
    return watch.seconds / len(some)


def rank(screened: pd.DataFrame, by: str, at_least: list[str]) -> pd.DataFrame:
    """Members with `eligible`, stable and as good as the base (row 0) in `at_least`, and `rank` among survivors.

    Eligible ones first, then by the measure `by`, by the others, and by number; −1 for those that fail.
    """
    survives = screened["verdict"] == "marginally_stable"
    good = np.logical_and.reduce(
        [survives, *(screened[name] >= screened[name].iloc[0] * (1.0 - 1e-9) for name in at_least)]
    )
    others = [name for name in MEASURES if name != by]
    keys = [np.arange(len(screened)), *(-screened[name].fillna(0.0) for name in (*others[::-1], by)), ~good, ~survives]
    order = np.lexsort(keys)
    places = np.full(len(screened), -1)
    places[order[: survives.sum()]] = np.arange(survives.sum())
    return screened.assign(eligible=good, rank=places)


def read_columns(paths: list[str]) -> pd.DataFrame:
    """Rows of several Parquet files; InputError names one that can't be read."""
    frames, rows = [], 0
    for path in paths:
        rows += rows_of(path)
        require_members(rows, path, "screen them in parts")
        frames.append(read_parquet(path))
    return pd.concat(frames, ignore_index=True)


OPTIONS = {
    "--scene": {"required": True, "help": "YAML file of the base scene"},
    "--members": {"required": True, "help": "Parquet file of the members"},
    "--cells": {"required": True, "nargs": "+", "help": "responses of the cells, from optics.local"},
    "--by": {"choices": MEASURES, "default": "margin_1_s", "help": "what survivors are ranked by"},
    "--at-least": {"nargs": "*", "choices": MEASURES, "default": [], "help": "no worse than the base in these"},
    "--out": {"required": True, "help": "Parquet file to write"},
}


def main() -> None:
    """Screen the members of a family."""
    watch = Stopwatch()
    given = parser("dynamics.screening", main.__doc__, OPTIONS).parse_args()
    take_out(given.out)
    members, cells = read_columns([given.members]), read_columns(given.cells)
    screened = rank(screen(scenes.read_scene(given.scene), members, cells), given.by, given.at_least)
    screened.attrs |= as_attribute()
    write_parquet(given.out, screened.to_parquet(index=False))
    counts = screened["verdict"].value_counts()
    finish(given.out, watch, ", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
