"""Variational smoothing against exact answers: evidence, moments, the mean field's variances, and verdicts where it is bad."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl import infer, smooth
from poseppl.diagnostics import approximation_figures, diagnose, verdicts
from poseppl.filters import kalman_filter, particle_filter
from poseppl.gaussians.block_tridiagonal import (
    BlockTridiagonal,
    block_cholesky,
    marginal_covariances,
    multiply,
    to_dense,
)
from poseppl.gaussians.trajectory_distribution import TrajectoryNormal
from poseppl.program import StateSpaceModel
from poseppl.smoothers import laplace_smoother, rauch_tung_striebel_smoother, variational_smoother
from poseppl.smoothers.laplace import TrajectoryGaussian
from poseppl.smoothers.variational import SVISettings, fit_guide, markov_guide, mean_field_guide

SETTINGS = SVISettings(400, 10, 0.1)
UNITS = jnp.array([1.0, 1000.0])
"""Scales of the two coordinates: millimetres beside radians."""


def target() -> tuple[jax.Array, BlockTridiagonal]:
    """Mean and precision of a Gaussian trajectory of four frames in unequal units."""
    own, beside = jnp.array([[3.0, 0.5], [0.5, 2.0]]), jnp.array([[-1.0, 0.3], [0.0, -0.6]])
    scales = jnp.outer(1 / UNITS, 1 / UNITS)
    mean = jnp.arange(8.0).reshape(4, 2) * UNITS
    return mean, BlockTridiagonal(jnp.tile(own * scales, (4, 1, 1)), jnp.tile(beside * scales, (3, 1, 1)))


def far_start() -> TrajectoryGaussian:
    """One without dependence between frames, a standard deviation away and twice as wide."""
    mean, precision = target()
    apart = precision._replace(diagonal=precision.diagonal / 4, below=jnp.zeros_like(precision.below))
    return TrajectoryGaussian(mean + UNITS, block_cholesky(apart), jnp.zeros((), int))


def fitted(family: Any) -> tuple[TrajectoryNormal, np.ndarray]:
    mean, precision = target()
    guide, params = family(far_start())

    def log_density(xs: jax.Array) -> jax.Array:
        return -0.5 * jnp.sum((xs - mean) * multiply(precision, xs - mean))

    params, bound = jax.jit(lambda key: fit_guide(key, log_density, guide, params, SETTINGS))(jax.random.key(0))
    return guide(params), np.asarray(bound)


def test_the_density_of_a_trajectory_is_that_of_the_dense_gaussian() -> None:
    mean, precision = target()
    nearest = TrajectoryNormal(mean, block_cholesky(precision))
    xs = mean + UNITS * jax.random.normal(jax.random.key(0), (3, 4, 2))
    dense = dist.MultivariateNormal(mean.ravel(), precision_matrix=to_dense(precision))
    np.testing.assert_allclose(nearest.log_prob(xs), dense.log_prob(xs.reshape(3, -1)), rtol=2e-4)


@pytest.mark.full
def test_the_structured_guide_finds_a_gaussian_from_afar() -> None:
    """Mean, variances and the log-integral; without noise at the end, for the gradient has none there."""
    mean, precision = target()
    nearest, bound = fitted(markov_guide)
    exact, found = marginal_covariances(block_cholesky(precision)).own, marginal_covariances(nearest.factor).own
    np.testing.assert_allclose((nearest.loc - mean) / UNITS, 0.0, atol=0.01)
    np.testing.assert_allclose(found / exact, 1.0, rtol=0.03)
    integral = 0.5 * mean.size * np.log(2 * np.pi) - 0.5 * float(block_cholesky(precision).log_det)
    np.testing.assert_allclose(bound[-1], integral, atol=0.02)
    assert bound[0] < integral - 1


@pytest.mark.full
def test_the_mean_field_has_the_variances_of_its_formula() -> None:
    """1 / P_ii, and the bound is below the log-integral by half the log-determinant of the precision's correlations."""
    mean, precision = target()
    nearest, bound = fitted(mean_field_guide)
    curvature = np.diagonal(np.asarray(precision.diagonal), axis1=1, axis2=2)
    variance = np.diagonal(np.asarray(marginal_covariances(nearest.factor).own), axis1=1, axis2=2)
    np.testing.assert_allclose(variance * curvature, 1.0, atol=0.1)
    np.testing.assert_allclose((nearest.loc - mean) / UNITS, 0.0, atol=0.1)
    exact = np.diagonal(np.asarray(marginal_covariances(block_cholesky(precision)).own), axis1=1, axis2=2)
    assert (variance < exact).all()
    reached = 0.5 * mean.size * np.log(2 * np.pi) - 0.5 * np.log(curvature).sum()
    last = bound[-100:]
    assert abs(last.mean() - reached) < 5 * last.std() / 10 + 0.05


