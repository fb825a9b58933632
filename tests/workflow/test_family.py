"""Families: what is written is what was meant, wrong ones are refused in one line, and only the best go on."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from beamrider.io.files import InputError, load_yaml, read_lines
from dynamics.scene.schema import read_scene
from optics.cells.schema import read_cell, read_metagrating
from workflow.configuration import read_config, read_plan
from workflow.family import base_parameters, expand, number_cells, read_family

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / "workflow"
FIG6 = read_scene(WORKFLOW / "scenes/fig6.yaml")
BASES = [read_metagrating(WORKFLOW / f"designs/mark1e_{kind}.yaml") for kind in ("te", "tm")]
BASE = base_parameters(FIG6, BASES)


@pytest.fixture
def family(tmp_path):
    """A function that reads a family made of the given entries."""

    def read(**entries):
        path = tmp_path / "own.yaml"
        data = {"kind": "family", "name": "own", "description": "a family", "scene": "fig6", **entries}
        path.write_text(yaml.safe_dump(data), encoding="utf-8")
        return read_family(path)

    return read


FAMILIES = [path for path in sorted(WORKFLOW.glob("designs/*.yaml")) if load_yaml(path)["kind"] == "family"]


@pytest.mark.parametrize("path", FAMILIES, ids=lambda path: path.stem)
def test_every_family_is_valid_and_starts_from_the_published_design(path):
    members, cells = number_cells(expand(read_family(path), BASE), BASES)
    for group, base in zip(("te", "tm"), BASES, strict=True):
        first = cells[members[f"{group}_cell"].iloc[0]]
        assert first.model_copy(update={"name": base.name}) == base
    assert len(members) > (1 if path.stem == "wider_periods" else 1000)  # that one confirms a single design


def test_a_product_solves_every_cell_once(family):
    own = family(
        te={"gap_nm": [150, 190], "period_nm": {"low": 1500, "high": 1700, "count": 3}},
        tm={"gap_nm": {"times": {"low": 1.0, "high": 2.0, "count": 5}}},
        sail={"spin_Hz": [-80, -120]},
    )
    members, cells = number_cells(expand(own, BASE), BASES)
    assert len(members) == 1 + 2 * 3 * 5 * 2
    assert len(cells) == 2 * 3 + 5
    assert members["tm.gap_nm"].max() == 400.0
    assert sorted(members["te.period_nm"].unique()) == [1500.0, 1600.0, 1700.0]


def test_samples_keep_their_seed_and_normal_errors_their_size(family):
    spread = {"te": {"gap_nm": {"sigma": 5}}, "both": {"index_n": {"sigma": 0.01}}}
    sample = {"kind": "normal", "count": 4000, "scales": [1.0, 3.0]}
    drawn = [expand(family(**spread, sample={**sample, "seed": seed}), BASE) for seed in (1, 1, 2)]
    assert drawn[0].equals(drawn[1])
    assert not drawn[0].equals(drawn[2])
    assert (drawn[0]["te.index_n"] == drawn[0]["tm.index_n"]).all()
    for scale in (1.0, 3.0):
        gaps = drawn[0].loc[drawn[0]["scale"] == scale, "te.gap_nm"]
        assert gaps.std() == pytest.approx(5.0 * scale, rel=5 / np.sqrt(8000))
    sobol = expand(family(te={"gap_nm": {"low": 100, "high": 300}}, sample={"kind": "sobol", "count": 256}), BASE)
    counts = np.histogram(sobol["te.gap_nm"][1:], 16, (100, 300))[0]
    assert (counts == 16).all()


def test_cells_that_do_not_fit_their_period_are_impossible(family):
    members, cells = number_cells(expand(family(te={"wide_nm": [600, 1300]}), BASE), BASES)
    assert members["te_cell"].tolist() == [0, 0, -1]
    assert len(cells) == 2


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({}, "nothing varies: give te, tm, both or sail a parameter"),
        ({"te": {"gab_nm": [1]}}, r"te: unknown key 'gab_nm'; did you mean 'gap_nm'\?"),
        ({"te": {"gap_nm": {"low": 2, "high": 1, "count": 2}}}, "high = 1: must be greater than low = 2"),
        ({"te": {"gap_nm": {"low": 1, "high": 2}}}, "te.gap_nm: must have a count where sample.kind = product"),
        ({"te": {"gap_nm": {"sigma": 2}}}, "te.gap_nm: must be a list, .* where sample.kind = product"),
        ({"te": {"gap_nm": [1]}, "both": {"gap_nm": [1]}}, "both.gap_nm: varies in te or tm already"),
        ({"te": {"gap_nm": [1]}, "sample": {"kind": "sobol"}}, "count: must be given for kind sobol"),
        ({"name": "other", "te": {"gap_nm": [1]}}, "name = 'other': must be the file's own name, 'own'"),
    ],
)
def test_a_wrong_family_is_refused_in_one_line(family, entries, message):
    with pytest.raises(InputError, match=message) as refusal:
        family(**entries)
    assert "\n" not in str(refusal.value)


def _snakemake(folder, *arguments):
    command = [sys.executable, "-m", "snakemake", "--cores", "1", *arguments]
    here = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run(command, cwd=folder, env=here, capture_output=True, text=True, check=False)


def test_members_that_fail_cost_no_fdtd_and_no_flight(tmp_path):
    """A small family, really screened: what is left to do is the confirmation of its two best members alone."""
    for name in ("beamrider", "optics", "dynamics", "workflow"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "Snakefile", tmp_path)
    search = tmp_path / "workflow/designs/search.yaml"
    data = yaml.safe_load(search.read_text())
    for group in ("te", "tm"):
        data[group] = {key: values[::3] for key, values in data[group].items()}
    search.write_text(yaml.safe_dump(data))
    folder = tmp_path / "results/screening/search"
    result = _snakemake(tmp_path, "--config", "fdtd=true", "--", str(folder.relative_to(tmp_path) / "candidates"))
    assert result.returncode == 0, result.stderr
    screened = pd.read_parquet(folder / "screened.parquet")
    best = screened[screened["eligible"] & (screened.index > 0)].sort_values("rank").index[:2]
    for place, number in zip(("1", "2"), best, strict=True):
        cell = read_cell(folder / "candidates" / place / "te.yaml")
        lines = read_lines(folder / "cells.jsonl")
        assert cell.model_dump() == json.loads(lines[int(screened["te_cell"][number])]) | {"name": "te"}
        assert read_scene(folder / "candidates" / place / "sail.yaml").sail.designs == ["tm", "te"]
    alone = "results/screening/search/confirmed/1/floquet_fdtd.json"
    one = _snakemake(tmp_path, "--dry-run", "--config", "fdtd=true", "--", alone)
    assert one.returncode == 0, one.stdout + one.stderr
    dry = _snakemake(tmp_path, "--dry-run", "--config", "fdtd=true", "--", "screening")
    assert dry.returncode == 0, dry.stderr
    plan = read_plan(read_config([tmp_path / "workflow/config.yaml"], {"fdtd": True}), tmp_path)
    parts = max(map(plan.fdtd_parts, plan.scene("fig6").sail.designs))
    jobs = dict(re.findall(r"^(candidate_\w+|cells) +(\d+)$", dry.stdout + dry.stderr, re.M))
    assert jobs == {
        "candidate_modal_table": "4",
        "candidate_fdtd_nodes": "4",
        "candidate_fdtd_part": str(4 * parts),
        "candidate_fdtd_table": "4",
        "candidate_floquet": "2",
        "candidate_floquet_fdtd": "2",
        "candidate_rigid": "2",
        "candidate_flight": "2",
        "candidate_basin": "2",
        "candidate_basin_part": str(2 * plan.basin_parts("fig6")),
    }
