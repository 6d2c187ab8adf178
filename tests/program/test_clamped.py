"""Clamping: the full model as a function of some coordinates."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.filters import particle_filter
from poseppl.program import Clamped, CompiledModel, StateSpaceModel, clamp
from poseppl.runs.run import run_filter

FREE = ("a", "c")
INDICES = np.array([0, 3, 4])
A = jnp.asarray(np.random.default_rng(1).normal(0.0, 0.4, (5, 5)))


def initial(params, inputs):
    numpyro.sample("a", dist.Normal(inputs[0], 1.0))
    numpyro.sample("b", dist.Normal(jnp.zeros(2), 0.5).to_event(1))
    numpyro.sample("c", dist.Normal(jnp.ones(2), 2.0).to_event(1))


def transition(params, state, inputs):
    mean = A @ jnp.concatenate([state["a"][None], state["b"], state["c"]]) + inputs[0]
    b = numpyro.sample("b", dist.Normal(mean[1:3], 0.5).to_event(1))
    numpyro.sample("a", dist.Normal(mean[0] + b[0], 1.0))
    numpyro.sample("c", dist.Normal(mean[3:], 2.0).to_event(1))


def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(jnp.concatenate([state["a"] * state["b"], state["c"]]), 1.0).to_event(1))


@pytest.fixture(scope="module")
def full():
    return StateSpaceModel(initial, transition, observation).compile(np.zeros(1))


@pytest.fixture(scope="module")
def inputs():
    values = jnp.arange(5.0)
    return Clamped(jnp.ones(1), values, values - 0.5)


X = jnp.array([-1.0, -2.0, -4.0])
PREVIOUS = jnp.array([0.1, 0.2, 0.4])
FULL_X = jnp.array([-1.0, 1.0, 2.0, -2.0, -4.0])
FULL_PREVIOUS = jnp.array([0.1, 0.5, 1.5, 0.2, 0.4])


def log_normal(x, mean, scale):
    return jnp.sum(dist.Normal(mean, scale).log_prob(x))


def test_it_is_a_compiled_model(full):
    clamped = clamp(full, FREE)
    assert isinstance(clamped, CompiledModel)
    assert clamped.dimension == 3
    assert clamped.coordinate_names == ("a", "c[0]", "c[1]")
    assert clamp(full, [3, "a", "c[1]"]).coordinate_names == clamped.coordinate_names


def test_densities_are_those_of_the_free_sites(full, inputs):
    """The likelihood is the full model's; what is clamped adds nothing to the state's density."""
    clamped = clamp(full, FREE)
    data = full.observe({"y": np.arange(4.0)})
    mean = A @ FULL_PREVIOUS + 1.0
    for found, expected in [
        (clamped.log_initial(X, inputs), log_normal(X[0], 1.0, 1.0) + log_normal(X[1:], 1.0, 2.0)),
        (clamped.log_transition(X, PREVIOUS, inputs), log_normal(X[0], mean[0] + 1.0, 1.0) + log_normal(X[1:], mean[3:], 2.0)),
        (clamped.log_observation(X, data, inputs), full.log_observation(FULL_X, data, inputs.inputs)),
        (full.to_flat(clamped.to_sites(X, inputs)), FULL_X),
        (clamped.to_flat(full.to_sites(FULL_X)), X),
    ]:
        np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_draws_are_those_of_their_moments(full, inputs):
    """The site that depends on a clamped one of its frame is moved by it; in the full model both vary together."""
    clamped = clamp(full, FREE)
    mean, covariance = clamped.transition_moments(PREVIOUS, inputs)
    expected = (A @ FULL_PREVIOUS + 1.0)[INDICES] + jnp.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(mean, expected, rtol=1e-5)
    np.testing.assert_allclose(covariance, np.diag([1.0, 4.0, 4.0]), rtol=1e-5)
    keys = jax.random.split(jax.random.key(0), 4000)
    draws = jax.vmap(lambda key: clamped.sample_transition(key, PREVIOUS, inputs))(keys)
    assert (np.abs(draws.mean(0) - mean) < 5 * np.sqrt(np.diagonal(covariance) / 4000)).all()
    mean, covariance = full.transition_moments(FULL_PREVIOUS, inputs.inputs)
    gain = covariance[INDICES][:, 1:3] @ jnp.linalg.inv(covariance[1:3, 1:3])
    np.testing.assert_allclose(mean[INDICES] + gain @ (inputs.values[1:3] - mean[1:3]), expected, rtol=1e-5)


@pytest.mark.full
def test_summaries_of_the_data_are_blocks(full, inputs):
    clamped = clamp(full, FREE)
    data = full.observe({"y": np.arange(4.0)})
    jacobian = full.observation_jacobian(FULL_X, inputs.inputs)
    np.testing.assert_allclose(clamped.observation_jacobian(X, inputs), jacobian[:, INDICES], rtol=1e-6)
    information = clamped.observation_information(X, data, inputs)
    expected = full.observation_information(FULL_X, data, inputs.inputs)[np.ix_(INDICES, INDICES)]
    np.testing.assert_allclose(information, expected, rtol=1e-6)


@pytest.mark.full
def test_gradient_is_that_of_the_free(full, inputs):
    clamped = clamp(full, FREE)
    data = full.observe({"y": np.arange(4.0)})
    found = jax.grad(clamped.log_observation)(X, data, inputs)
    expected = jax.grad(full.log_observation)(FULL_X, data, inputs.inputs)
    np.testing.assert_allclose(found, expected[INDICES], rtol=1e-6)


@pytest.mark.full
def test_a_filter_runs_on_it(full):
    clamped = clamp(full, FREE)
    rng = np.random.default_rng(0)
    data = full.observe({"y": rng.normal(size=(2, 4))})
    inputs = Clamped.of_trajectory(rng.normal(size=(2, 5)), rng.normal(size=(2, 1)))
    built = particle_filter(clamped, 50)
    frames = [jax.tree.map(lambda a, t=t: a[t], (data, inputs)) for t in range(2)]
    state, _ = built.init(jax.random.key(0), *frames[0])
    state, info = jax.jit(built.step)(jax.random.key(1), state, *frames[1])
    assert state.particles.shape == (50, 3)
    assert np.isfinite(info.log_evidence)


def test_what_is_clamped_to_other_values_is_the_same_program(full):
    """Models of the same free sites are one, and so are their filters: another recording's values trace nothing again."""
    assert clamp(full, FREE) is clamp(full, [3, "a", "c[1]"]) and clamp(full, FREE) is not clamp(full, ["b"])
    traced = []

    def counted(params, state, inputs):
        traced.append(inputs)
        observation(params, state, inputs)

    whole = StateSpaceModel(initial, transition, counted).compile(np.zeros(1))
    data, rng, evidence, counts = full.observe({"y": np.zeros((3, 4))}), np.random.default_rng(0), [], []

    def collect(rng_key, state, info, inputs):
        return state.particles[0]

    for _ in range(2):
        values = Clamped.of_trajectory(rng.normal(size=(3, 5)), np.zeros((3, 1)))
        run = run_filter(particle_filter(clamp(whole, FREE), 50), jax.random.key(0), data, values, collect=collect)
        evidence.append(float(run.info.log_evidence.sum()))
        counts.append(len(traced))
    assert counts[0] == counts[1] and evidence[0] != evidence[1]


