"""JSON schemas of the files that users write, from the models that read them.

Kinds, ranges, choices and defaults are those of the model; the description of a key is the text below it in the source;
its unit is that which the key ends in ('period_nm'), or the `unit` given with its type where the key names none. Rules
between keys are the models' alone: a schema never refuses what its model takes.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from itertools import pairwise
from typing import Any

from pydantic import BaseModel, TypeAdapter

from beamrider.io.wording import models_of
from beamrider.provenance.sources import is_text

DRAFT = "https://json-schema.org/draft/2020-12/schema"
#: Units by the last parts of keys.
UNITS = {
    "nm": "nm",
    "m": "m",
    "s": "s",
    "minutes": "min",
    "deg": "°",
    "Hz": "Hz",
    "K": "K",
    "Pa": "Pa",
    "N": "N",
    "kg": "kg",
    "W_m2": "W/m²",
    "kg_m3": "kg/m³",
    "W_mK": "W/(m K)",
    "J_kgK": "J/(kg K)",
    "1_K": "1/K",
    "m_s": "m/s",
    "m_s2": "m/s²",
    "N_m": "N/m",
    "N_s_m": "N s/m",
}


def unit_of(key: str) -> str | None:
    """The unit that a key ends in: the longest that fits; None where it names none."""
    parts = key.split("_")
    return next((UNITS[end] for i in range(1, len(parts)) if (end := "_".join(parts[i:])) in UNITS), None)


def descriptions(model: type[BaseModel]) -> dict[str, str]:
    """The text below each field of a model's source, and of those that it inherits from, by name."""
    found: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        if issubclass(kind, BaseModel) and kind is not BaseModel:
            body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0].body  # type: ignore[attr-defined]
            fields = [(ast.unparse(key.target), text) for key, text in pairwise(body) if isinstance(key, ast.AnnAssign)]
            found |= {name: inspect.cleandoc(text.value.value) for name, text in fields if is_text(text)}
    return found


def json_schema(kind: Any, title: str) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a model, or of a union of models, with descriptions and units."""
    schema = TypeAdapter(kind).json_schema()
    parts = {schema.get("title"): schema, **schema.get("$defs", {})}
    for model in models_of(kind):
        if model.__name__ in parts:  # others are in one of the same name
            _describe(parts[model.__name__], model)
    return {"$schema": DRAFT, **schema, "title": title}


def _describe(part: dict[str, Any], model: type[BaseModel]) -> None:
    """Add to a model's part of a schema what its fields mean and are measured in."""
    texts = descriptions(model)
    part["description"] = inspect.cleandoc(model.__doc__ or "")
    for key, rule in part["properties"].items():
        rule.pop("title", None)
        unit = unit_of(key) or given_unit(rule)
        if unit:
            rule["unit"] = unit
        if key in texts:
            rule["description"] = texts[key]


def given_unit(rule: Any) -> str | None:
    """The unit that a type states, within a choice or a list too; None where none is."""
    if isinstance(rule, dict):
        if isinstance(rule.get("unit"), str):
            return str(rule["unit"])
        return next(filter(None, map(given_unit, [*rule.get("anyOf", []), rule.get("items")])), None)
    return None
