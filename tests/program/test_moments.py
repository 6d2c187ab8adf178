"""Moments of the transition and curvature of the observation, against exact ones."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro import handlers
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model
from programs import initial, model

from poseppl.program import StateSpaceModel

FULL = [[1.0, 0.3], [0.3, 0.5]]
X = jnp.array([0.4, -0.3, 1.1])


@pytest.mark.full
@pytest.mark.parametrize("matrices", [{}, {"Q": FULL, "R": FULL}], ids=["diagonal", "full"])
def test_linear_gaussian_is_exact(matrices):
    matrices = linear_gaussian_matrices(2, H=[[1.0, 2.0], [0.5, -1.0]], **matrices)
    compiled = linear_gaussian_model(matrices).compile()
    x = jnp.array([0.7, -1.0])
    mean, covariance = jax.jit(compiled.transition_moments)(x)
    np.testing.assert_allclose(mean, matrices.A @ x, rtol=1e-6)
    np.testing.assert_allclose(covariance, matrices.Q, rtol=1e-6, atol=1e-7)
    data = compiled.observe({"y": [0.0, 1.0]})
    information = jax.jit(compiled.observation_information)(x, data)
    np.testing.assert_allclose(information, matrices.H.T @ np.linalg.solve(matrices.R, matrices.H), rtol=1e-5)
    hessian = jax.hessian(compiled.log_observation)(x, data)
    np.testing.assert_allclose(information, -hessian, rtol=1e-4, atol=1e-5)


def information_of(program, values, mask=None):
    compiled = model(observation=program).compile()
    return jax.jit(compiled.observation_information)(X, compiled.observe(values, mask))


def curved(state):
    return jnp.stack([jnp.sin(state["level"]), state["slope"][0] * state["slope"][1]])


JACOBIAN = np.array([[np.cos(0.4), 0, 0], [0, 1.1, -0.3]])


def test_gauss_newton_leaves_out_the_residual():
    program = lambda p, s, i: numpyro.sample("y", dist.Normal(curved(s), jnp.array([0.5, 2.0])))  # noqa: E731
    found = information_of(program, {"y": [50.0, -50.0]})
    np.testing.assert_allclose(found, JACOBIAN.T @ np.diag([4.0, 0.25]) @ JACOBIAN, rtol=1e-5)


@pytest.mark.full
def test_masks_scales_and_wrappers():
    def program(params, state, inputs):
        numpyro.sample("batch", dist.Normal(curved(state), 1.0))
        numpyro.sample("event", dist.Normal(curved(state), 1.0).to_event(1))
        with handlers.scale(scale=3.0):
            numpyro.sample("scaled", dist.Normal(curved(state), 1.0))
        numpyro.sample("inner", dist.Normal(curved(state), 1.0).mask(jnp.array([False, True])).to_event(1))
        with handlers.mask(mask=False):
            numpyro.sample("never", dist.Normal(curved(state), 1.0))
        numpyro.sample("spread", dist.Normal(state["level"], 1.0).expand([4]))

    values = {"batch": [0.0, np.nan], "event": [0.0, 0.0], "scaled": [0.0, 0.0], "inner": [0.0, 0.0], "never": [0.0, 0.0]}
    found = information_of(program, {**values, "spread": [0.0, np.nan, 0.0, 0.0]})
    expected = JACOBIAN.T @ np.diag([1 + 1 + 3, 1 + 3 + 1]) @ JACOBIAN + np.diag([3.0, 0, 0])
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.parametrize("masks", [lambda fn: fn.mask(False), lambda fn: fn.mask(jnp.array([True, False])).to_event(1)])
def test_moments_know_no_mask_of_the_program(masks):
    """A Kalman filter would take the data that it hides for seen."""
    program = lambda p, s, i: numpyro.sample("y", masks(dist.Normal(curved(s), 1.0)))  # noqa: E731
    compiled = model(observation=program).compile()
    with pytest.raises(ValueError, match="masks the site 'y' itself.*NaN for the data that it hides"):
        compiled.observation_moments(X)
    assert "masks site 'y' itself" in str(compiled.why_not_predictive())


class Known(dist.Normal):
    """A Normal of location `fixed * curved(state)` that knows its Jacobian, and counts how often it is asked."""

    asked = 0

    def __init__(self, state, fixed):
        self.state, self.fixed = state, fixed
        super().__init__(fixed * jnp.stack([jnp.sin(state[0]), state[1] * state[2]]), 0.5)

    def whitened_jacobian(self, mask):
        Known.asked += 1
        rows = jnp.stack([jnp.array([jnp.cos(self.state[0]), 0, 0]), jnp.stack([0.0, self.state[2], self.state[1]])])
        return jnp.where(jnp.array([True, True]) if mask is None else mask, 1.0, 0.0)[:, None] * self.fixed * rows / 0.5


@pytest.mark.parametrize(("constant", "asked"), [(True, 1), (False, 0)])
def test_a_jacobian_in_closed_form_is_used_where_it_is_whole(constant, asked):
    def program(params, state, inputs):
        turned = jnp.concatenate([2 * state["level"][None], state["slope"]])
        numpyro.sample("y", Known(turned, 3.0 if constant else 1.0 + state["level"] ** 2))

    def location(x):
        fixed = 3.0 if constant else 1.0 + x[0] ** 2
        return fixed * jnp.stack([jnp.sin(2 * x[0]), x[1] * x[2]])

    Known.asked = 0
    found = information_of(program, {"y": [0.0, np.nan]})
    row = jax.jacfwd(location)(X)[0] / 0.5
    np.testing.assert_allclose(found, jnp.outer(row, row), rtol=1e-5)
    assert Known.asked == asked
    slope = jax.jit(model(observation=program).compile().observation_jacobian)(X)
    np.testing.assert_allclose(slope, jax.jacfwd(location)(X), rtol=1e-5)
    assert Known.asked == 2 * asked


@pytest.mark.full
def test_the_jacobian_is_that_of_all_means_in_order():
    def program(params, state, inputs):
        numpyro.sample("many", dist.MultivariateNormal(jnp.stack([curved(state)] * 2), jnp.array(FULL)))
        numpyro.sample("event", dist.Normal(2.0 * curved(state), jnp.exp(state["level"])).to_event(1))

    compiled = model(observation=program).compile()
    slope = jax.jit(compiled.observation_jacobian)(X)
    np.testing.assert_allclose(slope, np.concatenate([JACOBIAN, JACOBIAN, 2 * JACOBIAN]), rtol=1e-5)
    assert slope.shape[0] == compiled.observation_moments(X)[0].shape[0]


def test_scale_that_depends_on_the_state_is_ignored():
    program = lambda p, s, i: numpyro.sample("y", dist.Normal(curved(s), jnp.exp(s["level"])))  # noqa: E731
    np.testing.assert_allclose(information_of(program, {"y": [0.0, 0.0]}), JACOBIAN.T @ JACOBIAN / np.exp(0.8), rtol=1e-5)


def test_multivariate_normal_in_batches():
    covariance = jnp.array(FULL)
    program = lambda p, s, i: numpyro.sample("y", dist.MultivariateNormal(jnp.stack([curved(s)] * 3), covariance))  # noqa: E731
    values = np.zeros((3, 2))
    values[1] = np.nan
    found = information_of(program, {"y": values})
    np.testing.assert_allclose(found, 2 * JACOBIAN.T @ np.linalg.solve(FULL, JACOBIAN), rtol=1e-4)


def test_other_sites_and_factors_by_their_clipped_hessian():
    def program(params, state, inputs):
        numpyro.factor("hill", -2.0 * state["level"] ** 2 + 3.0 * state["slope"][0] ** 2)
        numpyro.sample("count", dist.Poisson(jnp.exp(state["slope"][1])))

    found = information_of(program, {"count": 4})
    np.testing.assert_allclose(found, np.diag([4.0, 0.0, np.exp(1.1)]), rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(information_of(program, {"count": np.nan}), np.diag([4.0, 0.0, 0.0]), rtol=1e-4, atol=1e-5)


def test_reverse_rules_of_a_model_are_enough():
    @jax.custom_vjp
    def stretch(x):
        return 2 * x

    stretch.defvjp(lambda x: (2 * x, None), lambda _, g: (2 * g,))
    normal = lambda p, s, i: numpyro.sample("y", dist.Normal(stretch(s["level"]), 1.0))  # noqa: E731
    np.testing.assert_allclose(information_of(normal, {"y": 0.0})[0, 0], 4)
    factor = lambda p, s, i: numpyro.factor("f", -(stretch(s["level"]) ** 2))  # noqa: E731
    np.testing.assert_allclose(information_of(factor, {})[0, 0], 8)


def moments_of(transition, initial=None):
    compiled = model(initial or (lambda p, i: transition(p, {"level": 0.0, "slope": jnp.zeros(2)}, i)), transition).compile()
    return jax.jit(compiled.transition_moments)(X)


def test_moments_of_other_distributions():
    def transition(params, state, inputs):
        numpyro.sample("slope", dist.Laplace(state["slope"], 2.0).to_event(1))
        numpyro.sample("level", dist.StudentT(5.0, state["level"], 3.0))

    mean, covariance = moments_of(transition, initial)
    np.testing.assert_allclose(mean, X, rtol=1e-6)
    np.testing.assert_allclose(covariance, np.diag([9 * 5 / 3, 8, 8]), rtol=1e-6)


def test_moments_of_an_angle():
    """A concentrated VonMises is a Normal of variance 1 / concentration around the unwrapped mean."""

    def transition(params, state, inputs):
        numpyro.sample("level", dist.VonMises(state["level"] + 7.0, 1000.0))
        numpyro.sample("slope", dist.MultivariateNormal(state["slope"], jnp.array(FULL)))

    mean, covariance = moments_of(transition)
    np.testing.assert_allclose(mean, X + jnp.array([7.0, 0, 0]), rtol=1e-6)
    np.testing.assert_allclose(covariance[0, 0], 1e-3, rtol=1e-3)
    np.testing.assert_allclose(covariance[1:, 1:], FULL, rtol=1e-6)


def refused(match, transition, initial=None):
    with pytest.raises(ValueError, match=match):
        moments_of(transition, initial)


def test_independence_is_seen_through_calls():
    def transition(params, state, inputs):
        level = numpyro.sample("level", dist.Normal(state["level"], 1.0))
        other = jax.jit(lambda a, b: (a * 2, b))(level, state["slope"])[1]
        numpyro.sample("slope", dist.Normal(other, 1.0))

    np.testing.assert_allclose(moments_of(transition)[0], X)


@pytest.mark.full
def test_sites_without_gaussian_moments_are_refused():
    def positive(params, state, inputs):
        numpyro.sample("level", dist.Gamma(2.0, 1.0))
        numpyro.sample("slope", dist.Normal(state["slope"], 1.0))

    def walk(params, state, inputs):
        numpyro.sample("level", dist.Normal(0.0, 1.0))
        numpyro.sample("slope", dist.GaussianRandomWalk(1.0, 2))

    def shifted(params, state, inputs):
        shift = dist.transforms.AffineTransform(state["level"], 2.0)
        numpyro.sample("level", dist.TransformedDistribution(dist.Normal(0.0, 1.0), shift))
        numpyro.sample("slope", dist.Normal(state["slope"], 1.0))

    refused("site 'level': not over the real line", positive)
    refused("site 'slope': GaussianRandomWalk does not give its covariance", walk)
    refused("site 'level': its distribution gives no mean and variance", shifted)


@pytest.mark.full
@pytest.mark.parametrize("scale", [-0.5, 0.5])
def test_a_negative_scale_has_no_moments(scale):
    """Its square is a variance, by which a Kalman filter would go on where the density says that nothing is possible."""

    def first(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def walk(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"], inputs))

    def seen(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], inputs))

    compiled = StateSpaceModel(first, walk, seen).compile(1.0)
    for found in (compiled.transition_moments, compiled.observation_moments):
        assert np.isnan(jax.jit(found)(jnp.zeros(1), scale)[1]).all() == (scale < 0)
