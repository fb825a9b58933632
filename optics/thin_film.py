"""Reflection, transmission and absorption of plane films, from the back by reflection coefficients of decaying waves.

Airy's recursion r = (r₁₂ + r₂₃ x²)/(1 + r₁₂ r₂₃ x²), x = exp(iδ) with |x| ≤ 1 (Born & Wolf, Principles of Optics,
§1.6): it cannot overflow, whatever the thickness. Any number of layers; s, p and their mean.

    python -m optics.thin_film --cell workflow/designs/si43.yaml --out table.h5
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optics.cells import ThinFilm, read_cell
from optics.command import check_range, table_arguments
from optics.files import InputError, Stopwatch, run_stage, versions
from optics.incidence import Complexes, Floats
from optics.sampling import refine
from optics.table import PressureTable


@dataclass(frozen=True)
class FilmResponse:
    """Reflectance, transmittance and absorptance (n,) over sines of incidence."""

    reflectance: Floats
    transmittance: Floats
    absorptance: Floats


def _normal(permittivity: complex, s: Floats) -> Complexes:
    """k_z/k₀ = √(ε − s²) with Im ≥ 0."""
    root = np.sqrt(permittivity - s**2 + 0j)
    return np.where(root.imag < 0, -root, root)


def _amplitudes(cell: ThinFilm, s: Floats, polarisation: str) -> tuple[Floats, Floats]:
    """R and T (n,) for 's' or 'p', in front-medium sines s (n,) of k_t/k₀."""
    permittivity = [
        complex(cell.surroundings.front) ** 2,
        *(layer.index.permittivity for layer in cell.layers),
        complex(cell.surroundings.back) ** 2,
    ]
    k_z = [_normal(epsilon, s) for epsilon in permittivity]
    # E-field admittances: h_t/E_t of a wave along +z.
    y = k_z if polarisation == "s" else [epsilon / k for epsilon, k in zip(permittivity, k_z, strict=True)]
    r = (y[-2] - y[-1]) / (y[-2] + y[-1])
    t = 1 + r
    for i in range(len(cell.layers) - 1, -1, -1):
        x = np.exp(1j * k_z[i + 1] * 2 * np.pi * cell.layers[i].thickness_nm / cell.wavelength_nm)
        front = (y[i] - y[i + 1]) / (y[i] + y[i + 1])
        denominator = 1 + front * r * x * x
        t = (1 + front) * x * t / denominator
        r = (front + r * x * x) / denominator
    return np.asarray(np.abs(r) ** 2), np.asarray(np.abs(t) ** 2 * y[-1].real / y[0].real)


def solve(cell: ThinFilm, s: Floats) -> FilmResponse:
    """Response at k_t/k₀ = s (n,), the sine of incidence in vacuum, for the cell's polarisation."""
    s = np.asarray(s, float)
    kinds = ("s", "p") if cell.polarisation == "mean" else (cell.polarisation,)
    both = np.mean([_amplitudes(cell, s, kind) for kind in kinds], axis=0)
    return FilmResponse(both[0], both[1], 1.0 - both[0] - both[1])


def pressure(cell: ThinFilm, s: Floats) -> tuple[Floats, FilmResponse]:
    """Q (n, 3) for light tilted along g, k = (s, 0, √(n² − s²)), and the response it follows from.

    Momentum balance: q_g = a s, q_n = w(1 + R) − w_back T, as in `optics.momentum` with the specular order alone.
    """
    s = np.asarray(s, float)
    response = solve(cell, s)
    w = np.sqrt(cell.surroundings.front**2 - s**2)
    w_back = np.sqrt(np.maximum(cell.surroundings.back**2 - s**2, 0.0))
    q_n = w * (1 + response.reflectance) - w_back * response.transmittance
    return np.stack([response.absorptance * s, np.zeros_like(s), q_n], -1), response


def make_table(cell: ThinFilm, s_max: float, tolerance: float) -> PressureTable:
    """Axisymmetric pressure table over sines 0 … s_max, refined until interpolation meets `tolerance`."""
    watch = Stopwatch()

    def response(s: Floats) -> Floats:
        q, film = pressure(cell, s)
        return np.column_stack([q, film.absorptance])

    nodes = refine(response, np.linspace(0.0, s_max, 33), tolerance, 1e-5)
    values = response(nodes.nodes)
    attrs = {
        "name": cell.name, "solver": "thin_film", "cell": cell.model_dump(), "wavelength_m": cell.wavelength_nm * 1e-9,
        "settings": {"s_max": s_max, "tolerance": tolerance}, "cutoffs": [],
        "energy_imbalance": float(max(0.0, -values[:, 3].min())), "wall_seconds": watch.seconds,
        "versions": versions("numpy", "scipy"),
    }
    # Closed form: what error there is comes from interpolation and rounding.
    error = nodes.error.max(axis=1) + 1e-14
    return PressureTable(
        nodes.nodes, np.zeros(1), values[:, :3].T[..., None], values[:, 3:], error[:, None],
        axisymmetric=True, attrs=attrs,
    )


def main() -> None:
    """Command line: see the module docstring."""
    arguments = table_arguments("optics.thin_film", "Pressure table of a plane film", 1e-6, 0.999, v_max=False)
    cell = read_cell(arguments.cell)
    if not isinstance(cell, ThinFilm):
        raise InputError(f"{arguments.cell}: kind = {cell.kind!r}: must be thin_film; use optics.modal for gratings")
    check_range(cell.surroundings.front, arguments.u_max)
    make_table(cell, arguments.u_max, arguments.tolerance).write(arguments.out)


if __name__ == "__main__":
    run_stage(main)
