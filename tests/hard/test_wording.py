"""Whatever a file gives: one line in the file's own words, never a traceback or the words of a validation library."""

from __future__ import annotations

import copy
import datetime
import functools
import operator
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from beamrider.io.files import InputError, Strict, load_yaml, read_model, validate
from beamrider.io.wording import brief
from dynamics.rigid.basin import Grid
from dynamics.scene.materials import MATERIALS
from dynamics.scene.schema import Scene
from optics.cells.schema import KINDS, read_cell
from workflow.configuration import Config
from workflow.family import Family

WORKFLOW = Path(__file__).parents[2] / "workflow"
FILM = {"n": 2.0, "k": 1e-6}
MATERIAL = {**MATERIALS["nitride_te"].model_dump(), "with_temperature": {"absorptance": [[300.0, 9.448e-6]]}}
SECTOR = {"from_deg": 0.0, "material": MATERIAL, "reflectance": 0.5, "thickness_m": 4e-7, "g": [1.0, 0.0]}
NAMED = {**SECTOR, "material": "nitride_te", "g": "radial"}

SCENE = {
    **Scene.model_validate(load_yaml(WORKFLOW / "scenes/fig6.yaml")).model_dump(),
    "sail": {
        "outline": "round",
        "profile": "flat",
        "surface": "smooth",
        "rescale": False,
        "radius_m": 0.5,
        "rings": 3,
        "rotation_deg": 0.0,
        "sectors": [SECTOR],
        "rim": {"from_m": 0.4, "sectors": [SECTOR, {**NAMED, "from_deg": 9}]},
        "grid": {"x_m": [0.0], "y_m": [], "regions": [[None, {k: v for k, v in NAMED.items() if k != "from_deg"}]]},
    },
}
SHARED = {"name": "c", "wavelength_nm": 1064.0, "surroundings": {"front": 1.0, "back": 1.0, "back_k": 0.0}}
GRATING = {**SHARED, "electric_axis": "r", "period_nm": 1000.0}
WHOLE: dict[str, tuple[type[Strict], dict[str, Any]]] = {
    "scene": (Scene, SCENE),
    "metagrating": (
        KINDS["metagrating"],
        {
            **GRATING,
            "kind": "metagrating",
            "ridges_nm": [[0.0, 300.0]],
            "ridge_height_nm": 300.0,
            "membrane_nm": 200.0,
            "index": FILM,
            "corner_radius_nm": 10.0,
        },
    ),
    "thin_film": (
        KINDS["thin_film"],
        {
            **SHARED,
            "kind": "thin_film",
            "polarisation": "mean",
            "layers": [{"thickness_nm": 100.0, "index": FILM}],
        },
    ),
    "lamellar": (
        KINDS["lamellar"],
        {
            **GRATING,
            "kind": "lamellar",
            "layers": [
                {"thickness_nm": 100.0, "index": FILM, "ridges": [{"start_nm": 0.0, "width_nm": 100.0, "index": FILM}]},
            ],
        },
    ),
    "profile": (
        KINDS["profile"],
        {
            **GRATING,
            "kind": "profile",
            "depth_nm": 500.0,
            "polygons": [
                {"index": FILM, "vertices_nm": [[0.0, 0.0], [100.0, 500.0], [0.0, 500.0]]},
            ],
        },
    ),
    "basin grid": (Grid, Grid(limit_m=1.0).model_dump()),
    "config": (Config, load_yaml(WORKFLOW / "config.yaml")),
    "family": (
        Family,
        {
            "kind": "family",
            "name": "f",
            "description": "",
            "scene": "fig6",
            "te": {"gap_nm": [1.0, 2.0]},
            "tm": {"gap_nm": {"low": 1.0, "high": 2.0, "count": 3}},
            "both": {"index_n": {"times": {"low": 1, "high": 2, "count": 2}}},
            "sail": {"spin_Hz": [1.0]},
            "sample": {"kind": "product"},
            "best": {"count": 1},
        },
    ),
}
WRONG: dict[str, Any] = {
    "text": "a b",
    "long text": "x" * 10_000,
    "list": [1, 2],
    "list of text": ["a", None],
    "empty list": [],
    "mapping": {"a": 1},
    "empty mapping": {},
    "null": None,
    "true": True,
    "negative": -1.5,
    "huge": 1e300,
    "very long": 10**5000,
    "nan": float("nan"),
    "inf": float("inf"),
    "date": datetime.date(2026, 1, 1),
    "nested": [[[[{"a": [[[[[1]]]]]}]]]],
}
LIBRARY = re.compile(
    r"Input should|valid (string|number|integer|boolean|list|dict|tuple)|type=|_type|literal|instance of|discriminator|"
    r"\bunion|tagged|[Vv]alue error|validation error|pydantic|function-|constrained|Field required|None|True|False|"
    r"\bstr\b|\bint\b|\bfloat\b|\bdict|\bbool|something else|String should|List should|\bmodel\b|Extra inputs|datetime"
)


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every key and entry of nested mappings and lists."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield (*path, key)
        yield from places(value, (*path, key))


