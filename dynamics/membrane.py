"""Flexible flight: the sail as masses and springs, lit, heated and spinning, from spin-up to the end of the scene.

    python -m dynamics.membrane --scene workflow/scenes/s3.yaml --tables te.h5 tm.h5 --out flight.vtkhdf

A flight that was killed goes on from its last checkpoint, in the folder flight.vtkhdf.partial, when the same command is
given again, and ends with the same bits.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynamics.attitude import rotation_from_angles
from dynamics.command import finish, stage_arguments
from dynamics.corotating import carrier_work, chord_speed
from dynamics.flight import Frame, series, write_flight
from dynamics.forecast import require_mesh, require_series, say_flexible
from dynamics.journal import Journal, leaves, numbers_digest, without
from dynamics.kernels import carried, failure, properties, record, sheet, tearing
from dynamics.kernels.crew import assist, dismiss
from dynamics.kernels.elastic import REFERENCE_TEMPERATURE
from dynamics.kernels.flown import Work
from dynamics.kernels.integrators import State
from dynamics.kernels.step import run
from dynamics.kernels.triangles import Patch
from dynamics.lattice import Floats, per_triangle
from dynamics.light.pointing import from_beam
from dynamics.mesh import sail_mesh
from dynamics.mesh_checks import check_shadow
from dynamics.model import Membrane, build
from dynamics.neglected import neglected, said
from dynamics.pace import foresee, paces
from dynamics.plan import plan
from dynamics.sail import check_place, check_release, load_tables, provenance, require_own_polarisation
from dynamics.scene import Scene, read_scene
from dynamics.stencil import free_sides, kept
from dynamics.table_error import TableErrors, membrane_errors
from dynamics.work_space import PATCH, initial_state, work_space
from optics.compiled import digest
from optics.compiling import compiling
from optics.files import InputError, Stopwatch, progress, run_stage, write_json
from optics.table import PressureTable

#: Steps a kernel call: long against a call's cost, short against a checkpoint's interval.
CHUNK = 512
#: Part of the fingerprint of a checkpoint, as are the compiled sources: raise it when this module gives other numbers.
SCHEMA = 4
#: Elastic strain of pressure below which rounding may be all there is.
LEAST_STRAIN = 1e-9
REASONS = {
    failure.INTACT: "finished", failure.TENSILE: "tensile_failure", failure.THERMAL: "thermal_failure",
    failure.LEFT_TABLE: "left_table", failure.FLY_AWAY: "fly_away", failure.NON_FINITE: "non_finite",
    failure.BROKEN: "broken", failure.BEYOND: "beyond_scheme",
}


@dataclass(frozen=True)
class End:
    """Why, at which step and time in s a flight ended; where (3,) in m and what was found, if something was."""

    reason: str
    step: int
    time: float
    position: Floats
    detail: str


class Flight:
    """A flexible flight in progress: its state, and the journal it writes."""

    def __init__(self, scene: Scene, tables: dict[str, PressureTable], folder: Path, threads: int = 1) -> None:
        require_mesh(scene)
        self.membrane: Membrane = build(scene, tables)
        self.model = self.membrane.model
        require_series(scene, self.model.dt, self.model.end, folder)
        self.state: State = initial_state(self.membrane)
        self.work: Work = work_space(
            self.model, scene.flight.on_failure, self.membrane.lattice.conductance_shares, threads
        )
        # What a later run needs, which may have another number of threads
        self._kept = without(self.work._replace(stencil=kept(self.work.stencil)), self.model)
        self._others = ThreadPoolExecutor(threads)
        if threads > 1:
            # Compiled here, where it may fail: the first thread would wait without end for one that never starts
            dismiss(self.work.stencil.scratch.board)
            self._assist(1)
        self.carrier = self.membrane.carrier
        self.carrying = None if self.carrier is None else carrier_work(self.carrier, self.model)
        self.step, self.fresh = 0, True
        self._wall, self._watch, self._saved = 0.0, Stopwatch(), Stopwatch()
        n = self.model.masses.size
        self.journal = Journal(folder, record.WIDTH, 1 + 7 * n + self.work.broken.failed.size)
        self._rows = np.empty((CHUNK // self.model.series_every + 3, record.WIDTH))
        self._frame_steps = max(1, round(scene.flight.snapshot_every_s / self.model.dt))
        # The numbers that fly, too: they change with any edit of a material, the lattice or the mesh
        flying = [self.model, *([self.carrier] if self.carrier is not None else [])]
        digests = [digest(), *map(numbers_digest, flying), *(table.digest for table in tables.values())]
        self._fingerprint = hashlib.sha256(repr([SCHEMA, scene.model_dump_json(), digests]).encode()).hexdigest()

    @property
    def wall_seconds(self) -> float:
        """Wall time in s of this flight, over all its runs."""
        return self._wall + self._watch.seconds

    @property
    def memory(self) -> int:
        """Bytes of all arrays that the kernels are given, but for the pressure tables; each array counts once."""
        parts: list[Any] = [self.model, self.state, self.work]
        parts += [self.carrier, self.carrying] if self.carrier is not None else []
        held = [found for part in parts for found in leaves(part)]
        arrays = [np.asarray(value) for name, value in held if not name.startswith("light.tables.")]
        return sum({array.ctypes.data: array.nbytes for array in arrays if array.nbytes}.values())

    def resume(self) -> bool:
        """Go on from the checkpoint in the journal's folder, if there is one of this very flight."""
        counters = self.journal.restore(self._fingerprint, *self._trees())
        if counters is not None:
            self.step, self.fresh, self._wall = int(counters["step"]), bool(counters["fresh"]), counters["wall"]
        return counters is not None

    def checkpoint(self) -> None:
        """Save the state from which `resume` goes on."""
        counters = {"step": self.step, "fresh": self.fresh, "wall": self.wall_seconds}
        self.journal.save(self._fingerprint, counters, *self._trees())
        self._saved = Stopwatch()

    def fly(self) -> End:
        """To the end, with progress on standard error and checkpoints on the way."""
        name, every = self.membrane.scene.name, self.membrane.scene.flight.checkpoint_every_s
        before, after = paces(self)
        release, end = self.model.release, self.model.end

        def done(step: int) -> int:
            """Steps in the light that take as long as all steps up to this one."""
            return round(before / after * min(step, release)) + max(0, step - release)

        left = (done(end) - done(self.step)) * after
        say_flexible(self.membrane.scene, self.model.dt, end, left, self.journal.folder)
        what = f"flexible {name}"
        with progress((), what, total=done(end), unit="step", initial=done(self.step)) as bar:
            while self.step < end:
                ended = self.advance()
                bar.update(done(self.step) - bar.n)
                if ended is not None:
                    return ended
                if self._saved.seconds > every:
                    self.checkpoint()
        return self._end(failure.INTACT)

    def rehearse(self, start: int, count: int) -> float:
        """Wall time in s of each of `count` steps from the start, the release or the present, which leave no trace."""
        kept, model = [array.copy() for _, array in self._arrays()], self.model
        if start == model.release and self.step < start:
            release(self.membrane, self.state)
        watch = Stopwatch()
        last = model.release if start < model.release else model.end
        _, reached, _ = self._run(start, min(start + count, last), True)
        spent = watch.seconds
        for (_, array), copy in zip(self._arrays(), kept, strict=True):
            array[...] = copy
        return spent / max(1, reached - start)

    def advance(self) -> End | None:
        """One kernel call: to the next frame, the release, or CHUNK steps on; the end, if it came."""
        if self.step == 0 and self.fresh:
            self._frame()
        before = [array.copy() for _, array in self._arrays()]
        start, fresh = self.step, self.fresh
        code, self.step, written = self._run(start, self._stop(), fresh)
        self.fresh = False
        self.journal.add_rows(self._rows[:written])
        if code != failure.INTACT:
            return self._fail(code, before, start, fresh)
        if self.step == self.model.release:
            release(self.membrane, self.state)
            self.fresh = True
        if (self.step - self.model.release) % self._frame_steps == 0 or self.step == self.model.end:
            self._frame()
        return None

    def _run(self, start: int, stop: int, fresh: bool) -> tuple[int, int, int]:
        """Steps from start to stop, with the other threads at their side: failure code, step reached, rows written."""
        work, model, board = self.work, self.model, self.work.stencil.scratch.board
        board[:] = 0
        try:
            others = [self._others.submit(self._assist, k) for k in range(1, work.stencil.scratch.bad.size)]
            if self.carrier is None:
                found = run(model, self.state, work, start, stop, fresh, self._rows)
            else:
                found = carried.run(
                    model, self.carrier, self.state, work, self.carrying, start, stop, fresh, self._rows
                )
        except BaseException:
            # The others would wait for work, and the process for them, without end
            dismiss(board)
            raise
        for other in others:
            other.result()
        return found

    def _assist(self, thread: int) -> None:
        """What one of the other threads does during a kernel call."""
        work, model = self.work, self.model
        assist(model.stencil, work.stencil, model.light, work.light, work.ahead, work.broken.gone, thread)

    def _trees(self) -> list[Any]:
        """All that changes as the sail flies."""
        return [self.state, self._kept, *([self.carrying] if self.carrying is not None else [])]

    def _arrays(self) -> Iterator[tuple[str, Any]]:
        for tree in self._trees():
            yield from leaves(tree)

    def _stop(self) -> int:
        """The step up to which the next kernel call goes."""
        release, since = self.model.release, self.step - self.model.release
        frame = self.step + self._frame_steps - since % self._frame_steps
        return min(self.step + CHUNK, frame, release if self.step < release else self.model.end)

    def _frame(self) -> None:
        temperature = self.state.temperature
        if not self.model.warm:
            temperature = np.full(self.model.masses.size, self.membrane.scene.flight.start_temperature_K)
        time = (self.step - self.model.release) * self.model.dt
        failed = self.work.broken.failed.astype(float)
        self.journal.add_frame(np.array([time]), self.state.x.T, self.state.v.T, temperature, failed)

    def _fail(self, code: int, before: list[Any], start: int, fresh: bool) -> End:
        """The end, with the state at which it came as last frame; for a non-finite one the last good state instead."""
        node = self._broken_node()
        if code == failure.NON_FINITE:
            for (_, array), copy in zip(self._arrays(), before, strict=True):
                array[...] = copy
            if self.step > start:
                self._run(start, self.step - 1, fresh)
                self.step -= 1
        self._frame()
        return self._end(code, node)

    def _broken_node(self) -> int:
        """The first node with a number that is not finite; the start of the edge found where there is none."""
        values = [*self.state.x, *self.state.v, *([self.state.temperature] if self.model.warm else [])]
        broken = np.flatnonzero(~np.isfinite(values).all(axis=0))
        parts = self.membrane.mesh.triangles if self.membrane.elastic_triangles else self.membrane.mesh.edges
        return int(broken[0]) if broken.size else int(parts[self.work.flags[1], 0])

    def _end(self, code: int, node: int = -1) -> End:
        where, detail = self._place(code, node)
        time = (self.step - self.model.release) * self.model.dt
        return End(REASONS[code], self.step, time, where, detail)

    def _place(self, code: int, node: int) -> tuple[Floats, str]:
        """Where the reason of the end was found, and in words."""
        x, found, mesh = self.state.x.T, int(self.work.flags[1]), self.membrane.mesh
        if code in (failure.INTACT, failure.FLY_AWAY, failure.BROKEN):
            return self.model.masses @ x / self.model.masses.sum(), "centre of mass"
        if code == failure.NON_FINITE:
            return x[node], f"node {node}"
        if code == failure.LEFT_TABLE:
            u, v = self.work.light.direction
            sector = int(mesh.sector[found])
            return x[mesh.triangles[found]].mean(axis=0), f"triangle {found}, sector {sector}, u = {u:.6g}, v = {v:.6g}"
        if code == failure.THERMAL or self.membrane.elastic_triangles:
            return x[mesh.triangles[found]].mean(axis=0), f"triangle {found} of nodes {mesh.triangles[found].tolist()}"
        return x[mesh.edges[found]].mean(axis=0), f"edge {found} between nodes {mesh.edges[found].tolist()}"

    def frames(self) -> Iterator[Frame]:
        """The frames of the journal."""
        n = self.model.masses.size
        for numbers in self.journal.frames:
            points, velocity, temperature, failed = np.split(numbers[1:], [3 * n, 6 * n, 7 * n])
            points = points.reshape(n, 3)
            strain, slack = strains(self.membrane, points, temperature)
            flags = failed if failed.size else None
            if self.work.broken.gone.size:
                strain[failed > 0] = np.nan  # of a triangle that is no longer there
                slack = None if slack is None else np.where(failed > 0, 0.0, slack)
            yield Frame(float(numbers[0]), points, velocity.reshape(n, 3), temperature, strain, flags, slack)

    def columns(self) -> dict[str, tuple[Floats, str]]:
        """Columns and units of the series."""
        cold = None if self.model.warm else self.membrane.scene.flight.start_temperature_K
        return series(np.asarray(self.journal.rows), cold)


