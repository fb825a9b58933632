"""Diffraction efficiencies of a cell from two FDTD runs: one empty, for the incident wave, and one with the cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamrider.arrays import Complexes, Floats
from beamrider.io.files import InputError
from optics.cells.outline import Grating
from optics.fdtd.grid import FdtdSettings, Layout, half_spaces, layout
from optics.fdtd.material import lossless, weakly_absorbing
from optics.fdtd.orders import Orders
from optics.fdtd.run import Decay, Run
from optics.waves.incidence import electric_vector, wave_vector


@dataclass(frozen=True)
class Lines:
    """Result of the empty run: E_X, E_Z, H_X, H_Z of the incident wave on the front and the back line (2, 4, 1)."""

    amplitudes: Complexes
    decay: Decay


def flux(amplitudes: Complexes) -> Floats:
    """Power along +Y per area (n,) of orders with E_X, E_Z, H_X, H_Z (4, n), in the units of the DFT."""
    e_x, e_z, h_x, h_z = amplitudes
    return np.asarray((e_z * h_x.conj() - e_x * h_z.conj()).real)


def stress(u_m: Floats, v: float, amplitudes: Complexes, epsilon: tuple[complex, complex] = (1.0, 1.0)) -> Floats:
    """Maxwell's stress (2,), force per area on g and n, of the total field on the two lines, amplitudes (2, 4, n).

    `epsilon` holds the permittivities there; the momentum is Minkowski's. By Parseval the mean over a line is a sum
    over orders; their normal fields follow from k × E = H and k × H = −ε E (Jackson, §6.7). Nothing is split into what
    comes in and goes out: the beat of the two, which hardly any force is left of, has to cancel by itself. Evanescent
    orders, of which only the one that leaves is there, carry no force. What enters an absorbing half-space stays there.
    """
    e = np.array([complex(one).real if complex(one).imag == 0 else np.inf for one in epsilon])[:, None]
    e_x, e_z, h_x, h_z = np.moveaxis(amplitudes * np.isfinite(e)[:, None], 1, 0)
    e = np.where(np.isfinite(e), e, 1.0)
    e_y, h_y = (u_m * h_z - v * h_x) / e, v * e_x - u_m * e_z
    along = (e * e_x * e_y.conj() + h_x * h_y.conj()).real.sum(axis=-1)
    normal, tangential = np.array([e_y, h_y]), np.array([[e_x, h_x], [e_z, h_z]])
    weight = np.stack([e, np.ones_like(e)])
    across = (weight * (np.abs(normal) ** 2 - (np.abs(tangential) ** 2).sum(axis=0))).sum(axis=(0, -1)) / 2
    return np.array([along[0] - along[1], across[1] - across[0]])


def incident_wave(cell: Grating, u: float, v: float, grid: Layout, settings: FdtdSettings) -> Lines:
    """The empty run; InputError where the sheet doesn't radiate the wanted plane wave (off by more than 1e-2)."""
    run = Run(cell, u, v, grid, settings, empty=True)
    try:
        amplitudes, decay = run.until_decayed()
    finally:
        run.close()
    found = amplitudes[0, :, 0].copy()
    w = float(wave_vector(u, v, run.front_index)[2])
    found[:2] /= np.cos(np.pi * run.frequency * w * grid.pixel)  # E is averaged over two rows, H is not
    check_polarisation(cell, u, v, found, run.front_index * run.frequency * grid.pixel)
    return Lines(amplitudes, decay)