def beside(data: Any, path: tuple[Any, ...]) -> list[str]:
    """Keys that a rule about several keys may name in place of the one at a path: those beside its last one."""
    last = max(i for i, part in enumerate(path) if isinstance(part, str))
    return list(functools.reduce(operator.getitem, path[:last], data))


def changed(data: Any, path: tuple[Any, ...], value: Any) -> Any:
    """A copy of nested mappings and lists with one value replaced."""
    out = copy.deepcopy(data)
    here = out
    for part in path[:-1]:
        here = here[part]
    here[path[-1]] = value
    return out


def line(model: type[Strict], data: Any) -> str:
    """What is said of wrong data; empty if nothing is wrong."""
    try:
        validate(data, model, "a.yaml")
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("what", WHOLE)
def test_the_whole_is_right(what):
    assert line(*WHOLE[what]) == ""


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("what", WHOLE)
def test_a_wrong_kind_of_value_is_named_with_its_key_in_one_line(what, wrong):
    model, data = WHOLE[what]
    found = 0
    for path in places(data):
        said = line(model, changed(data, path, WRONG[wrong]))
        if not said:
            continue
        found += 1
        key = next(part for part in reversed(path) if isinstance(part, str))
        assert said.startswith("a.yaml: "), said
        assert re.search("|".join(map(re.escape, [key, *beside(data, path)])), said), (path, said)
        assert "\n" not in said
        assert not LIBRARY.search(said), (path, said)
        assert len(said) < 600, (path, said)
    assert found > 0


@pytest.mark.parametrize("what", WHOLE)
def test_every_key_left_out_or_misspelt_is_named(what):
    model, data = WHOLE[what]
    for path in places(data):
        if not isinstance(path[-1], str):
            continue
        parent = functools.reduce(operator.getitem, path[:-1], data)
        without = {key: value for key, value in parent.items() if key != path[-1]}
        whole = changed(data, path[:-1], without) if path[:-1] else without
        said = line(model, whole)
        assert not said or re.search("|".join(["missing", path[-1], *beside(data, path)]), said), (path, said)
        assert not LIBRARY.search(said), (path, said)
        misspelt = {**without, f"{path[-1]}x": parent[path[-1]]}
        said = line(model, changed(data, path[:-1], misspelt) if path[:-1] else misspelt)
        of_kind = path == ("beam", "profile", "kind")
        names = "must be a mapping that names its kind" if of_kind else f"unknown key '{path[-1]}x'"
        assert names in said.replace('"', "'"), (path, said)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (
            ("sail", "sectors", 0, "material"),
            {"thickness_m": 563e-9, "poisson": 0.2},
            r"sail.sectors\[0\].material: missing density_kg_m3, young_Pa, strength_Pa, conductivity_W_mK, "
            "heat_capacity_J_kgK, expansion_1_K, emissivity_front, emissivity_back, absorptance, failure_temperature_K",
        ),
        (
            ("sail", "sectors", 0, "material"),
            5,
            r"sail.sectors\[0\].material = 5: must be text: put it in quotes "
            "or a mapping of thickness_m, density_kg_m3, .*",
        ),
        (
            ("sail", "sectors", 0, "material"),
            "gold",
            r"sail.sectors\[0\].material = 'gold': must be one of nitride_te, "
            "nitride_tm, silicon_43nm, or given in full",
        ),
        (
            ("sail", "sectors", 0, "material", "young_Pa"),
            "stiff",
            r'sail.sectors\[0\].material.young_Pa = "stiff": must be a number',
        ),
        (
            ("sail", "sectors", 0, "g"),
            "up",
            r"sail.sectors\[0\].g = \"up\": must be 'radial', '-radial', 'tangential' or '-tangential'",
        ),
        (("sail", "sectors", 0, "g"), [1, "a"], r"sail.sectors\[0\].g\[1\] = \"a\": must be a number"),
        (("sail", "sectors", 0, "g"), [1], r"sail.sectors\[0\].g = \[1\]: must be a list of at least 2 entries"),
        (
            ("sail", "sectors", 0, "g"),
            7,
            r"sail.sectors\[0\].g = 7: must be a list or 'radial', '-radial', 'tangential' or '-tangential'",
        ),
        (
            ("sail", "sectors", 0, "material", "with_temperature"),
            {"density_kg_m3": [[300, 1]]},
            r"sail.sectors\[0\].material.with_temperature: unknown key .?density_kg_m3.? "
            r"\(allowed: conductivity_W_mK, .*\)",
        ),
        (("beam",), None, "beam = null: must be a mapping of intensity_W_m2, radius_m, radius_y_m, .*"),
        (("sail", "rings"), 3.5, "sail.rings = 3.5: must be a whole number"),
        (("sail", "rings"), 10**4000, r"sail.rings = 100000… \(4001 digits\): must be less than or equal to 1000"),
        (("effects", "light"), "on", 'effects.light = "on": must be true or false'),
        (("name",), 42, "name = 42: must be text: put it in quotes"),
        (
            ("name",),
            "a/b",
            "name = \"a/b\": must be made of letters, digits, '_', '.' and '-' only, a letter, digit or '_' first",
        ),
        (("sail", "radius_m"), float("nan"), "sail.radius_m = .nan: must be a finite number"),
        (("description",), "x", ""),
    ],
)
def test_what_is_said_of_a_scene(path, value, said):
    assert re.fullmatch(said, line(Scene, changed(SCENE, path, value)).removeprefix("a.yaml: "))


