"""Stability of a sail on its way, over its speed: margin, frequencies of the swings, time, growth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beamrider.io.files import read_json, run_stage
from workflow.figures.drawing import BLUE, GREEN, ORANGE, parser, save

_MOST_GROWTH = 30.0  # e-folds that are drawn: a sail is lost long before


def _shade(axes: Axes, found: dict[str, Any]) -> None:
    """Grey where a swing grows."""
    edges = [0.0, *(0.5 * (low + high) for low, high in found["changes"]), found["beta_max"]]
    for i in range(0 if found["way"][0]["growth_1_s"] > 0.0 else 1, len(edges) - 1, 2):
        axes.axvspan(edges[i], edges[i + 1], color="0.88", lw=0, zorder=0)


def _margin(axes: Axes, beta: np.ndarray, way: list[dict[str, Any]]) -> None:
    low, high = np.array([one["margin_range_1_s"] for one in way]).T
    axes.fill_between(beta, low, high, color=BLUE, alpha=0.3, lw=0, label="within the errors of the optics")
    axes.plot(beta, [one["margin_1_s"] for one in way], color=BLUE, lw=1.2, label="margin")
    axes.axhline(0.0, color="0.3", lw=0.6)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylabel("margin, −growth (1/s)")
    axes.legend(loc="lower left")


def _swings(axes: Axes, beta: np.ndarray, way: list[dict[str, Any]]) -> None:
    found = np.array([one["exponents_1_s"] for one in way])
    hertz, grows = np.abs(found[..., 1]) / (2.0 * np.pi), found[..., 0] > 1e-3
    across = np.broadcast_to(beta[:, None], hertz.shape)
    axes.plot(across[~grows], hertz[~grows], ".", color=BLUE, ms=2.5, label="neither grow nor decay")
    axes.plot(across[grows], hertz[grows], ".", color=ORANGE, ms=2.5, label="grow")
    axes.set_ylabel("swings seen from the sail (Hz)")
    axes.set_ylim(bottom=axes.get_ylim()[0] - 0.15 * np.ptp(axes.get_ylim()))
    axes.legend(loc="lower left", markerscale=3, ncols=2)


def _time(axes: Axes, beta: np.ndarray, way: list[dict[str, Any]], lost: float | None) -> None:
    axes.plot(beta, [one["time_s"] / 3600.0 for one in way], color=GREEN, label="time")
    axes.set_ylabel("time on the way (h)")
    right = axes.twinx()
    right.grid(visible=False)
    right.plot(
        beta, np.minimum([one["log_growth"] for one in way], _MOST_GROWTH), color=ORANGE, label="growth of a swing"
    )
    right.set_ylabel("e-folds of a swing so far")
    if lost is not None:
        right.axvline(lost, color=ORANGE, ls=":", label=f"lost at {lost:.4f} c: grown tenfold")
    handles = [*axes.get_legend_handles_labels()[0], *right.get_legend_handles_labels()[0]]
    axes.legend(handles=handles, loc="upper left")
    axes.set_xlabel("speed β = v/c")


def draw(found: dict[str, Any]) -> Figure:
    """Three panels over the speed."""
    way = found["way"]
    beta = np.array([one["beta"] for one in way])
    figure, panels = plt.subplots(3, 1, figsize=(7.5, 8.0), sharex=True)
    for axes in panels:
        _shade(axes, found)
    _margin(panels[0], beta, way)
    _swings(panels[1], beta, way)
    _time(panels[2], beta, way, found["lost_at_beta"])
    first, last = (1e9 * one["wavelength_m"] for one in (way[0], way[-1]))
    panels[0].set_title(
        f"{found['scene']}: {found['spin_Hz']:g} Hz, light of {first:.0f} nm, seen at {last:.0f} nm in the end; grey: "
        "unstable"
    )
    panels[0].set_xlim(beta[0], beta[-1])
    return figure


def main() -> None:
    """Draw the way of a scene."""
    arguments = parser(__doc__)
    arguments.add_argument("--way", required=True, type=Path, help="way.json, from dynamics.way")
    given = arguments.parse_args()
    save(draw(read_json(given.way)), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
