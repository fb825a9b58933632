"""Every figure is drawn, and the summary written, from small real files: spinning or not, released or torn before."""

import contextlib
import csv
import importlib
import io
import json
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

from beamrider.io.files import read_json, run_stage, write_json
from beamrider.io.parquet import write_parquet
from dynamics.membrane import stage as membrane
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.stability import floquet, maps
from optics.cells.outline import read_grating, upright
from optics.modal.stage import solve
from optics.table.pressure_table import PressureTable
from optics.table.promise import promised
from tests.membranes import FIG6, altered
from tests.synthetic import smooth_tables

ROOT = Path(__file__).parents[2]
FLIGHT = {"duration_s": 1e-3, "snapshot_every_s": 2e-4, "spin_up_s": 2e-3}
SCENES = {"spinning": -120.0, "still": 0.0, "torn": 3000.0}  # turns a second; the last bursts in spin-up


def _scene(name):
    return altered(
        FIG6, name=name, sail={"rings": 2}, release={"spin_Hz": SCENES[name]}, rigid={"duration_s": 0.01}, flight=FLIGHT
    )


def _stage(module, out, *arguments):
    """Run a stage's `main` in this process, where its kernels are compiled already."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["stage", *map(str, arguments), "--out", str(out)])
        module.main()


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    """A results folder with modal and FDTD tables, and the stability and the flights of three scenes."""
    folder = tmp_path_factory.mktemp("results")
    tables = smooth_tables()
    for name, table in tables.items():
        for solver, sign, tolerance in (("modal", 0.0, 1e-3), ("fdtd", 1e-3, 1e-7)):
            table.q_nodes[2] += sign
            table.attrs.update(solver=solver, settings={"tolerance": tolerance})
            promised(table, tolerance, ["made up"]).write(folder / "tables" / name / f"{solver}.h5")
    for name in SCENES:
        scene, out = folder / f"{name}.yaml", folder / "scenes" / name
        scene.write_text(_scene(name).model_dump_json(exclude_none=True), encoding="utf-8")
        for solver, suffix in (("fdtd", "_fdtd"), ("modal", "")) if name != "torn" else ():
            paths = [folder / "tables" / design / f"{solver}.h5" for design in tables]
            _stage(floquet, out / f"floquet{suffix}.json", "--scene", scene, "--tables", *paths)
        paths = [folder / "tables" / design / "modal.h5" for design in tables]
        for stage, file in ((rigid, "rigid.h5"), (membrane, "flight.vtkhdf"), (maps, "maps.h5")):
            _stage(stage, out / file, "--scene", scene, "--tables", *paths)
    return folder


def _run(script, *arguments):
    """Exit code and standard error of a program, run in this process: imports are most of a figure's time."""
    module, error, code = importlib.import_module(f"workflow.{script}"), io.StringIO(), 0
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(error):
        patch.setattr(sys, "argv", [script, *map(str, arguments)])
        try:
            run_stage(module.main)
        except SystemExit as end:
            code = end.code
    return code, error.getvalue()


@pytest.fixture
def drawn(tmp_path):
    """A function that runs a figure's script and returns the text of its SVG, once both files hold a picture."""

    def run(script, *arguments):
        png, svg = tmp_path / "figure.png", tmp_path / "figure.svg"
        assert _run(f"figures.{script}", *arguments, "--out", png, "--svg", svg) == (0, "")
        image = imread(png)
        assert min(image.shape[:2]) > 500
        assert np.ptp(image[..., :3], axis=(0, 1)).min() > 0.5
        text = svg.read_text(encoding="utf-8")
        assert text.rstrip().endswith("</svg>")
        return re.sub("<metadata>.*?</metadata>", "", text, flags=re.DOTALL)  # which names the files it was drawn from

    return run


def test_pressure(drawn, results):
    cell = results / "tables/mark1e_te"
    text = drawn("pressure", "--modal", cell / "modal.h5", "--fdtd", cell / "fdtd.h5")
    assert "largest 1.0e-03" in text


