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

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from optics.fdtd_grid import FdtdSettings, Layout
from optics.fdtd_material import material, weakly_absorbing
from optics.files import InputError
from optics.incidence import Complexes, Floats, electric_vector, order_cosines, wave_vector
from optics.outline import Grating, depth_nm

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
    return meep


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


def propagating_orders(cell: Grating, u: float, v: float) -> tuple[Floats, Complexes]:
    """u_m and w_m (n,) of the orders that leave the cell in vacuum, ascending; the specular one is among them."""
    most = int(np.ceil(2 / cell.pitch))
    u_m, w_m = order_cosines(u, v, cell.pitch, np.arange(-most, most + 1))
    return u_m[w_m.real > 0], w_m[w_m.real > 0]


def grazing(cell: Grating, u: float, v: float) -> float:
    """Smallest |w| of the diffraction orders, propagating or evanescent."""
    most = int(np.ceil(2 / cell.pitch))
    return float(np.abs(order_cosines(u, v, cell.pitch, np.arange(-most, most + 1))[1]).min())


def reflection(smallest: float) -> float:
    """Meep's `R_asymptotic`, the power sent back of a wave at right angles, for orders of |w| ≥ `smallest`.

    Damping falls with w however thick the absorber is: a wave of w comes back with the amplitude R^(w/2) (Taflove &
    Hagness, Computational Electrodynamics, §7.5). Meep's own 1e-15 leaves 5 % of an order of w = 0.17.
    """
    return float(min(_HEAD_ON, _SENT_BACK ** (2 / smallest)))


def pulse_width(smallest: float, settings: FdtdSettings) -> float:
    """Width of the pulse as a share of its frequency, for orders of |w| ≥ `smallest`.

    An order is cut off at a frequency lower by w²/2. There its waves leave the cell as slowly as one likes: a pulse
    that holds them rings for long, so it is made narrow enough to hold 4 % of them, and lasts half of the longest time
    at most.
    """
    return min(settings.pulse_width, max(_DARK * smallest**2, 16 / settings.longest))


