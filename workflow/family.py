"""Families of designs: ranges, lists or random errors for parameters of a sail's two cells, its sectors and its beam.

    python -m workflow.family --family workflow/designs/search.yaml --out DIR

expands a family to DIR/cells.jsonl, every cell once, and DIR/members.parquet, one row a sail: its parameters and the
numbers of its two cells. Member 0 is the base scene's own sail.
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import Discriminator, Field, Tag, model_validator
from scipy.special import ndtri
from scipy.stats import qmc

from beamrider.arrays import Floats
from beamrider.io.files import (
    DIMENSIONLESS,
    InputError,
    Name,
    Positive,
    Stopwatch,
    Strict,
    finish,
    read_model,
    run_stage,
    validate,
    write_lines,
)
from beamrider.io.parquet import write_parquet
from beamrider.provenance.record import as_attribute
from dynamics.sail.forecast import A_MADE_MEMBER, require_members
from dynamics.scene.schema import Scene, read_scene
from optics.cells.schema import Metagrating, read_metagrating

Count = Annotated[int, Field(ge=1, le=1_000_000, json_schema_extra=DIMENSIONLESS)]
MOST = 2_000_000
OWN: dict[str, Any] = {"unit": "that of the parameter"}


class Range(Strict):
    """Evenly from `low` to `high`: `count` values of a product, any value in a sample."""

    low: Annotated[float, Field(json_schema_extra=OWN)]
    """Least value."""
    high: Annotated[float, Field(json_schema_extra=OWN)]
    """Largest value."""
    count: Annotated[int, Field(ge=2, le=100_000, json_schema_extra=DIMENSIONLESS)] | None = None
    """Number of values, of a product."""

    @model_validator(mode="after")
    def _ascending(self) -> Range:
        if self.high <= self.low:
            raise ValueError(f"high = {self.high:g}: must be greater than low = {self.low:g}")
        return self


class Spread(Strict):
    """Normal errors of standard deviation `sigma` about the base."""

    sigma: Annotated[Positive, Field(json_schema_extra=OWN)]
    """Standard deviation."""


class Factors(Strict):
    """The base times each factor of a range."""

    times: Range
    """The factors."""


def _kind(data: Any) -> str:
    """Which of the forms a parameter's values have, for errors that speak of that form alone."""
    keys = data if isinstance(data, dict) else vars(data) if isinstance(data, Strict) else {}
    if isinstance(data, list):
        return "list"
    return "errors" if "sigma" in keys else "factors" if "times" in keys else "range"


Values = Annotated[
    Annotated[Annotated[list[float], Field(min_length=1)], Tag("list")]
    | Annotated[Range, Tag("range")]
    | Annotated[Spread, Tag("errors")]
    | Annotated[Factors, Tag("factors")],
    Discriminator(_kind),
]


class CellRanges(Strict):
    """Parameters of a two-ridge cell, along +g: wide ridge from 0, gap, narrow ridge, rest empty. Lengths in nm."""

    period_nm: Values | None = None
    """Period."""
    wide_nm: Values | None = None
    """Width of the wide ridge, which starts at 0."""
    gap_nm: Values | None = None
    """Gap between the ridges."""
    narrow_nm: Values | None = None
    """Width of the narrow ridge."""
    ridge_height_nm: Values | None = None
    """Height of the ridges."""
    membrane_nm: Values | None = None
    """Thickness of the membrane."""
    index_n: Annotated[Values | None, Field(json_schema_extra=DIMENSIONLESS)] = None
    """Real part of the refractive index."""
    index_k: Annotated[Values | None, Field(json_schema_extra=DIMENSIONLESS)] = None
    """Its imaginary part."""


class SailRanges(Strict):
    """Opening angle of the sectors of the first cell, spin and 1/e² radius of the beam."""

    sector_deg: Values | None = None
    """Opening angle of the sectors of the first cell."""
    spin_Hz: Values | None = None
    """Spin, signed."""
    beam_radius_m: Values | None = None
    """1/e² intensity radius of the beam."""


