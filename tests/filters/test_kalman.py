"""Kalman's filter and the Rauch-Tung-Striebel smoother: exact where they should be, approximate where they must be."""

from __future__ import annotations

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.stats
from law_problems import frame, problem, run
from oracles.kalman import kalman_filter as kalman_oracle, rauch_tung_striebel
from poseppl_models.toys.growth import growth
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

import poseppl
from poseppl.filters import kalman_filter
from poseppl.gaussians.gaussian import Gaussian, RootGaussian
from poseppl.gaussians.linearisation import linearise, predict
from poseppl.program import StateSpaceModel
from poseppl.smoothers import rauch_tung_striebel_smoother, smoothed_moments

POSED = problem()
KEY = jax.random.key(0)
VALUES = {"y": np.where(POSED.observations.mask["y"], POSED.observations.values["y"], np.nan)}
both = pytest.mark.parametrize("linearisation", ["first-order", "unscented"])


@both
def test_filter_is_exact_for_linear_gaussian_programs(linearisation):
    filter = kalman_filter(POSED.model, 10, linearisation=linearisation)
    states, infos = jax.jit(lambda key: run(filter, key, POSED.observations, POSED.inputs))(jax.random.key(0))
    np.testing.assert_allclose(states.posterior.mean, POSED.exact.means, atol=2e-6)
    np.testing.assert_allclose(states.posterior.covariance, POSED.exact.covariances, atol=2e-6)
    np.testing.assert_allclose(infos.log_evidence, POSED.exact.log_evidence, atol=5e-6)


def driven_by(a, q, params):
    """The oracle's log-evidence of a chain x_t = a x_(t-1) + N(0, q^2) in two dimensions, seen as a sum."""
    matrices = linear_gaussian_matrices(A=a * np.array([[1.0, 0.3], [-0.2, 0.8]]), Q=q**2 * np.eye(2), H=[[1.0, 1.0]])
    return kalman_oracle(matrices, *params).log_evidence.sum()


@pytest.mark.full
@both
@pytest.mark.parametrize("first", ["init", "before"])
def test_gradient_by_the_transition_parameters_equals_finite_differences(linearisation, first):
    ys, mask = np.array([[0.4], [1.9], [0.0], [-0.7], [1.1]]), np.array([[True], [True], [False], [True], [True]])

    def transition(params, state, inputs):
        mean = params["a"] * jnp.array([[1.0, 0.3], [-0.2, 0.8]]) @ state["x"]
        numpyro.sample("x", dist.Normal(mean, params["q"]).to_event(1))

    programs = linear_gaussian_model(linear_gaussian_matrices(A=np.eye(2), H=[[1.0, 1.0]]))
    point = {"a": jnp.asarray(0.9), "q": jnp.asarray(0.6)}
    model = StateSpaceModel(programs.initial, transition, programs.observation).compile(params=point)
    data = model.observe({"y": np.where(mask, ys, np.nan)})

    def log_evidence(params):
        filter = kalman_filter(model.with_params(params), 3, linearisation=linearisation)
        state, total = filter.initial_state(frame(data, 0)), 0.0
        for t in range(len(ys)):
            go = filter.init if t == 0 and first == "init" else partial(filter.step, state=state)
            state, info = go(jax.random.key(t), observation=frame(data, t))
            total = total + info.log_evidence
        return total

    value, slope = jax.jit(jax.value_and_grad(log_evidence))(point)
    step = 1e-5
    wanted = {
        "a": (driven_by(0.9 + step, 0.6, (ys, mask)) - driven_by(0.9 - step, 0.6, (ys, mask))) / (2 * step),
        "q": (driven_by(0.9, 0.6 + step, (ys, mask)) - driven_by(0.9, 0.6 - step, (ys, mask))) / (2 * step),
    }
    np.testing.assert_allclose(value, driven_by(0.9, 0.6, (ys, mask)), rtol=1e-5)
    for name, expected in wanted.items():
        np.testing.assert_allclose(slope[name], expected, rtol=1e-4)


@pytest.mark.full
def test_a_broken_state_does_not_begin_again():
    filter = kalman_filter(POSED.model, 5)
    state, _ = filter.init(jax.random.key(0), *POSED.at(0))
    broken = state._replace(joint=RootGaussian(state.posterior.mean, jnp.full((2, 2), jnp.nan)))
    after, info = filter.step(jax.random.key(0), broken, *POSED.at(1))
    assert info.failed and np.isnan(after.particles).all()


