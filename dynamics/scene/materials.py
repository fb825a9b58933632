"""Materials of sails, with literature values. Add one here or give it in full in the scene file."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from beamrider.io.files import DIMENSIONLESS, NonNegative, Pair, Positive, Strict

Changing = Literal[
    "conductivity_W_mK", "heat_capacity_J_kgK", "expansion_1_K", "emissivity_front", "emissivity_back", "absorptance"
]
Table = Annotated[list[Pair], Field(min_length=1)]
Fraction = Annotated[float, Field(ge=0, le=1, json_schema_extra=DIMENSIONLESS)]


class Material(Strict):
    """What a region is made of."""

    thickness_m: Annotated[float, Field(ge=1e-12, le=1e3)] | None = None
    """Thickness of the plain film of equal mass.

    Not needed, and checked, where the region has a design, whose cross-section is known (`dynamics.sail.masses`).
    """
    density_kg_m3: Annotated[float, Field(ge=1e-6, le=1e9)]
    """Density."""
    young_Pa: Annotated[float, Field(ge=1e-6, le=1e18)]
    """Young's modulus."""
    poisson: Annotated[float, Field(gt=-1, lt=0.5, json_schema_extra=DIMENSIONLESS)]
    """Poisson's ratio."""
    strength_Pa: Positive
    """Tensile strength: the principal stress at which the material tears."""
    conductivity_W_mK: NonNegative
    """Thermal conductivity."""
    heat_capacity_J_kgK: Annotated[float, Field(ge=1e-6, le=1e12)]
    """Specific heat capacity."""
    expansion_1_K: Annotated[float, Field(ge=-1, le=1)]
    """Linear coefficient of thermal expansion."""
    emissivity_front: Fraction
    """Hemispherical emissivity of the face that the light reaches."""
    emissivity_back: Fraction
    """Hemispherical emissivity of the other face."""
    absorptance: Fraction
    """Absorptance of a region without a design, at any angle."""
    failure_temperature_K: Annotated[float, Field(ge=1e-3, le=1e30)]
    """Temperature at which the material fails."""
    damping_s: Annotated[float, Field(ge=0, le=1e3)] = 0.0
    """Retardation time τ: stress = stiffness · (strain + τ · rate of strain)."""
    with_temperature: Annotated[
        dict[Changing, Table], Field(json_schema_extra={"unit": "K, that of the property"})
    ] = {}
    """Tables [[K, value], …] of properties that change with temperature, linear in between and constant beyond.

    At 300 K they give the plain value; of the expansion they hold the differential coefficient. Flexible flight follows
    them, rigid flight takes the plain values.
    """

    @model_validator(mode="after")
    def _tables_fit(self) -> Material:
        for name, table in self.with_temperature.items():
            kelvin, values = (np.array([row[i] for row in table]) for i in range(2))
            if kelvin[0] <= 0 or any(b <= a for a, b in itertools.pairwise(kelvin)):
                raise ValueError(f"with_temperature.{name}: temperatures must be positive and ascend, not {kelvin}")
            highest = 1.0 if name in ("emissivity_front", "emissivity_back", "absorptance") else np.inf
            if name != "expansion_1_K" and not (values.min() >= 0 and values.max() <= highest):
                raise ValueError(f"with_temperature.{name}: values must be from 0 to {highest:g}")
            if name == "heat_capacity_J_kgK" and values.min() == 0:
                raise ValueError(f"with_temperature.{name}: values must be above 0")
            plain, here = getattr(self, name), float(np.interp(300.0, kelvin, values))
            if not np.isclose(here, plain, rtol=1e-6, atol=0.0):
                raise ValueError(f"with_temperature.{name}: gives {here:g} at 300 K: must be {name} = {plain:g}")
        return self

    def highest(self, name: Changing) -> float:
        """The largest size of a property at any temperature."""
        return max(abs(getattr(self, name)), *(abs(row[1]) for row in self.with_temperature.get(name, [[0.0, 0.0]])))

    def lowest(self, name: Changing) -> float:
        """The smallest size of a property at any temperature."""
        return min(abs(getattr(self, name)), *(abs(row[1]) for row in self.with_temperature.get(name, [[0.0, np.inf]])))

    @property
    def areal_mass(self) -> float:
        """Mass per area in kg/m²."""
        if self.thickness_m is None:
            raise ValueError("no thickness: that of a design is known with its table (dynamics.sail.masses)")
        return self.density_kg_m3 * self.thickness_m

    @property
    def limit_strain(self) -> float:
        """Strain at which the material tears, strength over Young's modulus."""
        return self.strength_Pa / self.young_Pa


def _nitride(thickness_m: float, absorptance: float) -> Material:
    """Stoichiometric LPCVD silicon nitride (Gao et al., Table S1), at the mass-equivalent thickness of a metagrating.

    The thickness is nominal, as of all materials here: where a design is known, its own takes its place.
    The absorptance is 1 − exp(−4πkh/λ) of a single pass through the plain film of equal mass, k = 2e-6 at 1064 nm.
    """
    return Material(
        thickness_m=thickness_m,
        density_kg_m3=2700.0,
        young_Pa=270e9,
        poisson=0.27,
        strength_Pa=6.4e9,
        conductivity_W_mK=3.0,
        heat_capacity_J_kgK=800.0,
        expansion_1_K=2.3e-6,
        emissivity_front=0.1,
        emissivity_back=0.1,
        absorptance=absorptance,
        failure_temperature_K=1673.15,
    )


MATERIALS: dict[str, Material] = {
    "nitride_te": _nitride(400e-9, 9.448e-6),
    "nitride_tm": _nitride(1240e-9 / 3, 9.763e-6),
    "silicon_43nm": Material(
        thickness_m=43e-9,
        density_kg_m3=2330.0,
        young_Pa=169e9,
        poisson=0.262,
        strength_Pa=2.1e9,
        conductivity_W_mK=160.0,
        heat_capacity_J_kgK=670.0,
        expansion_1_K=2.33e-6,
        emissivity_front=0.1,
        emissivity_back=0.1,
        absorptance=7.0e-7,
        failure_temperature_K=1200.0,
    ),
}
