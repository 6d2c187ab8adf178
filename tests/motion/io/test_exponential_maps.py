from __future__ import annotations

import numpy as np
import pytest
from recording_samples import EXPONENTIAL_MAPS, EXPONENTIAL_SKELETON

from poseppl.errors import InputError
from poseppl.motion.io.json_skeletons import UNIT_MM
from poseppl.motion.io.recording import read_motion


def read(tmp_path, maps=EXPONENTIAL_MAPS, skeleton=EXPONENTIAL_SKELETON, **options):
    (tmp_path / "walk.txt").write_text(maps)
    (tmp_path / "skeleton.json").write_text(skeleton)
    return read_motion(tmp_path / "walk.txt", tmp_path / "skeleton.json", **options)


def test_by_hand(tmp_path):
    motion = read(tmp_path, rate=60.0)
    assert (motion.names, motion.parents, motion.rate) == (("joint_0", "joint_1", "joint_2"), (-1, 0, 1), 60.0)
    # the matrices act on rows: a quarter turn about z takes (0, -8, 0) to (-8, 0, 0), one about y takes (1, 0, 0) to (0, 0, 1)
    y_up = np.array([[[0, 16, 0], [1, 16, 0], [-7, 16, 0]], [[1, 16, 0], [1, 16, 1], [1, 8, 1]]])
    np.testing.assert_allclose(motion.positions, UNIT_MM * y_up[..., [0, 2, 1]] * (1, -1, 1), atol=1e-4)


@pytest.mark.parametrize(
    ("maps", "skeleton", "message"),
    [
        (EXPONENTIAL_MAPS[:-4], EXPONENTIAL_SKELETON, "line 2: 11 values .expected 12"),
        (EXPONENTIAL_MAPS.replace("16", "nan"), EXPONENTIAL_SKELETON, "line 1, translation y: 'nan' is not a number"),
        ("0", EXPONENTIAL_SKELETON, "line 1: 1 values .expected 12"),
        (EXPONENTIAL_MAPS, "[1, 2]", "skeleton.json: no skeleton"),
        (EXPONENTIAL_MAPS, EXPONENTIAL_SKELETON.replace("0, 1]", "2, 1]"), "parent: the parent of joint 1 is 2"),
        (EXPONENTIAL_MAPS, EXPONENTIAL_SKELETON.replace("[0, -8, 0]", "[0, 0]"), "skeleton.json: no skeleton"),
        (EXPONENTIAL_MAPS, EXPONENTIAL_SKELETON.replace("-8", "1e300"), "offset: a number that is not finite, or too large"),
    ],
)
def test_malformed_files_are_refused(tmp_path, maps, skeleton, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, maps, skeleton)


def test_maps_want_a_skeleton(tmp_path):
    (tmp_path / "walk.txt").write_text(EXPONENTIAL_MAPS)
    with pytest.raises(InputError, match="exponential maps need their skeleton .expected skeleton='skeleton.json'"):
        read_motion(tmp_path / "walk.txt")


def test_recorded_walk_stands_on_the_ground(data_dir):
    folder = data_dir / "cmu_expmap"
    motion = read_motion(folder / "train_walking" / "walking_1.txt", folder / "skeleton.json")
    assert motion.positions.shape == (344, 38, 3) and motion.rate == 120.0
    feet = motion.positions[:, [motion.index(f"{side}ToeBase") for side in ("Left", "Right")]]
    slowest = np.linalg.norm(np.diff(feet, axis=0), axis=-1).min(axis=1)
    assert slowest.mean() < 4  # mm a frame; turned the other way it is 16
    assert motion.positions[:, motion.index("Head_end"), 2].mean() - feet[..., 2].min() > 1300
