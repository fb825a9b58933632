"""The command `beamrider`: one sub-command a stage, each the same program as `python -m` runs, with the same options.

What a stage writes says the same of what made it, whichever way it was given. Stages are imported when they are named:
help and version take none of them.
"""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Sequence

COMMANDS = {
    "table": ("optics.modal", "pressure table of a cell, by the solver for its kind"),
    "directions": ("optics.nodes", "directions for FDTD to solve"),
    "responses": ("optics.local", "response of many cells around normal incidence"),
    "band": ("optics.band", "response of a cell around normal incidence over a band of wavelengths"),
    "stability": ("dynamics.floquet", "linear stability of a spinning sail: multipliers, margin, verdict"),
    "way": ("dynamics.way", "linear stability of a spinning sail on its way, over its speed"),
    "fly": ("dynamics.rigid", "flight of a sail, rigid (--out F.h5) or flexible (--out F.vtkhdf)"),
    "screen": ("dynamics.screening", "linear stability of the members of a family"),
    "basin": ("dynamics.basin", "releases from which a rigid sail stays on its beam"),
    "maps": ("dynamics.maps", "maps of force and torque"),
    "mesh": ("dynamics.mesh", "mesh of a sail, for ParaView"),
    "plan": ("dynamics.scene", "effects that a scene calls for, each with its reason"),
    "merit": ("dynamics.merit", "figures of merit of materials"),
    "schema": ("beamrider.schema", "JSON schema of scenes, cells, families, configuration; reference page"),
    "show": ("beamrider.show", "what made a result: program, sources, versions, inputs"),
    "check": ("beamrider.check", "are files whole"),
}
SOLVERS = {"modal": "optics.modal", "fdtd": "optics.fdtd", "thin_film": "optics.thin_film"}
CHOICES = {
    "table": "--solver {modal,fdtd,thin_film} chooses the solver; without it films are solved by thin_film, gratings "
    "by modal. What follows is for modal.",
    "fly": "--rigid or --flexible chooses; without it --out F.h5 is a rigid flight, --out F.vtkhdf a flexible one. "
    "What follows is for rigid flight.",
}
HELP = ("-h", "--help")


class Refused(Exception):
    """A command line that names no stage; the text says why."""


def overview() -> str:
    """What `beamrider --help` prints: each sub-command with one line."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:{width}}  {about}" for name, (_, about) in COMMANDS.items()]
    return "\n".join(
        [
            "usage: beamrider COMMAND …",
            "",
            "From the unit cell of a light sail's surface to its flight on the beam.",
            "",
            *lines,
            "",
            "beamrider COMMAND --help lists the options of one; beamrider --version tells the version.",
        ]
    )


def without(option: str, words: Sequence[str]) -> tuple[str | None, list[str]]:
    """The last value of an option, as `--option value` or `--option=value`, None without it, and the other words."""
    value, rest, following = None, [], False
    for word in words:
        name, sign, given = word.partition("=")
        if following:
            value, following = word, False
        elif name == option:
            value, following = given, not sign
        else:
            rest.append(word)
    if following:
        raise Refused(f"{option}: must have a value")
    return value, rest


def stage_of(name: str, words: Sequence[str]) -> tuple[str, list[str]]:
    """The program of a sub-command, as in `python -m program`, and its own words; `Refused` says what names none."""
    if name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS, n=1)
        raise Refused(f"no command '{name}'{f'; did you mean {near[0]!r}?' if near else ''} (--help lists them)")
    if name == "table":
        return _solver(words)
    return _flight(words) if name == "fly" else (COMMANDS[name][0], list(words))


def _solver(words: Sequence[str]) -> tuple[str, list[str]]:
    """The solver that is asked for, else that for the cell's kind."""
    solver, rest = without("--solver", words)
    if solver is not None:
        if solver not in SOLVERS:
            raise Refused(f"--solver = {solver}: must be one of {', '.join(SOLVERS)}")
        return SOLVERS[solver], rest
    cell, _ = without("--cell", rest)
    return SOLVERS["thin_film" if cell is not None and _kind(cell) == "thin_film" else "modal"], rest


def _kind(path: str) -> object:
    """What kind a cell's file says that it is; None where it can't be read, which the solver will say."""
    from beamrider.io.files import InputError, read_mapping

    try:
        return read_mapping(path).get("kind")
    except InputError:
        return None


def _flight(words: Sequence[str]) -> tuple[str, list[str]]:
    """Rigid or flexible flight, as asked for, else by the ending of the output."""
    asked = {word for word in words if word in ("--rigid", "--flexible")}
    rest = [word for word in words if word not in asked]
    if len(asked) > 1:
        raise Refused("--rigid, --flexible: must be one of them")
    out, _ = without("--out", rest)
    ending = "" if out is None else out.rpartition(".")[2]
    if "--flexible" in asked or (not asked and ending == "vtkhdf"):
        return "dynamics.membrane", rest
    if asked or ending == "h5" or out is None:
        return "dynamics.rigid", rest
    raise Refused(f"--out = {out}: must end in .h5 (rigid flight) or .vtkhdf (flexible); or give --rigid or --flexible")


def main() -> None:
    """Run the stage that the command line names."""
    words = sys.argv[1:]
    if not words or words[0] in HELP:
        print(overview())
        raise SystemExit(0 if words else 2)
    if words[0] == "--version":
        from importlib.metadata import version

        print(f"beamrider {version('beamrider')}")
        return
    name, *given = words
    try:
        program, given = stage_of(name, given)
    except Refused as error:
        print(f"error: beamrider{f' {name}' if name in COMMANDS else ''}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    if name in CHOICES and set(given) & set(HELP) and program == COMMANDS[name][0]:
        print(CHOICES[name], end="\n\n", flush=True)
    run(program, f"beamrider {name}", given)


def run(program: str, command: str, words: list[str]) -> None:
    """Run a stage as `python -m program` would, under the name of the command that was given."""
    from beamrider.io.files import run_stage

    module = importlib.import_module(program)
    if hasattr(module, "__path__"):
        module = importlib.import_module(f"{program}.__main__")
    sys.argv = [command, *words]
    run_stage(module.main, program)