def test_rounded_corners(drawn, tmp_path):
    cells = [ROOT / f"workflow/designs/{kind}_te.yaml" for kind in ("rounded", "mark1e")]
    u, v = np.linspace(-0.05, 0.05, 7), np.linspace(0.0, 0.05, 4)
    stairs = solve(upright(read_grating(cells[0]), 12), u, v, 27)
    q = np.moveaxis(stairs.q, -1, 0) + 1e-3
    attrs = {"name": "rounded_te", "nodes_u": list(u), "nodes_v": list(v), "cpu_seconds": 3.0}
    table = PressureTable(u, v, q, stairs.absorptance, np.full((7, 4), 2e-3), mirror_v=True, attrs=attrs)
    table.write(tmp_path / "fdtd.h5")
    numbers = tmp_path / "rounded.csv"
    files = ("--tables", tmp_path / "fdtd.h5", "--rounded", cells[0], "--sharp", cells[1], "--csv", numbers)
    text = drawn("rounded", *files)
    assert "what rounding changes" in text
    rows = {row["quantity"]: float(row["value"]) for row in csv.DictReader(numbers.open(encoding="utf-8"))}
    assert rows["|FDTD − staircase|, largest"] == pytest.approx(1e-3, rel=1e-3)
    assert 1e-3 < rows["|staircase − sharp|, largest"] < 5e-3
    assert rows["share of directions within the error that FDTD states"] == 1
    assert rows["directions solved"] == 28


def _study(incidence, growth, end):
    flight = {"end": end, "time_s": 1.0, "distance_m": 0.1, "tilt_deg": 2.0, "bounded": end == "finished"}
    return {
        "case": "wide",
        "label": "wide gaps",
        "incidence": incidence,
        "verdict": "unstable" if growth else "undecided",
        "max_modulus": 1.0 + growth,
        "margin_1_s": -growth,
        "margin_range_1_s": [-1.5 * growth, -growth],
        "route_difference": None,
        "small_flight_difference": 1e-5,
        "basin_share": 0.5,
        "paper_verdict": "unstable",
        "paper_flight": "lost",
        "flights": {"displaced": flight, "tilted": flight},
    }


def test_conclusions_say_what_stands_and_what_changes(drawn, tmp_path):
    studies = []
    for study in (_study("yaw_blind", 0.5, "fly_away"), _study("sail_frame", 0.4, "finished")):
        studies.append(tmp_path / f"{study['incidence']}.json")
        write_json(studies[-1], study)
    table, text = tmp_path / "table.csv", tmp_path / "text.md"
    drawn("conclusions", "--studies", *studies, "--csv", table, "--markdown", text)
    assert "- wide gaps: linear stability: **stands** (unstable); flight: **changes** (bounded" in text.read_text()
    with open(table, encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["incidence"] for row in rows] == ["yaw blind", "sail frame"]
    assert [row["tilted_end"] for row in rows] == ["fly away", "finished"]


def test_conclusions_say_what_the_heat_of_the_gratings_does(drawn, tmp_path):
    study, heat = tmp_path / "study.json", tmp_path / "heat.json"
    flight = {
        "absorptance": "table",
        "in_plane": "mass_equivalent",
        "intensity_W_m2": 1e9,
        "emissivity": 0.1,
        "end": "finished",
        "time_s": 0.6,
        "temperature_K": 1251.6,
        "strain": 1.143e-3,
        "slack": 0.23,
        "distance_m": 0.0836,
        "height_m": 65.0,
    }
    write_json(
        heat,
        {
            "scene": "fig6",
            "rings": 12,
            "taut": 0.01,
            "flights": [flight],
            "intensity": {**flight, "intensity_W_m2": 3e8},
            "emissivity": {**flight, "emissivity": 0.35},
        },
    )
    studies = [_study(kind, 0.5, "fly_away") for kind in ("yaw_blind", "sail_frame")]
    names = [study.with_name(f"{s['incidence']}.json") for s in studies]
    for name, one in zip(names, studies, strict=True):
        write_json(name, one)
    text = tmp_path / "text.md"
    drawn("conclusions", "--studies", *names, "--heat", heat, "--csv", tmp_path / "t.csv", "--markdown", text)
    said = text.read_text(encoding="utf-8")
    assert "| its gratings | plain film of equal mass | 1 | 0.1 | finished | 1252 | 0.114 | 23 | 83.60 | 65.0" in said
    assert "taut again (less than 1 % slack) in a beam of 0.3 GW/m², or with an emissivity of 0.35 a face" in said


