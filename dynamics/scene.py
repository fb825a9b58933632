"""The scene file: what is flown, and which effects that calls for.

The model below is the one source of every scene parameter, its unit, range and default. Defaults are correct physics;
choices that only serve to reproduce published runs are marked "published".
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from dynamics.command import stage_arguments
from dynamics.materials import MATERIALS, Material
from dynamics.shapes import rim_slope
from optics.files import InputError, Name, NonNegative, Pair, Positive, Strict, read_model, run_stage, write_json

Fraction = Annotated[float, Field(ge=0, le=1)]
Angle = Annotated[float, Field(ge=0, lt=360)]


class Region(Strict):
    """A part of the sail of one material, thickness and optical response.

    The optical response is either a pressure table of `design`, or constant `reflectance` and the material's
    absorptance. thickness_m: instead of the material's. `g` is the direction across the ridges (for a film it only
    labels the axes): fixed in the body's x and y, or 'radial' (outward), 'tangential' (counter-clockwise seen from +z)
    or the negatives of these, in each triangle projected into its plane.
    """

    material: str | Material
    thickness_m: Positive | None = None
    design: Name | None = None
    reflectance: Fraction | None = None
    g: Pair | Literal["radial", "-radial", "tangential", "-tangential"] = [1.0, 0.0]

    @model_validator(mode="after")
    def _consistent(self) -> Region:
        if isinstance(self.material, str) and self.material not in MATERIALS:
            raise ValueError(f"material = '{self.material}': must be one of {', '.join(MATERIALS)}, or given in full")
        if (self.design is None) == (self.reflectance is None):
            raise ValueError("give either design (a pressure table) or reflectance (constant), not both")
        if not isinstance(self.g, str) and not math.isclose(math.hypot(*self.g), 1.0, rel_tol=1e-9):
            raise ValueError(f"g = {self.g}: must be a unit vector")
        return self

    @property
    def properties(self) -> Material:
        """The region's material, at the region's thickness."""
        material = MATERIALS[self.material] if isinstance(self.material, str) else self.material
        return material if self.thickness_m is None else material.model_copy(update={"thickness_m": self.thickness_m})


    @property
    def fixed(self) -> Pair | None:
        """The direction across the ridges in the body's x and y, None where it differs from place to place."""
        return None if isinstance(self.g, str) else self.g


class Sector(Region):
    """A region from its starting polar angle to the start of the next sector."""

    from_deg: Angle


def _ascending(sectors: list[Sector]) -> None:
    starts = [sector.from_deg for sector in sectors]
    if any(b <= a for a, b in itertools.pairwise(starts)):
        raise ValueError(f"sectors: from_deg must ascend, not {starts}")


class Rim(Strict):
    """Sectors of their own from a distance from the axis on, instead of those within."""

    from_m: Positive
    sectors: Annotated[list[Sector], Field(min_length=1)]

    @model_validator(mode="after")
    def _consistent(self) -> Rim:
        _ascending(self.sectors)
        return self


class Grid(Strict):
    """Regions in cells between ascending cuts in x and y, laid over the sectors: a row for each interval of y.

    A row has one entry more than there are cuts in x; null leaves a cell to the sectors.
    """

    x_m: list[float] = []
    y_m: list[float] = []
    regions: list[list[Region | None]]

    @model_validator(mode="after")
    def _consistent(self) -> Grid:
        for name, cuts in (("x_m", self.x_m), ("y_m", self.y_m)):
            if any(b <= a for a, b in itertools.pairwise(cuts)):
                raise ValueError(f"{name}: cuts must ascend, not {cuts}")
        rows, columns = len(self.y_m) + 1, len(self.x_m) + 1
        if [len(row) for row in self.regions] != [columns] * rows:
            raise ValueError(f"regions: must be {rows} rows (intervals of y) of {columns} entries (intervals of x)")
        return self