@cache
def dense_posterior():
    """Mean (T, d) and covariances of the smoothing distribution, from the joint density's Hessian, all frames at once."""
    shape = POSED.exact.means.shape

    def log_joint(flat):
        return POSED.model.log_joint(flat.reshape(shape), POSED.observations, POSED.inputs)

    zero = jnp.zeros(shape[0] * shape[1])
    slope, curvature = jax.jit(lambda x: (jax.grad(log_joint)(x), jax.hessian(log_joint)(x)))(zero)
    covariance = np.linalg.inv(-np.asarray(curvature, float))
    mean = (covariance @ np.asarray(slope)).reshape(shape)
    blocks = covariance.reshape(*shape, *shape)
    return mean, np.stack([blocks[t, :, t] for t in range(shape[0])])


@both
def test_smoother_is_exact_for_linear_gaussian_programs(linearisation):
    mean, covariances = dense_posterior()
    found = smoothed_moments(POSED.model, POSED.observations, POSED.inputs, linearisation=linearisation)
    np.testing.assert_allclose(found.mean, mean, atol=5e-6)
    np.testing.assert_allclose(found.covariance, covariances, atol=5e-6)


def test_drawn_trajectories_have_the_smoothed_moments():
    mean, covariances = dense_posterior()
    smoother = rauch_tung_striebel_smoother(POSED.model, num_draws=20_000)
    draws = smoother.smooth(jax.random.key(0), None, POSED.observations, POSED.inputs).particles
    error = np.sqrt(np.asarray(jnp.diagonal(covariances, axis1=1, axis2=2)) / 20_000)
    assert np.abs((draws.mean(1) - mean) / error).max() < 5
    spread = jax.vmap(lambda x: jnp.cov(x.T))(draws)
    assert np.abs(spread - covariances).max() < 5 * np.sqrt(2 / 20_000) * np.abs(covariances).max()


def test_summaries_of_gaussians_are_those_of_the_formula():
    """Quantiles of their draws have an error of 3 %."""
    result = poseppl.infer(POSED.model, VALUES, kalman_filter, KEY, POSED.inputs)
    smoothed = poseppl.smooth(result, rauch_tung_striebel_smoother(POSED.model), KEY, inputs=POSED.inputs)
    for told, (means, covariances) in ((result, POSED.exact[:2]), (smoothed, dense_posterior())):
        summary, deviations = told["summary"], np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        np.testing.assert_allclose(summary["state_mean"], means, atol=5e-6)
        np.testing.assert_allclose(summary["x_sd"], deviations, atol=5e-6)
        ends = means + scipy.stats.norm.ppf(0.95) * deviations
        np.testing.assert_allclose(summary["state_quantile"].sel(quantile=0.95), ends, atol=1e-5)
        assert np.abs(told["unconstrained_posterior/state"].mean(("chain", "draw")) - means).max() > 1e-3


def test_one_frame_and_no_data():
    observations = jax.tree.map(lambda leaf: leaf[2:3], POSED.observations)
    found = smoothed_moments(POSED.model, observations, POSED.inputs[2:3])
    mean, covariance = POSED.model.initial_moments(POSED.inputs[2])
    np.testing.assert_allclose(found.mean[0], mean, atol=1e-6)
    np.testing.assert_allclose(found.covariance[0], covariance, atol=1e-6)


@pytest.mark.full
def test_sigma_points_see_what_a_tangent_does_not():
    """E[x^2] of x ~ N(0, 4) is 4; the tangent at 0 is flat."""
    start = Gaussian(jnp.zeros(1), 4.0 * jnp.eye(1))

    def squared(x):
        return x**2, jnp.eye(1)

    assert predict(start, linearise(squared, start, "first-order")).mean[0] == 0
    unscented = predict(start, linearise(squared, start, "unscented"))
    np.testing.assert_allclose(unscented.mean, [4.0], rtol=1e-5)
    np.testing.assert_allclose(unscented.covariance, [[2 * 16.0 + 1.0]], rtol=1e-5)


@pytest.mark.full
@both
def test_nonlinear_programs_run(linearisation):
    model = growth().compile(jnp.float32(1.0))
    filter = kalman_filter(model, 5, linearisation=linearisation)
    observations = model.observe({"y": np.array([4.0, np.nan, 1.0])})
    states, infos = run(filter, jax.random.key(0), observations, jnp.arange(1.0, 4.0))
    assert np.isfinite(np.asarray(states.particles)).all()
    assert not np.asarray(infos.failed).any()


