"""Screened families of designs: the search around the published one, the study of gaps, and errors of fabrication."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from drawing import BLUE, GREEN, ORANGE, PURPLE, RED, parser, plt, save
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from scipy.stats import binomtest

from optics.files import run_stage

# Where the tables of the paper's "20 % larger gap" really lie, and the gaps taken at their word, in nm.
PAPER_GAPS = {"the paper's tables of its 20 % case": (337.5, 342.0, "D"), "a gap 20 % wider": (228.0, 240.0, "s")}


def draw_search(screened: pd.DataFrame) -> Figure:
    """Margin over thrust of the survivors, and where each cell's parameters put them."""
    figure, (cloud, gaps) = plt.subplots(1, 2, figsize=(12, 4.8))
    stable, base = screened[screened["verdict"] == "marginally_stable"], screened.iloc[0]
    best = screened[screened["eligible"]].sort_values("rank").head(5)
    points = cloud.scatter(
        1e3 * stable["thrust_N"], stable["margin_1_s"], c=stable["tm.period_nm"], s=4, cmap="viridis", rasterized=True
    )
    figure.colorbar(points, ax=cloud, label="period of the TM cell (nm)")
    cloud.plot(1e3 * base["thrust_N"], base["margin_1_s"], "*", color=RED, ms=15, mec="white", label="published design")
    cloud.plot(1e3 * best["thrust_N"], best["margin_1_s"], "D", color=ORANGE, mec="black", label="best at its thrust")
    cloud.set(xlabel="thrust (mN)", ylabel="margin (1/s)")
    share = len(stable) / (screened["verdict"] != "impossible").sum()
    cloud.set_title(f"{len(screened) - 1} members, {share:.0%} marginally stable")
    cloud.legend()
    for group, colour in (("te", BLUE), ("tm", GREEN)):
        for name, style in (("gap_nm", "-"), ("wide_nm", "--"), ("period_nm", ":")):
            key = f"{group}.{name}"
            medians = screened.assign(ok=screened["verdict"] == "marginally_stable").groupby(key)["ok"].mean()
            label = f"{group.upper()} {name[:-3].replace('wide', 'wide ridge')}"
            gaps.plot(medians.index / base[key], 100 * medians, style, marker="o", ms=3, color=colour, label=label)
    gaps.axvline(1.0, color=RED, lw=0.8)
    gaps.set(xlabel="parameter, of the published one", ylabel="stable members (%)", title="what stability hangs on")
    gaps.legend()
    return figure


def draw_gaps(screened: pd.DataFrame) -> Figure:
    """Margin over both gaps, and along equal factors."""
    figure, (plane, line) = plt.subplots(1, 2, figsize=(12, 4.8))
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
    factor = same["te.gap_nm"] / base["te.gap_nm"]
    _along(line, factor.to_numpy(), same, base)
    return figure


def _along(line: plt.Axes, factor: np.ndarray, same: pd.DataFrame, base: pd.Series) -> None:
    """Margin and the slopes of the torques over one factor for both gaps."""
    line.fill_between(factor, same["margin_low_1_s"], same["margin_high_1_s"], color=BLUE, alpha=0.3)
    line.plot(factor, same["margin_1_s"], color=BLUE, label="margin")
    line.axhline(0.0, color="0.3", lw=0.8)
    line.set_yscale("symlog", linthresh=0.5)
    line.set(xlabel="gap, of the published one (both cells)", ylabel="margin (1/s)")
    line.yaxis.label.set_color(BLUE)
    slopes = line.twinx()
    slopes.grid(False)
    slopes.plot(factor, 1e3 * same["tau_x_roll"], color=ORANGE, label=r"$\partial\tau_x/\partial\varphi$")
    slopes.plot(factor, 1e3 * same["F_y_y"], color=PURPLE, ls="--", label=r"$\partial F_y/\partial y$")
    slopes.axhline(0.0, color=ORANGE, lw=0.8, ls=":")
    slopes.set_ylabel(r"$10^{-3}$ (normalised); restoring where negative", color=ORANGE)
    lost = {"stability": same["margin_1_s"].to_numpy(), "roll": -same["tau_x_roll"].to_numpy()}
    where = {what: float(factor[np.argmax(values < 0)]) for what, values in lost.items() if (values < 0).any()}
    te, tm, _ = PAPER_GAPS["the paper's tables of its 20 % case"]
    line.axvspan(*sorted((te / base["te.gap_nm"], tm / base["tm.gap_nm"])), color="0.8")
    line.set_title(", ".join(f"{what} lost at {x:.2f}" for what, x in where.items()) + "; grey: the paper's tables")
    handles = [*line.get_lines()[:1], *slopes.get_lines()[:2]]
    line.legend(handles, [str(handle.get_label()) for handle in handles], loc="lower left")


def draw_tolerances(screened: pd.DataFrame) -> Figure:
    """Share of stable sails with its 95 % interval, and their margins, over the scale of the errors."""
    figure, (share, margin) = plt.subplots(1, 2, figsize=(11, 4.2))
    members = screened.iloc[1:]
    for verdict, colour in (("marginally_stable", BLUE), ("unstable", RED), ("undecided", ORANGE)):
        counts = members.assign(hit=members["verdict"] == verdict).groupby("scale")["hit"].agg(["sum", "count"])
        interval = [binomtest(int(k), int(n)).proportion_ci(0.95, "wilson") for k, n in counts.to_numpy()]
        value = (counts["sum"] / counts["count"]).to_numpy()
        error = np.abs(np.array([(low, high) for low, high in interval]).T - value)
        share.errorbar(counts.index, 100 * value, 100 * error, marker="o", color=colour, capsize=3,
                       label=verdict.replace("_", " "))
    share.set(xscale="log", xlabel="errors (1: as the family says)", ylabel="sails (%)", title="Wilson 95 %")
    share.legend()
    scales = sorted(members["scale"].unique())
    share.set_xticks(scales, [f"{s:g}" for s in scales])
    share.minorticks_off()
    margin.boxplot([members.loc[members["scale"] == s, "margin_1_s"].dropna() for s in scales], whis=(5, 95),
                   showfliers=False, tick_labels=[f"{s:g}" for s in scales])
    margin.axhline(float(screened["margin_1_s"].iloc[0]), color=RED, lw=0.8, label="without errors")
    margin.axhline(0.0, color="0.3", lw=0.8)
    margin.set(xlabel="errors (1: as the family says)", ylabel="margin (1/s)", title="quartiles, 5 and 95 %")
    margin.legend()
    return figure


KINDS = {"search": draw_search, "gap_study": draw_gaps, "tolerances": draw_tolerances}


def main() -> None:
    """Draw one family."""
    arguments = parser(__doc__)
    arguments.add_argument("--kind", required=True, choices=KINDS, help="which of the studies")
    arguments.add_argument("--screened", required=True, type=Path, help="Parquet file of dynamics.screening")
    given = arguments.parse_args()
    save(KINDS[given.kind](pd.read_parquet(given.screened)), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