def check_polarisation(cell: Grating, u: float, v: float, found: Complexes, pixel: float = 0.0) -> None:
    """Refuse tangential fields E_X, E_Z, H_X, H_Z (4,) that differ from the wanted plane wave's by more than 1e-2.

    More is allowed where pixels of `pixel` wavelengths change the medium's impedance. Compared up to one complex
    factor; H tells the direction of travel and the mixture of s and p.
    """
    index, allowed = cell.surroundings.front, max(1e-2, (2 * np.pi * pixel) ** 2 / 12)
    e = electric_vector(u, v, cell.electric_axis, index)
    h = np.cross(wave_vector(u, v, index), e)
    # Seen along (X, Y, Z) = (g, −n, r), a proper rotation, axial H turns like E.
    wanted = np.array([e[0], e[1], h[0], h[1]])
    scale = wanted @ found / (wanted @ wanted)
    deviation = float(np.linalg.norm(found / scale - wanted) / np.linalg.norm(wanted)) if scale != 0 else np.inf
    if not deviation <= allowed:
        raise InputError(
            f"{cell.name} at u = {u:g}, v = {v:g}: the source radiates a wave {deviation:.1%} off the wanted "
            f"polarisation; allowed {allowed:.0%}; raise pixels_per_wavelength"
        )


@dataclass(frozen=True)
class Efficiencies:
    """Power fractions reflected, transmitted (n,) of the orders, and what else a run tells.

    absorptance: from the fields' own loss; imbalance: power that came in minus what left and what was lost, by the
    fields between the lines (of weak absorption, which is not in the run, nothing); stress (2,): q_g and q_n from
    Maxwell's stress of the total field.
    """

    orders: Orders
    reflected: Floats
    transmitted: Floats
    absorptance: float
    imbalance: float
    stress: Floats
    decay: Decay


def efficiencies(
    cell: Grating, u: float, v: float, n_x: int, settings: FdtdSettings, thicker: float = 1.0
) -> Efficiencies:
    """Efficiencies of all orders that leave, for one direction with `n_x` pixels a period.

    `thicker` is the absorbers' thickness in units of the settings'. The loss of the fields is ω ∫ E* Im ε E dA / P
    (Jackson §6.8), of weak absorption with the fields of the lossless structure, to first order.
    """
    grid = layout(cell, n_x, settings, thicker)
    incident = incident_wave(cell, u, v, grid, settings)
    run = Run(cell, u, v, grid, settings)
    try:
        heat = (lambda: 0.0) if lossless(cell) else run.monitor_heat()
        amplitudes, decay = run.until_decayed()
        lost, behind = heat(), run.amplitudes(_resolved(cell, u, n_x))[1]
    finally:
        run.close()
    power = -float(flux(incident.amplitudes[0])[0])
    u_m, w_front, w_back = run.orders
    specular = int(np.abs(u_m - u).argmin())
    scattered = amplitudes[0].copy()
    scattered[:, specular] -= incident.amplitudes[0, :, 0]
    reflected = np.where(w_front.real > 0, flux(scattered) / power, 0.0)
    transmitted = np.where(w_back.real > 0, -flux(amplitudes[1]) / power, 0.0)
    # The rate of change of a step, not the frequency, is what the discrete fields lose their energy with.
    absorbed = lost * 2 * np.sin(run.step / 2) / (run.settings.courant * grid.pixel) / (power * grid.period)
    kept = 0.0 if weakly_absorbing(cell) else absorbed
    imbalance = 1 - reflected.sum() + float(flux(behind).sum()) / power - kept
    return Efficiencies(
        run.orders,
        reflected,
        transmitted,
        absorbed,
        imbalance,
        _force(run, amplitudes) / power,
        decay.worse(incident.decay),
    )


def _resolved(cell: Grating, u: float, n_x: int) -> Floats:
    """u_m (n,) of the orders that take 4 pixels or more a period: all that reach a line."""
    most = n_x // 4
    return np.asarray(u + cell.pitch * np.arange(-most, most + 1))


def _force(run: Run, amplitudes: Complexes) -> Floats:
    """`stress` of amplitudes (2, 4, n): Meep averages E over two rows, not H.

    That is right for the flux that Yee's scheme conserves, and undone here.
    """
    total, phase = amplitudes.copy(), np.pi * run.frequency * run.grid.pixel
    for line, w in zip(total, run.orders[1:], strict=True):
        line[:2] /= np.cos(phase * w.real)
    return stress(run.orders.u, run.v, total, half_spaces(run.cell))