def strains(membrane: Membrane, points: Floats, temperature: Floats) -> tuple[Floats, Floats | None]:
    """Strain (t,) of the triangles at points (n, 3) in m and temperature (n,) in K, and 1 (t,) where they are slack.

    The larger principal strain where triangles carry the load, which are slack where ε₂ + ν ε₁ < 0, that is where the
    smaller principal stress is a pressure; of springs the largest ℓ/L_T − 1 of the three sides, and None.
    """
    mesh, model = membrane.mesh, membrane.model
    a, b = mesh.edges.T
    if membrane.elastic_triangles:
        corners, free, t = model.triangles.corners, free_sides(model.stencil, model.sheet), len(mesh.triangles)
        whole = sheet.SheetWork(model.sheet.modulus, model.sheet.shear, model.sheet.limit)
        patch, found = Patch(np.empty((6, PATCH)), np.empty((10, PATCH)), np.empty((PATCH, 4))), np.empty((2, t))
        sheet.grow(model.sheet, model.stencil, corners, temperature, free)
        properties.grow(model.curves.expansion, model.sheet, model.stencil, corners, temperature, free)
        sheet.principal(
            model.sheet, whole, model.stencil, free, corners, np.ascontiguousarray(points.T), patch, found
        )
        poisson = per_triangle(membrane.scene.sail, mesh, "poisson")
        return found[0], (found[1] + poisson * found[0] < -LEAST_STRAIN).astype(float)
    free = mesh.lengths
    if model.springs.expansion.size:
        mean = 0.5 * (temperature[a] + temperature[b])
        free = free * (1.0 + membrane.lattice.expansion * (mean - REFERENCE_TEMPERATURE))
    edges = np.linalg.norm(points[b] - points[a], axis=1) / free - 1.0
    return np.asarray(edges[mesh.triangle_edges].max(axis=1)), None


