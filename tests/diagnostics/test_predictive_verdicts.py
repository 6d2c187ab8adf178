"""Verdicts of predictive checks, on scalar Kalman filters that are right, over-confident, or of the wrong model."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, kstest, norm

from poseppl.diagnostics import check_predictions, predictive_figures, verdicts
from poseppl.diagnostics.predictive import implied_coverage
from poseppl.runs.predictive import DataPrediction
from poseppl.runs.results import Names, build_result

FRAMES, ENTRIES = 300, 8
PRECISE, NOISY = 0.05, 4.0
"""Variances of the noise, that of a step being 0.25."""


def kalman(data: np.ndarray, noise: float, *, step: float = 0.25, narrow: float = 1.0) -> DataPrediction:
    """Predictions of data (T, k), each entry a random walk seen with noise; the posterior's variance is cut to `narrow`."""
    mean, variance, innovations, claimed = np.zeros(data.shape[1]), 1.0, [], []
    for row in data:
        innovations.append(row - mean)
        claimed.append(np.full(len(mean), variance))
        gain = variance / (variance + noise)
        mean, variance = mean + gain * (row - mean), narrow * (1 - gain) * variance + step
    z, state = np.array(innovations), np.array(claimed)
    white = z / np.sqrt(state + noise)
    squares = (white**2).sum(axis=1)
    share = state[:, 0] / (state[:, 0] + noise)
    whole = squares / data.shape[1], chi2.cdf(squares, data.shape[1]), share
    return DataPrediction(norm.cdf(white), z, state, np.full_like(z, noise), *whole)


def walks(noise: float, seed: int, steps: np.ndarray | None = None) -> np.ndarray:
    rng = np.random.default_rng(seed)
    moves = 0.5 * rng.standard_normal((FRAMES, ENTRIES)) if steps is None else steps
    moves[0] = rng.standard_normal(ENTRIES)
    return moves.cumsum(axis=0) + np.sqrt(noise) * rng.standard_normal((FRAMES, ENTRIES))


@pytest.mark.parametrize("noise", [PRECISE, NOISY])
def test_a_filter_that_is_right_is_let_be(noise: float) -> None:
    found = [kalman(walks(noise, seed), noise) for seed in range(30)]
    assert [check_predictions(prediction) for prediction in found] == [[]] * 30
    # the estimate is near 1, and its error is what it is said to be
    inflations = [predictive_figures(prediction).inflation for prediction in found]
    scores = np.array([(each.estimate - 1) / each.standard_error for each in inflations])
    assert abs(np.mean([each.estimate for each in inflations]) - 1) < 0.05
    assert 0.5 < np.square(scores).mean() < 2.0  # chi-square of 30: 1 +- 0.26, with errors from 17 batches


@pytest.mark.parametrize("noise", [PRECISE, NOISY])
def test_a_quarter_of_the_covariance_is_an_error(noise: float) -> None:
    for seed in range(10):
        (found,) = check_predictions(kalman(walks(noise, seed), noise, step=0.25 * 0.25, narrow=0.25))
        assert found.severity == "error" and "Overconfident" in found.text


def test_noise_that_hides_the_state_does_not_hide_over_confidence() -> None:
    """The sizes of the innovations hardly tell, their likeness to the frame before does."""
    figures = predictive_figures(kalman(walks(NOISY, 0), NOISY, step=0.15, narrow=0.9))
    assert figures.outer.estimate < 0.13
    assert figures.by_products.estimate - figures.by_products.half_width > 1.4
    assert figures.by_squares.estimate - figures.by_squares.half_width < 1.4
    # both estimate the same ratio
    gap = figures.by_products.estimate - figures.by_squares.estimate
    assert abs(gap) < 4 * np.hypot(figures.by_products.standard_error, figures.by_squares.standard_error)


def shorter(noise: float, seed: int, **wrong: float) -> DataPrediction:
    """Forty frames of one entry."""
    return kalman(walks(noise, seed)[:40, :1], noise, **wrong)


@pytest.mark.full
def test_forty_numbers_tell_half_of_the_variance() -> None:
    """Batches of so few frames do not: their interval excludes 1 in a third of the sequences."""
    right, wrong = ([shorter(PRECISE, seed, step=step) for seed in range(200)] for step in (0.25, 0.11))
    found, accused = (sum("Overconfident" in str(check_predictions(each)) for each in runs) for runs in (wrong, right))
    assert found > 120 and accused <= 10  # 144 and 6; the level is 2.5 %, and batches add to it
    inflations = [predictive_figures(each).inflation for each in wrong]
    assert sum(each.estimate - each.half_width > 1 for each in inflations) < 80


@pytest.mark.full
@pytest.mark.parametrize("noise", [PRECISE, NOISY])
def test_chance_is_uniform_where_predictions_hold(noise: float) -> None:
    chances = np.array([predictive_figures(shorter(noise, seed)).chance for seed in range(400)])
    assert kstest(chances, "uniform").pvalue > 1e-4
    assert predictive_figures(shorter(noise, 0, step=0.001, narrow=0.1)).chance < 1e-4


