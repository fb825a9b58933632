"""What the workflow makes: `workflow/config.yaml`, strictly validated, and what follows from it and from the scenes."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from beamrider.io.files import DIMENSIONLESS, InputError, Name, Strict, load_yaml, scalar, validate
from dynamics.sail.sectors import release_directions
from dynamics.scene.schema import Scene, read_scene
from optics.cells.schema import Cell, ThinFilm, read_cell

SOURCE = "workflow/config.yaml"
PROGRAM = ("workflow", "beamrider", "optics", "dynamics")

Tolerance = Annotated[float, Field(gt=0, lt=1, json_schema_extra=DIMENSIONLESS)]
Cosine = Annotated[float, Field(gt=0, lt=1, json_schema_extra=DIMENSIONLESS)]


def _no_number(given: Any) -> Any:
    """ValueError for 0 and 1, which Python takes for false and true."""
    if isinstance(given, int | float) and not isinstance(given, bool):
        raise ValueError("must be 'auto', true or false")
    return given


Switch = Annotated[Literal["auto", True, False], BeforeValidator(_no_number)]


class Grid(Strict):
    """Range of direction cosines that a solver's tables cover, and the error of q aimed at."""

    u_max: Cosine
    """Largest |u|, the direction cosine across the ridges."""
    v_max: Cosine
    """Largest |v|, along the ridges."""
    tolerance: Tolerance
    """Error of q aimed at."""


class Config(Strict):
    """What `snakemake` makes, in `workflow/config.yaml`; every key but `way` is needed."""

    designs: list[Name]
    """Tables made in any case, and families that are screened; scenes add the designs they fly."""
    tables: Literal["modal", "fdtd"]
    """The solver whose tables the scenes fly on; films always use the transfer matrix."""
    modal: Grid
    """Modal tables."""
    accept_missed: bool
    """Go on with tables whose error is larger than the tolerance asked for, or stop there.

    FDTD tables that no scene flies on stop nothing: what they miss is in the summary.
    """
    fdtd: Switch
    """Make FDTD tables; 'auto': where Meep is installed."""
    fdtd_designs: list[Name]
    """Designs that FDTD solves."""
    fdtd_grid: Grid
    """Range of FDTD tables, and the error of interpolation aimed at by choice of directions."""
    fdtd_tolerance: Tolerance
    """Tolerance of FDTD tables, a third of which is for each direction."""
    block_minutes: Annotated[float, Field(ge=0.1, le=1000)]
    """Time on one core of the jobs that FDTD tables, basin maps and the cells of families are split into."""
    floquet: list[Name]
    """Scenes whose linear stability is analysed, with FDTD tables again where their designs have them."""
    maps: list[Name]
    """Scenes whose forces and torques are mapped."""
    rigid: list[Name]
    """Scenes that are flown rigid."""
    flight: list[Name]
    """Scenes that are flown flexible."""
    basins: list[Name]
    """Scenes whose basins `snakemake basins` maps, with either incidence."""
    way: list[Name] = []
    """Scenes whose stability on the way to 0.2 c `snakemake way` follows."""


def meep_installed() -> bool:
    """Is Meep (not the other package called `meep`) on the path? Found without importing it, which takes a second."""
    spec = importlib.util.find_spec("meep")
    return bool(spec and spec.origin and any(Path(spec.origin).parent.glob("_meep*")))


