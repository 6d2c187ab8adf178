"""Calibrations of Qualisys, OpenCV, EasyMocap and OpenCap: what they hold, and files that are wrong or malicious."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from damage import damaged_copies

from poseppl.errors import InputError
from poseppl.motion.io import CameraRecord, read_calibration, read_cameras
from poseppl.motion.io.cameras_yaml import read_opencv_yaml

MATRIX = np.array([[1680.5, 0.0, 532.25], [0.0, 1681.25, 948.5], [0.0, 0.0, 1.0]])
TURN = cv2.Rodrigues(np.array([1.5, -0.5, 0.25]))[0]
PLACE = np.array([[0.5], [1.0], [3.0]])
LENS = np.array([[0.1, -0.2, 0.001, 0.002, 0.05]])


@pytest.fixture(scope="module")
def qualisys(data_dir: Path) -> str:
    return (data_dir / "pose2sim_balancing" / "calibration" / "Calib.qca.txt").read_text()


def test_qualisys_is_the_published_toml(data_dir: Path) -> None:
    folder = data_dir / "pose2sim_balancing" / "calibration"
    found = read_calibration(folder / "Calib.qca.txt")
    assert found.unit == "mm"
    for ours, published in zip(found.cameras, read_cameras(folder / "Calib_qualisys.toml"), strict=True):
        assert ours.name == published.name and ours.size == published.size
        np.testing.assert_allclose(ours.matrix, published.matrix, rtol=1e-9)
        np.testing.assert_allclose(ours.distortion, published.distortion, rtol=1e-9)
        np.testing.assert_allclose(ours.rotation, published.rotation, atol=1e-12)
        np.testing.assert_allclose(ours.translation, published.translation, atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<?xml version='1.0' encoding='ASCII'?>", '<!DOCTYPE a [<!ENTITY b "c">]>', "definitions of its own"),
        ("</calibration>", "", "no XML: .*it may have been cut off"),
        ("<camera ", "<other ", "no XML"),
        ('focalLengthU="107599.671875"', "", "camera cam_01.intrinsic.focalLengthU: it is missing"),
        ('focalLengthU="107599.671875"', 'focalLengthU="-1"', "camera cam_01.intrinsic: a focal length is not positive"),
        ('r11="0.5536380477336265"', 'r11="0.9"', "camera cam_01.transform: not a rotation matrix"),
        ('r11="0.5536380477336265"', 'r11="nan"', "camera cam_01.transform.r11: 'nan' is not a number"),
        ('serial="cam_02"', 'serial="cam_01"', "two cameras are called 'cam_01'"),
        ('fov_video bottom="1919"', 'fov_video bottom="-5"', "camera cam_01.fov_video: 1088 x -4 pixels"),
    ],
)
def test_a_wrong_calibration_of_qualisys_is_reported(tmp_path: Path, qualisys: str, old: str, new: str, words: str) -> None:
    assert old in qualisys
    (tmp_path / "Calib.qca.txt").write_text(qualisys.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"Calib\.qca\.txt.*{words}"):
        read_cameras(tmp_path / "Calib.qca.txt")


def write_yaml(path: Path, **fields: Any) -> Path:
    """Output of OpenCV itself."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in fields.items():
        storage.write(name, value)
    storage.release()
    return path


def opencv(path: Path, **changes: Any) -> Path:
    fields = {
        "image_width": 1088,
        "image_height": 1920,
        "camera_matrix": MATRIX,
        "distortion_coefficients": LENS,
        "R": TURN,
        "T": PLACE,
    }
    return write_yaml(path, **(fields | changes))


def same(camera: CameraRecord, scale: float = 1000.0) -> None:
    np.testing.assert_allclose(camera.matrix, MATRIX)
    np.testing.assert_allclose(camera.distortion, LENS[0])
    np.testing.assert_allclose(camera.rotation, TURN, atol=1e-12)
    np.testing.assert_allclose(camera.translation, scale * PLACE[:, 0])


