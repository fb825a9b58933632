"""A flexible flight in progress: the sail as masses and springs, lit, heated and spinning, step by step."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import Stopwatch, progress
from beamrider.machine_code.cache import digest
from dynamics.membrane.arrays import WorkSpace
from dynamics.membrane.build import Membrane, build
from dynamics.membrane.effects import failure, tethers
from dynamics.membrane.forecast import require_mesh, require_series, say_flexible
from dynamics.membrane.output import record
from dynamics.membrane.output.flight_file import Frame, series
from dynamics.membrane.output.journal import Journal, leaves, numbers_digest, without
from dynamics.membrane.release import release
from dynamics.membrane.row_layout import kept
from dynamics.membrane.state import State
from dynamics.membrane.stepping import corotating_flight
from dynamics.membrane.stepping.corotating_setup import STIFFEST, corotating, corotating_work
from dynamics.membrane.stepping.step import run
from dynamics.membrane.stepping.threads import assist, dismiss
from dynamics.membrane.strains import strains
from dynamics.membrane.work_space import initial_state, work_space
from dynamics.sail.sectors import check_place
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable

#: Steps a kernel call: long against a call's cost, short against a checkpoint's interval.
CHUNK = 512
#: Most steps that are timed at once, and seconds after which it is enough.
MOST, ENOUGH = 512, 0.1
#: Part of the fingerprint of a checkpoint, as are the compiled sources: raise it when this module gives other numbers.
SCHEMA = 6
REASONS = {
    failure.INTACT: "finished",
    failure.TENSILE: "tensile_failure",
    failure.THERMAL: "thermal_failure",
    failure.LEFT_TABLE: "left_table",
    failure.FLY_AWAY: "fly_away",
    failure.NON_FINITE: "non_finite",
    failure.BROKEN: "broken",
    failure.BEYOND: "beyond_scheme",
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
        self.work: WorkSpace = work_space(self.model, threads)
        # What a later run needs, which may have another number of threads
        self._kept = without(self.work._replace(stencil=kept(self.work.stencil)), self.model)
        self._others = ThreadPoolExecutor(threads)
        if threads > 1:
            # Compiled here, where it may fail: the first thread would wait without end for one that never starts
            dismiss(self.work.stencil.scratch.board)
            self._assist(1)
        self.corotating = self.membrane.corotating
        self.corotating_work = None if self.corotating is None else corotating_work(self.corotating, self.model)
        self.step, self.fresh = 0, True
        self._wall, self._watch, self._saved = 0.0, Stopwatch(), Stopwatch()
        n = self.model.masses.size
        carried = (self.model.effects.tethers.mass.size, self.model.effects.tethers.body.size)
        width, self._more = record.WIDTH + tethers.width(*carried), tethers.payload_columns(*carried)
        self.journal = Journal(folder, width, 1 + 7 * n + self.work.effects.tearing.failed.size)
        self._rows = np.empty((CHUNK // self.model.series_every + 3, width))
        self._frame_steps = max(1, round(scene.flight.snapshot_every_s / self.model.dt))
        # The numbers that fly, too: they change with any edit of a material, the lattice or the mesh
        flying = [self.model, *([self.corotating] if self.corotating is not None else [])]
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
        parts += [self.corotating, self.corotating_work] if self.corotating is not None else []
        held = [found for part in parts for found in leaves(part)]
        arrays = [np.asarray(value) for name, value in held if not name.startswith("effects.light.tables.")]
        return sum({array.ctypes.data: array.nbytes for array in arrays if array.nbytes}.values())

    def resume(self) -> bool:
        """Go on from the checkpoint in the journal's folder, if there is one of this very flight."""
        counters = self.journal.restore(self._fingerprint, *self._trees())
        if counters is not None:
            self.step, self.fresh, self._wall = int(counters["step"]), bool(counters["fresh"]), counters["wall"]
            if self.corotating_work is not None and self.corotating_work.stiffer[0] > 1.0:
                self._stiffen(1.0)
        return counters is not None

    def checkpoint(self) -> None:
        """Save the state from which `resume` goes on."""
        counters = {"step": self.step, "fresh": self.fresh, "wall": self.wall_seconds}
        self.journal.save(self._fingerprint, counters, *self._trees())
        self._saved = Stopwatch()

    def fly(self) -> End:
        """To the end, with progress on standard error and checkpoints on the way."""
        name, every = self.membrane.scene.name, self.membrane.scene.flight.checkpoint_every_s
        before, after = step_seconds(self)
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
            release(self.membrane, self.state, self.work.effects.tethers)
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
        if code == failure.BEYOND and self._stiffen(2.0):
            code = failure.INTACT
        if code != failure.INTACT:
            return self._fail(code, before, start, fresh)
        if self.step == start:
            return None
        if self.step == self.model.release:
            release(self.membrane, self.state, self.work.effects.tethers)
            self.fresh = True
        if (self.step - self.model.release) % self._frame_steps == 0 or self.step == self.model.end:
            self._frame()
            if self._at_rest():
                return replace(self._end(failure.INTACT), reason="at_rest")
        return None

    def _at_rest(self) -> bool:
        """Has a held sail been at rest since the last snapshot, by the root mean square speed of its nodes."""
        held = self.membrane.scene.holding
        if held is None or held.rest_speed_m_s is None or self.step <= self.model.release + self._frame_steps:
            return False
        rows, row = self.journal.rows, record.COLUMNS
        since = (self.step - self._frame_steps - self.model.release) * self.model.dt
        lately = rows[rows[:, row["time"]] >= since, row["energy_kinetic"]]
        speed = np.sqrt(2.0 * lately.max(initial=0.0) / self.model.masses.sum())
        return bool(lately.size > 0 and speed < held.rest_speed_m_s)

    def _run(self, start: int, stop: int, fresh: bool) -> tuple[int, int, int]:
        """Steps from start to stop, with the other threads at their side: failure code, step reached, rows written."""
        work, model, board = self.work, self.model, self.work.stencil.scratch.board
        board[:] = 0
        try:
            others = [self._others.submit(self._assist, k) for k in range(1, work.stencil.scratch.bad.size)]
            if self.corotating is None:
                found = run(model, self.state, work, start, stop, fresh, self._rows)
            else:
                found = corotating_flight.run(
                    model, self.corotating, self.state, work, self.corotating_work, start, stop, fresh, self._rows
                )
        except BaseException:
            # The others would wait for work, and the process for them, without end
            dismiss(board)
            raise
        for other in others:
            other.result()
        return found

    def _stiffen(self, times: float) -> bool:
        """Take the sail for so many times as stiff across its plane as now; False where that is more than the most."""
        if self.corotating is None or self.corotating_work is None:
            return False
        stiffer, parts = times * float(self.corotating_work.stiffer[0]), self.membrane
        if stiffer > STIFFEST:
            return False
        self.corotating = corotating(parts.scene, parts.mesh, self.model.masses, self.model.dt, stiffer)
        self.corotating_work.stiffer[0] = stiffer
        return True

    def _assist(self, thread: int) -> None:
        """What one of the other threads does during a kernel call."""
        work, model = self.work, self.model
        light, held, gone = model.effects.light, work.effects.light, work.effects.tearing.gone
        assist(model.stencil, work.stencil, light, held, work.ahead, gone, thread)

    def _trees(self) -> list[Any]:
        """All that changes as the sail flies."""
        return [self.state, self._kept, *([self.corotating_work] if self.corotating_work is not None else [])]

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
        failed = self.work.effects.tearing.failed.astype(float)
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
            u, v = self.work.effects.light.direction
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
            if self.work.effects.tearing.gone.size:
                strain[failed > 0] = np.nan  # of a triangle that is no longer there
                slack = None if slack is None else np.where(failed > 0, 0.0, slack)
            yield Frame(
                float(numbers[0]), points, velocity.reshape(n, 3), temperature, strain, failed=flags, slack=slack
            )

    def columns(self) -> dict[str, tuple[Floats, str]]:
        """Columns (rows, ...) and units of the series."""
        cold = None if self.model.warm else self.membrane.scene.flight.start_temperature_K
        return series(np.asarray(self.journal.rows), cold, self._more)


def step_seconds(flight: Flight) -> tuple[float, float]:
    """Wall time in s of a step of the spin-up and of one in the light, with everything compiled."""
    after = _seconds_a_step(flight, max(flight.step, flight.model.release))
    return _seconds_a_step(flight, 0) if flight.step < flight.model.release else after, after


def _seconds_a_step(flight: Flight, start: int) -> float:
    """Wall time in s of a step from one on, renewals of light and heat shared out."""
    flight.rehearse(start, 1)
    count = min(MOST, max(8, flight.model.optics_every, flight.model.effects.heat.every))
    while True:
        spent = flight.rehearse(start, count)
        if count == MOST or spent * count > ENOUGH:
            return spent
        count = min(MOST, 4 * count)


def fly(scene: Scene, tables: dict[str, PressureTable]) -> tuple[Flight, End, dict[str, Floats]]:
    """Fly a scene without leaving a file: the flight, its end, and the columns (rows, ...) of its series."""
    check_place(scene, np.array(scene.release.offset_m))
    with tempfile.TemporaryDirectory() as folder:
        flight = Flight(scene, tables, Path(folder))
        end = flight.fly()
        return flight, end, {name: np.array(values) for name, (values, _) in flight.columns().items()}