class Sample(Strict):
    """How members are drawn."""

    kind: Literal["product", "sobol", "normal"] = "product"
    """Every combination, a Sobol sequence, or independent normal errors."""
    count: Count | None = None
    """Members that are drawn; for 'sobol' and 'normal', and for these only."""
    seed: Annotated[int, Field(json_schema_extra=DIMENSIONLESS)] = 0
    """Seed of the random numbers."""
    scales: Annotated[list[Positive], Field(min_length=1, json_schema_extra=DIMENSIONLESS)] = [1.0]
    """Each normal draw comes once with its errors times each scale."""

    @model_validator(mode="after")
    def _counted(self) -> Sample:
        if (self.count is None) != (self.kind == "product"):
            raise ValueError("count: must be given for kind sobol and normal, and for these only")
        if self.kind != "normal" and self.scales != [1.0]:
            raise ValueError("scales: must be given for kind normal only")
        return self


class Best(Strict):
    """How many members go on to FDTD, basin map and flexible flight, and by what they are ranked.

    Among survivors at least as good as the base sail in each of `at_least`.
    """

    count: Annotated[int, Field(ge=0, le=100, json_schema_extra=DIMENSIONLESS)] = 0
    """Number of members that go on."""
    by: Literal["margin_1_s", "thrust_N", "acceleration_m_s2"] = "margin_1_s"
    """What survivors are ranked by."""
    at_least: list[Literal["margin_1_s", "thrust_N", "acceleration_m_s2"]] = ["thrust_N"]
    """Measures in which they must be no worse than the base sail."""


class Family(Strict):
    """A family: the base scene with what varies of the cells (te: first design, tm: second, both) and of the sail.

    Parameters of `both` change alike in both cells, as those of one membrane do.
    """

    kind: Literal["family"]
    """What the design is."""
    name: Name
    """Name of the family, that of the file without its ending."""
    description: str
    """What the family is, in words."""
    scene: Name
    """Scene whose sail is the base of the family."""
    te: CellRanges = CellRanges()
    """What varies of the first design's cell."""
    tm: CellRanges = CellRanges()
    """What varies of the second design's cell."""
    both: CellRanges = CellRanges()
    """What varies of both alike."""
    sail: SailRanges = SailRanges()
    """What varies of sail and beam."""
    sample: Sample = Sample()
    """How members are drawn."""
    orders: Annotated[int, Field(ge=4, le=60, json_schema_extra={"unit": "diffraction orders"})] = 15
    """Highest diffraction order that the cells are solved with."""
    best: Best = Best()
    """The members that go on."""

    @model_validator(mode="after")
    def _fits(self) -> Family:
        varied = self.varied
        if not varied:
            raise ValueError("nothing varies: give te, tm, both or sail a parameter")
        for name in CellRanges.model_fields:
            if getattr(self.both, name) is not None and (getattr(self.te, name) or getattr(self.tm, name)) is not None:
                raise ValueError(f"both.{name}: varies in te or tm already")
        wanted = {
            "product": (list, Range, Factors),
            "sobol": (list, Range, Factors),
            "normal": (Spread,),
        }[self.sample.kind]
        for key, values in varied.items():
            if not isinstance(values, wanted):
                even = "a list, {low, high} or {times: {low, high}}"
                allowed = "{sigma: …}" if self.sample.kind == "normal" else even
                raise ValueError(f"{key}: must be {allowed} where sample.kind = {self.sample.kind}")
            grid = values.times if isinstance(values, Factors) else values
            if self.sample.kind == "product" and isinstance(grid, Range) and grid.count is None:
                raise ValueError(f"{key}: must have a count where sample.kind = product")
        return self

    @property
    def varied(self) -> dict[str, Any]:
        """What varies, by place, as in 'te.gap_nm'."""
        groups = ((name, getattr(self, name)) for name in ("te", "tm", "both", "sail"))
        return {
            f"{name}.{key}": values
            for name, group in groups
            for key in type(group).model_fields
            if (values := getattr(group, key)) is not None
        }

    @property
    def most_cells(self) -> int:
        """Cells that are solved, at most: of one kind and of the other."""
        if self.sample.kind != "product":
            return 2 * (self.sample.count or 0) * len(self.sample.scales)
        sizes = {key: _count(values) for key, values in self.varied.items()}
        kinds = (("te.", "both."), ("tm.", "both."))
        return sum(math.prod(n for key, n in sizes.items() if key.startswith(kind)) for kind in kinds)


def _count(values: Any) -> int:
    """How many values of a product's parameter there are."""
    values = values.times if isinstance(values, Factors) else values
    return (values.count or 2) if isinstance(values, Range) else len(values)