def test_files_of_opencv(tmp_path: Path) -> None:
    opencv(tmp_path / "left.yml")
    opencv(tmp_path / "right.yaml", R=cv2.Rodrigues(TURN)[0])
    found = read_calibration(tmp_path)
    assert found.unit is None and [camera.name for camera in found.cameras] == ["left", "right"]
    for camera in found.cameras:
        same(camera)
        assert camera.size == (1088, 1920)
    same(read_calibration(tmp_path / "left.yml", "mm").cameras[0], 1.0)
    same(read_calibration(tmp_path / "left.yml", "25.4").cameras[0], 25.4)
    with pytest.raises(InputError, match="unit: 'feet' .expected mm, cm, dm, m, in, or a number of mm"):
        read_calibration(tmp_path, "feet")


def test_the_axis_that_is_up_can_be_given(tmp_path: Path) -> None:
    opencv(tmp_path / "left.yml")
    found = read_calibration(tmp_path, "mm", "-y")
    assert found.up == "-y" and found.unit == "mm"
    point = np.array([3.0, -2.0, 5.0])  # its height is 2, along -y
    turned = np.array([3.0, 5.0, 2.0])
    camera = found.cameras[0]
    np.testing.assert_allclose(camera.rotation @ turned + camera.translation, TURN @ point + PLACE[:, 0], atol=1e-12)
    with pytest.raises(InputError, match="up: 'down' is no axis"):
        read_calibration(tmp_path, up="down")


def test_easymocap(tmp_path: Path) -> None:
    write_yaml(tmp_path / "intri.yml", K_1=MATRIX, dist_1=LENS, K_2=MATRIX, dist_2=LENS, H_2=1920, W_2=1088)
    text = (tmp_path / "intri.yml").read_text().replace("---\n", '---\nnames:\n  - "1"\n  - "2"\n', 1)
    (tmp_path / "intri.yml").write_text(text)
    write_yaml(tmp_path / "extri.yml", R_1=cv2.Rodrigues(TURN)[0], Rot_1=TURN, T_1=PLACE, R_2=cv2.Rodrigues(TURN)[0], T_2=PLACE)
    for path in (tmp_path, tmp_path / "intri.yml"):
        found = read_calibration(path)
        assert found.unit is None and [camera.name for camera in found.cameras] == ["1", "2"]
        same(found.cameras[0])
        same(found.cameras[1])
        assert [camera.size for camera in found.cameras] == [(1064, 1897), (1088, 1920)]
    (tmp_path / "intri.yml").write_text(text.replace('- "2"', '- "3"'))
    with pytest.raises(InputError, match=r"extri\.yml, Rot_3: the field is missing"):
        read_cameras(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("camera_matrix: !!opencv-matrix", "camera_matrix: !!python/object/apply:os.system", "line 5: '!!python/object"),
        ("image_width: 1088", "image_width: &a 1088", "line 3: '&a 1088' .expected numbers"),
        ("image_width: 1088", "image_width: *a", "line 3"),
        ("image_width: 1088", "image_height: 1088", "line 4: 'image_height' comes twice"),
        ("image_width: 1088", "image_width 1088", "line 3: 'image_width 1088' is no name and value"),
        ("image_width: 1088", "image_width: -1", "image_width, image_height: "),
        ("rows: 3", "rows: 4", "4 x 3 of other data"),
        ("rows: 3", "row: 3", "a matrix without rows"),
        ("data: [ 1680.5", "data: [ a, 1680.5", "3 x 3 of other data"),
        ("data: [ 1680.5", "data: [ .Nan", "data 0, 532|data .Nan"),
        ("1681.25", "-1681.25", "camera_matrix: a focal length is not positive"),
        ("camera_matrix", "other_matrix", "camera_matrix: the field is missing"),
    ],
)
def test_a_wrong_file_of_opencv_is_reported(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = opencv(tmp_path / "left.yml").read_text()
    assert old in text
    (tmp_path / "left.yml").write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"left\.yml.*({words})"):
        read_cameras(tmp_path / "left.yml")


def test_values_are_those_of_opencv(tmp_path: Path) -> None:
    big = np.random.default_rng(0).normal(0, 1e3, (20, 7))
    found = read_opencv_yaml(write_yaml(tmp_path / "a.yml", big=big, whole=3, real=2.5, text="a: b, c", empty=""))
    np.testing.assert_array_equal(found["big"], big)
    assert found["whole"] == 3 and found["real"] == 2.5 and found["text"] == "a: b, c"


def opencap(**changes: Any) -> dict[str, Any]:
    return {
        "distortion": LENS,
        "intrinsicMat": MATRIX,
        "imageSize": np.array([[1920.0], [1088.0]]),
        "rotation": TURN,
        "translation": 1000 * PLACE,
        "rotation_EulerAngles": np.zeros((3, 1)),
    } | changes


