"""Parallel passes against the sequential ones: gaps, inputs, unequal scales, one frame, both precisions."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.compilation import double_precision
from poseppl.errors import UnsuitableModelError
from poseppl.filters.in_parallel import is_linear, wants_parallel
from poseppl.smoothers.rauch_tung_striebel import rauch_tung_striebel_smoother, smoothed_moments

DRIFT = np.array([[1.0, 0.5, 0.0], [0.0, 0.9, 0.1], [0.0, -0.2, 0.8]])
SCALES = np.array([1.0, 0.01, 30.0])


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(jnp.array([1.0, 0.02, -20.0]), SCALES).to_event(1))


def transition(params, state, inputs):
    unit = state["x"] / SCALES
    moved = DRIFT @ unit + 0.1 * inputs["push"]
    numpyro.sample("x", dist.Normal(SCALES * moved, 0.3 * SCALES).to_event(1))


def observation(params, state, inputs):
    numpyro.sample("near", dist.Normal(state["x"][0] + 0.1 * state["x"][2] - inputs["push"], 0.5))
    numpyro.sample("far", dist.Normal(state["x"][2], 10.0))


def problem(num_frames):
    rng = np.random.default_rng(num_frames)
    push = rng.normal(size=num_frames).astype(np.float32)
    model = poseppl.StateSpaceModel(initial, transition, observation).compile({"push": jnp.float32(0.0)})
    near, far = rng.normal(size=num_frames), 20 * rng.normal(size=num_frames) - 20
    near[1::3] = far[2:4] = np.nan
    return model, {"near": near, "far": far}, {"push": push}


def both(num_frames, **how):
    model, data, inputs = problem(num_frames)
    observed = model.observe(data)
    return [smoothed_moments(model, observed, inputs, parallel=parallel, **how) for parallel in (False, True)]


def assert_equal(one, other, tolerance):
    deviation = np.sqrt(np.diagonal(one.covariance, axis1=1, axis2=2))
    assert np.abs((one.mean - other.mean) / deviation).max() < tolerance
    apart = (one.covariance - other.covariance) / deviation[:, :, None] / deviation[:, None]
    assert np.abs(apart).max() < tolerance


@pytest.mark.parametrize("num_frames", [2, pytest.param(13, marks=pytest.mark.full)])
def test_both_passes_are_those_of_kalman_and_rauch_tung_striebel(num_frames):
    assert_equal(*both(num_frames), 2e-4)


@pytest.mark.full
@pytest.mark.parametrize("linearisation", ["first-order", "unscented"])
def test_in_double_precision_they_are_equal(linearisation):
    with double_precision():
        assert_equal(*both(50, linearisation=linearisation), 1e-9)


@pytest.mark.full
def test_a_program_that_is_not_linear_needs_iterations():
    """Both end in the same fixed point; without iterations, the parallel passes are linearised at the initial mean."""

    def curved(params, state, inputs):
        numpyro.sample("near", dist.Normal(state["x"][0] + 0.5 * jnp.sin(state["x"][0]), 0.5))
        numpyro.sample("far", dist.Normal(state["x"][2], 10.0))

    model = poseppl.StateSpaceModel(initial, transition, curved).compile({"push": jnp.float32(0.0)})
    _, data, inputs = problem(8)
    observed = model.observe(data)

    def found(parallel, iterations):
        return smoothed_moments(model, observed, inputs, parallel=parallel, num_iterations=iterations)

    assert_equal(found(False, 30), found(True, 30), 5e-3)
    with pytest.raises(AssertionError):
        assert_equal(found(False, 1), found(True, 1), 5e-3)


def test_a_result_is_smoothed_in_parallel():
    model, data, inputs = problem(13)
    filtered = poseppl.infer(model, data, poseppl.kalman_filter, jax.random.key(0), inputs)
    trees = [
        poseppl.smooth(
            filtered, rauch_tung_striebel_smoother(model, num_draws=20, parallel=parallel), jax.random.key(1), inputs
        )
        for parallel in (False, True)
    ]
    for name in ("summary/x_mean", "posterior/x"):
        one, other = (tree[name].values / SCALES for tree in trees)
        np.testing.assert_allclose(one, other, atol=2e-3)


@pytest.mark.full
@pytest.mark.parametrize("double", [False, True])
def test_a_filter_in_parallel_is_the_filter(double):
    """States, evidence, predictive checks, draws and the gradient by an input; with gaps, and with one frame."""
    tolerance = 1e-6 if double else 3e-4  # inputs are in single precision
    with double_precision(double):
        model, data, inputs = problem(13)
        predict = poseppl.predictive_checks(model)

        def run(schedule):
            def total(shift):
                built, moved = poseppl.kalman_filter(model, 5, schedule=schedule), {"push": inputs["push"] + shift}
                scan = poseppl.scan_filter(built, jax.random.key(0), model.observe(data), moved, collect=kept, predict=predict)
                return scan.outputs[2].sum(), (scan.outputs, scan.prediction.data.chi_square, scan.state.particles / SCALES)

            (_, found), slope = jax.jit(jax.value_and_grad(total, has_aux=True))(jnp.asarray(0.1))
            return jax.tree.map(np.asarray, (*found, slope))

        one, other = run("sequential"), run("parallel")
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=10 * tolerance, rtol=tolerance), one, other)


def kept(rng_key, state, info, inputs):
    return state.posterior.mean / SCALES, state.posterior.covariance / np.outer(SCALES, SCALES), info.log_evidence


@pytest.mark.full
def test_one_frame_and_the_log_likelihood_in_parallel():
    model, data, inputs = problem(9)
    for frames in (1, 9):
        rows = {name: values[:frames] for name, values in data.items()}
        found = [
            poseppl.log_likelihood(
                model, None, rows, partial(poseppl.kalman_filter, schedule=schedule), inputs={"push": inputs["push"][:frames]}
            )
            for schedule in ("sequential", "parallel")
        ]
        assert float(found[0]) == pytest.approx(float(found[1]), abs=1e-3)


def test_programs_that_are_not_linear_are_refused_in_parallel_and_run_in_turn_by_themselves(monkeypatch):
    def curved(params, state, inputs):
        numpyro.sample("near", dist.Normal(jnp.sin(state["x"][0]), 0.5))

    model = poseppl.StateSpaceModel(initial, transition, curved).compile({"push": jnp.float32(0.0)})
    _, data, inputs = problem(4)
    value = lambda **how: poseppl.log_likelihood(  # noqa: E731
        model, None, {"near": data["near"]}, partial(poseppl.kalman_filter, **how), inputs=inputs
    )
    with pytest.raises(UnsuitableModelError, match="schedule='sequential'"):
        value(schedule="parallel")
    assert not is_linear(model, inputs) and is_linear(problem(4)[0], inputs)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    built = poseppl.kalman_filter(model)
    assert built.in_parallel(jnp.zeros(4), model.observe({"near": data["near"]}), lambda: inputs) is None
    assert wants_parallel("auto", True) and not wants_parallel("auto", False) and not wants_parallel("sequential", True)
