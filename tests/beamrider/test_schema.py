"""Schemas say what the models say: of every shipped file, and of files with one thing changed."""

import copy
import json
import re
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from pydantic import ValidationError

from beamrider.io.files import load_yaml
from beamrider.io.json_schema import descriptions, unit_of
from beamrider.io.wording import models_of
from beamrider.schema import FILES, model_of, page, schema_of
from optics.cells.schema import KINDS
from tests.hard.test_wording import places

ROOT = Path(__file__).parents[2]
CELLS = {"index": {"table": [[1000.0, 2.1, 0.0], [1100.0, 2.0, 1e-6]]}}
#: Files that the shipped ones leave out: keys and kinds that none of them has.
MORE: dict[str, list[dict[str, Any]]] = {
    "cell": [
        {
            "kind": "metagrating",
            "name": "a",
            "wavelength_nm": 1064,
            "electric_axis": "g",
            "period_nm": 1500,
            "ridges_nm": [[0, 500]],
            "ridge_height_nm": 400,
            "membrane_nm": 2000,
            "membrane_coherent": False,
            **CELLS,
        },
        {
            "kind": "lamellar",
            "name": "b",
            "wavelength_nm": 1064,
            "electric_axis": "r",
            "period_nm": 1500,
            "layers": [
                {
                    "thickness_nm": 100,
                    "index": {"n": 1.5},
                    "ridges": [{"start_nm": 0, "width_nm": 10, "index": {"n": 2}}],
                },
                {"thickness_nm": 900, "index": {"n": 1.5}, "coherent": False},
            ],
            "surroundings": {"front": 1, "back": 1.5, "back_k": 0.1},
        },
        {
            "kind": "profile",
            "name": "c",
            "wavelength_nm": 1064,
            "electric_axis": "r",
            "period_nm": 1500,
            "depth_nm": 400,
            "polygons": [{"vertices_nm": [[0, 0], [500, 0], [500, 400]], **CELLS}],
        },
    ],
    "scene": [
        {
            "name": "all",
            "description": "",
            "sail": {
                "profile": "sphere",
                "depth": -0.5,
                "radius_m": 1,
                "rings": 4,
                "outline": "square",
                "sectors": [
                    {
                        "from_deg": 0,
                        "reflectance": 0.5,
                        "g": "radial",
                        "material": {
                            "thickness_m": 1e-7,
                            "density_kg_m3": 2700,
                            "young_Pa": 270e9,
                            "poisson": 0.27,
                            "strength_Pa": 6.4e9,
                            "conductivity_W_mK": 3,
                            "heat_capacity_J_kgK": 800,
                            "expansion_1_K": 2.3e-6,
                            "emissivity_front": 0.1,
                            "emissivity_back": 0.1,
                            "absorptance": 1e-5,
                            "failure_temperature_K": 1600,
                            "with_temperature": {"absorptance": [[300, 1e-5], [900, 1e-4]]},
                        },
                    },
                    {"from_deg": 180, "design": "d", "material": "nitride_te", "membrane_m": 2e-7},
                ],
                "rim": {"from_m": 0.9, "sectors": [{"from_deg": 0, "design": "d", "material": "nitride_te"}]},
                "grid": {"x_m": [0], "y_m": [], "regions": [[None, {"design": "d", "material": "nitride_tm"}]]},
            },
            "beam": {"intensity_W_m2": 1e9, "radius_m": 0.4, "polarisation": "turning", "polarisation_Hz": 1},
            "effects": {"light": True},
            "flight": {"on_failure": "remove", "broken_fraction": 0.5},
        },
    ],
    "grid": [{}, {"offsets_m": [0, 0.2], "n_offsets": 5, "tilts_deg": [-1, 1], "limit_m": 1}],
}
OTHERS: list[Any] = [
    None,
    True,
    "text",
    -1,
    0,
    1,
    1.5,
    1e40,
    -1e40,
    10**13,
    1e-40,
    1e4,
    [],
    [1],
    [1, 2, 3],
    {},
    {"n": 1},
    "auto",
]


def _shipped() -> dict[str, list[Any]]:
    designs = [load_yaml(path) for path in sorted((ROOT / "workflow/designs").glob("*.yaml"))]
    return {
        "scene": [load_yaml(path) for path in sorted((ROOT / "workflow/scenes").glob("*.yaml"))],
        "cell": [data for data in designs if data["kind"] != "family"],
        "family": [data for data in designs if data["kind"] == "family"],
        "config": [load_yaml(ROOT / "workflow/config.yaml")],
    }


