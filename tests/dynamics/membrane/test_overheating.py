"""What heats a sail, and when it fails of heat: the absorptance of tables, and the temperature of the nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.membrane.build import build
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.output.record import COLUMNS
from dynamics.membrane.plan import plan
from dynamics.scene.schema import Scene
from tests.membranes import FIG6, FILM, altered, film, small
from tests.mirrors import lit
from tests.synthetic import smooth_table, smooth_tables

TE, TM = 3e-5, 1e-5
LIBRARY = FIG6.sail.sectors[0].properties.absorptance


def absorbing() -> dict[str, Any]:
    """Tables whose absorptances are others than those of the materials."""
    te = smooth_table("mark1e_te", (0.152, 1.33, -1.0, 0.0), (0.714, -2.7, 4.0, 0.0), absorptance=TE)
    tm = smooth_table("mark1e_tm", (0.142, 0.67, -1.0, 0.0), (0.233, -0.23, 2.0, 0.0), absorptance=TM)
    return {"mark1e_te": te, "mark1e_tm": tm}


def heated(scene: Scene, tables: dict[str, Any] | None = None) -> dict[str, np.ndarray]:
    return fly(scene, absorbing() if tables is None else tables)[2]


def share(series: dict[str, np.ndarray]) -> float:
    """Absorbed share of the light at the end of a flight."""
    return float(series["power_absorbed"][-1] / series["power_incident"][-1])


def centred(**groups: Any) -> Scene:
    """The sail of fig6 of six rings in the middle of its beam, for two hundredths of a millisecond."""
    flight = {"duration_s": 2e-5, "series_every": 1, "optics_every": 1, **groups.pop("flight", {})}
    release = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0}
    return small(rings=6, release=release, flight=flight, **groups)


def test_a_sail_takes_up_what_its_tables_say_unless_it_is_told_otherwise():
    # A third of the sail, and of a centred beam, is TE; spin makes it an ellipse, a little
    assert share(heated(centred())) == pytest.approx(TE / 3 + 2 * TM / 3, rel=1e-4)
    of_materials = 9.448e-6 / 3 + 2 * 9.763e-6 / 3
    assert share(heated(centred(absorptance="material"))) == pytest.approx(of_materials, rel=1e-4)


def test_regions_without_a_design_take_up_what_their_material_does(tmp_path):
    _, row = lit(tmp_path, sail={"sectors": film(reflectance=0.6, absorptance=0.1)})
    share = row[COLUMNS["power_absorbed"]] / row[COLUMNS["power_incident"]]
    assert share == pytest.approx(0.1, rel=1e-12)
    clear = small(sail={"sectors": film(absorptance=0.0)})
    assert not plan(clear)["absorption"].on
    assert plan(small())["absorption"].on


def test_a_material_that_changes_with_temperature_changes_what_its_table_says_by_the_same_factor():
    material = {**FILM, "absorptance": 2e-6, "with_temperature": {"absorptance": [[300, 2e-6], [500, 8e-6]]}}
    sectors = [{**s.model_dump(), "material": material} for s in FIG6.sail.sectors]
    for kelvin, factor in ((300.0, 1.0), (400.0, 2.5), (600.0, 4.0)):
        scene = centred(sail={"sectors": sectors}, flight={"start_temperature_K": kelvin})
        # Spin and light change the temperature by a few kelvins meanwhile
        assert share(heated(scene)) == pytest.approx(factor * (TE / 3 + 2 * TM / 3), rel=2e-2)
    own = centred(sail={"sectors": sectors}, absorptance="material", flight={"start_temperature_K": 400.0})
    assert share(heated(own)) == pytest.approx(5e-6, rel=2e-2)


def test_factors_that_cannot_be_are_refused():
    def scene(plain: float, hot: float) -> Scene:
        material = {**FILM, "absorptance": plain, "with_temperature": {"absorptance": [[300, plain], [900, hot]]}}
        return small(sail={"sectors": [{**s.model_dump(), "material": material} for s in FIG6.sail.sectors]})

    with pytest.raises(InputError, match=r"fig6\.yaml: sail: region 0: material\.absorptance = 0: must be above 0"):
        build(scene(0.0, 1e-3), absorbing())
    with pytest.raises(InputError, match=r"sail: region 1: .*times the table's own it comes to 2.4: must not exceed 1"):
        build(scene(1e-6, 0.08), absorbing())


def runaway(**flight: Any) -> Scene:
    """A film that takes up the more the hotter it is, until it fails at 1200 K."""
    table = [[300, 1e-6], [500, 1e-5], [700, 1e-4], [900, 1e-3], [1100, 1e-2]]
    hot = film(
        thickness_m=43e-9,
        failure_temperature_K=1200.0,
        absorptance=1e-6,
        with_temperature={"absorptance": table},
    )
    flight = {"duration_s": 0.05, "series_every": 64, "start_temperature_K": 500.0, **flight}
    return small(rings=5, sail={"sectors": hot}, release={"offset_m": [0.0, 0.0], "spin_Hz": 120.0}, flight=flight)


@pytest.mark.parametrize("integrator", ["verlet", "rk4"])
def test_a_sail_that_fails_of_heat_was_as_hot_as_it_fails_in_its_record(tmp_path, integrator):
    flight = Flight(runaway(integrator=integrator), {}, tmp_path)
    end = flight.fly()
    series = {name: values for name, (values, _) in flight.columns().items()}
    assert end.reason == "thermal_failure"
    assert series["time"][-1] == pytest.approx(end.time, abs=1e-12)
    assert series["temperature_max"][-1] > 1200.0
    assert (series["temperature_max"][:-1] <= 1200.0).all()
    # Of the nodes, of which the frames keep each
    last = list(flight.frames())[-1]
    assert series["temperature_max"][-1] == last.temperature.max()
    assert series["temperature_min"][-1] == last.temperature.min()
    corners = last.temperature[flight.membrane.mesh.triangles]
    assert series["temperature_max_triangles"][-1] == pytest.approx(corners.mean(axis=1).max(), rel=1e-14)
    found = int(flight.work.flags[1])
    assert corners[found].max() > 1200.0
    assert f"triangle {found}" in end.detail


def test_a_flight_that_ends_short_of_failure_was_never_as_hot_as_that():
    _, end, series = fly(runaway(duration_s=1e-3), {})
    assert end.reason == "finished"
    assert series["temperature_max"].max() < 1200.0


def test_failed_triangles_are_those_with_a_node_past_their_limit(tmp_path):
    flight = Flight(runaway(on_failure="record", broken_fraction=0.0, series_every=8), {}, tmp_path)
    assert flight.fly().reason == "broken"
    last = list(flight.frames())[-1]
    hot = (last.temperature[flight.membrane.mesh.triangles] > 1200.0).any(axis=1)
    assert last.failed is not None
    assert np.array_equal(last.failed > 0, hot)


def test_each_material_fails_at_its_own_temperature():
    weak = {**film(failure_temperature_K=600.0)[0], "from_deg": 0.0}
    strong = {**film(failure_temperature_K=1e5)[0], "from_deg": 180.0}
    scene = altered(
        runaway(),
        sail={"sectors": [weak, strong], "rings": 5, "rotation_deg": 0.0},
        flight={"on_failure": "record"},
    )
    model = build(scene, {}).model
    assert set(model.effects.heat.limit[build(scene, {}).mesh.sector == 0]) == {600.0}
    assert set(model.effects.heat.limit[build(scene, {}).mesh.sector == 1]) == {1e5}
    assert model.effects.heat.lowest == 600.0


def test_smooth_tables_absorb_what_their_materials_do():
    assert [float(t.absorptance(0.0, 0.0)) for t in smooth_tables().values()] == pytest.approx([9.448e-6, LIBRARY])
