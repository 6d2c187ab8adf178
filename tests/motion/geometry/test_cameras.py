from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from precision import epsilon
from scipy.spatial.transform import Rotation

from poseppl.motion.geometry import Cameras, depth, join_cameras, look_at, paper_camera, project
from poseppl.motion.geometry.cameras import NEAREST, moved_cameras
from poseppl.motion.io import CameraRecord, read_cameras
from poseppl.motion.tracking.placing import cameras_of_records

LENS = np.array([-0.21, 0.24, -0.001, 0.003, -0.07])


def points(count=50, seed=0):
    return np.random.default_rng(seed).uniform((-900, -900, 0), (900, 900, 1900), (count, 3))


def plain_projection(matrix, distortion, rotation, translation, point):
    """OpenCV's model as its manual writes it, one point at a time."""
    x, y, z = rotation @ point + translation
    x, y = x / z, y / z
    k1, k2, p1, p2, k3 = distortion
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent = np.array([x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y, 1])
    return (matrix @ bent)[:2]


def laboratory_rig(data_dir):
    """Four cameras of the Human3.6M laboratory, subject S1, as calibrations."""
    tables = json.loads((data_dir / "h36m_cameras" / "camera-parameters.json").read_text())
    records = []
    for name, outer in tables["extrinsics"]["S1"].items():
        inner = tables["intrinsics"][name]
        radial = np.ravel(inner["distortion"])
        records.append(
            CameraRecord(
                name,
                np.array(inner["calibration_matrix"], float),
                np.asarray(radial, float),
                np.array(outer["R"], float),
                np.ravel(np.array(outer["t"], float)),
                (1000, 1000),
            )
        )
    return records


@pytest.mark.full
def test_equation_18(dtype):
    """(X - Xc) / (Y - Yc) and (Z - Zc) / (Y - Yc)."""
    centre = np.array([100.0, -5000.0, 950.0])
    place = jnp.asarray(points())
    shifted = np.asarray(place, np.float64) - centre
    expected = shifted[:, [0, 2]] / shifted[:, 1:2]
    found = project(paper_camera(centre), place)
    assert found.shape == (1, 50, 2) and found.dtype == dtype
    np.testing.assert_allclose(found[0], expected, atol=20 * epsilon(dtype))
    np.testing.assert_allclose(depth(paper_camera(centre), place)[0], shifted[:, 1], atol=2e4 * epsilon(dtype))
    along_y = look_at(centre, centre + np.array([0, 4000.0, 0]))
    np.testing.assert_allclose(project(along_y, place), found, atol=20 * epsilon(dtype))


@pytest.mark.full
def test_look_at(dtype):
    camera = look_at((3000, -2000, 1800), (100, 200, 900), focal=1.5)
    tolerance = 10 * epsilon(dtype)  # roundings of one normalised cross product; found up to 1.5
    np.testing.assert_allclose(camera.rotation[0] @ camera.rotation[0].T, np.eye(3), atol=tolerance)
    np.testing.assert_allclose(jnp.linalg.det(camera.rotation[0]), 1, atol=tolerance)
    target = jnp.array([100.0, 200.0, 900.0])
    np.testing.assert_allclose(project(camera, target), 0, atol=tolerance)
    assert project(camera, target + jnp.array([0, 0, 100.0]))[0, 1] > 0.01  # image y is up
    right = project(camera, target + jnp.array([220.0, 290.0, 0]))[0]  # to the right of the viewing direction (-2900, 2200)
    assert right[0] > 0.01


def test_opencv_model(dtype):
    rng = np.random.default_rng(3)
    matrix = np.array([[1145.0, 0, 512.5], [0, 1143.0, 515.4], [0, 0, 1]])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    translation = np.array([50.0, -80.0, 5200.0])
    camera = cameras_of_records([CameraRecord("a", matrix, LENS, turn, translation, (1000, 1000))])
    places = points()
    expected = [plain_projection(matrix, LENS, turn, translation, point) for point in places]
    np.testing.assert_allclose(project(camera, jnp.asarray(places))[0], expected, atol=2e4 * epsilon(dtype))


