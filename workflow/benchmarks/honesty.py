"""Do tables keep their promise? Random cells, made into tables by the command line, against far better solutions.

Cells: dielectric, absorbing and metallic, lamellar and of other profiles, of 1 to 4 layers, with periods of 0.3 to 20
wavelengths, and films of up to 1 mm. Of each, 200 random directions are looked up and solved with far more diffraction
orders (profiles: also with far more slices); how much that solution may itself be off is taken from a coarser one.
Printed for each cell: what the command said, the share of the directions within the tolerance, covered by the stated
error, and where that is over ten times the true one. SILENT marks a cell that is said to be met and is not. Cells that
are forecast to take longer than --most-minutes are refused by the command line, in its own words.

    python -m workflow.benchmarks.honesty [--seed 1] [--cells 60] [--tolerance 1e-2] [--most-minutes 5] [--out FILE]
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from beamrider.io.files import atomic, progress, run_stage
from optics.cells.outline import Grating, is_upright, upright
from optics.cells.schema import ThinFilm, read_cell
from optics.modal.stage import solve
from optics.modal.steps import modal_cell
from optics.table.pressure_table import PressureTable
from optics.table.promise import MISSED
from optics.thin_film import stage as thin_film

Floats = np.ndarray
WAVELENGTH = 1064.0
# n + ik: dielectrics; absorbers; silver, gold, tungsten near 1064 nm (Johnson & Christy, Phys. Rev. B 6, 4370; Palik).
DIELECTRIC = (1.45, 2.0, 2.4, 3.5)
ABSORBING = (2.0 + 0.01j, 3.5 + 0.1j, 1.7 + 0.3j)
METAL = (0.22 + 7.1j, 0.26 + 6.97j, 3.05 + 3.39j)
MATERIALS = {"dielectric": DIELECTRIC, "absorbing": ABSORBING, "metal": METAL}
KINDS = (
    *((kind, shape) for kind in MATERIALS for shape in ("lamellar", "profile")),
    ("dielectric", "film"),
    ("absorbing", "film"),
    ("metal", "film"),
)
RANGE = 0.2
ROWS, LINES = 20, 10  # of random directions
SECONDS = 3600  # a table may take at most, whatever was foreseen
STEPS = 128
MOST = 300  # diffraction orders, unless the table itself took as many


@dataclass(frozen=True)
class Outcome:
    """What came of one cell; shares are NaN where no table was made."""

    name: str
    said: str
    within: float
    covered: float
    over_ten: float
    largest: float
    stated: float
    unsure: float
    seconds: float

    @property
    def silent(self) -> bool:
        """Said to be met, and is not."""
        return self.said == "met" and self.within < 0.99


def _index(value: complex) -> dict[str, float]:
    return {"n": complex(value).real, "k": complex(value).imag}


def _layers(rng: np.random.Generator, kind: str, period: float) -> list[dict[str, Any]]:
    """1 to 4 lamellar layers, at least one of them patterned, in units of nm."""
    count, out = int(rng.integers(1, 5)), []
    for i in range(count):
        layer: dict[str, Any] = {
            "thickness_nm": WAVELENGTH * rng.uniform(0.05, 0.6),
            "index": _index(rng.choice([1.0, *DIELECTRIC])),
        }
        if i == 0 or rng.random() < 0.5:
            cuts = period * np.sort(rng.uniform(0.0, 1.0, 2 * int(rng.integers(1, 3))))
            layer["ridges"] = [
                {"start_nm": float(a), "width_nm": float(b - a), "index": _index(rng.choice(MATERIALS[kind]))}
                for a, b in zip(cuts[::2], cuts[1::2], strict=True)
            ]
        out.append(layer)
    return out


def _profile(rng: np.random.Generator, kind: str, period: float) -> dict[str, Any]:
    """A blazed or slanted or trapezoidal ridge on a membrane."""
    height, base = WAVELENGTH * rng.uniform(0.1, 0.8, 2)
    foot, top = np.sort(rng.uniform(0.0, period, 2)), np.sort(rng.uniform(0.0, period, 2))
    ridge = [[foot[0], height], [top[0], 0.0], [top[1], 0.0], [foot[1], height]]
    flat = [[0.0, height], [period, height], [period, height + base], [0.0, height + base]]
    chosen = _index(rng.choice(MATERIALS[kind]))
    polygons = [{"index": chosen, "vertices_nm": [[float(g), float(n)] for g, n in shape]} for shape in (flat, ridge)]
    return {"kind": "profile", "depth_nm": float(height + base), "polygons": polygons}


def random_cell(rng: np.random.Generator, k: int) -> dict[str, Any]:
    """The k-th random cell, as its YAML file holds it; kinds take turns."""
    kind, shape = KINDS[k % len(KINDS)]
    common: dict[str, Any] = {"name": f"{kind}_{shape}_{k}", "wavelength_nm": WAVELENGTH}
    if shape == "film":
        layers = [
            {"thickness_nm": float(10 ** rng.uniform(1.0, 6.0)), "index": _index(rng.choice(MATERIALS[kind]))}
            for _ in range(int(rng.integers(1, 5)))
        ]
        return common | {"kind": "thin_film", "layers": layers, "polarisation": str(rng.choice(["s", "p", "mean"]))}
    period = WAVELENGTH * float(np.exp(rng.uniform(np.log(0.3), np.log(20.0))))
    common |= {"period_nm": period, "electric_axis": str(rng.choice(["g", "r"]))}
    if shape == "profile":
        return common | _profile(rng, kind, period)
    back = rng.choice([1.0, 1.45])
    return common | {"kind": "lamellar", "layers": _layers(rng, kind, period), "surroundings": {"back": float(back)}}


def _made(path: Path, cell: dict[str, Any], tolerance: float, most_minutes: float) -> tuple[str, PressureTable | None]:
    """What the command line says of a cell, in a word or in its own, and its table."""
    film = cell["kind"] == "thin_film"
    module, ranges = (
        ("optics.thin_film", ["--u-max", "0.9"])
        if film
        else ("optics.modal", ["--u-max", str(RANGE), "--v-max", str(RANGE), "--most-minutes", str(most_minutes)])
    )
    out = path.with_suffix(".h5")
    command = [sys.executable, "-m", module, "--cell", str(path), "--out", str(out), "--tolerance", str(tolerance)]
    try:
        done = subprocess.run([*command, *ranges], capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return f"over {SECONDS} s", None
    if done.returncode in (0, MISSED):
        table = PressureTable.read(out)
        return "met" if done.returncode == 0 else f"missed: {table.attrs['missed_because']}", table
    lines = done.stderr.strip().splitlines()
    return f"exit {done.returncode}: {lines[-1] if lines else ''}", None


def _truth(grating: Grating, u: Floats, v: Floats, order: int) -> tuple[Floats, Floats]:
    """q (n_u, n_v, 3) from far more orders, and how far that may be off (n_u, n_v): its change from half of them.

    Walls that are not upright: from `STEPS` steps, off by their change from half of these as well.
    """
    least = int((max(grating.surroundings.front, grating.surroundings.back) + RANGE) / grating.pitch)
    best = min(max(3 * order, least + 60), max(MOST, 3 * order // 2))
    if is_upright(grating):
        q, half = (np.asarray(solve(upright(grating, 1), u, v, n).q) for n in (best, best // 2))
        return q, np.abs(q - half).max(axis=-1)
    best = min(best, max(2 * order, order + 8))
    q, half, fewer = (
        np.asarray(solve(modal_cell(grating, count), u, v, n).q)
        for count, n in ((STEPS, best), (STEPS // 2, best), (STEPS // 2, best // 2))
    )
    return q, (np.abs(q - half) + np.abs(half - fewer)).max(axis=-1)


def _film_truth(film: ThinFilm, s: Floats) -> tuple[Floats, Floats]:
    q, _ = thin_film.pressure(film, s)
    return q, np.full(s.shape, 1e-9)


def judge(path: Path, cell: dict[str, Any], tolerance: float, most_minutes: float, rng: np.random.Generator) -> Outcome:
    """Make the table of a cell and look at it."""
    said, table = _made(path, cell, tolerance, most_minutes)
    if table is None:
        return Outcome(cell["name"], said, *[float("nan")] * 7)
    grating = read_cell(path)
    if isinstance(grating, ThinFilm):
        u, v = 0.9 * np.sqrt(rng.uniform(0.0, 1.0, ROWS * LINES)), np.zeros(ROWS * LINES)
        q, unsure = _film_truth(grating, u)
    else:
        u, v = np.sort(rng.uniform(-RANGE, RANGE, ROWS)), np.sort(rng.uniform(0.0, RANGE, LINES))
        with threadpool_limits(1):
            q, unsure = _truth(grating, u, v, int(table.attrs["settings"]["orders"]))
        u, v = u[:, None], v[None, :]
    error, stated = np.abs(table.q(u, v) - q).max(axis=-1), table.stated_error(u, v)
    sure = np.maximum(error - unsure, 0.0)
    return Outcome(
        cell["name"],
        said,
        float((sure <= tolerance).mean()),
        float((sure <= stated).mean()),
        float((stated > 10 * (error + unsure)).mean()),
        float(error.max()),
        float(table.error.max()),
        float(np.median(unsure)),
        float(table.attrs["cpu_seconds"]),
    )


def outcomes(seed: int, cells: range, tolerance: float, most_minutes: float, only: str) -> Iterator[Outcome]:
    """One cell after the other; each depends on the seed and its own number only."""
    with tempfile.TemporaryDirectory() as folder:
        for k in progress(cells, "honesty", unit="cell"):
            rng = np.random.default_rng([seed, k])
            cell = random_cell(rng, k)
            if only not in cell["name"]:
                continue
            path = Path(folder) / f"{cell['name']}.yaml"
            path.write_text(json.dumps(cell), encoding="utf-8")
            yield judge(path, cell, tolerance, most_minutes, rng)


def _line(one: Outcome) -> str:
    mark = " SILENT" if one.silent else ""
    return (
        f"{one.name:24s} {one.within:8.1%} {one.covered:8.1%} {one.over_ten:9.1%} {one.largest:9.1e} {one.stated:9.1e} "
        f"{one.unsure:9.1e} {one.seconds:8.1f}  {one.said}{mark}"
    )


def _total(every: list[Outcome]) -> str:
    made = [one for one in every if np.isfinite(one.within)]
    met = [one for one in made if one.said == "met"]
    shares = [
        np.mean([getattr(one, name) for one in group]) if group else np.nan
        for group, name in (
            (met, "within"),
            (made, "covered"),
            (made, "over_ten"),
        )
    ]
    return (
        f"{len(every)} cells: {len(met)} met, {len(made) - len(met)} missed, {len(every) - len(made)} refused or not "
        f"ended; within tolerance where met {shares[0]:.2%}, covered {shares[1]:.2%}, over ten times {shares[2]:.1%}, "
        f"silent {sum(one.silent for one in every)}"
    )


def main() -> None:
    """Print one line a cell and the totals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cells", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="number of the first cell: to go on with a run")
    parser.add_argument("--only", default="", help="cells whose names hold this, as film, lamellar or metal_profile")
    parser.add_argument("--tolerance", type=float, default=1e-2)
    parser.add_argument("--most-minutes", type=float, default=5.0, help="CPU minutes that a table may take")
    parser.add_argument("--out", type=Path, help="CSV to write")
    given = parser.parse_args()
    print(
        f"{'cell':24s} {'within':>8s} {'covered':>8s} {'over 10 x':>9s} {'largest':>9s} {'stated':>9s} "
        f"{'unsure':>9s} {'CPU s':>8s}  said",
        flush=True,
    )
    every = []
    for one in outcomes(given.seed, range(given.first, given.cells), given.tolerance, given.most_minutes, given.only):
        every.append(one)
        print(_line(one), flush=True)
    print(_total(every))
    if given.out:
        with atomic(given.out) as temporary, open(temporary, "w", encoding="utf-8", newline="") as stream:
            rows = csv.writer(stream, lineterminator="\n")
            rows.writerow(Outcome.__dataclass_fields__)
            rows.writerows(vars(one).values() for one in every)


if __name__ == "__main__":
    run_stage(main)
