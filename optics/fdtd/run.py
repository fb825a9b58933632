"""One Meep run: a cell on a pixel grid, lit by a pulse, and the diffraction orders it sends out.

Meep's axes are X = g, Y = −n, Z = r (a proper rotation, as g × r = n): light runs towards −Y, ridges face +Y.

    ▒▒▒▒▒▒▒▒▒  absorber (PML)
    ─────────  current sheet, radiates the wanted plane wave
    - - - - -  front line: tangential E, H at the centre frequency
    ▔█▔▔▔█▔▔▔  ridges on the membrane
    - - - - -  back line
    ▒▒▒▒▒▒▒▒▒  absorber (PML)

Fields on the lines are split into diffraction orders. A plane wave of direction k carries momentum k/c per power, so
efficiencies give the force (Jackson, Classical Electrodynamics, §6.7). Order by order, the incident wave is subtracted
exactly. Maxwell's stress of the total field checks that: it carries the beat of incident and reflected wave, an error
of second order in the pixel that depends on the distance.

Meep is imported inside functions only: importing it switches denormal numbers off in the whole process.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamrider.arrays import Complexes, Floats
from beamrider.io.files import InputError
from optics.cells.outline import Grating
from optics.fdtd.grid import FdtdSettings, Layout
from optics.fdtd.material import material, nearly_transparent, weakly_absorbing
from optics.fdtd.medium import Media, dissipated, first_column, geometry, rows_of_material, sampled
from optics.fdtd.orders import Orders, grazing, leaving_orders, steepness
from optics.waves.incidence import electric_vector, wave_vector

HOW_TO_GET_MEEP = (
    "Meep is not installed: apt-get install python3-meep (Debian) or conda install -c conda-forge pymeep; "
    "the package 'meep' on PyPI is something else"
)

_STEP = 5  # periods between two looks at the amplitudes
# What an absorber sends back: of the flattest order's amplitude; at most of the power of a wave that meets it head on.
_SENT_BACK, _HEAD_ON = 1e-5, 1e-15
# A Gaussian of this width in units of w² is down to 4 %, exp(−(π w²/width)²/2), at the frequency of an order's cut-off.
_DARK = 1.25


def import_meep() -> Any:
    """The module `meep`, silent; InputError where it is missing or is PyPI's other package."""
    try:
        import meep
    except ImportError:
        raise InputError(HOW_TO_GET_MEEP) from None
    if not hasattr(meep, "Simulation"):
        raise InputError(HOW_TO_GET_MEEP)
    meep.verbosity(0)
    atexit.unregister(_silence)
    atexit.register(_silence)
    return meep


def _silence() -> None:
    """Meep tells its run time on standard output when the process ends: after the line that a stage ends with."""
    sys.stdout.flush()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


@dataclass(frozen=True)
class Decay:
    """How far a pulse had died away when the run was stopped.

    residual: relative change of the amplitudes that was still to come; capped: the run had reached its longest time.
    """

    residual: float
    capped: bool

    def worse(self, other: Decay) -> Decay:
        """That of two runs together."""
        return Decay(max(self.residual, other.residual), self.capped or other.capped)


def remaining(changes: list[float]) -> float:
    """What is still to come of a series whose last terms are `changes`, if it goes on as a geometric one.

    A single resonance rings down so: each step brings ρ times the change of the one before, and all that follow
    together ρ/(1 − ρ) times the last. Infinite while it does not fall.
    """
    if len(changes) < 4:
        return np.inf
    ratio = np.sqrt(changes[-1] / changes[-3]) if changes[-3] > 0 else 0.0
    return float(changes[-1] * ratio / (1 - ratio)) if ratio < 1 else np.inf


def reflection(smallest: float) -> float:
    """Meep's `R_asymptotic`, the power sent back of a wave at right angles, for orders of |w| ≥ `smallest`.

    Damping falls with w however thick the absorber is: a wave of w comes back with the amplitude R^(w/2) (Taflove &
    Hagness, Computational Electrodynamics, §7.5). Meep's own 1e-15 leaves 5 % of an order of w = 0.17.
    """
    return float(min(_HEAD_ON, _SENT_BACK ** (2 / smallest)))


def pulse_width(smallest: float, settings: FdtdSettings) -> float:
    """Width of the pulse as a share of its frequency, for orders at cosines to the normal |w|/n ≥ `smallest`.

    An order is cut off at a frequency lower by w²/2n². There its waves leave the cell as slowly as one likes: a pulse
    that holds them rings for long, so it is made narrow enough to hold 4 % of them, and lasts half of the longest time
    at most.
    """
    return min(settings.pulse_width, max(_DARK * smallest**2, 16 / settings.longest))


