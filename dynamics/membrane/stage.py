"""Flexible flight: the sail as masses and springs, lit, heated and spinning, from spin-up to the end of the scene.

    python -m dynamics.membrane --scene workflow/scenes/s3.yaml --tables te.h5 tm.h5 --out flight.vtkhdf

A flight that was killed goes on from its last checkpoint, in the folder flight.vtkhdf.partial, when the same command is
given again, and ends with the same bits.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from beamrider.io.arguments import stage_arguments
from beamrider.io.files import InputError, finish, write_json
from beamrider.machine_code.notice import compiling
from dynamics.membrane.coarse_forecast import forecast_fine
from dynamics.membrane.flight import End, Flight
from dynamics.membrane.output.flight_file import write_flight
from dynamics.membrane.plan import plan
from dynamics.membrane.release import check_tilt
from dynamics.membrane.summary import attributes, errors_met
from dynamics.sail.neglected import said
from dynamics.sail.sectors import check_place, check_release, load_tables, require_own_polarisation
from dynamics.scene.schema import Scene, read_scene
from optics.table.pressure_table import PressureTable


def require_flyable(scene: Scene, tables: dict[str, PressureTable]) -> None:
    """InputError where a scene can't be flown with the pressure table of each of its designs, as it is released."""
    if scene.reflections.polarisation != "tracked":
        require_own_polarisation(scene, "a flexible flight without reflections.polarisation: tracked")
    check_release(scene, tables)
    check_place(scene, np.array(scene.release.offset_m))
    check_tilt(scene)


def fly_to(out: Path, scene: Scene, tables: dict[str, PressureTable], threads: int = 1) -> tuple[End, list[str]]:
    """Fly a scene that is flyable and write its flight: how it ended, and notes on it.

    What is kept of a flight under way lies beside `out`, from where it goes on.
    """
    with compiling("1 min"):
        forecast_fine(scene, lambda coarse, folder: Flight(coarse, tables, folder, threads), out)
        flight = Flight(scene, tables, out.with_name(out.name + ".partial"), threads)
        if flight.resume():
            print(f"{scene.name}: going on from step {flight.step}", file=sys.stderr)
        end = flight.fly()
    # Within the folder first: a process killed now leaves nothing beside the output
    made = out.with_name(out.name + ".partial") / out.name
    size = flight.journal.frames.nbytes + flight.journal.rows.nbytes
    met = errors_met(flight, tables)
    told = attributes(flight, end, tables) | met.attributes()
    write_flight(made, flight.membrane.mesh, flight.frames(), flight.columns(), told, size)
    made.replace(out)
    flight.journal.remove()
    return end, [met.text, said(told["neglected"])]


OPTIONS = {
    "--plan": "JSON file for the plan of effects",
    "--threads": {"type": int, "default": 1, "help": "threads that fly the sail, at most one a core (%(default)s)"},
}


def main() -> None:
    """Fly the flexible sail of a scene and write its flight."""
    given = stage_arguments("dynamics.membrane", main.__doc__, "VTKHDF file to write", options=OPTIONS)
    if not 1 <= given.threads <= len(os.sched_getaffinity(0)):
        raise InputError(f"--threads = {given.threads}: must be from 1 to {len(os.sched_getaffinity(0))}, the cores")
    scene = read_scene(given.scene)
    tables = load_tables(given.tables, scene)
    require_flyable(scene, tables)
    if given.plan:
        write_json(given.plan, {name: effect.model_dump() for name, effect in plan(scene).items()})
    end, notes = fly_to(Path(given.out), scene, tables, given.threads)
    where = "" if end.reason == "finished" else f" ({end.detail}, near {np.array2string(end.position, precision=4)} m)"
    ended = f"{end.reason} at {end.time:.6g} s{where}, {end.step} steps"
    finish(given.out, given.watch, ended, notes)
