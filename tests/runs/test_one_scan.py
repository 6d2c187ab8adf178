"""One key is one run, whatever drives it: the scan, infer, log_likelihood, a batch, or frames one at a time."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import TWO_STATES
from poseppl_models.toys.finite_hmm import finite_hmm
from test_log_likelihood import DATA, MODEL, PARAMS

import poseppl
from poseppl.filters import Filter, hidden_markov_filter, kalman_filter, particle_filter, tempered_filter
from poseppl.filters.base import filter_info
from poseppl.filters.sequential_monte_carlo import ParticleState
from poseppl.runs.online_run import OnlineRun
from poseppl.runs.run import run_filter

KEY = jax.random.key(4)
BOUND = MODEL.with_params(PARAMS)
ROUNDING = {"rtol": 2e-5, "atol": 2e-5}
CHAOS = {"atol": 0.02}
"""Moves that are accepted or refused enlarge a difference in rounding; evidence of other keys differs by 0.3."""


def drawing():
    """A filter whose evidence is what it drew, in `step` plus 1, so that it says which key it had; it compiles quickly."""

    def of_key(rng_key, start):
        draw = start + jax.random.uniform(rng_key)
        info = filter_info(draw, 1.0, 1, jnp.asarray(False), num_likelihood=0)
        return ParticleState(draw[None, None], jnp.zeros(1)), info

    return Filter(lambda rng_key, data, inputs: of_key(rng_key, 0.0), lambda rng_key, state, data, inputs: of_key(rng_key, 1.0))


DRAWING = drawing()
OBSERVED = BOUND.observe(DATA)
SCANNED = jax.jit(lambda key: poseppl.scan_filter(DRAWING, key, OBSERVED).outputs.log_evidence)


def keep_evidence(rng_key, state, info, inputs):
    return info.log_evidence, jax.random.uniform(rng_key)


@pytest.mark.full
def test_every_drive_has_the_keys_of_the_scan():
    expected = SCANNED(KEY)
    for chunk in (1, 3, None):
        run = run_filter(DRAWING, KEY, OBSERVED, collect=keep_evidence, chunk=chunk)
        np.testing.assert_array_equal(run.info.log_evidence, expected)
    online = poseppl.Online(DRAWING, KEY)
    found = [online.update(jax.tree.map(lambda leaf, t=t: leaf[t], OBSERVED))[1].log_evidence for t in range(8)]
    np.testing.assert_array_equal(found, expected)
    parts = [jax.tree.map(lambda leaf, rows=rows: leaf[rows], OBSERVED) for rows in (slice(3), slice(3, None))]
    fed = OnlineRun(DRAWING, KEY, parts[0], collect=keep_evidence, note=pytest.fail)
    fed.add(parts[1])
    np.testing.assert_array_equal(fed.finish().info.log_evidence, expected)
    whole = poseppl.scan_filter(DRAWING, KEY, OBSERVED, collect=keep_evidence).outputs
    jax.tree.map(np.testing.assert_array_equal, whole, tuple(run.outputs))


def test_the_key_of_a_frame_is_that_of_its_number():
    def draw(key, frame):
        return (frame > 0) + jax.random.uniform(jax.random.split(jax.random.fold_in(key, frame))[0])

    keys = jax.random.split(KEY, 3)
    many, expected = jax.jit(
        lambda keys: (jax.vmap(SCANNED)(keys), jax.vmap(jax.vmap(draw, (None, 0)), (0, None))(keys, jnp.arange(8)))
    )(keys)
    np.testing.assert_array_equal(many, expected)
    np.testing.assert_array_equal(many[1], SCANNED(keys[1]))


FILTERS = {
    "particle": lambda model: particle_filter(model, 30),
    "kalman": lambda model: kalman_filter(model, 4),
    "tempered": lambda model: tempered_filter(model, 20),
}


def assert_one_run(model, data, build, tolerance=ROUNDING):
    result = poseppl.infer(model, data, build, KEY)
    value = jax.jit(lambda data: poseppl.log_likelihood(model, None, data, build, KEY))(model.observe(data))
    np.testing.assert_allclose(value, result["sample_stats/log_evidence"].sum(), **tolerance)
    return result


@pytest.mark.full
@pytest.mark.parametrize("name", FILTERS)
def test_infer_and_log_likelihood_of_a_key_are_one_run(name):
    build, tolerance = FILTERS[name], CHAOS if name == "tempered" else ROUNDING
    result = assert_one_run(BOUND, DATA, build, tolerance)
    filter = build(BOUND)
    scan = jax.jit(jax.vmap(lambda key: poseppl.scan_filter(filter, key, OBSERVED)))(jnp.stack([jax.random.key(9), KEY]))
    # the second in order, for whatever takes a batch's keys for the first one's
    np.testing.assert_allclose(scan.outputs.log_evidence[1], result["sample_stats/log_evidence"], **tolerance)
    if name != "kalman":
        assert np.abs(np.diff(scan.outputs.log_evidence, axis=0)).max() > 1e-3
    # the diagnosis alone is kept, none of it as long as the particles
    assert {leaf.shape for leaf in jax.tree.leaves(scan.outputs)} == {(2, 8), (2, 8, 0)} and scan.prediction is None


@pytest.mark.full
def test_a_hidden_markov_filter_is_one_run():
    model = finite_hmm(*TWO_STATES).compile()
    assert_one_run(model, {"y": np.arange(12, dtype=np.int32) % 3}, hidden_markov_filter)


@pytest.mark.full
@pytest.mark.parametrize("name", ["particle", "kalman"])
def test_a_series_of_a_batch_is_a_run_of_its_own_key(name):
    series = {"y": np.stack([DATA["y"], DATA["y"] + 1, DATA["y"]])}
    batch = poseppl.infer_batch(BOUND, series, FILTERS[name], KEY, chunk=2)
    for number in range(3):
        alone = poseppl.infer(BOUND, {"y": series["y"][number]}, FILTERS[name], jax.random.fold_in(KEY, number))
        found = batch["sample_stats/log_evidence"].sel(series=number)
        np.testing.assert_allclose(found, alone["sample_stats/log_evidence"], **ROUNDING)


@pytest.mark.full
def test_the_gradient_of_the_scan_is_that_of_the_log_likelihood():
    def evidence(params):
        return poseppl.scan_filter(kalman_filter(MODEL.with_params(params), 1), KEY, OBSERVED).outputs.log_evidence.sum()

    def reference(params):
        return poseppl.log_likelihood(MODEL, params, OBSERVED, lambda model: kalman_filter(model, 1))

    found, expected = (jax.jit(jax.grad(function))(PARAMS) for function in (evidence, reference))
    assert all(abs(value) > 1e-3 for value in found.values())
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4), found, expected)


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="a leading axis of 8 frames"):
        poseppl.scan_filter(DRAWING, KEY, OBSERVED, np.zeros(7))
    with pytest.raises(ValueError, match="Expected an Observation"):
        poseppl.scan_filter(DRAWING, KEY, DATA)
    with pytest.raises(ValueError, match="key"):
        poseppl.scan_filter(DRAWING, 3, OBSERVED)
