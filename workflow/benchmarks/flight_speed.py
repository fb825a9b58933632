"""Speed of flexible flight: a step by element and effect, growth with rings, memory, and the roofline of this machine.

The baselines run in the same process: a plain compiled loop over the edges, and one over the nodes with padded lists of
neighbours. Times are CPU times of one thread, the best of several; those by threads are wall times. Each effect that is
off is timed in turn with a sail that has not what it needs.

    python -m workflow.benchmarks.flight_speed --out flight_speed [--rings 30] [--largest 200] [--tables TE.h5 TM.h5]

writes flight_speed.csv and flight_speed.png (the roofline).
"""

from __future__ import annotations

import argparse
import csv
import math
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import numba
import numpy as np

from beamrider.io.files import atomic, run_stage
from dynamics.membrane.flight import Flight
from dynamics.membrane.layout import rows
from dynamics.membrane.output.record import WIDTH
from dynamics.membrane.stepping.step import run
from dynamics.membrane.stepping.threads import sweep_all
from dynamics.scene.schema import Scene, read_scene
from optics.table.pressure_table import PressureTable
from workflow.benchmarks.rows import seconds as best

SCENES = Path(__file__).parents[1] / "scenes"
#: How often flights that are compared are set up.
PLACES = 6
#: Of an evaluation of all elastic forces, of which the quickest counts.
REPEATS = 200
#: Doubles moved to or from the second cache and operations for each node in a step of the triangles: elements of two
#: families, positions and velocities before and after, with the lines that writing fetches first. From memory they come
#: once for all steps taken at once.
DOUBLES = 2 * (3 + 3 + 1 + 1) + 1 + 2 * (3 + 2 * 3)
FLOPS = 2 * 71 + 3 * 5 + 3 * 7


@numba.njit(cache=False, error_model="numpy")
def over_edges(x: Any, start: Any, end: Any, k: Any, free: Any, force: Any) -> None:
    """Springs as one writes them down first: one loop over the edges, that adds to both ends."""
    force[:] = 0.0
    for e in range(start.size):
        a, b = start[e], end[e]
        d0, d1, d2 = x[0, b] - x[0, a], x[1, b] - x[1, a], x[2, b] - x[2, a]
        pull = k[e] * (1.0 - free[e] / math.sqrt(d0 * d0 + d1 * d1 + d2 * d2))
        for c, d in ((0, d0), (1, d1), (2, d2)):
            force[c, a] += pull * d
            force[c, b] -= pull * d


@numba.njit(cache=False, error_model="numpy")
def over_nodes(x: Any, neighbours: Any, k: Any, free: Any, force: Any) -> None:
    """Springs node by node, with padded lists (d, n) of neighbours: each spring is computed twice."""
    x0, x1, x2, f0, f1, f2 = x[0], x[1], x[2], force[0], force[1], force[2]
    for i in range(f0.size):
        f0[i], f1[i], f2[i] = 0.0, 0.0, 0.0
    for j in range(neighbours.shape[0]):
        other, stiff, length = neighbours[j], k[j], free[j]
        for i in range(f0.size):
            d0, d1, d2 = x0[other[i]] - x0[i], x1[other[i]] - x1[i], x2[other[i]] - x2[i]
            square = d0 * d0 + d1 * d1 + d2 * d2
            pull = stiff[i] * (1.0 - length[i] / math.sqrt(square if square > 0.0 else 1.0))
            f0[i] += pull * d0
            f1[i] += pull * d1
            f2[i] += pull * d2


def padded(flight: Flight) -> tuple[Any, Any, Any]:
    """Neighbours, stiffness and free length (d, n) of every node; a node is its own neighbour where it has none."""
    springs, n = flight.model.effects.springs, flight.model.masses.size
    found: list[list[tuple[int, float, float]]] = [[] for _ in range(n)]
    for a, b, k, rest in zip(*(v.tolist() for v in springs[:4]), strict=True):
        found[a].append((b, k, rest))
        found[b].append((a, k, rest))
    depth = max(map(len, found))
    table = np.array([row + [(i, 0.0, 1.0)] * (depth - len(row)) for i, row in enumerate(found)])
    other, k, free = table.transpose(2, 1, 0)
    return other.astype(np.uint32), np.ascontiguousarray(k), np.ascontiguousarray(free)


