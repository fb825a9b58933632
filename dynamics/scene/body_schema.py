"""What holds a sail, and what it carries: held nodes, gravity, shaking; point masses on tethers."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from beamrider.io.files import Pair, Strict

MOST_TETHERS = 12
MOST_PAYLOADS = 100


def _key(unit: str, description: str, **limits: Any) -> Any:
    """A field with its unit, what it means, and its range."""
    return Field(description=description, json_schema_extra={"unit": unit}, **limits)


Acceleration = Annotated[float, Field(ge=-1e12, le=1e12)]
Place = Annotated[float, Field(ge=-1e9, le=1e9)]


class HeldPart(Strict):
    """Nodes of the sail that are held: all within `radius_m` of a place on it at rest, or else the nearest one."""

    at_m: Annotated[Pair, _key("m", "x and y of the place, from the middle of the sail")]
    radius_m: Annotated[float, _key("m", "nodes as near as this are held; 0 for the nearest one", ge=0, le=1e9)] = 0.0
    stiffness_N_m: Annotated[float, _key(
        "N/m", "of springs that hold the part in every direction, shared by its nodes; null holds them fast",
        ge=1e-12, le=1e15,
    )] | None = None


class Shaking(Strict):
    """Acceleration a sin(2π f t + φ) of what holds the sail, from the release on, in whose frame the sail is flown."""

    acceleration_m_s2: Annotated[list[Acceleration], _key("m/s²", "a along x, y, z", min_length=3, max_length=3)]
    frequency_Hz: Annotated[float, _key("Hz", "f", ge=0, le=1e9)]
    phase_deg: Annotated[float, _key("°", "φ; 90 begins with the full acceleration", ge=-360, le=360)] = 0.0


class Held(Strict):
    """How a flexible sail is held, as in a laboratory; it then is not released: tilt and offset are its mounting.

    Tension is that of a film made with it: isotropic in the whole sail, which the rim takes up.
    """

    rim: Annotated[Literal["free", "clamped", "springs"], _key(
        "1", "nodes of the rim: free, held fast, or on springs of `rim_stiffness_N_m2`"
    )] = "free"
    rim_stiffness_N_m2: Annotated[float, _key(
        "N/m²", "of the rim's springs in every direction, a metre of rim", ge=1e-12, le=1e15
    )] | None = None
    tension_N_m: Annotated[float, _key("N/m", "of the sail at rest at 300 K", ge=0, le=1e9)] = 0.0
    parts: Annotated[list[HeldPart], _key("1", "parts of the sail that are held", max_length=1000)] = []
    gravity_m_s2: Annotated[list[Acceleration], _key(
        "m/s²", "gravity along x, y, z, or less the steady acceleration of what holds the sail",
        min_length=3, max_length=3,
    )] = [0.0, 0.0, 0.0]
    shaking: Annotated[Shaking | None, _key("1", "of what holds the sail")] = None
    drag_1_s: Annotated[float, _key(
        "1/s", "rate at which the surroundings take away velocity: force on a node −m · rate · v", ge=0, le=1e12
    )] = 0.0
    rest_speed_m_s: Annotated[float, _key(
        "m/s", "root mean square speed: where it stays below for a whole `flight.snapshot_every_s` the flight ends as "
        "'at_rest'; null flies on", ge=1e-30, le=1e9,
    )] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Held:
        if (self.rim == "springs") != (self.rim_stiffness_N_m2 is not None):
            raise ValueError("rim_stiffness_N_m2: must be given with rim: springs, and only then")
        if self.tension_N_m > 0.0 and self.rim == "free":
            raise ValueError(f"tension_N_m = {self.tension_N_m:g}: needs rim: clamped or springs, which take it up")
        return self


class Tether(Strict):
    """A massless line from a payload to a place on the sail: tension = stiffness · (stretch + τ · its rate), ≥ 0."""

    to_m: Annotated[Pair, _key("m", "x and y of its place on the sail at rest, from the middle")]
    stiffness_N_m: Annotated[float, _key("N/m", "tension by stretch", ge=1e-12, le=1e15)]
    length_m: Annotated[float, _key(
        "m", "free length; null for the distance at the start", ge=0, le=1e9
    )] | None = None
    damping_s: Annotated[float, _key("s", "retardation time τ", ge=0, le=1e3)] = 0.0
    strength_N: Annotated[float, _key(
        "N", "tension at which it snaps; null for never", ge=1e-30, le=1e30
    )] | None = None
    pushes: Annotated[bool, _key("1", "a strut: it also pushes when it is shorter than its free length")] = False


class Payload(Strict):
    """A point mass on tethers, ahead of the sail (z > 0), behind it (z < 0) or, on struts, within it."""

    mass_kg: Annotated[float, _key("kg", "mass", ge=1e-15, le=1e9)]
    position_m: Annotated[list[Place], _key(
        "m", "x, y and z at the start, from the middle (apex) of the sail, turned and shifted with it at the release",
        min_length=3, max_length=3,
    )]
    tethers: Annotated[list[Tether], _key("1", "its tethers", min_length=1, max_length=MOST_TETHERS)]


Payloads = Annotated[list[Payload], _key("1", "point masses on tethers", max_length=MOST_PAYLOADS)]
