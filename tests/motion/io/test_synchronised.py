from __future__ import annotations

import warnings

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import VideoWarning, open_video, synchronised


def video(camera, count, rate=None, level=0):
    return open_video(np.full((count, 20, 30), level, np.uint8), camera, rate=rate)


def test_frames_of_all_cameras_together():
    cameras = [open_video(np.arange(5, dtype=np.uint8)[:, None, None].repeat(20, 1).repeat(30, 2), name) for name in "ab"]
    frames = list(synchronised(cameras, start=1, stop=4))
    assert [frame for frame, _ in frames] == [1, 2, 3]
    for frame, images in frames:
        assert list(images) == ["a", "b"] and all(np.all(image == frame) for image in images.values())


@pytest.mark.parametrize("unknown", [False, True])
def test_lengths_that_differ(unknown):
    cameras = [video("left", 5), video("right", 3)]
    if unknown:  # a container without a count: the end is met while reading
        cameras = [camera._replace(num_frames=None) for camera in cameras]
    with pytest.raises(InputError, match="camera right: the video (has 3 frames, 5 are wanted|ends before frame 3)"):
        list(synchronised(cameras))
    with pytest.warns(VideoWarning, match="camera right"):
        assert len(list(synchronised(cameras, mismatch="shortest"))) == 3
    assert len(list(synchronised(cameras, stop=3))) == 3


def test_rates_that_differ():
    with pytest.raises(InputError, match="camera right: 25 frames a second, but 30 in camera left"):
        list(synchronised([video("left", 3, 30), video("right", 3, 25)]))
    with pytest.warns(VideoWarning, match="paired by number"):
        assert len(list(synchronised([video("left", 3, 30), video("right", 3, 25)], mismatch="shortest"))) == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(list(synchronised([video("left", 3, 30), video("right", 3, 29.999), video("top", 3)]))) == 3


def test_cameras_without_names_of_their_own():
    with pytest.raises(InputError, match="two videos of the camera 'left'"):
        list(synchronised([video("left", 2), video("left", 2)]))
    with pytest.raises(InputError, match="no camera"):
        list(synchronised([]))


def test_recorded_cameras(data_dir):
    folder = data_dir / "pose2sim_balancing" / "videos"
    cameras = [open_video(folder / f"cam0{number}.mp4", f"cam0{number}") for number in (1, 4)]
    (frame, images), *rest = synchronised(cameras, start=2, stop=4)
    assert frame == 2 and len(rest) == 1
    assert images["cam01"].shape == (1920, 1080, 3) and images["cam04"].shape == (1920, 1088, 3)
