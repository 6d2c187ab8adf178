"""The moving-window filter: its target from formulas, its smoothed frames, and what the window buys."""

from __future__ import annotations

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from law_problems import Problem, frame, independent, problem, run, z_scores
from oracles.grid import growth_on_grid
from oracles.kalman import kalman_filter, rauch_tung_striebel, simulate
from poseppl_models.toys.growth import growth
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

from poseppl.filters import Filter, window_filter
from poseppl.filters.window import WindowState, _pasts, predict
from poseppl.filters.window_target import empty_window, move_on, window_target
from poseppl.gaussians.linearisation import Gaussian
from poseppl.program import Observation

WINDOW = 3


def window_after(posed, num_frames, size=WINDOW):
    """The window once so many frames are in, with arbitrary predictions; returned with them (T, d), (T, d, d)."""
    rng = np.random.default_rng(0)
    means = rng.normal(size=(num_frames, 2))
    factors = rng.normal(size=(num_frames, 2, 2))
    covariances = factors @ factors.transpose(0, 2, 1) + np.eye(2)
    means[0], covariances[0] = posed.matrices.m, posed.matrices.P
    window = empty_window(posed.model, size, frame(posed.inputs, 0))
    for t in range(num_frames):
        prediction = Gaussian(jnp.asarray(means[t], jnp.float32), jnp.asarray(covariances[t], jnp.float32))
        window = move_on(window, prediction, *posed.at(t))
    return window, means, covariances


def log_window(posed, xs, begin, mean, covariance):
    """The density of frames begin, begin + 1, ... by the formula, one term at a time."""
    A, Q, H, R, _, _, B = posed.matrices
    normal = scipy.stats.multivariate_normal.logpdf
    total = normal(xs[0], mean, covariance)
    for step, x in enumerate(xs):
        t = begin + step
        if step > 0:
            total += normal(x, A @ xs[step - 1] + B @ np.asarray(posed.inputs[t]), Q)
        seen = np.asarray(posed.observations.mask["y"][t])
        if seen.any():
            data = np.asarray(posed.observations.values["y"][t])
            total += normal(data[seen], (H @ x)[seen], R[np.ix_(seen, seen)])
    return total


@jax.jit
def evaluate(window, xs):
    """Densities of flat windows (S, W d); curvature of the first one, and minus its Hessian."""
    target = window_target(problem().model, window)
    curvature = target.prior_precision + target.information(xs[0])
    return jax.vmap(target.log_density)(xs), curvature, -jax.hessian(target.log_density)(xs[0])


@pytest.mark.full
@pytest.mark.parametrize("num_frames", [1, 2, 3, 4, 5])
def test_target_is_the_joint_density_of_the_window(num_frames):
    """Also while it fills up: its empty slots are then independent of the rest."""
    posed = problem()
    window, means, covariances = window_after(posed, num_frames)
    held = min(num_frames, WINDOW)
    begin = num_frames - held
    xs = np.random.default_rng(1).normal(size=(4, WINDOW, 2))
    expected = [log_window(posed, x[WINDOW - held :], begin, means[begin], covariances[begin]) for x in xs]
    empty = xs[:, : WINDOW - held]
    expected += scipy.stats.multivariate_normal.logpdf(empty, means[0], covariances[0]).reshape(4, -1).sum(1)
    found, curvature, hessian = evaluate(window, jnp.asarray(xs.reshape(4, -1), jnp.float32))
    np.testing.assert_allclose(found, expected, rtol=2e-5)
    np.testing.assert_allclose(curvature, hessian, rtol=1e-4, atol=1e-4)


def slow_problem(num_frames=9):
    """A state that hardly moves behind much noise, so that every frame's data matter to the frames around it."""
    matrices = linear_gaussian_matrices(1, A=[[0.98]], Q=[[0.02]], R=[[1.0]])
    inputs = jnp.zeros((num_frames, 1))
    _, ys = simulate(matrices, num_frames, seed=3)
    model = linear_gaussian_model(matrices).compile(inputs[0])
    return Problem(matrices, model, model.observe({"y": ys}), inputs, kalman_filter(matrices, ys))


@cache
def last_window(*, twice=False):
    """Means (40, W, 1) and variances (40, W) of the last window's frames, for 40 runs."""
    posed = slow_problem()
    built = window_filter(posed.model, 60, window=WINDOW, num_starts=4)
    filter_ = counting_twice(posed.model, built) if twice else built

    def one(rng_key):
        states, _ = run(filter_, rng_key, posed.observations, posed.inputs)
        draws = states.trajectories[-1].reshape(-1, WINDOW)
        return jnp.mean(draws, 0), jnp.var(draws, 0)

    found = independent(one, 40)
    return [np.asarray(part, float) for part in found]