class Run:
    """A Meep simulation of the cell, or with `empty` of a strip one pixel wide of what is in front of it.

    The second is the same to a plane wave.
    """

    def __init__(
        self, cell: Grating, u: float, v: float, grid: Layout, settings: FdtdSettings, empty: bool = False
    ) -> None:
        self.mp = import_meep()
        self.cell, self.u, self.v, self.grid, self.settings, self.empty = cell, u, v, grid, settings, empty
        self.frequency = 1000 / cell.wavelength_nm
        self.front_index = cell.surroundings.front
        self.pulse_width = pulse_width(steepness(cell, u, v), settings)
        self.n_x = 1 if empty else grid.n_x
        self.width = self.n_x * grid.pixel
        self.rows = rows_of_material(cell, grid)
        self.step = 2 * np.pi * self.frequency * settings.courant * grid.pixel
        orders = leaving_orders(cell, u, v)
        keep = np.isclose(orders.u, u, atol=1e-12) if empty else np.ones(orders.u.size, bool)
        kept: list[Any] = [part[keep] for part in orders]
        self.orders = Orders(*kept)
        self.components = [self.mp.Ex, self.mp.Ez, self.mp.Hx, self.mp.Hz]
        self.material = material(cell, grid, settings.courant)
        with contextlib.redirect_stderr(io.StringIO()):  # a note on odd numbers of pixels, which are meant
            self.simulation = self._simulation()
            self.lines = [self._monitor(self.components, y, 0.0) for y in (grid.y_front, grid.y_back)]
            self.simulation.init_sim()

    def _simulation(self) -> Any:
        mp, grid, f = self.mp, self.grid, self.frequency
        absorber = mp.PML(
            grid.n_absorber * grid.pixel,
            direction=mp.Y,
            R_asymptotic=reflection(grazing(self.cell, self.u, self.v)),
            mean_stretch=2.0,  # without it slowly decaying near fields reach the end of the absorber, and grow there
        )
        media = Media(mp, f, self.step, not weakly_absorbing(self.cell), nearly_transparent(self.cell))
        self.seen = sampled(self.material, grid, self.rows)
        return mp.Simulation(
            cell_size=mp.Vector3(self.width, grid.n_y * grid.pixel),
            resolution=1 / grid.pixel,
            dimensions=2,
            default_material=media.one(self.material.front, self.material.front),
            geometry=[] if self.empty else self._geometry(media),
            extra_materials=media.examples(),
            sources=self._sources(),
            boundary_layers=[absorber],
            k_point=mp.Vector3(f * self.u, 0, f * self.v),
            kz_2d="complex",
            Courant=self.settings.courant,
            eps_averaging=False,  # `fdtd_material` does it
            ensure_periodicity=False,  # what lies behind the cell would come up again in the absorber in front of it
        )

    def _geometry(self, media: Media) -> list[Any]:
        return geometry(media, self.material, self.seen, self.grid, self.rows)

    def _sources(self) -> list[Any]:
        """Current sheet K = n × H of the wanted wave (Love's equivalence; Harrington, Time-Harmonic Fields, §3-5)."""
        mp, e = self.mp, electric_vector(self.u, self.v, self.cell.electric_axis, self.front_index)
        h = np.cross(wave_vector(self.u, self.v, self.front_index), e)
        current = np.cross([0.0, 0.0, 1.0], h)
        pulse = mp.GaussianSource(self.frequency, fwidth=self.pulse_width * self.frequency, cutoff=4)

        def phase(p: Any) -> complex:
            return complex(np.exp(2j * np.pi * self.frequency * self.u * p.x))

        return [
            mp.Source(
                pulse,
                component,
                center=mp.Vector3(0, self.grid.y_source),
                size=mp.Vector3(self.width),
                amplitude=amplitude,
                amp_func=phase,
            )
            for component, amplitude in ((mp.Ex, current[0]), (mp.Ez, current[1]))
            if abs(amplitude) > 1e-12
        ]

    def _monitor(self, components: list[Any], y: float, height: float) -> Any:
        where = self.mp.Volume(center=self.mp.Vector3(0, y), size=self.mp.Vector3(self.width, height))
        return self.simulation.add_dft_fields(components, self.frequency, 0, 1, where=where)

    def _period(self, monitor: Any) -> tuple[Floats, slice]:
        """Pixel centres x of one period on a monitor (Meep's arrays reach beyond it), and where in the array."""
        x = np.atleast_1d(np.asarray(self.simulation.get_array_metadata(dft_cell=monitor)[0]))
        start = (x.size - self.n_x) // 2
        one = slice(start, start + self.n_x)
        return x[one], one

    def _array(self, monitor: Any, component: Any) -> Complexes | None:
        """Fields of a component at pixel centres; None for one that symmetry keeps at zero."""
        array = np.asarray(self.simulation.get_dft_array(monitor, component, 0))
        return array if array.size > 1 else None

    def amplitudes(self, u_m: Floats | None = None) -> Complexes:
        """Amplitudes (2, 4, n) on the two lines of the orders `u_m` (n,), those that leave unless given.

        Meep averages E_Z and H_X over two neighbours along X to bring them to pixel centres, which multiplies a wave
        by cos(k_X pixel/2): undone here, so that the flux is the one that the Yee scheme conserves.
        """
        u_m = self.orders.u if u_m is None else u_m
        averaged = np.cos(np.pi * self.frequency * u_m * self.grid.pixel)
        out = np.zeros((2, 4, u_m.size), complex)
        for i, monitor in enumerate(self.lines):
            x, one = self._period(monitor)
            to_orders = np.exp(-2j * np.pi * self.frequency * u_m[:, None] * x) / x.size
            for j, component in enumerate(self.components):
                array = self._array(monitor, component)
                if array is not None:
                    out[i, j] = to_orders @ array[one] / (averaged if j in (1, 2) else 1.0)
        return out

    def _advance(self, time: float) -> None:
        """Step on by a time, in Meep's units; `Simulation.run` would spend a quarter as long again between steps."""
        fields = self.simulation.fields
        try:
            for _ in range(int(np.ceil(time / fields.dt))):
                fields.step()
        except RuntimeError as error:  # "simulation fields are NaN or Inf"
            raise InputError(self._unstable(str(error).removeprefix("meep: "))) from None

    def _unstable(self, what: str) -> str:
        return (
            f"{self.cell.name} at u = {self.u:g}, v = {self.v:g}: FDTD with {self.grid.n_x} pixels a period: {what}; "
            "lower 'courant', or use optics.modal"
        )

    def until_decayed(self) -> tuple[Complexes, Decay]:
        """Run until the amplitudes (...) stand still or the longest time is over; they, and what they still lack."""
        f, step = self.frequency, _STEP / self.frequency
        self.simulation.run(until=0)  # makes the monitors
        self._advance(8 / (self.pulse_width * f))  # the pulse: cutoff 4 on both sides
        before, changes, capped = self.amplitudes(), [np.inf], False
        while (residual := remaining(changes)) > self.settings.decay and not capped:
            self._advance(step)
            now = self.amplitudes()
            changes.append(float(np.abs(now - before).max() / np.abs(now).max()))
            before = now
            if not np.isfinite(changes[-1]):
                raise InputError(self._unstable("fields are not finite"))
            capped = self.simulation.meep_time() * f >= self.settings.longest
        return before, Decay(residual, capped)

    def monitor_heat(self) -> Callable[[], float]:
        """Start recording E between the lines; the function returned gives ∫ E* Im ε E dA there (µm²).

        E is taken where Yee's grid holds it, and ε as the grid has it (of weak absorption, as it would have it): the
        loss of the discrete fields. In the middle of a pixel E is known only to first order beside a face.
        """
        mp, (low, high), pixel = self.mp, self.rows, self.grid.pixel
        # Edges a quarter of a pixel off the points, so that rounding does not decide which of them belong to it.
        middle = first_column(self.n_x) + 0.25 + (self.n_x - 1) / 2
        where = mp.Volume(
            center=mp.Vector3(middle * pixel, (low + high) * pixel / 2),
            size=mp.Vector3((self.n_x - 1) * pixel, (high - low - 0.5) * pixel),
        )
        monitors = [
            self.simulation.add_dft_fields([c], self.frequency, 0, 1, where=where, yee_grid=True)
            for c in (mp.Ex, mp.Ey, mp.Ez)
        ]

        def integral() -> float:
            fields = [self._array(m, c) for m, c in zip(monitors, (mp.Ex, mp.Ey, mp.Ez), strict=True)]
            return dissipated(self.seen, fields, weakly_absorbing(self.cell)) * pixel**2

        return integral

    def close(self) -> None:
        """Free Meep's memory."""
        self.simulation.reset_meep()
