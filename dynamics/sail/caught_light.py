"""Does a mesh catch the light that falls on it? The kernels take the beam's intensity at the middle of each triangle.

Of a beam that is narrow against its triangles a mesh then gets too much or too little, up to all of it. What it gets is
compared with the integral over the same triangles, for beams where the released sail may have them.
"""

from __future__ import annotations

import math

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.light.pointing import extremes
from dynamics.light.spots import Spots, finest, share
from dynamics.sail.mesh import Mesh, sail_mesh
from dynamics.scene.sail_schema import MOST_RINGS
from dynamics.scene.schema import Scene

#: Share of the power on the sail that a mesh may lose or gain, or give to a wrong region.
MOST = 1e-2
#: Sides of triangles in radii of the beam: below the first the share is below a tenth of MOST, above the other all.
FINE, COARSE = 0.1, 2.0
#: Rings of the largest mesh that is tried in search of one that will do; larger ones are like it in a wider beam.
TRIED = 40


def share_wrong(mesh: Mesh, beam: Spots, places: Floats) -> float:
    """The largest share of the power on the mesh, seen along the beam, that is wrong for beams at `places`.

    It is what the whole mesh gets too much or too little, or what a wrong region gets, whichever is more. places (k, 2)
    in m: of the axis of the beam, in the plane of the mesh. The integral is over pieces of an eighth of the length over
    which the beam changes, which err by a sixty-fourth of what a triangle as wide as that does.
    """
    side, radius = float(mesh.lengths.max()), finest(beam)
    if side > COARSE * radius:
        return 1.0
    parts = max(2, math.ceil(8.0 * side / radius))
    shares = []
    for place in places:
        right = _powers(mesh, beam, place, parts)
        off = _powers(mesh, beam, place, 1) - right
        shares.append(max(abs(off.sum()), 0.5 * np.abs(off).sum()) / max(right.sum(), 1e-30))
    return float(max(shares))


def _powers(mesh: Mesh, beam: Spots, place: Floats, parts: int) -> Floats:
    """Light (regions,) on the regions in units of the peak intensity, from the middles of parts² pieces a triangle."""
    a, b, c = (mesh.nodes[mesh.triangles[:, i], :2] - place for i in range(3))
    one, other = b - a, c - a
    area = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / parts**2
    total = np.zeros(len(area))
    for u, v in _middles(parts):
        x, y = (a + u * one + v * other).T
        total += share(beam, x, y)
    return np.asarray(np.bincount(mesh.sector, total * area))


def _middles(parts: int) -> list[tuple[float, float]]:
    """Barycentric middles of the parts² equal pieces of a triangle: rows, every second piece upside down."""
    return [
        ((i + (1 + j % 2) / 3.0) / parts, (j // 2 + (1 + j % 2) / 3.0) / parts)
        for i in range(parts)
        for j in range(2 * (parts - i) - 1)
    ]


def _places(scene: Scene) -> Floats:
    """Where the released sail may have the beam's axis: its middle, and two circles, the outer one of the offset."""
    away = math.hypot(*scene.release.offset_m)
    if not scene.beam.pointing.steady:
        away += math.hypot(*extremes(scene.beam.pointing, None)[:2])
    angles = np.radians(np.arange(0.0, 360.0, 45.0) + 7.0)  # on no line of the mesh
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    away = min(away, 0.9 * scene.sail.radius_m)  # beyond, the mesh has no light to get wrong
    return np.concatenate([np.zeros((1, 2)), *([0.5 * away * circle, away * circle] if away > 0 else [])])


def check_light(scene: Scene, mesh: Mesh) -> None:
    """InputError, which names the rings that it takes, where the mesh would not catch the light that falls on it."""
    beam, side = scene.beam.spots, float(mesh.lengths.max())
    if scene.beam.intensity_W_m2 == 0.0 or side < FINE * finest(beam):
        return
    wrong = share_wrong(mesh, beam, _places(scene))
    if wrong > MOST:
        needed = _rings(scene, wrong)
        cure = f"must be at least {needed}, or widen" if needed <= MOST_RINGS else "no mesh is fine enough: widen"
        what, key = (
            (f"beam of {scene.beam.radius_m:g} m", "radius_m")
            if scene.beam.gaussian
            else (f"beam that changes within {finest(beam):.3g} m", "profile")
        )
        raise InputError(
            f"{scene.name}.yaml: sail.rings = {scene.sail.rings}: triangles of {side:.3g} m would get "
            f"{100.0 * wrong:.3g} % of the light of a {what} wrong: {cure} beam.{key}"
        )


def _rings(scene: Scene, wrong: float) -> int:
    """The fewest rings, within a tenth, whose mesh catches the light right; more than allowed where none does.

    The share falls as the square of the triangles' sides where they are narrower than the beam.
    """
    rings, beam, places = scene.sail.rings, scene.beam.spots, _places(scene)
    while wrong > MOST and rings <= MOST_RINGS:
        rings = math.ceil(rings * (2.0 if wrong == 1.0 else max(1.05, 1.02 * math.sqrt(wrong / MOST))))
        tried = min(rings, TRIED)
        mesh = sail_mesh(scene.sail.model_copy(update={"rings": tried}))
        wrong = share_wrong(mesh, [spot.wider(rings / tried) for spot in beam], places * rings / tried)
    return rings
