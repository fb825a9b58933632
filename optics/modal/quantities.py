"""What a table holds of a direction: q and absorptance, of the cell's own polarisation and of Stokes components."""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Floats
from optics.modal.response import Response
from optics.waves.incidence import worst_polarisation

OWN = 4  # quantities of the cell's own polarisation, which directions are chosen for


def quantities(response: Response) -> Floats:
    """Q and absorptance (20, n_u, n_v): of the cell's own polarisation, then of the four Stokes components."""
    own = np.concatenate([response.q, response.absorptance[..., None]], axis=-1)
    stokes = np.concatenate([response.q_stokes, response.absorptance_stokes[..., None]], axis=-1)
    every = np.concatenate([own[:, :, None], stokes], axis=2)
    return np.moveaxis(every.reshape(*every.shape[:2], -1), -1, 0)


def apart(values: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Q (3, ...), absorptance (...), q_stokes (4, 3, ...), absorptance_stokes (4, ...) of `quantities` (20, ...)."""
    every = values.reshape(5, 4, *values.shape[1:])
    return every[0, :3], every[0, 3], every[1:, :3], every[1:, 3]


def own_error(differences: Floats) -> Floats:
    """Largest error (...) in the cell's own polarisation of `quantities` (20, ...)."""
    return np.asarray(np.abs(differences[:OWN]).max(axis=0))


def error_in_any(differences: Floats) -> Floats:
    """Largest error (...) in any polarisation of `quantities` (20, ...)."""
    parts = differences[OWN:].reshape(4, 4, *differences.shape[1:])
    return np.asarray(worst_polarisation(parts).max(axis=0))
