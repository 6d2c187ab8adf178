"""A detector's errors are what cameras do not agree upon, however the points move."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.named_points import CAMERA_SCALE

from poseppl.compilation import double_precision
from poseppl.motion.geometry import join_cameras, look_at, project
from poseppl.motion.io.skeleton_files import Link, Skeleton
from poseppl.motion.points.fit import PointParams, fit_points, points_mode, prior_moments
from poseppl.motion.points.linked_points import linked_draws
from poseppl.motion.points.named_points import FREEDOM, PointRecording, make_point_problem
from poseppl.program.parameters import parameter_bijector

NUM_FRAMES, NUM_POINTS = 80, 4
ERROR, STEP = 1.0, 4.0
"""Standard deviations, px, of a detector's errors, and of a point's step from frame to frame."""


def rough_walk(seed: int) -> PointRecording:
    """Points that walk at random, which no velocity foresees, in two cameras; errors are independent."""
    rng = np.random.default_rng(seed)
    cameras = join_cameras([look_at((3000.0, 0, 300), (0, 0, 0), 900.0), look_at((0.0, 3000, 0), (0, 0, 0), 900.0)])
    places = np.cumsum(rng.normal(size=(NUM_FRAMES, NUM_POINTS, 3)), 0) * STEP * 3000 / 900
    points = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places))), 0, 1)
    points = points + ERROR * rng.normal(size=points.shape)
    frames = np.arange(NUM_FRAMES)
    return PointRecording(
        tuple("abcd"),
        ("x", "y"),
        cameras,
        np.full((2, 2), 1e3),
        points,
        np.full(points.shape[:3], 0.95),
        frames,
        frames / 30,
        30.0,
        "",
    )


@pytest.fixture(scope="module")
def fitted() -> PointParams:
    with double_precision():
        return fit_points(make_point_problem(rough_walk(0)), num_draws=400)


def deviation(params: Mapping[str, np.ndarray]) -> np.ndarray:
    """Standard deviation (...) of a coordinate's error, that of all points and cameras together."""
    share = FREEDOM / (FREEDOM - 2) + np.exp(2 * params["log_lasting"]) * (1 + np.exp(2 * params["log_bias"]))
    size = params["log_size"] + params["log_scale"].mean(-1) + params["camera"].mean(-1)
    return np.asarray(np.exp(size) * np.sqrt(share))


def test_motion_that_is_not_foreseen_is_no_error(fitted: PointParams) -> None:
    """Two cameras disagree in one of four coordinates: the deviation is known to within 1 / sqrt(2 T K)."""
    error = deviation({name: np.asarray(value) for name, value in fitted.params.items()})
    print(error, fitted.params)
    assert abs(np.log(error / ERROR)) < 4 / np.sqrt(2 * NUM_FRAMES * NUM_POINTS)


@pytest.mark.full
def test_draws_know_what_two_cameras_tell(fitted: PointParams) -> None:
    """How large errors are, and little of in which camera: the prior says that neither is much the worse.

    A little it tells by its approximation, not by the data: Laplace's of Student-t errors is not exact.
    """
    draws = {name: np.asarray(value) for name, value in fitted.draws.items()}
    assert draws["log_scale"].shape == (400, NUM_POINTS)
    apart = np.diff(draws["camera"]).std()
    assert 0.5 < apart / (np.sqrt(2) * CAMERA_SCALE) < 1 + 3 / np.sqrt(2 * 400)
    told = np.log(deviation(draws)).std() * np.sqrt(2 * NUM_FRAMES * NUM_POINTS)
    print(apart, told)
    assert 0.5 < told < 4
    for name in ("log_speed", "log_speed_lasts"):
        assert np.allclose(draws[name], fitted.params[name])


@pytest.mark.full
def test_linked_points_are_under_the_draws_of_params() -> None:
    """Errors are ten times as large in one of two draws, whose positions and lengths have larger variances."""
    few = rough_walk(0).of_frames(slice(0, 12))
    with double_precision():
        problem = make_point_problem(few)
        names = parameter_bijector(problem.whole)
        likeliest = names.to_params(jnp.asarray(prior_moments(problem.whole, names)[0]))
        draws = {name: jnp.stack([value, value]) for name, value in likeliest.items()}
        draws["log_size"] = draws["log_size"] + jnp.array([0.0, np.log(10)])
        skeleton = Skeleton(few.names, (Link((0, 2), None, None, 0.05),), ())
        found = PointParams(likeliest, draws)
        (group,) = linked_draws(problem, found, points_mode(problem, likeliest), skeleton, 100, 0)
    assert group.places.shape == (100, 12, 2, 3) and group.lengths.shape == (100, 1)
    spread = [(half.std(0)).mean() for half in np.split(group.places, 2)]
    assert spread[1] > 2 * spread[0], spread


@pytest.mark.slow
def test_a_single_frame_has_params() -> None:
    """No time passes in it, so that it has no speed."""
    with double_precision():
        found = fit_points(make_point_problem(rough_walk(0).of_frames(slice(0, 1))), num_draws=2, num_rounds=1, num_steps=2)
    assert all(np.isfinite(value).all() for kind in found for value in kind.values())
