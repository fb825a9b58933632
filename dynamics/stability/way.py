"""Linear stability of a spinning sail on its way: over its speed β = v/c, as its light shifts to the red.

    python -m dynamics.way --scene workflow/scenes/fig6.yaml --responses te_band.h5 tm_band.h5 --out way.json

In the frame that moves with the sail the light of a laser at rest has the wavelength λ √((1 + β)/(1 − β)) and the
intensity I (1 − β)/(1 + β) (Einstein, Ann. Phys. 322 (1905) 891, §7 and §8). Both change slowly against a turn and
against the sail's swings: at each β the linear model of `dynamics.stability.linear` holds, in proper time. Spin and
mass are constant. A lateral velocity v tilts the light by −v/c (aberration): the growth of order a/c that this gives,
or the damping, is told, and too weak to decide a verdict.

Windows of β are found on a grid of `STEP`, and their edges then halved down to `EDGE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from beamrider.arrays import Complexes, Floats
from beamrider.io.arguments import stage_arguments
from beamrider.io.files import InputError, finish, versions, write_json
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.rigid.body import RigidBody, rigid_body
from dynamics.sail.sectors import load_tables, require_own_polarisation
from dynamics.scene import schema as scenes
from dynamics.stability.derivatives import body_moments, derivatives, imbalance
from dynamics.stability.linear import RESOLUTION, LinearModel, growth, margin
from optics.table.band_response import BandResponse
from optics.table.normal_incidence import ATTRIBUTE, NormalResponse, constant_response
from optics.table.pressure_table import PressureTable

BETA_MAX = 0.2
#: Of β: grid on which changes are looked for, how well their edges are known, distance of the entries.
STEP, EDGE, LISTED = 1e-5, 1e-7, 2e-3
#: Places at which the journey is added up, beside those that are listed.
ALONG = 4001
#: Mixtures of the errors of the responses, each number at its full size up or down.
SAMPLES = 32
#: Growth of a swing with which a sail counts as lost.
LOST = 10.0
Intensity = Literal["sail", "rest"]
VERDICTS = ("marginally_stable", "undecided", "unstable")


def redshift(beta: Floats | float) -> Any:
    """λ'/λ (...) of light from behind at β (...)."""
    return np.sqrt((1.0 + np.asarray(beta)) / (1.0 - np.asarray(beta)))[()]


@dataclass(frozen=True)
class Way:
    """A scene's sail and the responses of its designs over the band.

    intensity: that in the sail's frame falls as it flees ('sail'), or stays that at rest ('rest').
    """

    scene: scenes.Scene
    bands: dict[str, BandResponse]
    intensity: Intensity = "sail"

    @cached_property
    def wavelength(self) -> float:
        """Wavelength in m of the light at rest, that of the cells."""
        known = {float(_cell(band)["wavelength_nm"]) for band in self.bands.values()}
        if len(known) > 1:
            those = ", ".join(f"{x:g}" for x in sorted(known))
            raise InputError(f"--responses: cells for light of {those} nm: one beam lights the whole sail")
        if not known:
            raise InputError(
                f"{self.scene.name}.yaml: sail.sectors: none has a design, whose light would have a colour"
            )
        return 1e-9 * known.pop()

    @cached_property
    def body(self) -> RigidBody:
        """The sail as a rigid body; InputError where it has no equilibrium on the axis."""
        scene = self.scene
        if scene.beam.intensity_W_m2 == 0.0:
            raise InputError(f"{scene.name}.yaml: beam.intensity_W_m2 = 0: must be above 0 for a stability analysis")
        require_own_polarisation(scene, "a stability analysis")
        if scene.incidence == "yaw_blind":
            raise InputError(f"{scene.name}.yaml: incidence = yaw_blind: must be sail_frame for stability on the way")
        if not scene.beam.round or scene.beam.pointing.path is not None:
            raise InputError(f"{scene.name}.yaml: beam: must be round and stay where it is for stability on the way")
        if scene.carried:
            raise InputError(f"{scene.name}.yaml: payload: must be left out for stability on the way")
        tables = {name: _stand_in(band, band.at(self.wavelength)) for name, band in self.bands.items()}
        load_tables(tables.values(), scene)
        body = rigid_body(scene, tables, lookup="smooth", quadrature=None)
        share, _ = imbalance(scene, tables, body)
        if share > 1e-6:
            raise InputError(
                f"{scene.name}.yaml: sail.sectors: force or torque on the centred, level sail is {share:.2g} of the "
                "thrust; it must vanish for a stability analysis (give sail and beam a two-fold symmetry)"
            )
        return body

    @cached_property
    def spin(self) -> float:
        """Spin in rad per unit of time."""
        return 2.0 * np.pi * self.scene.release.spin_Hz * self.body.units.time

    def dimming(self, beta: Floats) -> Floats:
        """Intensity (...) on the sail over that at rest."""
        return (1.0 - beta) / (1.0 + beta) if self.intensity == "sail" else np.ones_like(beta)

    def responses(self, beta: Floats) -> dict[str, NormalResponse]:
        """Of each design the responses at β (n,); InputError where a band ends before."""
        light = self.wavelength * redshift(beta)
        for name, band in self.bands.items():
            if light.max() > band.wavelength[-1] * (1.0 + 1e-9):
                raise InputError(
                    f"--responses: the band of '{name}' ends at {band.wavelength[-1] * 1e9:.6g} nm: light is seen at "
                    f"{light.max() * 1e9:.6g} nm at beta = {beta.max():g}; make a wider one with optics.band, or lower "
                    "--beta-max"
                )
        return {name: band.at(light) for name, band in self.bands.items()}

    def models(self, beta: Floats, seed: int | None = None) -> LinearModel:
        """Linear models at β (n,). seed: of a mixture of all errors at their full size, up or down; None for none."""
        known = {
            name: _numbers(found, None if seed is None else [seed, i])
            for i, (name, found) in enumerate(self.responses(beta).items())
        }
        parts = []
        for sector in self.scene.sail.sectors:
            mirror = constant_response(sector.reflectance or 0.0, sector.properties.absorptance)
            steady = np.tile(mirror.q, (beta.size, 1)), np.tile(mirror.gradient, (beta.size, 1, 1))
            parts.append(known[sector.design] if sector.design else steady)
        q, gradient = (np.stack([part[k] for part in parts], axis=1) for k in range(2))
        jacobian, thrust = derivatives(self.body.sail.g, q, gradient, body_moments(self.scene, self.body))
        share = self.dimming(beta)
        inertia = self.body.sail.inertia[:2, :2]
        return LinearModel(share[:, None, None] * jacobian, share * thrust, inertia, self.spin, False)


