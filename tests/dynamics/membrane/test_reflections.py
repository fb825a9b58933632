"""Reflections within the sail: nearest hits, the account of power and momentum, closed forms of folded mirrors."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.effects import reflections, tree
from dynamics.membrane.flight import Flight, fly
from dynamics.membrane.output.record import COLUMNS
from dynamics.membrane.plan import plan
from optics.cells.schema import ThinFilm
from optics.thin_film.stage import make_table, solve
from tests.membranes import altered, dark, film, normals
from tests.mirrors import BOWL, WIDE, force, lit
from tests.synthetic import smooth_tables

SILICON = ThinFilm.model_validate(
    {
        "kind": "thin_film",
        "name": "si43",
        "wavelength_nm": 1550,
        "polarisation": "mean",
        "layers": [{"thickness_nm": 43, "index": {"n": 3.48, "k": 1.2e-6}}],
    }
)


# Nearest hits


def test_the_tree_finds_what_asking_every_triangle_finds(tmp_path: Path):
    """A crumpled sheet, rays from everywhere: the same triangle and distance to the bit."""
    flight, _ = lit(tmp_path, sail=BOWL)
    m, random = flight.model.effects, np.random.default_rng(5)
    x = np.ascontiguousarray(flight.model.rest + 0.1 * random.standard_normal(flight.model.rest.shape))
    w = flight.work.effects.reflections
    tree.refit(m.reflections.tree, x, m.light.corners, w.boxes)
    hits, none = 0, np.empty(0, np.int64)
    for k in range(400):
        origin, direction = 0.3 * random.standard_normal(3), random.standard_normal(3)
        direction = np.eye(3)[k % 3] if k < 30 else direction / np.linalg.norm(direction)
        got = tree.nearest(
            m.reflections.tree, w.boxes, x, m.light.corners, origin, direction, -1, 1e-9, none, w.stack, w.ray[2]
        )
        every = np.array([tree.meets(x, m.light.corners, i, origin, direction) for i in range(len(m.reflections.kind))])
        every[~(every > 1e-9)] = np.inf
        best = int(np.argmin(every))
        assert got == ((best, every[best]) if every[best] < np.inf else (-1, np.inf))
        hits += got[0] >= 0
    assert hits > 100


# Accounts


@pytest.mark.parametrize("rays", [1, 3])
def test_no_power_is_lost_or_made(tmp_path: Path, rays: int):
    """Incident = absorbed + passed through + leaving + given up, to rounding."""
    flight, row = lit(tmp_path, sail=BOWL, reflections={"rays_a_side": rays})
    account, incident = flight.work.effects.reflections.account, row[COLUMNS["power_incident"]]
    through = (1.0 - 0.6 - 0.1) * incident + account[reflections.THROUGH]
    absorbed = 0.1 * incident + account[reflections.ABSORBED]
    left = account[reflections.LEAVES] + account[reflections.GIVEN_UP]
    assert absorbed + through + left == pytest.approx(incident, rel=1e-12)
    assert row[COLUMNS["power_absorbed"]] == pytest.approx(absorbed, rel=1e-12)
    assert row[COLUMNS["power_reflected"]] == account[reflections.LEAVES]
    assert account[reflections.HITS] > 0.5 * 216 * rays**2


def test_the_force_is_what_the_light_loses_in_momentum(tmp_path: Path):
    """An opaque crumpled mirror: F = (incident − leaving)/c, whichever face is hit; nothing given up."""
    random = np.random.default_rng(7)
    flight, row = lit(
        tmp_path,
        sail={**BOWL, "sectors": film(reflectance=0.9, absorptance=0.1)},
        rings=5,
        shape=lambda x: x + 0.02 * random.standard_normal(x.shape),
        reflections={"bounces": 500, "cutoff": 0.0},
    )
    account = flight.work.effects.reflections.account
    leaving = account[reflections.MOMENTUM : reflections.MOMENTUM + 3]
    given = np.array([0.0, 0.0, row[COLUMNS["power_incident"]] / LIGHT_SPEED])
    assert account[reflections.GIVEN_UP] < 1e-18 * row[COLUMNS["power_incident"]]
    assert np.abs(force(row) - (given - leaving)).max() < 1e-12 * given[2]


def test_a_right_angle_sends_light_back_where_it_came_from(tmp_path: Path):
    """Two plane mirrors at 45°: every ray hits both and leaves along −z with R²: F_z = (P/c)(1 + R²) if opaque."""

    def folded(x: np.ndarray) -> np.ndarray:
        return np.stack([x[0] / np.sqrt(2.0), x[1], -np.abs(x[0]) / np.sqrt(2.0)])

    sail = {"outline": "square", "sectors": film(reflectance=0.9, absorptance=0.1)}
    flight, row = lit(tmp_path, sail=sail, rings=4, effects={"reflections": True}, shape=folded)
    power = row[COLUMNS["power_incident"]]
    assert flight.work.effects.reflections.account[reflections.HITS] == 128
    assert power == pytest.approx(1e9 / np.sqrt(2.0), rel=1e-7)
    assert row[COLUMNS["power_reflected"]] == pytest.approx(0.81 * power, rel=1e-12)
    assert np.allclose(force(row), [0.0, 0.0, 1.81 * power / LIGHT_SPEED], rtol=1e-12, atol=1e-12)


def test_backs_of_mirrors_reflect_like_their_fronts(tmp_path: Path):
    """The same fold turned over (light on the convex side) and within it a ray trap: each face is a mirror alike."""

    def closed(x: np.ndarray) -> np.ndarray:
        """Half the sheet at 45°, the other half upright and turned over, so that its back is hit."""
        left = np.stack([x[0] / np.sqrt(2.0), x[1], x[0] / np.sqrt(2.0)])
        return np.where(x[0] <= 0, left, np.stack([0.0 * x[0], x[1], -x[0]]))

    sail = {"outline": "square", "sectors": film(reflectance=0.9, absorptance=0.1)}
    flight, row = lit(tmp_path, sail=sail, rings=4, effects={"reflections": True}, shape=closed)
    power, account = row[COLUMNS["power_incident"]], flight.work.effects.reflections.account
    # Off the slope along +x, back off the upright part along −x, then off the slope again along −z
    assert account[reflections.LEAVES] == pytest.approx(0.9**3 * power, rel=1e-12)
    assert np.allclose(force(row), [0.0, 0.0, (1 + 0.9**3) * power / LIGHT_SPEED], rtol=1e-9, atol=1e-9)


def test_rays_of_a_paraboloid_meet_the_sail_once_more_and_leave_along_the_axis(tmp_path: Path):
    """Through the focus and back, from 2f < r on; the error falls with more rays a triangle and with more triangles."""
    opaque = film(reflectance=0.9, absorptance=0.1)
    off = []
    for rings in (8, 16, 32):
        flight, _ = lit(tmp_path, sail={**BOWL, "sectors": opaque}, rings=rings)
        account = flight.work.effects.reflections.account
        rim = flight.model.rest[:2].max()
        f = 0.5 / (4 * 1.4)
        inner = 4 * f**2 / rim  # rays from further in pass the rim
        area = np.pi * np.array([inner**2, rim**2 - inner**2]) * 1e9
        slope = flight.work.effects.light.incident.sum() / area.sum()
        assert slope == pytest.approx(1.0, abs=0.03)
        want = 0.9 * area[0] + 0.81 * area[1]
        off.append(abs(account[reflections.LEAVES] / want - 1.0))
    assert off[-1] < 5e-3
    assert off[-1] < 0.3 * off[0]


def test_more_rays_a_triangle_converge(tmp_path: Path):
    """Axial force on a paraboloid whose triangles reflect onto one another: at least at first order in rays a side."""
    values = {}
    for rays in (1, 2, 4, 8, 32):
        _, row = lit(tmp_path, sail=BOWL, rings=6, reflections={"rays_a_side": rays})
        values[rays] = force(row)[2]
    error = {rays: abs(values[rays] / values[32] - 1.0) for rays in (1, 2, 4, 8)}
    assert error[1] > 1e-3
    assert all(error[rays] < 5e-3 / rays for rays in error)


# Films


def test_a_film_s_table_gives_its_reflectance_and_absorptance_at_every_angle(tmp_path: Path):
    table = make_table(SILICON, 0.999, 1e-6)
    sail = {**BOWL, "sectors": [{"from_deg": 0.0, "material": "silicon_43nm", "design": "si43"}]}
    flight, _ = lit(tmp_path, {"si43": table}, sail=sail, absorptance="table")
    for degrees in (0.0, 30.0, 45.0, 60.0, 70.0, 80.0):
        want = solve(SILICON, np.array([np.sin(np.radians(degrees))]))
        got = reflections.response(
            flight.model.effects.reflections,
            flight.model.effects.light,
            flight.work.effects.light.absorptance,
            0,
            np.cos(np.radians(degrees)),
        )
        assert got[0] == pytest.approx(float(want.reflectance[0]), abs=1e-5)
        assert got[1] == pytest.approx(float(want.absorptance[0]), rel=1e-4)


def test_gratings_are_not_traced():
    design = [{"from_deg": 0.0, "material": "nitride_te", "design": "mark1e_te"}]
    scene = dark(2, sail={**BOWL, "sectors": design}, beam=WIDE)
    with pytest.raises(InputError, match=r"effects\.reflections: 'mark1e_te' is a grating"):
        fly(scene, {"mark1e_te": smooth_tables()["mark1e_te"]})


# On only when the scene calls for it


@pytest.mark.parametrize(
    ("sail", "on"),
    [
        ({}, False),
        (BOWL, True),
        ({**BOWL, "depth": 0.2}, False),
        ({"profile": "cone", "depth": 1.0}, True),
        ({**BOWL, "sectors": film(reflectance=0.0)}, False),
    ],
)
def test_only_steep_reflecting_sails_call_for_reflections(tmp_path: Path, sail: dict[str, Any], on: bool):
    scene = dark(2, sail={"sectors": film(), **sail}, beam=WIDE)
    assert plan(scene)["reflections"].on == on
    assert (Flight(scene, {}, tmp_path).model.effects.reflections.kind.size > 0) == on


def test_reflections_that_hit_nothing_leave_every_bit_as_it_was():
    scene = dark(
        3,
        sail={"sectors": film(reflectance=0.5)},
        beam=WIDE,
        release={"spin_Hz": -120.0},
        flight={"duration_s": 2e-4, "fly_away_m": 1e3},
    )
    on, off = (fly(altered(scene, effects={"reflections": value}), {})[0].state for value in (True, False))
    assert all(np.array_equal(a, b) for a, b in zip(on, off, strict=True))


def test_shallow_and_steep_sails_feel_the_closed_form_of_their_first_reflection(tmp_path: Path):
    """F = Σ (P/c)(2R (k·n) n + a k) over the triangles where reflections are off."""
    flight, row = lit(tmp_path, sail=BOWL, effects={"reflections": False})
    normal, power = normals(flight), flight.work.effects.light.incident
    want = (power / LIGHT_SPEED * (2 * 0.6 * normal[2] * normal + 0.1 * np.array([[0.0], [0.0], [1.0]]))).sum(axis=1)
    assert np.allclose(force(row), want, rtol=1e-12, atol=1e-12 * want[2])