class Sail(Strict):
    """The shape of a sail, its mesh of `rings` rings turned by `rotation_deg` about z, and its regions.

    radius_m: of the disc, centre to corner of the hexagon, half the width of the square; of curved sails that along
    the slope, more or less, unless `rescale` stretches the shape until its rim has that radius. depth: setting α, for
    curved profiles only, apex downstream; negative turns the sail round. surface: on polygons the nodes lie on the
    surface of revolution ('smooth') or rings are plane ('faceted').
    """

    outline: Literal["round", "hexagonal", "square"] = "round"
    profile: Literal["flat", "paraboloid", "cone", "sphere"] = "flat"
    surface: Literal["smooth", "faceted"] = "smooth"
    depth: Annotated[float, Field(ge=-100, le=100)] | None = None
    rescale: bool = False
    radius_m: Positive
    rings: Annotated[int, Field(ge=1, le=1000)]
    rotation_deg: float = 0.0
    sectors: Annotated[list[Sector], Field(min_length=1)]
    rim: Rim | None = None
    grid: Grid | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Sail:
        _ascending(self.sectors)
        if (self.depth is None) != (self.profile == "flat"):
            raise ValueError("depth: must be given for curved profiles, and for them only")
        if self.profile == "sphere" and not 0 < abs(self.depth or 0.0) <= 0.8:
            raise ValueError(f"depth = {self.depth}: must be from -0.8 to 0.8 and not 0 for a sphere")
        return self

    @property
    def regions(self) -> list[Region]:
        """All regions: the sectors, those of the rim, those of the grid row by row."""
        rim = self.rim.sectors if self.rim is not None else []
        rows = self.grid.regions if self.grid is not None else []
        return [*self.sectors, *rim, *(region for row in rows for region in row if region is not None)]

    @property
    def beyond_rigid(self) -> str | None:
        """What keeps the sail from the rigid model, which flies flat round sails of sectors; None if nothing does."""
        for name, plain in (("outline", "round"), ("profile", "flat"), ("rim", None), ("grid", None)):
            value = getattr(self, name)
            if value != plain:
                return f"{name} = '{value}'" if isinstance(value, str) else name
        special = [f"sectors.{i}.g = '{s.g}'" for i, s in enumerate(self.sectors) if isinstance(s.g, str)]
        return special[0] if special else None

    @property
    def designs(self) -> list[str]:
        """Names of the designs whose pressure tables the sail needs, in order of first use."""
        return list(dict.fromkeys(s.design for s in self.regions if s.design))


class Beam(Strict):
    """Gaussian beam along +z, I = I₀ exp(−2ρ²/w²); off for `delay_s`, rises in `rise_s`, on for `on_s`, falls alike.

    polarisation: 'sail' turns with the sail, so that each cell always sees its own (the paper); 'lab' is linear at
    `polarisation_deg` from x towards y; 'turning' starts there and turns at `polarisation_Hz`. The last two are for
    rigid flight on tables that hold the Stokes response, and for reflections with `polarisation: tracked`. With these,
    the field that turns with the 'sail' is at `polarisation_deg` from the body's x.
    """

    intensity_W_m2: NonNegative
    radius_m: Positive
    delay_s: NonNegative = 0.0
    rise_s: NonNegative = 1e-6
    on_s: Positive = 1e9
    polarisation: Literal["sail", "lab", "turning"] = "sail"
    polarisation_deg: float = 0.0
    polarisation_Hz: float = 0.0

    @model_validator(mode="after")
    def _one_polarisation(self) -> Beam:
        if self.polarisation != "turning" and self.polarisation_Hz != 0.0:
            raise ValueError(f"polarisation_Hz = {self.polarisation_Hz:g}: needs polarisation: turning")
        return self


class Release(Strict):
    """State at t = 0: tilt about the origin (spin axis included), then shift; spin in turns per second, signed."""

    offset_m: Pair = [0.0, 0.0]
    pitch_deg: Annotated[float, Field(gt=-90, lt=90)] = 0.0
    roll_deg: Annotated[float, Field(gt=-90, lt=90)] = 0.0
    spin_Hz: float = 0.0


class Rigid(Strict):
    """Rigid flight: duration, tolerance (relative and absolute, in normalised units) and rows of output a second.

    most_steps: of the integrator, after which the flight is given up. beam_distance: 'lateral' distance from the axis;
    'published' adds the axial coordinate of the point in the body.
    """

    duration_s: Positive = 1.0
    tolerance: Annotated[float, Field(gt=0, le=1e-2)] = 1e-9
    output_Hz: Positive = 2000.0
    most_steps: Annotated[int, Field(ge=1)] = 10_000_000
    beam_distance: Literal["lateral", "published"] = "lateral"


