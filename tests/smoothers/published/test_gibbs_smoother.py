"""Gibbs smoothing: exact on mixtures that are known, and on the model itself where it accepts against the likelihood."""

from __future__ import annotations

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.stats
from law_problems import z_scores
from mixture_problems import exact_smoothing, mixture_problem

from poseppl.program import StateSpaceModel
from poseppl.smoothers import History
from poseppl.smoothers.published.gibbs import gibbs_chains, gibbs_smoother, gibbs_starts
from poseppl.smoothers.published.likelihood_mixture import mixture_of_gaussians

CHAINS = 100
POSED = mixture_problem(separation=1.5)


@cache
def draws_of_known_mixture(**options):
    """Draws (M, R, T, d) of many chains, and the acceptance."""
    starts = jnp.asarray(np.random.default_rng(1).normal(size=(CHAINS, 3, 2)), jnp.float32)

    @jax.jit
    def run(rng_key):
        data = POSED.observations, POSED.inputs
        return gibbs_chains(rng_key, POSED.model, POSED.mixture, starts, *data, 400, 40, **options)

    return run(jax.random.key(0))


def moment_scores(draws, exact):
    """Largest z-scores, over chains, of means and of second moments about the exact means, those between frames included."""
    centred = (np.asarray(draws, float) - exact.means).reshape(*draws.shape[:2], -1)
    seconds = np.einsum("mri,mrj->mij", centred, centred) / centred.shape[1]
    return np.abs(z_scores(centred.mean(1), 0.0)).max(), np.abs(z_scores(seconds, exact.covariance)).max()


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"collapsed": False}, {"blocked": True}], ids=["collapsed", "given", "blocked"])
def test_known_mixtures_are_sampled_exactly(options):
    chains = draws_of_known_mixture(**options)
    assert max(moment_scores(chains.draws, exact_smoothing(POSED))) < 5
    np.testing.assert_allclose(chains.acceptance, 1.0, atol=1e-3)


@pytest.mark.full
def test_wrong_answers_are_noticed():
    """Inputs of the wrong frame, and a mixture whose weights are forgotten."""
    shifted = POSED._replace(inputs=jnp.roll(POSED.inputs, 1, axis=0))
    even = POSED._replace(weights=np.full(POSED.weights.shape, 0.5))
    draws = draws_of_known_mixture().draws
    for wrong in (shifted, even):
        assert moment_scores(draws, exact_smoothing(wrong))[0] > 10


# A transition that is not linear


def curved_mean(x):
    return 2 * np.sin(x) if isinstance(x, np.ndarray) else 2 * jnp.sin(x)


def curved_model():
    """A turning transition, and data that leave the sign open."""

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.5, 1.5))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(curved_mean(state["x"]), 0.8))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"] ** 2 / 2, 1.0))

    return StateSpaceModel(initial, transition, observation).compile()


def grid_smoothing(log_likelihoods):
    """Smoothed means and variances (T,) by quadrature; log-likelihoods (T, G) from the grid."""
    grid = np.linspace(-9, 9, 901)
    likelihoods = np.exp(log_likelihoods(grid))
    kernel = scipy.stats.norm.pdf(grid[:, None], curved_mean(grid)[None], 0.8)
    forward, backward = [scipy.stats.norm.pdf(grid, 0.5, 1.5) * likelihoods[0]], [np.ones_like(grid)]
    for t in range(1, len(likelihoods)):
        forward.append(kernel @ forward[-1] * likelihoods[t])
    for t in range(len(likelihoods) - 1, 0, -1):
        backward.append((likelihoods[t] * backward[-1]) @ kernel)
    smoothed = np.array(forward) * np.array(backward[::-1])
    smoothed /= smoothed.sum(1, keepdims=True)
    means = smoothed @ grid
    return means, (smoothed * (grid - means[:, None]) ** 2).sum(1)


