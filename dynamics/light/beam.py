"""The beam of a scene file: profile, pulse, pointing, polarisation.

A profile is a file beside this one and a line here, in `Shape`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from beamrider.io.files import DIMENSIONLESS, NonNegative, Number, Positive, Strict
from beamrider.io.wording import brief
from dynamics.light import spots
from dynamics.light.aim import POWER, Wander
from dynamics.light.flat_top import FlatTop
from dynamics.light.gaussian import Gaussian
from dynamics.light.measured import Map
from dynamics.light.pointing import Noise, Pointing, extremes, wander
from dynamics.light.profile import Floats
from dynamics.light.ring import Ring
from dynamics.light.spots import Spot
from dynamics.light.super_gaussian import SuperGaussian

Rate = Annotated[float, Field(ge=-1e9, le=1e9)]
Shape = Gaussian | SuperGaussian | FlatTop | Ring | Map


class Part(Strict):
    """One of the spots of a `sum`."""

    profile: Annotated[Shape, Field(discriminator="kind", description="As the beam's own, without 'sum'.")] = Gaussian()
    share: Annotated[
        NonNegative,
        Field(
            description="Share of intensity_W_m2 where the spot is brightest.",
            json_schema_extra=DIMENSIONLESS,
        ),
    ] = 1.0
    x_m: Annotated[Number, Field(description="Place of its middle in m.")] = 0.0
    y_m: Annotated[Number, Field(description="Place of its middle in m.")] = 0.0
    radius_m: Annotated[Positive | None, Field(description="Radius in m; null for a map, which has its own.")] = None
    radius_y_m: Annotated[Positive | None, Field(description="That along its second axis in m; null: the same.")] = None
    angle_deg: Annotated[Number, Field(ge=-360, le=360, description="Its first axis from x towards y.")] = 0.0

    @model_validator(mode="after")
    def _sized(self) -> Part:
        if (self.radius_m is None) != isinstance(self.profile, Map):
            raise ValueError("radius_m: must be given, but for a map, which has its own")
        if isinstance(self.profile, Map) and self.radius_y_m is not None:
            raise ValueError("radius_y_m: a map has its own radii")
        return self

    @property
    def spot(self) -> Spot:
        """As the rest of the program knows it."""
        radius = self.radius_m or 1.0
        return Spot(
            self.profile,
            self.share,
            (self.x_m, self.y_m),
            (radius, self.radius_y_m or radius),
            math.radians(self.angle_deg),
        )


class Sum(Strict):
    """Spots of light whose intensities add up."""

    kind: Literal["sum"] = "sum"
    """What the profile is."""
    parts: Annotated[list[Part], Field(min_length=1, max_length=100, description="The spots.")]


class Beam(Strict):
    """Light along +z; off for `delay_s`, rises in `rise_s`, on for `on_s`, falls alike.

    polarisation: 'sail' turns with the sail, so that each cell always sees its own (the paper); 'lab' is linear at
    `polarisation_deg` from x towards y; 'turning' starts there and turns at `polarisation_Hz`. The last two are for
    rigid flight on tables that hold the Stokes response, and for reflections with `polarisation: tracked`. With these,
    the field that turns with the 'sail' is at `polarisation_deg` from the body's x.
    """

    intensity_W_m2: Annotated[
        NonNegative,
        Field(
            description="Where the profile is brightest, in W/m²; a map with a unit brings its own.",
        ),
    ]
    radius_m: Annotated[
        Positive,
        Field(
            description="Radius of the profile in m, of 1/e² intensity of a Gaussian; maps and sums bring their own.",
        ),
    ]
    radius_y_m: Annotated[
        Positive | None,
        Field(
            description="Radius in m along the second axis of an astigmatic beam; null: the same.",
        ),
    ] = None
    angle_deg: Annotated[Number, Field(ge=-360, le=360, description="Its first axis from x towards y.")] = 0.0
    profile: Annotated[Shape | Sum, Field(discriminator="kind", description="Intensity across the beam.")] = Gaussian()
    delay_s: Annotated[NonNegative, Field(description="Dark until then, in s.")] = 0.0
    rise_s: Annotated[NonNegative, Field(description="Length of the raised-cosine rise, and of the fall, in s.")] = 1e-6
    on_s: Annotated[Positive, Field(description="Time at full power in s.")] = 1e9
    pointing: Annotated[Pointing, Field(description="Where the beam points as time goes on.")] = Pointing()
    power_noise: Annotated[Noise | None, Field(description="Fluctuation of the power, as a share of it.")] = None
    polarisation: Annotated[Literal["sail", "lab", "turning"], Field(description="What the field turns with.")] = "sail"
    polarisation_deg: Annotated[Rate, Field(description="Direction of the field from x towards y.")] = 0.0
    polarisation_Hz: Annotated[Rate, Field(description="Turns of the field in a second.")] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _own_size(cls, data: Any) -> Any:
        """Radius, and intensity, of a map or a sum, which bring their own."""
        profile = data.get("profile") if isinstance(data, dict) else None
        kind = profile.get("kind") if isinstance(profile, dict) else getattr(profile, "kind", None)
        if isinstance(profile, dict) and isinstance(kind, int):  # pydantic cannot say a very long number
            return {**data, "profile": {**profile, "kind": brief(kind)}}
        if kind not in ("map", "sum"):
            return data
        try:
            own = profile if isinstance(profile, Map | Sum) else (Map if kind == "map" else Sum).model_validate(profile)
        except ValidationError:  # said where the field itself is looked at
            return {"radius_m": 1.0, "intensity_W_m2": 1.0, **data}
        found = own.extent[2] if isinstance(own, Map) else spots.reach([part.spot for part in own.parts])
        data = {"radius_m": found, **data, "profile": own}
        given = data["radius_m"]
        if (isinstance(given, float | int) and not math.isclose(given, found, rel_tol=1e-9)) or data.get("radius_y_m"):
            raise ValueError(f"radius_m = {data['radius_m']}: must be left out: a {kind} brings its own, {found:.6g}")
        if isinstance(own, Map) and math.isfinite(own.grid.peak):
            data = {"intensity_W_m2": own.grid.peak, **data}
        return data

    @model_validator(mode="after")
    def _one_polarisation(self) -> Beam:
        if self.polarisation != "turning" and self.polarisation_Hz != 0.0:
            raise ValueError(f"polarisation_Hz = {self.polarisation_Hz:g}: needs polarisation: turning")
        return self

    @property
    def spots(self) -> list[Spot]:
        """The profile, as spots of light."""
        turn = math.radians(self.angle_deg)
        if not isinstance(self.profile, Sum):
            radius = 1.0 if isinstance(self.profile, Map) else self.radius_m
            return [Spot(self.profile, 1.0, (0.0, 0.0), (radius, self.radius_y_m or radius), turn)]
        c, s = math.cos(turn), math.sin(turn)
        return [
            Spot(
                one.profile,
                one.share,
                (c * one.place[0] - s * one.place[1], s * one.place[0] + c * one.place[1]),
                one.radii,
                one.angle + turn,
            )
            for one in (part.spot for part in self.profile.parts)
        ]

    @property
    def gaussian(self) -> bool:
        """Is it one round Gaussian spot, for which quadrature has a shorter way."""
        return isinstance(self.profile, Gaussian) and self.round

    @property
    def round(self) -> bool:
        """Does the intensity depend on the distance from the axis alone."""
        return spots.round_beam(self.spots)

    @property
    def reach_m(self) -> float:
        """Distance in m from the axis where the bright part ends: of a round Gaussian beam its radius."""
        return spots.reach(self.spots)

    @property
    def files(self) -> list[str]:
        """Files that it was read from, relative to the folder where the command runs."""
        maps = [spot.profile.file for spot in self.spots if isinstance(spot.profile, Map)]
        return [*maps, *([self.pointing.path_file] if self.pointing.path_file else [])]

    @property
    def wander(self) -> Wander:
        """Its axis and power as time goes on, in SI."""
        return wander(self.pointing, self.power_noise)

    @property
    def brightest_W_m2(self) -> float:
        """Intensity in W/m² that is nowhere exceeded."""
        noise = 0.0 if self.power_noise is None else float(extremes(self.pointing, self.power_noise)[POWER])
        return self.intensity_W_m2 * sum(spot.share for spot in self.spots) * (1.0 + noise)

    @property
    def steady(self) -> bool:
        """Does it keep its place and power."""
        return self.power_noise is None and self.pointing.steady


def intensity(beam: Beam, x: Any, y: Any) -> Floats:
    """Intensity (...) in W/m² at lateral position x, y in m (broadcast), at full power."""
    return np.asarray(beam.intensity_W_m2 * spots.share(beam.spots, x, y))


def gradient(beam: Beam, x: Floats, y: Floats) -> Floats:
    """Its derivatives (2, ...) in W/m³ along x and y."""
    return np.asarray(beam.intensity_W_m2 * spots.gradient(beam.spots, x, y))


def power(beam: Beam) -> float:
    """Power of the whole beam in W."""
    return beam.intensity_W_m2 * spots.power(beam.spots)
