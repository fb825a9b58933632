"""What holds a sail, and what it carries: held nodes, gravity, shaking; point masses on tethers."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from beamrider.io.files import Pair, Strict

MOST_TETHERS = 12
MOST_PAYLOADS = 100


def _unit(unit: str, **limits: Any) -> Any:
    """A field with its unit and its range."""
    return Field(json_schema_extra={"unit": unit}, **limits)


Acceleration = Annotated[float, Field(ge=-1e12, le=1e12)]
Place = Annotated[float, Field(ge=-1e9, le=1e9)]


class HeldPart(Strict):
    """Nodes of the sail that are held: all within `radius_m` of a place on it at rest, or else the nearest one."""

    at_m: Annotated[Pair, _unit("m")]
    """X and y of the place, from the middle of the sail."""
    radius_m: Annotated[float, _unit("m", ge=0, le=1e9)] = 0.0
    """Nodes as near as this are held; 0 for the nearest one."""
    stiffness_N_m: Annotated[float, _unit("N/m", ge=1e-12, le=1e15)] | None = None
    """Of springs that hold the part in every direction, shared by its nodes; null holds them fast."""


class Shaking(Strict):
    """Acceleration a sin(2π f t + φ) of what holds the sail, from the release on, in whose frame the sail is flown."""

    acceleration_m_s2: Annotated[list[Acceleration], _unit("m/s²", min_length=3, max_length=3)]
    """A along x, y, z."""
    frequency_Hz: Annotated[float, _unit("Hz", ge=0, le=1e9)]
    """F."""
    phase_deg: Annotated[float, _unit("°", ge=-360, le=360)] = 0.0
    """Φ; 90 begins with the full acceleration."""


class Held(Strict):
    """How a flexible sail is held, as in a laboratory; it then is not released: tilt and offset are its mounting.

    Tension is that of a film made with it: isotropic in the whole sail, which the rim takes up.
    """

    rim: Annotated[Literal["free", "clamped", "springs"], _unit("1")] = "free"
    """Nodes of the rim: free, held fast, or on springs of `rim_stiffness_N_m2`."""
    rim_stiffness_N_m2: Annotated[float, _unit("N/m²", ge=1e-12, le=1e15)] | None = None
    """Of the rim's springs in every direction, a metre of rim."""
    tension_N_m: Annotated[float, _unit("N/m", ge=0, le=1e9)] = 0.0
    """Of the sail at rest at 300 K."""
    parts: Annotated[list[HeldPart], _unit("1", max_length=1000)] = []
    """Parts of the sail that are held."""
    gravity_m_s2: Annotated[list[Acceleration], _unit("m/s²", min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    """Gravity along x, y, z, or less the steady acceleration of what holds the sail."""
    shaking: Annotated[Shaking | None, _unit("1")] = None
    """Of what holds the sail."""
    drag_1_s: Annotated[float, _unit("1/s", ge=0, le=1e12)] = 0.0
    """Rate at which the surroundings take away velocity: force on a node −m · rate · v."""
    rest_speed_m_s: Annotated[float, _unit("m/s", ge=1e-30, le=1e9)] | None = None
    """Root mean square speed below which, for `flight.snapshot_every_s`, the flight ends as 'at_rest'."""

    @model_validator(mode="after")
    def _consistent(self) -> Held:
        if (self.rim == "springs") != (self.rim_stiffness_N_m2 is not None):
            raise ValueError("rim_stiffness_N_m2: must be given with rim: springs, and only then")
        if self.tension_N_m > 0.0 and self.rim == "free":
            raise ValueError(f"tension_N_m = {self.tension_N_m:g}: needs rim: clamped or springs, which take it up")
        return self


class Tether(Strict):
    """A massless line from a payload to a place on the sail: tension = stiffness · (stretch + τ · its rate), ≥ 0."""

    to_m: Annotated[Pair, _unit("m")]
    """X and y of its place on the sail at rest, from the middle."""
    stiffness_N_m: Annotated[float, _unit("N/m", ge=1e-12, le=1e15)]
    """Tension by stretch."""
    length_m: Annotated[float, _unit("m", ge=0, le=1e9)] | None = None
    """Free length; null for the distance at the start."""
    damping_s: Annotated[float, _unit("s", ge=0, le=1e3)] = 0.0
    """Retardation time τ."""
    strength_N: Annotated[float, _unit("N", ge=1e-30, le=1e30)] | None = None
    """Tension at which it snaps; null for never."""
    pushes: Annotated[bool, _unit("1")] = False
    """A strut: it also pushes when it is shorter than its free length."""


class Payload(Strict):
    """A point mass on tethers, ahead of the sail (z > 0), behind it (z < 0) or, on struts, within it."""

    mass_kg: Annotated[float, _unit("kg", ge=1e-15, le=1e9)]
    """Mass."""
    position_m: Annotated[list[Place], _unit("m", min_length=3, max_length=3)]
    """X, y and z at the start, from the middle (apex) of the sail, turned and shifted with it at the release."""
    tethers: Annotated[list[Tether], _unit("1", min_length=1, max_length=MOST_TETHERS)]
    """Its tethers."""


Payloads = Annotated[list[Payload], _unit("1", max_length=MOST_PAYLOADS)]