class Run:
    """A Meep simulation of the cell, or with `empty` of a strip of vacuum one pixel wide: the same to a plane wave."""

    def __init__(
        self, cell: Grating, u: float, v: float, grid: Layout, settings: FdtdSettings, empty: bool = False
    ) -> None:
        self.mp = import_meep()
        self.cell, self.u, self.v, self.grid, self.settings, self.empty = cell, u, v, grid, settings, empty
        self.frequency = 1000 / cell.wavelength_nm
        self.smallest = grazing(cell, u, v)
        self.pulse_width = pulse_width(self.smallest, settings)
        self.n_x = 1 if empty else grid.n_x
        self.width = self.n_x * grid.pixel
        self.bottom = round(grid.y_bottom / grid.pixel)
        self.material = material(cell, grid, settings.courant)
        u_m, w_m = propagating_orders(cell, u, v)
        keep = np.isclose(u_m, u, atol=1e-12) if empty else np.ones(u_m.size, bool)
        self.u_m, self.w_m = u_m[keep], w_m[keep]
        self.components = [self.mp.Ex, self.mp.Ez, self.mp.Hx, self.mp.Hz]
        with contextlib.redirect_stderr(io.StringIO()):  # a note on odd numbers of pixels, which are meant
            self.simulation = self._simulation()
            self.lines = [self._monitor(self.components, y, 0.0) for y in (grid.y_front, grid.y_back)]
            self.simulation.init_sim()

    def _simulation(self) -> Any:
        mp, grid, f = self.mp, self.grid, self.frequency
        absorber = mp.PML(
            grid.n_absorber * grid.pixel, direction=mp.Y, R_asymptotic=reflection(self.smallest),
            mean_stretch=2.0,  # without it slowly decaying near fields reach the end of the absorber, and grow there
        )
        return mp.Simulation(
            cell_size=mp.Vector3(self.width, grid.n_y * grid.pixel), resolution=1 / grid.pixel, dimensions=2,
            geometry=[] if self.empty else self._geometry(), sources=self._sources(), boundary_layers=[absorber],
            k_point=mp.Vector3(f * self.u, 0, f * self.v), kz_2d="complex", Courant=self.settings.courant,
            eps_averaging=False,  # `fdtd_material` does it
        )

    def _geometry(self) -> list[Any]:
        """A block around the cell that knows ε at every grid point. Weak absorption is left to perturbation theory."""
        grid, pixel = self.grid, self.grid.pixel
        low, high = self.bottom - 2, self.bottom + 2 + int(np.ceil(depth_nm(self.cell) / 1000 / pixel))
        x = (np.arange(2 * grid.n_x) - grid.n_x) * pixel / 2
        y = np.arange(2 * low, 2 * high + 1) * pixel / 2
        tensor = self.material.tensor(x, y)
        if weakly_absorbing(self.cell):
            tensor = tensor.real.astype(complex)
        # Most points share their tensor with others, and to make a medium takes Meep longer than many a time step.
        different, which = np.unique(tensor.reshape(-1, 4).round(12), axis=0, return_inverse=True)
        media = [self._medium(one) for one in different]
        at: Any = which.reshape(tensor.shape[:2]).tolist()

        def permittivity(p: Any) -> Any:
            i, j = round(2 * p.x / pixel + grid.n_x) % (2 * grid.n_x), round(2 * p.y / pixel) - 2 * low
            return media[at[i][j]]

        mp = self.mp
        # Meep looks for conductivity only where some plain medium has one: this one, which lies hidden below the other.
        conductor = [] if weakly_absorbing(self.cell) else [mp.Medium(D_conductivity=1.0)]
        place = {
            "size": mp.Vector3(mp.inf, (high - low - 0.5) * pixel, mp.inf),
            "center": mp.Vector3(0, (high + low) * pixel / 2),
        }
        return [mp.Block(material=medium, **place) for medium in (*conductor, permittivity)]

    def _medium(self, tensor: Complexes) -> Any:
        """Meep's medium of ε_XX, ε_YY, ε_ZZ, ε_XY (4,). Of absorption it takes the diagonal, as a conductivity."""
        mp, (real, imag) = self.mp, (tensor.real, tensor.imag)
        loss = 2 * np.pi * self.frequency * imag[:3] / real[:3]
        return mp.Medium(
            epsilon_diag=mp.Vector3(*real[:3]), epsilon_offdiag=mp.Vector3(real[3]),
            D_conductivity_diag=mp.Vector3(*loss),
        )

    def _sources(self) -> list[Any]:
        """Current sheet K = n × H of the wanted wave (Love's equivalence; Harrington, Time-Harmonic Fields, §3-5)."""
        mp, e = self.mp, electric_vector(self.u, self.v, self.cell.electric_axis)
        h = np.cross(wave_vector(self.u, self.v), e)
        current = np.cross([0.0, 0.0, 1.0], h)
        pulse = mp.GaussianSource(self.frequency, fwidth=self.pulse_width * self.frequency, cutoff=4)

        def phase(p: Any) -> complex:
            return complex(np.exp(2j * np.pi * self.frequency * self.u * p.x))

        return [
            mp.Source(
                pulse, component, center=mp.Vector3(0, self.grid.y_source), size=mp.Vector3(self.width),
                amplitude=amplitude, amp_func=phase,
            )
            for component, amplitude in ((mp.Ex, current[0]), (mp.Ez, current[1])) if abs(amplitude) > 1e-12
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

    def amplitudes(self) -> Complexes:
        """Order amplitudes (2, 4, n) on the two lines.

        Meep averages E_Z and H_X over two neighbours along X to bring them to pixel centres, which multiplies a wave
        by cos(k_X pixel/2): undone here, so that the flux is the one that the Yee scheme conserves.
        """
        averaged = np.cos(np.pi * self.frequency * self.u_m * self.grid.pixel)
        out = np.zeros((2, 4, self.u_m.size), complex)
        for i, monitor in enumerate(self.lines):
            x, one = self._period(monitor)
            to_orders = np.exp(-2j * np.pi * self.frequency * self.u_m[:, None] * x) / x.size
            for j, component in enumerate(self.components):
                array = self._array(monitor, component)
                if array is not None:
                    out[i, j] = to_orders @ array[one] / (averaged if j in (1, 2) else 1.0)
        return out

    def _advance(self, time: float) -> None:
        """Step on by a time, in Meep's units; `Simulation.run` would spend a quarter as long again between steps."""
        fields = self.simulation.fields
        for _ in range(int(np.ceil(time / fields.dt))):
            fields.step()

    def until_decayed(self) -> tuple[Complexes, Decay]:
        """Run until the amplitudes stand still or the longest time is over; they, and what they still lack."""
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
                raise InputError(f"FDTD at u = {self.u:g}, v = {self.v:g}: fields are not finite; lower 'courant'")
            capped = self.simulation.meep_time() * f >= self.settings.longest
        return before, Decay(residual, capped)

    def monitor_heat(self) -> Callable[[], float]:
        """Start recording E in the material; the function returned gives ∫ Im ε |E|² dA over it (µm²)."""
        mp, grid = self.mp, self.grid
        height = depth_nm(self.cell) / 1000
        components = [mp.Ex, mp.Ey, mp.Ez]
        monitor = self._monitor(components, grid.y_bottom + height / 2, height)

        def integral() -> float:
            x, one = self._period(monitor)
            y = np.atleast_1d(np.asarray(self.simulation.get_array_metadata(dft_cell=monitor)[1]))
            lossy = self.material.absorbing(x, y) * grid.pixel**2
            arrays = [self._array(monitor, component) for component in components]
            return float(sum((np.abs(array[one]) ** 2 * lossy).sum() for array in arrays if array is not None))

        return integral

    def close(self) -> None:
        """Free Meep's memory."""
        self.simulation.reset_meep()
