"""Polarised light from hit to hit on specular films: amplitudes, chains of facets, folded mirrors, accounts."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tmm

from beamrider.io.files import InputError
from dynamics.light.intensity import LIGHT_SPEED
from dynamics.membrane.effects import polarisation, reflections
from dynamics.membrane.flight import Flight
from dynamics.membrane.output.record import COLUMNS
from dynamics.membrane.plan import plan
from optics.cells.schema import ThinFilm
from optics.table.pressure_table import PressureTable
from optics.thin_film.stage import amplitudes, make_table, polarised, stack
from tests.membranes import dark, film, normals
from tests.mirrors import BOWL, WIDE, force, lit

FACES = {"outline": "square"}


def cell(name: str, *layers: tuple[float, float, float]) -> ThinFilm:
    """A film of layers (nm, n, k) at 1550 nm."""
    found = [{"thickness_nm": d, "index": {"n": n, "k": k}} for d, n, k in layers]
    return ThinFilm.model_validate({"kind": "thin_film", "name": name, "wavelength_nm": 1550, "layers": found})


GLASSY = cell("glassy", (43.0, 3.48, 0.05))
METAL = cell("metal", (2000.0, 1.4, 16.0))


@pytest.fixture(scope="module")
def tables() -> dict[str, PressureTable]:
    return {made.name: make_table(made, 0.9999, 1e-8) for made in (GLASSY, METAL)}


def tracked(
    tmp_path: Path, tables: dict[str, PressureTable], design: str, degrees: float, **groups: Any
) -> tuple[Flight, np.ndarray]:
    """A sail of that film, lit by a field fixed in the lab at `degrees` from x."""
    sail = {"sectors": [{"from_deg": 0.0, "material": "silicon_43nm", "design": design}], **groups.pop("sail", {})}
    beam = {"polarisation": "lab", "polarisation_deg": degrees, **groups.pop("beam", {})}
    bounced = {"polarisation": "tracked", **groups.pop("reflections", {})}
    return lit(
        tmp_path,
        {design: tables[design]},
        sail=sail,
        beam=beam,
        reflections=bounced,
        absorptance="table",
        outside_table="clamp",
        **groups,
    )


def response(made: ThinFilm, cosine: float) -> np.ndarray:
    return polarised(made, np.array([np.sqrt(1.0 - cosine**2)]))[:, 0]


# Films


def test_amplitudes_are_those_of_the_transfer_matrix():
    """tmm, whose p light has the same sign; |r|² is R, and r_p = −r_s at normal incidence."""
    random = np.random.default_rng(3)
    for _ in range(20):
        index = np.array([1.0, *(random.uniform(1.2, 4.0, 3) + 1j * random.uniform(0.0, 3.0, 3)), 1.0])
        thickness, angle = random.uniform(20.0, 400.0, 3), random.uniform(0.0, 1.5)
        found = amplitudes(index, thickness, 1550.0, np.sin(angle))
        for kind, share, r in zip("sp", (0.0, 1.0), found, strict=True):
            want = tmm.coh_tmm(kind, index, [np.inf, *thickness, np.inf], angle, 1550.0)["r"]
            assert abs(r - want) < 1e-12
            reflectance = stack(index, thickness, 1550.0, np.sin(angle), share).reflectance
            assert abs(r) ** 2 == pytest.approx(reflectance, rel=1e-12)
        r_s, r_p = amplitudes(index, thickness, 1550.0, 0.0)
        assert abs(r_s + r_p) < 1e-14


def test_a_table_keeps_amplitudes_and_interpolates_them(tmp_path: Path, tables: dict[str, PressureTable]):
    tables["glassy"].write(tmp_path / "t.h5")
    table = PressureTable.read(tmp_path / "t.h5")
    assert np.array_equal(table.amplitudes, tables["glassy"].amplitudes)
    flight, _ = tracked(tmp_path, {"glassy": table}, "glassy", 0.0, rings=2)
    m = flight.model.effects
    for cosine in np.random.default_rng(1).uniform(0.02, 1.0, 50):
        got = polarisation.film(m.reflections.polariser, m.light, 0, m.reflections.last[0], -1.0, 0, cosine)
        assert np.allclose(got, response(GLASSY, cosine), rtol=0.0, atol=1e-7)


def test_tables_without_amplitudes_are_refused_in_one_line(tmp_path: Path, tables: dict[str, PressureTable]):
    bare = {"metal": replace(tables["metal"], amplitudes=None)}
    with pytest.raises(InputError, match="'metal' holds no amplitudes of s and p light"):
        tracked(tmp_path, bare, "metal", 0.0, sail=BOWL)


# One ray


def jones_chain(normals: np.ndarray, films: np.ndarray, field: np.ndarray) -> list[float]:
    """Shares of the first power left after each facet: 2 × 2 Jones matrices, turned from one facet's axes to the next.

    normals (n, 3), films (n, 6) as of `polarised`, field (3,) complex across +z, the direction of the light.
    """
    ways = [np.array([0.0, 0.0, 1.0])]
    for normal in normals:
        ways.append(ways[-1] - 2.0 * (ways[-1] @ normal) * normal)
    axes = [np.cross(way, normal) for way, normal in zip(ways, normals, strict=False)]
    axes = [axis / np.linalg.norm(axis) for axis in axes]
    first = np.stack([axes[0], np.cross(axes[0], ways[0])])
    jones, powers = first @ field, []
    for i, row in enumerate(films):
        jones = np.array([complex(*row[:2]), complex(*row[2:4])]) * jones
        powers.append(float(np.vdot(jones, jones).real))
        if i + 1 < len(films):
            cos = axes[i] @ axes[i + 1]
            sin = np.cross(axes[i], axes[i + 1]) @ ways[i + 1]
            jones = np.array([[cos, -sin], [sin, cos]]) @ jones
    return powers


def test_three_facets_do_what_jones_matrices_say():
    """Random normals, random complex films with losses, random elliptical light."""
    random = np.random.default_rng(11)
    for _ in range(50):
        normals = random.standard_normal((3, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        films = np.concatenate([random.uniform(-0.6, 0.6, (3, 4)), random.uniform(0.0, 0.1, (3, 2))], axis=1)
        start = random.standard_normal((2, 3)) * np.array([1.0, 1.0, 0.0])
        start /= np.linalg.norm(start)
        field, way, power, powers = start.copy(), np.array([0.0, 0.0, 1.0]), 1.0, []
        for normal, row in zip(normals, films, strict=True):
            share, loss = polarisation.reflect(tuple(row), way, normal, field)
            assert 0.0 < share <= 1.0 - loss
            assert row[4:].min() <= loss <= row[4:].max()
            way, power = way - 2.0 * (way @ normal) * normal, power * share
            powers.append(power)
            assert np.abs(field @ way).max() < 1e-13
        assert np.allclose(powers, jones_chain(normals, films, start[0] + 1j * start[1]), rtol=1e-12)


def test_an_ideal_mirror_turns_the_field_as_a_conductor_does():
    """E' = −E + 2(n·E)n, from grazing to normal incidence; the share is R whatever the field."""
    random = np.random.default_rng(2)
    for tilt in (0.0, 1e-12, 1e-9, 1e-6, 0.3, 1.5):
        turn = random.uniform(0.0, 2.0 * np.pi)
        normal = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        field = np.array([[0.6, 0.0, 0.0], [0.0, 0.8, 0.0]])
        want = 0.5 * (-field + 2.0 * (field @ normal)[:, None] * normal)
        share, loss = polarisation.reflect((-0.5, 0.0, 0.5, 0.0, 0.1, 0.1), np.array([0.0, 0.0, 1.0]), normal, field)
        assert (share, loss) == (pytest.approx(0.25, rel=1e-14), pytest.approx(0.1, rel=1e-14))
        assert np.allclose(field, want, rtol=0.0, atol=1e-9)