SHIPPED = _shipped()


def _by_model(name: str, data: Any) -> list[str]:
    """Kinds of errors that the model finds; none where it takes the data."""
    model = model_of(name) if name != "cell" else KINDS.get(str(data.get("kind")))
    if model is None:
        return ["kind"]
    try:
        model.model_validate(data, context={"wavelength_nm": data.get("wavelength_nm")})
    except ValidationError as error:
        return [fault["type"] for fault in error.errors()]
    return []


@pytest.fixture(scope="module")
def schemas() -> dict[str, Draft202012Validator]:
    """The validators of all schemas."""
    return {name: Draft202012Validator(schema_of(name)) for name in FILES}


@pytest.mark.parametrize("name", FILES)
def test_schemas_are_schemas_and_take_what_is_shipped(schemas, name):
    Draft202012Validator.check_schema(schemas[name].schema)
    files = [*SHIPPED.get(name, []), *MORE.get(name, [])]
    assert files
    for data in files:
        assert _by_model(name, data) == []
        assert [error.message for error in schemas[name].iter_errors(data)] == []


def _changed(data: Any) -> list[Any]:
    """The data with one thing changed: each place with other values, gone, or with a key beside it."""
    found = []
    for path in places(data):
        for value in [*OTHERS, "gone", "added"]:
            new = copy.deepcopy(data)
            at = new
            for part in path[:-1]:
                at = at[part]
            if value == "gone":
                del at[path[-1]]
            elif value == "added" and isinstance(at, dict):
                at["another"] = 1
            else:
                at[path[-1]] = value
            found.append(new)
    return found


@pytest.mark.parametrize("name", FILES)
def test_schema_and_model_agree_on_what_is_changed(schemas, name):
    """A schema never refuses what its model takes; it takes what the model refuses for rules between keys alone."""
    counts = {"taken": 0, "refused": 0}
    for data in [*SHIPPED.get(name, [])[:2], *MORE.get(name, [])]:
        for changed in _changed(data):
            errors, by_schema = _by_model(name, changed), schemas[name].is_valid(changed)
            if not errors:
                assert by_schema, changed
            elif by_schema:  # 4.0 is a whole number in JSON
                assert "value_error" in errors or set(errors) <= {"int_type", "int_from_float"}, (errors, changed)
            counts["refused" if errors else "taken"] += 1
    assert min(counts.values()) > 20


@pytest.mark.parametrize("name", FILES)
def test_every_key_says_what_it_means_and_is_measured_in(name):
    """Write the text below the key; a number's key ends in its unit, or its type gives it, as DIMENSIONLESS does."""
    schema = schema_of(name)
    parts = {schema["title"]: schema, **schema.get("$defs", {})}
    for part in parts.values():
        for key, rule in part.get("properties", {}).items():
            assert rule.get("description"), f"{part['title']}.{key}: no description"
            if {'"number"', '"integer"'} & set(json.dumps(rule).replace(",", " ").replace("}", " ").split()):
                assert rule.get("unit"), f"{part['title']}.{key}: no unit"
    assert all(model.__doc__ for model in models_of(model_of(name)))


def test_units_and_descriptions_come_from_the_source():
    assert [unit_of(key) for key in ("period_nm", "intensity_W_m2", "expansion_1_K", "m", "rings", "back_k")] == [
        "nm",
        "W/m²",
        "1/K",
        None,
        None,
        None,
    ]
    texts = descriptions(KINDS["metagrating"])
    assert texts["period_nm"] == "Period along g."  # of the class that it inherits from
    assert texts["membrane_nm"] == "Thickness of the membrane below them."


def test_the_reference_page_is_that_of_the_schema():
    """Renew it with `beamrider schema reference --out docs/reference.md`."""
    assert (ROOT / "docs/reference.md").read_text(encoding="utf-8") == page(), (
        "docs/reference.md is not that of the schema: beamrider schema reference --out docs/reference.md"
    )


def test_links_of_the_reference_page_lead_somewhere():
    text = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    heads = {re.sub(r"[^a-z0-9 ]", "", head.lower()).replace(" ", "-") for head in re.findall("^#+ (.+)$", text, re.M)}
    links = set(re.findall(r"\]\(#([^)]+)\)", text))
    assert len(links) > 20
    assert links <= heads
