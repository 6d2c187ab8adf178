"""The HMC filters against exact answers, beyond the laws that every filter obeys."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import independent, problem, replicate
from poseppl_models.bodies.choo_fleet import arm

from poseppl.filters import assumed_density_filter, hmc_filter
from poseppl.filters.chains import effective_draws
from poseppl.filters.window import covariance_inflation
from poseppl.kernels import HMCSettings
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import paper_camera
from poseppl.program import Clamped, Observation, clamp

SHORT = HMCSettings(num_updates=30, num_leapfrog=8, num_warmup=10)


@pytest.mark.slow
def test_mixture_of_more_chains_comes_closer_to_kalman():
    """At later frames the prior is a mixture of M states: its error falls with M, and is gone at the first frame."""
    posed = problem()
    errors = []
    for num_chains in (3, 12, 48):
        means, _, _ = replicate(hmc_filter(posed.model, num_chains, SHORT), posed, 20)
        errors.append(np.sqrt(((means - posed.exact.means)[:, 1:] ** 2).mean()))
    # root mean square error over runs falls as 1/sqrt(M): by 2 at each fourfold M, here asked to fall by 1.5
    assert errors[0] > 1.5 * errors[1] > 1.5**2 * errors[2]


def arm_scene():
    body = arm()
    truth = jnp.asarray(body.rest).at[body.tree.coordinate_names.index("elbow_r.X")].set(0.6)
    inputs = BodyInputs(
        paper_camera((0, -5000, 1000)), jnp.full((1, 17), body.noise), truth, *2 * (jnp.full(28, 0.15),), body.tree
    )
    full = body.program.compile(inputs=inputs, params=body.params)
    model = clamp(full, body.free_coordinates)
    clamped = Clamped(inputs, truth, truth)
    points = full.sample_observation(jax.random.key(7), truth, inputs)
    return model, Observation(points, {"points": jnp.ones(points["points"].shape, bool)}), clamped


def importance_moments(model, observation, inputs, num_blocks=100, block=100_000):
    """Mean and second moments of the first frame's posterior from ten million draws of the prior."""

    def one(rng_key):
        draws = jax.vmap(lambda k: model.sample_initial(k, inputs))(jax.random.split(rng_key, block))
        log_weights = jax.vmap(lambda x: model.log_observation(x, observation, inputs))(draws)
        weights = jnp.exp(log_weights - reference)
        features = jnp.concatenate([draws, draws**2], 1)
        return jnp.sum(weights), weights @ features

    reference = model.log_observation(model.initial_moments(inputs)[0], observation, inputs)
    totals, sums = independent(one, num_blocks, seed=1)
    totals, sums = np.asarray(totals, float), np.asarray(sums, float)
    mean = sums.sum(0) / totals.sum()
    residual = (sums - totals[:, None] * mean) / totals.mean()
    return mean, residual.std(0, ddof=1) / np.sqrt(num_blocks)


@pytest.fixture(scope="module")
def arm_reference():
    return importance_moments(*arm_scene())


def errors_of(state, reference):
    """Differences of the chains' first and second moments, in standard errors of both."""
    mean, standard_error = reference
    chains = np.asarray(state.particles, float)
    means = np.concatenate([chains, chains**2], -1).mean(1)
    return (means.mean(0) - mean) / np.hypot(means.std(0, ddof=1) / np.sqrt(len(means)), standard_error)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hmc", "assumed-density"])
def test_arm_agrees_with_ten_million_particles(name, arm_reference):
    model, observation, inputs = arm_scene()
    if name == "hmc":
        built = hmc_filter(model, 40, HMCSettings(num_updates=600, num_leapfrog=12, num_warmup=100, jitter=0.5))
    else:
        settings = HMCSettings(num_updates=600, num_leapfrog=8, num_warmup=100, jitter=0.5)
        built = assumed_density_filter(model, 40, settings, num_starts=40)
    state, info = jax.jit(built.init)(jax.random.key(2), observation, inputs)
    assert not info.failed
    assert np.abs(errors_of(state, arm_reference)).max() < 5