def test_pickles_of_opencap(tmp_path: Path) -> None:
    for camera in ("Cam0", "Cam1"):
        (tmp_path / camera).mkdir()
        (tmp_path / camera / "cameraIntrinsicsExtrinsics.pickle").write_bytes(pickle.dumps(opencap()))
    found = read_calibration(tmp_path)
    assert found.unit == "mm" and [camera.name for camera in found.cameras] == ["Cam0", "Cam1"]
    for camera in found.cameras:
        same(camera)
        assert camera.size == (1088, 1920)


def test_a_malicious_pickle_runs_nothing(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> Any:
            return (os.system, (f"touch {tmp_path / 'called'}",))

    for value in (Evil(), opencap(rotation=Evil()), opencap(extra=[Evil()])):
        (tmp_path / "cam.pickle").write_bytes(pickle.dumps(value))
        with pytest.raises(InputError, match=r"cam\.pickle: the pickle asks for posix\.system"):
            read_cameras(tmp_path / "cam.pickle")
    assert not (tmp_path / "called").exists()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([], "no camera"),
        ({"intrinsicMat": MATRIX}, "imageSize: the field is missing"),
        (opencap(rotation=np.diag([1.0, 1.0, 2.0])), "rotation: "),
        (opencap(rotation="up"), "rotation: not an array of numbers"),
        (opencap(translation=np.zeros(2)), "translation: 2 values"),
        (opencap(imageSize=[1280, [720, 1]]), "imageSize: not an array of numbers"),
        (opencap(imageSize=[1280]), "imageSize: .1280.0. .expected .width, height. in pixels"),
        (opencap(distortion=np.full(5, np.nan)), "distortion: not finite"),
    ],
)
def test_a_wrong_pickle_is_reported(tmp_path: Path, value: Any, words: str) -> None:
    (tmp_path / "cam.pickle").write_bytes(pickle.dumps(value))
    with pytest.raises(InputError, match=rf"cam\.pickle.*{words}"):
        read_cameras(tmp_path / "cam.pickle")


def test_a_folder_without_a_calibration(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no calibration in the folder, or two kinds"):
        read_cameras(tmp_path)
    opencv(tmp_path / "left.yml")
    (tmp_path / "cam.pickle").write_bytes(pickle.dumps(opencap()))
    with pytest.raises(InputError, match="no calibration in the folder, or two kinds"):
        read_cameras(tmp_path)


def test_damaged_files_are_read_or_refused(tmp_path: Path, qualisys: str) -> None:
    yaml = opencv(tmp_path / "left.yml").read_bytes()
    refused = 0
    for name, data in (("a.yml", yaml), ("a.pickle", pickle.dumps(opencap())), ("a.qca.txt", qualisys.encode())):
        for copy in damaged_copies(data, 60):
            (tmp_path / name).write_bytes(copy)
            try:
                cameras = read_cameras(tmp_path / name)
            except InputError as error:
                refused += 1
                assert name in str(error)
            else:
                for camera in cameras:
                    assert all(np.isfinite(part).all() for part in (camera.matrix, camera.distortion, camera.translation))
    assert refused > 60


def test_a_picture_of_qualisys_that_is_cut_out_of_the_sensors(tmp_path: Path, qualisys: str) -> None:
    """The principal point counts from the picture's corner, the skew is a 64th as well."""
    text = qualisys
    for old, new in (
        (
            '<fov_video bottom="1919" left="0" right="1087" top="0"/>',
            '<fov_video bottom="1003" left="100" right="899" top="204"/>',
        ),
        ('centerPointU="34110.316406" centerPointV="60680.792969"', 'centerPointU="32000" centerPointV="38400"'),
        ('focalLengthU="107599.671875" focalLengthV="107588.828125"', 'focalLengthU="64000" focalLengthV="128000"'),
        ('skew="0.000000"', 'skew="128"'),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "Calib.qca.txt").write_text(text)
    found = read_cameras(tmp_path / "Calib.qca.txt")[0]
    np.testing.assert_allclose(found.matrix, [[1000, 2, 400], [0, 2000, 396], [0, 0, 1]])
    assert found.size == (800, 800)