@pytest.mark.full
def test_recorded_rigs(data_dir, dtype):
    """Calibrations of two laboratories: several cameras at once are each one alone, and are the textbook's."""
    balancing = read_cameras(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml")
    for records, size in ((laboratory_rig(data_dir), 1000), (balancing, 1920)):
        cameras = cameras_of_records(records)
        assert len(records) == 4
        places = points(20)
        together = project(cameras, jnp.asarray(places))
        assert together.shape == (4, 20, 2)
        for i, record in enumerate(records):
            expected = [
                plain_projection(record.matrix, record.distortion, record.rotation, record.translation, point)
                for point in places
            ]
            in_front = np.asarray(depth(cameras, jnp.asarray(places)))[i] > 1000
            assert in_front.any()
            np.testing.assert_allclose(together[i][in_front], np.array(expected)[in_front], atol=100 * size * epsilon(dtype))
            alone = project(cameras_of_records([record]), jnp.asarray(places))[0]
            np.testing.assert_allclose(together[i][in_front], alone[in_front], atol=10 * size * epsilon(dtype))


@pytest.mark.full
def test_join(dtype):
    plain, turned = paper_camera((0, -4000, 1000)), look_at((4000, 0, 1000), (0, 0, 1000))
    assert join_cameras([plain, turned]).distortion is None
    bent = turned._replace(distortion=jnp.asarray(LENS)[None])
    both = join_cameras([plain, bent])
    assert both.distortion.shape == (2, 5)
    places = jnp.asarray(points())
    expected = jnp.concatenate([project(plain, places), project(bent, places)])
    np.testing.assert_allclose(project(both, places), expected, atol=10 * epsilon(dtype))


@pytest.mark.full
@pytest.mark.parametrize("distance", [0.0, -1e-3, -1.0, -3000.0])
@pytest.mark.parametrize("lens", [False, True])
def test_behind_the_camera_all_is_finite(dtype, lens, distance):
    camera = paper_camera((0, -5000, 1000))
    if lens:
        camera = camera._replace(distortion=jnp.asarray(LENS)[None])
    place = jnp.array([40.0, -5000.0 + distance, 1100.0])
    assert np.isfinite(project(camera, place)).all()
    jacobian = jax.jacrev(lambda point: project(camera, point))(place)
    assert np.isfinite(jacobian).all()
    assert np.all(np.asarray(jacobian)[..., 1] == 0) or distance == 0  # depth has no say behind NEAREST
    assert depth(camera, place)[0] <= NEAREST


@pytest.mark.full
def test_gradients_with_respect_to_cameras(dtype):
    """Every field against central differences in float64; only the direction of rounding is left in float32."""
    camera = look_at((3000, -2000, 1800), (100, 200, 900), focal=1.5)._replace(distortion=jnp.asarray(LENS)[None])
    place = jnp.asarray(points(1)[0])
    gradient = jax.grad(lambda camera: jnp.sum(project(camera, place)))(camera)
    for name in Cameras._fields:
        leaf = np.asarray(getattr(camera, name), np.float64)
        step = 1e-2 * max(1.0, np.abs(leaf).max())
        for index in np.ndindex(leaf.shape):
            sides = []
            for sign in (1, -1):
                moved = leaf.copy()
                moved[index] += sign * step * 1e-2
                sides.append(float(jnp.sum(project(camera._replace(**{name: jnp.asarray(moved)}), place))))
            slope = (sides[0] - sides[1]) / (2e-2 * step)
            np.testing.assert_allclose(
                getattr(gradient, name)[index], slope, rtol=1e-3, atol=2 * epsilon(dtype) / step * 1e2 + 1e-6
            )


@pytest.mark.full
def test_batches_of_points_and_cameras(dtype):
    camera = join_cameras([paper_camera((0, -4000, 1000)), look_at((4000, 0, 1000), (0, 0, 1000))])
    places = jnp.asarray(points(6))
    grid = project(camera, places.reshape(2, 3, 3))
    np.testing.assert_allclose(grid.reshape(2, 6, 2), project(camera, places), atol=5 * epsilon(dtype))
    mapped = jax.vmap(project, (None, 0), 1)(camera, places)
    np.testing.assert_allclose(mapped, project(camera, places), atol=5 * epsilon(dtype))
    one_each = jax.vmap(lambda lens: project(jax.tree.map(lambda leaf: leaf[None], lens), places)[0])(camera)
    np.testing.assert_allclose(one_each, project(camera, places), atol=5 * epsilon(dtype))


@pytest.mark.full
@pytest.mark.parametrize("degrees", [0.0, 1e-4, 1e-2, 1.0, 90.0])
def test_moved_cameras_turn_about_their_own_axes(degrees: float) -> None:
    camera = look_at((0.0, -4000.0, 1000.0), (0.0, 0.0, 900.0))
    turn = np.deg2rad(degrees) * np.array([[0.6, 0.0, 0.8]])
    moved = moved_cameras(camera, jnp.asarray(turn, float), jnp.asarray([[1.0, 2.0, 3.0]]))
    expected = Rotation.from_rotvec(turn[0]).as_matrix() @ np.asarray(camera.rotation[0], np.float64)
    np.testing.assert_allclose(moved.rotation[0], expected, atol=3e-7)
    np.testing.assert_allclose(moved.centre[0], camera.centre[0] + np.array([1.0, 2.0, 3.0]))
    slope = jax.jacobian(lambda turn: moved_cameras(camera, turn, jnp.zeros((1, 3))).rotation)(jnp.asarray(turn, float))
    assert np.isfinite(slope).all()
