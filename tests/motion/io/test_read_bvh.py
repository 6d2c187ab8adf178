from __future__ import annotations

import numpy as np
import pybvh
import pytest
from recording_samples import BVH
from scipy.spatial.transform import Rotation

from poseppl.errors import InputError
from poseppl.motion.io.asf import read_asf
from poseppl.motion.io.bvh import read_bvh
from poseppl.motion.io.motion import z_up
from poseppl.motion.io.recording import read_motion

UNIT = 25.4 / 0.45


def read(tmp_path, text=BVH, **options):
    (tmp_path / "leg.bvh").write_text(text)
    return read_bvh(tmp_path / "leg.bvh", **options)


def test_kinematics_by_hand(tmp_path):
    motion = read(tmp_path, scale=10.0, up="y")
    assert motion.names == ("Hips", "Knee", "Knee_end") and motion.parents == (-1, 0, 1)
    assert motion.rate == 100.0
    # Channels Z, Y, X apply as R = Rz Ry Rx.
    hip, knee = (Rotation.from_euler("ZYX", degrees, degrees=True) for degrees in ([10, 20, 30], [1, 2, 4]))
    points = [np.array([1.0, 100.0, 0.0])]
    points.append(points[0] + hip.apply([2.0, -80.0, 0.0]))
    points.append(points[1] + (hip * knee).apply([0.0, -80.0, 0.0]))
    expected = 10.0 * np.stack(points)[:, [0, 2, 1]] * (1, -1, 1)
    np.testing.assert_allclose(motion.positions[1], expected, rtol=1e-9)


@pytest.mark.parametrize(("factor", "unit"), [(1.0, 10.0), (10.0, 1.0), (0.01, 1000.0), (0.4, 25.4)])
def test_scale_is_guessed_from_the_height(tmp_path, factor, unit):
    # The leg is 160 units long, so centimetres make it 1.6 m.
    text = BVH.replace("-80.0", str(-80.0 * factor))
    motion = read(tmp_path, text, up="y")
    assert f"1 unit is taken as {unit:.4g} mm" in motion.notes[1]


def test_upper_case_suffix_and_carriage_returns(tmp_path):
    (tmp_path / "LEG.BVH").write_bytes(BVH.replace("\n", "\r\n").encode())
    assert read_motion(tmp_path / "LEG.BVH").positions.shape == (2, 3, 3)


def test_recorded_walk(data_dir):
    motion = read_motion(data_dir / "pybvh" / "cmu_12_01_walk.bvh")
    assert motion.positions.shape == (524, 38, 3) and motion.rate == 120.0
    # The unit of the CMU skeletons: the recording is small, but its arm is as long as in an ASF skeleton of the database.
    assert "56.44 mm" in motion.notes[1]
    height = np.ptp(motion.positions[..., 2], axis=1)
    assert 1300 < height.mean() < 1450
    assert abs(motion.positions[..., 2].min()) < 30
    arm = motion.positions[:, motion.index("LeftForeArm")] - motion.positions[:, motion.index("LeftArm")]
    asf = {bone.name: bone.length for bone in read_asf(data_dir / "cmu_amc" / "02.asf").bones}
    np.testing.assert_allclose(np.linalg.norm(arm, axis=-1).mean(), asf["lhumerus"], rtol=0.25)  # of another person
    lengths = np.linalg.norm(motion.positions[:, 1:] - motion.positions[:, np.asarray(motion.parents)[1:]], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(lengths[0], lengths.shape), atol=1e-6)


def test_makehuman_is_z_up_in_decimetres(data_dir):
    motion = read_motion(data_dir / "makehuman" / "walk1.bvh")
    assert "taken as 100 mm" in motion.notes[1] and motion.rate == 24.0
    assert 1400 < np.ptp(motion.positions[0, :, 2]) < 1800


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1 2 4", "1 2 nan", "line 20, Knee Xrotation: 'nan' is not a number"),
        ("1 2 4", "1 2 inf", "line 20, Knee Xrotation: 'inf' is not a number"),
        ("1 2 4", "1 2", "line 20: 8 values (expected 9"),
        ("OFFSET 2.0", "OFFSET nan", "line 8, OFFSET: 'nan'"),
        ("OFFSET 2.0", "OFFSET 2 2.0", "line 8, OFFSET: 4 values"),
        ("Frames: 2", "Frames: 3", "2 frames; is the file truncated? (expected 3"),
        ("Frames: 2", "Frames: 1e9", "line 17, Frames:"),
        ("Frame Time: 0.01", "Frame Time: 0", "line 18, Frame Time:"),
        ("Frame Time: 0.01", "Frame Time: -0.01", "line 18, Frame Time:"),
        (BVH[BVH.index("MOTION") :], "", "no MOTION"),
        ("MOTION", "MOVING", "line 16: 'MOVING' is no part of a hierarchy"),
        ("HIERARCHY", "TREE", "no HIERARCHY"),
        ("JOINT Knee", "JOINT Hips", "a joint without one name of its own"),
        ("CHANNELS 3 Z", "CHANNELS 4 Z", "the count differs"),
        ("CHANNELS 3 Zrotation", "CHANNELS 3 Wrotation", "line 9, CHANNELS: rotation channels W, X, Y of 'Knee'"),
        ("}\nMOTION", "MOTION", "not closed"),
    ],
)
def test_bad_bvh(tmp_path, old, new, message):
    assert old in BVH
    with pytest.raises(InputError) as caught:
        read(tmp_path, BVH.replace(old, new, 1))
    assert message in str(caught.value) and "leg.bvh" in str(caught.value)


