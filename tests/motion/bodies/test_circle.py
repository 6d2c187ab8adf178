"""Walks along circles: rigid moves of frames, arc length, and what cannot be laid along one."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.geometry import Joint, Marker, kinematic_tree
from poseppl.motion.io import read_motion, slice_frames
from poseppl.motion.recordings.subjects import bend_along_circle, bend_motion, recorded_subject, turned, walking_subject

RATE, SPEED = 100.0, 1300.0


def straight(ahead=(0.6, 0.8), seconds=3.0, side=0.0):
    """Places (T, 3) of a pelvis that goes straight on, some way to the side of where it began."""
    times = np.arange(round(seconds * RATE)) / RATE
    ahead = np.array([*ahead, 0.0])
    across = np.array([-ahead[1], ahead[0], 0.0])
    sway = np.where(np.arange(len(times)) % 2, side, -side)
    return np.array([300.0, -200.0, 950.0]) + SPEED * times[:, None] * ahead + sway[:, None] * across


@pytest.fixture(scope="module")
def recorded(data_dir):
    return read_motion(data_dir / "cmu_walks" / "07_01.amc", data_dir / "cmu_walks" / "07.asf")


@pytest.mark.parametrize("radius", [1200.0, -700.0, 5000.0])
def test_a_straight_way_becomes_an_arc_of_the_same_length(radius):
    pelvis = straight()
    found = bend_along_circle(pelvis, RATE, radius)
    path = found.places(pelvis)
    np.testing.assert_allclose(path[0], pelvis[0], atol=1e-9)
    centre = pelvis[0, :2] + radius * np.array([-0.8, 0.6])  # to the left of the first step
    np.testing.assert_allclose(np.linalg.norm(path[:, :2] - centre, axis=-1), abs(radius), rtol=1e-12)
    way = np.linalg.norm(pelvis - pelvis[0], axis=-1)
    np.testing.assert_allclose(np.abs(radius * found.angles), way, atol=1e-9)
    chords = np.linalg.norm(np.diff(path, axis=0), axis=-1)
    step = SPEED / RATE
    np.testing.assert_allclose(chords, 2 * abs(radius) * np.sin(step / abs(radius) / 2), rtol=1e-9)
    np.testing.assert_array_equal(path[:, 2], pelvis[:, 2])
    assert np.all(np.sign(found.angles[1:]) == np.sign(radius))


def test_offsets_to_the_side_are_kept():
    path = bend_along_circle(straight(), RATE, 1200.0).places(straight(side=40.0))
    distances = np.linalg.norm(path[:, :2] - (straight()[0, :2] + 1200 * np.array([-0.8, 0.6])), axis=-1)
    np.testing.assert_allclose(distances[::2], 1240.0, rtol=1e-12)  # to the right, away from the middle
    np.testing.assert_allclose(distances[1::2], 1160.0, rtol=1e-12)


def test_poses_are_those_of_the_recording_up_to_the_turn(recorded):
    bent = turned(recorded, 1200.0)
    root = recorded.index("root")
    turn = bend_along_circle(recorded.positions[:, root], recorded.rate, 1200.0).angles
    before, after = (motion.positions - motion.positions[:, [root]] for motion in (recorded, bent))
    cosine, sine = np.cos(turn), np.sin(turn)
    turns = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
    np.testing.assert_allclose(after[..., :2], np.einsum("tij,tkj->tki", turns, before[..., :2]), atol=1e-9)
    np.testing.assert_array_equal(bent.positions[..., 2], recorded.positions[..., 2])
    assert turn[-1] == pytest.approx(3582 / 1200, abs=0.05)
    assert np.all(np.diff(turn) > 0)  # steps do not shake it


def test_a_circle_without_end_is_the_recording(recorded):
    np.testing.assert_allclose(turned(recorded, np.inf).positions, recorded.positions, atol=1e-9)
    np.testing.assert_allclose(turned(recorded, -1e12).positions, recorded.positions, atol=1e-4)


def test_frames_without_a_pelvis_are_moved_with_their_neighbours():
    pelvis = straight()
    gaps = pelvis.copy()
    gaps[[0, 40, 41, 299]] = np.nan
    whole, patched = (bend_along_circle(each, RATE, 900.0) for each in (pelvis, gaps))
    np.testing.assert_allclose(patched.angles[1:-1], whole.angles[1:-1], atol=0.02)


@pytest.mark.parametrize(
    ("pelvis", "radius", "words"),
    [
        (straight(), 299.0, "at least 300 mm"),
        (straight(), np.nan, "at least 300 mm"),
        (straight(seconds=0.2), 1200.0, "goes 247 mm ahead"),
        (straight(seconds=0.01), 1200.0, "goes 0 mm ahead"),
        (np.concatenate([straight(), straight()[::-1]]), 1200.0, "goes 0 mm ahead"),
        (np.full((5, 3), np.nan), 1200.0, "not known in any frame"),
    ],
)
def test_what_cannot_be_laid_along_a_circle(pelvis, radius, words):
    with pytest.raises(InputError, match=words) as error:
        bend_along_circle(pelvis, RATE, radius)
    assert "turn: " in str(error.value)


@pytest.mark.full
def test_the_built_in_walk_turns_with_its_states():
    plain, found = walking_subject(frames="0:40:3"), walking_subject(frames="0:40:3", turn=-800.0)
    np.testing.assert_allclose(found.body.places(found.states), found.markers, atol=0.01)
    np.testing.assert_array_equal(found.states[:, 4:], plain.states[:, 4:])
    assert found.states[-1, 3] - plain.states[-1, 3] < -1.5


@pytest.mark.full
def test_a_body_that_cannot_be_turned_is_reported():
    tree = kinematic_tree([Joint("trunk", None, (0, 0, 0), "XZ")], [Marker("top", "trunk", (0, 0, 500))])
    with pytest.raises(InputError, match=r"trunk\.X"):
        bend_along_circle(straight(), RATE, 900.0).states(tree, np.zeros((300, 5)))


@pytest.mark.full
def test_frames_between_the_chosen_ones_count_for_the_circle(data_dir):
    """A body fitted to a few frames of the circle has the recording's angles in its joints."""
    walk = (data_dir / "cmu_walks" / "07_01.amc", data_dir / "cmu_walks" / "07.asf")
    plain, found = (recorded_subject(*walk, frames="20:300:40", turn=radius) for radius in (None, 1200.0))
    assert found.frames.tolist() == plain.frames.tolist() == list(range(20, 300, 40))
    part = slice_frames(read_motion(*walk), "20:300")
    every = bend_motion(part, part.positions[:, part.index("root")], 1200.0)
    np.testing.assert_allclose(found.markers[:, 0], every.positions[::40, part.index("root")], atol=1e-9)
    assert found.residual == pytest.approx(plain.residual, abs=0.01)
    np.testing.assert_allclose(found.states[:, 8:], plain.states[:, 8:], atol=0.01)
