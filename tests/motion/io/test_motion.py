from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.files.frame_range import FrameRange
from poseppl.motion.io.motion import Motion, slice_frames, z_up
from poseppl.motion.io.recording import read_motion


def motion(frames=10):
    positions = np.arange(frames * 6, dtype=np.float64).reshape(frames, 2, 3)
    return Motion(("a", "b"), positions, (-1, 0), 100.0, "walk")


@pytest.mark.parametrize(("up", "expected"), [("x", [2, 3, 1]), ("y", [1, -3, 2]), ("z", [1, 2, 3])])
def test_z_up_is_a_rotation(up, expected):
    turned = z_up(np.eye(3), up)
    assert np.linalg.det(turned) == 1.0
    np.testing.assert_array_equal(turned["xyz".index(up)], [0, 0, 1])
    np.testing.assert_array_equal(z_up(np.array([1.0, 2.0, 3.0]), up), expected)


@pytest.mark.parametrize(
    ("frames", "expected"),
    [("2:8:2", [2, 4, 6]), (":3", [0, 1, 2]), ("8:", [8, 9]), ("::4", [0, 4, 8]), ("7", [7]), (FrameRange(1, 3), [1, 2])],
)
def test_frames(frames, expected):
    part = slice_frames(motion(), frames)
    np.testing.assert_array_equal(part.positions, motion().positions[expected])


def test_the_step_divides_the_rate():
    assert slice_frames(motion(), "::4").rate == 25.0


@pytest.mark.parametrize("frames", ["5:20", "10", "10:", "0:0", "5:2", "::0", "-3:", "a:b", "", "1:2:3:4", "0:9999999999"])
def test_bad_frames(frames):
    with pytest.raises(InputError, match="frames"):
        slice_frames(motion(), frames)


def test_out_of_range_tells_the_range():
    with pytest.raises(InputError, match=r"walk, frames: '5:20' is out of range \(expected a range within 0:10\)"):
        slice_frames(motion(), "5:20")


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="shape"):
        Motion(("a",), np.zeros((3, 2, 3)), (), 1.0, "")
    with pytest.raises(ValueError, match="parents"):
        Motion(("a",), np.zeros((3, 1, 3)), (-1, 0), 1.0, "")
    with pytest.raises(InputError, match="one of a, b"):
        motion().index("c")


def test_read_motion_names_what_it_needs(tmp_path):
    for name, options, message in (
        ("walk.amc", {}, "skeleton='FILE.asf'"),
        ("walk.amc", {"skeleton": tmp_path / "no.asf"}, "no.asf: no such file"),
        ("walk.amc", {"skeleton": "x.asf", "rate": -1.0}, "frames a second"),
        ("walk.bvh", {"skeleton": "x.asf"}, "takes no skeleton"),
        ("walk.bvh", {"up": "w"}, "no axis"),
        ("walk.bvh", {}, "no such file"),
        ("walk.c3d", {}, "no such file"),
        ("walk.fbx", {}, "unknown format '.fbx' .expected .amc or .bvh or .c3d"),
    ):
        with pytest.raises(InputError, match=message):
            read_motion(tmp_path / name, **options)
