"""Factorisation by nested dissection."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags, kron
from scipy.sparse.linalg import spsolve

from dynamics.membrane.stepping.dissection import solve_factorised
from dynamics.membrane.stepping.dissection_setup import dissect, factorise, solution_space
from dynamics.sail.mesh import Mesh, sail_mesh
from tests.membranes import small


def mesh(rings: int) -> Mesh:
    return sail_mesh(small(rings=rings).sail)


def grounded(found: Mesh, unknowns: int, rng: np.random.Generator) -> csr_matrix:
    """A matrix that is not symmetric, its symmetric part positive definite, with `unknowns` a node of the mesh."""
    n, (a, b) = len(found.nodes), found.edges.T
    joined = csr_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(n, n))
    laplacian = diags(np.asarray(joined.sum(axis=1)).ravel() + rng.uniform(0.1, 1.0, n)) - joined
    skew = rng.standard_normal((unknowns, unknowns))
    return csr_matrix(kron(laplacian, np.eye(unknowns) + 0.3 * (skew - skew.T)))


@pytest.mark.parametrize("unknowns", [1, 2])
@pytest.mark.parametrize("rings", [1, 3, 12])
def test_solution_is_that_of_a_sparse_solver(rings: int, unknowns: int):
    rng, found = np.random.default_rng(rings), mesh(rings)
    matrix = grounded(found, unknowns, rng)
    values = rng.standard_normal(matrix.shape[0])
    expected = spsolve(matrix.tocsc(), values)
    factor = factorise(matrix, found.nodes[:, :2])
    solve_factorised(factor, solution_space(factor), values)
    assert np.abs(values - expected).max() < 1e-12 * np.abs(expected).max()


def test_every_node_is_eliminated_once_and_halves_do_not_touch():
    found = mesh(12)
    n, (a, b) = len(found.nodes), found.edges.T
    graph = csr_matrix((np.ones(2 * len(a), dtype=np.int8), (np.r_[a, b], np.r_[b, a])), shape=(n, n))
    blocks = dissect(found.nodes[:, :2], graph)
    assert sorted(np.concatenate(blocks)) == list(range(n))
    assert len(blocks[-1]) <= 2 * 12 + 1  # no more than a row of the lattice parts the whole


def test_storage_grows_as_n_log_n():
    """Doubling the rings takes at most 4 log(4n)/log(n) times as many numbers."""
    sizes = []
    for rings in (10, 20, 40):
        found = mesh(rings)
        sizes.append(factorise(grounded(found, 1, np.random.default_rng(0)), found.nodes[:, :2]).numbers.size)
    nodes = [1 + 3 * rings + 3 * rings**2 for rings in (10, 20, 40)]
    for k in (1, 2):
        law = nodes[k] * np.log(nodes[k]) / (nodes[k - 1] * np.log(nodes[k - 1]))
        assert sizes[k] / sizes[k - 1] < 1.15 * law
