"""Integers beyond 2^24 in float32: two coordinates hold them exactly."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from poseppl.filters.hidden_markov import state_values
from poseppl.program import StateSpaceModel
from poseppl.program.clamped import Clamped, clamp

STOCK = np.array([30_000_001, 7, 2**31 - 100], np.int32)
"""Counts of three shops, of which the last is near the largest integer."""


def first_stock(params, inputs):
    numpyro.sample("drift", dist.Normal(0.0, 1.0))
    numpyro.sample("sold", dist.Poisson(jnp.array([1.0, 2.0, 3.0])))
    numpyro.sample("stock", dist.Delta(jnp.asarray(STOCK), event_dim=1))


def next_stock(params, state, inputs):
    numpyro.sample("drift", dist.Normal(state["drift"], 0.1))
    sold = numpyro.sample("sold", dist.Poisson(jnp.array([1.0, 2.0, 3.0])))
    numpyro.sample("stock", dist.Delta(state["stock"] - sold, event_dim=1))


def seen(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["drift"], 1.0))


SHOPS = StateSpaceModel(first_stock, next_stock, seen)


def test_layout_and_names():
    model = SHOPS.compile()
    assert model.sites["stock"].split and not model.sites["sold"].split
    assert model.dimension == 1 + 3 + 6
    assert model.coordinate_names[4:] == (
        *("stock[0]", "stock[1]", "stock[2]"),
        *("stock[0] (rest)", "stock[1] (rest)", "stock[2] (rest)"),
    )
    assert model.finite_coordinates == (False,) + (True,) * 9
    with jax.enable_x64(True):
        assert SHOPS.compile().dimension == 7


@pytest.mark.parametrize("dtype", [np.int32, np.uint32])
def test_every_integer_comes_back(dtype):
    ends = np.iinfo(dtype)
    edges = np.array([ends.min, ends.min + 1, 0, 1, 2**24 + 1, 2**31 - 129, 2**31 - 65, 2**31 - 1, ends.max - 1, ends.max])
    drawn = np.random.default_rng(0).integers(ends.min, ends.max, 1000, endpoint=True)
    values = np.concatenate([edges, drawn]).astype(dtype)
    site = SHOPS.compile().sites["stock"]
    transform = site._replace(dtype=np.dtype(dtype)).transform
    parts = transform.inv(jnp.asarray(values))
    assert parts.dtype == jnp.float32 and parts.shape == (2, 1010)
    np.testing.assert_array_equal(transform(parts), values)
    np.testing.assert_array_equal(np.asarray(parts, np.float64).sum(0), values)


@pytest.mark.full
def test_draws_and_densities_are_exact():
    model = SHOPS.compile()
    x = model.sample_initial(jax.random.key(1))
    np.testing.assert_array_equal(model.to_sites(x)["stock"], STOCK)
    moved = model.sample_transition(jax.random.key(2), x)
    sites = model.to_sites(moved)
    np.testing.assert_array_equal(sites["stock"], STOCK - np.asarray(sites["sold"]))
    np.testing.assert_array_equal(model.to_flat(sites), moved)
    expected = dist.Poisson(jnp.array([1.0, 2.0, 3.0])).log_prob(sites["sold"]).sum()
    expected += dist.Normal(model.to_sites(x)["drift"], 0.1).log_prob(sites["drift"])
    np.testing.assert_allclose(model.log_transition(moved, x), expected, rtol=1e-5)
    assert model.log_det(moved) == 0
    one_off = model.to_flat({**sites, "stock": sites["stock"] + 1})
    assert model.log_transition(one_off, x) == -np.inf


def test_a_gradient_by_the_real_coordinates():
    model = SHOPS.compile()
    x = model.sample_initial(jax.random.key(1))
    gradient = jax.grad(model.log_initial)(x)
    np.testing.assert_allclose(gradient[0], -x[0], rtol=1e-5)
    assert np.isfinite(gradient).all()


def test_a_clamped_model_has_the_layout_of_the_full_one():
    model = SHOPS.compile()
    x = model.sample_initial(jax.random.key(1))
    moved = model.sample_transition(jax.random.key(2), x)
    free = clamp(model, ["sold", "stock"])
    assert free.coordinate_names == model.coordinate_names[1:]
    inputs = Clamped(None, moved, x)
    np.testing.assert_array_equal(free.to_sites(moved[1:], inputs)["stock"], model.to_sites(moved)["stock"])
    drift = dist.Normal(x[0], 0.1).log_prob(moved[0])
    np.testing.assert_allclose(free.log_transition(moved[1:], x[1:], inputs), model.log_transition(moved, x) - drift, rtol=1e-4)
    given = clamp(model, ["drift"])
    assert given.log_transition(moved[:1], x[:1], inputs) == pytest.approx(float(drift), rel=1e-5)


def of_first(law):
    """The layout of a site `n` that is drawn from a law at first."""

    def move(params, state, inputs):
        numpyro.sample("n", law(params, inputs))

    first = StateSpaceModel(
        lambda params, inputs: move(params, None, inputs), move, lambda params, state, inputs: seen_count(state)
    )
    return lambda inputs=None, params=None: first.compile(inputs, params).sites["n"].split


def seen_count(state):
    numpyro.sample("y", dist.Normal(jnp.asarray(state["n"], float), 1.0))


def test_which_sites_are_large():
    assert of_first(lambda params, inputs: dist.Poisson(params))(params=3e7)
    assert not of_first(lambda params, inputs: dist.Poisson(params))(params=300.0)
    assert of_first(lambda params, inputs: dist.Delta(jnp.int32(-40_000_003)))()
    assert of_first(lambda params, inputs: dist.DiscreteUniform(20_000_000, 20_000_010))()
    assert not of_first(lambda params, inputs: dist.DiscreteUniform(0, 2**23))()
    assert not of_first(lambda params, inputs: dist.Poisson(inputs))(inputs=jnp.float32(3e7))  # zero when it is compiled
    traced = jax.jit(lambda rate: jnp.asarray(of_first(lambda params, inputs: dist.Poisson(params))(params=rate)))
    assert not traced(3e7)


def test_values_of_a_hidden_markov_chain_of_large_numbers():
    def move(params, state, inputs):
        numpyro.sample("n", dist.DiscreteUniform(20_000_001, 20_000_004))

    model = StateSpaceModel(lambda params, inputs: move(params, None, inputs), move, lambda p, s, u: seen_count(s)).compile()
    values = jax.vmap(model.to_sites)(jnp.asarray(state_values(model)))["n"]
    np.testing.assert_array_equal(values, [20_000_001, 20_000_002, 20_000_003, 20_000_004])
