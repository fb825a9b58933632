"""The scene file: what is flown, and how; `sail_schema` is about the sail, `effects_plan` about effects.

These models are the one source of every scene parameter, its unit, range and default. Defaults are correct physics;
choices that only serve to reproduce published runs are marked "published".
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from beamrider.io.files import DIMENSIONLESS, InputError, Name, Pair, Positive, Strict, read_model
from dynamics.light.beam import Beam as Beam
from dynamics.light.beam import Rate as Rate
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.scene.body_schema import Held, Payload, Payloads
from dynamics.scene.sail_schema import Fraction, Region, Sail

#: Fastest rim of a spinning sail, over the speed of light: beyond, its own relativity counts.
FASTEST = 1e-2
#: Longest time in s that a scene may speak of, 30 years; most steps and intervals of steps.
Duration = Annotated[float, Field(ge=1e-15, le=1e9)]
Count = Annotated[int, Field(ge=1, le=10**12, json_schema_extra={"unit": "steps"})]
Every = Annotated[int, Field(ge=1, le=10000, json_schema_extra={"unit": "steps"})]
Factor = Annotated[Positive, Field(json_schema_extra=DIMENSIONLESS)]
Kelvin = Annotated[float, Field(ge=1e-3, le=1e6)]


class Release(Strict):
    """State at t = 0: tilt about the origin (spin axis included), then shift."""

    offset_m: Pair = [0.0, 0.0]
    """Shift [x, y] from the axis of the beam."""
    pitch_deg: Annotated[float, Field(gt=-90, lt=90)] = 0.0
    """Pitch, about y."""
    roll_deg: Annotated[float, Field(gt=-90, lt=90)] = 0.0
    """Roll, about x."""
    spin_Hz: Rate = 0.0
    """Turns a second about the sail's normal, signed."""


class Rigid(Strict):
    """Rigid flight."""

    duration_s: Duration = 1.0
    """Duration."""
    tolerance: Annotated[float, Field(ge=1e-15, le=1e-2, json_schema_extra=DIMENSIONLESS)] = 1e-9
    """Error of a step, relative and absolute, in normalised units."""
    output_Hz: Annotated[float, Field(ge=1e-12, le=1e15)] = 2000.0
    """Rows of output a second."""
    most_steps: Count = 10_000_000
    """Steps of the integrator after which the flight is given up."""
    beam_distance: Literal["lateral", "published"] = "lateral"
    """Distance that the intensity is taken at: from the axis ('lateral').

    'published' adds the axial coordinate of the point in the body.
    """


