"""Where the numbers of a pressure table lie in the two plain arrays that `optics.table.lookup` reads."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers
from optics.table.hermite import Patches, Values
from optics.table.locate import HEADER, LINE, TableArrays
from optics.table.pole_tracks import Resonances
from optics.table.strips import Layout

# Coefficients begin where a cache line of memory does, in numbers.
_CACHE_LINE = 8
_PER_NODE = 4


def _line_table(layout: Layout) -> tuple[Floats, list[float]]:
    """Lines u = l₀ √(square₀ − v²) + l₁ √(square₁ − v²) − l₂ (n + 1, 3), the last one at infinity, and both squares."""
    lines, curves = layout.lines, len(layout.lines) - 2
    squares = sorted(set(lines.index[:curves] ** 2)) or [lines.index[-1] ** 2]
    if len(squares) > 2:
        raise ValueError("cutoff_index holds more than two refractive indices; there are two half-spaces")
    table = np.zeros((len(lines) + 1, LINE))
    table[:curves, 0] = lines.sign[:curves] * (lines.index[:curves] ** 2 == squares[0])
    table[:-1, 1] = lines.sign - table[:-1, 0]
    table[:, 2] = np.append(lines.shift, -np.inf)
    return table, [squares[0], squares[-1]]


def _node_table(nodes: Floats) -> Floats:
    """Node, width of the interval on its right and the reciprocal of that (n, 3); the last node is at infinity."""
    width = np.append(np.diff(nodes), 1.0)
    return np.stack([np.append(nodes[:-1], np.inf), width, 1.0 / width], axis=1)


def _buckets(nodes: Floats, count: int, scale: float) -> Integers:
    """The last node that lies in a bucket before, for each of the buckets int((x − nodes[0]) scale)."""
    bucket = np.minimum((nodes[:-1] - nodes[0]) * scale, count - 1.0).astype(np.int64)
    return np.maximum(np.searchsorted(bucket, np.arange(count)) - 1, 0)


class _Parts:
    """Parts of an array, one after the other."""

    def __init__(self, header: int) -> None:
        self.parts: list[NDArray[Any]] = [np.zeros(header)]
        self.size = header

    def add(self, part: NDArray[Any]) -> int:
        """Where the part (...) begins, once it is added."""
        self.parts.append(part.ravel())
        self.size += part.size
        return self.size - part.size


def _lines_of_slabs(layout: Layout) -> Integers:
    """Lines from left to right in each slab (n_slabs, most); the one at infinity fills the rest."""
    rows = np.full((len(layout.slabs), 1 + max(len(slab) for slab in layout.slabs)), len(layout.lines))
    for row, slab in zip(rows, layout.slabs, strict=True):
        row[: len(slab) + 1] = [*(layout.strips[k].left for k in slab), layout.strips[slab[-1]].right]
    return rows


def _add_taus(numbers: _Parts, places: _Parts, patches: list[Patches]) -> list[list[int]]:
    """Where the nodes of τ of each strip and their buckets begin, and how many buckets; strips of a lane share them."""
    found: dict[bytes, list[int]] = {}
    for tau in (patch.tau for patch in patches):
        if tau.tobytes() not in found:
            count = _PER_NODE * tau.size
            held = numbers.add(_node_table(tau)), places.add(_buckets(tau, count, float(count)))
            found[tau.tobytes()] = [*held, count]
    return [found[patch.tau.tobytes()] for patch in patches]


def _add_strips(numbers: _Parts, places: _Parts, layout: Layout, patches: list[Patches], k: int) -> int:
    """Where the strips begin, slab by slab, the last of a slab repeated until all slabs are as long: see `STRIP`."""
    taus = _add_taus(numbers, places, patches)
    numbers.add(np.zeros(-numbers.size % _CACHE_LINE))
    rows = [
        [*tau, numbers.add(patch.values) - patch.strip.first * 4 * k, patch.values[0].size]
        for tau, patch in zip(taus, patches, strict=True)
    ]
    most = max(len(slab) for slab in layout.slabs)
    return places.add(np.array([rows[k] for slab in layout.slabs for k in (*slab, *[slab[-1]] * (most - len(slab)))]))


def _aligned(parts: _Parts) -> Floats:
    """The parts in one array that begins where a cache line does."""
    room = np.empty(parts.size + _CACHE_LINE)
    skip = -(room.ctypes.data // room.itemsize) % _CACHE_LINE
    return np.concatenate(parts.parts, out=room[skip : skip + parts.size])


def pack(
    layout: Layout,
    values: Values,
    patches: list[Patches],
    axisymmetric: bool,
    nearest: bool,
    resonances: Resonances | None = None,
) -> TableArrays:
    """Plain arrays of a table; `nearest`: to be looked up at its nearest node. The resonances are added to the rest."""
    k, v, numbers, places = values.nodes.shape[0], values.v, _Parts(HEADER), _Parts(HEADER)
    lines, squares = _line_table(layout)
    of_slabs = _lines_of_slabs(layout)
    many = _PER_NODE * v.size
    per_v = many / (v[-1] - v[0])
    slab = np.searchsorted(layout.slab_first, np.arange(v.size - 1), side="right") - 1
    parity = np.ones(k) if values.parity is None else values.parity
    header = [
        k,
        of_slabs.shape[1],
        numbers.add(_node_table(v)),
        numbers.add(lines[of_slabs]),
        numbers.add(parity),
        places.add(_buckets(v, many, per_v)),
        many,
        places.add(slab),
        _add_strips(numbers, places, layout, patches, k),
        values.parity is not None,
        layout.curved,
    ]
    if resonances is not None and resonances.count:
        header += [resonances.count, numbers.add(resonances.packed), resonances.v.size]
    places.parts[0][: len(header)] = header
    numbers.parts[0][:7] = [*squares, *-layout.lines.shift[-2:], v[0], v[-1], per_v]
    return TableArrays(_aligned(numbers), np.concatenate(places.parts).astype(np.int64), axisymmetric, nearest)
