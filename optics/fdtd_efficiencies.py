"""Diffraction efficiencies of a cell from two FDTD runs: one empty, for the incident wave, and one with the cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optics.fdtd_grid import FdtdSettings, Layout, layout
from optics.fdtd_material import lossless, weakly_absorbing
from optics.fdtd_run import Decay, Run
from optics.files import InputError
from optics.incidence import Complexes, Floats, electric_vector, wave_vector
from optics.outline import Grating


@dataclass(frozen=True)
class Lines:
    """Result of the empty run: E_X, E_Z, H_X, H_Z of the incident wave on the front and the back line (2, 4, 1)."""

    amplitudes: Complexes
    decay: Decay


def flux(amplitudes: Complexes) -> Floats:
    """Power along +Y per area (n,) of orders with E_X, E_Z, H_X, H_Z (4, n), in the units of the DFT."""
    e_x, e_z, h_x, h_z = amplitudes
    return np.asarray((e_z * h_x.conj() - e_x * h_z.conj()).real)


def stress(u_m: Floats, v: float, amplitudes: Complexes) -> Floats:
    """Maxwell's stress (2,), force per area on g and n, of the total field on the two lines, amplitudes (2, 4, n).

    By Parseval the mean over a line is a sum over orders; their normal fields follow from k × E = H and k × H = −E
    (Jackson, §6.7). Nothing is split into what comes in and goes out: the beat of the two, which hardly any force is
    left of, has to cancel by itself. Evanescent orders, of which only the one that leaves is there, carry no force.
    """
    e_x, e_z, h_x, h_z = np.moveaxis(amplitudes, 1, 0)
    e_y, h_y = u_m * h_z - v * h_x, v * e_x - u_m * e_z
    along = (e_x * e_y.conj() + h_x * h_y.conj()).real.sum(axis=-1)
    across = (np.abs([e_y, h_y]) ** 2 - np.abs([e_x, h_x]) ** 2 - np.abs([e_z, h_z]) ** 2).sum(axis=(0, -1)) / 2
    return np.array([along[0] - along[1], across[1] - across[0]])


def incident_wave(cell: Grating, u: float, v: float, grid: Layout, settings: FdtdSettings) -> Lines:
    """The empty run; InputError where the sheet doesn't radiate the wanted plane wave (off by more than 1e-2)."""
    run = Run(cell, u, v, grid, settings, empty=True)
    try:
        amplitudes, decay = run.until_decayed()
    finally:
        run.close()
    found = amplitudes[0, :, 0].copy()
    w = float(wave_vector(u, v)[2])
    found[:2] /= np.cos(np.pi * run.frequency * w * grid.pixel)  # E is averaged over two rows, H is not
    check_polarisation(cell, u, v, found)
    return Lines(amplitudes, decay)


def check_polarisation(cell: Grating, u: float, v: float, found: Complexes) -> None:
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
            "polarisation; allowed 1%; raise pixels_per_wavelength"
        )


@dataclass(frozen=True)
class Efficiencies:
    """Power fractions reflected, transmitted (n,) of the orders u_m, w_m, and what else a run tells.

    absorptance: of weak absorption, else NaN; stress (2,): q_g and q_n from Maxwell's stress of the total field.
    """

    u_m: Floats
    w_m: Complexes
    reflected: Floats
    transmitted: Floats
    absorptance: float
    stress: Floats
    decay: Decay


def efficiencies(
    cell: Grating, u: float, v: float, resolution: float, settings: FdtdSettings, thicker: float = 1.0
) -> Efficiencies:
    """Efficiencies of all propagating orders for one direction at one resolution (see `pixels`).

    `thicker` is the absorbers' thickness in units of the settings'.

    Weak absorption: a = ω ∫ Im ε |E|² dA / P of the lossless structure (first-order perturbation, Jackson §6.8).
    """
    grid = layout(cell, resolution, settings, thicker)
    incident = incident_wave(cell, u, v, grid, settings)
    run = Run(cell, u, v, grid, settings)
    try:
        weak = weakly_absorbing(cell)
        heat = run.monitor_heat() if weak and not lossless(cell) else lambda: 0.0
        amplitudes, decay = run.until_decayed()
        dissipated = heat()
    finally:
        run.close()
    power = -float(flux(incident.amplitudes[0])[0])
    specular = int(np.abs(run.u_m - u).argmin())
    scattered = amplitudes[0].copy()
    scattered[:, specular] -= incident.amplitudes[0, :, 0]
    # Meep averages E over two rows, not H: right for the flux that Yee's scheme conserves, undone here for the stress.
    between_rows = np.cos(np.pi * run.frequency * run.w_m.real * grid.pixel)
    total = amplitudes / np.stack([between_rows] * 2 + [np.ones_like(between_rows)] * 2)
    absorbed = 2 * np.pi * run.frequency * dissipated / (power * grid.period)
    return Efficiencies(
        run.u_m, run.w_m, flux(scattered) / power, -flux(amplitudes[1]) / power, absorbed if weak else float("nan"),
        stress(run.u_m, v, total) / power, decay.worse(incident.decay),
    )
