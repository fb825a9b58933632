"""Every published flight is there, is flown as published, and its figure and its line in the table are drawn."""

import contextlib
import csv
import importlib
import io
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from beamrider.io.files import InputError, run_stage
from dynamics.membrane import flight as membrane
from dynamics.membrane import stage, summary
from dynamics.membrane.build import build
from dynamics.scene.schema import Scene, read_scene
from tests.membranes import altered
from tests.synthetic import smooth_tables
from workflow.figures.flight_result import _widening
from workflow.published import as_flown, read_published

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "workflow" / "scenes"
PUBLISHED = read_published(ROOT / "workflow" / "published.yaml")


def _script(name, *arguments):
    """Run a script of workflow/figures in this process; what it prints to standard error."""
    module, error = importlib.import_module(f"workflow.figures.{name}"), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(error):
        patch.setattr(sys, "argv", [name, *map(str, arguments)])
        patch.chdir(ROOT)
        run_stage(module.main)
    return error.getvalue()


def test_the_list_of_published_flights_is_complete():
    assert set(PUBLISHED) == {path.stem for path in SCENES.glob("*.yaml")}


@pytest.mark.parametrize("name", [name for name in PUBLISHED if name.startswith(("fig6", "s", "spin"))])
def test_every_metagrating_flight_comes_with_right_and_with_published_physics(name):
    twin = name.removesuffix("_published") if name.endswith("_published") else f"{name}_published"
    assert PUBLISHED[twin].figure == PUBLISHED[name].figure


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_flight_as_flown_is_a_valid_scene_that_keeps_all_but_mesh_and_duration(name):
    scene = read_scene(SCENES / f"{name}.yaml")
    flown = as_flown(scene, PUBLISHED[name])
    assert Scene.model_validate(flown.model_dump()) == flown
    assert flown.model_dump(exclude={"sail": {"rings"}, "flight": True}) == scene.model_dump(
        exclude={"sail": {"rings"}, "flight": True}
    )
    kept = {"duration_s", "snapshot_every_s", "time_step_s"}
    assert flown.flight.model_dump(exclude=kept) == scene.flight.model_dump(exclude=kept)


def test_a_published_time_step_stays_the_same_share_of_the_bound_on_a_coarser_mesh():
    """0.87 of 2/ω_max on the published mesh; the share changes by 1 % as the highest mode sits at the rim."""
    scene = read_scene(SCENES / "s3_published.yaml")
    coarse = as_flown(scene, PUBLISHED["s3_published"].model_copy(update={"rings": 10}))
    free = altered(coarse, flight={"time_step_s": None})
    bound = build(free, smooth_tables()).model.dt / 0.8
    assert coarse.flight.time_step_s / bound == pytest.approx(9.97792623e-7 / 1.1424e-6, rel=0.02)


def test_a_wrong_list_ends_with_one_line(tmp_path):
    path = tmp_path / "published.yaml"
    path.write_text("- {scene: fig6, figure: Fig. 6, ring: 12}\n")
    with pytest.raises(InputError, match=r"published.yaml: flights\[0\]: unknown key 'ring'; did you mean 'rings'"):
        read_published(path)


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Flight files of fig6 for a millisecond, and of a copy that is blown off its beam."""
    folder = tmp_path_factory.mktemp("published")
    short = {"duration_s": 1e-3, "snapshot_every_s": 2e-4, "spin_up_s": 2e-3}
    fig6 = altered(read_scene(SCENES / "fig6.yaml"), sail={"rings": 2}, flight=short)
    paths = {}
    for name, scene in {"rides": fig6, "lost": altered(fig6, flight={"fly_away_m": 0.0707})}.items():
        flight = membrane.Flight(scene, smooth_tables(), folder / f"{name}.partial")
        end = flight.fly()
        paths[name] = folder / f"{name}.vtkhdf"
        columns, attributes = flight.columns(), summary.attributes(flight, end, smooth_tables())
        stage.write_flight(paths[name], flight.membrane.mesh, flight.frames(), columns, attributes)
    return paths


@pytest.mark.parametrize(
    ("distance", "start"),
    [
        (lambda t: 0.115 - 0.065 * np.cos(2 * np.pi * t / 8.0), None),  # a bounded beat
        (lambda t: 1e-15 * np.exp(t), None),  # rounding on the axis
        (lambda t: 0.05 * np.exp(0.8 * t), 1.25 + np.log(2.0) / 0.8),
    ],
)
def test_only_swings_that_grow_are_called_growing(distance, start):
    t = np.linspace(0.0, 5.0, 2001)
    found = _widening(distance(t), 0.4)
    assert found is None if start is None else t[found] == pytest.approx(start, abs=5e-3)


def test_figure_of_a_published_flight(flights, tmp_path):
    png, svg = tmp_path / "figure.png", tmp_path / "figure.svg"
    given = [f"modal={flights['rides']}", f"published={flights['lost']}"]
    assert _script("published_flight", "--name", "fig6", "--flights", *given, "--out", png, "--svg", svg) == ""
    assert np.ptp(imread(png)[..., :3], axis=(0, 1)).min() > 0.5
    text = svg.read_text(encoding="utf-8")
    assert "rides the beam for 0.001 s" in text
    assert "leaves the beam at " in text


def test_table_of_published_flights(flights, tmp_path):
    table, page, text = (tmp_path / f"flights.{kind}" for kind in ("csv", "html", "md"))
    given = [f"fig6:modal={flights['rides']}", f"fig6:published={flights['lost']}"]
    assert _script("published_table", "--flights", *given, "--out", table, "--html", page, "--markdown", text) == ""
    with open(table, encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    found = {(row["tables"], row["quantity"]): row["agrees"] for row in rows}
    assert found["modal", "outcome"] == "yes"
    assert found["published", "outcome"] == "no"
    assert found["modal", "peak temperature"] == "no"  # after a millisecond
    assert found["modal", "largest tilt"] == "yes"
    assert found["published", "largest tilt"] == "no"  # it is not the largest of a flight that was lost
    assert all(row["paper"] for row in rows if row["agrees"])
    assert "| Fig. 6 | fig6 | modal | 2 | " in text.read_text(encoding="utf-8")
    assert "<td>peak temperature</td>" in page.read_text(encoding="utf-8")
