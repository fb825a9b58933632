"""Beam profiles: power, gradient, limits, axes, places."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from beamrider.io.files import InputError, validate
from dynamics.light import beam as light
from dynamics.light.beam import Beam
from dynamics.light.profile import Profile
from dynamics.scene.schema import Scene
from tests.membranes import FIG6

ROUND: list[dict[str, Any]] = [
    {"kind": "gaussian"},
    {"kind": "super_gaussian", "order": 4},
    {"kind": "super_gaussian", "order": 12},
    {"kind": "flat_top", "order": 3},
    {"kind": "flat_top", "order": 60},
    {"kind": "ring", "charge": 1},
    {"kind": "ring", "charge": 7},
]
TILTED = {"radius_m": 0.3, "radius_y_m": 0.5, "angle_deg": 25.0}
PARTS = [
    {"radius_m": 0.2, "x_m": 0.15, "y_m": -0.05, "share": 0.6},
    {"radius_m": 0.3, "radius_y_m": 0.1, "angle_deg": 70.0, "profile": {"kind": "ring"}},
    {"radius_m": 0.25, "x_m": -0.2, "profile": {"kind": "flat_top", "order": 5}, "share": 0.3},
]


def beam(profile: dict[str, Any], **keys: Any) -> Beam:
    size = {} if profile["kind"] in ("map", "sum") else {"radius_m": 0.4}
    return Beam.model_validate({"intensity_W_m2": 1e9, "profile": profile, **size, **keys})


def measured(folder: Path, step: float = 0.02, unit: str = "W/m2") -> str:
    """A map of two smooth spots as HDF5, beside the test."""
    x, y = np.arange(-0.9, 0.9001, step), np.arange(-0.8, 0.8001, step)

    def spot(a: float, b: float, w: float) -> np.ndarray:
        return np.exp(-2.0 * ((x[:, None] - a) ** 2 + 1.5 * (y - b) ** 2) / w**2)

    with h5py.File(folder / "map.h5", "w") as file:
        file["x"], file["y"] = x, y
        file["intensity"] = 2e8 * (spot(0.05, 0.0, 0.3) + 0.5 * spot(-0.1, 0.1, 0.25))
        file["intensity"].attrs["units"] = unit
    return "map.h5"


@pytest.fixture
def of_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Beam:
    monkeypatch.chdir(tmp_path)
    return Beam.model_validate({"profile": {"kind": "map", "file": measured(tmp_path)}})


def every() -> list[Beam]:
    return [
        *(beam(one) for one in ROUND),
        *(beam(one, **TILTED) for one in ROUND),
        beam({"kind": "sum", "parts": PARTS}),
        beam({"kind": "sum", "parts": PARTS}, angle_deg=-40.0),
    ]


def added_up(which: Beam, extent: float, n: int) -> float:
    """Power by midpoints, which is exact to rounding for smooth beams that end within the extent."""
    x = extent * ((np.arange(n) + 0.5) / n * 2.0 - 1.0)
    return float(light.intensity(which, x[:, None], x).sum() * (2.0 * extent / n) ** 2)


@pytest.mark.parametrize("which", every())
def test_the_power_is_that_of_the_closed_form(which: Beam):
    assert added_up(which, 3.0, 1200) == pytest.approx(light.power(which), rel=2e-12)


def test_the_power_of_a_map_is_the_integral_of_its_spline(of_map: Beam):
    # Gauss–Legendre of each cell is exact for the bicubic polynomial that it holds
    grid = of_map.spots[0].profile.grid  # type: ignore[attr-defined]
    x, weight = np.polynomial.legendre.leggauss(3)
    steps = [axis[1] - axis[0] for axis in (grid.x, grid.y)]
    places = [
        (axis[0] - 12 * step + step * (np.arange(axis.size + 23)[:, None] + 0.5 * (x + 1.0))).ravel()
        for axis, step in zip((grid.x, grid.y), steps, strict=True)
    ]
    weights = [0.5 * step * np.tile(weight, place.size // 3) for step, place in zip(steps, places, strict=True)]
    total = weights[0] @ light.intensity(of_map, places[0][:, None], places[1]) @ weights[1]
    assert total == pytest.approx(light.power(of_map), rel=1e-8)


def differences(which: Beam, x: np.ndarray, y: np.ndarray, h: float) -> np.ndarray:
    """Derivatives by central differences of sixth order."""

    def along(dx: float, dy: float) -> np.ndarray:
        pair = [
            light.intensity(which, x + k * dx, y + k * dy) - light.intensity(which, x - k * dx, y - k * dy)
            for k in (1, 2, 3)
        ]
        return (45.0 * pair[0] - 9.0 * pair[1] + pair[2]) / (60.0 * h)

    return np.stack([along(h, 0.0), along(0.0, h)])


@pytest.mark.parametrize("which", every())
def test_the_gradient_is_that_of_differences(which: Beam):
    x, y = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 200))
    got, want = light.gradient(which, x, y), differences(which, x, y, 1e-4)
    assert np.abs(got - want).max() < 1e-7 * np.abs(want).max()


def test_the_gradient_of_a_map_is_that_of_differences(of_map: Beam):
    x, y = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 200))
    got, want = light.gradient(of_map, x, y), differences(of_map, x, y, 1e-6)
    assert np.abs(got - want).max() < 1e-6 * np.abs(want).max()


@pytest.mark.parametrize(
    "profile",
    [
        {"kind": "super_gaussian", "order": 2},
        {"kind": "flat_top", "order": 0},
        {"kind": "ring", "charge": 0},
        {"kind": "sum", "parts": [{"radius_m": 0.4}]},
    ],
)
def test_the_gaussian_limit_is_the_gaussian_to_the_bit(profile: dict[str, Any]):
    x, y = np.random.default_rng(2).uniform(-2.0, 2.0, (2, 1000))
    gaussian = beam({"kind": "gaussian"})
    assert np.array_equal(light.intensity(beam(profile), x, y), light.intensity(gaussian, x, y))
    assert np.allclose(light.gradient(beam(profile), x, y), light.gradient(gaussian, x, y), rtol=1e-13, atol=1e-300)
    assert light.power(beam(profile)) == pytest.approx(light.power(gaussian), rel=1e-14)


def test_a_gaussian_falls_by_e_squared_at_its_radius():
    which = beam({"kind": "gaussian"})
    assert light.intensity(which, 0.0, 0.0) == 1e9
    assert light.intensity(which, 0.24, -0.32) == pytest.approx(1e9 * np.exp(-2), rel=1e-14)


def test_profiles_are_brightest_where_they_say():
    assert light.intensity(beam({"kind": "ring", "charge": 8}), 0.8, 0.0) == pytest.approx(1e9, rel=1e-14)
    assert light.intensity(beam({"kind": "ring", "charge": 8}), 0.0, 0.0) < 1e-280
    for order in (0, 20, 100):
        flat = beam({"kind": "flat_top", "order": order})
        assert light.intensity(flat, 0.0, 0.0) == pytest.approx(1e9, rel=1e-14)
    assert light.intensity(flat, 0.28, 0.0) == pytest.approx(1e9, rel=1e-4)
    assert light.intensity(flat, 0.52, 0.0) < 1e-4 * 1e9


def test_two_radii_and_tilted_axes():
    which = beam({"kind": "super_gaussian", "order": 6}, **TILTED)
    c, s = math.cos(math.radians(25.0)), math.sin(math.radians(25.0))
    for place in ((0.3 * c, 0.3 * s), (-0.5 * s, 0.5 * c)):
        assert light.intensity(which, *place) == pytest.approx(1e9 * np.exp(-2), rel=1e-13)
    # A beam of two equal radii is the round one, however its axes lie
    round_one = beam({"kind": "ring"})
    same = beam({"kind": "ring"}, radius_y_m=0.4 * (1 + 1e-15), angle_deg=33.0)
    x, y = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 100))
    assert np.allclose(light.intensity(same, x, y), light.intensity(round_one, x, y), rtol=1e-12)


def test_the_parts_of_a_sum_add_up_where_they_lie():
    whole = beam({"kind": "sum", "parts": PARTS})
    x, y = np.random.default_rng(4).uniform(-0.5, 0.5, (2, 100))
    first = beam({"kind": "gaussian"}, radius_m=0.2)
    second = beam({"kind": "ring"}, radius_m=0.3, radius_y_m=0.1, angle_deg=70.0)
    third = beam({"kind": "flat_top", "order": 5}, radius_m=0.25)
    want = 0.6 * light.intensity(first, x - 0.15, y + 0.05) + light.intensity(second, x, y)
    want = want + 0.3 * light.intensity(third, x + 0.2, y)
    assert np.allclose(light.intensity(whole, x, y), want, rtol=1e-13, atol=1e-6)


def test_a_map_goes_through_its_points_and_ends_dark(of_map: Beam, tmp_path: Path):
    with h5py.File(tmp_path / "map.h5") as file:
        x, y, values = (file[name][:] for name in ("x", "y", "intensity"))
    assert of_map.intensity_W_m2 == values.max()
    assert np.abs(light.intensity(of_map, x[:, None], y) - values).max() < 1e-9 * values.max()
    assert light.intensity(of_map, 1.5, 0.0) == light.intensity(of_map, 0.0, -9.0) == 0.0
    assert of_map.profile.sha256 == hashlib.sha256((tmp_path / "map.h5").read_bytes()).hexdigest()  # type: ignore
    # From a CSV file in another unit the same numbers
    lines = ["x_m,y_m,intensity_W_cm2"]
    lines += [
        f"{a!r},{b!r},{float(values[i, j]) / 1e4!r}" for i, a in enumerate(x.tolist()) for j, b in enumerate(y.tolist())
    ]
    (tmp_path / "map.csv").write_text("\n".join(lines), encoding="utf-8")
    again = Beam.model_validate({"profile": {"kind": "map", "file": "map.csv"}})
    places = np.random.default_rng(5).uniform(-0.7, 0.7, (2, 100))
    assert np.allclose(light.intensity(again, *places), light.intensity(of_map, *places), rtol=1e-9, atol=1.0)


def test_a_beam_names_the_files_that_it_is_read_from(of_map: Beam, tmp_path: Path):
    (tmp_path / "path.csv").write_text("t_s,x_m,y_m\n0,0,0\n1,0.1,0.2\n", encoding="utf-8")
    both = Beam.model_validate(of_map.model_dump() | {"pointing": {"path_file": "path.csv"}})
    assert both.files == ["map.h5", "path.csv"]
    assert beam({"kind": "gaussian"}).files == []


def test_a_map_turns_with_the_angle_and_takes_another_peak(of_map: Beam):
    turned = Beam.model_validate(of_map.model_dump() | {"angle_deg": 90.0, "intensity_W_m2": 1.0})
    x, y = np.random.default_rng(6).uniform(-0.5, 0.5, (2, 50))
    assert np.allclose(
        light.intensity(turned, -y, x) * of_map.intensity_W_m2, light.intensity(of_map, x, y), rtol=1e-9, atol=1e-3
    )


# What is refused


def refusal(**keys: Any) -> str:
    with pytest.raises(InputError) as caught:
        validate({**FIG6.model_dump(), "beam": {"intensity_W_m2": 1e9, **keys}}, Scene, "own.yaml")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"profile": {"kind": "donut"}, "radius_m": 1.0}, "beam.profile = "),
        ({"profile": {"kind": "super_gaussian", "order": 3}, "radius_m": 1.0}, "order = 3: must be a multiple of 2"),
        ({"profile": {"kind": "super_gaussian", "order": 0}, "radius_m": 1.0}, "order = 0: must be greater than or eq"),
        ({"profile": {"kind": "flat_top"}}, "beam: missing radius_m"),
        ({"profile": {"kind": "sum", "parts": [{"x_m": 1.0}]}}, "radius_m: must be given"),
        ({"profile": {"kind": "sum", "parts": [{"radius_m": 1.0}]}, "radius_m": 3.0}, "a sum brings its own"),
        ({"profile": {"kind": "map", "file": "../m.h5"}}, "must be a path of a .csv, .h5 or .hdf5 file below"),
        ({"profile": {"kind": "map", "file": "none.h5"}}, "none.h5: cannot be read"),
    ],
)
def test_wrong_beams_are_refused_in_one_line(keys: dict[str, Any], said: str):
    assert said in refusal(**keys)


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda f: f["intensity"].attrs.update({"units": "lux"}), "unit of intensity 'lux': must be one of W/m2, "),
        (lambda f: f["intensity"].write_direct(np.full(f["intensity"].shape, 1.0)), "of the peak at the border"),
        (lambda f: f["x"].write_direct(np.arange(f["x"].size) ** 2.0), "x: must ascend in eq"),
        (lambda f: f["intensity"].write_direct(np.full(f["intensity"].shape, np.nan)), "must be finite"),
        (lambda f: f.pop("y"), "not a readable map"),
    ],
)
def test_wrong_maps_are_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, edit: Any, said: str):
    monkeypatch.chdir(tmp_path)
    measured(tmp_path)
    with h5py.File("map.h5", "r+") as file:
        edit(file)
    assert said in refusal(profile={"kind": "map", "file": "map.h5"})


def test_a_map_that_has_changed_since_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    known = Beam.model_validate({"profile": {"kind": "map", "file": measured(tmp_path)}}).model_dump()
    measured(tmp_path, step=0.05)
    assert "is not the file of that sha256" in refusal(**known)


def test_a_relative_map_needs_an_intensity(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    profile = {"kind": "map", "file": measured(tmp_path, unit="1")}
    assert Beam.model_validate({"profile": profile, "intensity_W_m2": 3.0}).intensity_W_m2 == 3.0
    with pytest.raises(ValueError, match="intensity_W_m2"):
        Beam.model_validate({"profile": profile})


def test_a_profile_with_tails_must_tell_where_it_is_dark():
    """Else its integrals would end at its radius, without a word."""

    class Tailed(Profile):
        kind: str = "tailed"

        def values(self, u: Any, v: Any) -> Any:
            return (1.0 + np.asarray(u) ** 2) ** -3.0

    with pytest.raises(NotImplementedError, match=r"'tailed': is not dark at 8 radii: it must define `dark`"):
        Tailed().dark  # noqa: B018
