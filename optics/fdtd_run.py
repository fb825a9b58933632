"""One Meep run: a cell on a pixel grid, lit by a pulse, and the diffraction orders it sends out.

Meep's axes are X = g, Y = −n, Z = r (a proper rotation, as g × r = n): light runs towards −Y, ridges face +Y.

    ▒▒▒▒▒▒▒▒▒  absorber (PML)
    ─────────  current sheet, radiates the wanted plane wave
    - - - - -  front line: tangential E, H at the centre frequency
    ▔█▔▔▔█▔▔▔  ridges on the membrane
    - - - - -  back line
    ▒▒▒▒▒▒▒▒▒  absorber (PML)

Fields on the lines are split into diffraction orders. By Parseval the Maxwell stress over a line is a sum over orders,
and a plane wave of direction k carries momentum k/c per power, so efficiencies give the force (Jackson, Classical
Electrodynamics, §6.7). Order by order, the incident wave is subtracted exactly: a stress monitor of the total
field carries its beat with the reflected wave, an error of second order in the pixel that depends on the distance.

Meep is imported inside functions only: importing it switches denormal numbers off in the whole process.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from optics.cells import Metagrating
from optics.fdtd_grid import FdtdSettings, Layout, covered, layout, rectangles
from optics.files import InputError
from optics.incidence import Complexes, Floats, electric_vector, order_cosines, wave_vector

HOW_TO_GET_MEEP = (
    "Meep is not installed: apt-get install python3-meep (Debian) or conda install -c conda-forge pymeep; "
    "the package 'meep' on PyPI is something else"
)
_WEAK_ABSORPTION = 1e-3


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
class Lines:
    """Result of a run. amplitudes (2, 4, n): E_X, E_Z, H_X, H_Z of each order on the front and the back line.

    `u_m`, `w_m` (n,): cosines of the orders. `heat`: ∫|E|² dA over the material in µm² (0 where not asked for).
    `residual`: last relative change of the amplitudes over ten periods.
    """

    amplitudes: Complexes
    u_m: Floats
    w_m: Complexes
    heat: float
    residual: float


def propagating_orders(cell: Metagrating, u: float, v: float) -> tuple[Floats, Complexes]:
    """u_m and w_m (n,) of the orders that leave the cell in vacuum, ascending; the specular one is among them."""
    most = int(np.ceil(2 / cell.pitch))
    u_m, w_m = order_cosines(u, v, cell.pitch, np.arange(-most, most + 1))
    return u_m[w_m.real > 0], w_m[w_m.real > 0]


class _Run:
    """A Meep simulation of the cell, or with `empty` of a strip of vacuum one pixel wide: the same to a plane wave."""

    def __init__(
        self, cell: Metagrating, u: float, v: float, grid: Layout, settings: FdtdSettings, empty: bool = False
    ) -> None:
        self.mp = import_meep()
        self.cell, self.u, self.v, self.grid, self.settings, self.empty = cell, u, v, grid, settings, empty
        self.frequency = 1000 / cell.wavelength_nm
        self.n_x = 1 if empty else grid.n_x
        self.width = self.n_x * grid.pixel
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
            grid.n_absorber * grid.pixel, direction=mp.Y,
            mean_stretch=2.0,  # without it slowly decaying near fields reach the end of the absorber, and grow there
        )
        return mp.Simulation(
            cell_size=mp.Vector3(self.width, grid.n_y * grid.pixel), resolution=1 / grid.pixel, dimensions=2,
            geometry=[] if self.empty else self._geometry(), sources=self._sources(), boundary_layers=[absorber],
            k_point=mp.Vector3(f * self.u, 0, f * self.v), kz_2d="complex", Courant=self.settings.courant,
        )

    def _geometry(self) -> list[Any]:
        """Blocks of the material. Weak absorption is left to perturbation theory (see `efficiencies`)."""
        mp, epsilon = self.mp, self.cell.index.permittivity
        medium = mp.Medium(epsilon=epsilon.real)
        if not weakly_absorbing(self.cell):
            medium = mp.Medium(
                epsilon=epsilon.real, D_conductivity=2 * np.pi * self.frequency * epsilon.imag / epsilon.real
            )
        return [
            mp.Block(mp.Vector3(b - a, d - c, mp.inf), center=mp.Vector3((a + b) / 2, (c + d) / 2), material=medium)
            for a, b, c, d in rectangles(self.cell, self.grid)
        ]

    def _sources(self) -> list[Any]:
        """Current sheet K = n × H of the wanted wave (Love's equivalence; Harrington, Time-Harmonic Fields, §3-5)."""
        mp, e = self.mp, electric_vector(self.u, self.v, self.cell.electric_axis)
        h = np.cross(wave_vector(self.u, self.v), e)
        current = np.cross([0.0, 0.0, 1.0], h)
        pulse = mp.GaussianSource(self.frequency, fwidth=self.settings.pulse_width * self.frequency, cutoff=4)

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

    def until_decayed(self) -> tuple[Complexes, float]:
        """Run until the amplitudes stand still; they, and their last relative change over ten periods."""
        f, step = self.frequency, 10 / self.frequency
        self.simulation.run(until=8 / (self.settings.pulse_width * f))  # the pulse: cutoff 4 on both sides
        before, residual = self.amplitudes(), np.inf
        while residual > self.settings.decay and self.simulation.meep_time() * f < self.settings.longest:
            self.simulation.run(until=step)
            now = self.amplitudes()
            residual = float(np.abs(now - before).max() / np.abs(now).max())
            before = now
        if not np.isfinite(residual):
            raise InputError(f"FDTD at u = {self.u:g}, v = {self.v:g}: fields are not finite; lower 'courant'")
        return before, residual

    def monitor_heat(self) -> Callable[[], float]:
        """Start recording E in the material; the function returned gives ∫|E|² dA over it (µm²)."""
        mp, grid = self.mp, self.grid
        height = (self.cell.ridge_height_nm + self.cell.membrane_nm) / 1000
        components = [mp.Ex, mp.Ey, mp.Ez]
        monitor = self._monitor(components, grid.y_bottom + height / 2, height)

        def integral() -> float:
            x, one = self._period(monitor)
            y = np.atleast_1d(np.asarray(self.simulation.get_array_metadata(dft_cell=monitor)[1]))
            area = covered(rectangles(self.cell, grid), x, y, grid.pixel)
            arrays = [self._array(monitor, component) for component in components]
            return float(sum((np.abs(array[one]) ** 2 * area).sum() for array in arrays if array is not None))

        return integral

    def close(self) -> None:
        """Free Meep's memory."""
        self.simulation.reset_meep()


def weakly_absorbing(cell: Metagrating) -> bool:
    """Whether absorption is so small that it must come from first-order perturbation theory, not from 1 − R − T."""
    epsilon = cell.index.permittivity
    return bool(epsilon.imag <= _WEAK_ABSORPTION * abs(epsilon.real))


def flux(amplitudes: Complexes) -> Floats:
    """Power along +Y per area (n,) of orders with E_X, E_Z, H_X, H_Z (4, n), in the units of the DFT."""
    e_x, e_z, h_x, h_z = amplitudes
    return np.asarray((e_z * h_x.conj() - e_x * h_z.conj()).real)


def incident_wave(cell: Metagrating, u: float, v: float, grid: Layout, settings: FdtdSettings) -> Lines:
    """The empty run; InputError where the sheet doesn't radiate the wanted plane wave (off by more than 1e-2)."""
    run = _Run(cell, u, v, grid, settings, empty=True)
    try:
        amplitudes, residual = run.until_decayed()
    finally:
        run.close()
    found = amplitudes[0, :, 0].copy()
    w = float(wave_vector(u, v)[2])
    found[:2] /= np.cos(np.pi * run.frequency * w * grid.pixel)  # E is averaged over two rows, H is not
    check_polarisation(cell, u, v, found)
    return Lines(amplitudes, run.u_m, run.w_m, 0.0, residual)


def check_polarisation(cell: Metagrating, u: float, v: float, found: Complexes) -> None:
    """Refuse tangential fields E_X, E_Z, H_X, H_Z (4,) that differ from the wanted plane wave's by more than 1e-2.

    Compared up to one complex factor; H tells the direction of travel and the mixture of s and p.
    """
    e = electric_vector(u, v, cell.electric_axis)
    h = np.cross(wave_vector(u, v), e)
    # Seen along (X, Y, Z) = (g, −n, r), a proper rotation, axial H turns like E.
    wanted = np.array([e[0], e[1], h[0], h[1]])
    scale = wanted @ found / (wanted @ wanted)
    deviation = float(np.linalg.norm(found / scale - wanted) / np.linalg.norm(wanted)) if scale != 0 else np.inf
    if not deviation <= 1e-2:
        raise InputError(
            f"{cell.name} at u = {u:g}, v = {v:g}: the source radiates a wave {deviation:.1%} off the wanted "
            "polarisation; allowed 1%; raise resolutions_per_um"
        )


@dataclass(frozen=True)
class Efficiencies:
    """Power fractions reflected, transmitted (n,) of the orders u_m, w_m; absorptance of weak absorption, else NaN."""

    u_m: Floats
    w_m: Complexes
    reflected: Floats
    transmitted: Floats
    absorptance: float
    residual: float


def efficiencies(cell: Metagrating, u: float, v: float, resolution: float, settings: FdtdSettings) -> Efficiencies:
    """Efficiencies of all propagating orders for one direction at one resolution (pixels per µm).

    Weak absorption: a = ω Im ε ∫|E|² dA / P of the lossless structure (first-order perturbation, Jackson §6.8).
    """
    grid = layout(cell, resolution, settings)
    incident = incident_wave(cell, u, v, grid, settings)
    run = _Run(cell, u, v, grid, settings)
    try:
        weak = weakly_absorbing(cell)
        heat = run.monitor_heat() if weak and cell.index.k > 0 else lambda: 0.0
        amplitudes, residual = run.until_decayed()
        energy = heat()
    finally:
        run.close()
    power = -float(flux(incident.amplitudes[0])[0])
    specular = int(np.abs(run.u_m - u).argmin())
    scattered = amplitudes[0].copy()
    scattered[:, specular] -= incident.amplitudes[0, :, 0]
    absorbed = 2 * np.pi * run.frequency * cell.index.permittivity.imag * energy / (power * grid.period)
    return Efficiencies(
        run.u_m, run.w_m, flux(scattered) / power, -flux(amplitudes[1]) / power,
        absorbed if weak else float("nan"), max(residual, incident.residual),
    )