@pytest.mark.full
def test_a_likelihood_without_moments_is_refused():
    def heavy(params, state, inputs):
        numpyro.sample("y", dist.StudentT(3.0, state["x"], 1.0))

    def start(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def move(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"], 1.0))

    model = StateSpaceModel(start, move, heavy).compile()
    observations = model.observe({"y": 0.3})
    with pytest.raises(ValueError, match="site 'y'"):
        kalman_filter(model, 5).init(jax.random.key(0), observations)


def test_settings_are_checked():
    with pytest.raises(ValueError, match="linearisation is 'third'"):
        kalman_filter(POSED.model, linearisation="third")
    with pytest.raises(ValueError, match="num_draws is 0"):
        rauch_tung_striebel_smoother(POSED.model, num_draws=0)


def test_sigma_points_average_a_noise_that_depends_on_the_state():
    """E[0.1 + x^2] of x ~ N(1, 4) is 5.1; at the mean alone it is 1.1."""
    start = Gaussian(jnp.ones(1), 4.0 * jnp.eye(1))

    def noisy(x):
        return x, (0.1 + x**2)[:, None]

    np.testing.assert_allclose(linearise(noisy, start, "unscented").noise, [[5.1]], rtol=1e-5)
    np.testing.assert_allclose(linearise(noisy, start, "first-order").noise, [[1.1]], rtol=1e-5)


LOCAL_TREND = [[1.0, 1.0], [0.0, 1.0]], np.diag([0.1, 0.01]), [[1.0, 0.0]]
SEASONAL = (
    [[1.0, 0, 0, 0], [0, -1, -1, -1], [0, 1, 0, 0], [0, 0, 1, 0]],
    np.diag([0.1, 0.05, 0.0, 0.0]),
    [[1.0, 1.0, 0.0, 0.0]],
)
ACCELERATED = [[1.0, 1.0, 0.5], [0, 1, 1], [0, 0, 1]], 0.01 * np.eye(3), [[1.0, 0.0, 0.0]]
DIFFUSE = 1e8


def diffuse_problem(A, Q, H):
    """A model of a start of variance 10^8, data of 20 frames, and their matrices."""
    A, H, dimension = np.array(A), np.array(H), len(A)

    def start(params, inputs):
        numpyro.sample("x", dist.Normal(jnp.zeros(dimension), DIFFUSE**0.5).to_event(1))

    def move(params, state, inputs):
        mean, deviation = jnp.asarray(A) @ state["x"], jnp.sqrt(jnp.asarray(np.diagonal(Q)))
        numpyro.sample("x", dist.Normal(mean, deviation, validate_args=False).to_event(1))

    def observe(params, state, inputs):
        numpyro.sample("y", dist.Normal(jnp.asarray(H) @ state["x"], 1.0))

    rng, x, ys = np.random.default_rng(0), np.full(dimension, 5.0), []
    for _ in range(20):
        x = A @ x + np.sqrt(np.diagonal(Q)) * rng.normal(size=dimension)
        ys.append(H @ x + rng.normal(size=1))
    matrices = linear_gaussian_matrices(A=A, Q=Q, H=H, R=np.eye(1), P=DIFFUSE * np.eye(dimension))
    return StateSpaceModel(start, move, observe).compile(), np.array(ys), matrices


@pytest.mark.parametrize("matrices", [LOCAL_TREND, SEASONAL, ACCELERATED], ids=["trend", "seasonal", "accelerated"])
def test_a_diffuse_start_is_exact_in_float32(matrices):
    model, ys, exact = diffuse_problem(*matrices)
    result = poseppl.infer(model, {"y": ys}, kalman_filter(model, 10), KEY)
    wanted = kalman_oracle(exact, ys, np.ones(ys.shape, bool))
    deviations = np.sqrt(np.diagonal(wanted.covariances, axis1=1, axis2=2))
    assert result["summary/state_mean"].dtype == np.float32
    np.testing.assert_allclose((result["summary/state_mean"] - wanted.means) / deviations, 0.0, atol=2e-3)
    np.testing.assert_allclose(result["summary/state_sd"] / deviations, 1.0, rtol=2e-3)
    np.testing.assert_allclose(result["sample_stats/log_evidence"], wanted.log_evidence, atol=2e-3)


@pytest.mark.full
@pytest.mark.parametrize("matrices", [LOCAL_TREND, SEASONAL, ACCELERATED], ids=["trend", "seasonal", "accelerated"])
def test_smoothing_from_a_diffuse_start_is_exact_in_float32(matrices):
    model, ys, exact = diffuse_problem(*matrices)
    found = jax.jit(lambda data: smoothed_moments(model, data))(model.observe({"y": ys}))
    wanted_means, wanted_covariances = rauch_tung_striebel(exact, kalman_oracle(exact, ys))
    deviations = np.sqrt(np.diagonal(wanted_covariances, axis1=1, axis2=2))
    np.testing.assert_allclose((found.mean - wanted_means) / deviations, 0.0, atol=5e-3)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)) / deviations, 1.0, rtol=5e-3)
