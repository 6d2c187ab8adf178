"""Paths of people over frames, of groups and detections that are made up."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.motion.geometry import look_at
from poseppl.motion.io import DetectedPeople
from poseppl.motion.keypoints.people import LARGEST_JUMP, LARGEST_SPEED, FollowedPerson, Group, _best_path

RATE = 30.0


def groups(*places: float) -> list[Group]:
    """People at places along a line, all seen alike."""
    return [Group((number,), np.array([place, 0.0, 0.0]), 10.0) for number, place in enumerate(places)]


def test_a_path_stays_with_the_person_who_is_near() -> None:
    """Two people half a metre apart stand still, and are listed in turn: a step from one to the other costs support."""
    frames = [groups(0.0, 500.0) if t % 2 else groups(500.0, 0.0) for t in range(12)]
    path = _best_path(frames, RATE)
    assert list(path) == list(range(11, -1, -1))
    assert len({frames[t][i].place[0] for t, i in path.items()}) == 1


def test_a_path_bridges_a_second_and_follows_the_larger_support() -> None:
    """A person who is gone for 20 frames is the same one; nobody walks 4 m between two frames."""
    frames = [groups(0.0) if t < 10 or t >= 30 else [] for t in range(40)]
    assert len(_best_path(frames, RATE)) == 20
    far = [groups(0.0) if t < 10 else groups(4000.0) for t in range(40)]
    assert sorted(_best_path(far, RATE)) == list(range(10, 40))


@pytest.mark.parametrize(("steps", "found"), [(1, -1), (20, 0)])
def test_how_far_a_person_may_be_depends_on_the_time_since(steps: int, found: int) -> None:
    """In one camera, of pictures of 10 mm a pixel: after one frame too far away, after twenty not."""
    person = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 150.0], [0.0, 150.0]])
    reach = LARGEST_JUMP + LARGEST_SPEED * np.array([1, 20]) / RATE
    away = np.array([reach.mean() / 10.0, 0.0])
    names = ("a", "b", "c", "d")

    def seen(*points: np.ndarray) -> list[DetectedPeople]:
        table = np.stack(points)[:, None]
        return [DetectedPeople(table, np.where(np.isfinite(table[..., 0]), 1.0, 0.0), np.arange(len(points)), "", names)]

    nobody = np.full_like(person, np.nan)
    followed = FollowedPerson(look_at((0, 0, 0), (0, 1000, 0), 1000.0), seen(person), np.zeros((1, 1), int), RATE)
    assert followed.choose(seen(*[nobody] * (steps - 1), person + away)).ravel().tolist() == [-1] * (steps - 1) + [found]
