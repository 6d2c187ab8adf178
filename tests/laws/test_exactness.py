"""Laws on a linear Gaussian model, where a Kalman filter knows the answer.

Tolerances are 5 standard errors over independent replicates, few enough that the O(1/N) bias of self-normalised weights stays
below one of them; mistakes that are wrapped around every filter show that the tests would notice.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from catalogue import FILTERS, is_first, rows
from law_problems import BATCH, MASKED, check_impossible, problem, replicate, z_scores
from mistakes import SHARED_MISTAKES, Mistakes
from scipy.stats import norm

LARGE = ("window", "hmc", "covariance-scaled")


def is_small(row):
    return row.name not in LARGE


every_filter = rows(FILTERS, default=is_small)
sampling_filters = rows([r for r in FILTERS if r.posterior], is_first, is_small)
consistent_filters = rows([r for r in FILTERS if r.consistent], is_first, is_small)
unbiased_filters = rows([r for r in FILTERS if r.unbiased_evidence], is_first, is_small)

POSED = problem()
REPLICATES = BATCH
SMALL = 0.05
"""A bias, in posterior standard deviations."""


@cache
def built(row):
    return row.build(POSED.model)


@cache
def replicates(row):
    return replicate(built(row), POSED, row.num_replicates)


@cache
def scores(row):
    """z-scores of means (T, d) and of second moments about the exact means (T, d, d)."""
    means, seconds, _ = replicates(row)
    return z_scores(means[:REPLICATES], POSED.exact.means), z_scores(seconds[:REPLICATES], POSED.exact.covariances)


@sampling_filters
def test_first_frame_is_the_closed_form_posterior(row):
    means, seconds = scores(row)
    assert np.abs(means[0]).max() < 5
    assert np.abs(seconds[0]).max() < 5


@consistent_filters
def test_means_and_covariances_are_kalmans(row):
    """Also at the frame without data, where Kalman's is the prediction."""
    means, seconds = scores(row)
    assert np.abs(means).max() < 5
    assert np.abs(seconds).max() < 5


@consistent_filters
def test_after_an_impossible_frame_all_is_as_if_nothing_had_been_seen_in_it(row):
    """Later frames agree with Kalman's filter without the data of that frame."""
    check_impossible(built(row), POSED, REPLICATES)


@every_filter
def test_frame_without_data_has_no_evidence(row):
    increments = replicates(row)[2][:, MASKED]
    if row.evidence_error > 1e-3:
        assert abs(np.exp(increments).mean() - 1) < row.evidence_error
    else:  # a sum of some terms in float32; Laplace's approximation comes to 4e-7
        np.testing.assert_allclose(increments, 0.0, atol=1e-5)


def evidence_ratios(increments):
    """Estimated over exact evidence of each run and frame (K, T)."""
    return np.exp(increments - POSED.exact.log_evidence)


def evidence_is_exact(ratios, approximation=1e-4):
    """Whether means over runs are 1, within five standard errors and the error of an approximation, or of rounding."""
    return bool((np.abs(ratios.mean(0) - 1) < 5 * standard_error(ratios) + approximation).all())


def standard_error(samples):
    return samples.std(0, ddof=1) / np.sqrt(len(samples))


def check_evidence(ratios, approximation=1e-4):
    assert evidence_is_exact(ratios, approximation)
    assert (standard_error(ratios) < 0.05).all()


@every_filter
def test_evidence_of_the_first_frame_is_the_closed_form(row):
    check_evidence(evidence_ratios(replicates(row)[2])[:, :1], row.evidence_error)


@sampling_filters
def test_evidence_of_every_frame_is_kalmans(row):
    """Whether the mean of likelihoods, a product over temperatures, or Laplace's sum over modes."""
    check_evidence(evidence_ratios(replicates(row)[2]), row.evidence_error)


@pytest.mark.full
def test_evidence_of_the_best_particle_is_noticed():
    ratios = evidence_ratios(replicates(next(row for row in FILTERS if row.name == "hmc"))[2])
    assert not evidence_is_exact(20 * ratios)


@unbiased_filters
def test_evidence_is_unbiased(row):
    ratio = np.exp(replicates(row)[2].sum(1) - POSED.exact.log_evidence.sum())
    assert abs(z_scores(ratio, 1.0)) < 5


MISTAKES = SHARED_MISTAKES | {
    "evidence of the frame before": Mistakes(late_evidence=1),
    "data twice": Mistakes(data=1.0),
}


def broken_laws(row, found):
    """The laws of this file that runs of a row do not hold."""
    (means, seconds, increments), exact = found, POSED.exact
    frames = slice(None) if row.consistent else slice(1)
    broken = set()
    for name, moments, truth in (("means", means, exact.means), ("covariances", seconds, exact.covariances)):
        with np.errstate(divide="ignore", invalid="ignore"):  # runs that are all the same
            scores = z_scores(moments, truth)[frames]
        if row.posterior and not (np.abs(scores) < 5).all():
            broken.add(name)
    ratios = evidence_ratios(increments)[:, slice(None) if row.posterior else slice(1)]
    return broken if evidence_is_exact(ratios, row.evidence_error) else broken | {"evidence"}


@pytest.mark.full
@every_filter
def test_mistakes_are_noticed(row):
    """Each by a law, in every row, but those on moments by seekers of modes; equal weights can be ignored."""
    right = tuple(part[:REPLICATES] for part in replicates(row))
    assert not broken_laws(row, right)
    for name in MISTAKES if row.posterior else ["evidence of the frame before"]:
        found = replicate(built(row), POSED, REPLICATES, mistakes=MISTAKES[name])
        if name == "weights ignored" and row.equal_weights:
            for one, two in zip(found, right, strict=True):
                np.testing.assert_allclose(one, two, rtol=1e-4, atol=1e-4)
        else:
            assert broken_laws(row, found), name


def pooled_bias(shift=0.0):
    """Errors of means in posterior standard deviations (T, d), over all rows that know them, with their standard errors."""
    scale = np.sqrt(np.diagonal(POSED.exact.covariances, axis1=1, axis2=2))
    errors = [(replicates(row)[0] - POSED.exact.means) / scale + shift for row in FILTERS if row.consistent]
    spreads = [standard_error(each) for each in errors]
    return np.mean([each.mean(0) for each in errors], 0), np.sqrt(np.sum(np.square(spreads), 0)) / len(errors)


@pytest.mark.slow
def test_a_small_bias_is_noticed_in_all_rows_together():
    """A twentieth of a standard deviation, of any sign, frame and coordinate, with a probability of 99 % at least."""
    bias, error = pooled_bias()
    assert (np.abs(bias) < 5 * error).all()
    assert norm.cdf(SMALL / error - 5).min() > 0.99
    for shift in (-SMALL, SMALL):
        bias, error = pooled_bias(shift)
        assert (np.abs(bias) > 5 * error).all()
