"""Versions of the libraries that modules belong to, as installed here and as asked for in a file of constraints."""

from __future__ import annotations

import functools
import importlib.metadata
import importlib.util
import platform
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from packaging.requirements import Requirement


@functools.cache
def _distributions() -> dict[str, list[str]]:
    """Names of the installed distributions that hold a module."""
    return {module: list(names) for module, names in importlib.metadata.packages_distributions().items()}


def versions_of(modules: Iterable[str], constraints: Path) -> dict[str, str]:
    """Versions of Python and of the libraries that hold the modules, with those that they need in turn, by name.

    Of a module that no installed distribution holds, as Debian's Meep, the version that its own source states. Where
    the file of constraints asks for another version than is installed, this is said too.
    """
    names = set(modules) - set(sys.stdlib_module_names)
    held = {name for module in names for name in _distributions().get(module, [])}
    loose = {module: _stated(module) for module in names if module not in _distributions()}
    found = {"Python": platform.python_version(), **{name: version for name, version in loose.items() if version}}
    pins = _constraints(constraints.read_text(encoding="utf-8") if constraints.is_file() else "")
    for name, version in _needed(frozenset(held)).items():
        wanted = pins.get(name)
        met = wanted is None or Requirement(wanted).specifier.contains(version, prereleases=True)
        found[name] = version if met else f"{version} ({wanted})"
    return dict(sorted(found.items()))


@functools.cache
def _needed(distributions: frozenset[str]) -> dict[str, str]:
    """Versions of distributions, and of all that they need to run, by normalised name (PEP 503)."""
    found: dict[str, str] = {}
    todo = list(distributions)
    while todo:
        name = _normalised(todo.pop())
        if name in found:
            continue
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        found[name] = distribution.version
        needs = [Requirement(text) for text in distribution.requires or []]
        todo += [need.name for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})]
    return found


def _normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


@functools.cache
def _constraints(text: str) -> dict[str, str]:
    """Lines of a constraints file's text that hold for this Python, by normalised name."""
    lines = [line.split("#")[0].strip() for line in text.splitlines()]
    found = [need for need in map(Requirement, filter(None, lines)) if need.marker is None or need.marker.evaluate()]
    return {_normalised(need.name): f"{need.name}{need.specifier}" for need in found}


@functools.cache
def _stated(module: str) -> str | None:
    """The version that a module's source states, not imported; None where there is no such module or version."""
    spec = importlib.util.find_spec(module)
    if not spec or not spec.origin or not spec.origin.endswith(".py"):
        return None
    found = re.search(r"^__version__ *= *['\"]([^'\"]+)['\"]", Path(spec.origin).read_text(encoding="utf-8"), re.M)
    return found[1] if found else "unknown"
