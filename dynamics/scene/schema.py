"""The scene file: what is flown, and how; `sail_schema` is about the sail, `effects_plan` about effects.

These models are the one source of every scene parameter, its unit, range and default. Defaults are correct physics;
choices that only serve to reproduce published runs are marked "published".
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from beamrider.io.files import InputError, Name, NonNegative, Pair, Positive, Strict, read_model
from dynamics.scene.body_schema import Held, Payload, Payloads
from dynamics.scene.sail_schema import Fraction, Region, Sail

#: Longest time in s that a scene may speak of, 30 years, and most turns a second; most steps and intervals of steps.
Duration = Annotated[float, Field(ge=1e-15, le=1e9)]
Rate = Annotated[float, Field(ge=-1e9, le=1e9)]
Count = Annotated[int, Field(ge=1, le=10**12)]
Kelvin = Annotated[float, Field(ge=1e-3, le=1e6)]


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
    polarisation_deg: Rate = 0.0
    polarisation_Hz: Rate = 0.0

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
    spin_Hz: Rate = 0.0


class Rigid(Strict):
    """Rigid flight: duration, tolerance (relative and absolute, in normalised units) and rows of output a second.

    most_steps: of the integrator, after which the flight is given up. beam_distance: 'lateral' distance from the axis;
    'published' adds the axial coordinate of the point in the body.
    """

    duration_s: Duration = 1.0
    tolerance: Annotated[float, Field(ge=1e-15, le=1e-2)] = 1e-9
    output_Hz: Annotated[float, Field(ge=1e-12, le=1e15)] = 2000.0
    most_steps: Count = 10_000_000
    beam_distance: Literal["lateral", "published"] = "lateral"


class Flight(Strict):
    """Flexible flight. Time starts at −spin_up; light and release are at t = 0.

    time_step_s: null for 0.8 of the stability bound of the mesh. optics_every, heat_every: steps between updates of the
    optical coefficients, which are those of the middle of that time, and of the temperatures. spin_up_s: null for the
    published |f|/(1801.8 max(|f|/100 Hz, Γ)), Γ = 10 for flat sails, 2 for curved ones,
    longer for sails of more than 0.5 m.
    stiffness: 'triangles' of constant strain, or springs along the edges: 'van_gelder' with Poisson's ratio, 'lattice'.
    in_plane: what carries tension and heat in the plane, the continuous 'membrane' of each design or a plain film of
    equal mass, 'mass_equivalent'.
    integrator: 'corotating' steps semi-implicitly, 1/150 of a turn by default, in the frame of a spinning flat sail of
    triangles, light and heat renewed in every step; it ends a flight as 'beyond_scheme' where strain or slopes are too
    large for it.
    Triangles tear where the larger principal stress reaches the strength, springs where their strain reaches strength
    over Young's modulus. rim_factor: for springs only. on_failure: 'stop' ends the flight; 'record' counts the failed
    triangles, 'remove' takes them out of the sail, until more than broken_fraction of them have failed. fly_away_m:
    distance of the centre of mass from the axis at which a flight ends, also a rigid one; null for 2.5 times the radius
    of the sail or the beam, whichever is larger: it is dark there.
    Published: rk4 with thermal_rate 2/3, in_plane 'mass_equivalent', stiffness 'lattice' with rim_factor 2, conductance
    'first_triangle', expansion_1_K 2.33e-6 for every material, stefan_boltzmann 5.67e-8, spin_up_gain 1.001486.
    """

    duration_s: Duration = 0.1
    integrator: Literal["semi_implicit_euler", "verlet", "rk4", "corotating"] = "verlet"
    time_step_s: Duration | None = None
    optics_every: Annotated[int, Field(ge=1, le=10000)] = 4
    heat_every: Annotated[int, Field(ge=1, le=10000)] = 4
    stiffness: Literal["triangles", "van_gelder", "lattice"] = "triangles"
    rim_factor: Positive = 1.0
    in_plane: Literal["membrane", "mass_equivalent"] = "membrane"
    conductance: Literal["cotangent", "area", "first_triangle"] = "cotangent"
    expansion_1_K: Annotated[float, Field(ge=-1, le=1)] | None = None
    thermal_rate: Positive = 1.0
    stefan_boltzmann: Positive = 5.670374419e-8
    start_temperature_K: Kelvin = 300.0
    background_temperature_K: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    spin_up_s: Duration | None = None
    spin_up_gain: Positive | None = None
    fly_away_m: Positive | None = None
    on_failure: Literal["stop", "record", "remove"] = "stop"
    broken_fraction: Fraction = 1.0
    series_every: Count = 8
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
    held: bool | None = None
    payload: bool | None = None
    tensile_failure: bool | None = None
    thermal_failure: bool | None = None


class Scene(Strict):
    """Everything about one run.

    incidence: 'sail_frame' sees the light in each element's own frame; 'yaw_blind' (published) uses the lab-frame pitch
    and roll whatever the yaw. lookup: 'smooth' or 'nearest' (published) entry of the table. absorptance: of the
    'table' of each design, times what the material's changes by with temperature, or that of the 'material'
    (published); without a design always the material's. outside_table: 'stop' the run or 'clamp' (published) to the
    edge and count; a grating lit from behind ends it either way, a film is the same from both sides. held: what holds a
    sail that is not released; payload: point masses on tethers.
    """

    name: Name
    description: str
    sail: Sail
    beam: Beam
    release: Release = Release()
    incidence: Literal["sail_frame", "yaw_blind"] = "sail_frame"
    lookup: Literal["smooth", "nearest"] = "smooth"
    absorptance: Literal["material", "table"] = "table"
    outside_table: Literal["stop", "clamp"] = "stop"
    rigid: Rigid = Rigid()
    flight: Flight = Flight()
    held: Held | None = None
    payload: Payloads = []
    reflections: Reflections = Reflections()
    effects: Effects = Effects()

    @property
    def fly_away(self) -> float:
        """Distance in m from the axis at which a flight ends."""
        return self.flight.fly_away_m or 2.5 * max(self.sail.radius_m, self.beam.radius_m)

    def tabled(self, region: Region) -> bool:
        """Does the absorptance of a region come from its design's table."""
        return self.absorptance == "table" and region.design is not None

    @property
    def holding(self) -> Held | None:
        """What holds the sail, None where nothing does or the effect is off."""
        return self.held if self.effects.held is not False else None

    @property
    def carried(self) -> list[Payload]:
        """The point masses that fly with the sail: none where the effect is off."""
        return self.payload if self.effects.payload is not False else []

    @model_validator(mode="after")
    def _bodies(self) -> Scene:
        for name in ("held", "payload"):
            if getattr(self.effects, name) and not getattr(self, name):
                raise ValueError(f"effects.{name} = true: needs {name}, which the scene does not give")
        if self.holding is not None and self.release.spin_Hz != 0.0:
            raise ValueError(f"release.spin_Hz = {self.release.spin_Hz:g}: must be 0 for a sail that is held")
        return self

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


def read_scene(path: str | Path) -> Scene:
    """The scene in a YAML file; InputError names the file, the field and what is allowed."""
    scene = read_model(path, Scene)
    if scene.name != Path(path).stem:
        raise InputError(f"{path}: name = '{scene.name}': must be the file's own name, '{Path(path).stem}'")
    return scene