def test_other_params():
    clamped = clamp(linear_gaussian(2).compile(params=1.0), ["x"]).with_params(2.0)
    assert clamped.params == clamped.full.params == 2.0


@pytest.mark.full
@pytest.mark.parametrize("free", [[], [0, 0], [5], [-1], ["x[7]"], ["b[0]"], ["a", 0]])
def test_refused(full, free):
    with pytest.raises(ValueError, match="free"):
        clamp(full, free)


@pytest.mark.full
def test_refused_inputs_and_clamping_twice(full):
    with pytest.raises(ValueError, match="inputs of type NoneType. Expected Clamped"):
        clamp(full, FREE).log_initial(X, None)
    with pytest.raises(ValueError, match="clamped already"):
        clamp(clamp(full, FREE), ["a"])


@pytest.mark.full
def test_a_trajectory_is_given_with_the_state_before_each(full):
    """The log-density of the free sites of three frames, given the others, by the formula."""
    rng = np.random.default_rng(5)
    states, given = rng.normal(size=(3, 5)), rng.normal(size=(3, 1))
    clamped = clamp(full, FREE)
    unseen = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), full.unobserved())
    found = clamped.log_joint(jnp.asarray(states)[:, INDICES], unseen, Clamped.of_trajectory(states, jnp.asarray(given)))
    expected = log_normal(states[0, 0], given[0, 0], 1.0) + log_normal(states[0, 3:], 1.0, 2.0)
    for t in (1, 2):
        mean = np.asarray(A) @ states[t - 1] + given[t, 0]
        expected += log_normal(states[t, 0], mean[0] + states[t, 1], 1.0) + log_normal(states[t, 3:], mean[3:], 2.0)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