class Flight(Strict):
    """Flexible flight. Time starts at −spin_up; light and release are at t = 0.

    Triangles tear where the larger principal stress reaches the strength, springs where their strain reaches strength
    over Young's modulus.
    Published: rk4 with thermal_rate 2/3, in_plane 'mass_equivalent', stiffness 'lattice' with rim_factor 2, conductance
    'first_triangle', expansion_1_K 2.33e-6 for every material, stefan_boltzmann 5.67e-8, spin_up_gain 1.001486.
    """

    duration_s: Duration = 0.1
    """Duration from the release on."""
    integrator: Literal["semi_implicit_euler", "verlet", "rk4", "corotating"] = "verlet"
    """Scheme of the steps.

    'corotating' steps semi-implicitly, 1/100 of a turn by default, in the frame of a spinning flat sail of triangles,
    light and heat renewed in every step, waves in its plane damped. Where strain or slopes are large it takes the sail
    for stiffer against short waves across it; where that is not enough it ends the flight as 'beyond_scheme'.
    """
    time_step_s: Duration | None = None
    """Time step; null for 0.8 of the stability bound of the mesh."""
    optics_every: Every = 4
    """Steps between updates of the optical coefficients, which are those of the middle of that time."""
    heat_every: Every = 4
    """Steps between updates of the temperatures."""
    stiffness: Literal["triangles", "van_gelder", "lattice"] = "triangles"
    """'triangles' of constant strain, or springs along the edges: 'van_gelder' with Poisson's ratio, 'lattice'."""
    rim_factor: Factor = 1.0
    """Factor on the stiffness of springs along the rim; for springs only."""
    in_plane: Literal["membrane", "mass_equivalent"] = "membrane"
    """What carries tension and heat in the plane.

    The continuous 'membrane' of each design, or a plain film of equal mass, 'mass_equivalent'.
    """
    conductance: Literal["cotangent", "area", "first_triangle"] = "cotangent"
    """Heat conductance of the edges: 'cotangent' of linear finite elements, 'area' of triangles over squared lengths.

    'first_triangle' (published) is 'area' without the second triangle of each edge.
    """
    expansion_1_K: Annotated[float, Field(ge=-1, le=1)] | None = None
    """Coefficient of thermal expansion in place of every material's own; null for these."""
    thermal_rate: Factor = 1.0
    """Factor on the rate at which temperatures change."""
    stefan_boltzmann: Annotated[Positive, Field(json_schema_extra={"unit": "W/(m² K⁴)"})] = 5.670374419e-8
    """The Stefan–Boltzmann constant."""
    start_temperature_K: Kelvin = 300.0
    """Temperature of the sail at the start."""
    background_temperature_K: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Temperature of what surrounds the sail."""
    spin_up_s: Duration | None = None
    """Time of the spin-up before the release.

    Null for the published |f|/(1801.8 max(|f|/100 Hz, Γ)), Γ = 10 for flat sails, 2 for curved ones, longer for sails
    of more than 0.5 m.
    """
    spin_up_gain: Factor | None = None
    """Uniform angular acceleration of the spin-up over spin / spin_up_s (published).

    Null to follow the nominal rate of the sail, which slows as it stretches.
    """
    fly_away_m: Positive | None = None
    """Distance of the centre of mass from the axis at which a flight ends, also a rigid one.

    Null for 2.5 times the radius of the sail or the beam, whichever is larger: it is dark there.
    """
    on_failure: Literal["stop", "record", "remove"] = "stop"
    """'stop' ends the flight; 'record' counts the failed triangles, 'remove' takes them out of the sail."""
    broken_fraction: Fraction = 1.0
    """Share of failed triangles beyond which a flight ends all the same."""
    series_every: Count = 8
    """Steps between rows of the time series."""
    snapshot_every_s: Positive = 1e-3
    """Time between snapshots of the whole sail."""
    checkpoint_every_s: Positive = 60.0
    """Wall time between checkpoints, from which a killed flight goes on."""

    @model_validator(mode="after")
    def _consistent(self) -> Flight:
        if self.on_failure != "stop" and self.stiffness != "triangles":
            raise ValueError(f"on_failure = '{self.on_failure}': needs stiffness: triangles; springs must 'stop'")
        return self


class Reflections(Strict):
    """Light that one part of a specular sail throws on another."""

    bounces: Annotated[int, Field(ge=1, le=1000, json_schema_extra={"unit": "hits"})] = 4
    """Hits after which a ray is given up."""
    rays_a_side: Annotated[int, Field(ge=1, le=100, json_schema_extra={"unit": "rays"})] = 1
    """Each triangle sends the square of it."""
    cutoff: Fraction = 1e-6
    """Share of its first power below which a ray is given up."""
    polarisation: Literal["mean", "tracked"] = "mean"
    """'mean' takes the mean of s and p at each hit; 'tracked' follows the beam's field from hit to hit.

    For 'tracked' films need their phases; at the first hit, too, it tells s from p.
    """


class Effects(Strict):
    """Overrides of the derived plan: true, false, or null to let the scene decide."""

    light: bool | None = None
    """Light pressure."""
    reflections: bool | None = None
    """Light that one part of the sail throws on another."""
    spin_up: bool | None = None
    """Spin-up before the release."""
    absorption: bool | None = None
    """Heating by the light."""
    emission: bool | None = None
    """Thermal radiation."""
    conduction: bool | None = None
    """Conduction of heat in the sail."""
    expansion: bool | None = None
    """Thermal expansion."""
    damping: bool | None = None
    """Internal damping of the materials."""
    held: bool | None = None
    """What holds the sail."""
    payload: bool | None = None
    """Point masses on tethers."""
    tensile_failure: bool | None = None
    """Tearing at the materials' strength."""
    thermal_failure: bool | None = None
    """Failure at the materials' failure temperature."""


class Scene(Strict):
    """Everything about one run."""

    name: Name
    """Name of the scene, that of the file without its ending."""
    description: str
    """What the scene is, in words."""
    sail: Sail
    """What is flown."""
    beam: Beam
    """The light that it flies on."""
    release: Release = Release()
    """Place, tilt and spin at t = 0."""
    incidence: Literal["sail_frame", "yaw_blind"] = "sail_frame"
    """'sail_frame' sees the light in each element's own frame.

    'yaw_blind' (published) uses the lab-frame pitch and roll whatever the yaw.
    """
    lookup: Literal["smooth", "nearest"] = "smooth"
    """Smooth interpolation of the tables, or their nearest entry (published)."""
    absorptance: Literal["material", "table"] = "table"
    """That of the 'table' of each design, times what the material's changes by with temperature.

    Or that of the 'material' (published); without a design always the material's.
    """
    outside_table: Literal["stop", "clamp"] = "stop"
    """'stop' the run where light comes from beyond a table, or 'clamp' it to the edge and count (published).

    A grating lit from behind ends it either way, a film is the same from both sides.
    """
    rigid: Rigid = Rigid()
    """Settings of rigid flight."""
    flight: Flight = Flight()
    """Settings of flexible flight."""
    held: Held | None = None
    """What holds a sail that is not released."""
    payload: Payloads = []
    """Point masses on tethers."""
    reflections: Reflections = Reflections()
    """Settings of light between the sail's parts."""
    effects: Effects = Effects()
    """What is on and off in flexible flight, where the scene is not to decide."""

    @property
    def fly_away(self) -> float:
        """Distance in m from the axis at which a flight ends."""
        return self.flight.fly_away_m or 2.5 * max(self.sail.radius_m, self.beam.reach_m)

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
    def _slower_than_light(self) -> Scene:
        rim = 2.0 * math.pi * abs(self.release.spin_Hz) * self.sail.radius_m
        if rim > FASTEST * LIGHT_SPEED:
            raise ValueError(
                f"release.spin_Hz = {self.release.spin_Hz:g}: moves the rim at {rim:.3g} m/s: must be below "
                f"{FASTEST:g} of the speed of light, above which relativity counts"
            )
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
