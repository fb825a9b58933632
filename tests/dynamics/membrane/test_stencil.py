"""The stencil gives the forces that lists of neighbours give, on every outline and for every kind of element."""

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynamics.membrane import flight as membrane
from dynamics.membrane.effects import failure, sheet
from dynamics.membrane.flight import Flight
from dynamics.membrane.layout import rows
from dynamics.membrane.layout.sweep import add_up
from dynamics.membrane.row_layout import scratch_space
from dynamics.membrane.stepping.threads import dismiss
from dynamics.sail.shapes import lattice_points
from dynamics.scene.schema import Scene
from tests.membranes import dark, edge_forces, film, small, stencil_forces

OUTLINES = ["round", "hexagonal", "square"]


@pytest.mark.parametrize("outline", OUTLINES)
def test_neighbours_in_the_mesh_are_neighbours_in_the_lattice(tmp_path: Path, outline: str):
    mesh = Flight(dark(4, sail={"outline": outline}), {}, tmp_path).membrane.mesh
    points = lattice_points(outline, 4)
    assert len(np.unique(points, axis=0)) == len(mesh.nodes)
    a, b = mesh.edges.T
    apart = points[b] - points[a]
    assert np.abs(apart).max() == 1
    if outline != "square":  # three directions, and their opposites
        assert not np.any(apart[:, 0] * apart[:, 1] > 0)


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("kind", ["triangles", "van_gelder"])
@pytest.mark.parametrize("rings", [1, 5, 8])
def test_forces_are_those_of_the_edges(tmp_path: Path, outline: str, kind: str, rings: int):
    flight = Flight(dark(rings, sail={"outline": outline}, flight={"stiffness": kind}), {}, tmp_path)
    noise = np.random.default_rng(1).standard_normal(flight.model.rest.shape)
    for size in (1e-6, 1e-2):  # none torn, and many
        x = flight.model.rest + size / rings * noise
        fast, count = stencil_forces(flight, x)
        slow = edge_forces(flight, x)
        assert (count > 0) == (size > 1e-3)
        assert np.abs(fast - slow).max() < 1e-13 * np.abs(slow).max()
        assert np.abs(fast.sum(axis=1)).max() < 1e-13 * np.abs(fast).sum()


def test_no_triangle_tears_unless_the_stencil_says_it_may(tmp_path: Path):
    """Strains of every size and direction: whatever is above its strength is among those that may have failed."""
    flight, rng = Flight(dark(3), {}, tmp_path), np.random.default_rng(3)
    m, w, torn = flight.model, flight.work, 0
    for _ in range(300):
        stretch = np.eye(3) + rng.uniform(0.0, 0.1) * rng.uniform(-1.0, 1.0, (3, 3))
        x = np.ascontiguousarray(stretch @ m.rest)
        corners = m.triangles.corners
        fails = sheet.first_torn(m.effects.sheet, w.effects.sheet, m.stencil, w.stencil.free, corners, x)[0] >= 0
        torn += fails
        assert stencil_forces(flight, x)[1] > 0 or not fails
    assert 50 < torn < 250