def scene(base: Scene, rings: int, **groups: Any) -> Scene:
    """A scene with other rings, that writes no rows, and parts replaced."""
    data = base.model_dump()
    groups["sail"] = {"rings": rings, **groups.get("sail", {})}
    flight = {"series_every": 10**9, "optics_every": 10**4, "heat_every": 10**4, **groups.pop("flight", {})}
    for name, value in {"flight": flight, **groups}.items():
        data[name] = {**data[name], **value}
    return Scene.model_validate(data)


def dark(base: Scene, rings: int, **flight: Any) -> Scene:
    """No light and no heat: elasticity alone."""
    off = dict.fromkeys(("emission", "absorption", "conduction", "expansion", "thermal_failure"), False)
    return scene(base, rings, flight=flight, beam={"intensity_W_m2": 0.0}, effects=off)


def started(given: Scene, tables: dict[str, PressureTable]) -> Flight:
    """A flight that has been lit for some steps."""
    with tempfile.TemporaryDirectory() as folder:
        flight = Flight(given, tables, Path(folder))
    flight.state.x[...] *= 1.0 + 1e-5
    flight.step = flight.model.release + 16
    steps(flight, 16, True)
    return flight


def steps(flight: Flight, count: int, fresh: bool = False) -> None:
    """Fly so many steps; RuntimeError if the flight ends."""
    rows = np.empty((count // flight.model.series_every + 3, WIDTH))
    n = flight.step
    code, flight.step, _ = run(flight.model, flight.state, flight.work, n, n + count, fresh, rows)
    if code != 0:
        raise RuntimeError(f"the flight ended at step {flight.step} with code {code}")


def step_time(given: Scene, tables: dict[str, PressureTable], repeats: int = 40) -> float:
    """CPU seconds a step."""
    flight = started(given, tables)
    return best(lambda: steps(flight, 64), repeats) / 64


def elements(base: Scene, rings: int) -> list[tuple[str, float]]:
    """Seconds of all elastic forces, and of a whole elastic step, by several ways."""
    net, film = (started(dark(base, rings, stiffness=kind), {}) for kind in ("van_gelder", "triangles"))
    m, w, x = net.model, net.work, net.state.x
    out, lists = np.empty_like(x), padded(net)
    a, free = m.effects.springs, w.effects.springs.free
    quickest = partial(best, repeats=REPEATS)
    still = rows.StepTimes(False, 0.0, 0.0, 0.0, 0.0)
    p, q = film.model, film.work
    return [
        ("springs, plain loop over edges", quickest(lambda: over_edges(x, a.start, a.end, a.stiffness, free, out))),
        ("springs, padded lists of neighbours", quickest(lambda: over_nodes(x, *lists, out))),
        ("springs, stencil", quickest(lambda: sweep_all(m.stencil, w.stencil, 0, still))),
        ("triangles, stencil", quickest(lambda: sweep_all(p.stencil, q.stencil, 0, still))),
        ("step of springs", best(lambda: steps(net, 64), 40) / 64),
        ("step of triangles", best(lambda: steps(film, 64), 40) / 64),
    ]


def effects(base: Scene, rings: int, tables: dict[str, PressureTable]) -> list[tuple[str, float]]:
    """Seconds a step with light and heat, at several intervals."""
    return [
        (
            f"optics every {k}, heat every {k}, rows every {rows}",
            step_time(scene(base, rings, flight={"optics_every": k, "heat_every": k, "series_every": rows}), tables),
        )
        for k, rows in ((4, 8), (16, 64), (32, 64))
    ]


def intervals(base: Scene) -> dict[str, Any]:
    """How long a scene holds light and heat, and how often it writes a row."""
    return base.flight.model_dump(include={"optics_every", "heat_every", "series_every"})


#: What a material lacks for each effect.
LACKS: dict[str, dict[str, Any]] = {
    "absorption": {"absorptance": 0.0},
    "emission": {"emissivity_front": 0.0, "emissivity_back": 0.0},
    "conduction": {"conductivity_W_mK": 0.0},
    "expansion": {"expansion_1_K": 0.0},
    "tensile_failure": {"strength_Pa": 1e30},
    "thermal_failure": {"failure_temperature_K": 1e30},
}


def films(base: Scene, **material: Any) -> dict[str, Any]:
    """Sectors of constant reflectance instead of the gratings, with some properties of the material replaced."""
    kind = base.sail.sectors[0].properties.model_dump()
    return {"sectors": [{"from_deg": 0.0, "material": {**kind, **material}, "reflectance": 0.5}]}


def switched_off(base: Scene, rings: int, repeats: int = 40) -> list[tuple[str, float, float]]:
    """For each effect seconds a step with it switched off, and of a sail without what it needs, in turn, the best.

    Each is set up anew PLACES times: where its arrays happen to lie changes a step by up to a tenth.
    """
    calm = {"release": {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0}, "flight": intervals(base)}
    found = []
    for name, lacks in LACKS.items():
        least = [math.inf, math.inf]
        for _ in range(PLACES):
            pair = [
                started(
                    scene(base, rings, sail={**films(base, **material), "rings": rings}, **calm, effects={name: value}),
                    {},
                )
                for material, value in (({}, False), (lacks, None))
            ]
            for _ in range(repeats):
                for i, flight in enumerate(pair):
                    least[i] = min(least[i], best(lambda f=flight: steps(f, 64), 1))  # type: ignore[misc]
        found.append((name, least[0] / 64, least[1] / 64))
    return found


def by_threads(given: Scene, tables: dict[str, PressureTable]) -> list[float]:
    """Wall seconds a step with one thread and with two, in turn, the best of several; bytes a node with one."""
    with tempfile.TemporaryDirectory() as folder:
        flights = [Flight(given, tables, Path(folder) / str(threads), threads) for threads in (1, 2)]
        least = [math.inf, math.inf]
        for flight in flights:
            flight.step = flight.model.release
            flight.state.x[...] *= 1.0 + 1e-5
        count = 256 if flights[0].model.masses.size < 20_000 else 64
        for _ in range(12):
            for i, flight in enumerate(flights):
                start = time.perf_counter()
                code, flight.step, _ = flight._run(flight.step, flight.step + count, flight.fresh)
                least[i], flight.fresh = min(least[i], time.perf_counter() - start), False
                if code != 0:
                    raise RuntimeError(f"the flight ended at step {flight.step} with code {code}")
    return [*(seconds / count for seconds in least), flights[0].memory / flights[0].model.masses.size]


def growth(base: Scene, largest: int) -> list[tuple[int, int, float, float]]:
    """Rings, nodes, seconds an elastic step and bytes a node (`Flight.memory`)."""
    found = []
    for rings in (r for r in (10, 30, 60, 100, 200) if r <= largest):
        flight = started(dark(base, rings), {})
        seconds = best(lambda f=flight: steps(f, 64), 20) / 64  # type: ignore[misc]
        n = flight.model.masses.size
        found.append((rings, n, seconds, flight.memory / n))
    return found


@numba.njit(cache=False, error_model="numpy")
def triad(a: Any, b: Any, c: Any, times: int) -> None:
    """c = a + 3 b: two doubles in, one out, two operations."""
    for _ in range(times):
        for i in range(a.size):
            c[i] = a[i] + 3.0 * b[i]


@numba.njit(cache=False, error_model="numpy")
def polynomial(a: Any, times: int) -> None:
    """Two chains of 16 operations for each number of a small array."""
    for _ in range(times):
        for i in range(a.size):
            x = a[i]
            y, z = x * x + 0.5, x * 0.5 + 0.25
            y, z = y * x + 0.5, z * x + 0.5
            y, z = y * x + 0.5, z * x + 0.5
            y, z = y * x + 0.5, z * x + 0.5
            y, z = y * x + 0.5, z * x + 0.5
            y, z = y * x + 0.5, z * x + 0.5
            y, z = y * x + 0.5, z * x + 0.5
            y, z = y * x + 0.5, z * x + 0.5
            a[i] = (y - z) * 0.125


def machine() -> dict[str, float]:
    """Bytes a second from memory and from the second cache, operations a second."""
    large, small = np.ones((3, 4_000_000)), np.ones((3, 20_000))
    return {
        "memory": 24 * large.shape[1] / best(lambda: triad(*large, 1), 20),
        "cache": 24 * small.shape[1] * 20 / best(lambda: triad(*small, 20), 50),
        "flops": 34 * 2048 * 20 / best(lambda: polynomial(np.full(2048, 0.3), 20), 50),
    }


def roofline(found: dict[str, float], sizes: list[tuple[int, int, float, float]], path: Path) -> None:
    """The bounds of this machine, and elastic steps below them."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    intensity = np.geomspace(0.02, 20, 200)
    for name in ("memory", "cache"):
        axes.loglog(intensity, np.minimum(found["flops"], found[name] * intensity) / 1e9, label=f"bound of {name}")
    for rings, nodes, seconds, _ in sizes:
        speed = nodes * FLOPS / seconds / 1e9
        axes.plot(FLOPS / (8 * DOUBLES), speed, "o", fillstyle="none", label=f"{rings} rings: {speed:.1f}")
    axes.set(xlabel="operations a byte", ylabel="10⁹ operations a second", title="Elastic step, one core")
    axes.legend(fontsize="small")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)
    pyplot.close(figure)


def main() -> None:
    """Print ratios; write CSV and PNG."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tables", type=Path, nargs="*", default=[], help="pressure tables of fig6, for the effects")
    parser.add_argument("--rings", type=int, default=30)
    parser.add_argument("--largest", type=int, default=200)
    given = parser.parse_args()
    base = read_scene(SCENES / "fig6.yaml")
    rows: list[tuple[str, float, str]] = []
    tables = {table.name: table for table in map(PressureTable.read, given.tables)}
    measured = elements(base, given.rings)
    plain = measured[0][1]
    for name, seconds in [*measured, *(effects(base, given.rings, tables) if tables else [])]:
        rows.append((name, seconds * 1e6, "µs"))
        print(f"{name:45s} {seconds * 1e6:8.1f} µs   {plain / seconds:5.2f} times the plain loop's speed", flush=True)
    for name, off, without in switched_off(base, given.rings):
        rows += [(f"{name} off", off * 1e6, "µs"), (f"without {name}", without * 1e6, "µs")]
        print(f"{name + ' off':45s} {off * 1e6:8.1f} µs   {off / without:5.3f} of a sail without", flush=True)
    for rings in sorted({given.rings, given.largest}):
        lit = scene(base, rings, flight=intervals(base))
        cases = [("elastic", dark(base, rings), {}), ("all effects", lit, tables)]
        for name, case, needed in cases if tables else cases[:1]:
            one, two, held = by_threads(case, needed)
            rows.append((f"{rings} rings, {name}, memory", held, "bytes a node"))
            rows += [(f"{rings} rings, {name}, {k} threads", t * 1e6, "µs") for k, t in ((1, one), (2, two))]
            each = f"one thread {one * 1e6:.1f}, two {two * 1e6:.1f} µs: {one / two:.2f} ×, {held:.0f} B a node"
            print(f"{rings:4d} rings, {name}: {each}", flush=True)
    sizes = growth(base, given.largest)
    for rings, n, seconds, held in sizes:
        rows += [(f"{rings} rings, step", seconds * 1e6, "µs"), (f"{rings} rings, memory", held, "bytes a node")]
        each = f"{seconds / n * 1e9:.2f} ns and {held:.0f} B each"
        print(f"{rings:4d} rings {n:7d} nodes {seconds * 1e6:9.1f} µs, {each}", flush=True)
    found = machine()
    for name, value in found.items():
        rows.append((name, value, "1/s"))
        print(f"{name}: {value / 1e9:.1f} · 10⁹ {'operations' if name == 'flops' else 'bytes'} a second")
    roofline(found, sizes, given.out.with_suffix(".png"))
    with atomic(given.out.with_suffix(".csv")) as temporary, Path(temporary).open("w", newline="") as file:
        csv.writer(file).writerows([("quantity", "value", "unit"), *rows])


if __name__ == "__main__":
    run_stage(main)