# Sails


def test_at_normal_incidence_polarisation_makes_no_difference(tmp_path: Path, tables: dict[str, PressureTable]):
    _, row = tracked(tmp_path, tables, "glassy", 33.0, rings=3)
    flight, mean = tracked(tmp_path, tables, "glassy", 33.0, rings=3, reflections={"polarisation": "mean"})
    assert flight.model.effects.reflections.kind.size == 0
    assert np.allclose(force(row), force(mean), rtol=0.0, atol=1e-12 * force(mean)[2])
    absorbed = COLUMNS["power_absorbed"]
    assert row[absorbed] == pytest.approx(mean[absorbed], rel=1e-12)


@pytest.mark.parametrize("design", ["glassy", "metal"])
def test_a_right_angle_tells_s_from_p(tmp_path: Path, tables: dict[str, PressureTable], design: str):
    """Two mirrors at 45°, the fold along y: light leaves with R_s² where E is along it, R_p² where it lies across.

    At 45° half of the power is in each; at 30° from y, 3/4 in s. Force: (P/c)(1 + R'²) + transmitted light's nothing.
    """

    def folded(x: np.ndarray) -> np.ndarray:
        return np.stack([x[0] / np.sqrt(2.0), x[1], -np.abs(x[0]) / np.sqrt(2.0)])

    r = response({"glassy": GLASSY, "metal": METAL}[design], np.sqrt(0.5))
    r_s, r_p, a = r[0] ** 2 + r[1] ** 2, r[2] ** 2 + r[3] ** 2, r[4:]
    for degrees, s in ((90.0, 1.0), (0.0, 0.0), (45.0, 0.5), (120.0, 0.75)):
        flight, row = tracked(tmp_path, tables, design, degrees, sail=FACES, rings=3, shape=folded)
        power, p = row[COLUMNS["power_incident"]], 1.0 - s
        left = flight.work.effects.reflections.account[reflections.LEAVES]
        assert left == pytest.approx((s * r_s**2 + p * r_p**2) * power, rel=1e-6)
        lost = s * a[0] * (1.0 + r_s) + p * a[1] * (1.0 + r_p)
        assert row[COLUMNS["power_absorbed"]] == pytest.approx(lost * power, rel=1e-6)
        # Each mirror pushes with √2 R along its normal at 45° to z; what it absorbs pushes along the ray
        push = s * (r_s + r_s**2 + a[0]) + p * (r_p + r_p**2 + a[1])
        assert np.allclose(force(row), [0.0, 0.0, push * power / LIGHT_SPEED], rtol=1e-6, atol=1e-7)