def test_all_missing_keys_are_named_at_once():
    assert line(Scene, {}) == "a.yaml: missing name, description, sail, beam"
    assert line(Scene, {**SCENE, "beam": {}}) == "a.yaml: beam: missing intensity_W_m2, radius_m"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("x" * 100, f'"{"x" * 58}…'),
        ([1, [2, [3, [4, [5]]]]], "[1, [2, [3, [4, […]]]]]"),
        (list(range(100)), "[0, 1, 2, 3, 4, 5, 6, 7, …]"),
        ({"a": None, "b": True}, '{"a": null, "b": true}'),
        pytest.param(-(10**5000), "-100000… (5001 digits)", id="-1e5000"),
        pytest.param(10**5000 - 1, "999999… (5000 digits)", id="1e5000"),
        ("a\nb\x1b", '"a\\nb\\u001b"'),
        (float("-inf"), "-.inf"),
        (datetime.date(2026, 1, 2), "2026-01-02"),
    ],
)
def test_values_are_shown_as_yaml_and_cut(value, said):
    assert brief(value) == said


FILES = {
    "empty": ("", "must be a mapping of keys to values; it is empty"),
    "text": ("hello", 'must be a mapping of keys to values; it is "hello"'),
    "a list": ("- 1\n- 2\n", r"must be a mapping of keys to values; it is \[1, 2\]"),
    "two documents": ("a: 1\n---\nb: 2\n", "not valid YAML: .*"),
    "deep": ("a: " + "[" * 5000 + "]" * 5000, "not valid YAML: nested too deeply, .*"),
    "less deep": ("name: " + "[" * 60 + "]" * 60, r"(name = \[+…\]+: must be text|missing kind.*)"),
    "deep mappings": ("{a: " * 3000 + "1" + "}" * 3000, "not valid YAML: nested too deeply, .*"),
    "a very long number": ("name: " + "1" * 5000, "not valid YAML: a number of 5000 digits: must have at most 400"),
    "no whole number": ("name: !!int abc", "not valid YAML: .*"),
    "no truth": ("name: !!bool maybe", "not valid YAML: .*"),
    "no time": ("name: !!timestamp abc", "not valid YAML: .*"),
    "nothing that is a number": ("name: !!int ''", "not valid YAML: .*"),
    "Python": ("name: !!python/object:os.system x", "not valid YAML: .*"),
    "a control character": ("name: \x00", "not valid YAML: .*"),
    "a key that is a list": ("? [a]\n: 1\n", "not valid YAML: found unhashable key"),
    "aliases without end": ("a: &a [*a]\n", "not valid YAML: found unconstructable recursive node"),
    "a bomb": (
        "a0: &a0 [1, 1]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 40)),
        "not valid YAML: more than 1000000 values, or an alias .*",
    ),
    "a tab": ("a:\n\t- b\n", "not valid YAML: .*"),
    "an alias of nothing": ("a: *b", "not valid YAML: found undefined alias 'b'"),
}


@pytest.mark.parametrize("what", FILES)
@pytest.mark.parametrize("read", [lambda path: read_model(path, Scene), read_cell], ids=["scene", "cell"])
def test_a_file_that_is_none(what, read, tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text(FILES[what][0], encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert re.fullmatch(rf"{re.escape(str(path))}(, line \d+)?: {FILES[what][1]}", str(caught.value))


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"\x80abc", b"\x89PNG\r\n\x1a\n\x00\x00"])
def test_a_file_that_is_no_text(content, tmp_path):
    (tmp_path / "a.yaml").write_bytes(content)
    with pytest.raises(InputError, match=r"a.yaml(, line \d+)?: (cannot be read|not valid YAML)") as caught:
        read_model(tmp_path / "a.yaml", Scene)
    assert "\n" not in str(caught.value)
