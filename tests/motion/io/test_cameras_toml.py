from __future__ import annotations

import numpy as np
import pytest
from recording_samples import TOML
from scipy.spatial.transform import Rotation

from poseppl.errors import InputError
from poseppl.motion.io.cameras import CameraRecord, read_cameras, write_cameras

ANIPOSE = """
[cam_0]
name = "front"
size = [1088.0, 1920.0]
matrix = [[1680.0, 0.0, 532.0], [0.0, 1681.0, 948.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.2, 0.3, 0.4]
rotation = [1.5, -0.5, 0.25]
translation = [0.5, 1.0, 3.0]
fisheye = false

[metadata]
error = 0.0
"""


def read(tmp_path, text):
    (tmp_path / "rig.toml").write_text(text)
    return read_cameras(tmp_path / "rig.toml")


def test_our_form(tmp_path):
    (camera,) = read(tmp_path, TOML)
    assert camera.name == "front" and camera.size == (1920, 1080)
    np.testing.assert_array_equal(camera.matrix, [[1500, 0, 960], [0, 1500, 540], [0, 0, 1]])
    np.testing.assert_array_equal(camera.translation, [0, 1000, 5000])
    (metres,) = read(tmp_path, TOML.replace('"mm"', '"m"'))
    np.testing.assert_array_equal(metres.translation, [0, 1e6, 5e6])


def test_anipose_form(tmp_path):
    (camera,) = read(tmp_path, ANIPOSE)
    assert camera.name == "front"
    np.testing.assert_allclose(camera.rotation, Rotation.from_rotvec([1.5, -0.5, 0.25]).as_matrix(), atol=1e-15)
    np.testing.assert_array_equal(camera.distortion, [0.1, 0.2, 0.3, 0.4, 0.0])
    np.testing.assert_array_equal(camera.translation, [500, 1000, 3000])
    (millimetres,) = read(tmp_path, 'units = "mm"\n' + ANIPOSE)
    np.testing.assert_array_equal(millimetres.translation, [0.5, 1, 3])


def test_recorded_rig(data_dir):
    cameras = read_cameras(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml")
    assert [camera.name for camera in cameras] == ["cam_01", "cam_02", "cam_03", "cam_04"]
    centres = np.array([-camera.rotation.T @ camera.translation for camera in cameras])
    # Four cameras around a beam, all above the floor (Z up) and within a few metres of each other.
    assert np.all((centres[:, 2] > 300) & (centres[:, 2] < 4000))
    assert 1000 < np.linalg.norm(centres - centres.mean(axis=0), axis=1).max() < 8000
    for camera in cameras:
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)


def test_rigs_of_long_lenses_and_of_caliscope(data_dir):
    flies = read_cameras(data_dir / "fly_legs" / "calibration.toml")
    assert [camera.name for camera in flies] == ["Cam-A", "Cam-B", "Cam-C"]
    assert flies[2].matrix[0, 0] == 136330.25013473458 and flies[2].distortion[0] == -6468.60716369641
    board = read_cameras(data_dir / "charuco_board" / "camera_array.toml")
    assert [camera.name for camera in board] == ["0", "1", "2", "3"]
    np.testing.assert_allclose(board[0].translation, [171.25994082321383, -32.34536459937444, 1208.386461814154])
    for camera in board:
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-9)


def test_caliscope_leaves_cameras_out(tmp_path):
    table = ANIPOSE.split("[metadata]")[0].replace("[cam_0]", "[cameras.3]").replace('name = "front"', "cam_id = 3")
    (camera,) = read(tmp_path, table + "\n[cameras.4]\nignore = true\n")
    assert camera.name == "3"
    with pytest.raises(InputError, match=r"cameras\.4\.size: the field is missing"):
        read(tmp_path, table + "\n[cameras.4]\nignore = false\n")