@pytest.fixture(scope="module")
def basins(results) -> list[Path]:
    """Maps of six releases, with both incidences, of the spinning scene; the first where its other results lie."""
    grid, out = results / "grid.yaml", results / "scenes/spinning/basin"
    grid.write_text("{n_offsets: 2, n_tilts: 3, offsets_m: [0.0, 0.1], tilts_deg: [-3, 3], duration_s: 0.02}")
    tables = [results / "tables" / design / "modal.h5" for design in smooth_tables()]
    paths = [out / f"{incidence}.h5" for incidence in ("sail_frame", "yaw_blind")]
    for path in paths:
        _stage(
            basin,
            path,
            "--scene",
            results / "spinning.yaml",
            "--tables",
            *tables,
            "--grid",
            grid,
            "--incidence",
            path.stem,
        )
    return paths


def test_the_way(drawn, tmp_path):
    place = {
        "wavelength_m": 1e-6,
        "margin_range_1_s": [0.5, 1.5],
        "growth_1_s": 0.0,
        "verdict": "marginally_stable",
        "exponents_1_s": [[0.0, 700.0], [0.0, -700.0]],
        "time_s": 0.0,
        "log_growth": 0.0,
    }
    lost = place | {"margin_range_1_s": [-2.5, -1.5], "verdict": "unstable", "exponents_1_s": [[2.0, 700.0]] * 2}
    found = {
        "scene": "own",
        "spin_Hz": -120.0,
        "beta_max": 0.2,
        "changes": [[0.09, 0.1]],
        "stable_at_start": True,
        "lost_at_beta": 0.1,
        "way": [
            place | {"beta": 0.0, "margin_1_s": 1.0},
            lost | {"beta": 0.2, "margin_1_s": -2.0, "time_s": 9e3, "log_growth": 50.0},
        ],
    }
    write_json(tmp_path / "way.json", found)
    text = drawn("way", "--way", tmp_path / "way.json")
    assert "lost at 0.1000 c: grown tenfold" in text
    assert "margin, −growth (1/s)" in text


def test_basins_side_by_side(drawn, basins):
    text = drawn("basin", "--maps", *basins)
    assert text.count("100 % bounded") == 2
    assert "spinning, incidence of the paper, blind to yaw" in text
    assert "best, incidence seen by the sail" in drawn("basin", "--maps", basins[0], "--names", "best")


def test_the_best_of_a_family_stand_beside_the_sail_they_vary(basins, results, tmp_path):
    family = ROOT / "workflow/designs/wider_periods.yaml"
    sail = {"te.period_nm": 1600.0, "tm.gap_nm": 200.0, "acceleration_m_s2": 350.0, "eligible": True, "rank": 1}
    frame = pd.DataFrame([sail, {**sail, "te.period_nm": 1650.0, "rank": 0}])
    write_parquet(tmp_path / "screened.parquet", frame.to_parquet())
    folder = results / "scenes/spinning"
    given = [
        "--family",
        family,
        "--screened",
        tmp_path / "screened.parquet",
        "--base",
        folder,
        "--csv",
        tmp_path / "table.csv",
        "--markdown",
        tmp_path / "table.md",
    ]
    assert _run("confirmed", *given, "--candidates", folder) == (0, "")
    with open(tmp_path / "table.csv", encoding="utf-8") as stream:
        base, best = csv.DictReader(stream)
    assert (base["what_differs"], best["what_differs"]) == ("", "te.period_nm 1650")
    assert (best["basin_bounded"], best["basin_flights"], best["rigid_end"]) == ("6", "6", "finished")
    assert float(best["thrust_fdtd_N"]) > float(best["thrust_N"]) > 0.0
    assert "| margin fdtd (1/s) |" in (tmp_path / "table.md").read_text()
    code, error = _run("confirmed", *given)
    assert (code, error.count("\n")) == (2, 1)


