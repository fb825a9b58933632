"""A profile in steps through its depth: how the modal method takes walls that are slanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from beamrider.arrays import Floats
from optics.cells.outline import SLICES, Grating, Piece, corners, is_slanted, layer_at, pieces_of, upright
from optics.cells.schema import LamellarLayer, LamellarStack, Metagrating, Profile, Surroundings


class Walls(NamedTuple):
    """What is met along g at one depth of a profile.

    x (k,): walls in periods, ascending; epsilon (k,): permittivity to the right of each, or the only one (1,);
    cos_2, sin_2 (k,): of twice the angle of the wall's normal from g.
    """

    x: Floats
    epsilon: tuple[complex, ...]
    cos_2: Floats
    sin_2: Floats


@dataclass(frozen=True, eq=False)
class Slanted:
    """A profile as the modal method takes it where its walls aren't upright: in steps, `count` through its depth.

    reach: |u| and |v| of the many directions it will be asked for, if these are known (see `optics.modal.slabs`).
    """

    profile: Profile
    count: int
    reach: tuple[float, float] | None = None

    @cached_property
    def _key(self) -> tuple[str, int, tuple[float, float] | None]:
        return self.profile.model_dump_json(), self.count, self.reach

    def holds(self, u: Floats, v: Floats) -> bool:
        """Whether all directions u (n_u,), v (n_v,) are within its reach."""
        if self.reach is None:
            return False
        return bool((np.abs(u) <= self.reach[0]).all() and (np.abs(v) <= self.reach[1]).all())

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Slanted) and self._key == other._key

    @property
    def name(self) -> str:
        """Of the profile."""
        return self.profile.name

    @property
    def electric_axis(self) -> str:
        """Of the profile."""
        return self.profile.electric_axis

    @property
    def surroundings(self) -> Surroundings:
        """Of the profile."""
        return self.profile.surroundings

    @property
    def pitch(self) -> float:
        """λ/d of the profile."""
        return self.profile.pitch

    @property
    def wavelength_nm(self) -> float:
        """Of the profile."""
        return self.profile.wavelength_nm

    def _patterned(self) -> tuple[list[float], list[LamellarLayer]]:
        """Depths in nm that steps may not straddle, to the end of the last patterned part; what lies behind it."""
        levels = corners(self.profile).tolist()
        pieces, behind = pieces_of(self.profile), list[LamellarLayer]()
        while len(levels) > 2:
            last = layer_at(self.profile, pieces, levels[-2], levels[-1])
            if last.ridges:
                break
            behind.insert(0, last)
            levels.pop()
        return levels, behind

    @property
    def behind(self) -> list[LamellarLayer]:
        """Homogeneous layers behind the steps."""
        return self._patterned()[1]

    def pairs(self) -> list[tuple[float, Walls, Walls]]:
        """Pairs of steps from the front, `count` steps in all: thickness in nm, and the walls at Gauss's two depths."""
        pieces, out = pieces_of(self.profile), []
        levels, _ = self._patterned()
        for a, b in pairwise(levels):
            cuts = np.linspace(a, b, 1 + int(np.ceil(self.count * (b - a) / (2 * self.profile.depth_nm))))
            for top, bottom in pairwise(cuts.tolist()):
                middle, apart = (top + bottom) / 2, (bottom - top) / np.sqrt(12.0)
                above, below = (walls_at(self.profile, pieces, middle + side * apart) for side in (-1, 1))
                out.append((bottom - top, above, below))
        return out


def walls_at(cell: Profile, pieces: Sequence[Piece], n: float) -> Walls:
    """The walls at depth n in nm."""
    layer = layer_at(cell, pieces, n, n)
    gap, period = layer.index.permittivity, cell.period_nm
    ends = np.unique([0.0, *(x for ridge in layer.ridges for x in (ridge.start_nm, ridge.start_nm + ridge.width_nm))])
    ends = ends[ends < period * (1 - 1e-12)]
    middles = (ends + np.append(ends[1:], period)) / 2
    epsilon = [
        next((r.index.permittivity for r in layer.ridges if r.start_nm < x < r.start_nm + r.width_nm), gap)
        for x in middles
    ]
    jumps = [k for k in range(ends.size) if epsilon[k] != epsilon[k - 1]]
    if not jumps:
        return Walls(np.empty(0), (epsilon[0],), np.empty(0), np.empty(0))
    angles = np.array([_twice_angle(pieces, ends[k], n, period) for k in jumps])
    return Walls(ends[jumps] / period, tuple(epsilon[k] for k in jumps), np.cos(angles), np.sin(angles))


def _twice_angle(pieces: Sequence[Piece], g: float, n: float, period: float) -> float:
    """Twice the angle of the normal of the wall at g, in depth n: of the last polygon with an edge there."""
    for vertices, _ in reversed(pieces):
        after = np.roll(vertices, -1, axis=0)
        passes = (vertices[:, 1] < n) != (after[:, 1] < n)
        start, along = vertices[passes], (after - vertices)[passes]
        at = start[:, 0] + along[:, 0] * (n - start[:, 1]) / along[:, 1]
        apart = np.abs((at - g + period / 2) % period - period / 2)
        if apart.size and apart.min() < 1e-9 * period:
            dg, dn = along[int(apart.argmin())]
            return float(2.0 * np.arctan2(-dg, dn))
    return 0.0


def modal_cell(cell: Grating, count: int = SLICES) -> Metagrating | LamellarStack | Slanted:
    """The cell as the modal method takes it, with `count` slices or steps where its walls aren't upright.

    Rounded corners, which are small, become slices; profiles with slanted walls are taken in steps.
    """
    if isinstance(cell, Profile) and any(is_slanted(cell, (a + b) / 2) for a, b in pairwise(corners(cell))):
        return Slanted(cell, count)
    return upright(cell, count)


ModalCell = Metagrating | LamellarStack | Slanted


def source(cell: Grating | Slanted) -> Grating:
    """The cell as it was given."""
    return cell.profile if isinstance(cell, Slanted) else cell