def release(membrane: Membrane, state: State) -> None:
    """Bring the spinning sail to its place at t = 0, as a rigid body and at once.

    In this order: turn positions and velocities about z until the reference node is back at its azimuth (yaw 0); tilt
    both by A_x(roll) A_y(pitch) about the origin, the spin axis with them; shift by the offset. In the co-rotating
    scheme nodes go on along chords.
    """
    given = membrane.scene.release
    node, masses = membrane.mesh.reference_node, membrane.lattice.masses
    centre = state.x @ masses / masses.sum()
    arm, rest = state.x[:, node] - centre, membrane.model.rest[:, node]
    yaw = math.atan2(rest[1], rest[0]) - math.atan2(arm[1], arm[0])
    tilt = rotation_from_angles(np.radians(given.roll_deg), np.radians(given.pitch_deg), yaw)
    state.x[...] = tilt @ state.x + np.array([*given.offset_m, 0.0])[:, None]
    state.v[...] = tilt @ state.v
    if membrane.carrier is not None:
        state.v[...] *= chord_speed(membrane.scene, membrane.model.dt)


def check_tilt(scene: Scene) -> None:
    """InputError where the released sail would shade itself, as deep ones do when they are tilted."""
    given = scene.release
    if scene.sail.profile != "flat" and scene.beam.intensity_W_m2 > 0:
        tilt = rotation_from_angles(np.radians(given.roll_deg), np.radians(given.pitch_deg), 0.0)
        check_shadow(sail_mesh(scene.sail), tilt, f"{scene.name}.yaml: release.pitch_deg, roll_deg")