def test_options_are_checked(tmp_path):
    with pytest.raises(InputError, match="scale"):
        read(tmp_path, scale=-1.0)
    with pytest.raises(InputError, match="no height"):
        read(tmp_path, BVH.replace("-80.0", "0"), up="y")


@pytest.mark.parametrize("name", ["pybvh/cmu_12_01_walk.bvh", "makehuman/walk1.bvh", "makehuman/dance1.bvh"])
def test_pybvh_reads_the_same(data_dir, name):
    motion, clip = (
        read_bvh(data_dir / name, scale=1.0),
        pybvh.read_bvh_file(data_dir / name, warn_on_world_up_disagreement=False),
    )
    expected = z_up(clip.node_positions(), clip.world_up[-1])
    np.testing.assert_allclose(motion.positions, expected, atol=1e-9)
    assert motion.rate == pytest.approx(clip.fps)


def with_positions(text, moved=""):
    """The recording with position channels on every joint, all at their offsets, one joint sliding along x by 0.5 a frame."""
    head, motion = text.split("MOTION\n")
    places, lines = [], head.split("\n")
    for number, line in enumerate(lines):
        words = line.split()
        if words[:1] == ["JOINT"]:
            name = words[1]
        if words[:1] == ["OFFSET"]:
            offset, at = words[1:], number
        if words[:2] == ["CHANNELS", "3"]:
            lines[number] = f"CHANNELS 6 Xposition Yposition Zposition {' '.join(words[2:])}"
            lines[at] = "OFFSET 0 0 0"  # what the channels say counts
            places.append((name, [float(value) for value in offset]))
    count, time, *rows = motion.strip().split("\n")
    written = []
    for frame, row in enumerate(rows):
        values = row.split()
        new = values[:6]
        for joint, (name, (x, y, z)) in enumerate(places):
            new += [repr(x + 0.5 * frame * (name == moved)), repr(y), repr(z), *values[6 + 3 * joint : 9 + 3 * joint]]
        written.append(" ".join(new))
    return "\n".join(lines) + "MOTION\n" + "\n".join([count, time, *written]) + "\n"


def test_positions_on_every_joint(tmp_path, data_dir):
    text = (data_dir / "pybvh" / "cmu_12_01_walk.bvh").read_text()
    plain, full = read(tmp_path, text), read(tmp_path, with_positions(text))
    assert full.names == plain.names and "56.44 mm" in full.notes[1]
    np.testing.assert_allclose(full.positions, plain.positions, atol=1e-3)


def test_a_joint_that_slides_takes_its_children_along(tmp_path):
    still = read(tmp_path, with_positions(BVH), scale=10.0, up="y")
    moved = read(tmp_path, with_positions(BVH, "Knee"), scale=10.0, up="y")
    turn = Rotation.from_euler("ZYX", [10, 20, 30], degrees=True)
    step = 10.0 * turn.apply([0.5, 0, 0])[[0, 2, 1]] * (1, -1, 1)
    np.testing.assert_allclose(moved.positions[1] - still.positions[1], [np.zeros(3), step, step], atol=1e-9)
    np.testing.assert_allclose(moved.positions[0], still.positions[0], atol=1e-9)
    np.testing.assert_allclose(still.positions, read(tmp_path, scale=10.0, up="y").positions, atol=1e-9)


def test_some_position_channels_are_refused(tmp_path):
    text = BVH.replace("CHANNELS 3 Z", "CHANNELS 4 Xposition Z").replace("30 1 2", "30 0 1 2")
    with pytest.raises(InputError, match="line 9, CHANNELS: position channels X of 'Knee' .expected X, Y and Z, or none"):
        read(tmp_path, text)
