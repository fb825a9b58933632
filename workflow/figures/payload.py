"""What a payload behind a sail leaves of its stability: margin by its mass and distance, and the frequencies."""

from __future__ import annotations

import argparse

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

from beamrider.arrays import Floats
from beamrider.io.files import run_stage
from dynamics.rigid.body import carrying, rigid_body
from dynamics.sail.sectors import load_tables
from dynamics.scene.schema import Scene, read_scene
from dynamics.stability.derivatives import linearise
from dynamics.stability.linear import LinearModel, growth, margin
from dynamics.stability.towed import TowedModel, towed
from optics.table.pressure_table import PressureTable
from workflow.figures.drawing import BLUE, COLOURS, parser, save

MASSES_G, LINES = (0.01, 0.03, 0.1, 0.3, 1.0), 6
NEAREST, FARTHEST = 0.03, 3.0
#: Half the width in Hz of the panel of frequencies about the spin.
WINDOW = 4.0


def loaded(scene: Scene, mass: float, depth: float, given: argparse.Namespace) -> Scene:
    """The scene with a mass in kg so many m behind the middle, on an even ring of the given tethers."""
    angles = 2.0 * np.pi * np.arange(LINES) / LINES
    places = given.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    lines = [{"to_m": place, "stiffness_N_m": given.stiffness, "damping_s": given.damping} for place in places.tolist()]
    payload = [{"mass_kg": mass, "position_m": [0.0, 0.0, -depth], "tethers": lines}]
    return Scene.model_validate(scene.model_dump() | {"payload": payload})


class Sweep:
    """Stability of one scene's sail with any payload, table errors left out."""

    def __init__(self, scene: Scene, tables: dict[str, PressureTable], given: argparse.Namespace) -> None:
        self._scene, self._given = scene, given
        self.depths = np.geomspace(NEAREST, FARTHEST, given.places)
        self._body = rigid_body(scene, tables, lookup="smooth", quadrature=None)
        self.unit, self.spin_Hz = self._body.units.time, abs(scene.release.spin_Hz)
        self._spin = 2.0 * np.pi * scene.release.spin_Hz * self.unit
        self._jacobian, self._thrust = linearise(scene, tables, self._body)
        inertia = self._body.sail.inertia[:2, :2]
        self.alone = LinearModel(self._jacobian, np.array(self._thrust), inertia, self._spin, False)

    def at(self, mass: float, depth: float) -> TowedModel:
        """The model with a mass in kg at a depth in m."""
        scene = loaded(self._scene, mass, depth, self._given)
        return towed(carrying(scene, self._body), self._jacobian, self._thrust, self._spin, scene)

    def margin(self, model: LinearModel) -> float:
        """Margin in 1/s, of a damped sail the rate of decay."""
        exponents = model.exponents()
        room = -growth(exponents) if model.damped else margin(exponents)
        return float(room / (model.period * self.unit))

    def frequencies(self, model: LinearModel) -> Floats:
        """Frequencies (n,) ≥ 0 in Hz of the motions in turning axes."""
        found = np.linalg.eigvals(model.corotating()).imag / (2.0 * np.pi * self.unit)
        return np.sort(found[found >= 0.0])


def _margins(sweep: Sweep, mass: float) -> tuple[Floats, Floats]:
    """Depths (n,) in m and margins (n,) in 1/s with a mass in kg: where motions meet, within narrow bands, too."""
    depths = sweep.depths
    found = np.array([sweep.margin(sweep.at(mass, depth)) for depth in depths])
    low = 1 + np.flatnonzero((found[1:-1] < found[:-2]) & (found[1:-1] < found[2:]))
    lowest = [
        minimize_scalar(lambda d: sweep.margin(sweep.at(mass, d)), bounds=depths[[i - 1, i + 1]], method="bounded")
        for i in low
    ]
    depths = np.append(depths, [float(one.x) for one in lowest])
    order = np.argsort(depths)
    return depths[order], np.append(found, [float(one.fun) for one in lowest])[order]


def _draw_margins(panel: Axes, sweep: Sweep, mass: float, colour: str) -> None:
    """Margins with one mass in g by its distance; crosses where motions grow."""
    depths, found = _margins(sweep, 1e-3 * mass)
    panel.plot(depths, found, color=colour, lw=1.2, label=f"{mass:g} g")
    panel.plot(depths[found < 0.0], found[found < 0.0], "x", color=colour, ms=4)


def draw(sweep: Sweep, mass_g: float) -> Figure:
    """Margins on the left, frequencies with one mass on the right."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.4))
    for mass, colour in zip(MASSES_G, COLOURS, strict=False):
        _draw_margins(left, sweep, mass, colour)
    left.axhline(sweep.margin(sweep.alone), color="0.4", ls="--", lw=1, label="sail alone")
    left.axhline(0.0, color="0.4", lw=0.8)
    left.set(
        xscale="log",
        xlabel="distance behind the sail (m)",
        ylabel="margin (1/s); × below 0: motions grow",
        title="how far motions are from meeting",
    )
    left.legend(frameon=False, loc="upper center", ncols=3)
    left.set_ylim(top=1.25 * left.get_ylim()[1])
    for depth in sweep.depths[::2]:
        values = sweep.frequencies(sweep.at(1e-3 * mass_g, depth)) - sweep.spin_Hz
        right.plot(np.full(values.size, depth), values, "k.", ms=2)
    for value in sweep.frequencies(sweep.alone) - sweep.spin_Hz:
        right.axhline(value, color=BLUE, lw=0.8)
    right.set(
        xscale="log",
        ylim=(-WINDOW, WINDOW),
        xlabel="distance behind the sail (m)",
        ylabel="frequency in turning axes, less the spin (Hz)",
        title=f"{mass_g:g} g (dots), sail alone (lines)",
    )
    return figure


def main() -> None:
    """Draw the stability of a scene's sail with a mass behind it."""
    arguments = parser(__doc__)
    arguments.add_argument("--scene", required=True, help="YAML file of the scene")
    arguments.add_argument("--tables", nargs="*", default=[], help="pressure table of each design of the scene")
    arguments.add_argument("--mass", type=float, default=0.1, help="g of the panel of frequencies (%(default)s)")
    arguments.add_argument("--radius", type=float, default=0.3, help="m from the middle to the tethers (%(default)s)")
    arguments.add_argument("--stiffness", type=float, default=1e3, help="N/m of each tether (%(default)s)")
    arguments.add_argument("--places", type=int, default=321, help="distances, evenly by their logarithm (%(default)s)")
    arguments.add_argument("--damping", type=float, default=0.0, help="retardation time in s (%(default)s)")
    given = arguments.parse_args()
    scene = read_scene(given.scene)
    save(draw(Sweep(scene, load_tables(given.tables, scene), given), given.mass), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