@dataclass(frozen=True)
class Plan:
    """The configuration with the scenes and cells it names, all read and checked, and whether FDTD is run.

    folder: that of the workflow, where scenes and designs lie. families: designs that stand for
    many, with the number of the best that are confirmed.
    """

    config: Config
    scenes: dict[str, Scene]
    cells: dict[str, Cell]
    fdtd: bool
    folder: Path
    families: dict[str, int] = field(default_factory=dict)

    @property
    def gratings(self) -> list[str]:
        """Designs that are gratings of any kind."""
        return [name for name, cell in self.cells.items() if not isinstance(cell, ThinFilm)]

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
        """Scenes whose stability is analysed again with FDTD tables: those that fly on modal ones of its designs."""
        return [s for s in self.config.floquet if self.config.tables == "modal" and self._solved_by_fdtd(s)]

    def _solved_by_fdtd(self, scene: str) -> bool:
        """Has a scene gratings, and each of them an FDTD table?"""
        gratings = set(self.scenes[scene].sail.designs) - set(self.films)
        return bool(gratings) and gratings <= set(self.fdtd_designs)

    @property
    def files(self) -> dict[str, Scene | Cell]:
        """The scenes and cells by the files they were read from."""
        scenes = {f"workflow/scenes/{name}.yaml": scene for name, scene in self.scenes.items()}
        return scenes | {f"workflow/designs/{name}.yaml": cell for name, cell in self.cells.items()}

    def scene(self, name: str) -> Scene:
        """A scene of the configuration, or any other in workflow/scenes, read and checked now."""
        if name in self.scenes:
            return self.scenes[name]
        scene = read_scene(self.folder / "scenes" / f"{name}.yaml")
        cells = {design: _read_cell(self.folder, design) for design in scene.sail.designs}
        _refuse_tables(replace(self, scenes={name: scene}, cells=self.cells | cells))
        return scene

    def film(self, design: str) -> bool:
        """Is a design, of the configuration or any other in workflow/designs, a plain film?"""
        cell = self.cells.get(design) or _read_cell(self.folder, design)
        return isinstance(cell, ThinFilm)

    def table(self, design: str, solver: str) -> str:
        """Path of a design's pressure table; a film's comes from the transfer matrix whatever the `solver`."""
        return f"results/tables/{design}/{'thin_film' if self.film(design) else solver}.h5"

    def tables(self, scene: str, solver: str | None = None) -> list[str]:
        """Paths of the tables that a scene flies on."""
        return [self.table(design, solver or self.config.tables) for design in self.scene(scene).sail.designs]

    def parts(self, design: str) -> list[str]:
        """Paths of the blocks of directions that a design's FDTD table is merged from."""
        return [f"results/tables/{design}/fdtd/part{i}.h5" for i in range(1, self.fdtd_parts(design) + 1)]

    def fdtd_parts(self, design: str) -> int:
        """Jobs that a design's FDTD table is split into."""
        cell = self.cells.get(design) or _read_cell(self.folder, design)
        return 1 if isinstance(cell, ThinFilm) else self._blocks("fdtd_seconds", cell, self.config.fdtd_tolerance)

    def basin_parts(self, scene: str) -> int:
        """Jobs that a scene's basin map is split into."""
        return self._blocks("basin_seconds", self.scene(scene))

    def screening_parts(self, cells: int, orders: int) -> int:
        """Jobs that so many cells of a family are split into."""
        return self._blocks("cells_seconds", cells, orders)

    def _blocks(self, work: str, *of: Any) -> int:
        demands = importlib.import_module("workflow.demands")
        return int(demands.blocks(getattr(demands, work)(*of), self.config.block_minutes))

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
    def all_families(self) -> list[str]:
        """Paths of what is found out about every family, and about its best members."""
        screened = [f"results/screening/{family}/screened.parquet" for family in self.families]
        return screened + [f"results/screening/{family}/confirmed.md" for family, best in self.families.items() if best]

    @property
    def checks(self) -> list[str]:
        """Path of the comparison of FDTD with the modal method, where both are there to compare."""
        return ["results/checks.json"] if self.fdtd_designs else []

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
        names += [f"maps_{scene}" for scene in self.config.maps]
        names += [f"family_{family}" for family in self.families]
        names += [f"confirmed_{family}" for family, best in self.families.items() if best]
        return names + (["flights"] if self.all_flights else [])


def _refuse_tables(plan: Plan) -> None:
    """InputError where a scene is to fly on FDTD tables that are not made."""
    for name, scene in plan.scenes.items() if plan.config.tables == "fdtd" else ():
        missing = [d for d in scene.sail.designs if d not in (*plan.fdtd_designs, *plan.films)]
        for design in missing:
            why = "name it in fdtd_designs" if plan.fdtd else "FDTD is off or Meep is not installed"
            raise InputError(f"{SOURCE}: tables = 'fdtd': scene '{name}' has no FDTD table of '{design}': {why}")


def _refuse_ranges(plan: Plan) -> None:
    """InputError where a table would reach beyond the circle of directions, or FDTD's beyond the modal one."""
    modal, fdtd = plan.config.modal, plan.config.fdtd_grid
    for key, grid in (("modal", modal), ("fdtd_grid", fdtd)):
        square = grid.u_max**2 + grid.v_max**2
        if square >= 1:
            raise InputError(f"{SOURCE}: {key}: u_max² + v_max² = {square:.4g}: must be less than 1: no light beyond")
    for axis in ("u_max", "v_max") if plan.fdtd_designs else ():
        wide, most = getattr(fdtd, axis), getattr(modal, axis)
        if wide > most:
            raise InputError(f"{SOURCE}: fdtd_grid.{axis} = {wide:g}: must be at most modal.{axis} = {most:g}")


