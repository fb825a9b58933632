"""The list of effects: a new one is a file and a line, and flies; names, columns and the scene's keys fit the list."""

import json
import os
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from beamrider.machine_code import cache
from dynamics.membrane import effects
from dynamics.membrane.effects import composition
from dynamics.membrane.output.record import COLUMNS, SIZES, WIDTH
from dynamics.membrane.plan import plan
from dynamics.scene.schema import Effects
from tests import drag
from tests.membranes import small

#: The line in the list, then a flight at 1 m/s through what brakes it, with free steps where it is calm.
FLY = """
import json, sys, tempfile
from pathlib import Path
from dynamics.membrane import effects
from tests import drag
effects.EFFECTS = (*effects.EFFECTS, drag)
from dynamics.membrane.flight import Flight
from dynamics.membrane.output.record import SIZES
from dynamics.membrane.plan import plan
from tests.membranes import column, dark, steps
found = {"columns": list(SIZES)}
for name in ("draught", "calm"):
    scene = dark(3, name=name, flight={"series_every": 1})
    flight = Flight(scene, {}, Path(tempfile.mkdtemp()))
    flight.step = flight.model.release
    flight.state.v[0] = 1.0
    rows = steps(flight, 200)
    found[name] = {
        "plan": plan(scene)["drag"].model_dump(), "dt": flight.model.dt, "mass": float(flight.model.masses.sum()),
        "sizes": [flight.model.effects.drag.rate.size, flight.work.effects.drag.power.size],
        "state": [value.tolist() for value in flight.state],
        **{key: column(rows, key).tolist() for key in ("time", "velocity", "drag_force", "drag_power")},
    }
json.dump(found, open(sys.argv[1], "w"))
"""


@pytest.fixture(scope="module")
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What FLY found, in a process of its own, as the list is read on import.

    Its machine code is kept apart from ours, of which it begins with a copy, and from one run of the tests to the next.
    """
    folder, today = tmp_path_factory.mktemp("drag"), Path(os.environ[cache.VARIABLE])
    kept = request.config.cache
    own = kept.mkdir(f"drag-{sha256(Path(drag.__file__).read_bytes()).hexdigest()[:8]}") if kept else folder
    if today.is_dir() and not (own / today.name).exists():
        shutil.copytree(today, own / today.name)
    given = {**os.environ, cache.VARIABLE: str(own), "PYTHONPATH": str(cache.ROOT)}
    command = [sys.executable, "-c", FLY, str(folder / "found.json")]
    done = subprocess.run(command, cwd=cache.ROOT, env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads((folder / "found.json").read_text())


@pytest.mark.slow  # it compiles the whole step with one more effect: minutes
def test_a_new_effect_brakes_the_sail_as_its_closed_form_says(flown: dict):
    """Velocity Verlet with the drag of half a step ago: v falls by (1 − γΔt) a step but for the first half one."""
    found = flown["draught"]
    v, time = np.array(found["velocity"])[:, 0], np.array(found["time"])
    assert found["plan"] == {
        "on": True,
        "reason": "air around the sail",
        "cost": "a pass over all nodes in each step; steps are taken one at a time",
    }
    assert v[-1] < 0.99
    assert np.allclose(v, np.exp(-200.0 * (time - time[0])), rtol=200.0 * found["dt"], atol=0)
    assert np.allclose(np.array(found["drag_force"])[:, 0], -200.0 * found["mass"] * v, rtol=1e-12)
    assert np.allclose(found["drag_power"][1:], 200.0 * found["mass"] * v[1:] ** 2, rtol=400.0 * found["dt"])
    assert flown["columns"][-2:] == ["drag_force", "drag_power"]


@pytest.mark.slow
def test_where_it_is_off_it_has_no_arrays_and_does_nothing(flown: dict):
    found = flown["calm"]
    assert found["plan"] == {"on": False, "reason": "air around the sail", "cost": "nothing"}
    assert found["sizes"] == [0, 0]
    assert np.ptp(np.array(found["velocity"])[:, 0]) < 1e-12
    assert not np.any(found["drag_force"])


def test_every_effect_of_the_plan_has_a_key_in_the_scene_and_the_other_way_round():
    assert set(plan(small())) == set(Effects.model_fields)


def test_what_is_on_says_its_cost_and_what_is_off_costs_nothing():
    for decision in plan(small()).values():
        assert (decision.cost == "nothing") == (not decision.on)
        assert decision.reason


def test_columns_lie_one_after_the_other_and_fill_a_row():
    ends = [COLUMNS[name] + length for name, (length, _) in SIZES.items()]
    assert [0, *ends] == [*COLUMNS.values(), WIDTH]


def test_a_column_has_one_effect(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(composition, "EFFECTS", (*effects.EFFECTS, effects.EFFECTS[0]))
    with pytest.raises(ValueError, match="is another's"):
        composition.columns_from({})


def test_every_effect_is_complete():
    for effect in effects.EFFECTS:
        assert effect.NAME
        assert effect.COST
        assert callable(effect.build)
        assert hasattr(effect, "COLUMNS") == hasattr(effect, "write")
