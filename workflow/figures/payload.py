"""What a payload behind a sail leaves of its stability: margin by its mass and distance, and the frequencies."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from beamrider.io.files import run_stage
from dynamics.rigid.body import rigid_body
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from dynamics.stability.derivatives import linearise
from dynamics.stability.linear import LinearModel, growth, margin
from dynamics.stability.towed import TowedModel, towed
from workflow.figures.drawing import parser, save

MASSES_G, LINES = (0.01, 0.03, 0.1, 0.3, 1.0), 6
DEPTHS = np.geomspace(0.03, 3.0, 41)


def loaded(scene: Scene, mass: float, depth: float, radius: float, stiffness: float, damping: float) -> Scene:
    """The scene with a mass in kg so many m behind the middle, on an even ring of tethers to a radius in m."""
    angles = 2.0 * np.pi * np.arange(LINES) / LINES
    places = [[float(radius * np.cos(angle)), float(radius * np.sin(angle))] for angle in angles]
    lines = [{"to_m": place, "stiffness_N_m": stiffness, "damping_s": damping} for place in places]
    payload = [{"mass_kg": mass, "position_m": [0.0, 0.0, -depth], "tethers": lines}]
    return Scene.model_validate(scene.model_dump() | {"payload": payload})


class Sweep:
    """Stability of one scene with any payload, table errors left out."""

    def __init__(self, scene: Scene, tables: Any, given: Any) -> None:
        self._scene, self._tables, self._given = scene, tables, given
        body = rigid_body(scene, tables, lookup="smooth", quadrature=None)
        self.unit, self._spin = body.units.time, 2.0 * np.pi * scene.release.spin_Hz * body.units.time
        self._jacobian, self._thrust = linearise(scene, tables, body)
        inertia = body.sail.inertia[:2, :2]
        self.alone = LinearModel(self._jacobian, np.array(self._thrust), inertia, self._spin, False)

    def at(self, mass: float, depth: float) -> TowedModel:
        """The model with a mass in kg at a depth in m."""
        given = self._given
        scene = loaded(self._scene, mass, depth, given.radius, given.stiffness, given.damping)
        body = rigid_body(scene, self._tables, lookup="smooth", quadrature=None)
        return towed(body, self._jacobian, self._thrust, self._spin, scene)

    def margin(self, model: LinearModel) -> float:
        """Margin in 1/s, of a damped sail the rate of decay."""
        exponents = model.exponents()
        room = -growth(exponents) if model.damped else margin(exponents)
        return float(room / (model.period * self.unit))

    def frequencies(self, model: LinearModel) -> Any:
        """Frequencies (n,) ≥ 0 in Hz of the motions in turning axes."""
        found = np.linalg.eigvals(model.corotating()).imag / (2.0 * np.pi * self.unit)
        return np.sort(found[found >= 0.0])


def draw(sweep: Sweep, mass_g: float) -> Figure:
    """Margins on the left, frequencies with one mass on the right."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.2))
    for mass in MASSES_G:
        found = [sweep.at(1e-3 * mass, depth) for depth in DEPTHS]
        left.plot(DEPTHS, [sweep.margin(one) for one in found], label=f"{mass:g} g")
        if mass == mass_g:
            for depth, one in zip(DEPTHS, found, strict=True):
                values = sweep.frequencies(one)
                right.plot(np.full(values.size, depth), values, "k.", ms=2.5)
    left.axhline(sweep.margin(sweep.alone), color="0.4", ls="--", lw=1, label="sail alone")
    left.axhline(0.0, color="0.4", lw=0.8)
    left.set(xscale="log", xlabel="distance behind the sail (m)", ylabel="margin (1/s), below 0: growth")
    left.legend(frameon=False)
    for value in sweep.frequencies(sweep.alone):
        right.axhline(value, color="C0", lw=0.8)
    right.set(
        xscale="log", yscale="symlog", xlabel="distance behind the sail (m)",
        ylabel="frequency in turning axes (Hz)", title=f"{mass_g:g} g (dots), sail alone (lines)",
    )
    right.set_ylim(bottom=0.0)
    return figure


def main() -> None:
    """Draw the stability of a scene's sail with a mass behind it."""
    arguments = parser(__doc__)
    arguments.add_argument("--scene", required=True, help="YAML file of the scene")
    arguments.add_argument("--tables", nargs="*", default=[], help="pressure table of each design of the scene")
    arguments.add_argument("--mass", type=float, default=0.1, help="g of the panel of frequencies (%(default)s)")
    arguments.add_argument("--radius", type=float, default=0.3, help="m from the middle to the tethers (%(default)s)")
    arguments.add_argument("--stiffness", type=float, default=1e3, help="N/m of each tether (%(default)s)")
    arguments.add_argument("--damping", type=float, default=0.0, help="retardation time in s (%(default)s)")
    given = arguments.parse_args()
    scene = read_scene(given.scene)
    save(draw(Sweep(scene, load_tables(given.tables, scene), given), given.mass), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