def first_failure(flight: Flight) -> dict[str, Any]:
    """When, where and how the first triangle failed of a flight that goes on after it; nothing if none did."""
    broken = flight.work.broken
    if broken.tally[tearing.BY_STRESS] + broken.tally[tearing.BY_HEAT] == 0:
        return {}
    kind = "tensile_failure" if broken.tally[tearing.KIND] == tearing.BY_STRESS else "thermal_failure"
    place = {"first_failure_time": float(broken.first[0]), "first_failure_position": broken.first[1:].copy()}
    return {"first_failure": kind, "first_failure_triangle": int(broken.tally[tearing.FIRST]), **place}


def errors_met(flight: Flight, tables: dict[str, PressureTable]) -> TableErrors:
    """What the tables' stated errors come to on the way of a flight, in its snapshots from the release on."""
    n, mesh = flight.model.masses.size, flight.membrane.mesh
    points = [numbers[1 : 1 + 3 * n].reshape(n, 3) for numbers in flight.journal.frames if numbers[0] >= 0.0]
    if flight.model.light.wander.periods.size > 0:
        times = [float(numbers[0]) for numbers in flight.journal.frames if numbers[0] >= 0.0]
        points = [from_beam(flight.model.light.wander, t, one) for t, one in zip(times, points, strict=True)]
    return membrane_errors(flight.membrane.scene, tables, mesh, points)


