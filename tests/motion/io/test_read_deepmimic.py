from __future__ import annotations

import json

import numpy as np
import pytest
from recording_samples import CHARACTER, CLIP

from poseppl.errors import InputError
from poseppl.motion.io.recording import read_motion


def read(tmp_path, clip=CLIP, character=CHARACTER):
    (tmp_path / "clip.txt").write_text(clip)
    (tmp_path / "character.txt").write_text(character)
    return read_motion(tmp_path / "clip.txt", tmp_path / "character.txt")


def test_forward_kinematics_by_hand(tmp_path):
    motion = read(tmp_path)
    assert motion.names == ("root", "hip", "knee", "ankle") and motion.rate == 2.0
    # # (x, y, z) of the file is our (x, -z, y)
    np.testing.assert_allclose(motion.positions[0], [[0, 0, 1000], [0, -100, 1000], [0, -100, 600], [0, -100, 100]], atol=1e-9)
    # the root turned a quarter about y takes z to x; the hip a quarter about z takes -y to x, which the root takes to -z
    expected = [[1000, 0, 1000], [1100, 0, 1000], [1100, 400, 1000], [1100, 400, 500]]
    np.testing.assert_allclose(motion.positions[1], expected, atol=1e-4)


def test_the_last_frame_has_no_duration(tmp_path):
    """Whatever stands there: the rate is that of the frames before it."""
    rows = json.loads(CLIP)["Frames"][:2]
    for durations, rate in (((0.5, 0.0), 2.0), ((0.25, 7.0), 4.0)):
        frames = [[duration, *row[1:]] for duration, row in zip(durations, rows, strict=True)]
        assert read(tmp_path, json.dumps({**json.loads(CLIP), "Frames": frames})).rate == rate


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("clip", "1, 0, 0, 0, 0]", "2, 0, 0, 0, 0]"), "quaternion of hip has length 2"),
        (("clip", "-1.57079633]", "-1.57079633, 0]"), "frame 1 is no row of 13 numbers"),
        (("clip", '"Frames"', '"Rows"'), "no frames"),
        (("clip", "[0.5, 0,", "[0, 0,"), "without duration"),
        (("clip", "[0.5, 0,", f"[0.5, {10**400},"), "not finite, or absurdly large"),
        (("clip", "{", "("), "malformed JSON"),
        (("character", '"Parent": 2', '"Parent": 7'), "parent of 'ankle' is 7"),
        (("character", '"revolute"', '"ball"'), "joint 'knee' is not supported"),
        (("character", '"AttachZ": 0.1', '"Attach": 0.1'), "not a joint"),
        (("character", '"Joints"', '"Bones"'), "no skeleton"),
    ],
)
def test_bad_files(tmp_path, change, message):
    which, old, new = change
    given = {"clip": CLIP, "character": CHARACTER}
    with pytest.raises(InputError, match=message):
        read(tmp_path, **{**given, which: given[which].replace(old, new, 1)})


def test_a_clip_needs_its_character(tmp_path):
    (tmp_path / "clip.txt").write_text(CLIP)
    with pytest.raises(InputError, match="needs its character"):
        read_motion(tmp_path / "clip.txt")
