"""What is wrong with a value that a file gives, in one line and in the words of the file.

A validation finds errors of many kinds, at places that name branches of unions and types of Python. Here each becomes
`sail.sectors[0].material: missing young_Pa, poisson` or `sail.rings = -3: must be greater than or equal to 1`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel

#: Characters of a value that are shown of it; and entries, and levels, before that.
MOST, ENTRIES, LEVELS = 60, 8, 4
#: Characters of a word of a message, which may be a path, and of all of it.
LONGEST_WORD, LONGEST_LINE = 300, 1500
LONG = re.compile(rf"\S{{{MOST + 1},}}")
#: What each kind of error asks for; {…} are the limits that come with it.
MUST = {
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "string_type": "text",
    "string_unicode": "text",
    "string_sub_type": "text",
    "none_required": "null",
    "list_type": "a list",
    "tuple_type": "a list",
    "iterable_type": "a list",
    "dict_type": "a mapping of keys to values",
    "mapping_type": "a mapping of keys to values",
    "model_attributes_type": "a mapping of keys to values",
    "dataclass_type": "a mapping of keys to values",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "greater than or equal to {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "less than or equal to {le:g}",
    "multiple_of": "a multiple of {multiple_of:g}",
    "string_too_short": "of at least {min_length} characters",
    "string_too_long": "of at most {max_length} characters",
    "string_pattern_mismatch": "made of letters, digits, '_', '.' and '-' only, a letter, digit or '_' first",
    "union_tag_invalid": "one of {expected_tags}",
    "union_tag_not_found": "a mapping that names its kind",
    "recursion_loop": "a value that does not hold itself",
}
#: What a branch of a union is for, by the beginning of its name.
TEXT, LIST, NUMBER = ("str", "constrained-str", "literal"), ("list", "tuple"), ("int", "float", "constrained-")


@dataclass(frozen=True)
class Fault:
    """One error of a validation: where in the file, by which branches of unions (depth, name), and what it says."""

    path: tuple[Any, ...]
    branches: tuple[tuple[int, str], ...]
    kind: str
    given: Any
    limits: Mapping[str, Any]
    text: str


def describe(errors: Iterable[Mapping[str, Any]], data: Any, model: type[BaseModel]) -> str:
    """One line for the first thing that is wrong with `data` as a `model`; keys that are missing together, together."""
    faults = _fitting([_fault(error, data) for error in errors], data)
    first = faults[0]
    if first.kind == "missing":
        parent = first.path[:-1]
        names = [str(f.path[-1]) for f in faults if f.kind == "missing" and f.path[:-1] == parent]
        return f"{place(parent)}: missing {', '.join(names)}" if parent else f"missing {', '.join(names)}"
    if first.kind == "unknown_key":
        allowed = str(first.limits.get("expected", "text")).replace(" or ", ", ").replace("'", "")
        return f"{place(first.path[:-1])}: unknown key {brief(first.path[-1])} (allowed: {allowed})"
    if first.kind in ("value_error", "assertion_error"):
        return _joined(first, model)
    alike = [f for f in faults if f.path == first.path]
    wanted = " or ".join(dict.fromkeys(_must(fault, model) for fault in alike))
    return f"{place(first.path)} = {brief(first.given)}: must be {wanted}"


def place(path: Sequence[Any]) -> str:
    """Keys and numbers of entries as a file's reader would write them: sail.sectors[0].g."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{_cut(str(part))}" if text else _cut(str(part))
    return text


def brief(value: Any) -> str:
    """A value as YAML would have it, on one line, of at most MOST characters."""
    return _cut(_flow(value, LEVELS))


def shortened(line: str) -> str:
    """A message as one line, without what is too long of its words and of itself to be read."""
    words = (word if len(word) <= LONGEST_WORD else f"{word[:LONGEST_WORD]}…" for word in line.split())
    return " ".join(words)[:LONGEST_LINE]


