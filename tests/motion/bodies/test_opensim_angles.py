"""Joint angles as OpenSim has them: against OpenSim's own inverse kinematics, and against its definition."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import arm, full_body
from poseppl_models.darby.marker_body import full_body as darby_body
from scipy.spatial.transform import Rotation

from poseppl.motion.bodies.opensim import circular_summary, opensim_coordinates, opensim_values
from poseppl.motion.io.opensim_files import read_mot
from poseppl.motion.recordings.subjects import recorded_subject


def values_of(body, states):
    columns = [each.name for each in opensim_coordinates(body)]
    values = np.asarray(jax.jit(lambda x: opensim_values(body, x))(jnp.asarray(np.atleast_2d(states), float)))
    return dict(zip(columns, values.T, strict=True))


def state(body, **angles):
    found = np.zeros(body.tree.dimension)
    for name, value in angles.items():
        joint, _, axis = name.rpartition("_")
        found[body.tree.coordinate_names.index(f"{joint}.{axis}")] = value
    return found


@pytest.mark.full
def test_a_walk_has_the_angles_that_opensim_finds(data_dir: Path) -> None:
    """Marker sets and bodies differ: offsets of some degrees are theirs, signs and shapes of the curves are not."""
    folder = data_dir / "opensim_mocap"
    subject = recorded_subject(folder / "walking1.trc", frames="0:131:5")
    ours, theirs = values_of(subject.body, subject.states), read_mot(folder / "walking1_ik.mot")
    assert not theirs.in_degrees
    limbs = [
        f"{name}_{side}" for name in ("hip_flexion", "hip_adduction", "knee_angle", "arm_flex", "elbow_flex") for side in "rl"
    ]
    trunk = ["pelvis_list", "pelvis_rotation", "lumbar_bending", "lumbar_rotation", "arm_add_r", "arm_add_l"]
    for name in limbs + trunk:
        expected = np.rad2deg(theirs.columns[name][::5])
        assert np.corrcoef(ours[name], expected)[0, 1] > 0.94, name
        assert np.abs(ours[name] - expected).mean() < 6.5, name
    for name, bound in (("pelvis_tx", 0.1), ("pelvis_ty", 0.05), ("pelvis_tz", 0.05)):
        assert np.abs(ours[name] - theirs.columns[name][::5]).max() < bound, name


@pytest.mark.parametrize("side", ["r", "l"])
def test_what_is_positive(side: str) -> None:
    body, mirror = full_body(), 1.0 if side == "r" else -1.0
    moved = values_of(
        body,
        state(
            body, **{f"hip_{side}_X": 0.3, f"knee_{side}_X": -0.5, f"elbow_{side}_X": 0.7, f"shoulder_{side}_Y": mirror * 0.2}
        ),
    )
    expected = {"hip_flexion": 0.3, "knee_angle": 0.5, "elbow_flex": 0.7, "arm_add": 0.2, "arm_flex": 0.0, "hip_rotation": 0.0}
    for name, value in expected.items():
        np.testing.assert_allclose(moved[f"{name}_{side}"], np.rad2deg(value), atol=1e-3, err_msg=name)


def test_angles_make_the_rotations_again() -> None:
    """R_Z(flexion) R_X(adduction) R_Y(rotation) in OpenSim's axes is the thigh against the pelvis, for any pose."""
    body, rng = full_body(), np.random.default_rng(1)
    angles = rng.uniform(-1.2, 1.2, (20, 3))
    poses = np.stack([state(body, hip_r_Z=z, hip_r_Y=y, hip_r_X=x) for z, y, x in angles])
    found = values_of(body, poses)
    again = Rotation.from_euler(
        "ZXY", np.stack([found[f"hip_{part}_r"] for part in ("flexion", "adduction", "rotation")], 1), True
    )
    ours = Rotation.from_euler("ZYX", angles).as_matrix()
    forward_up_right = [1, 2, 0]
    np.testing.assert_allclose(again.as_matrix(), ours[:, forward_up_right][:, :, forward_up_right], atol=1e-5)


def test_the_ground_is_y_up() -> None:
    body = full_body()
    pose = state(body, spine_Z=-np.pi / 2, spine_tx=100.0, spine_ty=200.0, spine_tz=900.0)  # looks along the world's x
    found = values_of(body, pose)
    for name, value in {"pelvis_rotation": 0.0, "pelvis_tx": 0.1, "pelvis_ty": 0.9, "pelvis_tz": -0.2}.items():
        np.testing.assert_allclose(found[name], value, atol=1e-4, err_msg=name)


def test_each_coordinate_once() -> None:
    for body in (full_body(), darby_body(), arm()):
        names = [each.name for each in opensim_coordinates(body)]
        assert len(set(names)) == len(names)
    own = [each.name for each in opensim_coordinates(full_body()) if each.meaning.startswith("our own")]
    assert own == ["head.Z", "head.Y", "head.X", "girdle.Z"]
    own = [each.name for each in opensim_coordinates(darby_body()) if each.meaning.startswith("our own")]
    assert own == ["neck.Z", "neck.Y", "neck.X", *(f"clavicle_{side}.{axis}" for side in "lr" for axis in "ZY")]


def test_a_body_without_segments_keeps_its_names() -> None:
    body = full_body()._replace(segments={})
    found = values_of(body, state(body, spine_tx=1500.0, knee_r_X=-0.5))
    assert list(found) == list(body.tree.coordinate_names)
    np.testing.assert_allclose([found["spine.tx"][0], found["knee_r.X"][0]], [1.5, np.rad2deg(-0.5)], rtol=1e-5)


@pytest.mark.full
def test_angles_that_pass_half_a_turn() -> None:
    rng = np.random.default_rng(2)
    truth = np.linspace(150.0, 230.0, 9)
    draws = (truth[:, None] + rng.normal(0.0, 10.0, (4000, 9, 1)) + 180.0) % 360.0 - 180.0
    mean, spread, (lower, upper) = circular_summary(draws, (0.05, 0.95))
    np.testing.assert_allclose(mean[:, 0], truth, atol=5 * 10 / 4000**0.5)  # five standard errors
    np.testing.assert_allclose(spread, 10.0, rtol=5 / 8000**0.5)
    np.testing.assert_allclose([(mean - lower)[:, 0], (upper - mean)[:, 0]], 16.45, atol=5 * 10 * 2.1 / 4000**0.5)
