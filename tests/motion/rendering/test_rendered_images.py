"""Rendered pictures agree with the calibration, the figure and the furniture."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.motion.geometry import project
from poseppl.motion.rendering import Setting, Stage
from poseppl.motion.rendering.figure import JOINTS
from poseppl.motion.rendering.room import CLEARANCE
from poseppl.motion.tracking.placing import cameras_of_records

pytestmark = pytest.mark.full

Build = Callable[..., Setting]


@pytest.mark.parametrize("size", [(640, 480), (320, 400)])
def test_the_calibration_is_the_renderers(drawable: Build, size: tuple[int, int]) -> None:
    """The mean of the pixels of a ball, 30 mm and at least a pixel in radius, is where its centre is projected to."""
    setting = drawable(size=size)
    joints = np.stack([setting.figure.points[joint][1] for joint in JOINTS])
    corners = np.array([[x, y, 40.0] for x in (-2000, 0, 2000) for y in (-2000, 2000)]) + [*setting.room.centre, 0]
    places = np.concatenate([joints, corners])
    expected = np.asarray(project(cameras_of_records(setting.cameras), jnp.asarray(places)))
    with Stage(setting, beads=1) as stage:
        for camera in range(4):
            errors = []
            for place, (x, y) in zip(places, expected[camera], strict=True):
                if not (10 < x < size[0] - 11 and 10 < y < size[1] - 11):
                    continue
                rows, columns = np.nonzero(stage.beads(camera, [place]) == 0)
                errors.append([columns.mean() - x, rows.mean() - y])
            offsets = np.abs(errors)
            assert len(errors) >= 17
            assert offsets.max() < 0.5  # as was asked for; 0.4 is seen where a ball has 4 pixels
            # half a pixel off, the other convention of where an image begins, would show in the mean
            assert np.abs(np.mean(errors, axis=0)).max() < 0.1


def test_masks_are_where_the_joints_are(drawable: Build) -> None:
    setting = drawable(clutter=False)
    cameras = cameras_of_records(setting.cameras)
    inner = ("pelvis", "chest", "skull", "knee_l", "knee_r", "elbow_l", "elbow_r", "hip_l", "hip_r")
    with Stage(setting) as stage:
        for frame in range(setting.num_frames):
            stage.pose(frame)
            points = np.stack([setting.figure.points[joint][frame] for joint in inner])
            for camera, places in enumerate(np.rint(np.asarray(project(cameras, jnp.asarray(points)))).astype(int)):
                mask = stage.visible(camera)
                assert np.mean(mask[places[:, 1], places[:, 0]]) >= 8 / 9  # a joint's pixel may fall beside a thin arm
                assert 60 < mask.sum() < 600  # a person of 1.75 m is some 25 pixels tall at 96 x 72
                rows, columns = np.nonzero(mask)
                assert rows.min() > 0 and rows.max() < 71 and columns.min() > 0 and columns.max() < 95


def test_the_person_is_what_changes_a_picture(drawable: Build) -> None:
    with Stage(drawable(clutter=False)) as stage:
        for camera in range(4):
            change = np.abs(stage.picture(camera).astype(int) - stage.picture(camera, person=False)).max(-1)
            mask = stage.visible(camera)
            assert np.mean(change[mask] > 10) > 0.9  # some clothes look like the wall
            assert np.mean(change[~mask] > 10) < 0.1  # edges and the shadow


def test_pixels_are_hidden_only_by_furniture(drawable: Build) -> None:
    hidden = {}
    for clutter in (True, False):
        setting = drawable(clutter=clutter)
        assert bool(setting.furniture) == clutter
        with Stage(setting) as stage:
            hidden[clutter] = 0
            for frame in range(setting.num_frames):
                stage.pose(frame)
                for camera in range(4):
                    visible, whole, occluder = (draw(camera) for draw in (stage.visible, stage.whole, stage.occluder))
                    assert not (visible & ~whole).any()
                    assert not (whole & ~visible & (occluder == 0)).any()
                    hidden[clutter] += int((whole & ~visible).sum())
                    assert occluder.any() == clutter
    assert hidden[True] > 20 and hidden[False] == 0


def test_furniture_keeps_clear_of_the_person(walker: Build) -> None:
    layouts = []
    for seed in range(5):
        setting = walker(seed=seed)
        route = np.stack(list(setting.figure.points.values()), 1)[..., :2].reshape(-1, 2)
        kinds = [piece.kind for piece in setting.furniture]
        assert kinds.count("table") == 1 and kinds.count("chair") >= 3
        for piece in setting.furniture:
            nearest = np.linalg.norm(route - [piece.x, piece.y], axis=-1).min()
            assert nearest >= CLEARANCE + (400 if piece.kind == "table" else 225)  # at least the clearance and the half depth
        layouts.append(setting.furniture)
    assert len(set(layouts)) == 5 and layouts[0] == walker(seed=0).furniture