def together(seed: int, wrong: slice = slice(0), times: float = 3.0) -> DataPrediction:
    """Predictions of entries that should hardly differ, and in some frames do by so many times the variance that is claimed."""
    rng = np.random.default_rng(seed)
    own, noise = np.full(FRAMES, 0.05), 0.02
    own[wrong] *= times
    z = rng.standard_normal((FRAMES, 1)) + np.sqrt(own[:, None] + noise) * rng.standard_normal((FRAMES, ENTRIES))
    covariance = 1.0 + (0.05 + noise) * np.eye(ENTRIES)
    squares = np.einsum("ti,ij,tj->t", z, np.linalg.inv(covariance), z)
    state, share = np.full_like(z, 1.05), np.full(FRAMES, 1 - noise * np.trace(np.linalg.inv(covariance)) / ENTRIES)
    whole = squares / ENTRIES, chi2.cdf(squares, ENTRIES), share
    return DataPrediction(norm.cdf(z / np.sqrt(1.05 + noise)), z, state, np.full_like(z, noise), *whole)


def test_what_no_entry_shows_by_itself_is_found_in_whole_frames() -> None:
    found = [together(seed, slice(100, 200)) for seed in range(20)]
    assert all(predictive_figures(each).inflation.estimate < 1.3 for each in found)
    inflations = [predictive_figures(each).by_chi_square.estimate for each in found]
    # of eight directions seven have 0.17 instead of 0.07 in a third of the frames, 0.05 of which are the state's
    expected = 1 + (7 / 8) * (0.17 / 0.07 - 1) / 3 / (1 - 0.02 * 7 / 8 / 0.07)
    assert abs(np.mean(inflations) - expected) < 0.05  # 0.03 are what frames are cut off at
    texts = [check_predictions(each, np.arange(FRAMES) + 1000)[0].text for each in found]
    ends = [[int(word) for word in text.split("in frames ")[1].split(" (")[0].split(" to ")] for text in texts]
    assert np.abs(np.median(ends, 0) - [1100, 1199]).max() < 5
    assert sum(check_predictions(together(seed)) != [] for seed in range(100)) == 0


def test_smooth_motion_within_wide_steps_is_no_error() -> None:
    """Steps that repeat themselves make innovations alike; where they are as small as was said, the filter is not to blame."""
    rng = np.random.default_rng(3)
    steps = np.zeros((FRAMES, ENTRIES))
    for t in range(1, FRAMES):
        steps[t] = 0.95 * steps[t - 1] + 0.4 * np.sqrt(1 - 0.95**2) * rng.standard_normal(ENTRIES)
    prediction = kalman(walks(PRECISE, 3, steps), PRECISE)
    assert predictive_figures(prediction).by_products.estimate > 2
    assert all(found.severity != "error" for found in check_predictions(prediction))


def test_bias_and_width_are_warnings() -> None:
    rising = walks(
        PRECISE, 1, np.full((FRAMES, ENTRIES), 0.4) + 0.1 * np.random.default_rng(1).standard_normal((FRAMES, ENTRIES))
    )
    (bias,) = check_predictions(kalman(rising, PRECISE))
    assert bias.severity == "warning" and "above the predicted median" in bias.text


def coverage_of_states(prediction: DataPrediction, data: np.ndarray, truth: np.ndarray) -> float:
    """Share of true states (T, k) in 90 % intervals of the states after their data."""
    gain = prediction.state_variance / (prediction.state_variance + prediction.noise_variance)
    mean = data - prediction.innovation + gain * prediction.innovation
    return float(np.mean(np.abs(truth - mean) < norm.ppf(0.95) * np.sqrt((1 - gain) * prediction.state_variance)))


@pytest.mark.parametrize("noise", [PRECISE, NOISY])
def test_noise_three_times_too_large_is_a_warning(noise: float) -> None:
    """Nearly all data and states lie in their intervals. A noise that is right is not accused, in few frames either."""
    for seed in range(10):
        data = walks(noise, seed)
        wrong = kalman(data, 9 * noise)
        (found,) = check_predictions(wrong)
        assert found.severity == "warning"
        assert found.text.startswith("Underconfident predictions: the coverage of 90 % intervals of the data")
        assert "The noise is too large" in found.text and found.text.endswith("This is about the data, not about the states.")
        assert coverage_of_states(wrong, data, walks(0.0, seed)) > 0.96
    assert sum("Underconfident" in str(check_predictions(shorter(noise, seed))) for seed in range(100)) <= 3


