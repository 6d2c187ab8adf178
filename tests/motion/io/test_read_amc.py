from __future__ import annotations

import numpy as np
import pytest
from recording_samples import AMC, ASF
from scipy.spatial.transform import Rotation

from poseppl.errors import InputError
from poseppl.motion.io import amc
from poseppl.motion.io.amc import euler_rotation, read_amc
from poseppl.motion.io.asf import read_asf
from poseppl.motion.io.recording import read_motion

UNIT = 25.4 / 0.45


def read(tmp_path, asf=ASF, amc=AMC):
    (tmp_path / "leg.asf").write_text(asf)
    (tmp_path / "leg.amc").write_text(amc)
    return read_motion(tmp_path / "leg.amc", tmp_path / "leg.asf")


def test_skeleton(tmp_path):
    (tmp_path / "leg.asf").write_text(ASF)
    skeleton = read_asf(tmp_path / "leg.asf")
    assert [bone.name for bone in skeleton.bones] == ["root", "femur", "tibia", "foot"]
    assert [bone.parent for bone in skeleton.bones] == [-1, 0, 1, 2]
    femur = skeleton.bones[1]
    assert femur.length == pytest.approx(7.5 * UNIT, rel=1e-12)
    assert femur.dof == ("rx", "ry", "rz")


@pytest.mark.parametrize("order", ["XYZ", "ZYX", "YZX", "ZXY"])
def test_euler_rotation_turns_about_fixed_axes(order):
    angles = np.random.default_rng(0).uniform(-3, 3, (20, 3))
    about = {letter: Rotation.from_rotvec(angles * np.eye(3)[axis]).as_matrix() for axis, letter in enumerate("XYZ")}
    first, second, third = (about[letter] for letter in order)
    np.testing.assert_allclose(euler_rotation(angles, order).as_matrix(), third @ second @ first, atol=1e-14)


def test_kinematics_by_hand(tmp_path):
    # The same chain written out with scipy: p = p_parent + l R_parent C M C^-1 d, then (x, y, z) -> (x, -z, y).
    motion = read(tmp_path)

    def turn(x, y, z):
        return Rotation.from_euler("xyz", [x, y, z], degrees=True)

    root, femur_axis, tibia_axis = turn(10, 20, 30), turn(0, 0, 20), turn(10, 0, 20)
    femur = root * femur_axis * turn(5, -6, 7) * femur_axis.inv()
    tibia = femur * tibia_axis * turn(41, 0, 0) * tibia_axis.inv()
    hip = np.array([1.5, 2.0, 3.0]) * UNIT
    knee = hip + 7.5 * UNIT * femur.apply([0.6, -0.8, 0.0])
    ankle = knee + 7 * UNIT * tibia.apply([0.0, -1.0, 0.0])
    toe = ankle + 2 * UNIT * tibia.apply([0.0, 0.0, 1.0])
    expected = np.stack([hip, knee, ankle, toe])[:, [0, 2, 1]] * (1, -1, 1)
    np.testing.assert_allclose(motion.positions[1], expected, rtol=1e-10)
    assert motion.rate == 120.0


@pytest.mark.parametrize(("subject", "clip", "frames"), [("02", "02_01", 343), ("02", "02_03", 173), ("03", "03_01", 432)])
def test_recorded_walks(data_dir, subject, clip, frames):
    folder = data_dir / "cmu_amc"
    skeleton = read_asf(folder / f"{subject}.asf")
    motion = read_amc(folder / f"{clip}.amc", skeleton)
    assert motion.positions.shape == (frames, 31, 3)
    parents = np.asarray(motion.parents)
    lengths = np.linalg.norm(motion.positions[:, 1:] - motion.positions[:, parents[1:]], axis=-1)
    expected = np.broadcast_to([bone.length for bone in skeleton.bones[1:]], lengths.shape)
    np.testing.assert_allclose(lengths, expected, rtol=1e-10)
    by_name = {bone.name: bone.length for bone in skeleton.bones}
    for name in ("femur", "tibia", "humerus", "radius", "foot"):
        assert by_name["l" + name] == pytest.approx(by_name["r" + name], rel=0.05)


def looks_like_a_walk(motion):
    # The head bone ends inside the skull, some 10 cm below the crown; the toes touch the floor; of two ankles one stands still.
    height = motion.positions[..., 2]
    ankles = motion.positions[:, [motion.index("ltibia"), motion.index("rtibia")]]
    slower = np.linalg.norm(np.diff(ankles, axis=0), axis=-1).min(axis=1) * motion.rate
    return 1450 < np.ptp(height, axis=1).mean() < 1800 and abs(height.min()) < 30 and np.median(slower) < 180


