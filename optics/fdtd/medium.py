"""A cell as Meep takes it: blocks whose media hold ε∞ and the poles of `fdtd_poles` at every grid point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from beamrider.arrays import Complexes, Floats
from optics.cells.outline import Grating, depth_nm, polygons
from optics.fdtd.grid import Layout, half_spaces
from optics.fdtd.material import Averages, Material, tensor
from optics.fdtd.poles import passive, permittivity


def rows_of_material(cell: Grating, grid: Layout) -> tuple[int, int]:
    """Rows of pixels, from the centre of the grid: that of the back line, and one above all material."""
    bottom = round(grid.y_bottom / grid.pixel)
    return round(grid.y_back / grid.pixel - 0.5), bottom + 2 + int(np.ceil(depth_nm(cell) / 1000 / grid.pixel))


def first_column(n_x: int) -> int:
    """Where Meep's grid begins, in pixels from the centre: of an odd number one more lies to the right of it."""
    return -(n_x // 2)


def sampled(found: Material, grid: Layout, rows: tuple[int, int]) -> Averages:
    """What the points of one period see, in steps of half a pixel from Meep's first column and from the lowest row."""
    x = (np.arange(2 * grid.n_x) + 2 * first_column(grid.n_x)) * grid.pixel / 2
    y = np.arange(2 * rows[0], 2 * rows[1] + 1) * grid.pixel / 2
    return found.averages(x, y)


class Media:
    """Makes Meep's media for light of `frequency` (c/µm) on a time grid of step ωΔt.

    Without loss unless `absorb`. Tensors keep ε_XY only if `oblique`, and poles never do: Meep averages what E_X does
    to P_Y and E_Y to P_X over different neighbours, and fields grow without limit where absorption is strong (in ridges
    of index 3.5 + 2.7i twelve decades in 600 periods). The faces of ridges and layers do without, but for corners.
    """

    def __init__(self, mp: Any, frequency: float, step: float, absorb: bool, oblique: bool) -> None:
        self.mp, self.frequency, self.step, self.absorb, self.oblique = mp, frequency, step, absorb, oblique
        self._collisions: set[float] = set()

    def one(self, mean: complex, harmonic: complex, n_x: float = 0.0, n_y: float = 0.0) -> Any:
        """The medium of ε `harmonic` along the normal and `mean` across it."""
        both = (passive(np.asarray(e if self.absorb else e.real), self.step) for e in (mean, harmonic))
        infinity, free, lossy = (tensor(a, h, n_x, n_y) for a, h in zip(*both, strict=True))
        poles = [self._pole(strength, gamma) for strength, gamma in ((free, 0.0), (lossy, self.frequency))]
        across = (harmonic - mean).real * n_x * n_y if self.oblique else 0.0
        return self.mp.Medium(
            epsilon_diag=self.mp.Vector3(*infinity[:3]),
            epsilon_offdiag=self.mp.Vector3(across),
            E_susceptibilities=[pole for pole in poles if pole is not None],
        )

    def _pole(self, strength: Floats, gamma: float) -> Any:
        if not np.any(strength):
            return None
        self._collisions.add(gamma)
        return self.mp.DrudeSusceptibility(
            frequency=self.frequency, gamma=gamma, sigma_diag=self.mp.Vector3(*strength[:3])
        )

    def examples(self) -> list[Any]:
        """A medium with every pole that was made: Meep looks for poles in plain media only, not in a function's."""
        poles = [self.mp.DrudeSusceptibility(frequency=self.frequency, gamma=g, sigma=1.0) for g in self._collisions]
        return [self.mp.Medium(E_susceptibilities=poles)] if poles else []

    def of_points(self, seen: Averages) -> tuple[list[Any], list[list[int]]]:
        """All different media, and which of them each point (k, l) has: to make one takes Meep long."""
        points = np.stack([part.ravel() for part in seen], axis=-1).round(12)
        different, which = np.unique(points, axis=0, return_inverse=True)
        media = [self.one(mean, harmonic, n_x.real, n_y.real) for mean, harmonic, n_x, n_y in different]
        of_points: list[list[int]] = np.asarray(which).reshape(seen.mean.shape).tolist()  # type: ignore[assignment,unused-ignore]
        return media, of_points


def fit_error(cell: Grating, step: float) -> float:
    """Largest relative error of the permittivity that the poles give each material at the light's frequency."""
    every = np.array([*half_spaces(cell), *(epsilon for _, epsilon in polygons(cell))])
    return float((np.abs(permittivity(passive(every, step), step) - every) / np.abs(every)).max())


def geometry(media: Media, found: Material, seen: Averages, grid: Layout, rows: tuple[int, int]) -> list[Any]:
    """What lies behind the cell, and a block around the cell that knows the medium of every grid point."""
    mp, (low, high) = media.mp, rows
    every, which = media.of_points(seen)

    def medium(p: Any) -> Any:
        i, j = round(2 * p.x / grid.pixel) - 2 * first_column(grid.n_x), round(2 * p.y / grid.pixel) - 2 * low
        return every[which[i % (2 * grid.n_x)][j]]

    bottom = -grid.n_y // 2 - 1
    behind = _block(mp, bottom, low + 0.75, grid.pixel, media.one(found.back, found.back))
    return [behind, _block(mp, low + 0.25, high - 0.25, grid.pixel, medium)]


def _block(mp: Any, low: float, high: float, pixel: float, material: Any) -> Any:
    size, centre = (high - low) * pixel, (high + low) * pixel / 2
    return mp.Block(size=mp.Vector3(mp.inf, size, mp.inf), center=mp.Vector3(0, centre), material=material)


def dissipated(seen: Averages, fields: Sequence[Complexes | None], oblique: bool) -> float:
    """Σ E* Im ε E over the points of one period above the back line, in pixels, of E_X, E_Y, E_Z.

    Each (n_y, n_x) comes as Yee's grid holds it, with one column or row more than asked for on the sides where it is
    half a pixel off; None is zero. A row on the line itself counts half. With `oblique`, Im ε_XY too: E_X and E_Y meet
    in the corners of the pixels.
    """
    loss = tensor(seen.mean.imag, seen.harmonic.imag, seen.n_x, seen.n_y)
    n = seen.mean.shape[0] // 2
    e_x, e_y, e_z = fields
    total = 0.0
    if e_x is not None:
        total += (loss[1::2, 2::2, 0] * np.abs(e_x[1 : n + 1, 1:]) ** 2).sum()
    if e_y is not None:
        on_row = loss[0::2, 1::2, 1] * np.abs(e_y[:n, 1:-1]) ** 2
        total += on_row.sum() - on_row[:, 0].sum() / 2
    if e_z is not None:
        total += (loss[0::2, 2::2, 2] * np.abs(e_z[:n, 1:]) ** 2).sum()
    if oblique and e_x is not None and e_y is not None:
        x, y = (e_x[:n] + e_x[1 : n + 1]) / 2, (e_y[:n, :-1] + e_y[:n, 1:]) / 2
        total += 2 * (loss[0::2, 0::2, 3] * (x.conj() * y).real).sum()
    return float(total)
