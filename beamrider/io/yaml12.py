"""YAML 1.2, as configuration is written: numbers are numbers; no duplicate keys, no endless aliases, no objects."""

from __future__ import annotations

import re
from collections.abc import Hashable
from typing import Any

import yaml
from yaml.composer import Composer

from beamrider.io.wording import brief

#: Values that a YAML file may hold, each as often as aliases name it.
MOST_VALUES = 1_000_000
#: Characters of a whole number; bytes of a file, which take some seconds to read; levels of lists and mappings.
MOST_DIGITS, MOST_BYTES, MOST_LEVELS = 400, 1_000_000, 100
TOO_DEEP = f"nested too deeply, more than {MOST_LEVELS} levels"


class Loader(Composer, yaml.CSafeLoader):
    """The core schema of YAML 1.2 (section 10.3.2 of its specification), and no duplicate keys.

    PyYAML reads YAML 1.1, where 0600 is 384, 1:30 is 90, 1e-3 is text, `no` is false and 2026-01-01 a date. Its parser
    in C makes the events, one by one and without recursion; nodes are composed of them here, where depth is limited.
    """

    yaml_implicit_resolvers: dict[Any, Any] = {}
    level = 0

    def __init__(self, stream: str) -> None:
        yaml.CSafeLoader.__init__(self, stream)
        Composer.__init__(self)

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """A node and all below it; ConstructorError, in time, where that is too deep."""
        if self.level == MOST_LEVELS:
            event: Any = self.peek_event()
            raise yaml.constructor.ConstructorError(None, None, TOO_DEEP, event.start_mark)
        self.level += 1
        node = super().compose_node(parent, index)
        self.level -= 1
        return node


def _mapping(loader: Loader, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
    seen = set()
    keys = (loader.construct_object(key, deep=True) for key, _ in node.value)
    for key in (key for key in keys if isinstance(key, Hashable)):
        if key in seen:
            said = f"key '{brief(key).strip(chr(34))}' is given twice"
            raise yaml.constructor.ConstructorError(None, None, said, node.start_mark)
        seen.add(key)
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


def _integer(loader: Loader, node: yaml.ScalarNode) -> int:
    text = loader.construct_scalar(node)
    if len(text) > MOST_DIGITS:
        said = f"a number of {len(text)} digits: must have at most {MOST_DIGITS}"
        raise yaml.constructor.ConstructorError(None, None, said, node.start_mark)
    return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))


_INTEGER = r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+"
_FLOAT = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
for _tag, _pattern in (
    ("null", "null|Null|NULL|~|"),
    ("bool", "true|True|TRUE|false|False|FALSE"),
    ("int", _INTEGER),
    ("float", _FLOAT),
):
    Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^(?:{_pattern})$"), [None])
Loader.add_constructor("tag:yaml.org,2002:int", _integer)
Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def scalar(text: str) -> Any:
    """A value given as text, on the command line, as it would be in a file: '1e-3' is a number, 'modal' stays text."""
    loader = Loader("")
    return loader.construct_object(yaml.ScalarNode(loader.resolve(yaml.ScalarNode, text, (True, False)), text))


def within_reason(data: Any) -> Any:
    """The data, if it is a tree of at most MOST_VALUES, MOST_LEVELS deep; ValueError where it is more, or endless."""
    sizes: dict[int, int] = {}

    def size(value: Any, level: int = 0) -> int:
        if not isinstance(value, dict | list):
            return 1
        if level == MOST_LEVELS:
            raise ValueError(TOO_DEEP)
        if id(value) not in sizes:
            sizes[id(value)] = MOST_VALUES  # met again within itself: endless
            parts = value.values() if isinstance(value, dict) else value
            sizes[id(value)] = 1 + sum(size(part, level + 1) for part in parts)
        return sizes[id(value)]

    if size(data) > MOST_VALUES:
        raise ValueError(f"more than {MOST_VALUES} values, or an alias within what it stands for")
    return data