def _cut(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= MOST else f"{text[: MOST - 1]}…"


def _flow(value: Any, levels: int) -> str:
    """YAML's flow style of a value, without what is too deep or too much to show."""
    if isinstance(value, Mapping | list | tuple):
        opening, closing = "{}" if isinstance(value, Mapping) else "[]"
        if levels == 0 and value:
            return f"{opening}…{closing}"
        some = list(value.items() if isinstance(value, Mapping) else value)[:ENTRIES]
        parts = [
            ": ".join(_flow(x, levels - 1) for x in part) if isinstance(value, Mapping) else _flow(part, levels - 1)
            for part in some
        ]
        return f"{opening}{', '.join(parts + ['…'] * (len(value) > ENTRIES))}{closing}"
    if isinstance(value, float) and not math.isfinite(value):
        return {"inf": ".inf", "-inf": "-.inf"}.get(str(value), ".nan")
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**MOST:
        return f"{'-' if value < 0 else ''}{abs(value) // 10 ** (_digits(value) - 6)}… ({_digits(value)} digits)"
    if isinstance(value, str):
        return json.dumps(value[: 2 * MOST], ensure_ascii=False)
    return json.dumps(value) if isinstance(value, int | float) or value is None else str(value)[: 2 * MOST]


def _digits(value: int) -> int:
    """Decimal digits of a whole number, also where Python refuses to write it out."""
    count = max(1, int(abs(value).bit_length() * math.log10(2.0)))
    return count + (abs(value) >= 10**count)


def _fault(error: Mapping[str, Any], data: Any) -> Fault:
    """An error with its place sorted out: what is in `data`, and which branches of unions led to it."""
    path: list[Any] = []
    kind, text = error["type"], error["msg"]
    branches: list[tuple[int, str]] = []
    here, last = data, len(error["loc"]) - 1
    for i, part in enumerate(error["loc"]):
        inside = isinstance(here, Mapping) and part in here
        if inside or (isinstance(here, list | tuple) and isinstance(part, int) and part < len(here)):
            here = here[part]
            path.append(part)
        elif i == last and error["type"] in ("missing", "extra_forbidden"):
            path.append(part)
        elif part == "[key]":
            kind = "unknown_key"
        else:
            branches.append((len(path), str(part)))
    return Fault(tuple(path), tuple(branches), kind, error["input"], error.get("ctx") or {}, text)


def _fitting(faults: list[Fault], data: Any) -> list[Fault]:
    """The faults without those of branches that are for another kind of value, where a branch is for this one."""
    forks = {(f.path[:depth], name) for f in faults for depth, name in f.branches}
    misfits = set()
    for path in {path for path, _ in forks}:
        names = {name for at, name in forks if at == path}
        good = {name for name in names if _is_for(name, _value(data, path))}
        misfits |= {(path, name) for name in names - good} if good else set()
    return [f for f in faults if not any((f.path[:depth], name) in misfits for depth, name in f.branches)] or faults


def _value(data: Any, path: Sequence[Any]) -> Any:
    for part in path:
        data = data[part]
    return data


def _is_for(branch: str, value: Any) -> bool:
    """Is a branch of a union, by its name, for values of this kind."""
    if isinstance(value, str):
        return branch.startswith(TEXT)
    if isinstance(value, list):
        return branch.startswith(LIST)
    if isinstance(value, Mapping):
        return not branch.startswith((*TEXT, *LIST, *NUMBER, "bool", "none"))
    return branch.startswith("bool" if isinstance(value, bool) else NUMBER)


def _must(fault: Fault, model: type[BaseModel]) -> str:
    """What a value must be."""
    limits = fault.limits
    if fault.kind in ("literal_error", "enum"):
        allowed = str(limits["expected"])
        return allowed.replace("True", "true").replace("False", "false").replace("None", "null")
    if fault.kind in ("model_type", "model_attributes_type") and "class_name" in limits:
        keys = next((m.model_fields for m in models_of(model) if m.__name__ == limits["class_name"]), {})
        return f"a mapping of {', '.join(keys)}" if keys else MUST["dict_type"]
    if fault.kind == "greater_than_equal" and 0 < limits["ge"] <= 1e-9 and fault.given <= 0:
        return "greater than 0"  # the bound itself is for numbers that are far too small
    if fault.kind in ("too_short", "too_long"):
        bound = "at least {min_length}" if fault.kind == "too_short" else "at most {max_length}"
        return f"a list of {bound}".format(**limits) + " entries"
    if fault.kind == "string_type" and isinstance(fault.given, int | float) and not isinstance(fault.given, bool):
        return "text: put it in quotes"
    return MUST.get(fault.kind, "something else").format(**limits)


def _joined(fault: Fault, model: type[BaseModel]) -> str:
    """What a rule of the model says, with its place before it: as one where the rule begins with one of its keys."""
    text = " ".join(fault.text.removeprefix("Value error, ").removeprefix("Assertion failed, ").split())
    text = LONG.sub(lambda word: _cut(word[0]), text)
    where, owners = place(fault.path), {key for m in models_of(model) for key in m.model_fields}
    begins = text.replace("[", " ").replace(".", " ").replace(":", " ").split(" ", 1)[0]
    if not where:
        return text
    return f"{where}.{text}" if begins in owners else f"{where}: {text}"


def models_of(model: Any) -> Iterator[type[BaseModel]]:
    """A model and all those that its fields are made of."""
    seen: set[Any] = set()
    waiting = [model]
    while waiting:
        kind = waiting.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel) and kind not in seen:
            seen.add(kind)
            yield kind
            fields = kind.model_fields.values()
            waiting += [field.annotation for field in fields]
            waiting += [getattr(part, "json_schema_input_type", None) for field in fields for part in field.metadata]
        waiting += get_args(kind)