def _screened():
    """A small screened family, stable where its gaps are small."""
    gaps = np.linspace(1.0, 1.9, 10)
    te, tm = (x.ravel() for x in np.meshgrid(190 * gaps, 200 * gaps, indexing="ij"))
    te, tm = np.append(190, te), np.append(200, tm)
    margin = 2.0 - te / 190 - 0.3 * tm / 200
    frame = pd.DataFrame(
        {
            "te.gap_nm": te,
            "tm.gap_nm": tm,
            "thrust_N": 0.3 + 1e-4 * te,
            "margin_1_s": margin,
            "scale": te // 100,
            "margin_low_1_s": margin - 0.01,
            "margin_high_1_s": margin + 0.01,
            "tau_x_roll": -0.1 * margin,
            "F_y_y": -margin,
            "verdict": np.where(margin > 0, "marginally_stable", "unstable"),
            "eligible": margin > 0,
            "rank": np.where(margin > 0, np.argsort(np.argsort(-margin)), -1),
        }
    )
    parameters = [f"{group}.{name}_nm" for group in ("te", "tm") for name in ("wide", "period")]
    return frame.assign(**dict.fromkeys(parameters, 500.0))


@pytest.mark.parametrize("kind", ["search", "gap_study", "tolerances"])
def test_families(drawn, tmp_path, kind):
    write_parquet(tmp_path / "screened.parquet", _screened().to_parquet())
    text = drawn("families", "--kind", kind, "--screened", tmp_path / "screened.parquet")
    assert {"search": "published design", "gap_study": "stability lost at 1.60", "tolerances": "Wilson"}[kind] in text


def test_maps(drawn, results):
    text = drawn("maps", "--maps", results / "scenes/spinning/maps.h5", "--name", "spinning")
    assert "equilibrium" in text


def test_payload(drawn, results):
    tables = [results / "tables" / design / "modal.h5" for design in smooth_tables()]
    text = drawn("payload", "--scene", results / "spinning.yaml", "--tables", *tables, "--places", 5, "--mass", 0.3)
    assert "0.3 g (dots), sail alone (lines)" in text


@pytest.mark.parametrize(("scene", "first"), [("spinning", 0.0), ("torn", -2e-3)])
def test_snapshots_from_release_or_of_all_there_is(drawn, results, scene, first):
    text = drawn("snapshots", "--flight", results / "scenes" / scene / "flight.vtkhdf", "--name", scene)
    times = [float(time) for time in re.findall(r"t = (\S+) s,", text)]
    assert times[0] == pytest.approx(first, abs=1e-5)
    assert times == sorted(set(times))
    assert len(times) > 1


def test_flights_that_go_on_and_one_that_ends_before_release(drawn, results):
    files = {"rigid": "rigid.h5", "flexible": "flight.vtkhdf"}
    given = {kind: [f"{s}={results}/scenes/{s}/{file}" for s in ("spinning", "torn")] for kind, file in files.items()}
    text = drawn("flights", "--rigid", *given["rigid"], "--flexible", *given["flexible"])
    assert text.count("rigid, to 0.01 s") == 2
    assert re.search(r"flexible, to -0\.00\d+ s", text)


def test_a_flight_that_ends_before_release_alone(drawn, results):
    text = drawn("flights", "--flexible", f"torn={results}/scenes/torn/flight.vtkhdf")
    assert re.search(r"flexible, to -0\.00\d+ s", text)


def _floquet(results, scenes, suffix=""):
    return [f"{scene}={results}/scenes/{scene}/floquet{suffix}.json" for scene in scenes]


def test_multipliers_are_those_of_the_scenes_that_spin(drawn, results):
    both = ["spinning", "still"]
    text = drawn("multipliers", "--floquet", *_floquet(results, both), "--fdtd", *_floquet(results, both, "_fdtd"))
    assert "spinning (modal tables)" in text
    assert "spinning (FDTD tables)" in text
    assert "still" not in text
    assert "no sail spins" in drawn("multipliers", "--floquet", *_floquet(results, ["still"]))


def test_multipliers_are_labelled_by_the_tables_that_they_were_made_with(drawn, results):
    text = drawn("multipliers", "--floquet", *_floquet(results, ["spinning"], "_fdtd"))
    assert "spinning (FDTD tables)" in text
    assert "modal tables" not in text


