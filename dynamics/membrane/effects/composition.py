"""All effects of the list at once: their parameters and work arrays, and what they do in a step, one after the other.

Functions are put together from the list as source text: compiled code calls no function that it does not know by name.
They are copied into those that call them, whose machine code in the cache holds them.
"""

from __future__ import annotations

from collections import namedtuple
from itertools import accumulate
from typing import Any

from dynamics.membrane.effects import EFFECTS
from dynamics.membrane.effects.interface import Columns, Setup, hook

#: Parameters and work arrays of the effects, by their names.
Parameters: Any = namedtuple("Parameters", [effect.NAME for effect in EFFECTS])  # type: ignore[misc]
Arrays: Any = namedtuple("Arrays", [effect.NAME for effect in EFFECTS if hasattr(effect, "work")])  # type: ignore[misc]


def build_all(setup: Setup) -> Any:
    """Parameters of all effects."""
    return Parameters(*(effect.build(setup) for effect in EFFECTS))


def work_all(model: Any) -> Any:
    """Work arrays of all effects that have some."""
    return Arrays(*(effect.work(model) for effect in EFFECTS if hasattr(effect, "work")))


def composed(arguments: str, calls: list[tuple[Any, str]], value: bool = False) -> Any:
    """A compiled function of `arguments` that calls functions, each with arguments of its own.

    value: it returns whether any of them returns True; else nothing is returned.
    """
    space = {f"f{k}": function for k, (function, _) in enumerate(calls)}
    said = [f"f{k}({own})" for k, (_, own) in enumerate(calls)]
    lines = [f"return {' or '.join(said) or False}"] if value else said or ["pass"]
    exec(f"def composed({arguments}):\n" + "".join(f"    {line}\n" for line in lines), space)
    return hook()(space["composed"])


def _in_turn(name: str, arguments: str, value: bool = False) -> Any:
    """`name` of all effects that have it, in the order of the list."""
    return composed(arguments, [(getattr(e, name), arguments) for e in EFFECTS if hasattr(e, name)], value)


acts_each_step = _in_turn("acts_each_step", "model", value=True)
lengthen = _in_turn("lengthen", "model, work, temperature")
relight = _in_turn("relight", "model, work, x, t")
accelerate = _in_turn("accelerate", "model, work, x, v, t")
heat = _in_turn("heat", "model, work, x, temperature")


def columns_from(first: Columns) -> dict[str, tuple[int, str]]:
    """Columns of a row: the first ones, then those of the effects."""
    found = dict(first)
    for effect in EFFECTS:
        for name, column in getattr(effect, "COLUMNS", {}).items():
            if name in found:
                raise ValueError(f"{effect.__name__}: column '{name}' is another's")
            found[name] = column
    return found


def writing(start: int) -> Any:
    """Compiled `write(model, work, state, centre, row)` of all effects, whose columns begin at `start` of the row."""
    own = [effect for effect in EFFECTS if getattr(effect, "COLUMNS", {})]
    ends = [*accumulate((sum(n for n, _ in effect.COLUMNS.values()) for effect in own), initial=start)]
    calls = [
        (effect.write, f"model, work, state, centre, row[{begin}:{end}]")
        for effect, begin, end in zip(own, ends[:-1], ends[1:], strict=True)
    ]
    return composed("model, work, state, centre, row", calls)
