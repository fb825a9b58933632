"""How far the modal method's own error estimate can be trusted.

The paper's cells and random ones of dielectric (periods 0.8 to 2.5 wavelengths, one to three ridges, permittivity 2 to
12) and of metal (gold, silver, tungsten at several wavelengths, as ridges on a substrate or on a film of their own),
each with the number of orders chosen for an error of 1e-3, at random directions: the estimate against the error itself,
taken from far more orders, in the cell's own polarisation and in any.

    python -m workflow.benchmarks.error_estimate [--cells 20] [--metals 20] [--seed 1] [--tolerance 1e-3]
"""

from __future__ import annotations

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.io.files import run_stage
from optics.cells.schema import LamellarStack, Metagrating, read_metagrating
from optics.modal.limit import without_limit
from optics.modal.response import solve
from optics.modal.truncation import change, choose
from workflow.benchmarks.rows import CELLS, DESIGNS

WAVELENGTH = 1064.0
SMALLEST = 40.0
RANGE = 0.4227


def random_cell(rng: np.random.Generator, k: int) -> Metagrating:
    """A cell of one to three ridges, no ridge or gap narrower than SMALLEST nm; TE and TM in turn."""
    while True:
        period = WAVELENGTH * rng.uniform(0.8, 2.5)
        edges = np.sort(rng.uniform(0.0, period, 2 * rng.integers(1, 4)))
        if np.diff(edges, append=period + edges[0]).min() > SMALLEST:
            break
    return Metagrating.model_validate(
        {
            "kind": "metagrating",
            "name": f"random{k}",
            "wavelength_nm": WAVELENGTH,
            "electric_axis": "rg"[k % 2],
            "period_nm": period,
            "ridges_nm": np.stack([edges[::2], np.diff(edges)[::2]], axis=1).tolist(),
            "ridge_height_nm": rng.uniform(100.0, 700.0),
            "membrane_nm": rng.uniform(0.0, 400.0),
            "index": {"n": float(np.sqrt(rng.uniform(2.0, 12.0)))},
        }
    )


# Wavelength in nm, n, k: gold and silver of Johnson & Christy 1972 (Phys. Rev. B 6, 4370), tungsten of Ordal et al.
# 1988 (Appl. Opt. 27, 1203) and Palik (Handbook of Optical Constants, 1985).
METALS = {
    "gold": [(549.0, 0.43, 2.455), (659.0, 0.14, 3.697), (1088.0, 0.27, 7.150), (1610.0, 0.51, 10.744)],
    "silver": [(400.0, 0.05, 2.104), (549.0, 0.06, 3.586), (659.0, 0.05, 4.483), (1088.0, 0.04, 7.795)],
    "tungsten": [(500.0, 3.38, 2.68), (633.0, 3.65, 2.89), (1064.0, 3.04, 3.44), (1550.0, 2.36, 4.61)],
}


def metal_cell(rng: np.random.Generator, k: int) -> LamellarStack:
    """Ridges of metal in air or glass, E across them; on glass, on the metal itself, or free."""
    while True:
        name = list(METALS)[k % 3]
        wavelength, n, extinction = METALS[name][rng.integers(4)]
        period = wavelength * rng.uniform(0.3, 1.8)
        width = period * rng.uniform(0.2, 0.8)
        metal, gap = {"n": n, "k": extinction}, {"n": float(rng.choice([1.0, 1.5]))}
        ridge = {"start_nm": 0.0, "width_nm": width, "index": metal}
        layers = [{"thickness_nm": wavelength * rng.uniform(0.03, 0.3), "index": gap, "ridges": [ridge]}]
        if rng.random() < 0.5:
            layers.append({"thickness_nm": wavelength * rng.uniform(0.03, 0.2), "index": metal})
        cell = LamellarStack.model_validate(
            {
                "kind": "lamellar",
                "name": f"{name}{k}",
                "wavelength_nm": wavelength,
                "electric_axis": "g",
                "period_nm": period,
                "layers": layers,
                "surroundings": {"back": float(rng.choice([1.0, 1.5]))},
            }
        )
        if not without_limit(cell):
            return cell


def compare(
    cell: Metagrating | LamellarStack, rng: np.random.Generator, tolerance: float
) -> tuple[int, np.ndarray, np.ndarray]:
    """Orders chosen, estimated and true errors (2, n) at random directions, in the own polarisation and in any."""
    u, v = rng.uniform(-RANGE, RANGE, 8), np.sort(rng.uniform(0.0, RANGE, 3))
    chosen = choose(cell, RANGE, RANGE, tolerance)
    found = solve(cell, u, v, chosen.order)
    estimate = chosen.errors(u, v, found, 1e-9)
    true = change(found, solve(cell, u, v, min(150, max(3 * chosen.order, 60))))
    return chosen.order, np.reshape(estimate, (2, -1)), np.reshape(true, (2, -1))


def line(name: str, order: str, estimate: np.ndarray, true: np.ndarray) -> str:
    """One line of the output."""
    ratio = estimate / np.maximum(true, 1e-13)
    own, every = ratio
    return (
        f"{name:12s} {order:>6s} {np.quantile(true[1], 0.95):11.1e} {(own >= 1).mean():8.1%} "
        f"{(every >= 1).mean():8.1%} {(every > 10).mean():10.1%} {np.median(every):13.1f}"
    )


def main() -> None:
    """Print one line a cell and the totals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=20)
    parser.add_argument("--metals", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tolerance", type=float, default=1e-3)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    dielectric = [read_metagrating(DESIGNS / f"{name}.yaml") for name in CELLS]
    dielectric += [random_cell(rng, k) for k in range(arguments.cells)]
    metal = [metal_cell(rng, k) for k in range(arguments.metals)]
    print(f"{'cell':12s} orders  error 95 %  covered   in any  over 10 x  median ratio")
    with threadpool_limits(1):
        for what, cells in (("dielectric", dielectric), ("metal", metal)):
            parts = []
            for cell in cells:
                order, estimate, true = compare(cell, rng, arguments.tolerance)
                parts.append((estimate, true))
                print(line(cell.name, str(order), estimate, true), flush=True)
            if parts:
                together = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
                print(line(f"{what}s", "", *together), flush=True)


if __name__ == "__main__":
    run_stage(main)
