"""Screened families of designs: the search around the published one, the study of gaps, and errors of fabrication."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from scipy.stats import binomtest

from beamrider.io.files import run_stage
from beamrider.io.parquet import read_parquet
from workflow.figures.drawing import BLUE, GREEN, ORANGE, PURPLE, RED, parser, save

# Where the tables of the paper's "20 % larger gap" really lie, and the gaps taken at their word, in nm.
PAPER_GAPS = {"the paper's tables of its 20 % case": (337.5, 342.0, "D"), "a gap 20 % wider": (228.0, 240.0, "s")}


BINS = 10
LINES = ("-", "--", ":", "-.")
GROUPS = {"te": BLUE, "tm": GREEN, "sail": PURPLE}


def varied(screened: pd.DataFrame) -> list[str]:
    """The parameters that differ between members."""
    named = [column for column in screened if str(column).split(".")[0] in GROUPS and "." in str(column)]
    return [str(column) for column in named if screened[column].nunique() > 1]


def label(key: str) -> str:
    """A parameter as the figures name it: 'te.wide_nm' is the TE wide ridge."""
    group, name = key.split(".")
    plain = name.rsplit("_", 1)[0].replace("_", " ").replace("wide", "wide ridge")
    return f"{group.upper() if group != 'sail' else 'sail'} {plain}"


def draw_search(screened: pd.DataFrame) -> Figure:
    """Margin over thrust of the survivors, and the share that survives over each parameter."""
    figure, (cloud, shares) = plt.subplots(1, 2, figsize=(12, 4.8))
    stable, base, keys = screened[screened["verdict"] == "marginally_stable"], screened.iloc[0], varied(screened)
    best = screened[screened["eligible"]].sort_values("rank").head(5)
    colour = "tm.period_nm" if "tm.period_nm" in keys else keys[-1]
    points = cloud.scatter(
        1e3 * stable["thrust_N"], stable["margin_1_s"], c=stable[colour], s=4, cmap="viridis", rasterized=True
    )
    figure.colorbar(points, ax=cloud, label=f"{label(colour)} ({colour.rsplit('_', 1)[-1]})")
    cloud.plot(1e3 * base["thrust_N"], base["margin_1_s"], "*", color=RED, ms=15, mec="white", label="published design")
    cloud.plot(1e3 * best["thrust_N"], best["margin_1_s"], "D", color=ORANGE, mec="black", label="best members")
    cloud.set(xlabel="thrust (mN)", ylabel="margin (1/s)")
    share = len(stable) / (screened["verdict"] != "impossible").sum()
    cloud.set_title(f"{len(screened) - 1} members, {share:.0%} marginally stable")
    cloud.legend()
    for key in keys:
        _share_along(shares, key, screened.iloc[1:], float(base[key]))
    shares.axvline(1.0, color=RED, lw=0.8)
    shares.set(xlabel="parameter, of the published one", ylabel="stable members (%)", title="what stability hangs on")
    shares.legend()
    return figure


def _share_along(axes: plt.Axes, key: str, members: pd.DataFrame, base: float) -> None:
    """Share of stable members at each value of a parameter, or in bins of equal counts where there are many."""
    ok, value = members["verdict"] == "marginally_stable", members[key]
    bins = value if value.nunique() <= 2 * BINS else pd.qcut(value, BINS, duplicates="drop")
    groups = pd.DataFrame({"ok": ok, "value": value}).groupby(bins, observed=True).mean()
    group = key.split(".")[0]
    style = LINES[sum(line.get_color() == GROUPS[group] for line in axes.get_lines()) % len(LINES)]
    axes.plot(groups["value"] / base, 100 * groups["ok"], f"{style}o", color=GROUPS[group], ms=3, label=label(key))


def draw_gaps(screened: pd.DataFrame) -> Figure:
    """Margin over both gaps, and along equal factors, with the slopes of force and torque that hold the sail."""
    figure, axes = plt.subplot_mosaic("pm;ps", figsize=(12, 5.4), width_ratios=[1.1, 1])
    plane = axes["p"]
    base, members = screened.iloc[0], screened.iloc[1:]
    table = members.pivot_table(index="tm.gap_nm", columns="te.gap_nm", values="margin_1_s")
    norm = SymLogNorm(0.1, vmin=-10, vmax=10)
    image = plane.pcolormesh(table.columns, table.index, table, cmap="RdBu", norm=norm, rasterized=True)
    figure.colorbar(image, ax=plane, label="margin (1/s); negative: growth rate")
    for label, (te, tm, marker) in PAPER_GAPS.items():
        plane.plot(te, tm, marker, color=ORANGE, mec="black", ms=8, label=label)
    plane.plot(base["te.gap_nm"], base["tm.gap_nm"], "*", color=GREEN, mec="black", ms=13, label="published design")
    plane.plot(table.columns, table.columns / base["te.gap_nm"] * base["tm.gap_nm"], ":", color="black", lw=0.8)
    plane.set(xlabel="gap of the TE cell (nm)", ylabel="gap of the TM cell (nm)")
    plane.set_title("both gaps; dotted: equal factors")
    plane.legend(loc="upper left", fontsize=7)
    factor = members["te.gap_nm"] / base["te.gap_nm"]
    same = members[np.isclose(factor, members["tm.gap_nm"] / base["tm.gap_nm"])]
    factor = (same["te.gap_nm"] / base["te.gap_nm"]).to_numpy()
    _margin_along(axes["m"], factor, same)
    _slopes_along(axes["s"], factor, same, base)
    te, tm, _ = PAPER_GAPS["the paper's tables of its 20 % case"]
    for panel in (axes["m"], axes["s"]):
        panel.axvspan(*sorted((te / base["te.gap_nm"], tm / base["tm.gap_nm"])), color="0.85", zorder=0)
        panel.axvline(1.2, color=ORANGE, lw=0.8)
        panel.axhline(0.0, color="0.3", lw=0.8)
    return figure


def _lost(factor: np.ndarray, held: np.ndarray) -> str:
    """Where a quantity that is positive while it holds the sail first fails, as text."""
    return f"lost at {factor[np.argmax(held < 0)]:.2f}" if (held < 0).any() else "never lost"


def _margin_along(axes: plt.Axes, factor: np.ndarray, same: pd.DataFrame) -> None:
    """Margin over one factor for both gaps."""
    axes.fill_between(factor, same["margin_low_1_s"], same["margin_high_1_s"], color=BLUE, alpha=0.3)
    axes.plot(factor, same["margin_1_s"], color=BLUE)
    axes.set_yscale("symlog", linthresh=0.1)
    lost = _lost(factor, same["margin_1_s"].to_numpy())
    axes.set(ylabel="margin (1/s); negative: growth", title=f"stability {lost}; grey: the paper's tables, line: 1.2")


def _slopes_along(axes: plt.Axes, factor: np.ndarray, same: pd.DataFrame, base: pd.Series) -> None:
    """Slopes of force and torque over what they are for the published gaps: they hold the sail while positive."""
    parts = []
    for column, name, label, colour, style in (
        ("tau_x_roll", "roll", r"$\partial\tau_x/\partial\varphi$", ORANGE, "-"),
        ("F_y_y", "offset along y", r"$\partial F_y/\partial y$", PURPLE, "--"),
    ):
        held = (same[column] / base[column]).to_numpy()
        axes.plot(factor, held, style, color=colour, label=label)
        parts.append(f"{name} {_lost(factor, held)}")
    axes.set(xlabel="gap, of the published one (both cells)", ylabel="restoring slope, of the published one")
    axes.set_title(", ".join(parts))
    axes.legend()


SCALE = "errors, of the family's standard deviations"


def draw_tolerances(screened: pd.DataFrame) -> Figure:
    """Share of stable sails with its 95 % interval, and their margins, over the scale of the errors."""
    figure, (share, margin) = plt.subplots(1, 2, figsize=(11, 4.2))
    members = screened.iloc[1:]
    shown = [("marginally_stable", BLUE), ("unstable", RED), ("undecided", ORANGE), ("unresolved", PURPLE)]
    for verdict, colour in shown[: 4 if (members["verdict"] == "unresolved").any() else 3]:
        counts = members.assign(hit=members["verdict"] == verdict).groupby("scale")["hit"].agg(["sum", "count"])
        interval = [binomtest(int(k), int(n)).proportion_ci(0.95, "wilson") for k, n in counts.to_numpy()]
        value = (counts["sum"] / counts["count"]).to_numpy()
        error = np.abs(np.array([(low, high) for low, high in interval]).T - value)
        share.errorbar(
            counts.index, 100 * value, 100 * error, marker="o", color=colour, capsize=3, label=verdict.replace("_", " ")
        )
    share.set(xscale="log", xlabel=SCALE, ylabel="sails (%)", title="share of sails, with Wilson's 95 % interval")
    share.legend()
    scales = sorted(members["scale"].unique())
    share.set_xticks(scales, [f"{s:g}" for s in scales])
    share.minorticks_off()
    margin.boxplot(
        [members.loc[members["scale"] == s, "margin_1_s"].dropna() for s in scales],
        whis=(5, 95),
        showfliers=False,
        tick_labels=[f"{s:g}" for s in scales],
    )
    margin.axhline(float(screened["margin_1_s"].iloc[0]), color=RED, lw=0.8, label="without errors")
    margin.axhline(0.0, color="0.3", lw=0.8)
    margin.set(xlabel=SCALE, ylabel="margin (1/s)", title="median, quartiles, 5 and 95 %")
    margin.legend()
    return figure


KINDS = {"search": draw_search, "gap_study": draw_gaps, "tolerances": draw_tolerances}


def main() -> None:
    """Draw one family."""
    arguments = parser(__doc__)
    arguments.add_argument("--kind", required=True, choices=KINDS, help="which of the studies")
    arguments.add_argument("--screened", required=True, type=Path, help="Parquet file of dynamics.screening")
    given = arguments.parse_args()
    save(KINDS[given.kind](read_parquet(given.screened)), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
