"""The built-in walk is what the recording gives, and it walks."""

from __future__ import annotations

import json
from importlib.resources import files

import jax
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.gait import gait_table, walk

from poseppl.motion.bodies.gait_fit import fit_gait, from_table, to_table
from poseppl.motion.geometry import marker_positions
from poseppl.motion.io import read_motion


@pytest.fixture(scope="module")
def stride():
    """Two seconds at 100 Hz: coordinates and markers by name."""
    states, lengths = walk(rate=100.0, num_frames=200)
    body = full_body(lengths)
    markers = np.asarray(jax.vmap(lambda x: marker_positions(body.tree, x))(states.astype(np.float32)))
    return dict(zip(body.tree.coordinate_names, states.T, strict=True)), {
        name: markers[:, i] for i, name in enumerate(body.tree.marker_names)
    }


def test_speed_and_direction(stride):
    angles, markers = stride
    velocity = (markers["pelvis"][110] - markers["pelvis"][0]) / 1.10  # one cycle
    assert 1000 < velocity[0] < 1600 and abs(velocity[1]) < 50 and abs(velocity[2]) < 50
    assert np.all(np.abs(angles["spine.Z"] + np.pi / 2) < 0.3)  # the body's front, +Y at heading 0, looks along +X
    assert np.hypot(*markers["pelvis"][0, :2]) < 50


def test_period():
    table = json.loads(files("poseppl_models.bodies").joinpath("walk.json").read_text())
    assert 0.9 < table["period"] < 1.2
    period = table["period"]
    states = walk(rate=10 / period, num_frames=41).states
    np.testing.assert_allclose(states[10:, 2:], states[:-10, 2:], atol=1e-9)


def test_knees_elbows_and_feet(stride):
    angles, markers = stride
    for side in "lr":
        knee, elbow = angles[f"knee_{side}.X"], angles[f"elbow_{side}.X"]
        assert knee.max() < 0 and 0.9 < np.ptp(knee) < 1.3 and np.degrees(-knee.min()) == pytest.approx(70, abs=12)
        assert elbow.min() > 0
        ankle = markers[f"ankle_{side}"]
        assert 40 < ankle[:, 2].min() < 110 and ankle[:, 2].max() < 300
        speed = np.linalg.norm(np.diff(ankle, axis=0), axis=1) * 100
        assert np.mean(speed < 400) > 0.3  # stands for a good part of the cycle, and swings for another
        assert speed.max() > 2500
    hips = angles["hip_l.X"] - angles["hip_l.X"].mean(), angles["hip_r.X"] - angles["hip_r.X"].mean()
    assert np.corrcoef(*hips)[0, 1] < -0.8  # legs in turn
    arms = angles["shoulder_l.X"], angles["hip_l.X"]
    assert np.corrcoef(*arms)[0, 1] < -0.3  # an arm swings against its leg


@pytest.mark.full
def test_walk_is_the_recordings_fit(data_dir):
    motion = read_motion(data_dir / "cmu_amc" / "02_01.amc", data_dir / "cmu_amc" / "02.asf")
    table = json.loads(files("poseppl_models.bodies").joinpath("walk.json").read_text())
    found = gait_table(motion)
    assert found["lengths"] == pytest.approx(table["lengths"], abs=0.11)
    assert found["period"] == pytest.approx(table["period"], abs=1e-3)
    assert set(found["coefficients"]) == set(table["coefficients"])
    for name, row in table["coefficients"].items():
        assert found["coefficients"][name] == pytest.approx(row, abs=0.3 if ".t" in name else 3e-3), name


def test_fit_recovers_a_gait():
    """From its own states, at another heading and place; and the table rounds it by no more than it says."""
    rng = np.random.default_rng(0)
    states = walk(rate=100.0, num_frames=280).states
    turn = 1.2
    moved = states.copy()
    c, s = np.cos(turn), np.sin(turn)
    moved[:, :2] = states[:, :2] @ np.array([[c, s], [-s, c]]) + [500.0, -3000.0]
    moved[:, 3] += turn
    gait = fit_gait(moved + 1e-4 * rng.normal(size=moved.shape), 100.0)
    assert gait.period == pytest.approx(1.10304, abs=1e-3)
    found = gait.at(np.arange(280) / 100)
    np.testing.assert_allclose(found[:, 3:], states[:, 3:], atol=5e-3)
    np.testing.assert_allclose(np.diff(found[:, :3], axis=0), np.diff(states[:, :3], axis=0), atol=0.3)
    names = full_body().tree.coordinate_names
    again = from_table(json.loads(json.dumps(to_table(gait, names))), names)
    np.testing.assert_allclose(again.at([0.3, 0.9]), gait.at([0.3, 0.9]), atol=0.1)
    with pytest.raises(ValueError, match="expected"):
        from_table(to_table(gait, names), names[:-1])


@pytest.mark.parametrize(
    ("states", "rate", "harmonics", "message"),
    [
        (np.zeros((20, 28)), 100.0, 4, "too short"),
        (np.zeros((300, 28)), 100.0, 4, "does not move"),
        (np.full((300, 28), np.nan), 100.0, 4, "finite"),
        (np.zeros((300, 28)), 100.0, 0, "at least 1"),
    ],
)
def test_fit_refuses(states, rate, harmonics, message):
    with pytest.raises(ValueError, match=message):
        fit_gait(states, rate, harmonics)


@pytest.mark.full
@pytest.mark.parametrize(("rate", "frames"), [(0.0, 5), (-1.0, 5), (60.0, 0), (float("nan"), 5)])
def test_walk_refuses(rate, frames):
    with pytest.raises(ValueError, match="positive"):
        walk(rate, frames)