def test_recorded_walk_is_a_walk(data_dir):
    folder = data_dir / "cmu_amc"
    motion = read_motion(folder / "02_01.amc", folder / "02.asf")
    height = motion.positions[..., 2]
    # The head bone ends inside the skull, some 10 cm below the crown; the toes are a few cm above the floor.
    assert looks_like_a_walk(motion)
    feet = [motion.index(name) for name in ("ltoes", "rtoes", "lfoot", "rfoot")]
    assert set(np.argmin(height, axis=1)) <= set(feet)
    # Alternating feet: the height of either ankle crosses the other's several times; the pelvis travels 2 to 5 m.
    ankles = height[:, motion.index("ltibia")] - height[:, motion.index("rtibia")]
    assert 2 <= np.count_nonzero(np.diff(np.sign(ankles))) <= 20
    travelled = np.linalg.norm(motion.positions[-1, 0, :2] - motion.positions[0, 0, :2])
    assert 2000 < travelled < 5000


@pytest.mark.parametrize("wrong", ["reversed", "inverse", "none"])
def test_wrong_conventions_are_no_walk(data_dir, monkeypatch, wrong):
    def rotation(angles, order):
        if wrong == "reversed":
            return euler_rotation(angles, order[::-1])
        axes = angles.ndim == 1
        if wrong == "inverse":
            return euler_rotation(angles, order).inv() if axes else euler_rotation(angles, order)
        return Rotation.identity() if axes else euler_rotation(angles, order)

    monkeypatch.setattr(amc, "euler_rotation", rotation)
    folder = data_dir / "cmu_amc"
    assert not looks_like_a_walk(read_motion(folder / "02_01.amc", folder / "02.asf"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tibia 41\n", "", "frame 2 lacks 'tibia'"),
        ("tibia 41\n", "tib", "lacks the joint 'tib'"),
        ("femur 5 -6 7e0", "femur 5 -6", "line 10, femur: 2 values in frame 2"),
        ("tibia 41", "ulna 41", "line 11: the skeleton lacks the joint 'ulna'"),
        ("tibia 41", "foot 41", "line 11, foot: 1 values"),
        ("tibia 41", "tibia nan", "line 11, tibia: 'nan' is not a number"),
        ("tibia 41", "tibia 1e300", "too large"),
        ("tibia 41", "tibia 41\ntibia 41", "line 12: 'tibia' is repeated"),
        ("\n2\n", "\n3\n", "line 8: frame 3 follows frame 1"),
        ("1\nroot", "root", "line 4: 'root' before the first frame"),
        (":DEGREES", ":RADIANS", "line 3: :radians differs"),
    ],
)
def test_bad_amc(tmp_path, old, new, message):
    assert old in AMC
    with pytest.raises(InputError) as caught:
        read(tmp_path, amc=AMC.replace(old, new, 1))
    assert message in str(caught.value) and "leg.amc" in str(caught.value)


@pytest.mark.parametrize("text", ["", "\n", ":DEGREES\n", "1\n", "\0\0"])
def test_amc_without_frames(tmp_path, text):
    with pytest.raises(InputError):
        read(tmp_path, amc=text)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (":hierarchy", ":other", ":hierarchy is missing"),
        (":bonedata", ":other", ":bonedata is missing"),
        ("     direction 0.6 -0.8 0\n", "", "direction: a bone lacks this line"),
        ("direction 0.6 -0.8 0", "direction 0.6 -0.8", "line 17, femur direction: 2 values"),
        ("direction 0.6 -0.8 0", "direction 0 0 0", "femur direction"),
        ("length 7.5", "length -7.5", "femur length: negative"),
        ("length 0.45", "length 0", "unit of length"),
        ("axis 0 0 20  XYZ", "axis 0 0 20 XYY", "axis order"),
        ("dof rx ry rz", "dof rx ry tz", "line 20, femur dof: channel 'tz' is not supported"),
        ("name tibia", "name femur", "bone 'femur' is repeated"),
        ("    femur tibia\n", "", "'tibia' is named before its parent"),
        ("femur tibia\n", "femur shin\n", "'shin' is not in :bonedata"),
        ("femur tibia\n", "femur tibia femur\n", "'femur' has two parents"),
        ("    tibia foot\n", "", "bone 'foot' is in no line of :hierarchy"),
        ("TX TY TZ RX RY RZ", "TX TY TZ RX RY", "order is incomplete"),
    ],
)
def test_bad_asf(tmp_path, old, new, message):
    assert old in ASF
    with pytest.raises(InputError) as caught:
        read(tmp_path, asf=ASF.replace(old, new, 1))
    assert message in str(caught.value) and "leg.asf" in str(caught.value)
