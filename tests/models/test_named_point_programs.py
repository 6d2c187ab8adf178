"""Named points' programs: exact transitions, and nothing that depends on how many frames a second there are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.named_points import motion_transition
from scipy.linalg import expm

from poseppl.compilation import double_precision
from poseppl.motion.geometry import join_cameras, look_at, project
from poseppl.motion.points.fit import points_mode, value_and_gradient
from poseppl.motion.points.named_points import PointRecording, make_point_problem, places_of
from poseppl.program.parameters import parameter_bijector

pytestmark = pytest.mark.full


@pytest.fixture(autouse=True)
def _double_precision() -> Iterator[None]:
    with double_precision():
        yield


@pytest.mark.parametrize("elapsed", [1e-4, 0.0099, 0.0101, 0.3, 5.0])
def test_the_transition_is_that_of_the_process_in_continuous_time(elapsed: float) -> None:
    """Van Loan's matrix exponential gives the mean and the covariance of any linear stochastic equation."""
    tau = 0.5
    drift, spread = np.array([[0, 1], [0, -1 / tau]]), np.diag([0, 2 / tau])
    whole = expm(np.block([[-drift, spread], [np.zeros((2, 2)), drift.T]]) * elapsed)
    mean, lower = motion_transition(jnp.asarray(elapsed), jnp.asarray(tau))
    assert np.allclose(mean, whole[2:, 2:].T, rtol=1e-10)
    covariance = whole[2:, 2:].T @ whole[:2, 2:]
    assert np.allclose(np.asarray(lower @ lower.T) / covariance, 1.0, rtol=1e-6 if elapsed > 0.001 else 0.01)


def recording(rate: float, num_frames: int) -> PointRecording:
    """Two points that move on curves, in two cameras, seen 30 times a second."""
    times = np.arange(num_frames) / rate
    cameras = join_cameras([look_at((3000.0, 0, 300), (0, 0, 0), 900.0), look_at((0.0, 3000, 0), (0, 0, 0), 900.0)])
    places = np.array([[10.0, 20, 30], [-40, 0, 90]]) + 200 * np.sin(3 * times[:, None, None] + np.arange(3))
    points = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places))), 0, 1).copy()
    points[~np.isclose(times * 30 % 1, 0) & ~np.isclose(times * 30 % 1, 1)] = np.nan
    sure, frames = np.full(points.shape[:3], 0.9), np.arange(num_frames)
    return PointRecording(("a", "b"), ("x", "y"), cameras, np.full((2, 2), 1e3), points, sure, frames, times, rate, "")


@pytest.mark.full
def test_twice_the_frames_a_second_change_nothing() -> None:
    """Frames between, in which nothing was seen, change not the evidence, its gradient or the other frames' places."""
    found: list[Any] = []
    for rate, num_frames in ((30.0, 5), (60.0, 9)):
        problem = make_point_problem(recording(rate, num_frames))
        names = parameter_bijector(problem.whole)
        params = problem.whole.sample_parameters(jax.random.key(0))
        mode = points_mode(problem, params)
        value, gradient = value_and_gradient(
            problem.model, problem.whole, names.to_flat(params), mode, problem.observations, problem.inputs
        )
        places = problem.frame.to_world(places_of(problem.model, mode[:, :: int(rate / 30)]))
        found.append((float(value), np.asarray(gradient), places))
    (value, gradient, places), (other, its_gradient, its_places) = found
    assert np.isclose(value, other, rtol=1e-7)  # as close as the climbs come to their modes
    assert np.allclose(gradient, its_gradient, rtol=1e-5)
    assert np.allclose(places, its_places, atol=1e-3)
