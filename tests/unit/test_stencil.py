"""The stencil gives the forces that lists of neighbours give, on every outline and for every kind of element."""

from pathlib import Path

import numpy as np
import pytest

from dynamics.kernels import elastic, optical, sheet, stencil, triangles
from dynamics.membrane import Flight
from dynamics.shapes import lattice_points
from tests.membranes import dark, film

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


def both(flight: Flight, x: np.ndarray) -> tuple[np.ndarray, int, np.ndarray, int]:
    """Forces (3, n) in N on nodes x (3, n) and number of failures, by the stencil and by lists."""
    m, w = flight.model, flight.work
    fast, slow = np.empty_like(x), np.empty_like(x)
    count = stencil.pull(m.stencil, w.stencil, x)
    stencil.accelerations(m.stencil, w.stencil, np.ones(x.shape[1]), fast)
    if flight.membrane.elastic_triangles:
        found = sheet.forces(m.sheet, w.sheet, m.springs, x, w.pull, slow)
    else:
        found = elastic.forces(m.springs, x, w.free, w.pull, slow)
    return fast, count, slow, found


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("kind", ["triangles", "van_gelder"])
@pytest.mark.parametrize("rings", [1, 5])
def test_forces_are_those_of_lists_of_neighbours(tmp_path: Path, outline: str, kind: str, rings: int):
    flight = Flight(dark(rings, sail={"outline": outline}, flight={"stiffness": kind}), {}, tmp_path)
    noise = np.random.default_rng(1).standard_normal(flight.model.rest.shape)
    for size in (1e-6, 1e-2):  # none torn, and many
        fast, count, slow, found = both(flight, flight.model.rest + size / rings * noise)
        assert count == found
        assert (count > 0) == (size > 1e-3)
        assert np.abs(fast - slow).max() < 1e-13 * np.abs(slow).max()
        assert np.abs(fast.sum(axis=1)).max() < 1e-13 * np.abs(fast).sum()


@pytest.mark.parametrize("kind", ["triangles", "van_gelder"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_node_that_is_not_finite_is_noticed(tmp_path: Path, kind: str, value: float):
    flight = Flight(dark(3, flight={"stiffness": kind}, effects={"tensile_failure": False}), {}, tmp_path)
    x = flight.model.rest.copy()
    assert both(flight, x)[1] == 0
    x[1, 7] = value
    assert both(flight, x)[1] > 0


@pytest.mark.parametrize("outline", OUTLINES)
def test_held_light_pushes_each_node_as_its_triangles_are_pushed(tmp_path: Path, outline: str):
    flight = Flight(dark(5, sail={"outline": outline, "sectors": film()}, beam={"intensity_W_m2": 1e9}), {}, tmp_path)
    m, w, rng = flight.model, flight.work, np.random.default_rng(0)
    x = m.rest + 1e-2 * rng.standard_normal(m.rest.shape)
    w.light.held[...] = rng.standard_normal(w.light.held.shape)
    pulled, pushed, total = np.empty_like(x), np.empty_like(x), np.zeros(3)
    stencil.pull(m.stencil, w.stencil, x)
    stencil.accelerations(m.stencil, w.stencil, np.ones(x.shape[1]), pulled)
    stencil.hold(m.stencil, w.light.held, w.stencil.held)
    stencil.push(m.stencil, w.stencil, 0.7, total)
    stencil.accelerations(m.stencil, w.stencil, np.ones(x.shape[1]), pushed)
    triangles.sides(x, m.triangles.corners, w.sides)
    optical.turn(w.light, w.sides, 0.7)
    want = np.zeros_like(x)
    for corner in m.triangles.corners:
        for c in range(3):
            np.add.at(want[c], corner, w.light.force[c, :-1])
    assert np.abs(pushed - pulled - want).max() < 1e-14 * np.abs(pulled).max() + 1e-13 * np.abs(want).max()
    assert np.abs(total - want.sum(axis=1)).max() < 1e-13 * np.abs(want).max()
