"""Materials of sails, with literature values. Add one here or give it in full in the scene file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from optics.files import NonNegative, Positive, Strict


class Material(Strict):
    """A membrane material at its equivalent plain thickness. SI; emissivities and absorptance are dimensionless."""

    thickness_m: Positive
    density_kg_m3: Positive
    young_Pa: Positive
    poisson: Annotated[float, Field(gt=-1, lt=0.5)]
    strength_Pa: Positive
    conductivity_W_mK: NonNegative
    heat_capacity_J_kgK: Positive
    expansion_1_K: float
    emissivity_front: Annotated[float, Field(ge=0, le=1)]
    emissivity_back: Annotated[float, Field(ge=0, le=1)]
    absorptance: Annotated[float, Field(ge=0, le=1)]
    failure_temperature_K: Positive

    @property
    def areal_mass(self) -> float:
        """Mass per area in kg/m²."""
        return self.density_kg_m3 * self.thickness_m

    @property
    def limit_strain(self) -> float:
        """Strain at which the material tears, strength over Young's modulus."""
        return self.strength_Pa / self.young_Pa


def _nitride(thickness_m: float, absorptance: float) -> Material:
    """Stoichiometric LPCVD silicon nitride (Gao et al., Table S1), at the mass-equivalent thickness of a metagrating.

    The absorptance is 1 − exp(−4πkh/λ) of a single pass through the plain film of equal mass, k = 2e-6 at 1064 nm.
    """
    return Material(
        thickness_m=thickness_m, density_kg_m3=2700.0, young_Pa=270e9, poisson=0.27, strength_Pa=6.4e9,
        conductivity_W_mK=3.0, heat_capacity_J_kgK=800.0, expansion_1_K=2.3e-6, emissivity_front=0.1,
        emissivity_back=0.1, absorptance=absorptance, failure_temperature_K=1673.15,
    )


MATERIALS: dict[str, Material] = {
    "nitride_te": _nitride(400e-9, 9.448e-6),
    "nitride_tm": _nitride(1240e-9 / 3, 9.763e-6),
    "silicon_43nm": Material(
        thickness_m=43e-9, density_kg_m3=2330.0, young_Pa=169e9, poisson=0.262, strength_Pa=2.1e9,
        conductivity_W_mK=160.0, heat_capacity_J_kgK=670.0, expansion_1_K=2.33e-6, emissivity_front=0.1,
        emissivity_back=0.1, absorptance=7.0e-7, failure_temperature_K=1200.0,
    ),
}