def _cell(band: BandResponse) -> dict[str, Any]:
    cell = band.attrs.get("cell")
    if not isinstance(cell, dict):
        raise InputError(f"response of '{band.name}': holds no cell: make it with optics.band")
    return cell


def _stand_in(band: BandResponse, response: NormalResponse) -> PressureTable:
    """A table that knows the cell and its response around normal incidence, and nothing else."""
    axis = np.array([-1.0, 1.0])
    attrs = {"name": band.name, "cell": _cell(band), ATTRIBUTE: response.as_dict()}
    return PressureTable(axis, axis, np.zeros((3, 2, 2)), np.zeros((2, 2)), np.ones((2, 2)), attrs=attrs)


def _numbers(found: NormalResponse, seed: list[int] | None) -> tuple[Floats, Floats]:
    """The numbers q (n, 3) and gradient (n, 3, 2), with their errors up or down by chance, the same way at every β."""
    if seed is None:
        return found.q, found.gradient
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], 9)
    return found.q + signs[:3] * found.q_error, found.gradient + signs[3:].reshape(3, 2) * found.gradient_error


@dataclass(frozen=True)
class Found:
    """At β (n,): growth and margins in 1/s, those at most and least within the errors, and verdicts as numbers.

    growth (n,): of the fastest swing, 0 where it is below the resolution. margin_range (n, 2). verdict (n,): index in
    `VERDICTS`.
    """

    beta: Floats
    growth: Floats
    margin: Floats
    margin_range: Floats
    verdict: NDArray[np.int64]


def _turn(way: Way, model: LinearModel) -> Any:
    """Time of a turn in s."""
    return np.asarray(model.period) * way.body.units.time


def assess(way: Way, beta: Floats) -> Found:
    """What the models at β (n,), and those within their errors, are."""
    rates, rooms = [], []
    for seed in (None, *range(SAMPLES)):
        model = way.models(beta, seed)
        exponents = model.exponents()
        rates.append(growth(exponents))
        rooms.append(margin(exponents) / _turn(way, model))
    grows = np.stack(rates) > RESOLUTION
    verdict = np.where(grows.all(axis=0), 2, np.where(grows.any(axis=0), 1, 0))
    per_second = np.where(grows[0], rates[0], 0.0) / _turn(way, model)
    return Found(beta, per_second, rooms[0], np.stack([np.min(rooms, axis=0), np.max(rooms, axis=0)], axis=1), verdict)


def _unstable(way: Way, beta: Floats) -> NDArray[np.bool_]:
    """Does a swing grow at β (n,), by the responses as they are."""
    return np.asarray(growth(way.models(beta).exponents()) > RESOLUTION)


