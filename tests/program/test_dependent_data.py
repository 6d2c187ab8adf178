"""Data sites that depend on one another within a frame, against Gaussians whose moments are known."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import stats

import poseppl
from poseppl.errors import UnsuitableModelError

KEY = jax.random.key(0)
STATE = np.array([0.7, -0.4])


def model_of(observation):
    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(jnp.array([1.0, -1.0]), 2.0))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"], 1.0))

    return poseppl.StateSpaceModel(initial, transition, observation).compile()


def chain(params, state, inputs):
    """Each of three thermometers is read against the one before it; the state has another one of its own."""
    first = numpyro.sample("first", dist.Normal(2.0 * state["x"][0], 0.5))
    numpyro.sample("alone", dist.Normal(state["x"][1], 0.7))
    second = numpyro.sample("second", dist.Normal(1.0 - 0.5 * first + state["x"][1], 0.3))
    numpyro.sample("third", dist.Normal(second + first, 0.2))


def of_chain(x):
    """Mean and covariance of first, alone, second, third."""
    load = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-0.5, 0, 1, 0], [0.5, 0, 1, 1]])  # of the errors e
    first = 2 * x[0]
    second = 1 - 0.5 * first + x[1]
    return np.array([first, x[1], second, second + first]), load @ np.diag([0.5, 0.7, 0.3, 0.2]) ** 2 @ load.T


def shared_offset(params, state, inputs):
    """A gauge and a pair of sensors that have the same unknown offset, which nobody ever sees."""
    offset = numpyro.sample("offset", dist.Normal(0.0, 0.8))
    numpyro.sample("gauge", dist.Normal(state["x"][0] + offset, 0.4))
    covariance = jnp.array([[0.3, 0.1], [0.1, 0.2]])
    numpyro.sample("pair", dist.MultivariateNormal(state["x"] + offset, covariance))


def of_shared_offset(x):
    """Mean and covariance of gauge, offset, pair: the sites in the order of their names."""
    mean = np.array([0.0, x[0], x[0], x[1]])
    covariance = np.zeros((4, 4))
    covariance[1, 1], covariance[2:, 2:] = 0.4**2, [[0.3, 0.1], [0.1, 0.2]]
    return mean, covariance + 0.8**2


def masked(names, values, seen):
    return {name: value if use else np.nan for name, value, use in zip(names, values, seen, strict=True)}


def log_marginal(mean, covariance, values, seen):
    seen = np.asarray(seen)
    if not seen.any():
        return 0.0
    return stats.multivariate_normal(mean[seen], covariance[np.ix_(seen, seen)]).logpdf(np.asarray(values)[seen])


def test_any_of_a_chain_may_be_missing():
    model, values = model_of(chain), np.array([1.1, 0.2, -0.3, 1.0])
    names = ("first", "alone", "second", "third")
    density, by_event = jax.jit(model.log_observation), jax.jit(model.log_data)
    for seen in itertools.product([True, False], repeat=4):
        data = model.observe(masked(names, values, seen))
        expected = log_marginal(*of_chain(STATE), values, seen)
        np.testing.assert_allclose(density(jnp.asarray(STATE, jnp.float32), data), expected, rtol=1e-4, atol=1e-4)
        terms = [float(term) for term in by_event(jnp.asarray(STATE, jnp.float32), data).values()]
        np.testing.assert_allclose(np.nansum(terms), expected, rtol=1e-4, atol=1e-4)
        assert np.isfinite([term for term, name in zip(terms, names, strict=True)]).sum() == sum(seen)


def test_a_latent_site_is_integrated_out():
    model, values = model_of(shared_offset), np.array([0.5, 0.9, -0.1])
    density = jax.jit(model.log_observation)
    for seen in itertools.product([True, False], repeat=3):
        gauge, pair = masked("ab", values[:2], seen[:2]), masked("ab", values[1:], seen[1:])
        data = model.observe({"offset": np.nan, "gauge": gauge["a"], "pair": [pair["a"], pair["b"]]})
        expected = log_marginal(*of_shared_offset(STATE), [0.0, *values], [False, *seen])
        found = density(jnp.asarray(STATE, jnp.float32), data)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    "seen",
    [
        (False, True, True, True),
        *(pytest.param(seen, marks=pytest.mark.full) for seen in [(True, True, True, True), (False, False, False, True)]),
    ],
)
def test_the_kalman_filter_and_the_particle_filter_have_the_posterior(seen):
    model, values = model_of(chain), np.array([1.1, 0.2, -0.3, 1.0])
    data = {name: [value] for name, value in masked(("first", "alone", "second", "third"), values, seen).items()}
    matrix = np.stack([of_chain(unit)[0] - of_chain(np.zeros(2))[0] for unit in np.eye(2)], 1)[list(seen)]
    offset, noise = of_chain(np.zeros(2))
    prior = np.array([1.0, -1.0])
    offset, noise = offset[list(seen)], noise[np.ix_(seen, seen)]
    spread = 4 * matrix @ matrix.T + noise
    residual = values[list(seen)] - offset - matrix @ prior
    mean = prior + 4 * matrix.T @ np.linalg.solve(spread, residual)
    evidence = stats.multivariate_normal(np.zeros(len(residual)), spread).logpdf(residual)
    kalman = poseppl.infer(model, data, poseppl.kalman_filter, KEY)
    np.testing.assert_allclose(kalman["summary/x_mean"].values[0], mean, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(kalman["sample_stats/log_evidence"].values[0], evidence, rtol=1e-3, atol=1e-3)
    particles = poseppl.infer(model, data, poseppl.particle_filter(model, 20_000), KEY)
    error = 5 / np.sqrt(particles["sample_stats/ess"].values[0])
    deviation = np.sqrt(np.diag(4 * np.eye(2) - 16 * matrix.T @ np.linalg.solve(spread, matrix)))
    assert (abs(particles["summary/x_mean"].values[0] - mean) < error * deviation).all()
    assert abs(particles["sample_stats/log_evidence"].values[0] - evidence) < error


@pytest.mark.full
def test_the_information_is_the_curvature_of_what_was_seen():
    for observation, data in (
        (chain, {"first": np.nan, "alone": 0.2, "second": -0.3, "third": 1.0}),
        (shared_offset, {"offset": np.nan, "gauge": 0.3, "pair": [np.nan, 0.2]}),
    ):
        model = model_of(observation)
        seen, x = model.observe(data), jnp.asarray(STATE, jnp.float32)
        curvature = -jax.hessian(model.log_observation)(x, seen)
        np.testing.assert_allclose(model.observation_information(x, seen), curvature, rtol=1e-3, atol=1e-3)


def counts(params, state, inputs):
    """Counts whose rate is measured in the same frame."""
    rate = numpyro.sample("rate", dist.Normal(state["x"][0], 0.1))
    numpyro.sample("count", dist.Poisson(jnp.exp(rate)))


def volatile(params, state, inputs):
    """A return whose scale follows from another one."""
    first = numpyro.sample("first", dist.Normal(state["x"][0], 0.5))
    numpyro.sample("second", dist.Normal(state["x"][1], jnp.exp(first)))


def curved(params, state, inputs):
    """A measurement that is no straight line in another one."""
    first = numpyro.sample("first", dist.Normal(state["x"][0], 0.5))
    numpyro.sample("second", dist.Normal(first**2, 0.5))


@pytest.mark.parametrize(
    ("observation", "data", "reason"),
    [
        (counts, {"rate": 0.5, "count": 2.0}, "no Normal"),
        (volatile, {"first": 0.5, "second": 0.2}, "scale of site 'second' depends on site 'first'"),
        (curved, {"first": 0.5, "second": 0.2}, "not affine"),
    ],
)
def test_what_cannot_be_integrated_out_is_refused(observation, data, reason):
    """Both missing, or the child alone, is well defined, and so is the density where both are seen."""
    model = model_of(observation)
    parent, child = data
    with pytest.raises(ValueError, match=f"'{child}' is given where '{parent}'.*{reason}"):
        model.observe({parent: [0.5, np.nan], child: [1.0, 2.0]})
    x = jnp.asarray(STATE, jnp.float32)
    both = float(model.log_observation(x, model.observe(data)))
    alone = float(model.log_observation(x, model.observe({**data, child: np.nan})))
    assert both != alone
    scale = 0.1 if observation is counts else 0.5
    np.testing.assert_allclose(alone, stats.norm.logpdf(0.5, STATE[0], scale), rtol=1e-4)
    assert float(model.log_observation(x, model.observe(dict.fromkeys(data, np.nan)))) == 0.0


def test_kalman_names_both_sites_of_a_scale_that_it_cannot_take():
    with pytest.raises(UnsuitableModelError, match="scale of site 'second' depends on site 'first'"):
        poseppl.infer(model_of(volatile), {"first": [0.5], "second": [0.2]}, poseppl.kalman_filter, KEY)


def vectors(params, state, inputs):
    """Two events of three correlated entries."""
    loc = jnp.stack([state["x"][0] * jnp.ones(3), state["x"][1] * jnp.arange(3.0)])
    numpyro.sample("z", dist.MultivariateNormal(loc, COVARIANCE))


COVARIANCE = np.array([[1.0, 0.6, 0.2], [0.6, 1.5, -0.3], [0.2, -0.3, 0.8]])


def test_single_entries_of_a_multivariate_normal_may_be_missing():
    model, values = model_of(vectors), np.array([[0.5, 1.2, -0.3], [0.1, -0.6, -1.0]])
    means = np.stack([STATE[0] * np.ones(3), STATE[1] * np.arange(3)])
    x, density, by_event = jnp.asarray(STATE, jnp.float32), jax.jit(model.log_observation), jax.jit(model.log_data)
    for seen in itertools.product([True, False], repeat=3):
        mask = np.array([seen, (True, False, True)])
        data = model.observe({"z": np.where(mask, values, np.nan)})
        events = [log_marginal(mean, COVARIANCE, value, use) for mean, value, use in zip(means, values, mask, strict=True)]
        np.testing.assert_allclose(density(x, data), sum(events), rtol=1e-4, atol=1e-4)
        terms = by_event(x, data)["z"]
        np.testing.assert_allclose(
            terms, [event if use.any() else np.nan for event, use in zip(events, mask, strict=True)], rtol=1e-4
        )
    information, curvature = jax.jit(model.observation_information), jax.jit(jax.hessian(model.log_observation))
    for mask in ([[True, False, True], [False, False, False]], [[True, True, True], [False, True, True]]):
        data = model.observe({"z": np.where(mask, values, np.nan)})
        np.testing.assert_allclose(information(x, data), -curvature(x, data), rtol=1e-3, atol=1e-3)


def test_other_events_are_still_seen_whole_or_not_at_all():
    def observation(params, state, inputs):
        numpyro.sample("share", dist.Dirichlet(jnp.exp(state["x"])))

    with pytest.raises(ValueError, match="observed in part"):
        model_of(observation).observe({"share": [np.nan, 0.3]})