@pytest.mark.parametrize("kind", ["triangles", "van_gelder"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_node_that_is_not_finite_is_noticed(tmp_path: Path, kind: str, value: float):
    flight = Flight(dark(3, flight={"stiffness": kind}, effects={"tensile_failure": False}), {}, tmp_path)
    x = flight.model.rest.copy()
    assert stencil_forces(flight, x)[1] == 0
    x[1, 7] = value
    assert stencil_forces(flight, x)[1] > 0


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("kind", ["triangles", "van_gelder"])
def test_held_light_pushes_each_node_as_its_triangles_are_pushed(tmp_path: Path, outline: str, kind: str):
    lit = {"beam": {"intensity_W_m2": 1e9}, "flight": {"stiffness": kind}}
    flight = Flight(dark(5, sail={"outline": outline, "sectors": film()}, **lit), {}, tmp_path)
    m, w, rng = flight.model, flight.work, np.random.default_rng(0)
    x = m.rest + 1e-2 * rng.standard_normal(m.rest.shape)
    held = rng.standard_normal((m.triangles.masses.size, 3))
    rows.hold(m.stencil, held, 0, 0, len(held), w.stencil.held)
    pulled, pushed, total = stencil_forces(flight, x)[0], stencil_forces(flight, x, 0.7)[0], np.zeros(3)
    add_up(w.stencil.scratch.sums[0], total)
    a, b, c = x.T[flight.membrane.mesh.triangles].transpose(1, 0, 2)
    force = held[:, :1] * (b - a) + held[:, 1:2] * (c - a) + held[:, 2:] * np.cross(b - a, c - a)
    want = np.zeros_like(x)
    for corner in m.triangles.corners:
        np.add.at(want.T, corner, 0.7 / 3.0 * force)
    assert np.abs(pushed - pulled - want).max() < 1e-14 * np.abs(pulled).max() + 1e-13 * np.abs(want).max()
    assert np.abs(total - want.sum(axis=1)).max() < 1e-13 * np.abs(want).max()


@pytest.mark.parametrize("stiffness", ["triangles", "van_gelder"])
@pytest.mark.parametrize("integrator", ["semi_implicit_euler", "verlet"])
def test_several_steps_at_once_are_the_same_steps_to_the_bit(tmp_path: Path, stiffness: str, integrator: str):
    """However a flight is cut into calls, and with one thread or two."""
    scene = small(
        sail={"sectors": film()},
        beam={"radius_m": 1.0},
        flight={"stiffness": stiffness, "integrator": integrator, "series_every": 50, "optics_every": 16},
    )
    ends = []
    for cut, threads in ((200, 1), (1, 1), (7, 1), (200, 2), (30, 2)):
        flight = Flight(scene, {}, tmp_path / f"{cut}_{threads}", threads)
        flight.step = flight.model.release
        flight.state.x[2] += 0.01 * flight.state.x[0]
        flight.state.v[:2] = -300.0 * flight.state.x[1], 300.0 * flight.state.x[0]
        last = flight.step + 200
        while flight.step < last:
            _, flight.step, _ = flight._run(flight.step, min(flight.step + cut, last), flight.fresh)
            flight.fresh = False
        ends.append([array.copy() for array in flight.state])
    for other in ends[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(ends[0], other, strict=True))


@pytest.mark.parametrize("rings", [1, 2, 3, 4, 8])
def test_sails_with_few_rows_a_thread_fly_alike(tmp_path: Path, rings: int):
    ends = []
    for threads in (1, 2, 5):
        beam = {"intensity_W_m2": 1e9, "radius_m": 4.0 if rings == 1 else 1.0}
        scene = dark(rings, sail={"sectors": film()}, beam=beam)
        flight = Flight(scene, {}, tmp_path / str(threads), threads)
        flight.step = flight.model.release
        flight.state.x[2] += 0.01 * flight.state.x[0]
        flight._run(flight.step, flight.step + 20, True)
        ends.append([array.copy() for array in flight.state])
    for other in ends[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(ends[0], other, strict=True))


def _glided(folder: Path, scene: Scene, levels: int, threads: int, growth: float) -> tuple[Any, ...]:
    """Codes and last steps of two calls of up to 40 steps, so many at once, and the state; growth: strain a step.

    The second call goes on from a failure: nothing of it may be left in the work space.
    """
    flight = Flight(scene, {}, folder, threads)
    model, work = flight.model, flight.work
    patches, _, patch = work.stencil.scratch.sides.shape
    scratch = scratch_space(model.stencil, model.lit, patch, patches, threads, levels)
    if threads == 1:
        assert scratch.sums.shape[0] == levels
    flight.work = work._replace(stencil=work.stencil._replace(scratch=scratch))
    flight.step = model.release
    flight.state.x[2] += 0.01 * flight.state.x[0]
    flight.state.v[:2] = -300.0 * flight.state.x[1], 300.0 * flight.state.x[0]
    flight.state.v[:2] += growth / model.dt * flight.state.x[:2]
    codes = []
    for _ in range(2):
        code, flight.step, _ = flight._run(flight.step, model.release + 40, flight.fresh)
        flight.fresh = False
        codes.append((code, flight.step - model.release))
    return (*codes, *(array.copy() for array in flight.state))


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("kind", ["triangles", "van_gelder"])
@pytest.mark.parametrize(("rings", "growth"), [(1, 0.0), (3, 0.0), (9, 0.0), (9, 3e-3), (9, 3.0)])
def test_steps_at_once_are_those_one_by_one_to_the_bit(
    tmp_path: Path, outline: str, kind: str, rings: int, growth: float
):
    """Also where an element tears amid them, or, where none can, numbers of triangles overflow."""
    scene = dark(
        rings,
        sail={"outline": outline, "sectors": film()},
        beam={"intensity_W_m2": 1e9, "radius_m": 4.0 if rings == 1 else 1.0},
        flight={"stiffness": kind, "optics_every": 32, "heat_every": 32, "series_every": 64},
        effects={"tensile_failure": growth < 1.0},
    )
    runs = [
        _glided(tmp_path / f"{levels}_{threads}", scene, levels, threads, growth)
        for levels, threads in ((1, 1), (2, 1), (5, 1), (8, 1), (2, 2), (1, 2))
    ]
    code, last = runs[0][0]
    expected = failure.INTACT if growth == 0.0 else failure.TENSILE if growth < 1.0 else failure.NON_FINITE
    assert code == (failure.INTACT if growth > 1.0 and kind != "triangles" else expected)
    assert last == 40 or 3 < last < 30
    for other in runs[1:]:
        assert other[:2] == runs[0][:2]
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(runs[0][2:], other[2:], strict=True))


def test_no_thread_waits_on_when_the_first_is_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    flight = Flight(dark(), {}, tmp_path, 2)
    monkeypatch.setattr(membrane, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        flight.advance()
    end = threading.Thread(target=flight._others.shutdown)
    end.start()
    end.join(10.0)
    waits = end.is_alive()
    dismiss(flight.work.stencil.scratch.board)
    assert not waits
