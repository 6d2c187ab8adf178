"""The points that the figure is hung on, its frames, and the room around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import read_motion, slice_frames
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.rendering import Setting, build_setting, find_toes
from poseppl.motion.rendering.figure import JOINTS, SEGMENTS, SOLE, dress_figure, figure_points, figure_pose
from poseppl.motion.rendering.room import corner_cameras, room_around

Build = Callable[..., Setting]


def test_segments_run_from_point_to_point(walker: Build) -> None:
    figure = walker().figure
    for frame in range(3):
        places, quaternions = figure_pose(figure, frame)
        np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1, rtol=1e-12)
        for (w, x, y, z), place, segment in zip(quaternions, places, SEGMENTS, strict=True):
            start, end = figure.points[segment.start][frame], figure.points[segment.end][frame]
            np.testing.assert_allclose(1000 * place, start, atol=1e-9)
            along = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
            np.testing.assert_allclose(along, (end - start) / np.linalg.norm(end - start), atol=1e-9)


def test_feet_point_forward_and_stand_on_the_floor(walker: Build) -> None:
    setting = walker()
    points = setting.figure.points
    going = points["pelvis"][-1] - points["pelvis"][0]
    for side in "lr":
        foot = points[f"toe_{side}"] - points[f"heel_{side}"]
        assert np.all(foot @ going > 0)
        assert np.all(np.linalg.norm(foot, axis=-1) > 150)
    lowest = min(points[f"{end}_{side}"][:, 2].min() for end in ("toe", "heel") for side in "lr")
    assert lowest - setting.room.floor == pytest.approx(SOLE * setting.figure.scale)


def test_fingers_go_on_from_the_forearm(walker: Build) -> None:
    points = walker().figure.points
    for side in "lr":
        forearm, hand = points[f"wrist_{side}"] - points[f"elbow_{side}"], points[f"finger_{side}"] - points[f"wrist_{side}"]
        cosine = (forearm * hand).sum(-1) / np.linalg.norm(forearm, axis=-1) / np.linalg.norm(hand, axis=-1)
        np.testing.assert_allclose(cosine, 1.0, atol=1e-9)


def test_a_build_is_symmetric_and_has_a_seed(walker: Build) -> None:
    points = walker().figure.points
    one, other = dress_figure(points, 1), dress_figure(points, 2)
    assert not np.allclose(one.thickness, other.thickness)
    assert np.array_equal(one.thickness, dress_figure(points, 1).thickness)
    factors = iter(one.thickness)
    by_segment = {segment.start + segment.end: [next(factors) for _ in segment.shapes] for segment in SEGMENTS}
    for name, thickness in by_segment.items():
        if "_l" in name and "_r" not in name:
            assert thickness == by_segment[name.replace("_l", "_r")]


def test_what_cannot_be_rendered_is_reported(walker: Build) -> None:
    points = walker().figure.points
    places = np.stack([points[joint] for joint in JOINTS], axis=1)
    with pytest.raises(InputError, match="no crown"):
        figure_points([name for name in JOINTS if name != "crown"], np.delete(places, JOINTS.index("crown"), axis=1))
    places[2, JOINTS.index("knee_r")] = np.nan
    with pytest.raises(InputError, match="knee_r is unknown in frame 2"):
        figure_points(JOINTS, places)
    room = room_around(np.zeros((1, 2)), 0.0)
    bad = ((5, (96, 72), None, "cameras"), (4, (97, 72), None, "size"), (4, (96, 72), 1.0, "focal"))
    for count, size, focal, field in bad:
        with pytest.raises(InputError, match=field):
            corner_cameras(room, count, size, focal)


@pytest.mark.full
def test_a_long_walk_has_a_longer_room() -> None:
    room = room_around(np.array([[0.0, 0.0], [9000.0, 1000.0]]), 0.0)
    assert room.size.tolist() == [11400.0, 6000.0] and room.centre.tolist() == [4500.0, 500.0]
    assert room_around(np.array([[0.0, 0.0], [0.0, 1000.0]]), 0.0).size.tolist() == [6000.0, 7000.0]


@pytest.mark.full
def test_recordings_bring_their_toes(data_dir: Path) -> None:
    folder = data_dir / "cmu_amc"
    amc, asf = folder / "02_01.amc", folder / "02.asf"
    motion = slice_frames(read_motion(amc, asf), "0:300:100")
    toes = find_toes(motion)
    assert np.array_equal(toes["toe_l"], motion.positions[:, motion.index("ltoes")])
    missing = motion.positions.copy()
    missing[1, motion.index("rtoes")] = np.nan
    assert set(find_toes(replace(motion, positions=missing))) == {"toe_l"}
    subject = recorded_subject(amc, asf, frames="0:300:100")
    setting = build_setting(subject.body.tree.marker_names, subject.markers, toes=toes)
    assert np.array_equal(setting.figure.points["toe_l"], toes["toe_l"])
    assert 0.9 < setting.figure.scale < 1.1
