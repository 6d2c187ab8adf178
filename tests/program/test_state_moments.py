"""Moments of frames whose sites depend on each other, against the joint Gaussian written by hand."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from programs import model

from poseppl.errors import UnsuitableModelError
from poseppl.gaussians.linear_transitions import transition_structure

X = jnp.array([0.4, -0.3, 1.1])
FULL = np.array([[1.0, 0.3], [0.3, 0.5]])
PULL = np.array([2.0, -1.0])


def level_of_slope(params, state, inputs):
    """The slope first, which moves the level."""
    slope = numpyro.sample("slope", dist.MultivariateNormal(0.5 * state["slope"], jnp.asarray(FULL)))
    numpyro.sample("level", dist.Normal(params * state["level"] + jnp.asarray(PULL) @ slope, 0.5))


def compiled_with(transition, params=None):
    return model(transition=transition).compile(params=params)


def test_a_chain_has_the_moments_of_its_joint_gaussian():
    compiled = compiled_with(level_of_slope, jnp.asarray(0.9))
    mean, covariance = jax.jit(compiled.transition_moments)(X)
    between = FULL @ PULL
    expected = np.block([[PULL @ between + 0.25, between[None]], [between[:, None], FULL]])
    np.testing.assert_allclose(mean, [0.9 * 0.4 + PULL @ X[1:] / 2, *X[1:] / 2], rtol=1e-5)
    np.testing.assert_allclose(covariance, expected, rtol=1e-5)
    assert not compiled.moments_are_linearised("transition", x_previous=X)
    both = jnp.stack([X, -X])
    np.testing.assert_allclose(jax.vmap(compiled.transition_moments)(both)[0], [mean, -mean], rtol=1e-5)
    slope = jax.grad(lambda params: compiled.with_params(params).transition_moments(X)[0][0])(jnp.asarray(0.9))
    np.testing.assert_allclose(slope, X[0], rtol=1e-5)


@pytest.mark.full
def test_second_moments_of_a_chain_need_no_normal():
    """The law of total variance holds for any distribution."""

    def transition(params, state, inputs):
        level = numpyro.sample("level", dist.Laplace(state["level"], 2.0))
        numpyro.sample("slope", dist.StudentT(5.0, state["slope"] + level * jnp.array([1.0, -3.0]), 3.0).to_event(1))

    covariance = compiled_with(transition).transition_moments(X)[1]
    pull = np.array([1.0, 1.0, -3.0])
    np.testing.assert_allclose(covariance, 8 * np.outer(pull, pull) + np.diag([0.0, 15.0, 15.0]), rtol=1e-5)


def test_a_bent_mean_is_linearised_and_said_so():
    def transition(params, state, inputs):
        level = numpyro.sample("level", dist.Normal(state["level"], 0.1))
        numpyro.sample("slope", dist.Normal(jnp.stack([jax.jit(jnp.sin)(level), level**2]), 1.0))

    compiled = compiled_with(transition)
    mean, covariance = compiled.transition_moments(X)
    pull = np.array([1.0, np.cos(0.4), 0.8])
    np.testing.assert_allclose(mean, [0.4, np.sin(0.4), 0.16], rtol=1e-5)
    np.testing.assert_allclose(covariance, 0.01 * np.outer(pull, pull) + np.diag([0.0, 1.0, 1.0]), rtol=1e-5)
    assert compiled.moments_are_linearised("transition", x_previous=X)
    assert not compiled.moments_are_linearised("initial")


@pytest.mark.parametrize(("pull", "affine"), [(lambda level: 2 * level, True), (jnp.square, False)], ids=["affine", "bent"])
def test_sites_that_bend_others_of_their_frame_are_not_linear(pull, affine):
    """Although their linearised mean and covariance are the same after any state."""

    def transition(params, state, inputs):
        level = numpyro.sample("level", dist.Normal(1.0, 1.0))
        numpyro.sample("slope", dist.Normal(pull(level), 1.0).expand([2]))

    assert transition_structure(compiled_with(transition), None).affine == affine


@pytest.mark.parametrize("pull", [lambda level: 2.0 * level, jnp.sin], ids=["affine", "bent"])
def test_a_first_frame_that_bends_is_no_gaussian(pull):
    def initial(params, inputs):
        level = numpyro.sample("level", dist.Normal(0.0, 1.0))
        numpyro.sample("slope", dist.Normal(pull(level), 1.0).expand([2]))

    compiled = model(initial).compile()
    assert compiled.initial_is_gaussian() == (pull is not jnp.sin)
    slope = float(jax.grad(pull)(0.0))
    np.testing.assert_allclose(compiled.initial_moments()[1][0], [1.0, slope, slope], rtol=1e-5)


def test_a_scale_that_depends_on_its_frame_is_refused():
    def transition(params, state, inputs):
        level = numpyro.sample("level", dist.Normal(state["level"], 1.0))
        numpyro.sample("slope", dist.Normal(state["slope"], jnp.exp(level)))

    with pytest.raises(UnsuitableModelError, match="the scale of site 'slope' depends on site 'level' of the same frame"):
        compiled_with(transition).transition_moments(X)


def in_logarithms(params, state, inputs):
    level = numpyro.sample("level", dist.Normal(0.9 * state["level"], 0.5))
    numpyro.sample("slope", dist.Normal(state["slope"] + level, jnp.array([0.1, 0.2])).to_event(1))


def positive(params, state, inputs):
    level = numpyro.sample("level", dist.LogNormal(0.9 * jnp.log(state["level"]), 0.5))
    numpyro.sample("slope", dist.LogNormal(jnp.log(state["slope"]) + jnp.log(level), jnp.array([0.1, 0.2])).to_event(1))


def of_kind(kind, transition):
    """A model whose initial program has sites of a kind."""

    def initial(params, inputs):
        numpyro.sample("level", kind(0.3, 1.0))
        numpyro.sample("slope", kind(0.0, 2.0).expand([2]))

    return model(initial, transition).compile()


def test_positive_sites_have_the_moments_of_their_logarithms():
    flat, constrained = of_kind(dist.Normal, in_logarithms), of_kind(dist.LogNormal, positive)
    for found, expected in [
        (constrained.initial_moments(), flat.initial_moments()),
        (constrained.transition_moments(X), flat.transition_moments(X)),
        (jax.jacrev(lambda x: constrained.transition_moments(x)[0])(X), jax.jacrev(lambda x: flat.transition_moments(x)[0])(X)),
    ]:
        jax.tree.map(lambda one, other: np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6), found, expected)


@pytest.mark.full
def test_the_law_must_be_seen_through_the_bijector_of_its_site():
    """A Normal through a logistic function or a stick-breaking map is; a Student's t is no Normal."""
    transforms = dist.transforms

    def initial(params, inputs):
        loc = jnp.array([0.3, -0.5])
        covariance = jnp.asarray(FULL)
        shares = dist.MultivariateNormal(loc, covariance)
        numpyro.sample("shares", dist.TransformedDistribution(shares, transforms.StickBreakingTransform()))
        numpyro.sample("chance", dist.TransformedDistribution(dist.Normal(0.7, 2.0), transforms.SigmoidTransform()))

    compiled = model(initial, lambda params, state, inputs: initial(params, inputs), lambda p, s, i: seen(s)).compile()
    mean, covariance = compiled.initial_moments()
    np.testing.assert_allclose(mean, [0.3, -0.5, 0.7], rtol=1e-6)
    np.testing.assert_allclose(covariance[:2, :2], FULL, rtol=1e-6)
    np.testing.assert_allclose(covariance[2], [0.0, 0.0, 4.0], rtol=1e-6)
    heavy = dist.TransformedDistribution(dist.StudentT(5.0, 0.0, 1.0), transforms.ExpTransform())
    squared = dist.TransformedDistribution(dist.Normal(0.0, 1.0), [transforms.ExpTransform(), transforms.PowerTransform(2.0)])
    for law in (heavy, squared, dist.Gamma(2.0, 1.0)):
        program = lambda *_, law=law: numpyro.sample("chance", law)  # noqa: E731
        with pytest.raises(UnsuitableModelError, match="'chance': not over the real line"):
            model(program, program, lambda p, s, i: seen(s)).compile().initial_moments()


def seen(state):
    numpyro.sample("y", dist.Normal(state["chance"], 1.0))
