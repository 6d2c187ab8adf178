"""The random walk's scales: a root of a second, so that no figure depends on the rate."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.run import frame_inputs
from poseppl.tracking import (
    TrackSettings,
    observe_motion,
    place_cameras,
    pose_problem,
    problem_of_result,
    track,
    walking_subject,
)
from poseppl.tracking.walk import SIGMA_ANGLE, SIGMA_POSITION, step_scales, time_steps

ARM = "poseppl_models.choo_fleet:arm"


def scene_of(rate: float, frames: str, model: str = ARM):
    subject = walking_subject(model, frames=frames, rate=rate)
    return observe_motion(subject, place_cameras(subject.markers[:, 0], 0.0), ("camera",))


def variance_of_a_second(problem) -> np.ndarray:
    """Sum of the covariances of the steps that the program makes after the first frame."""
    inputs = [frame_inputs(problem.inputs, frame) for frame in range(1, len(problem.observations.values["points"]))]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *inputs)
    moments = jax.vmap(problem.model.transition_moments, (None, 0))
    return np.asarray(jnp.diagonal(moments(jnp.zeros(problem.model.dimension), stacked)[1].sum(0)))


@pytest.mark.parametrize(("rate", "frames"), [(30.0, "0:31"), (60.0, "0:61"), (120.0, "0:121"), (120.0, "0:121:8")])
def test_the_motion_of_a_second_has_one_variance_at_any_rate(rate: float, frames: str) -> None:
    scene = scene_of(rate, frames)
    np.testing.assert_allclose(variance_of_a_second(pose_problem(scene)), SIGMA_ANGLE**2, rtol=1e-4)
    a_frame = scene._replace(rate=30.0)  # 0.15 radians a frame, whatever the rate
    wrong = variance_of_a_second(pose_problem(a_frame))
    assert (len(scene.points) == 31) == np.allclose(wrong, SIGMA_ANGLE**2, rtol=1e-4)


def test_at_30_hz_the_steps_are_the_published_ones() -> None:
    scene = scene_of(30.0, "0:4", "poseppl_models.choo_fleet:full_body")
    steps = pose_problem(scene).record()["step_scale"]
    np.testing.assert_allclose(steps, np.tile(np.where(np.arange(28) < 3, 15.0, 0.15), (4, 1)), rtol=1e-6)
    assert np.array([SIGMA_POSITION, SIGMA_ANGLE]) == pytest.approx([82.158, 0.82158], rel=1e-4)


def test_steps_over_gaps_are_wider() -> None:
    np.testing.assert_allclose(time_steps([7], 50.0), [0.02])
    np.testing.assert_allclose(time_steps([3, 5, 7, 13, 15], 10.0), [0.1, 0.1, 0.1, 0.3, 0.1])
    np.testing.assert_allclose(time_steps([0, 1], None), [1 / 30, 1 / 30])
    scene = scene_of(30.0, "0:4")
    gap = scene._replace(frames=np.array([0, 1, 5, 6]))
    steps = pose_problem(gap).record()["step_scale"]
    np.testing.assert_allclose(steps / steps[0], np.tile([[1], [1], [2], [1]], (1, 4)), rtol=1e-6)
    whole = step_scales(scene.body, {"sigma_position": 10.0, "sigma_angle": 2.0}, [0.25, 1.0])
    np.testing.assert_allclose(whole[:, [0, 2, 3, 27]], [[5, 5, 1, 1], [10, 10, 2, 2]])


def test_the_scales_that_are_asked_for_are_used_recorded_and_smoothed_with() -> None:
    """Where nothing is seen, the variance grows by that of the steps; the first frame is seen."""
    scene = scene_of(60.0, "0:5")
    scene.points[1:] = np.nan
    draws = 4000
    settings = TrackSettings(ARM, "extended-kalman", {"particles": draws}, sigma_angle=0.6)
    tree = track(scene, settings)
    expected = 0.6 / np.sqrt(60.0)
    assert tree["inputs/step_scale"].dims == ("frame", "dof")
    np.testing.assert_allclose(tree["inputs/step_scale"], expected, rtol=1e-6)
    variance = tree["summary/state_sd"].values ** 2
    grown = (variance[4] - variance[0]) / 4
    np.testing.assert_allclose(grown, expected**2, atol=5 * np.sqrt(2 / draws) * (variance[0] + variance[4]).max() / 4)
    assert np.all(np.abs(grown / (SIGMA_ANGLE**2 / 60.0) - 1) > 0.3)  # of the scales that nobody asked for
    problem = problem_of_result(tree)
    np.testing.assert_allclose(problem.record()["step_scale"], expected, rtol=1e-6)
    np.testing.assert_allclose(variance_of_a_second(problem), 4 * expected**2, rtol=1e-5)
