"""Forecasts against the Kalman prediction, under the inputs that are, and under others."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from law_problems import problem
from oracles.kalman import kalman_filter, simulate

import poseppl
from poseppl.errors import InputError
from poseppl.runs.results import provenance

POSED = problem()
HORIZON, DRAWS = 4, 4000
LATER = np.array([[1.0], [-3.0], [0.5], [2.0]])
LEADING = ("chain", "draw")


def exact_prediction(known: int, inputs: np.ndarray):
    """Means and covariances of the states after the first `known` frames, by the oracle of which the later data are masked."""
    ys = np.concatenate([np.asarray(POSED.observations.values["y"])[:known], np.zeros((len(inputs), 2))])
    mask = np.concatenate([np.asarray(POSED.observations.mask["y"])[:known], np.zeros((len(inputs), 2), bool)])
    whole = np.concatenate([np.asarray(POSED.inputs)[:known], inputs])
    found = kalman_filter(POSED.matrices, ys, mask, whole)
    return found.means[known:], found.covariances[known:]


@pytest.fixture(scope="module")
def result():
    collect = poseppl.collect_draws(POSED.model, max_draws=DRAWS)
    kalman = poseppl.kalman_filter(POSED.model, num_particles=DRAWS)
    return poseppl.infer(POSED.model, POSED.observations, kalman, jax.random.key(0), POSED.inputs, collect=collect, rate=25.0)


def agrees(draws, means, variances) -> bool:
    """Whether draws (S, H, k) have these moments (H, k), within five standard errors."""
    number = draws.shape[0]
    mean = np.abs(draws.mean(0) - means) < 5 * np.sqrt(variances / number)
    spread = np.abs(draws.var(0, ddof=1) / variances - 1) < 5 * np.sqrt(2 / number)
    return bool(mean.all() and spread.all())


def test_a_forecast_is_the_kalman_prediction(result):
    ahead = poseppl.forecast(result, POSED.model, HORIZON, jax.random.key(1), LATER)
    means, covariances = exact_prediction(5, LATER)
    states = ahead["forecast/x"].values[0]
    assert ahead["forecast/x"].dims[:3] == ahead["predictions/y"].dims[:3] == (*LEADING, "frame")
    assert agrees(states, means, np.diagonal(covariances, axis1=1, axis2=2))
    H, R = POSED.matrices.H, POSED.matrices.R
    of_data = np.einsum("kd,tde,ke->tk", H, covariances, H) + np.diagonal(R)
    data = ahead["predictions/y"].values[0]
    assert agrees(data, means @ H.T, of_data)
    # wrong variants: the inputs one frame late, and data without the noise of their own
    late, _ = exact_prediction(5, np.roll(LATER, 1, 0))
    assert not agrees(states, late, np.diagonal(covariances, axis1=1, axis2=2))
    assert not agrees(data, means @ H.T, of_data - np.diagonal(R))
    np.testing.assert_array_equal(ahead["forecast"]["frame"], [5, 6, 7, 8])
    assert provenance(ahead)["forecast from frame"] == 4 and ahead.attrs["rate"] == 25.0


def test_other_inputs_from_an_earlier_frame_on_tell_what_would_have_come(result):
    ahead = poseppl.forecast(result, POSED.model, HORIZON, jax.random.key(1), -LATER, start=1)
    means, covariances = exact_prediction(2, -LATER)
    assert agrees(ahead["forecast/x"].values[0], means, np.diagonal(covariances, axis1=1, axis2=2))
    np.testing.assert_array_equal(ahead["predictions"]["frame"], [2, 3, 4, 5])


@pytest.mark.full
def test_draws_are_chosen_evenly_or_repeated(result):
    few, more = (
        poseppl.forecast(result, POSED.model, 4, jax.random.key(1), LATER, num_draws=number) for number in (50, 2 * DRAWS)
    )
    assert few["forecast/x"].shape == (1, 50, 4, 2) and more["predictions/y"].shape == (1, 2 * DRAWS, 4, 2)
    means, covariances = exact_prediction(5, LATER)
    assert agrees(more["forecast/x"].values[0, ::2], means, np.diagonal(covariances, axis1=1, axis2=2))


@pytest.mark.full
def test_a_smoothed_result_goes_on_from_its_last_frame_alone(result):
    smoothed = poseppl.smooth(
        result, poseppl.smoothers.rauch_tung_striebel_smoother(POSED.model), jax.random.key(2), POSED.inputs
    )
    assert poseppl.forecast(smoothed, POSED.model, 4, jax.random.key(1), LATER)["forecast"].sizes["frame"] == 4
    with pytest.raises(InputError, match="know the data after it"):
        poseppl.forecast(smoothed, POSED.model, 4, jax.random.key(1), LATER, start=2)


@pytest.mark.full
def test_what_does_not_fit_is_said(result):
    with pytest.raises(InputError, match="no frame 17 .*one of 0 to 4"):
        poseppl.forecast(result, POSED.model, 4, jax.random.key(1), LATER, start=17)
    with pytest.raises(ValueError, match="leading axis of 3"):
        poseppl.forecast(result, POSED.model, 3, jax.random.key(1), LATER)
    with pytest.raises(ValueError, match="horizon is 0"):
        poseppl.forecast(result, POSED.model, 0, jax.random.key(1), LATER)


@pytest.mark.slow
def test_forecasts_cover_the_data_that_come():
    """Eighty sequences of the model, each forecast from its middle: the coverage of 90 % intervals is 90 %."""
    inside, outside = [], []
    kalman = poseppl.kalman_filter(POSED.model, num_particles=300)
    inputs = np.ones((9, 1))
    for seed in range(80):
        _, ys = simulate(POSED.matrices, 9, seed, inputs)
        found = poseppl.infer(POSED.model, {"y": ys[:5]}, kalman, jax.random.key(seed), inputs[:5])
        ahead = poseppl.forecast(found, POSED.model, HORIZON, jax.random.key(1000 + seed), inputs[5:])
        bounds = ahead["predictions/y"].quantile([0.05, 0.95], LEADING).values
        inside.append((bounds[0] < ys[5:]) & (ys[5:] < bounds[1]))
        narrow = bounds.mean(0) + 0.5 * (bounds - bounds.mean(0))
        outside.append((narrow[0] < ys[5:]) & (ys[5:] < narrow[1]))
    covered, half = (poseppl.diagnostics.coverage(part, 0.9) for part in (inside, outside))
    assert abs(covered.estimate - 0.9) < 4 * covered.standard_error
    assert abs(half.estimate - 0.9) > 4 * half.standard_error


def test_forecasts_from_all_frames_are_kalman_predictions(result):
    predicted = poseppl.hindcast(result, POSED.model, 2, jax.random.key(3), POSED.inputs, num_draws=DRAWS)
    assert predicted["y"].dims[:4] == (*LEADING, "start", "lead") and predicted["start"].values.tolist() == [0, 1, 2]
    H, R, whole = POSED.matrices.H, POSED.matrices.R, np.asarray(POSED.inputs)
    for start in range(3):
        means, covariances = exact_prediction(start + 1, whole[start + 1 : start + 3])
        of_data = np.einsum("kd,tde,ke->tk", H, covariances, H) + np.diagonal(R)
        drawn = predicted["y"].sel(start=start).values[0]
        assert agrees(drawn, means @ H.T, of_data)
        # a wrong variant: the inputs of the frame before
        late, _ = exact_prediction(start + 1, whole[start : start + 2])
        assert not agrees(drawn, late @ H.T, of_data)
    with pytest.raises(InputError, match="horizon: 5 .*less than the result's 5"):
        poseppl.hindcast(result, POSED.model, 5, jax.random.key(3), POSED.inputs)
