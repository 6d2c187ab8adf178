"""A model in bounded coordinates: the sites' own densities, their bounds, and the way back."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from poseppl.program import StateSpaceModel, bounded

LIMITS = np.array([0.5, 2.0])


def initial(params, inputs):
    numpyro.sample("angle", dist.TruncatedNormal(jnp.zeros(2), 1.0, low=-LIMITS, high=LIMITS))
    numpyro.sample("level", dist.Normal(0.0, 1.0))
    numpyro.sample("rate", dist.LogNormal(0.0, 0.5))
    numpyro.sample("shares", dist.Dirichlet(jnp.ones(3)))


def transition(params, state, inputs):
    numpyro.sample("angle", dist.TruncatedNormal(state["angle"], 0.3, low=-LIMITS, high=LIMITS))
    numpyro.sample("level", dist.Normal(state["level"], 0.1))
    numpyro.sample("rate", dist.LogNormal(0.1 * state["rate"], 0.1))
    numpyro.sample("shares", dist.Dirichlet(1.0 + state["shares"]))


def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["angle"] * state["level"], state["rate"]))


MODEL = StateSpaceModel(initial, transition, observation).compile()


@pytest.mark.full
def test_bounds_are_those_of_the_supports():
    found = bounded(MODEL)
    np.testing.assert_array_equal(found.lower, [-0.5, -2.0, -np.inf, 0.0, -np.inf, -np.inf])
    np.testing.assert_array_equal(found.upper, [0.5, 2.0, np.inf, np.inf, np.inf, np.inf])
    assert found.model.coordinate_names == MODEL.coordinate_names


@pytest.mark.full
def test_densities_are_those_of_the_sites_themselves():
    """Less the determinant of the bijector of what is bounded now, also on a bound, where the logistic function is infinite."""
    found = bounded(MODEL)
    x = jnp.array([0.3, -1.0, 0.4, 0.2, 0.1, -0.3])
    y = found.model.to_flat(MODEL.to_sites(x))
    np.testing.assert_allclose(found.to_unbounded(y), x, atol=1e-4)
    np.testing.assert_allclose(y[:2], MODEL.to_sites(x)["angle"])
    jacobian = jax.jacobian(found.to_unbounded)(y)
    volume = np.linalg.slogdet(np.asarray(jacobian))[1]
    assert float(found.model.log_initial(y)) == pytest.approx(float(MODEL.log_initial(x)) + volume, abs=1e-4)
    data = MODEL.observe({"y": [0.1, 0.2]})
    assert float(found.model.log_observation(y, data)) == pytest.approx(float(MODEL.log_observation(x, data)), abs=1e-5)
    edge = y.at[0].set(0.5)
    there = MODEL.to_flat(MODEL.to_sites(x) | {"angle": jnp.array([0.5, 1.0])})
    assert np.isfinite(float(found.model.log_initial(edge))) and not np.isfinite(float(MODEL.log_initial(there)))
    assert np.isfinite(np.asarray(found.to_unbounded(edge))).all()


@pytest.mark.full
def test_moments_are_given_for_bounded_sites_too():
    """Those of a truncated normal; a Dirichlet's are not, for its site is still seen through its bijector."""

    def simple(params, inputs):
        numpyro.sample("angle", dist.TruncatedNormal(0.5, 1.0, low=-1.0, high=2.0))

    def step(params, state, inputs):
        numpyro.sample("angle", dist.TruncatedNormal(state["angle"], 0.3, low=-1.0, high=2.0))

    model = StateSpaceModel(simple, step, lambda p, s, i: numpyro.sample("y", dist.Normal(s["angle"], 1.0))).compile()
    mean, covariance = bounded(model).model.initial_moments()
    draws = np.asarray(dist.TruncatedNormal(0.5, 1.0, low=-1.0, high=2.0).sample(jax.random.key(0), (100_000,)), float)
    assert float(mean[0]) == pytest.approx(draws.mean(), abs=5 * draws.std() / 300)
    assert float(covariance[0, 0]) == pytest.approx(draws.var(), rel=0.03)
    for refused in (model, bounded(MODEL).model):
        with pytest.raises(ValueError, match="no Gaussian moments"):
            refused.initial_moments()


@pytest.mark.full
def test_discrete_sites_are_refused():
    def count(params, *state_and_inputs):
        numpyro.sample("count", dist.Poisson(3.0))

    model = StateSpaceModel(count, count, lambda p, s, i: numpyro.sample("y", dist.Normal(s["count"], 1.0))).compile()
    with pytest.raises(ValueError, match="site 'count' is discrete"):
        bounded(model)
