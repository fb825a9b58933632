"""What is left of the paper's conclusions with the true incidence: one table (CSV and Markdown) and one figure."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from beamrider.io.files import atomic, read_json, run_stage
from workflow.figures.drawing import BLUE, ORANGE, parser, save

MODELS = {"yaw_blind": "yaw-blind", "sail_frame": "true"}
RELEASES = {"displaced": "displaced", "tilted": "displaced and tilted"}
COLUMNS = (
    "case",
    "incidence",
    "paper_verdict",
    "verdict",
    "max_modulus",
    "margin_1_s",
    "margin_low_1_s",
    "margin_high_1_s",
    "route_difference",
    "small_flight_difference",
    "paper_flight",
    "displaced_end",
    "displaced_time_s",
    "displaced_distance_m",
    "displaced_tilt_deg",
    "tilted_end",
    "tilted_time_s",
    "tilted_distance_m",
    "tilted_tilt_deg",
    "basin_share",
)
Study = dict[str, Any]


def row(study: Study) -> dict[str, Any]:
    """One line of the table: a case with one incidence model."""
    low, high = study["margin_range_1_s"]
    out = {
        **{key: study[key] for key in COLUMNS if key in study},
        "case": study["label"],
        "margin_low_1_s": low,
        "margin_high_1_s": high,
    }
    for release in RELEASES:
        flight = study["flights"][release]
        out |= {f"{release}_{key}": flight[key] for key in ("end", "time_s", "distance_m", "tilt_deg")}
    return out


def _text(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value).replace("_", " ")


def _small(value: float | None) -> str:
    return "one route" if value is None else f"{value:.0e}"


def _flight(study: Study, release: str) -> str:
    flight = study["flights"][release]
    if flight["bounded"]:
        return f"bounded: {flight['distance_m']:.3f} m, {flight['tilt_deg']:.1f}°"
    return f"lost at {flight['time_s']:.2f} s ({flight['end'].replace('_', ' ')})"


def _flies(study: Study) -> str:
    return "bounded" if study["flights"]["tilted"]["bounded"] else "lost"


def conclusion(blind: Study, true: Study) -> str:
    """One sentence on a case: what the paper says, what stands, what changes, and where the difference lies."""
    label, said, flown = true["label"], true["paper_verdict"], true["paper_flight"]
    parts = []
    for what, paper, without, with_ in (
        ("linear stability", said, blind["verdict"], true["verdict"]),
        ("flight", flown, _flies(blind), _flies(true)),
    ):
        found = with_.replace("_", " ")
        if paper is None:
            same = "as with" if without == with_ else f"but {without.replace('_', ' ')} with"
            parts.append(f"{what}: not in the paper; {found}, {same} yaw-blind incidence")
        elif paper == with_:
            parts.append(f"{what}: **stands** ({found})")
        elif without == with_:
            parts.append(
                f"{what}: **not confirmed** by a rigid sail with either incidence ({found}; the paper: "
                f"{paper.replace('_', ' ')}), so the incidence is not the reason"
            )
        else:
            parts.append(
                f"{what}: **changes** ({found}; the paper: {paper.replace('_', ' ')}, as yaw-blind incidence gives)"
            )
    shares = [f"{study['basin_share']:.0%}" for study in (true, blind)]
    parts.append(f"basin: {shares[0]} of the releases stay, {shares[1]} with yaw-blind incidence")
    return f"- {label}: " + "; ".join(parts) + "."


WHY = """\
The paper reads its pressure tables with the pitch and roll of the normal in the lab, whatever the yaw. A tilt that
stays in the lab is seen from the spinning sail under direction cosines that turn once a revolution; with the true
incidence the response of the TE and the TM sectors therefore takes turns in holding each axis, and small motions have
constant coefficients in axes that turn with the sail. Every number below is from the rigid sail. Linear: the verdict
from the multipliers of a turn, with the errors of the tables propagated; the margin is half the distance of the two
exponents nearest to each other (negative: the growth rate). It is checked twice: the multipliers of the co-rotating
exponential against those of the monodromy matrix in the lab, and ten turns of that matrix against a flight of the full
equations at a millionth of a diameter. Yaw-blind incidence has no co-rotating route, as its system is periodic in any
axes. A pair of its multipliers always lies next to 1, hence its small margins. Flights: 5 s or until lost,
released as published; a linear growth of 0.5 1/s need not show in so short a time. Basin: share of 45 releases, offsets
to 0.2 m by tilts to ±8°, that stay within one radius of the beam for 5 s. The tables of the paper's "20 % larger gap"
are those of 337.5 and 342 nm; 228 and 240 nm are 20 % taken at its word.
"""


def markdown(pairs: list[tuple[Study, Study]]) -> str:
    """The table and the conclusions as Markdown."""
    out = ["# What is left of the paper's conclusions with the true incidence", "", WHY, "## Conclusions", ""]
    out += [conclusion(blind, true) for blind, true in pairs]
    head = (
        "case",
        "incidence",
        "verdict",
        "largest modulus",
        "margin 1/s",
        "routes differ by",
        "ten turns flown differ by",
        *RELEASES.values(),
        "basin",
    )
    out += ["", "## Numbers", "", f"| {' | '.join(head)} |", "|" + " --- |" * len(head)]
    for pair in pairs:
        for study in pair:
            low, high = study["margin_range_1_s"]
            margin = f"{study['margin_1_s']:.3g} ({low:.3g} … {high:.3g})"
            cells = (
                study["label"],
                MODELS[study["incidence"]],
                study["verdict"].replace("_", " "),
                f"{study['max_modulus']:.5f}",
                margin,
                _small(study["route_difference"]),
                _small(study["small_flight_difference"]),
                *(_flight(study, release) for release in RELEASES),
                f"{study['basin_share']:.0%}",
            )
            out.append(f"| {' | '.join(cells)} |")
    return "\n".join(out) + "\n"


CARRIES = {"mass_equivalent": "plain film of equal mass", "membrane": "membrane alone"}
ABSORBS = {"material": "plain film (the paper)", "table": "its gratings"}
HEAT = """\
The paper heats its sail with what a plain film of equal mass takes up. The gratings take up more: their tables, which
FDTD confirms, are what `{scene}` flies on. Below are flexible flights on {rings} rings. What carries tension in the
plane is between two bounds: the plain film of equal mass, which is right along the ridges, and the membrane below them
alone. Slack is where the model without bending stiffness wrinkles; the temperature is that of the hottest node.
"""


def heat_section(heat: Study) -> list[str]:
    """What the absorptance of the gratings does to the sail, as lines of Markdown."""
    head = (
        "absorptance of",
        "tension carried by",
        "beam, GW/m²",
        "emissivity of a face",
        "end",
        "peak temperature, K",
        "largest strain, %",
        "slack, % of the area",
        "largest distance, mm",
        "height at the end, m",
    )
    rows = [*heat["flights"], *(heat[name] for name in ("intensity", "emissivity") if name in heat)]
    out = ["", "## Heat", "", HEAT.format(**heat), f"| {' | '.join(head)} |", "|" + " --- |" * len(head)]
    for row in rows:
        out.append(
            "| "
            + " | ".join(
                (
                    ABSORBS[row["absorptance"]],
                    CARRIES[row["in_plane"]],
                    f"{row['intensity_W_m2'] / 1e9:.3g}",
                    f"{row['emissivity']:.3g}",
                    row["end"].replace("_", " "),
                    f"{row['temperature_K']:.0f}",
                    f"{100 * row['strain']:.3f}",
                    f"{100 * row['slack']:.3g}",
                    f"{1e3 * row['distance_m']:.2f}",
                    f"{row['height_m']:.2f}",
                )
            )
            + " |"
        )
    if "intensity" in heat:
        beam, face = heat["intensity"]["intensity_W_m2"] / 1e9, heat["emissivity"]["emissivity"]
        out += [
            "",
            f"Heated by its gratings and held by the film of equal mass, the sail is taut again (less than "
            f"{100 * heat['taut']:g} % slack) in a beam of {beam:.2g} GW/m², or with an emissivity of {face:.2g} a "
            "face: the last two rows.",
        ]
    return out


def draw(pairs: list[tuple[Study, Study]]) -> Figure:
    """Margin, largest distance and tilt of the flights, and basin of each case, both incidences side by side."""
    figure, panels = plt.subplots(1, 4, figsize=(14, 4.6), sharey=True, width_ratios=[1.3, 1, 1, 0.7])
    margin, distance, tilt, basin = panels
    places = np.arange(len(pairs))[::-1]
    for shift, colour, k in ((0.18, ORANGE, 0), (-0.18, BLUE, 1)):
        studies = [pair[k] for pair in pairs]
        values = np.array([s["margin_1_s"] for s in studies])
        errors = np.abs(np.array([s["margin_range_1_s"] for s in studies]).T - values)
        margin.barh(places + shift, values, 0.34, color=colour, xerr=errors, error_kw={"lw": 0.8, "capsize": 2})
        basin.barh(places + shift, [100 * s["basin_share"] for s in studies], 0.34, color=colour)
        for axes, key in ((distance, "distance_m"), (tilt, "tilt_deg")):
            for release, marker, face in (("displaced", "o", "none"), ("tilted", "D", colour)):
                flights = [s["flights"][release] for s in studies]
                axes.plot([f[key] for f in flights], places + shift, marker, color=colour, mfc=face, ms=6)
                lost = [(f[key], y) for f, y in zip(flights, places + shift, strict=True) if not f["bounded"]]
                axes.plot(*np.reshape(lost, (-1, 2)).T, "x", color="black", ms=9, mew=1.2)
    margin.axvline(0.0, color="0.3", lw=0.8)
    margin.set_xscale("symlog", linthresh=1e-3)
    margin.set_xticks([-1.0, 0.0, 1e-3, 1e-2, 1e-1, 1.0])
    margin.set(xlabel="margin (1/s); negative: growth rate", title="linear stability", yticks=places)
    margin.set_yticklabels([true["label"] for _, true in pairs])
    distance.set(xlabel="largest distance from the axis (m)", title="rigid flight of 5 s", xscale="log")
    tilt.set(xlabel="largest tilt (°)", title="rigid flight of 5 s")
    basin.set(xlabel="releases that stay for 5 s (%)", title="basin", xlim=(0, 100))
    _legend(figure)
    return figure


def _legend(figure: Figure) -> None:
    bars = [plt.Rectangle((0, 0), 1, 1, color=colour) for colour in (ORANGE, BLUE)]
    styles = ({"marker": "o", "mfc": "none"}, {"marker": "D"}, {"marker": "x", "ms": 9})
    marks = [plt.Line2D([], [], color="black", ls="none", **style) for style in styles]
    labels = ["yaw-blind incidence (the paper's)", "true incidence", *RELEASES.values(), "lost"]
    figure.legend([*bars, *marks], labels, loc="outside lower center", ncols=5)


def main() -> None:
    """Gather the studies of all cases."""
    arguments = parser(__doc__)
    arguments.add_argument("--studies", required=True, nargs="+", type=Path, help="JSON of each case and incidence")
    arguments.add_argument("--heat", type=Path, help="JSON of workflow.heat: what the light taken up does")
    arguments.add_argument("--csv", required=True, type=Path, help="table to write")
    arguments.add_argument("--markdown", required=True, type=Path, help="table and conclusions to write")
    given = arguments.parse_args()
    studies = [read_json(path) for path in given.studies]
    by = {(s["case"], s["incidence"]): s for s in studies}
    pairs = [(by[name, "yaw_blind"], by[name, "sail_frame"]) for name in dict.fromkeys(s["case"] for s in studies)]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for study in (study for pair in pairs for study in pair):
        line = row(study)
        writer.writerow([_text(line.get(column)) for column in COLUMNS])
    heat = read_json(given.heat) if given.heat else None
    said = markdown(pairs) + ("\n".join(heat_section(heat)) + "\n" if heat else "")
    for path, text in ((given.csv, stream.getvalue()), (given.markdown, said)):
        with atomic(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    save(draw(pairs), given.out, given.svg)


if __name__ == "__main__":
    run_stage(main)