@pytest.fixture(scope="module")
def linear() -> Any:
    """A filtered linear Gaussian series with gaps, its smoother's exact result, and its evidence."""
    model = linear_gaussian(2, 1).compile()
    data = np.cumsum(np.random.default_rng(0).normal(size=(12, 1)), axis=0)
    data[3:5] = np.nan
    filtered = infer(model, {"y": data}, kalman_filter(model), jax.random.key(0))
    exact = smooth(filtered, rauch_tung_striebel_smoother(model), jax.random.key(1))
    return model, filtered, exact, float(filtered["sample_stats"]["log_evidence"].sum())


@pytest.mark.full
@pytest.mark.parametrize("family", ["markov", "mean-field"])
def test_the_bound_is_the_evidence_or_below(linear: Any, family: str) -> None:
    model, filtered, exact, evidence = linear
    found = smooth(filtered, variational_smoother(model, family=family, num_steps=100), jax.random.key(1))
    figures = approximation_figures(found)
    of_draws = found["approximation"]["log_ratio"].values
    if family == "mean-field":
        assert figures.bound < evidence - 1 and figures.bound + 5 * figures.bound_error < evidence
        return
    assert abs(figures.bound - evidence) < 1e-3 and of_draws.std() < 1e-2 and figures.pareto_k == 0
    for name in ("state_mean", "state_sd"):
        np.testing.assert_allclose(found["summary"][name], exact["summary"][name], rtol=2e-3, atol=2e-3)
    assert not [verdict for verdict in verdicts(diagnose(found)) if "Pareto" in verdict.text]


def volatility() -> StateSpaceModel:
    """A positive state of large scale whose data are Poisson: skewed, with a mode far from the mean."""

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("rate", dist.LogNormal(0.0, 1.0))

    def transition(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("rate", dist.LogNormal(jnp.log(state["rate"]), 1.0))

    def observation(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("y", dist.Poisson(state["rate"]))

    return StateSpaceModel(initial, transition, observation)


def filtered_counts() -> Any:
    model = volatility().compile()
    counts = np.array([0.0, 0.0, np.nan, 1.0, 0.0, 0.0])
    return model, infer(model, {"y": counts}, particle_filter(model, 3000), jax.random.key(0))


@pytest.mark.full
def test_a_positive_state_is_nearer_than_laplaces() -> None:
    """The bound of the variational Gaussian is above that of Laplace's, and below the evidence of 3,000 particles."""
    model, filtered = filtered_counts()
    found = smooth(filtered, variational_smoother(model, num_draws=2000), jax.random.key(1))
    start = smooth(filtered, variational_smoother(model, num_draws=2000, num_steps=0), jax.random.key(1))
    laplace = smooth(filtered, laplace_smoother(model), jax.random.key(1))
    np.testing.assert_allclose(start["summary"]["state_mean"], laplace["summary"]["state_mean"], atol=1e-4)
    best, first = approximation_figures(found), approximation_figures(start)
    evidence = float(filtered["sample_stats"]["log_evidence"].sum())
    assert best.bound > first.bound + 4 * np.hypot(best.bound_error, first.bound_error)
    assert best.bound < evidence + 0.1 and best.bound > evidence - 0.5
    assert (found["posterior"]["rate"].values > 0).all()


@pytest.mark.full
def test_a_mean_field_of_a_strongly_dependent_state_is_a_verdict() -> None:
    model = linear_gaussian(2, 1, R=100.0 * np.eye(1)).compile()
    filtered = infer(model, {"y": np.zeros((40, 1))}, kalman_filter(model), jax.random.key(0))
    found = smooth(filtered, variational_smoother(model, family="mean-field", num_steps=100), jax.random.key(1))
    assert approximation_figures(found).pareto_k > 0.7
    assert [verdict for verdict in verdicts(diagnose(found)) if "Pareto" in verdict.text]


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"family": "full"}, "family"),
        ({"start": "zero"}, "start"),
        ({"num_samples": 0}, "num_samples"),
        ({"learning_rate": 0.0}, "learning_rate"),
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(settings: Any, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        variational_smoother(linear_gaussian(2, 1).compile(), **settings)


def test_integer_states_are_refused() -> None:
    with pytest.raises(ValueError, match="discrete.*particle_gibbs_smoother"):
        variational_smoother(finite_hmm().compile())
