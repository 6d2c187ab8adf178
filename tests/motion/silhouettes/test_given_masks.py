"""Silhouettes whose masks are given instead of a background."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")

import cv2
from silhouette_rooms import RECORDS, SIZE, body, masks_of, pose

from poseppl.errors import InputError
from poseppl.motion.io import VideoWarning, open_video, write_cameras
from poseppl.motion.silhouettes.scene import silhouette_scene
from poseppl.motion.silhouettes.video_sources import VideoSources, see_silhouettes, sources_of_scene

FRAMES = 3
MASKS = [masks_of(pose(seed)) for seed in range(FRAMES)]
"""Masks of every frame, by the cameras' names."""


def sources(masks):
    """Videos that show nothing but noise, with these masks (T, H, W) of each camera."""
    noise = np.random.default_rng(0).integers(20, 40, (FRAMES, SIZE[1], SIZE[0]), np.uint8)
    given = {name: open_video(255 * np.asarray(values, np.uint8), f"{name} (masks)") for name, values in masks.items()}
    return VideoSources(RECORDS, tuple(open_video(noise, record.name, rate=30.0) for record in RECORDS), {}, {}, given)


def truth():
    return {record.name: np.stack([masks[record.name] for masks in MASKS]) for record in RECORDS}


def test_given_masks_are_the_silhouettes():
    seen, wanted = see_silhouettes(sources(truth())), silhouette_scene(body(), RECORDS, truth())
    for name in ("contour", "on_outline", "distance", "usable"):
        np.testing.assert_allclose(getattr(seen.data, name), getattr(wanted.data, name), atol=1e-5)
    assert seen.rate == 30.0


def test_masks_of_half_the_size_are_nearly_the_same():
    half = {name: [cv2.resize(mask, None, fx=0.5, fy=0.5) for mask in masks] for name, masks in truth().items()}
    seen, wanted = see_silhouettes(sources(half)), silhouette_scene(body(), RECORDS, truth())
    off = np.abs(seen.data.distance - wanted.data.distance)
    assert off.mean() < 0.2 and np.abs(wanted.data.distance).mean() > 10.0  # px
    other = see_silhouettes(sources(dict(zip(truth(), list(half.values())[::-1], strict=True))))
    # masks of the wrong cameras: 0.7 px, as both show one person in the middle and maps are cut at 30 px
    assert np.abs(other.data.distance - wanted.data.distance).mean() > 0.5


def test_masks_that_do_not_fit_are_reported():
    square = {"left": np.ones((FRAMES, 90, 90))}
    with pytest.raises(InputError, match="camera left: the mask has 90 x 90 pixels.*240 x 180"):
        see_silhouettes(sources(truth() | square))


@pytest.mark.full
@pytest.mark.parametrize("name", ["../left", "a/b"])
def test_a_scene_names_no_file_outside_of_its_folder(tmp_path, name):
    write_cameras(tmp_path / "Calib.toml", [RECORDS[0]._replace(name=name)])
    with pytest.raises(InputError, match="Calib.toml: a camera called"):
        sources_of_scene(tmp_path)


@pytest.mark.full
def test_fewer_masks_than_frames_end_the_run_or_stop_it():
    short = truth() | {"right": truth()["right"][:2]}
    with pytest.warns(VideoWarning, match=r"right \(masks\).*2 frames, 3 are wanted"):
        assert len(see_silhouettes(sources(short)).frames) == 2
    with pytest.raises(InputError, match=r"right \(masks\).*2 frames"):
        see_silhouettes(sources(short), on_failure="stop")
