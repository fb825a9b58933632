"""Nearest hit of a ray among triangles, by a balanced tree of boxes whose boxes follow the moving triangles.

The tree is built once from the shape at rest: halves of equal count along the longest side of their box. Node i of the
heap has children 2i + 1 and 2i + 2; leaf k holds a run of `order`. Ties go to the lower triangle: the same bits on
every run, and the same hit as by asking every triangle.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats, Indices, Integers

#: Triangles a leaf, at most.
LEAF = 4
#: Share of a triangle's barycentric coordinates by which a ray may miss it: none slips through between two.
SLACK = 1e-12


class Tree(NamedTuple):
    """order (t,): triangles leaf by leaf; bounds (leaves + 1,): where each leaf starts in it."""

    order: Integers
    bounds: Integers


def build_tree(centres: Floats) -> Tree:
    """The tree over triangles with centres (t, 3) at rest."""
    leaves = 1
    while leaves * LEAF < len(centres):
        leaves *= 2
    order = np.arange(len(centres))
    bounds = np.arange(leaves + 1) * len(centres) // leaves
    width = leaves
    while width > 1:
        for first in range(0, leaves, width):
            begin, end = bounds[first], bounds[first + width]
            here = order[begin:end]
            axis = int(np.argmax(np.ptp(centres[here], axis=0)))
            order[begin:end] = here[np.lexsort((here, centres[here, axis]))]
        width //= 2
    return Tree(order, bounds)


@numba.njit(cache=True, error_model="numpy")
def refit(tree: Tree, x: Floats, corners: Indices, boxes: Floats) -> None:
    """Write boxes (2·leaves − 1, 6): lowest and highest x, y, z of each node of the heap, at nodes x (3, n)."""
    leaves = tree.bounds.size - 1
    for k in range(leaves):
        box = boxes[leaves - 1 + k]
        for c in range(3):
            box[c], box[3 + c] = np.inf, -np.inf
        for at in range(tree.bounds[k], tree.bounds[k + 1]):
            for j in range(3):
                node = corners[j, tree.order[at]]
                for c in range(3):
                    box[c] = min(box[c], x[c, node])
                    box[3 + c] = max(box[3 + c], x[c, node])
    for i in range(leaves - 2, -1, -1):
        for c in range(3):
            boxes[i, c] = min(boxes[2 * i + 1, c], boxes[2 * i + 2, c])
            boxes[i, 3 + c] = max(boxes[2 * i + 1, 3 + c], boxes[2 * i + 2, 3 + c])


@numba.njit(cache=True, error_model="numpy")
def enters(box: Floats, origin: Floats, inverse: Floats, far: float) -> float:
    """Distance at which a ray enters a box (6,), inf if it misses it or enters beyond `far` (Kay & Kajiya, 1986)."""
    first, last = 0.0, far
    for c in range(3):
        a = (box[c] - origin[c]) * inverse[c]
        b = (box[3 + c] - origin[c]) * inverse[c]
        first = max(first, min(a, b))
        last = min(last, max(a, b))
    # A rim of rounding, so that a flat box is not missed
    return first if first <= last * (1.0 + 1e-12) + 1e-300 else np.inf


@numba.njit(cache=True, error_model="numpy")
def meets(x: Floats, corners: Indices, i: int, origin: Floats, direction: Floats) -> float:
    """Distance along a ray to triangle i, from either side; inf if it misses.

    Möller & Trumbore, J. Graphics Tools 2 (1997) 21.
    """
    p, q, s = corners[0, i], corners[1, i], corners[2, i]
    a0, a1, a2 = x[0, q] - x[0, p], x[1, q] - x[1, p], x[2, q] - x[2, p]
    b0, b1, b2 = x[0, s] - x[0, p], x[1, s] - x[1, p], x[2, s] - x[2, p]
    h0 = direction[1] * b2 - direction[2] * b1
    h1 = direction[2] * b0 - direction[0] * b2
    h2 = direction[0] * b1 - direction[1] * b0
    volume = a0 * h0 + a1 * h1 + a2 * h2
    if volume == 0.0:
        return np.inf
    o0, o1, o2 = origin[0] - x[0, p], origin[1] - x[1, p], origin[2] - x[2, p]
    u = (o0 * h0 + o1 * h1 + o2 * h2) / volume
    k0, k1, k2 = o1 * a2 - o2 * a1, o2 * a0 - o0 * a2, o0 * a1 - o1 * a0
    v = (direction[0] * k0 + direction[1] * k1 + direction[2] * k2) / volume
    if not (u >= -SLACK and v >= -SLACK and u + v <= 1.0 + SLACK):
        return np.inf
    return (b0 * k0 + b1 * k1 + b2 * k2) / volume


@numba.njit(cache=True, error_model="numpy")
def nearest(
    tree: Tree,
    boxes: Floats,
    x: Floats,
    corners: Indices,
    origin: Floats,
    direction: Floats,
    own: int,
    least: float,
    gone: Integers,
    stack: Integers,
    inverse: Floats,
) -> tuple[int, float]:
    """Triangle that a ray meets first, beyond the distance `least` and other than `own`, and the distance; −1 if none.

    gone (t,): not 0 for triangles that light passes, or empty. Work space: stack, at least as long as the tree is deep
    plus two, and inverse (3,).
    """
    leaves = tree.bounds.size - 1
    for c in range(3):
        inverse[c] = 1.0 / direction[c] if abs(direction[c]) > 1e-150 else np.copysign(1e150, direction[c])
    found, far = -1, np.inf
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        i = stack[depth]
        if not enters(boxes[i], origin, inverse, far) < np.inf:
            continue
        if i < leaves - 1:
            left, right = 2 * i + 1, 2 * i + 2
            swap = enters(boxes[left], origin, inverse, far) <= enters(boxes[right], origin, inverse, far)
            stack[depth], stack[depth + 1] = (right, left) if swap else (left, right)
            depth += 2
            continue
        k = i - (leaves - 1)
        for at in range(tree.bounds[k], tree.bounds[k + 1]):
            j = tree.order[at]
            if j == own or (gone.size > 0 and gone[j] != 0):
                continue
            distance = meets(x, corners, j, origin, direction)
            if distance > least and (distance < far or (distance == far and j < found)):
                found, far = j, distance
    return found, far
