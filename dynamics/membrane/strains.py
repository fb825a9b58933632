"""Strain of the triangles of a membrane at given points, and where it is slack."""

from __future__ import annotations

import numpy as np

from beamrider.arrays import Floats
from dynamics.membrane.build import Membrane
from dynamics.membrane.effects import properties, sheet
from dynamics.membrane.effects.springs import REFERENCE_TEMPERATURE
from dynamics.membrane.lattice import per_triangle
from dynamics.membrane.layout.triangles import Patch
from dynamics.membrane.row_layout import free_sides
from dynamics.membrane.work_space import PATCH

#: Elastic strain of pressure below which rounding may be all there is.
LEAST_STRAIN = 1e-9


def strains(membrane: Membrane, points: Floats, temperature: Floats) -> tuple[Floats, Floats | None]:
    """Strain (t,) of the triangles at points (n, 3) in m and temperature (n,) in K, and 1 (t,) where they are slack.

    The larger principal strain where triangles carry the load, which are slack where ε₂ + ν ε₁ < 0, that is where the
    smaller principal stress is a pressure; of springs the largest ℓ/L_T − 1 of the three sides, and None.
    """
    mesh, model = membrane.mesh, membrane.model
    a, b = mesh.edges.T
    if membrane.elastic_triangles:
        corners, free, t = model.triangles.corners, free_sides(model.stencil, model.effects.sheet), len(mesh.triangles)
        whole = sheet.SheetWork(model.effects.sheet.modulus, model.effects.sheet.shear, model.effects.sheet.limit)
        patch, found = Patch(np.empty((6, PATCH)), np.empty((10, PATCH)), np.empty((PATCH, 4))), np.empty((2, t))
        sheet.grow(model.effects.sheet, model.stencil, corners, temperature, free)
        growing = model.effects.properties.expansion
        properties.grow(growing, model.effects.sheet, model.stencil, corners, temperature, free)
        sheet.principal(
            model.effects.sheet, whole, model.stencil, free, corners, np.ascontiguousarray(points.T), patch, found
        )
        poisson = per_triangle(membrane.scene.sail, mesh, "poisson")
        return found[0], (found[1] + poisson * found[0] < -LEAST_STRAIN).astype(float)
    free = mesh.lengths
    if model.effects.springs.expansion.size:
        mean = 0.5 * (temperature[a] + temperature[b])
        free = free * (1.0 + membrane.lattice.expansion * (mean - REFERENCE_TEMPERATURE))
    edges = np.linalg.norm(points[b] - points[a], axis=1) / free - 1.0
    return np.asarray(edges[mesh.triangle_edges].max(axis=1)), None
