"""Numbers at the ends of what a scene may hold: a stage says in one line what is wrong with them, or it ends well."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from beamrider.io.files import run_stage
from dynamics.membrane import flight as membrane
from dynamics.rigid import stage as rigid
from dynamics.scene.schema import Scene
from dynamics.stability import floquet
from tests.hard.test_wording import changed, places
from tests.membranes import FILM, small
from tests.synthetic import smooth_tables

MATERIAL = {**FILM, "damping_s": 0.0}
SECTOR = {"material": MATERIAL, "thickness_m": 4e-7, "g": [1.0, 0.0]}
SCENE = small(
    rings=2,
    sail={
        "sectors": [
            {**SECTOR, "from_deg": 0.0, "design": "mark1e_te"},
            {**SECTOR, "from_deg": 180.0, "g": [-1.0, 0.0], "design": "mark1e_te"},
        ]
    },
    rigid={"duration_s": 1e-3, "most_steps": 1000},
    flight={"duration_s": 1e-8, "spin_up_s": 1e-8},
).model_dump()
EXTREMES = (1e300, 1e-300, -1e300, 0.0, 1e30, 1e-30, -1e30, 1e12, 1e9, -1e9, 1e-9, 1e-15, 1e6, 1e-6, 1000.0)


def accepted() -> Iterator[tuple[str, Any]]:
    """Scenes that differ from the small one in one number, by what differs, which the schema takes."""
    for path in places(SCENE):
        here = SCENE
        for part in path:
            here = here[part]
        if isinstance(here, bool) or not isinstance(here, int | float) or path[1:3] == ("sectors", 1):
            continue
        for value in EXTREMES:
            data = changed(SCENE, path, type(here)(value))
            try:
                Scene.model_validate(data)
            except ValidationError:
                continue
            if data["beam"]["radius_m"] < 0.01 * data["sail"]["radius_m"]:
                continue  # no quadrature of such a beam: its own refusal
            yield f"{'.'.join(map(str, path))} = {value:g}", data


CASES = dict(accepted())


def ends(stage: Any, data: dict[str, Any], folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Exit code of a stage on a scene; any other exception than its own goes through."""
    (folder / "fig6.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    arguments = ["--scene", str(folder / "fig6.yaml"), "--tables", str(folder / "te.h5"), "--out", str(folder / "out")]
    monkeypatch.setattr(sys, "argv", [stage.__name__, *arguments])
    try:
        run_stage(stage.main)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    return 0


@pytest.mark.parametrize(
    "stage",
    [
        pytest.param(rigid, id="rigid"),
        pytest.param(floquet, id="floquet"),
        pytest.param(membrane, id="membrane", marks=pytest.mark.slow),
    ],
)
def test_no_number_that_a_scene_may_hold_ends_in_a_traceback(stage, tmp_path, monkeypatch, capsys):
    smooth_tables()["mark1e_te"].write(tmp_path / "te.h5")
    broken = []
    for name, data in CASES.items():
        try:
            code = ends(stage, data, tmp_path, monkeypatch)
        except Exception as error:
            broken.append(f"{name}: {type(error).__name__}: {error}")
            continue
        told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
        if code not in (0, 2) or len(told) != (code == 2):
            broken.append(f"{name}: {code}, {told}")
    assert not broken, "\n".join(broken)
