"""The exact filter of finite states against the forward-backward oracle."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import TWO_STATES
from oracles.forward_backward import forward_backward
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.growth import growth

from poseppl.filters import hidden_markov, hidden_markov_filter
from poseppl.filters.hidden_markov import state_values
from poseppl.filters.scan import scan_filter
from poseppl.program import StateSpaceModel
from poseppl.runs.log_likelihood import log_likelihood
from poseppl.runs.run import run_filter
from poseppl.smoothers import collect_history, forward_backward_smoother

RNG = np.random.default_rng(5)
FIVE = (RNG.dirichlet(np.ones(5)), RNG.dirichlet(np.ones(5), 5), RNG.dirichlet(np.ones(3), 5))


@pytest.mark.parametrize("matrices", [TWO_STATES, FIVE], ids=["two", "five"])
def test_equal_to_forward_filtering(matrices):
    model = finite_hmm(*matrices).compile()
    symbols = RNG.integers(0, 3, 12)
    seen = np.arange(12) != 4
    observations = model.observe({"y": symbols.astype(np.int32)}, {"y": seen})
    run = run_filter(hidden_markov_filter(model), jax.random.key(0), observations, collect=collect_history)
    filtered, _, increments = forward_backward(*matrices, np.where(seen, symbols, -1))
    np.testing.assert_allclose(np.exp(run.outputs.log_weights), filtered, atol=1e-6)
    np.testing.assert_allclose(run.info.log_evidence, increments, atol=1e-5)


@pytest.mark.parametrize("most", [0, 2**22], ids=["frame by frame", "densities at once"])
@pytest.mark.parametrize("frames", [1, 12])
def test_densities_of_all_frames_at_once_change_nothing(frames, most, monkeypatch):
    """The oracle's evidence, and its differences by a parameter, with an input that changes the transition of each frame."""
    monkeypatch.setattr(hidden_markov, "_MAX_AT_ONCE", most)
    stay, symbols = RNG.uniform(0.5, 0.9, frames), RNG.integers(0, 2, frames).astype(np.int32)

    def start(params, inputs):
        numpyro.sample("x", dist.Bernoulli(0.3))

    def move(params, state, inputs):
        numpyro.sample("x", dist.Bernoulli(jnp.where(state["x"] == 1, inputs, 1 - inputs)))

    def observe(params, state, inputs):
        numpyro.sample("y", dist.Bernoulli(jnp.where(state["x"] == 1, params["hit"], 0.2)))

    def parameters():
        numpyro.sample("hit", dist.Uniform(0.0, 1.0))

    def evidence(hit):
        chances, total = np.array([0.7, 0.3]), 0.0
        for t, symbol in enumerate(symbols):
            if t:
                chances = chances @ np.array([[stay[t], 1 - stay[t]], [1 - stay[t], stay[t]]])
            chances = chances * np.abs([0.2, hit] - (1.0 - symbol))
            total += np.log(chances.sum())
            chances = chances / chances.sum()
        return total

    model = StateSpaceModel(start, move, observe, parameters).compile(0.5)
    value, slope = jax.value_and_grad(
        lambda hit: log_likelihood(model, {"hit": hit}, {"y": symbols}, hidden_markov_filter, inputs=stay)
    )(0.8)
    np.testing.assert_allclose(value, evidence(0.8), rtol=1e-5)
    np.testing.assert_allclose(slope, (evidence(0.8 + 1e-5) - evidence(0.8 - 1e-5)) / 2e-5, rtol=1e-4)


@pytest.mark.full
def test_values_of_several_sites():
    def start(params, inputs):
        numpyro.sample("gait", dist.Categorical(probs=np.full(3, 1 / 3)))
        numpyro.sample("contact", dist.Bernoulli(0.5).expand((2,)).to_event(1))

    def move(params, state, inputs):
        start(params, inputs)

    def observe(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["gait"] * 1.0, 1.0))

    values = state_values(StateSpaceModel(start, move, observe).compile())
    assert values.shape == (12, 3)
    assert len({tuple(row) for row in values}) == 12


@pytest.mark.full
def test_continuous_states_are_refused():
    with pytest.raises(ValueError, match="'x'.*particle filter"):
        hidden_markov_filter(growth().compile(1.0))


@pytest.mark.full
@pytest.mark.parametrize("matrices", [TWO_STATES, FIVE], ids=["two", "five"])
def test_in_parallel_it_is_forward_and_backward(matrices):
    """Filter, evidence and smoother against the oracle, with a frame without data, in both precisions."""
    symbols = RNG.integers(0, 3, 12)
    seen = np.arange(12) != 4
    filtered, smoothed, increments = forward_backward(*matrices, np.where(seen, symbols, -1))
    for double in (False, True):
        with jax.enable_x64(double):
            model = finite_hmm(*matrices).compile()
            observations = model.observe({"y": symbols.astype(np.int32)}, {"y": seen})
            built = hidden_markov_filter(model, schedule="parallel")
            history = scan_filter(built, jax.random.key(0), observations, collect=collect_history).outputs
            found = scan_filter(built, jax.random.key(0), observations).outputs.log_evidence
            after = forward_backward_smoother(model, parallel=True).smooth(jax.random.key(0), history, observations)
        tolerance = 1e-12 if double else 2e-6
        np.testing.assert_allclose(np.exp(np.asarray(history.log_weights)), filtered, atol=tolerance)
        np.testing.assert_allclose(found, increments, atol=5 * tolerance)
        np.testing.assert_allclose(np.exp(np.asarray(after.log_weights)), smoothed, atol=tolerance)


@pytest.mark.full
def test_long_series_in_parallel_neither_vanish_nor_lose_digits():
    """20,000 frames, whose likelihood float32 knows only as a logarithm; impossible data are reported."""
    model = finite_hmm(*TWO_STATES).compile()
    symbols = RNG.integers(0, 2, 20_000).astype(np.int32)
    observations = model.observe({"y": symbols})
    runs = [
        scan_filter(hidden_markov_filter(model, schedule=schedule), jax.random.key(0), observations).outputs
        for schedule in ("sequential", "parallel")
    ]
    np.testing.assert_allclose(runs[0].log_evidence, runs[1].log_evidence, atol=1e-5)
    never = (np.array([0.5, 0.5]), np.eye(2), np.eye(2))
    stuck = finite_hmm(*never).compile()
    data = stuck.observe({"y": np.array([0, 1, 1], np.int32)})
    info = scan_filter(hidden_markov_filter(stuck, schedule="parallel"), jax.random.key(0), data).outputs
    assert info.failed.tolist()[:2] == [False, True] and np.isneginf(info.log_evidence[1])