def _benchmark(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("s\th:m:s\n2.5\t0:00:02\n", encoding="utf-8")
    return path


def test_the_summary_has_rows_of_every_kind(results, tmp_path):
    tables = sorted(results.glob("tables/*/*.h5"))
    analyses = sorted(results.glob("scenes/*/floquet.json"))
    flights = [path for file in ("rigid.h5", "flight.vtkhdf") for path in sorted(results.glob(f"scenes/*/{file}"))]
    stages = [_benchmark(tmp_path / "tables/te" / name) for name in ("fdtd.tsv", "fdtd/part1.tsv", "fdtd/part2.tsv")]
    out = tmp_path / "summary.csv"
    given = ("--tables", *tables, "--floquet", *analyses, "--flights", *flights, "--benchmarks", *stages)
    assert _run("figures.summary", *given, "--out", out, "--html", tmp_path / "summary.html") == (0, "")
    rows = {tuple(row[:3]): row[3:] for row in csv.reader(out.open(encoding="utf-8"))}
    (rate, unit) = rows["stability", "still, modal tables", "largest growth rate"]
    exponents = json.loads((results / "scenes/still/floquet.json").read_text())["exponents_1_s"]
    assert (float(rate), unit) == (pytest.approx(max(re for re, _ in exponents), rel=1e-5, abs=1e-9), "1/s")
    assert ("stability", "still, modal tables", "largest |λ|") not in rows
    assert float(rows["stability", "spinning, modal tables", "largest |λ|"][0]) == pytest.approx(1, abs=0.2)
    assert float(rows["flight", "torn, flexible", "end"][0]) < 0
    assert rows["flight", "torn, flexible", "end reason"][0] == "tensile_failure"
    assert rows["table", "mark1e_te, modal", "tolerance 0.001"] == ["met", ""]
    assert rows["table", "mark1e_te, fdtd", "tolerance 1e-07"] == ["MISSED (made up)", ""]
    assert rows["flight", "spinning, rigid", "largest table error on the way"] == ["1e-06", ""]
    assert float(rows["flight", "spinning, flexible", "force error over thrust, at most"][0]) < 1e-5
    assert not [row for row in rows if row[0] != "table" and "MISSED" in row[2]]
    assert rows["wall time", "te", "fdtd merge"] == ["2.5", "s"]
    assert rows["wall time", "te", "fdtd, all parts"] == ["5", "s"]
    assert "<table>" in (tmp_path / "summary.html").read_text(encoding="utf-8")


def _check(results, out, fdtd="fdtd", suffix="_fdtd"):
    cells, scenes = ("mark1e_te", "mark1e_tm"), ("spinning", "still")
    return _run(
        "checks",
        "--modal",
        *(results / f"tables/{cell}/modal.h5" for cell in cells),
        "--fdtd",
        *(results / f"tables/{cell}/{fdtd}.h5" for cell in cells),
        "--floquet",
        *(results / f"scenes/{scene}/floquet.json" for scene in scenes),
        "--floquet-fdtd",
        *(results / f"scenes/{scene}/floquet{suffix}.json" for scene in scenes),
        "--out",
        out,
    )


def test_solvers_that_agree_pass_the_check(results, tmp_path):
    assert _check(results, tmp_path / "checks.json") == (0, "")
    checks = read_json(tmp_path / "checks.json")["checks"]
    assert [c["of"] for c in checks] == ["mark1e_te"] * 3 + ["mark1e_tm"] * 3 + ["spinning"]
    assert all(c["pass"] and c["value"] <= c["limit"] for c in checks)
    assert [c["value"] for c in checks if "Δq" in c["quantity"]] == pytest.approx([1e-3] * 4, rel=1e-6)
    assert [c["value"] for c in checks if "absorptance" in c["quantity"]] == [0.0, 0.0]


def test_solvers_that_disagree_fail_it_with_one_line_and_leave_nothing(results, tmp_path):
    for name, table in smooth_tables().items():
        table.q_nodes[2] += 0.012 if name == "mark1e_te" else 0.0
        table.write(results / "tables" / name / "wrong.h5")
    analysis = read_json(results / "scenes/spinning/floquet.json")
    analysis["multipliers"][0][0] += 0.02
    write_json(results / "scenes/spinning/floquet_wrong.json", analysis)
    (results / "scenes/still/floquet_wrong.json").write_text((results / "scenes/still/floquet.json").read_text())
    code, line = _check(results, tmp_path / "checks.json", "wrong", "_wrong")
    assert (code, list(tmp_path.iterdir())) == (2, [])
    assert line == (
        "error: FDTD and the modal method disagree: mark1e_te: |Δq|, 95 % below: 0.012, allowed 0.0075; "
        "spinning: |Δλ|, largest: 0.02, allowed 0.01\n"
    )