@pytest.mark.full
@pytest.mark.parametrize("target", ["mixture", "model"])
def test_curved_transition_against_a_grid(target):
    """Samples follow a deliberately wrong mixture, and chains on the likelihood itself do not depend on it."""
    model, ys = curved_model(), np.array([1.5, 0.3, 2.0, 1.0])
    means, weights = np.tile([1.2, -1.2], (4, 1)), np.array([0.7, 0.3])
    mixture = mixture_of_gaussians(np.tile(np.log(weights), (4, 1)), means[:, :, None], np.full((4, 2, 1, 1), 0.6))
    starts = jnp.asarray(np.random.default_rng(1).normal(size=(CHAINS, 4, 1)), jnp.float32)
    observations = model.observe({"y": ys})

    @jax.jit
    def run(rng_key):
        true_likelihood = target == "model"
        return gibbs_chains(rng_key, model, mixture, starts, observations, None, 600, 60, true_likelihood=true_likelihood)

    draws = np.asarray(run(jax.random.key(0)).draws, float)[..., 0]

    def of_mixture(grid):
        return np.logaddexp.reduce(np.log(weights) - 0.5 * (grid[:, None, None] - means) ** 2 / 0.6, axis=2).T

    def of_model(grid):
        return scipy.stats.norm.logpdf(ys[:, None], grid**2 / 2, 1.0)

    right, wrong = (of_mixture, of_model) if target == "mixture" else (of_model, of_mixture)
    exact_mean, exact_variance = grid_smoothing(right)
    assert np.abs(z_scores(draws.mean(1), exact_mean)).max() < 5
    assert np.abs(z_scores(((draws - exact_mean) ** 2).mean(1), exact_variance)).max() < 5
    assert np.abs(z_scores(draws.mean(1), grid_smoothing(wrong)[0])).max() > 10


# The smoother


def history_around(num_frames, num_particles=40, dimension=2, seed=0):
    rng = np.random.default_rng(seed)
    log_weights = np.log(rng.dirichlet(np.ones(num_particles), num_frames))
    particles = jnp.asarray(rng.normal(size=(num_frames, num_particles, dimension)), jnp.result_type(float))
    ancestors = jnp.zeros((num_frames, num_particles), jnp.int32)
    return History(particles, jnp.asarray(log_weights, particles.dtype), ancestors, jnp.zeros(num_frames, bool))


def test_first_chain_starts_at_the_most_likely_particles():
    history = history_around(3)
    starts = jax.jit(lambda key: gibbs_starts(POSED.model, key, history, POSED.inputs, 4))(jax.random.key(0))
    best = np.argmax(history.log_weights, axis=1)
    np.testing.assert_array_equal(starts[0], np.asarray(history.particles)[range(3), best])
    for frame in range(3):
        distances = np.abs(np.asarray(starts)[:, frame, None] - np.asarray(history.particles)[frame]).sum(-1)
        assert (distances.min(1) == 0).all()


@pytest.mark.full
def test_draws_of_the_smoother():
    built = gibbs_smoother(POSED.model, num_components=5, num_chains=2, num_draws=15, num_warmup=5)
    smoothed = jax.jit(built.smooth)(jax.random.key(0), history_around(3), POSED.observations, POSED.inputs)
    assert built.joint
    draws = np.asarray(smoothed.particles)
    assert draws.shape == (3, 2, 15, 2)
    assert smoothed.log_weights.shape == (3, 2, 15)
    assert len(np.unique(draws)) > 3
    assert (np.asarray(smoothed.info.ess) > 0).all()


@pytest.mark.full
def test_blocked_rounds_need_a_linear_transition():
    model = curved_model()
    built = gibbs_smoother(model, num_chains=2, num_draws=4, num_warmup=0, blocked=True)
    observations = model.observe({"y": np.ones(4)})
    with pytest.raises(ValueError, match="leave out blocked"):
        jax.eval_shape(built.smooth, jax.random.key(0), history_around(4, dimension=1), observations)


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"num_draws": 0}, "num_draws is 0"),
        ({"num_warmup": -1}, "num_warmup is -1"),
        ({"target": "likelihood"}, "mixture, model"),
        ({"target": "model", "blocked": True}, "blocked is True"),
        ({"num_components": 0}, "num_components is 0"),
    ],
)
def test_settings_out_of_range_are_refused(settings, match):
    with pytest.raises(ValueError, match=match):
        gibbs_smoother(POSED.model, **settings)