def counting_twice(model, built):
    """The filter whose summary is made from the window's own draws, which have seen the data of the window."""

    def step(rng_key, state, observation, inputs):
        window = state.window
        wrong = predict(model, state.trajectories[:, :, 0], frame(window.inputs, 1))
        full = window.num_frames >= WINDOW
        predictions = jax.tree.map(lambda old, new: old.at[1].set(jnp.where(full, new, old[1])), window.predictions, wrong)
        return built.step(rng_key, state._replace(window=window._replace(predictions=predictions)), observation, inputs)

    return Filter(built.init, step)


@pytest.mark.slow
def test_the_window_is_a_fixed_lag_smoother():
    """Its newest frame is Kalman's, its older ones are those of a Rauch-Tung-Striebel pass over the data so far."""
    posed = slow_problem()
    means, covariances = rauch_tung_striebel(posed.matrices, posed.exact)
    found, variances = last_window()
    assert np.abs(z_scores(found, means[-WINDOW:, 0])).max() < 5
    # the filtered mean of its oldest frame is another
    assert abs(z_scores(found, posed.exact.means[-WINDOW:, 0])[0]) > 10
    # a variance estimated in each run is that of the draws about their own mean: its error falls with their number
    np.testing.assert_allclose(variances.mean(0), covariances[-WINDOW:, 0, 0], rtol=0.03)


@pytest.mark.slow
def test_data_that_count_twice_are_noticed():
    """A summary that has seen the window's data makes the filter sure of itself."""
    exact = slow_problem().exact.covariances[-1, 0, 0]
    _, variances = last_window(twice=True)
    assert variances[:, -1].mean() < 0.8 * exact
    assert z_scores(variances[:, -1], exact) < -20


def growth_errors(size, ys, exact):
    """Mean squared distance (S,) of filtered means from the exact ones (S, T), for series ys (S, T)."""
    model, times = growth().compile(1.0), jnp.arange(1.0, ys.shape[1] + 1)
    built = window_filter(model, 20, window=size, num_starts=10)

    def one(row):
        rng_key, y = row
        states, _ = run(built, rng_key, Observation({"y": y}, {"y": jnp.ones(y.shape, bool)}), times)
        return jnp.mean(states.particles, (1, 2, 3))

    keys = jax.random.split(jax.random.key(0), len(ys))
    means = np.asarray(jax.jit(lambda rows: jax.lax.map(one, rows))((keys, jnp.asarray(ys, jnp.float32))), float)
    return ((means - exact) ** 2).mean(1)


def growth_means(ys):
    """Exact filtered means (S, T) of series ys (S, T)."""
    solved = [growth_on_grid(y, num_points=601)[:2] for y in ys]
    return np.array([filtered @ grid for grid, filtered in solved])


def growth_series(count, num_frames, seed=0):
    rng = np.random.default_rng(seed)
    x, ys = rng.normal(size=count) * 10**0.5, []
    for t in range(1, num_frames + 1):
        if t > 1:
            x = x / 2 + 25 * x / (1 + x**2) + 8 * np.cos(1.2 * t) + 10**0.5 * rng.normal(size=count)
        ys.append(x**2 / 20 + rng.normal(size=count))
    return np.stack(ys, 1)


@pytest.mark.slow
def test_a_window_comes_nearer_to_the_truth_of_a_nonlinear_model():
    ys = growth_series(32, 20)
    exact = growth_means(ys)
    gain = growth_errors(1, ys, exact) - growth_errors(WINDOW, ys, exact)
    # paired over series, some of which W = 1 loses altogether: with 24 of them the mean is already within two standard errors
    assert gain.mean() > 2 * gain.std(ddof=1) / np.sqrt(len(gain))


@pytest.mark.full
def test_numbers_out_of_range_are_refused():
    with pytest.raises(ValueError, match="at least 1"):
        window_filter(problem().model, window=0)
    with pytest.raises(ValueError, match="at least 1"):
        window_filter(problem().model, 0)


def test_pasts_that_are_moved_lead_to_the_newest_state():
    """Every other past is an unchanged trajectory; the rest are moved so that the transition's mean is the newest state."""
    matrices = linear_gaussian_matrices(2, A=np.eye(2))
    model = linear_gaussian_model(matrices).compile()
    trajectories = jax.random.normal(jax.random.key(0), (4, 5, 3, 2))
    newest = jax.random.normal(jax.random.key(1), (6, 2))
    past = WindowState(trajectories[:, :, -1], jnp.zeros((4, 5)), jnp.zeros(()), trajectories, None)
    pasts = np.asarray(_pasts(model, jax.random.key(2), past, newest, None))
    known = np.asarray(trajectories.reshape(20, 3, 2))
    assert pasts.shape == (6, 2, 2)
    for number, found in enumerate(pasts):
        if number % 2:
            np.testing.assert_allclose(found[-1], newest[number], rtol=1e-5)
        shape = found - found[-1]
        near = np.abs(known[:, 1:] - known[:, -1:] - shape).max((1, 2)).argmin()
        np.testing.assert_allclose(known[near, 1:] - known[near, -1], shape, atol=1e-5)
        assert number % 2 or np.allclose(found, known[near, 1:])