@pytest.mark.slow
def test_a_prior_of_other_width_is_noticed_on_the_arm(arm_reference):
    model, observation, inputs = arm_scene()
    wrong = inputs._replace(inputs=inputs.inputs._replace(start_scale=1.5 * inputs.inputs.start_scale))
    built = hmc_filter(model, 40, HMCSettings(num_updates=600, num_leapfrog=12, num_warmup=100, jitter=0.5))
    state, _ = jax.jit(built.init)(jax.random.key(2), observation, wrong)
    assert np.abs(errors_of(state, arm_reference)).max() > 10


def test_inflation_is_the_bias_of_the_inverse_covariance():
    dimension, num_draws, replicates = 5, 20, 4000
    draws = jax.random.normal(jax.random.key(0), (replicates, num_draws, dimension))
    inverses = jax.vmap(lambda x: jnp.linalg.inv(jnp.cov(x.T)))(draws)
    traces = np.asarray(jnp.trace(inverses, axis1=1, axis2=2) / dimension, float)
    expected = (num_draws - 1) / (num_draws - dimension - 2)
    assert abs(traces.mean() - expected) < 5 * traces.std(ddof=1) / np.sqrt(replicates)
    # chains of one draw are as many draws as there are chains
    assert float(covariance_inflation(draws[0, :, None])) == pytest.approx(expected, rel=1e-5)
    assert float(covariance_inflation(jax.random.normal(jax.random.key(1), (4000, 5, 5)))) < 1.01


@pytest.mark.full
def test_effective_draws_of_autoregressive_chains():
    """An AR(1) chain of coefficient rho has an inefficiency factor of (1 + rho) / (1 - rho)."""
    rho, num_chains, num_draws = 0.5, 200, 400
    noise = jax.random.normal(jax.random.key(0), (num_draws, num_chains, 20)) * np.sqrt(1 - rho**2)
    start = jax.random.normal(jax.random.key(1), (num_chains, 20))
    _, chain = jax.lax.scan(lambda x, e: (rho * x + e, rho * x + e), start, noise)
    expected = num_chains * num_draws * (1 - rho) / (1 + rho)
    # the variance of 200 chain means is known to sqrt(2 / 199) = 10 %, its mean over 20 coordinates to 2.2 %
    assert abs(float(effective_draws(jnp.swapaxes(chain, 0, 1))) / expected - 1) < 5 * 0.1 / np.sqrt(20) + 0.01


@pytest.mark.full
@pytest.mark.parametrize(
    "build",
    [
        lambda model: hmc_filter(model, 0),
        lambda model: assumed_density_filter(model, 0),
        lambda model: assumed_density_filter(model, num_starts=0),
        lambda model: assumed_density_filter(model, num_components=0),
        lambda model: assumed_density_filter(model, mode_power=1.5),
        lambda model: hmc_filter(model, 2, resampling="sistematic"),
    ],
)
def test_numbers_out_of_range_are_refused(build):
    with pytest.raises(ValueError, match=r"at least 1|systematic|\[0, 1\]"):
        build(problem().model)


@pytest.mark.slow
def test_mixture_prior_keeps_to_kalman():
    posed = problem()
    built = assumed_density_filter(posed.model, 60, num_components=2, num_starts=8)
    means, covariances, _ = replicate(built, posed, 20)
    error = means.std(0, ddof=1) / np.sqrt(len(means))
    assert np.abs((means.mean(0) - posed.exact.means) / error).max() < 5
    assert np.isfinite(covariances).all()


@pytest.mark.slow
def test_a_broken_state_does_not_begin_again():
    posed = problem()
    filter = assumed_density_filter(posed.model, 4, SHORT, num_starts=4)
    data = posed.at(1)
    start = filter.initial_state(*data)
    step = jax.jit(filter.step)
    first, _ = step(jax.random.key(0), start, *data)
    broken = first._replace(log_step_size=jnp.full((), jnp.nan))
    anew, _ = step(jax.random.key(1), start, *data)
    after, info = step(jax.random.key(1), broken, *data)
    assert np.isnan(info.step_size) and not np.array_equal(after.particles, anew.particles)