def _refuse_tilts(plan: Plan) -> None:
    """InputError where a scene is released with the light from beyond the range of the tables it flies on."""
    key = "modal" if plan.config.tables == "modal" else "fdtd_grid"
    grid = plan.config.modal if key == "modal" else plan.config.fdtd_grid
    for name in dict.fromkeys([*plan.config.rigid, *plan.config.flight]):
        scene = plan.scenes[name]
        gratings = [] if scene.outside_table == "clamp" else set(scene.sail.designs) & set(plan.gratings)
        for design, u, v in release_directions(scene):
            if design in gratings and (abs(u) > grid.u_max or abs(v) > grid.v_max):
                raise InputError(
                    f"{SOURCE}: {key}: u_max = {grid.u_max:g}, v_max = {grid.v_max:g}: too small for the release "
                    f"of scene '{name}', light from u = {u:.4g}, v = {v:.4g} on '{design}'; widen it, tilt "
                    "less, or set outside_table: clamp"
                )


def _refuse(plan: Plan) -> None:
    """InputError where the parts of the configuration contradict each other."""
    for i, design in enumerate(plan.config.fdtd_designs):
        if design not in plan.gratings:
            raise InputError(f"{SOURCE}: fdtd_designs[{i}] = {design!r}: must be a grating; FDTD solves no films")
    _refuse_tables(plan)
    _refuse_ranges(plan)
    _refuse_tilts(plan)


def _read_cell(folder: Path, design: str) -> Cell:
    path = folder / "designs" / f"{design}.yaml"
    cell = read_cell(path)
    if cell.name != design:
        raise InputError(f"{path}: name = '{cell.name}': must be the file's own name, '{design}'")
    return cell


def _families(folder: Path, designs: list[str]) -> dict[str, int]:
    """The designs that stand for many (`workflow.family`), checked, with the number of the best to be confirmed."""
    found = {}
    for design in designs:
        path = folder / "designs" / f"{design}.yaml"
        data = load_yaml(path)
        if isinstance(data, dict) and data.get("kind") == "family":
            family = importlib.import_module("workflow.family")  # only here: pandas takes a while
            found[design] = family.read_family(path).best.count
    return found


def read_config(paths: list[str | Path], given: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Content of configuration files, not yet validated: later ones and the command line's `given` overrule the first.

    InputError where a file is no mapping of keys to values.
    """
    merged: dict[str, Any] = {}
    for path in paths:
        data = load_yaml(path)
        if not isinstance(data, dict):
            found = "empty" if data is None else f"a {type(data).__name__}"
            raise InputError(f"{path}: must map keys ({', '.join(Config.model_fields)}) to values; it is {found}")
        merged = _merged(merged, data)
    return _merged(merged, _as_in_a_file(dict(given or {})))


def _merged(old: Any, new: Any) -> Any:
    """What is new overrules what is old, key by key in mappings."""
    if not (isinstance(old, dict) and isinstance(new, Mapping)):
        return new
    return {**old, **{key: _merged(old.get(key), value) for key, value in new.items()}}


def _as_in_a_file(value: Any) -> Any:
    """A value from the command line (`--config fdtd=false`), whose parts come as text."""
    if isinstance(value, Mapping):
        return {key: _as_in_a_file(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_as_in_a_file(part) for part in value]
    return scalar(value) if isinstance(value, str) else value


def link_program(program: Path, here: Path) -> None:
    """Make the folders of the program appear in `here`, where results are made, if that is another folder, by links.

    The program's own folder may then be one that cannot be written. InputError where something is in the way.
    """
    for name in PROGRAM if here.resolve() != program.resolve() else ():
        link, target = here / name, (program / name).resolve()
        try:
            if link.is_symlink() and link.resolve() != target:
                link.unlink()
            with contextlib.suppress(FileExistsError):
                link.symlink_to(target)
        except OSError as error:
            raise InputError(f"{here.resolve()}: results cannot be made here: {error.strerror}") from None
        if link.resolve() != target:
            raise InputError(f"{link.resolve()}: in the way of a link to {target}; make results in another folder")


def read_plan(data: dict[str, Any], root: str | Path = ".") -> Plan:
    """The plan of a configuration; InputError names the file, the field and what is allowed."""
    folder = Path(root) / "workflow"
    config = validate(data, Config, SOURCE)
    names = dict.fromkeys([*config.floquet, *config.maps, *config.rigid, *config.flight])
    scenes = {name: read_scene(folder / "scenes" / f"{name}.yaml") for name in names}
    used = [design for scene in scenes.values() for design in scene.sail.designs]
    families = _families(folder, config.designs)
    designs = dict.fromkeys([*config.designs, *config.fdtd_designs, *used])
    cells = {design: _read_cell(folder, design) for design in designs if design not in families}
    fdtd = meep_installed() if config.fdtd == "auto" else config.fdtd
    plan = Plan(config, scenes, cells, fdtd, folder, families)
    _refuse(plan)
    return plan