def lit_from_behind(flight: Flight) -> float | None:
    """Time in s of the first snapshot in which a part of the lit sail turns away from the light, None if none does."""
    n, triangles = flight.model.masses.size, flight.membrane.mesh.triangles
    for numbers in flight.journal.frames:
        x, failed = numbers[1 : 3 * n + 1].reshape(n, 3), numbers[7 * n + 1 :]
        a, b, c = (x[triangles[:, i], :2] for i in range(3))
        facing = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        there = failed == 0.0 if flight.work.broken.gone.size else np.ones(facing.size, bool)
        if numbers[0] >= 0.0 and np.any(facing[there] <= 0.0):
            return float(numbers[0])
    return None


def attributes(flight: Flight, end: End, tables: dict[str, PressureTable]) -> dict[str, Any]:
    """What /series says about the whole flight."""
    model, scene, columns = flight.model, flight.membrane.scene, flight.columns()
    time, position, velocity = (columns[name][0] for name in ("time", "position", "velocity"))
    return {
        "neglected": neglected(scene, tables, time, position, velocity, lit_from_behind(flight)),
        "end_reason": end.reason, "end_time": end.time, "end_position": end.position, "end_detail": end.detail,
        "steps": end.step, "time_step": model.dt, "mass_kg": float(model.masses.sum()),
        "scene": scene.model_dump_json(), "tables": json.dumps(provenance(tables)),
        "effects": json.dumps({name: effect.on for name, effect in flight.membrane.effects.items()}),
        "wall_seconds": flight.wall_seconds, "outside_table": int(flight.work.light.outside[0]),
        **first_failure(flight),
    }


def fly(scene: Scene, tables: dict[str, PressureTable]) -> tuple[Flight, End, dict[str, Floats]]:
    """Fly a scene without leaving a file: the flight, its end, and the columns of its series."""
    check_place(scene, np.array(scene.release.offset_m))
    with tempfile.TemporaryDirectory() as folder:
        flight = Flight(scene, tables, Path(folder))
        end = flight.fly()
        return flight, end, {name: np.array(values) for name, (values, _) in flight.columns().items()}


def main() -> None:
    """Fly the flexible sail of a scene and write its flight."""
    more = {
        "--plan": "JSON file for the plan of effects",
        "--threads": {"type": int, "default": 1, "help": "threads that fly the sail, at most one a core (%(default)s)"},
    }
    given = stage_arguments("dynamics.membrane", main.__doc__, "VTKHDF file to write", options=more)
    out = Path(given.out)
    if not 1 <= given.threads <= len(os.sched_getaffinity(0)):
        raise InputError(f"--threads = {given.threads}: must be from 1 to {len(os.sched_getaffinity(0))}, the cores")
    scene = read_scene(given.scene)
    if scene.reflections.polarisation != "tracked":
        require_own_polarisation(scene, "a flexible flight without reflections.polarisation: tracked")
    tables = load_tables(given.tables, scene)
    check_release(scene, tables)
    check_place(scene, np.array(scene.release.offset_m))
    if given.plan:
        write_json(given.plan, {name: effect.model_dump() for name, effect in plan(scene).items()})
    check_tilt(scene)
    with compiling("2 min"):
        foresee(scene, lambda coarse, folder: Flight(coarse, tables, folder, given.threads), out)
        flight = Flight(scene, tables, out.with_name(out.name + ".partial"), given.threads)
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
    where = "" if end.reason == "finished" else f" ({end.detail}, near {np.array2string(end.position, precision=4)} m)"
    ended = f"{end.reason} at {end.time:.6g} s{where}, {end.step} steps"
    finish(out, given.watch, ended, [met.text, said(told["neglected"])])


if __name__ == "__main__":
    run_stage(main)