def test_a_paraboloid_keeps_s_and_p_apart(tmp_path: Path, tables: dict[str, PressureTable]):
    """Axial rays stay in their meridional plane: those from r hit again at 4f²/r, where that is within the rim.

    What leaves is the mean of R_s R_s' and R_p R_p', not the product of means; the error is that of the mesh.
    """
    left = {}
    for kind in ("tracked", "mean"):
        flight, row = tracked(
            tmp_path,
            tables,
            "glassy",
            40.0,
            sail=BOWL,
            rings=24,
            reflections={"polarisation": kind, "rays_a_side": 2},
        )
        left[kind] = flight.work.effects.reflections.account[reflections.LEAVES] / row[COLUMNS["power_incident"]]
    f, rim = 0.5 / (4 * 1.4), flight.model.rest[:2].max()
    r = rim * np.sqrt((np.arange(4000) + 0.5) / 4000)  # of equal areas

    def shares(r: np.ndarray) -> np.ndarray:
        """R_s, R_p (2, n) where the slope is r/2f."""
        found = polarised(GLASSY, np.sin(np.arctan(r / (2 * f))))
        return np.stack([found[0] ** 2 + found[1] ** 2, found[2] ** 2 + found[3] ** 2])

    once, again = shares(r), np.where(4 * f**2 / r < rim, shares(np.minimum(4 * f**2 / r, rim)), 1.0)
    want = (once * again).mean()
    assert left["tracked"] == pytest.approx(want, rel=5e-3)
    assert left["mean"] == pytest.approx((once.mean(axis=0) * again.mean(axis=0)).mean(), rel=5e-3)
    assert abs(left["mean"] / want - 1.0) > 0.02


def crumpled(x: np.ndarray) -> np.ndarray:
    return x + 0.03 * np.random.default_rng(7).standard_normal(x.shape)


def test_no_polarised_power_is_lost_or_made(tmp_path: Path, tables: dict[str, PressureTable]):
    """Incident = absorbed + passed through + leaving + given up, to rounding, on a crumpled bowl."""
    flight, row = tracked(tmp_path, tables, "glassy", 20.0, sail=BOWL, rings=5, shape=crumpled)
    account, normal = flight.work.effects.reflections.account, normals(flight)
    power = flight.work.effects.light.incident
    shares = np.empty((2, power.size))
    for i in range(power.size):
        field = np.array([[np.cos(np.radians(20.0)), np.sin(np.radians(20.0)), 0.0], [0.0, 0.0, 0.0]])
        m = flight.model.effects
        found = polarisation.film(
            m.reflections.polariser, m.light, 0, m.reflections.last[0], -1.0, i, abs(normal[2, i])
        )
        shares[:, i] = polarisation.reflect(found, np.array([0.0, 0.0, 1.0]), normal[:, i].copy(), field)
    sent = account[[reflections.LEAVES, reflections.THROUGH, reflections.ABSORBED, reflections.GIVEN_UP]].sum()
    assert sent == pytest.approx(shares[0] @ power, rel=1e-12)
    absorbed = shares[1] @ power + account[reflections.ABSORBED]
    assert row[COLUMNS["power_absorbed"]] == pytest.approx(absorbed, rel=1e-12)
    assert account[reflections.HITS] > 100