def test_round_trip(tmp_path):
    rng = np.random.default_rng(0)
    cameras = [
        CameraRecord(
            name=name,
            matrix=np.array([[rng.uniform(500, 2000), 0.1, 960.3], [0, rng.uniform(500, 2000), 540.7], [0, 0, 1]]),
            distortion=rng.normal(0, 0.1, 5),
            rotation=Rotation.from_rotvec(rng.normal(size=3)).as_matrix(),
            translation=rng.normal(0, 3000, 3),
            size=(1920, 1080),
        )
        for name in ("front", 'a "quoted" \\ name.with\tdots', "左")
    ]
    write_cameras(tmp_path / "rig.toml", cameras)
    for before, after in zip(cameras, read_cameras(tmp_path / "rig.toml"), strict=True):
        assert before.name == after.name and before.size == after.size
        for field in ("matrix", "distortion", "rotation", "translation"):
            np.testing.assert_array_equal(getattr(before, field), getattr(after, field))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (TOML, "x = 1", "the file has no camera"),
        (TOML, "camera = 3", "the file has no camera"),
        (TOML, "camera = {front = 3}", "camera.front: not a table"),
        ("[camera.front]", "[camera.front", "no TOML"),
        ('"mm"', '"feet"', "units: unit 'feet'"),
        ("size = [1920, 1080]\n", "", "camera.front.size: the field is missing"),
        ("1920", "-1920", "camera.front.size"),
        ("[0.0, 1500.0, 540.0]", "[0.0, -1500.0, 540.0]", "camera.front.matrix: a focal length is not positive"),
        ("[0.0, 0.0, 1.0]]\nd", "[0.0, 0.0, 2.0]]\nd", "camera.front.matrix: not an intrinsic matrix"),
        ("0.1, -0.05", "nan, -0.05", "camera.front.distortion: not finite"),
        ("0.1, -0.05", "0.1, 0.1, -0.05", "camera.front.distortion: 6 coefficients"),
        ("0.1, -0.05", '"0.1", -0.05', "camera.front.distortion: not an array of numbers"),
        ("distortion", "distorsion", "camera.front.distorsion: unknown field"),
        ("[1.0, 0.0, 0.0]", "[1.1, 0.0, 0.0]", "camera.front.rotation: not a rotation matrix"),
        ("[1.0, 0.0, 0.0]", "[-1.0, 0.0, 0.0]", "camera.front.rotation: a reflection"),
        ("[0.0, 1000.0, 5000.0]", "[0.0, 1000.0]", "camera.front.translation: 2 values"),
        ("[0.0, 1000.0, 5000.0]", "[[0.0, 1.0, 2.0], [0.0, 1.0, 3.0]]", "camera.front.translation: the camera moves"),
    ],
)
def test_bad_toml(tmp_path, old, new, message):
    assert old in TOML
    with pytest.raises(InputError) as caught:
        read(tmp_path, TOML.replace(old, new, 1))
    assert message in str(caught.value) and "rig.toml" in str(caught.value)


def test_a_rotation_matrix_of_zeros_is_no_rotation(tmp_path):
    rotation = "rotation = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]"
    toml = "\n".join(rotation if line.startswith("rotation") else line for line in TOML.splitlines())
    assert toml != TOML
    with pytest.raises(InputError, match="camera.front.rotation: zeros are no rotation matrix"):
        read(tmp_path, toml)


def test_lenses_of_several_kinds(tmp_path):
    (fisheye,) = read(tmp_path, ANIPOSE.replace("fisheye = false", "fisheye = true"))
    assert fisheye.fisheye and fisheye.distortion.tolist() == [0.1, 0.2, 0.3, 0.4]
    with pytest.raises(InputError, match=r"cam_0\.fisheye: 3 "):
        read(tmp_path, ANIPOSE.replace("fisheye = false", "fisheye = 3"))
    eight = ANIPOSE.replace("[0.1, 0.2, 0.3, 0.4]", "[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0, 0, 0, 0]")
    (rational,) = read(tmp_path, eight)
    assert rational.distortion.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
    with pytest.raises(InputError, match="12 coefficients"):
        read(tmp_path, eight.replace("0, 0, 0, 0]", "0, 0, 0, 1]"))
    write_cameras(tmp_path / "both.toml", [fisheye._replace(name="a"), rational._replace(name="b")])
    for before, after in zip((fisheye, rational), read_cameras(tmp_path / "both.toml"), strict=True):
        assert before.fisheye == after.fisheye
        np.testing.assert_array_equal(before.distortion, after.distortion)


def test_cameras_of_one_name(tmp_path):
    with pytest.raises(InputError, match="two cameras are called 'front'"):
        read(tmp_path, ANIPOSE + ANIPOSE.replace("cam_0", "cam_1").replace("[metadata]", "[other]"))
