"""How much an FDTD table costs against the plain way: 51 × 51 even directions by plain Meep at one resolution.

Plain Meep runs at two resolutions in a sample of the directions, the steepest flank of the resonance among them. From
the largest error there (second order in the pixel) follows the resolution that the plain way needs for the largest
error of the table, and from the time (third order) what it would take for 51 × 26 directions, v → −v being a mirror.
What the table takes is measured likewise: directions drawn from its own are solved again. All times are CPU seconds.

    python -m workflow.benchmarks.fdtd_plain --modal modal.h5 --fdtd fdtd.h5
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.io.files import run_stage, validate
from optics.cells.schema import Metagrating, read_metagrating
from optics.fdtd.direction import solve_direction
from optics.fdtd.grid import FdtdSettings
from optics.fdtd.run import import_meep
from optics.modal.response import solve
from optics.table.pressure_table import PressureTable
from workflow.benchmarks.plain_meep import plain, pressure
from workflow.benchmarks.rows import DESIGNS

RESOLUTIONS = (14.9, 21.3)
SIDE, ORDER = 51, 40


def sample(cell: Metagrating, u_max: float, v_max: float, count: int) -> list[tuple[float, float]]:
    """Directions of the even grid: where the response is steepest, and others drawn at random (seed 1)."""
    u, v = np.linspace(-u_max, u_max, SIDE), np.linspace(0, v_max, SIDE // 2 + 1)
    slope = np.abs(np.gradient(solve(cell, u, v, 12).q[..., 2], axis=0))
    steepest = np.unravel_index(slope.argmax(), slope.shape)
    others = np.random.default_rng(1).integers(0, [u.size, v.size], (count - 1, 2))
    return [(float(u[i]), float(v[j])) for i, j in [steepest, *others]]


def plain_way(cell: Metagrating, directions: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Largest error and mean CPU seconds of a direction at each resolution."""
    errors, seconds = np.zeros(len(RESOLUTIONS)), np.zeros(len(RESOLUTIONS))
    for u, v in directions:
        truth = solve(cell, np.array([u]), np.array([v]), ORDER).q[0, 0, [0, 2]]
        for i, resolution in enumerate(RESOLUTIONS):
            start = time.process_time()
            with plain():
                q = pressure(cell, u, v, resolution)
            seconds[i] += (time.process_time() - start) / len(directions)
            errors[i] = max(errors[i], float(np.abs(q - truth).max()))
    return errors, seconds


def our_way(cell: Metagrating, table: PressureTable, count: int) -> tuple[float, int]:
    """Mean CPU seconds of a direction of the table, from `count` drawn at random (seed 1), and how many it has."""
    attrs = table.attrs
    every = np.stack(np.meshgrid(attrs["nodes_u"], attrs["nodes_v"], indexing="ij"), axis=-1).reshape(-1, 2)
    drawn = np.random.default_rng(1).choice(every, min(count, len(every)), replace=False)
    settings = validate(attrs["settings"], FdtdSettings, table.name)
    start = time.process_time()
    for u, v in drawn:
        solve_direction(cell, float(u), float(v), settings)
    return (time.process_time() - start) / len(drawn), len(every)


def main() -> None:
    """Print what was sampled and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modal", required=True, type=Path)
    parser.add_argument("--fdtd", required=True, type=Path)
    parser.add_argument("--count", type=int, default=12, help="directions sampled (default %(default)s)")
    given = parser.parse_args()
    fine, ours = PressureTable.read(given.modal), PressureTable.read(given.fdtd)
    target = float(np.abs(ours.q(ours.u[:, None], ours.v) - fine.q(ours.u[:, None], ours.v)).max())
    with threadpool_limits(1):
        cell = read_metagrating(DESIGNS / f"{ours.name}.yaml")
        import_meep()  # takes a second, which belongs to no direction
        errors, seconds = plain_way(cell, sample(cell, float(ours.u[-1]), float(ours.v[-1]), given.count))
        each_of_ours, nodes = our_way(cell, ours, given.count)
    needed = RESOLUTIONS[-1] * np.sqrt(errors[-1] / target)
    total = seconds[-1] * (needed / RESOLUTIONS[-1]) ** 3 * SIDE * (SIDE // 2 + 1)
    spent = each_of_ours * nodes
    print(f"{given.count} directions sampled; times are CPU seconds")
    for resolution, error, each in zip(RESOLUTIONS, errors, seconds, strict=True):
        print(f"plain Meep at {resolution:g}/λ: {error:.3g} off at most, {each:.3g} s a direction")
    print(f"{ours.name}: table within {target:.3g} of the modal one")
    print(f"our way: {nodes} directions of {each_of_ours:.3g} s, {spent:.4g} s")
    print(f"plain way: {needed:.3g}/λ for that, {total:.4g} s; ratio {total / spent:.3g}")


if __name__ == "__main__":
    run_stage(main)