def changes(way: Way, beta_max: float) -> Floats:
    """Edges (n, 2) in β between stable and unstable: the last of one kind and the first of the other, `EDGE` apart."""
    beta = np.linspace(0.0, beta_max, max(2, int(np.ceil(beta_max / STEP)) + 1))
    unstable = _unstable(way, beta)
    at = np.flatnonzero(unstable[1:] != unstable[:-1])
    low, high, kind = beta[at], beta[at + 1], unstable[at]
    while at.size and (high - low).max() > EDGE:
        middle = 0.5 * (low + high)
        same = _unstable(way, middle) == kind
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.stack([low, high], axis=1)


def aberrated(way: Way, beta: Floats) -> Complexes:
    """Exponents (n, 8) in 1/s with the tilt of the light that a lateral velocity gives.

    v_x tilts it as a pitch of v_x/c would, v_y as a roll of −v_y/c, but that the thrust does not turn with it.
    """
    model, units = way.models(beta), way.body.units
    tilt = model.jacobian[..., 2:].copy()
    tilt[..., 0, 1] -= model.thrust
    tilt[..., 1, 0] += model.thrust
    speed = LIGHT_SPEED * units.time / units.length
    drag = np.stack([tilt[..., 1], -tilt[..., 0]], axis=-1) / speed
    generator = model.corotating()
    generator[..., 2:4, 2:4] += drag[..., :2, :]
    generator[..., 6:8, 2:4] += np.linalg.solve(model.inertia, drag[..., 2:, :])
    return np.asarray(np.linalg.eigvals(generator) / units.time)


@dataclass(frozen=True)
class Journey:
    """The way at β (n,): proper acceleration in m/s², proper and lab time in s, distance in m, ln of the growth."""

    acceleration: Floats
    proper_time: Floats
    time: Floats
    distance: Floats
    log_growth: Floats


def journey(way: Way, beta: Floats, per_second: Floats) -> Journey:
    """The way from rest over β (n,) in the light of the scene, with growth in 1/s there; head-on, γ² dβ/dτ = a/c."""
    units = way.body.units
    pull = way.models(beta).thrust * units.length / units.time**2
    if np.any(pull <= 0.0):
        where = beta[np.argmax(pull <= 0.0)]
        raise InputError(f"{way.scene.name}.yaml: sail: the light does not push it on at beta = {where:g}")
    gamma = 1.0 / np.sqrt(1.0 - beta**2)
    per_beta = gamma**2 * LIGHT_SPEED / pull

    def along(values: Floats) -> Floats:
        return np.asarray(cumulative_trapezoid(values, beta, initial=0.0))

    return Journey(
        pull,
        along(per_beta),
        along(gamma * per_beta),
        along(gamma * per_beta * beta * LIGHT_SPEED),
        along(per_beta * per_second),
    )


def report(way: Way, beta_max: float = BETA_MAX) -> dict[str, Any]:
    """All that is found about a sail's way, as JSON."""
    edges = changes(way, beta_max)
    listed = np.linspace(0.0, beta_max, max(2, round(beta_max / LISTED) + 1))
    beta = np.unique(np.concatenate([listed, edges.ravel()]))
    dense = np.unique(np.concatenate([np.linspace(0.0, beta_max, ALONG), beta]))
    found, trip = assess(way, beta), journey(way, dense, _rates(way, dense))
    return {
        "scene": way.scene.name,
        "spin_Hz": way.scene.release.spin_Hz,
        "intensity": way.intensity,
        "wavelength_m": way.wavelength,
        "beta_max": beta_max,
        "way": _entries(way, found, trip, dense),
        "changes": edges.tolist(),
        "stable_at_start": bool(found.verdict[0] == 0),
        "stable_to_beta": _stable_to(way, found),
        "lost_at_beta": _lost(dense, trip.log_growth),
        "lost_means": f"a swing has grown {LOST:g} times",
        "resolution": RESOLUTION,
        "step_in_beta": STEP,
        "responses": {
            name: {
                "wavelengths": band.wavelength.size,
                "q_error": float(band.q_error.max()),
                "gradient_error": float(band.gradient_error.max()),
            }
            for name, band in way.bands.items()
        },
        "left_out": "spread of the beam; Thomas precession; Doppler shift by the sail's own rotation",
        "versions": versions("numpy", "scipy"),
    }


