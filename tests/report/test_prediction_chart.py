"""The histogram of predictive ranks: shares, their errors, and where it stands in the report."""

from __future__ import annotations

import numpy as np
import pytest
from page_reading import data_of
from synthetic import predicted_result, synthetic_result

from poseppl.diagnostics.verdicts.predictive import rank_test
from poseppl.report import report_html
from poseppl.report.charts import prediction_chart, transform_shares


def test_shares_and_what_was_not_seen() -> None:
    transform = np.array([[0.0, 0.05, np.nan], [0.1, 0.95, 1.0], [np.nan] * 3, [0.55, 0.15, 0.25]])
    share, error = transform_shares(transform)
    np.testing.assert_allclose(8 * share, [2, 2, 1, 0, 0, 1, 0, 0, 0, 2])
    assert np.isfinite(error).all() and error[3] == 0


@pytest.mark.full
def test_errors_are_those_of_batches_of_frames() -> None:
    """Data of a frame that fall together count as one."""
    rng = np.random.default_rng(0)
    together = np.repeat(rng.uniform(size=(400, 1)), 25, axis=1)
    apart = rng.uniform(size=(400, 25))
    wide, narrow = (transform_shares(each)[1].mean() for each in (together, apart))
    assert wide == pytest.approx(np.sqrt(0.09 / 400), rel=0.3)
    assert narrow == pytest.approx(np.sqrt(0.09 / 10_000), rel=0.3)


@pytest.mark.parametrize(
    ("power", "kind"),
    [
        (0.3, "overconfident, with higher bars at both ends"),
        (3.0, "underconfident, with a hump in the middle"),
        (1.0, "calibrated"),
    ],
)
def test_the_caption_says_what_the_ranks_are(power: float, kind: str) -> None:
    """Ranks u with |2 u - 1| = v^power are denser at the ends below a power of 1, and in the middle above it."""
    rng = np.random.default_rng(2)
    beside = rng.uniform(size=(100, 40)) ** power
    transform = 0.5 + 0.5 * rng.choice([-1, 1], beside.shape) * beside
    share = np.mean(np.abs(transform - 0.5) <= 0.45)
    words = rank_test(predicted_result(transform))
    assert words.startswith(f"The coverage of 90 % prediction intervals is {100 * share:.0f} % (± ") and f": {kind}" in words


def test_the_caption_says_that_it_cannot_tell() -> None:
    rng = np.random.default_rng(3)
    assert "too short to decide" in rank_test(predicted_result(rng.uniform(size=(9, 3))))
    assert "too few frames" in rank_test(predicted_result(rng.uniform(size=(1, 3))))
    one_side = 0.5 + 0.5 * rng.uniform(size=(30, 30))
    assert "100 % of the data are above the predicted median" in rank_test(predicted_result(one_side))
    assert rank_test(synthetic_result(num_frames=3)) == ""


@pytest.mark.full
def test_the_report_shows_it_where_there_are_checks() -> None:
    transform = np.random.default_rng(1).uniform(size=(12, 5))
    page = report_html(predicted_result(transform))
    assert "<h2>Predictions</h2>" in page and 'id="chart-predictions"' in page
    assert "The coverage of 90 % prediction intervals is" in page
    bars = data_of(page, "charts-data")["predictions"]["data"][0]
    counts = np.histogram(transform, 10, (0, 1))[0]
    np.testing.assert_allclose(bars["y"], 100 * counts / 60, rtol=1e-3)
    np.testing.assert_allclose(bars["x"], np.arange(0.05, 1, 0.1), rtol=1e-6)
    assert len(bars["error_y"]["array"]) == 10


@pytest.mark.full
def test_nothing_is_shown_without_checks() -> None:
    tree = synthetic_result(num_frames=3)
    assert prediction_chart(tree) is None and prediction_chart(predicted_result(np.full((3, 2), np.nan))) is None
    assert "Predictions" not in report_html(tree)
