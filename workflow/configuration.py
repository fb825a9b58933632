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

Cosine = Annotated[float, Field(gt=0, lt=1)]
# A value given on the command line (`--config fdtd=false`) comes as text.
Switch = Annotated[Literal["auto", True, False], BeforeValidator(lambda x: {"true": True, "false": False}.get(x, x))]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+$")]


class Grid(Strict):
    """Range of direction cosines that a solver's tables cover, and the error of q aimed at."""

    u_max: Cosine
    v_max: Cosine
    tolerance: Annotated[float, Field(gt=0, lt=1)]


class Config(Strict):
    """`config.yaml`; the comments there say what each key means."""

    designs: list[Name]
    tables: Literal["modal", "fdtd"]
    modal: Grid
    fdtd: Switch
    fdtd_designs: list[Name]
    fdtd_parts: Annotated[int, Field(ge=1, le=1000)]
    fdtd_grid: Grid
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


def _refuse(plan: Plan) -> None:
    """InputError where the parts of the configuration contradict each other."""
    for i, design in enumerate(plan.config.fdtd_designs):
        if design not in plan.gratings:
            raise InputError(f"{SOURCE}: fdtd_designs.{i} = {design!r}: must be a metagrating; FDTD solves no films")
    for scene in plan.scenes if plan.config.tables == "fdtd" else ():
        for design in set(plan.scenes[scene].sail.designs) - {*plan.fdtd_designs, *plan.films}:
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
