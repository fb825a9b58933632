"""What an effect is told when it is planned and set up, and what helps it to describe itself: see the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from beamrider.arrays import Floats, Integers
from beamrider.io.files import Strict
from dynamics.membrane.lattice import Lattice
from dynamics.sail.mesh import Mesh
from dynamics.scene.schema import Scene
from optics.table.pressure_table import PressureTable

#: Decorator of what an effect does in a step: copied into the step, so that models are not handed on as arguments.
hook = partial(numba.njit, inline="always")


class Decision(Strict):
    """One line of the plan: is the effect computed, why, and what that costs."""

    on: bool
    reason: str
    cost: str = "nothing"


Plan = dict[str, Decision]
#: From a scene and what is decided so far to the decision about an effect.
Decide = Callable[[Scene, Plan], Decision]


def needs_heat(decide: Decide) -> Decide:
    """The same, off where no heat comes or goes."""

    def decided(scene: Scene, so_far: Plan) -> Decision:
        if so_far["absorption"].on or so_far["emission"].on:
            return decide(scene, so_far)
        return Decision(on=False, reason="no heat comes or goes: the temperature stays uniform")

    return decided


#: How many numbers a column of the record takes, and their unit.
Columns = Mapping[str, tuple[int, str]]


@dataclass(frozen=True)
class Setup:
    """What effects are set up from: the scene, its tables by design, its plan, its mesh and lattice, dt in s."""

    scene: Scene
    tables: Mapping[str, PressureTable]
    plan: Plan
    mesh: Mesh
    lattice: Lattice
    dt: float

    def on(self, name: str) -> bool:
        """Is an effect of the plan computed."""
        return self.plan[name].on

    @property
    def warm(self) -> bool:
        """Does any effect need temperatures."""
        return any(map(self.on, ("absorption", "emission", "conduction", "expansion", "thermal_failure")))


def starts(columns: Columns) -> tuple[int, ...]:
    """Where each column begins in the part of a row that is theirs."""
    return tuple(accumulate([length for length, _ in columns.values()][:-1], initial=0))


def only_if(on: bool, values: Any) -> Floats:
    """The values (...), or nothing (0,) where an effect is off."""
    return np.ascontiguousarray(values, dtype=float) if on else np.empty(0)


def own(values: Any, changes: bool) -> Any:
    """Arrays to be changed in flight: copies, or, where nothing changes them, the model's."""
    return values.copy() if changes else values


def unsigned(values: Any) -> NDArray[np.uint32]:
    """Contiguous unsigned indices (...): compiled code need not test them for a negative sign."""
    return np.ascontiguousarray(values, dtype=np.uint32)


def slots(groups: Integers, size: int, positions: Integers, empty: int) -> NDArray[np.uint32]:
    """Padded lists (d, size): for each of `size` nodes the `positions` whose entry of `groups` is that node."""
    order = np.argsort(groups, kind="stable")
    counts = np.bincount(groups, minlength=size)
    rank = np.arange(groups.size) - np.repeat(np.cumsum(counts) - counts, counts)
    table = np.full((int(counts.max()), size), empty, dtype=np.uint32)
    table[rank, groups[order]] = positions[order]
    return table