@pytest.mark.parametrize(
    ("wrong", "cause", "covered"),
    [
        ({"step": 2.0}, "The transition variance is too large", 0.9),
        ({"step": 1.0, "noise": 0.2}, "The transition variance and the noise are too large", 1.0),
    ],
)
def test_what_is_too_wide_is_named(wrong: dict[str, float], cause: str, covered: float) -> None:
    """A transition that is too wide makes neighbouring innovations unlike, and the states' intervals are right all the same."""
    data = walks(PRECISE, 2)
    prediction = kalman(data, **{"noise": PRECISE, **wrong})
    (found,) = check_predictions(prediction)
    assert found.severity == "warning" and cause in found.text
    assert abs(coverage_of_states(prediction, data, walks(0.0, 2)) - covered) < 0.02


def test_autocorrelated_errors_do_not_make_states_under_confident() -> None:
    """Motion that is steadier than the transition: errors of predictions have less than half of the claimed variance.

    The intervals of the states after their data are right, and there is no warning.
    """
    steady = np.where(np.arange(FRAMES)[:, None] // 5 % 8 == np.arange(ENTRIES) % 8, 0.7, 0.0)
    data, truth = (walks(noise, 5, steady.copy()) for noise in (PRECISE, 0.0))
    prediction = kalman(data, PRECISE)
    figures = predictive_figures(prediction)
    assert figures.inflation.estimate + figures.inflation.half_width < 0.5 and figures.by_products.estimate > 1.3
    (found,) = check_predictions(prediction)
    assert found.severity == "info" and "errors are autocorrelated" in found.text
    assert abs(coverage_of_states(prediction, data, truth) - 0.9) < 0.02


def test_too_little_to_tell_is_not_reported() -> None:
    wrong = kalman(walks(PRECISE, 0), PRECISE, step=0.01, narrow=0.25)
    assert check_predictions(DataPrediction(*(leaf[:1] for leaf in wrong))) == []
    unseen = DataPrediction(*(np.full_like(leaf, np.nan) for leaf in wrong))
    assert check_predictions(unseen) == []
    hidden = DataPrediction(
        *(np.where(np.arange(FRAMES).reshape(-1, *[1] * (leaf.ndim - 1)) % 2, leaf, np.nan) for leaf in wrong)
    )
    assert [found.severity for found in check_predictions(hidden)] == ["error"]


def test_a_result_is_judged_by_its_predictions() -> None:
    draws = np.random.default_rng(0).standard_normal((4, 50, FRAMES, 1))
    wrong = kalman(walks(NOISY, 0), NOISY, step=0.05, narrow=0.25)
    for prediction, severity in ((wrong, "error"), (kalman(walks(NOISY, 0), NOISY), "info")):
        tree = build_result(
            state=draws, names=Names(("x",)), predictive=dict(zip(prediction._fields, prediction[:6], strict=False))
        )
        assert tree["predictive/transform"].dims == ("frame", "entry") and tree["predictive/chi_square"].dims == ("frame",)
        assert verdicts(tree)[0].severity == severity
    unpredictable = build_result(state=draws, names=Names(("x",)), attrs={"predictive checks": "not available: a factor"})
    assert "Predictive checks are not available: a factor." in [found.text for found in verdicts(unpredictable)]


@pytest.mark.full
def test_coverage_that_an_inflation_implies() -> None:
    assert implied_coverage(1.0) == pytest.approx(0.9)
    assert implied_coverage(4.0) == pytest.approx(2 * norm.cdf(1.6449 / 2) - 1, abs=1e-4)


@pytest.mark.parametrize("gains", [(0.5, 0.9), (0.9, 0.5)])
def test_products_are_those_of_a_gain_that_changes(gains: tuple[float, float]) -> None:
    """Two frames of many entries, whose errors have 1.5 times the variance that is claimed: the first gain alone decides."""
    rng, number, inflation = np.random.default_rng(0), 40_000, 1.5
    error = np.sqrt(inflation * gains[0]) * rng.standard_normal(number)
    first = error + np.sqrt(1 - gains[0]) * rng.standard_normal(number)
    # the first update leaves (1 - G) e - G v; a step brings the variance to what the second frame needs
    left = error - gains[0] * first
    step = inflation * gains[1] - ((1 - gains[0]) ** 2 * inflation * gains[0] + gains[0] ** 2 * (1 - gains[0]))
    moved = left + np.sqrt(step) * rng.standard_normal(number)
    second = moved + np.sqrt(1 - gains[1]) * rng.standard_normal(number)
    z, state = np.stack([first, second]), np.repeat([gains], number, axis=0).T
    unknown = np.full(2, np.nan)
    found = predictive_figures(DataPrediction(norm.cdf(z), z, state, 1 - state, unknown, unknown, unknown))
    weight = gains[0] * (1 - gains[0])
    # a product's variance is at most 1 / weight times that of two innovations; 0.05 are what innovations are cut off at
    assert abs(found.by_products.estimate - inflation) < 4 * inflation / weight / np.sqrt(number) + 0.05
    mean = np.mean(gains)
    assert abs(found.by_squares.estimate - inflation) < 4 * 2 / mean / np.sqrt(2 * number) + 0.05
