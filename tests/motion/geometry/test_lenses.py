"""Lenses of four, five and eight coefficients and fisheyes, against OpenCV, and back."""

from __future__ import annotations

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from precision import epsilon

from poseppl.motion.geometry import project
from poseppl.motion.geometry.cameras import distort, undistort, viewing_rays
from poseppl.motion.io import CameraRecord, read_cameras
from poseppl.motion.tracking.placing import cameras_of_records

MATRIX = np.array([[903.5, 0.0, 618.3], [0.0, 907.9, 394.2], [0.0, 0.0, 1.0]])
TURN = cv2.Rodrigues(np.array([0.2, -0.3, 0.1]))[0]
PLACE = np.array([100.0, -50.0, 4000.0])
LENSES = {
    "four": [-0.33, 0.12, -0.004, 0.004],
    "five": [-0.33, 0.046, -0.0043, 0.0041, 0.067],
    "eight": [0.5, -0.2, 0.001, -0.002, 0.05, 0.8, -0.1, 0.02],
    "fisheye": [0.08, -0.02, 0.01, -0.003],
}


def record(name: str) -> CameraRecord:
    lens = np.array(LENSES[name])
    fisheye = name == "fisheye"
    return CameraRecord(
        name, MATRIX, lens if fisheye or lens.size == 8 else np.pad(lens, (0, 5 - lens.size)), TURN, PLACE, (1280, 720), fisheye
    )


def by_opencv(name: str, points: np.ndarray) -> np.ndarray:
    turn, lens = cv2.Rodrigues(TURN)[0], np.array(LENSES[name])
    if name == "fisheye":
        return cv2.fisheye.projectPoints(points[:, None], turn, PLACE[:, None], MATRIX, lens)[0][:, 0]
    return cv2.projectPoints(points[:, None], turn, PLACE, MATRIX, lens)[0][:, 0]


def places() -> np.ndarray:
    return np.random.default_rng(0).uniform(-1500, 1500, (200, 3))


@pytest.mark.full
@pytest.mark.parametrize("name", LENSES)
def test_projection_is_that_of_opencv(dtype, name: str) -> None:
    camera = cameras_of_records([record(name)])
    assert camera.distortion.shape == (1, {"eight": 8, "fisheye": 9}.get(name, 5))
    found = project(camera, jnp.asarray(places(), dtype))[0]
    np.testing.assert_allclose(found, by_opencv(name, places()), atol=5e4 * epsilon(dtype))


@pytest.mark.parametrize("name", LENSES)
def test_rays_are_those_of_the_projection(name: str) -> None:
    camera = cameras_of_records([record(name)])
    rays = viewing_rays(camera, 0, by_opencv(name, places()))
    centre = -TURN.T @ PLACE
    expected = (places() - centre) / np.linalg.norm(places() - centre, axis=-1, keepdims=True)
    np.testing.assert_allclose(rays, expected, atol=2e-6)  # the camera is kept in single precision


@pytest.mark.full
def test_a_rig_of_all_kinds_is_each_camera_alone(dtype) -> None:
    rig = cameras_of_records([record(name) for name in LENSES])
    assert rig.distortion.shape == (4, 9)
    together = project(rig, jnp.asarray(places(), dtype))
    for index, name in enumerate(LENSES):
        np.testing.assert_allclose(together[index], by_opencv(name, places()), atol=5e4 * epsilon(dtype))


@pytest.mark.full
def test_gradients_are_finite_on_the_axis(dtype) -> None:
    for name in LENSES:
        lens = np.asarray(cameras_of_records([record("fisheye"), record(name)]).distortion[1], dtype)
        slope = jax.jacrev(lambda plane, lens=lens: jnp.stack(distort(lens, plane[0], plane[1])))(jnp.zeros(2, dtype))
        np.testing.assert_allclose(slope, np.eye(2), atol=1e-6)


def test_where_a_lens_puts_nothing_there_is_no_ray() -> None:
    folded = np.array([-0.5, 0.0, 0.0, 0.0, 0.0])  # no point is farther out than r (1 - r^2 / 2) at r^2 = 2 / 3
    farthest = np.sqrt(2 / 3) * (1 - 1 / 3)
    plane = np.array([[0.99 * farthest, 0.0], [1.01 * farthest, 0.0], [1e9, 1e9], [np.nan, 0.0]])
    found = undistort(folded, plane)
    assert np.isfinite(found).all(-1).tolist() == [True, False, False, False]
    assert found[0, 0] < np.sqrt(2 / 3)
    # Beyond the fold the formula puts points of the other side, such as -2 at 2.
    far = np.stack([np.linspace(1.01 * farthest, 5.0, 50), np.zeros(50)], -1)
    assert np.isnan(undistort(folded, far)).all()
    fisheye = undistort(np.array([0.0, 0.0, 0.0, 0.0, 0, 0, 0, 0, 1.0]), np.array([[1.5, 0.0], [1.6, 0.0]]))
    assert np.isfinite(fisheye).all(-1).tolist() == [True, False]
    np.testing.assert_allclose(fisheye[0, 0], np.tan(1.5))


@pytest.mark.full
def test_long_lenses_of_a_recording(data_dir) -> None:
    """Focal lengths of 20,000 to 136,000 px with k1 down to -6469: to the picture's corners and back."""
    for camera in read_cameras(data_dir / "fly_legs" / "calibration.toml"):
        width, height = camera.size
        corners = np.array([[0, 0], [width, 0], [0, height], [width, height], [width / 2, height / 2]], float)
        plane = (corners - camera.matrix[:2, 2]) / np.diagonal(camera.matrix)[:2]
        found = undistort(camera.distortion, plane)
        pixels = cv2.projectPoints(
            np.append(found, np.ones((5, 1)), 1)[:, None], np.zeros(3), np.zeros(3), camera.matrix, camera.distortion
        )
        np.testing.assert_allclose(pixels[0][:, 0], corners, atol=1e-6)
