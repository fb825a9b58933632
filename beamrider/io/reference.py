"""Pages that list the keys of files, in Markdown, from their JSON schemas (`beamrider.io.json_schema`)."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

Rule = dict[str, Any]
#: Places that are named of a mapping that files have in many.
PLACES = 6
WORDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "`true`, `false`",
    "null": "`null`",
}
HEAD = "| key | what it is | unit | default | meaning |\n|---|---|---|---|---|"


def reference(schema: Rule, what: str, level: int = 3) -> str:
    """Sections of a schema's mappings in Markdown, the outermost first, each with a table of its keys.

    what: the kind of file, which headings begin with.
    """
    return "\n\n".join(_section(what, name, rule, places, level) for name, rule, places in _mappings(schema))


def _mappings(schema: Rule) -> Iterator[tuple[str, Rule, list[str]]]:
    """Each kind of mapping: its name, its rule, and the places where files have it; in the order of first use."""
    places: dict[str, list[str]] = {}
    waiting = [("", schema)]
    while waiting:
        place, rule = waiting.pop(0)
        for name, where in _referred(rule, place):
            if name not in places:
                waiting += [(where, schema["$defs"][name])]
            if where not in places.setdefault(name, []):
                places[name].append(where)
        for key, part in rule.get("properties", {}).items():
            waiting.append((f"{place}.{key}" if place else key, part))
    if "properties" in schema:
        yield "", schema, []
    yield from ((name, schema["$defs"][name], where) for name, where in places.items())


def _referred(rule: Any, place: str) -> Iterator[tuple[str, str]]:
    """Names of mappings that a rule refers to, each with its place, but for those within its own keys."""
    if "$ref" in rule:
        yield rule["$ref"].rsplit("/", 1)[-1], place
    for key in ("anyOf", "oneOf"):
        for choice in rule.get(key, []):
            yield from _referred(choice, place)
    for key, mark in (("items", "[]"), ("additionalProperties", ".*")):
        if isinstance(rule.get(key), dict):
            yield from _referred(rule[key], place + mark)


def _section(what: str, name: str, rule: Rule, places: list[str], level: int) -> str:
    parts = [f"{'#' * level} {what}: {name}"] if name else []
    if named := [f"`{place}`" for place in places if place]:
        parts.append("In " + ", ".join([*named[:PLACES], *["and others"] * (len(named) > PLACES)]) + ".")
    parts += filter(None, [rule.get("description")])
    needed = rule.get("required", [])
    rows = [_row(what, key, part, key in needed) for key, part in rule.get("properties", {}).items()]
    return "\n\n".join([*parts, "\n".join([HEAD, *rows])])


def _row(what: str, key: str, rule: Rule, needed: bool) -> str:
    default = "**needed**" if needed else _default(rule.get("default"))
    unit = "" if rule.get("unit") in (None, "1") else rule["unit"]
    text = " ".join(rule.get("description", "").split())
    cells = (f"`{key}`", _kind(what, rule), unit, default, text)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _default(value: Any) -> str:
    """A default in the words of YAML; a mapping's own are listed with its keys."""
    return "" if isinstance(value, dict) else f"`{json.dumps(value, ensure_ascii=False)}`"


def _kind(what: str, rule: Rule) -> str:
    """What a value must be, with its range, in words."""
    if "$ref" in rule:
        name = rule["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{what.lower()}-{name.lower()})"
    for key in ("anyOf", "oneOf"):
        if key in rule:
            return " or ".join(dict.fromkeys(_kind(what, choice) for choice in rule[key]))
    if "const" in rule or "enum" in rule:
        return ", ".join(f"`{_plain(value)}`" for value in rule.get("enum", [rule.get("const")]))
    return _of_type(what, rule)


def _of_type(what: str, rule: Rule) -> str:
    kind = rule.get("type")
    if "prefixItems" in rule:
        return f"list of {', '.join(_kind(what, part) for part in rule['prefixItems'])}"
    if kind == "array":
        low, high = rule.get("minItems", 0), rule.get("maxItems")
        count = f"{low} " if low == high else f"at least {low} " if low else ""
        return f"list of {count}({_kind(what, rule['items'])})"
    if kind == "object":
        keys = ", ".join(f"`{name}`" for name in rule.get("propertyNames", {}).get("enum", []))
        return f"mapping of {keys or 'keys'} to ({_kind(what, rule['additionalProperties'])})"
    return WORDS.get(str(kind), "anything") + _range(rule)


def _range(rule: Rule) -> str:
    """The range of a number: ' ≥ 0, ≤ 1e+06'."""
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    bounds = [f"{sign} {rule[key]:g}" for key, sign in signs.items() if key in rule]
    return f" {', '.join(bounds)}" if bounds else ""


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