def read_family(path: str | Path) -> Family:
    """The family in a YAML file; InputError names the file, the field and what is allowed."""
    family = read_model(path, Family)
    if family.name != Path(path).stem:
        raise InputError(f"{path}: name = '{family.name}': must be the file's own name, '{Path(path).stem}'")
    return family


def cell_parameters(cell: Metagrating) -> dict[str, float]:
    """The parameters of a two-ridge cell; InputError for any other."""
    if len(cell.ridges_nm) != 2 or cell.ridges_nm[0][0] != 0.0:
        raise InputError(f"{cell.name}: ridges_nm: a family's cell must have two ridges, the first from 0")
    (_, wide), (start, narrow) = cell.ridges_nm
    return {
        "period_nm": cell.period_nm,
        "wide_nm": wide,
        "gap_nm": start - wide,
        "narrow_nm": narrow,
        "ridge_height_nm": cell.ridge_height_nm,
        "membrane_nm": cell.membrane_nm,
        "index_n": cell.index.n,
        "index_k": cell.index.k,
    }


def make_cell(base: Metagrating, p: dict[str, float], name: str, source: str = "") -> Metagrating | None:
    """The base cell with other parameters; None where its ridges do not fit or overlap.

    InputError, after the name of the `source`, where it is no cell for another reason.
    """
    if min(p["wide_nm"], p["gap_nm"], p["narrow_nm"], p["ridge_height_nm"], p["membrane_nm"]) <= 0.0:
        return None
    if p["wide_nm"] + p["gap_nm"] + p["narrow_nm"] > p["period_nm"]:
        return None
    data = base.model_dump() | {
        "name": name,
        "period_nm": p["period_nm"],
        "ridges_nm": [[0.0, p["wide_nm"]], [p["wide_nm"] + p["gap_nm"], p["narrow_nm"]]],
        "ridge_height_nm": p["ridge_height_nm"],
        "membrane_nm": p["membrane_nm"],
        "index": {"n": p["index_n"], "k": p["index_k"]},
    }
    return validate(data, Metagrating, f"{source}: cell {name}" if source else name)


def base_parameters(scene: Scene, cells: list[Metagrating]) -> dict[str, float]:
    """Parameters of the base sail by place, as in 'te.gap_nm'; InputError where it is not a four-sector sail."""
    starts = [sector.from_deg for sector in scene.sail.sectors]
    half = starts[0]
    if len(starts) != 4 or not np.allclose(starts, [half, 180 - half, 180 + half, 360 - half]):
        raise InputError(f"{scene.name}.yaml: sail.sectors: a family needs four, from a, 180 − a, 180 + a and 360 − a")
    out = {
        f"{group}.{key}": x
        for group, cell in zip(("te", "tm"), cells, strict=True)
        for key, x in cell_parameters(cell).items()
    }
    return out | {
        "sail.sector_deg": 2.0 * half,
        "sail.spin_Hz": scene.release.spin_Hz,
        "sail.beam_radius_m": scene.beam.radius_m,
    }


def _targets(key: str) -> list[str]:
    """Parameters that a place sets: both cells' for 'both.…'."""
    group, _, name = key.partition(".")
    return [f"te.{name}", f"tm.{name}"] if group == "both" else [key]


def _axis(values: Any, base: float, at: Floats | None) -> Floats:
    """Values of one parameter: all of a product, or those at quantiles `at` in 0 … 1."""
    if isinstance(values, Factors):
        return base * _axis(values.times, 1.0, at)
    if isinstance(values, Spread):
        return base + values.sigma * ndtri(np.asarray(at))
    if isinstance(values, Range):
        share = np.linspace(0.0, 1.0, values.count or 2) if at is None else at
        return values.low + (values.high - values.low) * share
    options = np.array(values, float)
    return options if at is None else options[np.minimum((at * options.size).astype(int), options.size - 1)]


