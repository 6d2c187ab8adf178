"""Laws on a linear Gaussian model, where a Kalman filter knows the answer.

Tolerances are 5 standard errors over independent replicates, few enough that the O(1/N) bias of self-normalised weights stays
below one of them; the wrong variants show that the tests would notice.
"""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from catalogue import FILTERS, row_id
from law_problems import MASKED, problem, replicate, z_scores
from oracles.kalman import kalman_filter

every_filter = pytest.mark.parametrize("row", FILTERS, ids=row_id)
sampling_filters = pytest.mark.parametrize("row", [r for r in FILTERS if r.posterior], ids=row_id)
consistent_filters = pytest.mark.parametrize("row", [r for r in FILTERS if r.consistent], ids=row_id)
unbiased_filters = pytest.mark.parametrize("row", [r for r in FILTERS if r.unbiased_evidence], ids=row_id)

POSED = problem()
REPLICATES = 40


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
    """What comes after is Kalman's without the data of that frame."""
    values = POSED.observations.values["y"].at[1].set(1e30)
    mask = np.array(POSED.observations.mask["y"])
    mask[1] = False
    exact = kalman_filter(POSED.matrices, POSED.observations.values["y"], mask, np.asarray(POSED.inputs))
    impossible = POSED._replace(observations=POSED.observations._replace(values={"y": values}))
    found = replicate(built(row), impossible, row.num_replicates, exact.means)  # as many as above: the program is compiled
    means, seconds, increments = (part[:REPLICATES] for part in found)
    assert (increments[:, 1] == -np.inf).all()
    assert np.abs(z_scores(means, exact.means)).max() < 5
    assert np.abs(z_scores(seconds, exact.covariances)).max() < 5


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


def check_evidence(ratios, approximation=1e-4):
    """Means over runs are 1, within five standard errors and the error of an approximation, or of rounding in float32."""
    error = ratios.std(0, ddof=1) / np.sqrt(len(ratios))
    assert (np.abs(ratios.mean(0) - 1) < 5 * error + approximation).all()
    assert (error < 0.05).all()


@every_filter
def test_evidence_of_the_first_frame_is_the_closed_form(row):
    check_evidence(evidence_ratios(replicates(row)[2])[:, :1], row.evidence_error)


@sampling_filters
def test_evidence_of_every_frame_is_kalmans(row):
    """Whether the mean of likelihoods, a product over temperatures, or Laplace's sum over modes."""
    check_evidence(evidence_ratios(replicates(row)[2]), row.evidence_error)


def test_evidence_of_the_best_particle_is_noticed():
    ratios = evidence_ratios(replicates(next(row for row in FILTERS if row.name == "hmc"))[2])
    with pytest.raises(AssertionError):
        check_evidence(20 * ratios)


@unbiased_filters
def test_evidence_is_unbiased(row):
    ratio = np.exp(replicates(row)[2].sum(1) - POSED.exact.log_evidence.sum())
    assert abs(z_scores(ratio, 1.0)) < 5


def test_evidence_that_forgets_the_weights_is_noticed():
    """Without resampling the increment has to weigh the likelihoods by the old weights; their plain mean is biased."""
    adaptive = next(row for row in FILTERS if row.name == "particle-adaptive").build(POSED.model)

    def step(rng_key, state, observation, inputs):
        forgetful = state._replace(log_weights=0.0 * state.log_weights)
        return adaptive.step(rng_key, forgetful, observation, inputs)

    _, _, increments = replicate(dataclasses.replace(adaptive, step=step), POSED, 200)
    ratio = np.exp(increments.sum(1) - POSED.exact.log_evidence.sum())
    assert abs(z_scores(ratio, 1.0)) > 20


def test_inputs_of_the_wrong_frame_are_noticed():
    shifted = POSED._replace(inputs=np.roll(POSED.inputs, 1, axis=0))
    means, _, _ = replicate(FILTERS[0].build(POSED.model), shifted, FILTERS[0].num_replicates)
    assert np.abs(z_scores(means[:REPLICATES], POSED.exact.means)).max() > 20
