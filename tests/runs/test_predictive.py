"""Predictive checks: exact ranks under the truth, counts, masks, the first frame, and what they leave alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian
from scipy.stats import kstest

from poseppl.filters import Filter, kalman_filter, particle_filter
from poseppl.program import CompiledModel, StateSpaceModel
from poseppl.runs.checkpoint import Checkpoint
from poseppl.runs.predictive import _explained, _left, _rank, _stratified, predictive_checks
from poseppl.runs.run import Run, run_filter

FRAMES = 300
LINEAR = linear_gaussian(3, 2).compile()
CHECKS = predictive_checks(LINEAR)
KALMAN, PARTICLE = kalman_filter(LINEAR, 500), particle_filter(LINEAR, 64)


def simulate(model: CompiledModel, frames: int, seed: int) -> dict[str, np.ndarray]:
    """Data of a sequence that the model itself draws."""
    key_first, key_states, key_data = jax.random.split(jax.random.key(seed), 3)
    first = model.sample_initial(key_first)

    def step(x: jax.Array, key: jax.Array) -> tuple[jax.Array, jax.Array]:
        new = model.sample_transition(key, x)
        return new, new

    _, later = jax.lax.scan(step, first, jax.random.split(key_states, frames - 1))
    states = jnp.concatenate([first[None], later])
    data = jax.vmap(model.sample_observation)(jax.random.split(key_data, frames), states)
    return {name: np.array(values) for name, values in data.items()}


def collect(rng_key: jax.Array, state: Any, info: Any, inputs: Any) -> Any:
    return jax.random.normal(rng_key), state.particles[0]


def check(filter: Filter, model: CompiledModel, data: dict[str, Any], **options: Any) -> Run:
    predict = CHECKS if model is LINEAR else predictive_checks(model)
    return run_filter(filter, jax.random.key(1), model.observe(data), collect=collect, predict=predict, **options)


def overconfident(filter: Filter) -> Filter:
    """The same filter, but it hands on a quarter of its covariance."""

    def narrowed(result: Any) -> Any:
        state, info = result
        mean = state.posterior.mean
        posterior = state.posterior._replace(covariance=state.posterior.covariance / 4)
        return state._replace(particles=mean + (state.particles - mean) / 2, posterior=posterior), info

    return dataclasses.replace(filter, init=lambda *a: narrowed(filter.init(*a)), step=lambda *a: narrowed(filter.step(*a)))


@pytest.mark.full
def test_ranks_are_uniform_under_the_exact_filter() -> None:
    prediction = check(KALMAN, LINEAR, simulate(LINEAR, FRAMES, 0)).prediction.data
    assert prediction.transform.shape == (FRAMES, 2) and prediction.chi_square.shape == (FRAMES,)
    # innovations of a linear model are independent, and so are their ranks
    assert kstest(prediction.transform.ravel(), "uniform").pvalue > 0.01
    assert kstest(prediction.chi_square_transform, "uniform").pvalue > 0.01
    variance = prediction.state_variance + prediction.noise_variance
    squares = prediction.innovation**2 / variance
    assert abs(squares.mean() - 1) < 4 * np.sqrt(2 / squares.size)
    np.testing.assert_allclose(prediction.noise_variance, 0.25, rtol=1e-5)
    settled = prediction.state_variance[50:].mean(axis=0)
    np.testing.assert_allclose(settled, _settled_variance(), rtol=0.05)  # 250 estimates of 200 draws each: 0.6 %
    # data are H x + noise of 0.25: the share of the states in tr((H P H' + R)^-1 (H P H' + R)), from covariances of 100 draws
    total = _settled()[0][:2, :2] + 0.25 * np.eye(2)
    share = 1 - 0.25 * np.trace(np.linalg.inv(total)) / 2
    np.testing.assert_allclose(prediction.state_share[50:].mean(), share, atol=0.01)


def _settled_variance() -> np.ndarray:
    return np.diag(_settled()[0])[:2]


def _settled() -> tuple[np.ndarray, np.ndarray]:
    """Predicted and filtered covariance (3, 3)."""
    A, P = 0.9 * np.eye(3) + 0.1 * np.eye(3, k=1), np.eye(3)
    H = np.eye(2, 3)
    for _ in range(200):
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + 0.25 * np.eye(2))
        filtered = P - gain @ H @ P
        P = A @ filtered @ A.T + 0.25 * np.eye(3)
    return P, filtered


def test_what_is_predicted_of_the_state_is_what_the_exact_filter_makes_of_it() -> None:
    """Its variance, how much of that the data take away, and its slope on the frame before."""
    data, prediction = check(KALMAN, LINEAR, simulate(LINEAR, FRAMES, 0)).prediction
    predicted, filtered = _settled()
    settled = slice(50, None)
    # 250 estimates of 200 draws each: variances err by 0.6 %, shares by as much of what is left, slopes by 0.004
    np.testing.assert_allclose(prediction.predicted_variance[settled].mean(0), np.diag(predicted), rtol=0.03)
    left = 1 - prediction.explained[settled].mean(0)
    np.testing.assert_allclose(left, np.diag(filtered) / np.diag(predicted), rtol=0.03)
    before = 0.9 + 0.1 * np.diag(filtered, k=1) / np.diag(filtered)[:2]
    np.testing.assert_allclose(prediction.autoregression[settled].mean(0), [*before, 0.9], atol=0.02)
    np.testing.assert_allclose(prediction.predicted_error**2, prediction.predicted_variance / 200, rtol=1e-5)
    moved = prediction.predicted_mean[settled, :2] + data.innovation[settled] - simulate(LINEAR, FRAMES, 0)["y"][settled]
    assert np.abs(moved).max() < 1e-4  # of a state that is seen exactly


@pytest.mark.slow
def test_ranks_of_an_overconfident_filter_heap_at_both_ends() -> None:
    filter = overconfident(KALMAN)
    prediction = check(filter, LINEAR, simulate(LINEAR, FRAMES, 0)).prediction.data
    outer = np.abs(prediction.transform - 0.5) > 0.45
    assert outer.mean() - 0.1 > 3 * np.sqrt(0.09 / outer.size)
    assert kstest(prediction.transform.ravel(), "uniform").pvalue < 0.05


def counts_model() -> StateSpaceModel:
    def initial(params, inputs):
        numpyro.sample("level", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("level", dist.Normal(0.9 * state["level"], 0.4))

    def observation(params, state, inputs):
        numpyro.sample("count", dist.Poisson(jnp.exp(0.5 * state["level"]).repeat(2)))

    return StateSpaceModel(initial, transition, observation)


@pytest.mark.full
def test_ranks_of_counts_are_randomised_to_uniform() -> None:
    model = counts_model().compile()
    data = simulate(model, FRAMES, 3)
    prediction = check(particle_filter(model, 500), model, data).prediction.data
    ranks = prediction.transform.ravel()
    assert (data["count"] == 0).mean() > 0.2  # without chance all of these would share one rank
    assert kstest(ranks, "uniform").pvalue > 0.01 and len(np.unique(ranks)) > 0.95 * ranks.size
    assert kstest(prediction.chi_square_transform, "uniform").pvalue > 0.01
    assert np.isfinite(prediction.noise_variance).all()


@pytest.mark.full
def test_what_was_not_seen_is_not_judged() -> None:
    data = simulate(LINEAR, 12, 5)
    whole = check(KALMAN, LINEAR, data).prediction.data
    data["y"][4, 1] = np.nan
    data["y"][7] = np.nan
    prediction, state = check(KALMAN, LINEAR, data).prediction
    for name in ("transform", "innovation", "state_variance", "noise_variance"):
        values = getattr(prediction, name)
        assert np.isnan(values[4, 1]) and np.isnan(values[7]).all() and np.isnan(values).sum() == 3, name
    np.testing.assert_array_equal(state.explained[7], 0.0)
    assert abs(state.explained[4, 1]) < 0.1 < state.explained[4, 0]
    missing = np.isnan(prediction.chi_square)
    assert missing[7] and missing.sum() == 1 and np.isnan(prediction.chi_square_transform).sum() == 1
    np.testing.assert_array_equal(prediction.transform[:4], whole.transform[:4])


@pytest.mark.slow
def test_the_first_frame_is_judged_by_the_initial_program() -> None:
    """Many sequences of one frame; with `init` (particle) and with a state before the first frame (Kalman)."""
    model = linear_gaussian(1, P=[[4.0]], m=[3.0], R=[[1.0]]).compile()
    first = np.random.default_rng(0).normal(3.0, np.sqrt(5.0), 200)
    for filter in (particle_filter(model, 50), kalman_filter(model, 50)):
        runs = [check(filter, model, {"y": [[y]]}).prediction.data for y in (-20.0, 3.0, 26.0)]
        assert [bool(run.transform[0, 0] < 0.01) for run in runs] == [True, False, False]
        assert [bool(run.transform[0, 0] > 0.99) for run in runs] == [False, False, True]
        assert 3.0 < runs[1].state_variance[0, 0] < 5.2
    predict, empty = predictive_checks(model), model.unobserved()
    state, _ = particle_filter(model, 50).init(jax.random.key(0), empty, None)

    def rank(key: jax.Array, y: jax.Array) -> jax.Array:
        seen = empty._replace(values={"y": y[None]}, mask={"y": jnp.ones(1, bool)})
        return predict(key, state, True, seen, None).data.transform

    ranks = jax.vmap(rank)(jax.random.split(jax.random.key(0), 200), jnp.asarray(first))
    assert kstest(np.asarray(ranks).ravel(), "uniform").pvalue > 0.01


@pytest.mark.full
def test_checks_of_the_data_alone_are_the_same() -> None:
    data = LINEAR.observe(simulate(LINEAR, 5, 2))
    whole, part = (
        run_filter(
            KALMAN, jax.random.key(4), data, collect=collect, predict=predictive_checks(LINEAR, of_state=told)
        ).prediction
        for told in (True, False)
    )
    assert whole is not None and part is not None and whole.state is not None and part.state is None
    for one, other in zip(whole.data, part.data, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5)


@pytest.mark.full
def test_a_filter_does_the_same_with_checks_as_without() -> None:
    data = LINEAR.observe(simulate(LINEAR, 20, 2))
    for filter in (PARTICLE, KALMAN):
        plain = run_filter(filter, jax.random.key(4), data, collect=collect)
        checked = run_filter(filter, jax.random.key(4), data, collect=collect, predict=CHECKS)
        assert plain.prediction is None and checked.prediction is not None
        for one, other in ((plain.outputs, checked.outputs), (plain.info, checked.info), (plain.state, checked.state)):
            jax.tree.map(np.testing.assert_array_equal, one, other)


@pytest.mark.full
def test_a_resumed_run_has_the_same_predictions(tmp_path: Path) -> None:
    data = simulate(LINEAR, 20, 2)
    for number, filter in enumerate((PARTICLE, KALMAN)):
        whole = check(filter, LINEAR, data, chunk=4)
        folder = tmp_path / str(number)
        check(filter, LINEAR, data, chunk=4, checkpoint=Checkpoint(folder))
        parts = sorted(folder.glob("part-*"))
        for part in parts[3:]:
            part.unlink()
        resumed = check(filter, LINEAR, data, chunk=4, checkpoint=Checkpoint(folder, resume=True))
        assert resumed.resumed == 9
        jax.tree.map(np.testing.assert_array_equal, whole.prediction, resumed.prediction)


def test_heuristic_likelihoods_predict_nothing() -> None:
    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 1.0))
        numpyro.factor("hint", -jnp.sum(state["x"] ** 2))

    programs = linear_gaussian(2)
    model = StateSpaceModel(programs.initial, programs.transition, observation).compile()
    assert "'hint' is a factor" in str(model.why_not_predictive())
    assert LINEAR.why_not_predictive() is None
    with pytest.raises(ValueError, match="predicts no data: 'hint' is a factor"):
        check(particle_filter(model, 10), model, {"y": np.zeros((2, 2))})


@pytest.mark.full
def test_more_coordinates_than_draws():
    """The share that data explain of each of 30 coordinates, from 20 states, by the formula on their covariance."""
    rng = np.random.default_rng(1)
    states, scores = rng.normal(size=(20, 30)), np.zeros((20, 30))
    scores[:, 0] = 3.0 * rng.normal(size=20)
    found = np.asarray(_explained(jnp.asarray(states, jnp.float32), jnp.asarray(scores, jnp.float32)), float)
    covariance, information = np.cov(states.T), scores.T @ scores / 20
    left = covariance - covariance @ information @ np.linalg.inv(np.eye(30) + covariance @ information) @ covariance
    gains = np.trace(covariance @ information @ np.linalg.inv(np.eye(30) + covariance @ information))
    np.testing.assert_allclose(found, 1 - np.diag(left) / np.diag(covariance) * 19 / (19 - gains), atol=1e-4)
    assert found[0] > 0.7 > np.abs(found[1:]).max()


def test_what_data_leave_of_errors_is_what_the_exact_filter_does() -> None:
    """In twelve coordinates of which four are seen; of 200 draws estimates err by 0.07 and less, of 400 means by 0.004."""
    rng = np.random.default_rng(3)
    root, seen = rng.normal(size=(12, 12)), np.eye(12)[:4] * 2.0
    covariance, information = root @ root.T, seen.T @ seen
    states = (rng.normal(size=(400, 200, 12)) @ root.T).astype(np.float32)
    found = np.asarray(jax.vmap(_left, (0, None))(jnp.asarray(states), jnp.asarray(information, jnp.float32))).mean(0)
    exact = np.linalg.inv(np.eye(12) + covariance @ information)
    np.testing.assert_allclose(found, exact, atol=0.02)
    assert np.abs(exact - exact.T).max() > 0.2


def test_weighted_draws_have_the_weighted_distribution() -> None:
    """Each coordinate separately; no position in a stratum is preferred, so the share below any value is right on average."""
    rng = np.random.default_rng(2)
    states, weights = rng.normal(size=(30, 2)), rng.dirichlet(np.ones(30))
    offsets = (np.arange(500) + 0.5) / 500
    draw = jax.jit(jax.vmap(_stratified, (None, None, 0)))
    found = np.asarray(draw(*(jnp.asarray(each, jnp.float32) for each in (states, weights, offsets))))
    assert found.shape == (500, 20, 2) and (np.diff(found, axis=1) >= 0).all()
    for value in (-0.8, 0.1, 1.3):
        np.testing.assert_allclose((found < value).mean((0, 1)), weights @ (states < value), atol=1 / 500)


def test_ranks_among_eight_draws_are_uniform() -> None:
    """For any number of draws: 3000 sequences of one frame, and the chi-square by four of the draws among the other four."""
    model = linear_gaussian(2, m=[1.0, -1.0]).compile()
    predict, empty = predictive_checks(model, 8, of_state=False), model.unobserved()
    state, _ = PARTICLE.init(jax.random.key(0), LINEAR.unobserved(), None)
    state = state._replace(particles=state.particles[:, :2])  # of no matter to a first frame
    data = np.random.default_rng(6).normal([1.0, -1.0], np.sqrt(1.25), (3000, 2))

    def ranks(key: jax.Array, y: jax.Array) -> tuple[Any, Any]:
        seen = empty._replace(values={"y": y}, mask={"y": jnp.ones(2, bool)})
        told = predict(key, state, True, seen, None).data
        return told.transform, told.chi_square_transform

    found = jax.jit(jax.vmap(ranks))(jax.random.split(jax.random.key(0), 3000), jnp.asarray(data))
    for each in (found[0][:, 0], found[0][:, 1], found[1]):
        assert kstest(np.asarray(each), "uniform").pvalue > 0.01


def test_ranks_of_draws_that_are_equal_to_the_data() -> None:
    """The value has the second, third or fourth of five ranks among four draws, by chance."""
    draws, ties = jnp.array([2.0, 1.0, 3.0, 2.0]), jnp.array([0.0, 0.5, 1.0])
    np.testing.assert_allclose(_rank(ties, draws[:, None], jnp.full(3, 2.0)), [0.2, 0.5, 0.8], rtol=1e-6)