def expand(family: Family, base: dict[str, float]) -> pd.DataFrame:
    """Parameters of every member, one column a place and `scale`; the base sail first."""
    varied, sample = family.varied, family.sample
    if sample.kind == "product":
        axes = {key: {t: _axis(values, base[t], None) for t in _targets(key)} for key, values in varied.items()}
        sizes = [next(iter(axis.values())).size for axis in axes.values()]
        total = math.prod(sizes)
        if total > MOST:
            raise InputError(f"{family.name}: {total} members: must be at most {MOST}; use sample.kind sobol")
        require_members(total, f"{family.name}.yaml", "vary less, or use sample.kind: sobol", A_MADE_MEMBER)
        picks = np.array(list(itertools.product(*map(range, sizes)))).reshape(total, len(sizes))
        columns = {t: x[picks[:, i]] for i, axis in enumerate(axes.values()) for t, x in axis.items()}
        return _members(base, columns, np.ones(total))
    count = sample.count or 0
    drawn_at_all = count * len(sample.scales)
    require_members(drawn_at_all, f"{family.name}.yaml: sample.count = {count}", "draw fewer", A_MADE_MEMBER)
    if sample.kind == "sobol":
        at = qmc.Sobol(len(varied), seed=sample.seed).random_base2(max(0, int(np.ceil(np.log2(count)))))[:count]
    else:
        at = np.random.default_rng(sample.seed).uniform(1e-12, 1.0 - 1e-12, (count, len(varied)))
    places = [(i, t, values) for i, (key, values) in enumerate(varied.items()) for t in _targets(key)]
    drawn = {t: _axis(values, base[t], at[:, i]) for i, t, values in places}
    scale = np.repeat(sample.scales, count)
    columns = {t: base[t] + scale * (np.tile(x, len(sample.scales)) - base[t]) for t, x in drawn.items()}
    return _members(base, columns if sample.kind == "normal" else drawn, scale)


def _members(base: dict[str, float], columns: dict[str, Floats], scale: Floats) -> pd.DataFrame:
    """A row for the base sail and one for each member."""
    data = {key: np.concatenate([[value], columns.get(key, np.full(scale.size, value))]) for key, value in base.items()}
    return pd.DataFrame(data | {"scale": np.concatenate([[0.0], scale])})


def number_cells(
    members: pd.DataFrame, bases: list[Metagrating], source: str = ""
) -> tuple[pd.DataFrame, list[Metagrating]]:
    """Members with the numbers of their cells (−1: impossible), and every cell once; `source` as in `make_cell`."""
    cells: list[Metagrating] = []
    for group, base in zip(("te", "tm"), bases, strict=True):
        names = [key for key in members if str(key).startswith(f"{group}.")]
        rows, inverse = np.unique(members[names].to_numpy(), axis=0, return_inverse=True)
        numbers = []
        for row in rows:
            parameters = {str(name)[3:]: float(x) for name, x in zip(names, row, strict=True)}
            cell = make_cell(base, parameters, f"{group}{len(cells)}", source)
            numbers.append(len(cells) if cell else -1)
            cells += [cell] if cell else []
        members = members.assign(**{f"{group}_cell": np.array(numbers)[inverse.ravel()]})
    return members, cells


def write(folder: Path, family: Family, scene: Scene, bases: list[Metagrating]) -> tuple[int, int]:
    """Write the cells and the members of a family; how many there are of each."""
    members, cells = number_cells(expand(family, base_parameters(scene, bases)), bases, f"{family.name}.yaml")
    write_lines(folder / "cells.jsonl", [cell.model_dump() for cell in cells])
    members.attrs |= as_attribute()
    write_parquet(folder / "members.parquet", members.to_parquet(index=False))
    return len(cells), len(members)


def main() -> None:
    """Expand a family of designs."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--family", required=True, help="YAML file of the family")
    parser.add_argument("--workflow", default="workflow", type=Path, help="folder of scenes and designs")
    parser.add_argument("--out", required=True, type=Path, help="folder to write to")
    given = parser.parse_args()
    watch = Stopwatch()
    family = read_family(given.family)
    scene = read_scene(given.workflow / "scenes" / f"{family.scene}.yaml")
    designs = [sector.design for sector in scene.sail.sectors]
    order = sorted(dict.fromkeys(designs), key=lambda design: design != designs[-1])
    if len(order) != 2 or None in order:
        raise InputError(f"{family.scene}.yaml: sail.sectors: a family needs sectors of two designs")
    bases = [read_metagrating(given.workflow / "designs" / f"{d}.yaml") for d in order]
    cells, members = write(given.out, family, scene, bases)
    finish(given.out / "members.parquet", watch, f"{members:,} members of {cells:,} cells, which are solved next")


if __name__ == "__main__":
    run_stage(main)
