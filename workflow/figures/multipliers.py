"""Floquet multipliers of the spinning sail: on the unit circle where it is marginally stable, one outside if not."""

from __future__ import annotations

import json
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.io.files import read_json, run_stage
from workflow.figures.drawing import COLOURS, named, parser, save, solver

MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def _circle(axes: Axes) -> None:
    angle = np.linspace(0, 2 * np.pi, 2001)
    axes.plot(np.cos(angle), np.sin(angle), color="0.5", lw=0.8, zorder=1)
    axes.set_aspect("equal")
    axes.set_xlabel("Re λ")


def _limits(points: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
    """A window around the upper half of all the multipliers, with a margin."""
    margin = 0.12 * max(np.ptp(points.real), points.imag.max(), 0.05)
    return (points.real.min() - margin, points.real.max() + margin), (-0.2 * margin, points.imag.max() + margin)


def _alike(results: dict[str, dict]) -> dict[str, list[str]]:
    """Spinning scenes by the multipliers they share: a different release, say, changes nothing here."""
    groups: dict[str, list[str]] = {}
    for name, result in results.items():
        if not result["multipliers"]:
            continue
        groups.setdefault(json.dumps(np.round(result["multipliers"], 9).tolist()), []).append(name)
    return {names[0]: names for names in groups.values()}


def _plot(panels: tuple[Axes, ...], results: dict[str, dict], fdtd: dict[str, dict]) -> list[np.ndarray]:
    """Draw every multiplier; return them, an array for each set."""
    every = []
    for i, (name, names) in enumerate(_alike(results).items()):
        colour, marker = COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)]
        for data in (results[name], fdtd.get(name)):
            if data is None or not data["multipliers"]:
                continue
            every.append(np.array(data["multipliers"]) @ [1, 1j])
            tables = solver(data)
            style: dict[str, Any] = {"mfc": "none", "ms": 8} if tables == "FDTD" else {"mfc": colour, "ms": 4}
            verdict = f"{data['verdict'].replace('_', ' ')}, max |λ| = {data['max_modulus']:.5f}"
            label = f"{', '.join(names)} ({tables} tables): {verdict}"
            for axes in panels:
                axes.plot(every[-1].real, every[-1].imag, marker, color=colour, ls="none", label=label, **style)
    return every


def draw(results: dict[str, dict], fdtd: dict[str, dict]) -> Figure:
    """The unit circle, and beside it the upper half near 1; filled: modal tables, open and larger: FDTD tables."""
    figure, (whole, near) = plt.subplots(1, 2, figsize=(10.5, 4.8), width_ratios=[1, 1.25])
    every = _plot((whole, near), results, fdtd)
    for axes in (whole, near):
        _circle(axes)
    whole.set_ylabel("Im λ")
    whole.set_title("multipliers λ of one turn, and the unit circle")
    near.set_title("near 1, upper half")
    if every:
        limits = _limits(np.concatenate(every))
        near.set(xlim=limits[0], ylim=limits[1], aspect="auto")
        figure.legend(*near.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    else:
        near.set_title("no sail spins: none has multipliers")
    return figure


def main() -> None:
    """Draw the multipliers of several scenes."""
    arguments = parser(__doc__)
    arguments.add_argument("--floquet", required=True, nargs="+", type=named, help="NAME=floquet.json of each scene")
    arguments.add_argument("--fdtd", nargs="*", default=[], type=named, help="the same, from FDTD tables")
    given = arguments.parse_args()
    read = ({name: read_json(path) for name, path in pairs} for pairs in (given.floquet, given.fdtd))
    save(draw(*read), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
