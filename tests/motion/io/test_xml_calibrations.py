"""Calibrations of Vicon and OptiTrack: made from one camera each, whose projection is known from first principles."""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poseppl.errors import InputError
from poseppl.motion.geometry import project
from poseppl.motion.io import read_calibration
from poseppl.motion.tracking.placing import cameras_of_records

CENTRE = np.array([3000.0, -2000.0, 1500.0])
POINTS = np.array([[0.0, 0, 0], [300, 200, 1000], [-250, 600, 1700], [900, -300, 800]])
TOWARDS = (np.array([0.0, 0.0, 900.0]) - CENTRE) / np.linalg.norm(np.array([0.0, 0.0, 900.0]) - CENTRE)
RIGHT = np.cross(TOWARDS, [0, 0, 1]) / np.linalg.norm(np.cross(TOWARDS, [0, 0, 1]))
UP = np.cross(RIGHT, TOWARDS)
FOCAL, PRINCIPAL, SIZE = 1650.0, np.array([950.0, 560.0]), (1920, 1080)

XCP = """<?xml version="1.0" encoding="UTF-8" standalone="no" ?>
<Cameras NAME="" VERSION="1.0">
  <Camera DEVICEID="2110" DISPLAY_TYPE="Vue" PIXEL_ASPECT_RATIO="1" SENSOR_SIZE="1920 1080" SKEW="0" TYPE="Vue">
    <KeyFrames><KeyFrame FOCAL_LENGTH="1650" ORIENTATION="{q}" POSITION="3000 -2000 1500" PRINCIPAL_POINT="950 560"
      {radial} WORLD_ERROR="0.2"/></KeyFrames>
  </Camera>
  <Camera DEVICEID="2111" DISPLAY_TYPE="T40" PIXEL_ASPECT_RATIO="1" SENSOR_SIZE="2336 1728"><KeyFrames/></Camera>
</Cameras>
"""
MCAL = """<?xml version="1.0" encoding="utf-16"?>
<Profile><Calibration><Cameras><Camera Serial="Prime 13">
  <Properties CameraID="1"/><Attributes ImagerPixelWidth="1920" ImagerPixelHeight="1080"/>
  <Intrinsic HorizontalFocalLength="1" VerticalFocalLength="1" LensCenterX="0" LensCenterY="0" KC1="0.2"/>
  <IntrinsicStandardCameraModel HorizontalFocalLength="1650" VerticalFocalLength="1650" LensCenterX="950" LensCenterY="560"
    k1="-0.1" k2="0.02" k3="0.001" TangentialX="0.0003" TangentialY="-0.0002"/>
  <Extrinsic X="3.0" Y="-2.0" Z="1.5" {turn}/>
</Camera></Cameras></Calibration></Profile>
"""


def ideal() -> np.ndarray:
    """Image points (4, 2) of the points, right and down, over the distance along the axis."""
    away = POINTS - CENTRE
    return np.stack([away @ RIGHT, -away @ UP], -1) / (away @ TOWARDS)[:, None]


def xcp(radial: str) -> str:
    to_camera = Rotation.from_matrix(np.stack([RIGHT, -UP, TOWARDS]))
    return XCP.format(q=" ".join(f"{value:.12g}" for value in to_camera.as_quat()), radial=radial)


def seen(path: Path) -> np.ndarray:
    found = read_calibration(path)
    assert [camera.size for camera in found.cameras] == [SIZE]
    return np.asarray(project(cameras_of_records(found.cameras), jnp.asarray(POINTS)))[0]


def test_a_camera_of_vicon_projects_as_its_axes_say(tmp_path: Path) -> None:
    file = tmp_path / "walk.xcp"
    file.write_text(xcp('VICON_RADIAL="0 0"'))
    np.testing.assert_allclose(seen(file), FOCAL * ideal() + PRINCIPAL, atol=0.01)
    assert read_calibration(file).unit == "mm" and read_calibration(file).cameras[0].name == "2110"


@pytest.mark.parametrize("radial", ['VICON_RADIAL="4e-08 2e-14"', 'VICON_RADIAL2="ViconRadial2 950 560 4e-08 2e-14 1e-21"'])
def test_the_lens_of_vicon_moves_seen_points_to_ideal_ones(tmp_path: Path, radial: str) -> None:
    file = tmp_path / "walk.xcp"
    file.write_text(xcp(radial))
    found = seen(file) - PRINCIPAL
    r2 = (found**2).sum(-1, keepdims=True)
    third = 1e-21 if "RADIAL2" in radial else 0.0
    np.testing.assert_allclose(found * (1 + 4e-8 * r2 + 2e-14 * r2**2 + third * r2**3), FOCAL * ideal(), atol=0.2)
    assert np.abs(found - FOCAL * ideal()).max() > 2


def test_a_camera_of_optitrack_projects_as_its_axes_say(tmp_path: Path) -> None:
    file = tmp_path / "room.mcal"
    turn = np.stack([RIGHT, UP, -TOWARDS], -1).ravel()  # the camera's axes as columns: x right, y up, z backwards
    text = MCAL.format(turn=" ".join(f'OrientMatrix{number}="{value:.12g}"' for number, value in enumerate(turn)))
    file.write_bytes(text.encode("utf-16"))
    x, y = ideal().T
    r2 = x**2 + y**2
    radial, p1, p2 = 1 - 0.1 * r2 + 0.02 * r2**2 + 0.001 * r2**3, 0.0003, -0.0002
    bent = [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y]
    np.testing.assert_allclose(seen(file), FOCAL * np.stack(bent, -1) + PRINCIPAL, atol=0.01)
    found = read_calibration(file)
    assert found.unit == "m" and found.cameras[0].name == "Prime 13"
    file.write_text(text.replace("IntrinsicStandardCameraModel", "Other"), encoding="utf-8")
    with pytest.raises(InputError, match=r"camera Prime 13\.IntrinsicStandardCameraModel: it is missing"):
        read_calibration(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('FOCAL_LENGTH="1650"', "", "KeyFrame.FOCAL_LENGTH: it is missing"),
        ("1920 1080", "1920", "SENSOR_SIZE: 1 values"),
        ('"950 560"', '"950 x"', "PRINCIPAL_POINT: 'x' is not a number"),
        ("<KeyFrame ", "<Other ", "no calibrated camera|mismatched tag"),
        ('VICON_RADIAL="0 0"', 'VICON_RADIAL="1 0"', "a distortion that no picture has"),
        ('VICON_RADIAL="0 0"', 'VICON_RADIAL2="ViconRadial2 900 560 0 0 0"', "is not the principal point"),
        ('VICON_RADIAL="0 0"', 'VICON_RADIAL2="ViconRadial2 950 560"', "3 values"),
    ],
)
def test_damaged_files_of_vicon(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "walk.xcp"
    whole = xcp('VICON_RADIAL="0 0"')
    assert old in whole
    file.write_text(whole.replace(old, new))
    with pytest.raises(InputError, match=message):
        read_calibration(file)
