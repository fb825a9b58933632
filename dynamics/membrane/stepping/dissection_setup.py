"""Factorisation of sparse matrices on a sail's nodes by nested dissection, for `dynamics.membrane.stepping.dissection`.

The nodes are halved again and again along the direction that leaves the fewest nodes between the halves (George, SIAM
J. Numer. Anal. 10 (1973) 345). Halves are eliminated before what separates them, as dense fronts (Duff & Reid, ACM
Trans. Math. Softw. 9 (1983) 302). On n nodes of a sheet, storage and solution grow as n log n.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from beamrider.arrays import Floats, Integers
from dynamics.membrane.stepping.dissection import Factor, Solution

#: Nodes up to which a part is not halved any more: the fastest at 30 rings.
LEAF = 16
#: Directions along which a part may be halved.
ANGLES = np.radians(np.arange(0.0, 180.0, 15.0))


def _halves(part: Integers, points: Floats, graph: csr_matrix) -> tuple[Integers, Integers, Integers]:
    """Two halves (·,) of the nodes of a part (m,), at points (n, 2), and the fewest nodes (·,) that separate them."""
    best: tuple[Integers, Integers, Integers] | None = None
    side = np.zeros(graph.shape[0], dtype=np.int8)
    for angle in ANGLES:
        order = part[np.argsort(points[part] @ [np.cos(angle), np.sin(angle)], kind="stable")]
        first, second = order[: order.size // 2], order[order.size // 2 :]
        side[second] = 1
        between = first[graph[first] @ side > 0]
        side[second] = 0
        if best is None or between.size < best[2].size:
            best = np.setdiff1d(first, between), np.sort(second), np.sort(between)
    assert best is not None
    return best


def dissect(points: Floats, graph: csr_matrix) -> list[Integers]:
    """Blocks of nodes in the order of elimination, of nodes at points (n, 2) joined by graph (n, n)."""
    blocks: list[Integers] = []
    parts = [(np.arange(len(points)), False)]
    while parts:
        part, whole = parts.pop()
        if part.size == 0:
            continue
        if whole or part.size <= LEAF:
            blocks.append(part)
            continue
        first, second, between = _halves(part, points, graph)
        parts += [(between, True), (second, False), (first, False)]
    return blocks


def _touched(begin: Integers, matrix: csr_matrix) -> tuple[list[Integers], list[list[int]]]:
    """Later places that each block touches, matrix (n, n) being in the order of elimination, and its children."""
    rows: list[Integers] = []
    children: list[list[int]] = [[] for _ in range(begin.size - 1)]
    for k in range(begin.size - 1):
        near = matrix.indices[matrix.indptr[begin[k]] : matrix.indptr[begin[k + 1]]]
        found = np.unique(np.concatenate([near, *(rows[c] for c in children[k])]))
        rows.append(found[found >= begin[k + 1]].astype(np.int64))
        if rows[k].size:
            children[int(np.searchsorted(begin, rows[k][0], side="right")) - 1].append(k)
    return rows, children


def _front(matrix: csr_matrix, columns: csr_matrix, own: Integers, rows: Integers) -> Floats:
    """The entries of `matrix` that meet a block's own places, as a dense matrix on its own and later places."""
    places = np.concatenate([own, rows])
    front = np.zeros((places.size, places.size))
    front[: own.size] = matrix[own][:, places].toarray()
    front[own.size :, : own.size] = columns[own][:, rows].toarray().T
    return front


def factorise(matrix: csr_matrix, points: Floats) -> Factor:
    """Block LU factors, without pivoting, of matrix (dn, dn), d unknowns a node, node by node, at points (n, 2).

    Its entries must be as many as those of its transpose, its symmetric part positive definite.
    """
    n = len(points)
    d = matrix.shape[0] // n
    cells = matrix.tocoo()
    graph = csr_matrix((np.ones(cells.nnz, dtype=np.int8), (cells.row // d, cells.col // d)), shape=(n, n))
    blocks = dissect(points, graph)
    order = (d * np.concatenate(blocks)[:, None] + np.arange(d)).ravel()
    begin = d * np.cumsum([0, *(len(block) for block in blocks)])
    matrix = matrix[order][:, order].tocsr()
    matrix.sort_indices()
    columns = matrix.T.tocsr()
    rows, children = _touched(begin, matrix)
    updates: dict[int, Floats] = {}
    numbers = []
    for k in range(begin.size - 1):
        own = np.arange(begin[k], begin[k + 1])
        front, places = _front(matrix, columns, own, rows[k]), np.concatenate([own, rows[k]])
        for child in children[k]:
            where = np.searchsorted(places, rows[child])
            front[np.ix_(where, where)] += updates.pop(child)
        s = own.size
        inverse = np.linalg.inv(front[:s, :s])
        lower, upper = front[s:, :s] @ inverse, inverse @ front[:s, s:]
        updates[k] = front[s:, s:] - lower @ front[:s, s:]
        numbers.append(np.concatenate([inverse.T.ravel(), lower.T.ravel(), upper.T.ravel()]))
    return Factor(
        order=order,
        begin=begin,
        rows=np.concatenate(rows),
        first_row=np.cumsum([0, *(len(r) for r in rows)]),
        numbers=np.concatenate(numbers),
        first_number=np.cumsum([0, *(len(x) for x in numbers)]),
        widest=max(int(np.diff(begin).max()), *(len(r) for r in rows)),
    )


def solution_space(factor: Factor) -> Solution:
    """Work space for a factor."""
    return Solution(np.zeros(factor.order.size), np.zeros(factor.widest), np.zeros(factor.widest))
