"""Clamping: the full model as a function of some coordinates."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.linear_gaussian import linear_gaussian

from poseppl.filters import particle_filter
from poseppl.program import Clamped, CompiledModel

FREE = (1, 2, 4)


@pytest.fixture(scope="module")
def full():
    return linear_gaussian(5, B=np.ones((5, 1))).compile(np.zeros(1))


@pytest.fixture(scope="module")
def inputs():
    values = jnp.arange(5.0)
    return Clamped(jnp.ones(1), values, values - 0.5)


X = jnp.array([-1.0, -2.0, -4.0])
PREVIOUS = jnp.array([0.1, 0.2, 0.4])
FULL_X = jnp.array([0.0, -1.0, -2.0, 3.0, -4.0])
FULL_PREVIOUS = jnp.array([-0.5, 0.1, 0.2, 2.5, 0.4])


def test_it_is_a_compiled_model(full):
    clamped = full.clamp(FREE)
    assert isinstance(clamped, CompiledModel)
    assert clamped.dimension == 3
    assert clamped.coordinate_names == ("x[1]", "x[2]", "x[4]")
    assert full.clamp(["x[1]", "x[2]", 4]).free == FREE


def test_densities_are_the_full_ones(full, inputs):
    clamped = full.clamp(FREE)
    data = full.observe({"y": np.arange(5.0)})
    for found, expected in [
        (clamped.log_initial(X, inputs), full.log_initial(FULL_X, inputs.inputs)),
        (clamped.log_transition(X, PREVIOUS, inputs), full.log_transition(FULL_X, FULL_PREVIOUS, inputs.inputs)),
        (clamped.log_observation(X, data, inputs), full.log_observation(FULL_X, data, inputs.inputs)),
        (clamped.log_det(X, inputs), full.log_det(FULL_X)),
        (clamped.to_sites(X, inputs)["x"], FULL_X),
        (clamped.to_flat({"x": FULL_X}), X),
    ]:
        np.testing.assert_array_equal(found, expected)


def test_draws_are_the_full_ones(full, inputs):
    clamped, key = full.clamp(FREE), jax.random.key(0)
    np.testing.assert_array_equal(clamped.sample_initial(key, inputs), full.sample_initial(key, inputs.inputs)[np.array(FREE)])
    drawn = full.sample_transition(key, FULL_PREVIOUS, inputs.inputs)[np.array(FREE)]
    np.testing.assert_array_equal(clamped.sample_transition(key, PREVIOUS, inputs), drawn)


def test_gaussian_summaries_are_blocks(full, inputs):
    clamped, block = full.clamp(FREE), np.ix_(FREE, FREE)
    data = full.observe({"y": np.arange(5.0)})
    mean, covariance = clamped.transition_moments(PREVIOUS, inputs)
    full_mean, full_covariance = full.transition_moments(FULL_PREVIOUS, inputs.inputs)
    np.testing.assert_array_equal(mean, full_mean[np.array(FREE)])
    np.testing.assert_array_equal(covariance, full_covariance[block])
    slope = full.observation_slope(FULL_X, inputs.inputs)
    np.testing.assert_array_equal(clamped.observation_slope(X, inputs), slope[:, block[1].ravel()])
    information = clamped.observation_information(X, data, inputs)
    np.testing.assert_array_equal(information, full.observation_information(FULL_X, data, inputs.inputs)[block])


def test_any_order_of_the_free(full, inputs):
    clamped = full.clamp((4, 1, 2))
    shuffled = X[jnp.array([2, 0, 1])]
    np.testing.assert_array_equal(clamped.fill(shuffled, inputs.values), FULL_X)
    np.testing.assert_array_equal(clamped.to_flat({"x": FULL_X}), shuffled)


def test_filling_needs_no_scatter(full, inputs):
    clamped = full.clamp(FREE)
    jaxpr = str(jax.make_jaxpr(jax.grad(lambda x: clamped.log_initial(x, inputs)))(X))
    assert "scatter" not in jaxpr
    assert "gather" not in jaxpr


def test_gradient_is_that_of_the_free(full, inputs):
    clamped = full.clamp(FREE)
    data = full.observe({"y": np.arange(5.0)})
    found = jax.grad(clamped.log_observation)(X, data, inputs)
    expected = jax.grad(full.log_observation)(FULL_X, data, inputs.inputs)
    np.testing.assert_allclose(found, expected[np.array(FREE)], rtol=1e-6)


def test_trajectory_and_filter(full):
    clamped = full.clamp(FREE)
    rng = np.random.default_rng(0)
    xs, ys, us = rng.normal(size=(4, 5)), rng.normal(size=(4, 5)), rng.normal(size=(4, 1))
    data = full.observe({"y": ys})
    inputs = Clamped.of_trajectory(xs, us)
    found = jax.jit(clamped.log_joint)(xs[:, FREE], data, inputs)
    np.testing.assert_allclose(found, jax.jit(full.log_joint)(xs, data, us), rtol=1e-5)
    built = particle_filter(clamped, 50)
    frames = [jax.tree.map(lambda a, t=t: a[t], (data, inputs)) for t in range(2)]
    state, _ = built.init(jax.random.key(0), *frames[0])
    state, info = jax.jit(built.step)(jax.random.key(1), state, *frames[1])
    assert state.particles.shape == (50, 3)
    assert np.isfinite(info.log_evidence)


def test_other_params():
    clamped = linear_gaussian(2).compile(params=1.0).clamp([0]).with_params(2.0)
    assert clamped.params == clamped.full.params == 2.0


@pytest.mark.parametrize("free", [[], [0, 0], [5], [-1], ["x[7]"]])
def test_refused(full, free):
    with pytest.raises(ValueError, match="free"):
        full.clamp(free)


def test_refused_inputs_and_clamping_twice(full):
    with pytest.raises(ValueError, match="inputs of type NoneType. Expected Clamped"):
        full.clamp(FREE).log_initial(X, None)
    with pytest.raises(ValueError, match="clamped already"):
        full.clamp(FREE).clamp([0])