def test_the_force_is_what_polarised_light_loses_in_momentum(tmp_path: Path, tables: dict[str, PressureTable]):
    """An opaque metal: F = (incident − leaving)/c, but for what interpolation lets through."""
    flight, row = tracked(
        tmp_path,
        tables,
        "metal",
        20.0,
        sail=BOWL,
        rings=5,
        shape=crumpled,
        reflections={"bounces": 500, "cutoff": 0.0},
    )
    account = flight.work.effects.reflections.account
    given = np.array([0.0, 0.0, row[COLUMNS["power_incident"]] / LIGHT_SPEED])
    leaving = account[reflections.MOMENTUM : reflections.MOMENTUM + 3]
    assert np.abs(force(row) - (given - leaving)).max() < 1e-6 * given[2]


def test_first_hits_of_two_crossed_fields_are_those_of_unpolarised_light(
    tmp_path: Path, tables: dict[str, PressureTable]
):
    """On a convex sail, where rays hit once: forces and heat are means of any two crossed fields'."""
    convex = {**BOWL, "depth": -1.4}
    rows = [tracked(tmp_path, tables, "glassy", a, sail=convex, rings=4)[1] for a in (25.0, 115.0)]
    _, mean = tracked(
        tmp_path,
        tables,
        "glassy",
        0.0,
        sail=convex,
        rings=4,
        effects={"reflections": True},
        reflections={"polarisation": "mean"},
    )
    for name in ("force", "power_absorbed"):
        at = COLUMNS[name]
        part = slice(at, at + 3) if name == "force" else slice(at, at + 1)
        apart, middle = rows[0][part] - rows[1][part], 0.5 * (rows[0][part] + rows[1][part])
        assert np.abs(middle - mean[part]).max() < 1e-6 * np.abs(mean[part]).max()
        assert np.abs(apart).max() < 1e-6 * np.abs(mean[part]).max()  # round sails are the same along x and y


def test_nothing_changes_when_sail_and_field_turn_together(tmp_path: Path, tables: dict[str, PressureTable]):
    """In the lab: mesh and field turned by 17°. Of the sail: its nodes turned, the field follows by itself."""
    _, row = tracked(tmp_path, tables, "glassy", 30.0, sail=BOWL, rings=4, shape=crumpled)
    c, s = np.cos(np.radians(17.0)), np.sin(np.radians(17.0))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = [
        tracked(tmp_path, tables, "glassy", 47.0, sail=BOWL, rings=4, shape=lambda x: turn @ crumpled(x)),
        tracked(tmp_path, tables, "glassy", 30.0, sail=BOWL, rings=4, shape=crumpled, beam={"polarisation": "sail"}),
        tracked(
            tmp_path,
            tables,
            "glassy",
            30.0,
            sail=BOWL,
            rings=4,
            shape=lambda x: turn @ crumpled(x),
            beam={"polarisation": "sail"},
        ),
    ]
    absorbed = COLUMNS["power_absorbed"]
    assert turned[0][1][absorbed] == pytest.approx(row[absorbed], rel=1e-12)
    assert np.allclose(force(turned[0][1]), turn @ force(row), rtol=0.0, atol=1e-12 * force(row)[2])
    assert turned[2][1][absorbed] == pytest.approx(turned[1][1][absorbed], rel=1e-12)
    assert np.allclose(force(turned[2][1]), turn @ force(turned[1][1]), rtol=0.0, atol=1e-12 * force(row)[2])
    # The field does matter
    other = tracked(tmp_path, tables, "glassy", 75.0, sail=BOWL, rings=4, shape=crumpled)[1]
    assert abs(other[absorbed] / row[absorbed] - 1.0) > 1e-5


def test_a_turning_field_is_where_its_rate_takes_it(tmp_path: Path, tables: dict[str, PressureTable]):
    turning = {"polarisation": "turning", "polarisation_Hz": -135.0}
    flight, _ = tracked(tmp_path, tables, "glassy", 10.0, rings=2, beam=turning)
    polariser = flight.model.effects.reflections.polariser
    angles = [polarisation.azimuth(polariser, flight.state.x, t) for t in (0.0, 1e-3, 2e-3)]
    assert angles[0] == pytest.approx(np.radians(10.0))
    assert [b - a for a, b in pairwise(angles)] == pytest.approx([-2.0 * np.pi * 0.135] * 2)


# Scenes


def test_tracking_is_on_from_the_first_hit_and_needs_reflections():
    groups = {"sail": {"sectors": film()}, "beam": WIDE}
    scene = dark(2, **groups, reflections={"polarisation": "tracked"})
    assert plan(scene)["reflections"].on
    with pytest.raises(ValueError, match=r"needs effects\.reflections: true or null"):
        dark(2, **groups, reflections={"polarisation": "tracked"}, effects={"reflections": False})
    with pytest.raises(ValueError, match="polarisation_deg = 30: needs polarisation: lab or turning"):
        dark(2, sail={"sectors": film()}, beam={**WIDE, "polarisation_deg": 30.0})
