"""Figures of merit of sail materials: thickness, burst diameter and spin limit (Gao, Kelzenberg & Atwater, Table 1).

    python -m dynamics.merit --out merit.csv

Thickness t = (0.1 g/m²)/ρ. Burst diameter of a clamped round film under 67 Pa, the light of 10 GW/m² on a mirror: it
bulges to a cap of height h with the stress σ = p a²/(4 h t) of a shallow cap and σ = (E/(1 − ν)) ⅔ (h/a)² of its
strain, hence at σ = σ_t: 2a = 2 t σ_t^{3/2} √(24 (1 − ν)/E)/p (Timoshenko & Woinowsky-Krieger, Theory of Plates and
Shells, §§97, 128). Spin limit of a flat disc of 10 m²: peak stress (3 + ν) ρ Ω² R²/8 = σ_t (Timoshenko & Goodier,
Theory of Elasticity, §32).
"""

from __future__ import annotations

import csv
from dataclasses import dataclass

import numpy as np

from beamrider.io.arguments import parser
from beamrider.io.files import Stopwatch, atomic, finish, take_out

AREAL_MASS = 1e-4
PRESSURE = 67.0
AREA = 10.0


@dataclass(frozen=True)
class Entry:
    """Inputs in SI, the printed thickness in m, diameter in m and spin in Hz (None: not printed), and a remark."""

    material: str
    source: str
    young: float
    strength: float
    density: float
    poisson: float
    printed: tuple[float, float, float] | None
    remark: str


def thickness(density: float) -> float:
    """Thickness in m of a film of 0.1 g/m²."""
    return AREAL_MASS / density


def burst_diameter(young: float, strength: float, density: float, poisson: float) -> float:
    """Diameter in m at which a clamped film of 0.1 g/m² bursts under 67 Pa."""
    return float(2.0 * thickness(density) * strength**1.5 * np.sqrt(24.0 * (1.0 - poisson) / young) / PRESSURE)


def spin_limit(strength: float, density: float, poisson: float) -> float:
    """Spin in Hz at which a flat disc of 10 m² bursts."""
    radius = np.sqrt(AREA / np.pi)
    return float(np.sqrt(8.0 * strength / ((3.0 + poisson) * density)) / (2.0 * np.pi * radius))


GPA = 1e9
SAME = "agrees to the digits printed"
TABLE = (
    Entry("silicon (111)", "Table 1", 169 * GPA, 2.1 * GPA, 2330, 0.26, (43e-9, 1.3, 130), SAME),
    Entry(
        "diamond, nano",
        "Table 1",
        750 * GPA,
        7.5 * GPA,
        2520,
        0.03,
        (31e-9, 1.7, 180),
        "printed inputs belong to no row of Table S1: strength of a filament, density of none",
    ),
    Entry(
        "diamond, nano",
        "Table S1",
        750 * GPA,
        5.0 * GPA,
        3270,
        0.03,
        (31e-9, 1.7, 180),
        "Table 1 was computed from this row; 1.73 m with ν = 0.10",
    ),
    Entry("tempered glass", "Table 1", 66 * GPA, 1.0 * GPA, 2420, 0.22, (41e-9, 0.66, 90), SAME),
    Entry("tempered glass", "Table S1", 77 * GPA, 1.0 * GPA, 2400, 0.22, None, "stiffer than in Table 1"),
    Entry(
        "silicon nitride",
        "Table 1",
        250 * GPA,
        6.4 * GPA,
        2700,
        0.27,
        (37e-9, 4.6, 210),
        "diameter as printed only with E = 270 GPa of Table S1",
    ),
    Entry("silicon nitride", "Table S1", 270 * GPA, 6.4 * GPA, 2700, 0.27, (37e-9, 4.6, 210), SAME),
    Entry(
        "MoS2, bilayer",
        "Table 1",
        220 * GPA,
        21 * GPA,
        5020,
        0.27,
        (20e-9, 19, 300),
        "diameter and spin as printed only with ν = 0",
    ),
    Entry("MoS2, bilayer, ν = 0", "Table 1", 220 * GPA, 21 * GPA, 5020, 0.0, (20e-9, 19, 300), SAME),
    Entry("aluminium", "Table 1", 72 * GPA, 0.50 * GPA, 2800, 0.33, (36e-9, 0.18, 60), SAME),
    Entry("polyimide", "Table 1", 2.5 * GPA, 0.069 * GPA, 1420, 0.34, (70e-9, 0.10, 30), SAME),
)
COLUMNS = (
    "material",
    "inputs",
    "E_GPa",
    "strength_GPa",
    "density_kg_m3",
    "poisson",
    "thickness_nm",
    "printed_thickness_nm",
    "burst_diameter_m",
    "printed_burst_diameter_m",
    "spin_limit_Hz",
    "printed_spin_limit_Hz",
    "remark",
)


def row(entry: Entry) -> tuple[str, ...]:
    """One line of the table, computed beside printed."""
    film = thickness(entry.density)
    burst = burst_diameter(entry.young, entry.strength, entry.density, entry.poisson)
    spin = spin_limit(entry.strength, entry.density, entry.poisson)
    inputs = (entry.young / GPA, entry.strength / GPA, entry.density, entry.poisson)
    printed = ("", "", "")
    if entry.printed:
        printed = (f"{entry.printed[0] * 1e9:.3g}", f"{entry.printed[1]:.3g}", f"{entry.printed[2]:.3g}")
    computed = (f"{film * 1e9:.4g}", f"{burst:.4g}", f"{spin:.4g}")
    pairs = [text for both in zip(computed, printed, strict=True) for text in both]
    return (entry.material, entry.source, *(f"{x:g}" for x in inputs), *pairs, entry.remark)


def main() -> None:
    """Figures of merit of the paper's materials, computed and printed, as CSV."""
    watch = Stopwatch()
    given = parser("dynamics.merit", main.__doc__, {"--out": {"required": True, "help": "CSV to write"}}).parse_args()
    take_out(given.out)
    with atomic(given.out) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(row(entry) for entry in TABLE)
    finish(given.out, watch, f"{len(TABLE)} materials")
