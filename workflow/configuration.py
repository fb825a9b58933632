"""What the workflow makes: `workflow/config.yaml`, strictly validated, and what follows from it and from the scenes."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from dynamics.scene import Scene, read_scene
from optics.cells import Cell, Metagrating, read_cell
from optics.files import InputError, Strict, validate

SOURCE = "workflow/config.yaml"

Tolerance = Annotated[float, Field(gt=0, lt=1)]
Cosine = Annotated[float, Field(gt=0, lt=1)]
# A value given on the command line (`--config fdtd=false`) comes as text.
Switch = Annotated[Literal["auto", True, False], BeforeValidator(lambda x: {"true": True, "false": False}.get(x, x))]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]


class Grid(Strict):
    """Range of direction cosines that a solver's tables cover, and the error of q aimed at."""

    u_max: Cosine
    v_max: Cosine
    tolerance: Tolerance


class Config(Strict):
    """`config.yaml`; the comments there say what each key means."""

    designs: list[Name]
    tables: Literal["modal", "fdtd"]
    modal: Grid
    fdtd: Switch
    fdtd_designs: list[Name]
    fdtd_parts: Annotated[int, Field(ge=1, le=1000)]
    fdtd_grid: Grid
    fdtd_tolerance: Tolerance
    floquet: list[Name]
    rigid: list[Name]
    flight: list[Name]


def meep_installed() -> bool:
    """Is Meep (not the other package called `meep`) on the path? Found without importing it, which takes a second."""
    spec = importlib.util.find_spec("meep")
    return bool(spec and spec.origin and any(Path(spec.origin).parent.glob("_meep*")))


@dataclass(frozen=True)
class Plan:
    """The configuration with the scenes and cells it names, all read and checked, and whether FDTD is run."""

    config: Config
    scenes: dict[str, Scene]
    cells: dict[str, Cell]
    fdtd: bool

    @property
    def gratings(self) -> list[str]:
        """Designs that are metagratings."""
        return [name for name, cell in self.cells.items() if isinstance(cell, Metagrating)]

    @property
    def films(self) -> list[str]:
        """Designs that are plain films."""
        return [name for name in self.cells if name not in self.gratings]

    @property
    def fdtd_designs(self) -> list[str]:
        """Designs that FDTD solves: none where it is off."""
        return self.config.fdtd_designs if self.fdtd else []

    @property
    def fdtd_scenes(self) -> list[str]:
        """Scenes of the stability analysis whose every grating has an FDTD table."""
        return [s for s in self.config.floquet if set(self.scenes[s].sail.designs) <= {*self.fdtd_designs, *self.films}]

    def table(self, design: str, solver: str) -> str:
        """Path of a design's pressure table; a film's comes from the transfer matrix whatever the `solver`."""
        return f"results/tables/{design}/{'thin_film' if design in self.films else solver}.h5"

    def tables(self, scene: str, solver: str | None = None) -> list[str]:
        """Paths of the tables that a scene flies on."""
        return [self.table(design, solver or self.config.tables) for design in self.scenes[scene].sail.designs]

    def parts(self, design: str) -> list[str]:
        """Paths of the blocks of directions that a design's FDTD table is merged from."""
        return [f"results/tables/{design}/fdtd/part{i}.h5" for i in range(1, self.config.fdtd_parts + 1)]

    @property
    def all_tables(self) -> list[str]:
        """Paths of every table: of each design, and again by FDTD."""
        return [*(self.table(d, "modal") for d in self.cells), *(self.table(d, "fdtd") for d in self.fdtd_designs)]

    @property
    def all_floquet(self) -> list[str]:
        """Paths of every stability analysis."""
        once = [f"results/scenes/{scene}/floquet.json" for scene in self.config.floquet]
        return once + [f"results/scenes/{scene}/floquet_fdtd.json" for scene in self.fdtd_scenes]

    @property
    def all_flights(self) -> list[str]:
        """Paths of every rigid and flexible flight."""
        rigid = [f"results/scenes/{scene}/rigid.h5" for scene in self.config.rigid]
        return rigid + [f"results/scenes/{scene}/flight.vtkhdf" for scene in self.config.flight]

    @property
    def benchmarks(self) -> list[str]:
        """Paths of the benchmark files of all of these, the parts and directions of FDTD included."""
        parts = [path for design in self.fdtd_designs for path in self.parts(design)]
        nodes = [f"results/tables/{design}/fdtd/nodes.json" for design in self.fdtd_designs]
        stages = map(Path, [*self.all_tables, *nodes, *parts, *self.all_floquet, *self.all_flights])
        return [Path("results/benchmarks", *stage.with_suffix(".tsv").parts[1:]).as_posix() for stage in stages]

    @property
    def figures(self) -> list[str]:
        """Names of the figures, without ending."""
        names = [f"pressure_{design}" for design in self.gratings]
        names += [f"snapshots_{scene}" for scene in self.config.flight]
        names += ["fdtd"] if self.fdtd_designs else []
        names += ["multipliers"] if self.config.floquet else []
        return names + (["flights"] if self.all_flights else [])


def _refuse(plan: Plan) -> None:
    """InputError where the parts of the configuration contradict each other."""
    for i, design in enumerate(plan.config.fdtd_designs):
        if design not in plan.gratings:
            raise InputError(f"{SOURCE}: fdtd_designs.{i} = {design!r}: must be a metagrating; FDTD solves no films")
    for scene in plan.scenes if plan.config.tables == "fdtd" else ():
        missing = [d for d in plan.scenes[scene].sail.designs if d not in (*plan.fdtd_designs, *plan.films)]
        for design in missing:
            why = "name it in fdtd_designs" if plan.fdtd else "FDTD is off or Meep is not installed"
            raise InputError(f"{SOURCE}: tables = 'fdtd': scene '{scene}' has no FDTD table of '{design}': {why}")


def read_plan(data: dict[str, Any], root: str | Path = ".") -> Plan:
    """The plan of a configuration; InputError names the file, the field and what is allowed."""
    folder = Path(root) / "workflow"
    config = validate(data, Config, SOURCE)
    names = dict.fromkeys([*config.floquet, *config.rigid, *config.flight])
    scenes = {name: read_scene(folder / "scenes" / f"{name}.yaml") for name in names}
    used = [design for scene in scenes.values() for design in scene.sail.designs]
    cells = {}
    for design in dict.fromkeys([*config.designs, *config.fdtd_designs, *used]):
        path = folder / "designs" / f"{design}.yaml"
        cells[design] = read_cell(path)
        if cells[design].name != design:
            raise InputError(f"{path}: name = '{cells[design].name}': must be the file's own name, '{design}'")
    plan = Plan(config, scenes, cells, meep_installed() if config.fdtd == "auto" else config.fdtd)
    _refuse(plan)
    return plan
