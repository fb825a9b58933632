"""Do FDTD and the modal method agree? Values and limits as JSON; ends with one line where a limit is exceeded.

The limits lie above what the configuration as delivered gives: what exceeds them is an error, or too coarse to be used.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from beamrider.io.files import InputError, Stopwatch, finish, read_json, run_stage, take_out, write_json
from dynamics.stability.floquet import distance
from optics.table.pressure_table import PressureTable

LARGEST, NEARLY_ALL, MULTIPLIERS, ABSORPTANCE = 0.015, 0.0075, 1e-2, 0.03


@dataclass(frozen=True)
class Check:
    """A difference of FDTD and the modal method, and what it may be at most; `of` a design or a scene."""

    of: str
    quantity: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Is the value within its limit? NaN is not."""
        return self.value <= self.limit


def table_checks(modal: Path, fdtd: Path) -> Iterator[Check]:
    """|Δq| (q_g, q_n) over the directions of the FDTD table, largest and 95 %; the absorptance at normal incidence."""
    rough, fine = PressureTable.read(fdtd), PressureTable.read(modal)
    q = fine.q(rough.u[:, None], rough.v)[..., [0, 2]]
    difference = np.abs(np.moveaxis(rough.q_nodes[[0, 2]], 0, -1) - q).max(axis=-1)
    yield Check(rough.name, "|Δq|, largest", float(difference.max()), LARGEST)
    yield Check(rough.name, "|Δq|, 95 % below", float(np.quantile(difference, 0.95)), NEARLY_ALL)
    # What the sail is heated by: where it flies, at the direction nearest to normal incidence
    i, j = np.argmin(np.abs(rough.u)), np.argmin(np.abs(rough.v))
    absorbed = float(fine.absorptance(rough.u[i], rough.v[j]))
    if absorbed > 0.0:
        off = abs(rough.absorptance_nodes[i, j] / absorbed - 1.0)
        yield Check(rough.name, "absorptance at normal incidence, relative", float(off), ABSORPTANCE)


def multiplier_checks(modal: Path, fdtd: Path) -> Iterator[Check]:
    """Largest distance between multipliers, paired off; none of a sail that does not spin, which has no multipliers."""
    one, other = (read_json(path) for path in (modal, fdtd))
    if one["multipliers"] and other["multipliers"]:
        gap = distance(*(np.array(data["multipliers"]) @ [1, 1j] for data in (one, other)))
        yield Check(one["scene"], "|Δλ|, largest", gap, MULTIPLIERS)


def judge(checks: list[Check]) -> None:
    """InputError, in one line, where there are checks that failed."""
    failed = [f"{c.of}: {c.quantity}: {c.value:.3g}, allowed {c.limit:g}" for c in checks if not c.passed]
    if failed:
        raise InputError(f"FDTD and the modal method disagree: {'; '.join(failed)}")


def main() -> None:
    """Check the tables and the stability analyses of a run."""
    watch = Stopwatch()
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("modal", "fdtd", "floquet", "floquet-fdtd"):
        parser.add_argument(f"--{name}", nargs="*", default=[], type=Path, help="as many, in the same order")
    parser.add_argument("--out", required=True, type=Path, help="JSON to write; none where a check fails")
    given = parser.parse_args()
    take_out(given.out)
    pairs = [(table_checks, given.modal, given.fdtd), (multiplier_checks, given.floquet, given.floquet_fdtd)]
    if any(len(modal) != len(fdtd) for _, modal, fdtd in pairs):
        raise InputError("--modal and --fdtd, --floquet and --floquet-fdtd: must be as many of the one as of the other")
    checks = [check for run, *files in pairs for pair in zip(*files, strict=True) for check in run(*pair)]
    judge(checks)
    write_json(given.out, {"checks": [{**asdict(check), "pass": check.passed} for check in checks]})
    finish(given.out, watch, f"{len(checks)} checks passed")


if __name__ == "__main__":
    run_stage(main)
