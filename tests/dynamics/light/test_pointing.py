"""Where the beam points: records of noise, paths, and the frame of a beam that wanders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError, validate
from dynamics.light import aim, pointing
from dynamics.light.pointing import Noise, Pointing
from dynamics.scene.schema import Scene
from tests.membranes import FIG6

WHITE = {"rms": 2e-3, "cutoff_Hz": 80.0, "seed": 7, "record_s": 4.0}


def test_a_white_record_has_its_size_and_no_higher_frequencies():
    times, values = Noise.model_validate(WHITE).record(0)
    assert values[0] == values[-1]
    assert np.sqrt(np.mean(values[:-1] ** 2)) == pytest.approx(2e-3, rel=1e-12)
    assert abs(values[:-1].mean()) < 1e-17
    powers = np.abs(np.fft.rfft(values[:-1]) / (values.size - 1)) ** 2 * 2.0
    f = np.arange(powers.size) / times[-1]
    assert np.allclose(powers[(f > 0) & (f <= 80.0)] * 4.0, 2e-3**2 / 80.0, rtol=1e-9)
    assert powers[f > 80.0].max() < 1e-30


def test_a_given_spectrum_is_that_of_the_record():
    noise = Noise(spectrum=[[10.0, 0.0], [30.0, 2e-8], [90.0, 1e-8]], seed=3, record_s=5.0)
    times, values = noise.record(1)
    powers = 2.0 * np.abs(np.fft.rfft(values[:-1]) / (values.size - 1)) ** 2 * 5.0
    f = np.arange(powers.size) / times[-1]
    assert np.allclose(powers, np.interp(f, [10.0, 30.0, 90.0], [0.0, 2e-8, 1e-8], left=0.0, right=0.0), atol=1e-20)
    assert np.sqrt(np.mean(values[:-1] ** 2)) == pytest.approx(np.sqrt(0.5 * 20 * 2e-8 + 60 * 1.5e-8), rel=1e-2)


def test_the_same_seed_gives_the_same_record_and_channels_are_their_own():
    one, same, other = (Noise.model_validate(WHITE | {"seed": seed}) for seed in (7, 7, 8))
    assert np.array_equal(one.record(0)[1], same.record(0)[1])
    for values in (other.record(0)[1], one.record(1)[1]):
        assert abs(np.corrcoef(one.record(0)[1], values)[0, 1]) < 0.2


def at(where: Pointing, power: Noise | None, times: Any, **units: float) -> np.ndarray:
    found, wander = np.empty((len(times), 5)), pointing.wander(where, power, **units)
    for t, out in zip(times, found, strict=True):
        aim.where(wander, float(t), out)
    return found


def test_kernels_follow_the_path_and_the_record():
    path = Pointing(path=[[0.0, 0.0, 0.0, 0.0, 0.0], [0.5, 0.1, -0.05, 1.0, 0.0], [2.0, 0.0, 0.2, 0.0, -2.0]])
    rows = np.array([[0.0, 0.0, 0.0, 0.0], [0.1, -0.05, np.radians(1.0), 0.0], [0.0, 0.2, 0.0, np.radians(-2.0)]])
    # On its rows, and where it stays before the first and after the last
    assert np.allclose(at(path, None, [0.0, 0.5, 2.0, 9.0])[:, :4], [*rows, rows[2]], atol=1e-15)
    assert np.allclose(at(path, None, [-1.0])[0], 0.0)
    between = at(path, None, np.linspace(0.0, 0.5, 50))[:, 0]
    assert np.all(np.diff(between) >= 0.0)  # monotone, without overshoot
    noise = Noise.model_validate(WHITE)
    both = Pointing(path=path.path, jitter_m=noise)
    times, values = noise.record(0)
    for period in (0, 2):  # it repeats
        sample = times[100:110] + period * 4.0
        want = values[100:110] + at(path, None, sample)[:, 0]
        assert np.allclose(at(both, None, sample)[:, 0], want, atol=1e-12)
    # In other units
    want = at(both, noise, [0.3])[0] / [0.5, 0.5, 1.0, 1.0, 1.0]
    assert np.allclose(at(both, noise, [0.3 / 0.01], length=0.5, time=0.01)[0], want, rtol=1e-9)


def test_between_its_points_a_record_is_what_the_cosines_are():
    noise = Noise(rms=1.0, cutoff_Hz=20.0, seed=1, record_s=2.0)
    lines = np.arange(1, 41)
    phases = np.random.default_rng([1, 0]).uniform(0.0, 2.0 * np.pi, 40)
    t = np.random.default_rng(2).uniform(0.0, 2.0, 200)
    want = np.sqrt(2.0 / 40.0) * np.cos(np.pi * np.outer(t, lines) + phases).sum(axis=1)
    assert np.abs(at(Pointing(jitter_m=noise), None, t)[:, 0] - want).max() < 3e-4


def test_knots_are_where_the_pieces_meet():
    noise, end = Noise.model_validate(WHITE), 6.0
    found = pointing.knots(Pointing(path=[[0.0, 0.0, 0.0], [1.0, 0.1, 0.0]], jitter_m=noise), None, end)
    times = noise.record(0)[0]
    assert 1.0 in found
    assert np.all((found > 0.0) & (found < end))
    assert np.isin(np.round(times[1:-1], 9), np.round(found, 9)).all()
    assert pointing.knots(Pointing(), None, end).size == 0


def test_the_frame_of_a_tilted_beam_is_a_rotation_that_takes_its_axis_to_z():
    now, frame = np.array([0.02, -0.01, np.radians(3.0), np.radians(-5.0), 0.0]), np.empty((3, 3))
    aim.axes(now, frame)
    assert np.allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    along = np.array([np.tan(now[2]), np.tan(now[3]), 1.0])
    assert np.allclose(frame @ along, [0.0, 0.0, np.linalg.norm(along)], atol=1e-15)
    wander = pointing.wander(Pointing(path=[[0, 0.02, -0.01, 3.0, -5.0], [1, 0.02, -0.01, 3.0, -5.0]]), None)
    x = np.array([[0.02, -0.01, 0.0], [0.02 + 4 * along[0], -0.01 + 4 * along[1], 4.0]]).T.copy()
    aim.aim(wander, 0.5, x)
    assert np.allclose(x[:2], 0.0, atol=1e-15)


def test_a_steady_beam_holds_nothing():
    wander = pointing.wander(Pointing(), None)
    assert wander.times.size == wander.pieces.size == wander.periods.size == 0
    assert aim.brightness(wander, 1.0) == 1.0


def test_a_path_comes_from_a_file_and_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    Path("path.csv").write_text("t_s,x_m,y_m\n0,0,0\n1,0.1,0.2\n", encoding="utf-8")
    found = Pointing(path_file="path.csv")
    assert found.path == [[0.0, 0.0, 0.0], [1.0, 0.1, 0.2]]
    Path("path.csv").unlink()
    assert Pointing.model_validate(found.model_dump()) == found


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"jitter_m": {"rms": 1.0, "seed": 1}}, "give either rms and cutoff_Hz (white), or spectrum"),
        ({"jitter_m": {"rms": 1.0, "cutoff_Hz": 1.0, "spectrum": [[1, 1], [2, 1]], "seed": 1}}, "give either rms and"),
        (
            {"jitter_m": {"rms": 1.0, "cutoff_Hz": 1e6, "seed": 1}},
            "record_s = 10: a record of frequencies up to 1e+06 Hz",
        ),
        ({"jitter_m": {"rms": 1.0, "cutoff_Hz": 0.01, "seed": 1}}, "must be at least a period"),
        ({"jitter_m": {"spectrum": [[2, 1], [1, 1]], "seed": 1}}, "frequencies must ascend"),
        ({"path": [[0, 0, 0], [0, 1, 0]]}, "times must ascend"),
        ({"path": [[0, 0, 0], [1, 1, 0, 0, 0]]}, "every row must be of 3 numbers, or every one of 5"),
        ({"path": [[0, 0, 0, 0, 0], [1, 1, 0, 80, 0]]}, "tilts must be from -30 to 30 degrees"),
        ({"path_file": "/etc/passwd"}, "must be a path below this folder"),
        ({"path_file": "none.csv"}, "cannot be read"),
    ],
)
def test_wrong_pointing_is_refused_in_one_line(keys: dict[str, Any], said: str):
    data = FIG6.model_dump()
    with pytest.raises(InputError) as refusal:
        validate({**data, "beam": {**data["beam"], "pointing": keys}}, Scene, "own.yaml")
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