class Flight(Strict):
    """Flexible flight. Time starts at −spin_up; light and release are at t = 0.

    time_step_s: null for 0.8 of the stability bound of the mesh. optics_every, heat_every: steps between updates of the
    optical coefficients, which are those of the middle of that time, and of the temperatures. spin_up_s: null for the
    published |f|/(1801.8 max(|f|/100 Hz, Γ)), Γ = 10 for flat sails, 2 for curved ones.
    stiffness: 'triangles' of constant strain, or springs along the edges: 'van_gelder' with Poisson's ratio, 'lattice'.
    integrator: 'corotating' steps semi-implicitly, 1/150 of a turn by default, in the frame of a spinning flat sail of
    triangles, light and heat renewed in every step; it ends a flight as 'beyond_scheme' where strain or slopes are too
    large for it.
    Triangles tear where the larger principal stress reaches the strength, springs where their strain reaches strength
    over Young's modulus. rim_factor: for springs only. on_failure: 'stop' ends the flight; 'record' counts the failed
    triangles, 'remove' takes them out of the sail, until more than broken_fraction of them have failed.
    Published: rk4 with thermal_rate 2/3, stiffness 'lattice' with rim_factor 2, conductance 'first_triangle',
    expansion_1_K 2.33e-6 for every material, stefan_boltzmann 5.67e-8, spin_up_gain 1.001486.
    """

    duration_s: Positive = 0.1
    integrator: Literal["semi_implicit_euler", "verlet", "rk4", "corotating"] = "verlet"
    time_step_s: Positive | None = None
    optics_every: Annotated[int, Field(ge=1, le=10000)] = 4
    heat_every: Annotated[int, Field(ge=1, le=10000)] = 4
    stiffness: Literal["triangles", "van_gelder", "lattice"] = "triangles"
    rim_factor: Positive = 1.0
    conductance: Literal["cotangent", "area", "first_triangle"] = "cotangent"
    expansion_1_K: float | None = None
    thermal_rate: Positive = 1.0
    stefan_boltzmann: Positive = 5.670374419e-8
    start_temperature_K: Positive = 300.0
    background_temperature_K: NonNegative = 0.0
    spin_up_s: Positive | None = None
    spin_up_gain: Positive | None = None
    fly_away_m: Positive = 1.25
    on_failure: Literal["stop", "record", "remove"] = "stop"
    broken_fraction: Fraction = 1.0
    series_every: Annotated[int, Field(ge=1)] = 8
    snapshot_every_s: Positive = 1e-3
    checkpoint_every_s: Positive = 60.0

    @model_validator(mode="after")
    def _consistent(self) -> Flight:
        if self.on_failure != "stop" and self.stiffness != "triangles":
            raise ValueError(f"on_failure = '{self.on_failure}': needs stiffness: triangles; springs must 'stop'")
        return self


class Reflections(Strict):
    """Light that one part of a specular sail throws on another.

    bounces: hits after which a ray is given up. rays_a_side: each triangle sends the square of it. cutoff: share of
    its first power below which a ray is given up. polarisation: 'mean' takes the mean of s and p at each hit; 'tracked'
    follows the beam's field from hit to hit, so films need their phases; at the first hit, too, it tells s from p.
    """

    bounces: Annotated[int, Field(ge=1, le=1000)] = 4
    rays_a_side: Annotated[int, Field(ge=1, le=100)] = 1
    cutoff: Fraction = 1e-6
    polarisation: Literal["mean", "tracked"] = "mean"


EFFECTS = (
    "light", "reflections", "spin_up", "absorption", "emission", "conduction", "expansion", "damping",
    "tensile_failure", "thermal_failure",
)


class Effects(Strict):
    """Overrides of the derived plan: true, false, or null to let the scene decide."""

    light: bool | None = None
    reflections: bool | None = None
    spin_up: bool | None = None
    absorption: bool | None = None
    emission: bool | None = None
    conduction: bool | None = None
    expansion: bool | None = None
    damping: bool | None = None
    tensile_failure: bool | None = None
    thermal_failure: bool | None = None


class Scene(Strict):
    """Everything about one run.

    incidence: 'sail_frame' sees the light in each element's own frame; 'yaw_blind' (published) uses the lab-frame pitch
    and roll whatever the yaw. lookup: 'smooth' or 'nearest' (published) entry of the table. absorptance: of the
    'material' or of the 'table'. outside_table: 'stop' the run or 'clamp' (published) to the edge and count; a grating
    lit from behind ends it either way, a film is the same from both sides.
    """

    name: Name
    description: str
    sail: Sail
    beam: Beam
    release: Release = Release()
    incidence: Literal["sail_frame", "yaw_blind"] = "sail_frame"
    lookup: Literal["smooth", "nearest"] = "smooth"
    absorptance: Literal["material", "table"] = "material"
    outside_table: Literal["stop", "clamp"] = "stop"
    rigid: Rigid = Rigid()
    flight: Flight = Flight()
    reflections: Reflections = Reflections()
    effects: Effects = Effects()

    @model_validator(mode="after")
    def _polarised(self) -> Scene:
        degrees, tracked = self.beam.polarisation_deg, self.reflections.polarisation == "tracked"
        if self.beam.polarisation == "sail" and degrees != 0.0 and not tracked:
            raise ValueError(
                f"beam.polarisation_deg = {degrees:g}: needs polarisation: lab or turning, or reflections with "
                "polarisation: tracked"
            )
        if tracked and self.effects.reflections is False:
            raise ValueError("reflections.polarisation = 'tracked': needs effects.reflections: true or null")
        return self


