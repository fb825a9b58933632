"""Polarised light on specular films: the transverse field of a ray, split into s and p at each hit.

A ray along d meets a surface of normal n; with ŝ = d × n/|d × n|, and p̂ = ŝ × d of the ray before and after,

    E = e_s ŝ + e_p p̂  →  r_s e_s ŝ + r_p e_p p̂'

(Yun, Crabtree & Chipman, Appl. Opt. 50 (2011) 2855). At normal incidence, where ŝ may be any transverse direction,
r_p = −r_s in these axes. Of the power, |r_s e_s|² + |r_p e_p|² is reflected and a_s |e_s|² + a_p |e_p|² absorbed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from beamrider.arrays import Floats
from dynamics.membrane.effects.interface import Setup
from dynamics.membrane.effects.light_pressure import LightPressure
from dynamics.membrane.effects.tables import Tables, concatenated, table
from dynamics.membrane.lattice import centred
from optics.table.pressure_table import lookup

#: Of one direction on one surface: Re r_s, Im r_s, Re r_p, Im r_p, a_s, a_p.
Film = tuple[float, float, float, float, float, float]

#: |d × n|² below which ŝ is taken across d at will: r_s and −r_p are the same there.
_NORMAL = 1e-20


class Polariser(NamedTuple):
    """The beam's field, and what films do to it; `tracked` is off and nothing is held where s and p are averaged.

    films: of each table Re r_s, Im r_s, Re r_p, Im r_p, then, as a table of its own, a_s, a_p. angle: of the field from
    x towards y at t = 0, in rad; rate: at which it turns, in rad/s. arms (2, n): mass times rest x and y of the nodes
    about the centre of mass, if the field turns with the sail; else empty.
    """

    tracked: bool
    films: Tables
    angle: float
    rate: float
    arms: Floats


def polariser(setup: Setup, on: bool) -> Polariser:
    """The beam's field and the films' amplitudes, if polarisation is tracked; InputError where a table has none."""
    scene, masses = setup.scene, setup.lattice.masses
    beam, tracked = scene.beam, on and scene.reflections.polarisation == "tracked"
    films = [part for design in scene.sail.designs if tracked for part in setup.tables[design].amplitude_arrays()]
    arms = masses * centred(setup.mesh, masses)[:, :2].T
    return Polariser(
        tracked=tracked,
        films=concatenated(films, False),
        angle=math.radians(beam.polarisation_deg),
        rate=2.0 * math.pi * beam.polarisation_Hz,
        arms=np.array(arms if tracked and beam.polarisation == "sail" else arms[:, :0], order="C"),
    )


@numba.njit(cache=True, error_model="numpy")
def azimuth(polariser: Polariser, x: Floats, t: float) -> float:
    """Angle in rad from x towards y of the beam's field at time t in s; x (3, n): nodes in m.

    A field that turns with the sail follows the rotation about z that fits its nodes best (Kabsch's, in the plane).
    """
    along, across = 0.0, 0.0
    for i in range(polariser.arms.shape[1]):
        along += polariser.arms[0, i] * x[0, i] + polariser.arms[1, i] * x[1, i]
        across += polariser.arms[0, i] * x[1, i] - polariser.arms[1, i] * x[0, i]
    yaw = math.atan2(across, along) if polariser.arms.shape[1] > 0 else 0.0
    return polariser.angle + polariser.rate * t + yaw


@numba.njit(cache=True, error_model="numpy")
def film(
    polariser: Polariser, light: LightPressure, kind: int, last: float, absorptance: float, i: int, cosine: float
) -> Film:
    """What triangle i does to s and p light at that cosine of incidence; see `Film`.

    kind: its table, or −1 for constant reflectance, which is that of an ideal mirror; last: largest sine of the table.
    absorptance: of both polarisations, or −f for f times the table's.
    """
    if kind < 0:
        r = math.sqrt(light.reflectance[i])
        return -r, 0.0, r, 0.0, absorptance, absorptance
    sine = min(math.sqrt(max(1.0 - cosine * cosine, 0.0)), last)
    s_re, s_im, p_re, p_im, _ = lookup(table(polariser.films, 2 * kind), sine, 0.0)
    if absorptance >= 0.0:
        return s_re, s_im, p_re, p_im, absorptance, absorptance
    a_s, a_p, _, _, _ = lookup(table(polariser.films, 2 * kind + 1), sine, 0.0)
    return s_re, s_im, p_re, p_im, -absorptance * a_s, -absorptance * a_p


@numba.njit(cache=True, error_model="numpy")
def _across(d: Floats, n: Floats) -> tuple[float, float, float]:
    """Unit vector ŝ along d × n, or any across d where they are parallel."""
    s0, s1, s2 = d[1] * n[2] - d[2] * n[1], d[2] * n[0] - d[0] * n[2], d[0] * n[1] - d[1] * n[0]
    if s0 * s0 + s1 * s1 + s2 * s2 < _NORMAL:
        if abs(d[0]) <= max(abs(d[1]), abs(d[2])):
            s0, s1, s2 = 0.0, d[2], -d[1]
        else:
            s0, s1, s2 = -d[2], 0.0, d[0]
    size = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    return s0 / size, s1 / size, s2 / size


@numba.njit(cache=True, error_model="numpy")
def reflect(response: Film, d: Floats, n: Floats, field: Floats) -> tuple[float, float]:
    """Share of a ray's power that is reflected, and absorbed, by a surface of unit normal n (3,); turns its field.

    d (3,): its unit direction before. field (2, 3): real and imaginary part of E across d, on return that across the
    direction after; of any size, as only its direction counts.
    """
    s_re, s_im, p_re, p_im, a_s, a_p = response
    s0, s1, s2 = _across(d, n)
    p0, p1, p2 = s1 * d[2] - s2 * d[1], s2 * d[0] - s0 * d[2], s0 * d[1] - s1 * d[0]
    es_re = field[0, 0] * s0 + field[0, 1] * s1 + field[0, 2] * s2
    es_im = field[1, 0] * s0 + field[1, 1] * s1 + field[1, 2] * s2
    ep_re = field[0, 0] * p0 + field[0, 1] * p1 + field[0, 2] * p2
    ep_im = field[1, 0] * p0 + field[1, 1] * p1 + field[1, 2] * p2
    of_s, of_p = es_re * es_re + es_im * es_im, ep_re * ep_re + ep_im * ep_im
    part = of_s / (of_s + of_p)
    share = (s_re * s_re + s_im * s_im) * part + (p_re * p_re + p_im * p_im) * (1.0 - part)
    loss = a_s * part + a_p * (1.0 - part)
    # p̂' = ŝ × (d − 2(d·n)n)
    twice = 2.0 * (d[0] * n[0] + d[1] * n[1] + d[2] * n[2])
    p0 -= twice * (s1 * n[2] - s2 * n[1])
    p1 -= twice * (s2 * n[0] - s0 * n[2])
    p2 -= twice * (s0 * n[1] - s1 * n[0])
    scale = 1.0 / math.sqrt(of_s + of_p)
    after = (
        scale * (s_re * es_re - s_im * es_im),
        scale * (p_re * ep_re - p_im * ep_im),
        scale * (s_re * es_im + s_im * es_re),
        scale * (p_re * ep_im + p_im * ep_re),
    )
    for k in range(2):
        s, p = after[2 * k], after[2 * k + 1]
        field[k, 0], field[k, 1], field[k, 2] = s * s0 + p * p0, s * s1 + p * p1, s * s2 + p * p2
    return min(share, 1.0 - loss), loss
