"""How far the modal method's own error estimate can be trusted.

The paper's cells and random ones (periods 0.8 to 2.5 wavelengths, one to three ridges, permittivity 2 to 12), each with
the number of orders chosen for an error of 1e-3, at random directions: the estimate against the error itself, taken
from ±120 orders.

    python workflow/benchmarks/error_estimate.py [--cells 20] [--seed 1] [--tolerance 1e-3]
"""

from __future__ import annotations

import argparse

import numpy as np
from rows import CELLS, DESIGNS
from threadpoolctl import threadpool_limits

from optics.cells import Metagrating, read_metagrating
from optics.lamellar import solve
from optics.truncation import choose_order, order_error

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
    return Metagrating.model_validate({
        "kind": "metagrating", "name": f"random{k}", "wavelength_nm": WAVELENGTH, "electric_axis": "rg"[k % 2],
        "period_nm": period, "ridges_nm": np.stack([edges[::2], np.diff(edges)[::2]], axis=1).tolist(),
        "ridge_height_nm": rng.uniform(100.0, 700.0), "membrane_nm": rng.uniform(0.0, 400.0),
        "index": {"n": float(np.sqrt(rng.uniform(2.0, 12.0)))},
    })


def compare(cell: Metagrating, rng: np.random.Generator, tolerance: float) -> tuple[int, np.ndarray, np.ndarray]:
    """Orders chosen, estimated and true errors (n,) at random directions."""
    u, v = rng.uniform(-RANGE, RANGE, 12), np.sort(rng.uniform(0.0, RANGE, 4))
    order = choose_order(cell, np.linspace(-RANGE, RANGE, 24), RANGE * np.array([0.0, 0.5, 1.0]), tolerance)
    found = solve(cell, u, v, order)
    estimate, _ = order_error(cell, u, v, order, found.q, found.q_stokes)
    return order, estimate.ravel(), np.abs(found.q - solve(cell, u, v, 120).q).max(axis=-1).ravel()


def main() -> None:
    """Print one line a cell and the totals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tolerance", type=float, default=1e-3)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    cells = [read_metagrating(DESIGNS / f"{name}.yaml") for name in CELLS]
    cells += [random_cell(rng, k) for k in range(arguments.cells)]
    ratios, errors = [], []
    print(f"{'cell':12s} orders  error 95 %  covered  over 10 x  median ratio")
    with threadpool_limits(1):
        for cell in cells:
            order, estimate, true = compare(cell, rng, arguments.tolerance)
            ratio = estimate / true
            ratios.append(ratio)
            errors.append(true)
            print(
                f"{cell.name:12s} {order:6d} {np.quantile(true, 0.95):11.1e} {(ratio >= 1).mean():8.1%} "
                f"{(ratio > 10).mean():10.1%} {np.median(ratio):13.1f}", flush=True,
            )
    every = np.concatenate(ratios)
    print(
        f"{'all':12s} {'':6s} {np.quantile(np.concatenate(errors), 0.95):11.1e} {(every >= 1).mean():8.1%} "
        f"{(every > 10).mean():10.1%} {np.median(every):13.1f}   ({every.size} directions)"
    )


if __name__ == "__main__":
    main()