def _stable_to(way: Way, found: Found) -> float:
    """The β to which the sail is stable, whatever the errors, from the start on: known to `EDGE`."""
    bad = np.flatnonzero(found.verdict != 0)
    if not bad.size or bad[0] == 0:
        return float(found.beta[-1] if not bad.size else 0.0)
    low, high = found.beta[bad[0] - 1], found.beta[bad[0]]
    while high - low > EDGE:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if assess(way, np.array([middle])).verdict[0] else (middle, high)
    return float(low)


def _lost(beta: Floats, log_growth: Floats) -> float | None:
    """Where swings have grown `LOST` times, from the logarithms of their growth at β (n,); None if they don't."""
    beyond = np.flatnonzero(log_growth > np.log(LOST))
    if not beyond.size:
        return None
    k = beyond[0]
    return float(np.interp(np.log(LOST), log_growth[k - 1 : k + 1], beta[k - 1 : k + 1]))


def _rates(way: Way, beta: Floats) -> Floats:
    """Growth in 1/s at β (n,), 0 where none is resolved."""
    model = way.models(beta)
    rate = growth(model.exponents())
    return np.asarray(np.where(rate > RESOLUTION, rate, 0.0) / _turn(way, model))


def _entries(way: Way, found: Found, trip: Journey, dense: Floats) -> list[dict[str, Any]]:
    """One entry for each β that is listed; the journey is known at `dense` ones, among which these are."""
    at = np.searchsorted(dense, found.beta)
    exponents = np.linalg.eigvals(way.models(found.beta).corotating()) / way.body.units.time
    light, damped = way.wavelength * redshift(found.beta), aberrated(way, found.beta).real.max(axis=-1)
    return [
        {
            "beta": float(found.beta[i]),
            "wavelength_m": float(light[i]),
            "margin_1_s": float(found.margin[i]),
            "margin_range_1_s": found.margin_range[i].tolist(),
            "growth_1_s": float(found.growth[i]),
            "verdict": VERDICTS[found.verdict[i]],
            "aberration_1_s": float(damped[i]),
            "exponents_1_s": [[float(x.real), float(x.imag)] for x in sorted(exponents[i], key=_order)],
            "acceleration_m_s2": float(trip.acceleration[k]),
            "time_s": float(trip.time[k]),
            "proper_time_s": float(trip.proper_time[k]),
            "distance_m": float(trip.distance[k]),
            "log_growth": float(trip.log_growth[k]),
        }
        for i, k in enumerate(at)
    ]


def _order(value: complex) -> tuple[float, float]:
    return (-abs(value.imag), -value.imag)


def read_bands(paths: Sequence[str | Path], scene: scenes.Scene) -> dict[str, BandResponse]:
    """The response of each design of a scene; InputError for one that is missing, foreign, or given twice."""
    found: dict[str, BandResponse] = {}
    for path in paths:
        band = BandResponse.read(path)
        if band.name not in scene.sail.designs or band.name in found:
            allowed = ", ".join(scene.sail.designs) or "none: no sector has a design"
            raise InputError(f"{path}: name = '{band.name}': must be a design of scene '{scene.name}', once: {allowed}")
        found[band.name] = band
    missing = [name for name in scene.sail.designs if name not in found]
    if missing:
        raise InputError(f"{scene.name}.yaml: sail.sectors: no response of '{missing[0]}'; add it to --responses")
    return found


OPTIONS = {
    "--responses": {"nargs": "*", "default": [], "help": "response over the band of each design, from optics.band"},
    "--beta-max": {"type": float, "default": BETA_MAX, "help": "how fast the way ends, in c (default %(default)s)"},
    "--intensity": {
        "choices": ("sail", "rest"),
        "default": "sail",
        "help": "light in the frame of the sail, (1 − β)/(1 + β) of that at rest, or that at rest all the way",
    },
}


def main() -> None:
    """Linear stability of a spinning sail on its way, over its speed."""
    given = stage_arguments("dynamics.way", main.__doc__, "JSON file to write", tables=False, options=OPTIONS)
    if not 0.0 < given.beta_max < 0.9:
        raise InputError(f"--beta-max = {given.beta_max:g}: must be between 0 and 0.9")
    scene = scenes.read_scene(given.scene)
    way = Way(scene, read_bands(given.responses, scene), given.intensity)
    found = report(way, given.beta_max)
    write_json(given.out, found)
    counts = {name: sum(one["verdict"] == name for one in found["way"]) for name in VERDICTS}
    said = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    lost = f"; lost at {found['lost_at_beta']:.4g} c" if found["lost_at_beta"] is not None else ""
    told = f"stable to {found['stable_to_beta']:.5g} c" if found["stable_at_start"] else "not stable at rest"
    changed = f"{len(found['changes'])} changes up to {given.beta_max:g} c"
    finish(given.out, given.watch, f"{said}; {told}, {changed}{lost}")