class Effect(Strict):
    """One line of the plan: is the effect computed, and why."""

    on: bool
    reason: str


def read_scene(path: str | Path) -> Scene:
    """The scene in a YAML file; InputError names the file, the field and what is allowed."""
    scene = read_model(path, Scene)
    if scene.name != Path(path).stem:
        raise InputError(f"{path}: name = '{scene.name}': must be the file's own name, '{Path(path).stem}'")
    return scene


def _reflections(scene: Scene, lit: bool) -> Effect:
    """Whether light along the axis can meet the sail twice.

    Off a slope s it leaves at 2s from where it came; the rest of the sail lies at most by the steepest slope S above
    the horizon, so 3S > 90° is needed, and a tilt adds to S.
    """
    steep = math.degrees(rim_slope(scene.sail)) + math.hypot(scene.release.pitch_deg, scene.release.roll_deg)
    bright = any(region.design or region.reflectance for region in scene.sail.regions)
    if not (lit and bright):
        return Effect(on=False, reason="nothing reflects light")
    if scene.reflections.polarisation == "tracked":
        return Effect(on=True, reason="the light's polarisation is tracked, from its first hit on")
    if scene.sail.profile == "flat":
        return Effect(on=False, reason="a flat sail does not reflect onto itself")
    if steep <= 30.0:
        return Effect(on=False, reason=f"slopes of {steep:.3g}°, up to 30° no light meets the sail twice")
    return Effect(on=True, reason=f"slopes of {steep:.3g}°, above 30°, and reflecting")


def _derived(scene: Scene) -> dict[str, Effect]:
    materials = [region.properties for region in scene.sail.regions]
    lit = scene.beam.intensity_W_m2 > 0
    heated = lit and (scene.absorptance == "table" or any(m.highest("absorptance") > 0 for m in materials))
    emits = any(m.highest("emissivity_front") + m.highest("emissivity_back") > 0 for m in materials)
    spins = scene.release.spin_Hz != 0
    conducts = any(m.highest("conductivity_W_mK") > 0 for m in materials)
    expansion = scene.flight.expansion_1_K
    expands = expansion != 0 if expansion is not None else any(m.highest("expansion_1_K") > 0 for m in materials)
    damps = any(m.damping_s > 0 for m in materials)
    return {
        "light": Effect(on=lit, reason=f"intensity {scene.beam.intensity_W_m2:g} W/m²"),
        "reflections": _reflections(scene, lit),
        "spin_up": Effect(on=spins, reason=f"spin {scene.release.spin_Hz:g} Hz"),
        "absorption": Effect(on=heated, reason="light on an absorber" if heated else "nothing absorbs light"),
        "emission": Effect(on=emits, reason="emissivity above zero" if emits else "emissivity zero everywhere"),
        "conduction": Effect(on=conducts, reason="conductivity above zero" if conducts else "no conductivity"),
        "expansion": Effect(on=expands, reason="expansion coefficient given" if expands else "expansion zero"),
        "damping": Effect(on=damps, reason="a material with damping" if damps else "no material has damping"),
        "tensile_failure": Effect(on=True, reason="every material has a strength"),
        "thermal_failure": Effect(on=True, reason="every material has a failure temperature"),
    }


def plan(scene: Scene) -> dict[str, Effect]:
    """Which effects the flexible flight computes, each with its reason; `effects:` in the scene overrides."""
    result = _derived(scene)
    for name in EFFECTS:
        override = getattr(scene.effects, name)
        if override is not None:
            result[name] = Effect(on=override, reason=f"effects.{name} in the scene")
    needs_heat = ("conduction", "expansion", "thermal_failure")
    if not (result["absorption"].on or result["emission"].on):
        for name in needs_heat:
            if getattr(scene.effects, name) is None:
                result[name] = Effect(on=False, reason="no heat comes or goes: the temperature stays uniform")
    return result


def main() -> None:
    """Write which effects a scene calls for, each with its reason."""
    arguments = stage_arguments("dynamics.scene", main.__doc__, "JSON file to write", tables=False)
    effects = plan(read_scene(arguments.scene))
    write_json(arguments.out, {name: effect.model_dump() for name, effect in effects.items()})


if __name__ == "__main__":
    run_stage(main)
