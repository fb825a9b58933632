"""Draw which rooms of the packages import which, as a Mermaid flow chart for `docs/structure.md`.

    python -m workflow.structure            writes docs/structure.md

A room is a package or a module right below `beamrider`, `optics`, `dynamics` or `workflow`; a program that is run as
`python -m ROOM` (`__main__`, or a module that only names one) is none. Arrows that follow from others are left out.
"""

from __future__ import annotations

from graphlib import TopologicalSorter
from pathlib import Path

import grimp

from beamrider.io.files import atomic, run_stage

PACKAGES = ("beamrider", "optics", "dynamics", "workflow")
FILE = Path(__file__).resolve().parents[1] / "docs" / "structure.md"
HEAD = """# Structure

Which rooms import which: arrows point from the one that imports to the one imported; those that follow from others are
left out. `python -m workflow.structure` draws this anew, `lint-imports` checks the layers, and a test that there is no
circle, of modules or of rooms.

"""

Edges = dict[str, set[str]]


def modules() -> Edges:
    """What each module imports of the project, anywhere in its text. ModuleNotFoundError where a package is missing."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    return {module: set(graph.find_modules_directly_imported_by(module)) for module in sorted(graph.modules)}


def room(module: str) -> str:
    """The room of a module; of a program's `__main__` the module itself."""
    return module if module.endswith(".__main__") else ".".join(module.split(".")[:2])


def rooms(edges: Edges) -> Edges:
    """What each room imports, programs left out."""
    found: Edges = {}
    for module, imported in edges.items():
        mine = found.setdefault(room(module), set())
        mine |= {room(other) for other in imported} - {room(module)}
    return {name: sorted_out for name, sorted_out in found.items() if not name.endswith(".__main__")}


def order(edges: Edges) -> list[str]:
    """All names, each after what it imports; `graphlib.CycleError` names a circle."""
    return list(TopologicalSorter({name: sorted(edges[name]) for name in sorted(edges)}).static_order())


def reduced(edges: Edges) -> Edges:
    """The edges that don't follow from others, of a graph without circles."""
    below: Edges = {}
    for name in order(edges):
        below[name] = edges[name].union(*(below[other] for other in edges[name]))
    return {name: {o for o in found if not any(o in below[x] for x in found - {o})} for name, found in edges.items()}


def chart(edges: Edges) -> str:
    """Rooms as a Mermaid flow chart, a frame for each package."""
    lines = ["```mermaid", "flowchart TB"]
    for package in reversed(PACKAGES):
        lines.append(f"  subgraph {package}")
        inside = sorted(name for name in edges if name.startswith(f"{package}."))
        lines += [f"    {name.replace('.', '_')}[{name.split('.')[1]}]" for name in inside]
        lines.append("  end")
    kept = reduced(edges)
    lines += [f"  {a} --> {b}".replace(".", "_") for a in sorted(kept) for b in sorted(kept[a])]
    return "\n".join([*lines, "```", ""])


def drawn() -> str:
    """The whole text of `docs/structure.md`."""
    found = rooms(modules())
    used = {name for name in found if "." in name and (found[name] or any(name in other for other in found.values()))}
    return HEAD + chart({name: found[name] & used for name in used})


def main() -> None:
    """Write docs/structure.md."""
    FILE.parent.mkdir(exist_ok=True)
    with atomic(FILE) as temporary:
        temporary.write_text(drawn(), encoding="utf-8")


if __name__ == "__main__":
    run_stage(main)
