"""A filter's updates against importance sampling from its own predictions, in exact linear filters and in bent ones."""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np
import pytest

from poseppl.diagnostics import check_updates, update_figures, verdicts
from poseppl.diagnostics.updates import LEAST_DRAWS, _excess
from poseppl.runs.predictive import Prediction, _weighted
from poseppl.runs.results import Names, build_result

FRAMES, RUNS, DRAWS, REPLICATES = 60, 20, 1000, 200
TURN = 0.98 * np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
STEP, NOISE = 0.1, 1.0
WEIGHTED = jax.jit(_weighted)


class Filtered(NamedTuple):
    """Arguments of the figures, and the truth (T, 2)."""

    prediction: Prediction
    mean: np.ndarray
    deviation: np.ndarray
    ess: np.ndarray
    truth: np.ndarray


def filtered(seed: int, *, shift: float = 0.0, narrow: float = 1.0) -> Filtered:
    """A Kalman filter of a point that turns, of which one coordinate is seen.

    Args:
        seed: Of the data.
        shift: Standard deviations by which each update's mean is off.
        narrow: Factor of each update's covariance.
    """
    rng = np.random.default_rng(seed)
    truth, mean, covariance, told = rng.standard_normal(2), np.zeros(2), np.eye(2), []
    for t in range(FRAMES):
        before = rng.multivariate_normal(mean, covariance, REPLICATES)
        if t:
            truth = TURN @ truth + np.sqrt(STEP) * rng.standard_normal(2)
            mean, covariance = TURN @ mean, TURN @ covariance @ TURN.T + STEP * np.eye(2)
        states = before @ TURN.T + np.sqrt(STEP) * rng.standard_normal((REPLICATES, 2)) if t else before
        data = truth[0] + np.sqrt(NOISE) * rng.standard_normal()
        checks = WEIGHTED(before, states, -0.5 * (data - states[:, 0]) ** 2 / NOISE)
        gain = covariance[:, 0] / (covariance[0, 0] + NOISE)
        mean, covariance = mean + gain * (data - mean[0]), (covariance - np.outer(gain, covariance[0])) * narrow
        mean = mean + shift * np.sqrt(np.diag(covariance))
        told.append(
            (*(np.asarray(checks[name]) for name in Prediction._fields[-4:]), mean, np.sqrt(np.diag(covariance)), truth)
        )
    *checks, means, deviations, truths = (np.array(values) for values in zip(*told, strict=True))
    # of the data's own checks nothing is asked here
    prediction = Prediction(*[np.full((FRAMES, 1), np.nan)] * 4, *[np.full(FRAMES, np.nan)] * 2)
    prediction = prediction._replace(**dict(zip(Prediction._fields[-4:], checks, strict=True)))
    return Filtered(prediction, means, deviations, np.full(FRAMES, np.inf), truths)


def test_exact_updates_are_let_be() -> None:
    runs = [filtered(seed) for seed in range(RUNS)]
    found = [update_figures(*run[:4]) for run in runs]
    inflation = np.array([each.inflation.mean() for each in found])
    assert all(each.frames == FRAMES for each in found)
    assert abs(inflation.mean() - 1) < 4 * inflation.std(ddof=1) / np.sqrt(RUNS)
    # 2.5 % are below by chance; an inflation of 1.4 is asked for besides
    assert sum(each.chance < 0.025 for each in found) <= 3
    assert sum(bool(check_updates(*run[:4])) for run in runs) <= 1


def test_displacements_by_chance_add_nothing_on_average() -> None:
    frames, draws, variance = 8, 4000, 0.09
    apart = np.sqrt(variance) * np.random.default_rng(0).standard_normal((frames, draws, 2))
    memory, noise = np.tile(TURN, (frames, 1, 1)), np.tile(variance * np.eye(2), (frames, 1, 1))
    total = _excess(memory, np.zeros((frames, 1, 2, 2)), apart, noise)
    assert (np.abs(total.mean(0)) < 4 * total.std(0) / np.sqrt(draws)).all()


@pytest.mark.parametrize("wrong", [{"shift": 0.3}, {"narrow": 0.7}])
def test_updates_that_are_always_off_or_too_sure_are_an_error(wrong: dict[str, float]) -> None:
    runs = [filtered(seed, **wrong) for seed in range(RUNS // 2)]
    told = [check_updates(*run[:4], ["--filter particle"]) for run in runs]
    assert [found.severity for each in told for found in each] == ["error"] * len(runs)
    assert "such as --filter particle" in told[0][0].text
    found = np.mean([update_figures(*run[:4]).inflation for run in runs])
    errors = np.array([np.mean(np.square(run.mean - run.truth) / np.square(run.deviation)) for run in runs])
    assert found == pytest.approx(errors.mean(), abs=4 * errors.std(ddof=1) / np.sqrt(len(runs)) + 0.15 * found)


def test_frames_of_few_effective_draws_tell_nothing() -> None:
    run = filtered(0, shift=0.3)
    few = run.prediction._replace(weighted_ess=np.full(FRAMES, LEAST_DRAWS - 1))
    assert update_figures(few, *run[1:4]).frames == 0 and check_updates(few, *run[1:4]) == []
    unknown = run.prediction._replace(weighted_mean=np.full((FRAMES, 2), np.nan), weighted_ess=np.full(FRAMES, np.nan))
    assert check_updates(unknown, *run[1:4]) == []


def test_a_result_is_judged_where_its_updates_are_told() -> None:
    for shift, severity in ((0.0, "info"), (0.3, "error")):
        run = filtered(1, shift=shift)
        draws = run.mean + run.deviation * np.random.default_rng(0).standard_normal((4, 50, FRAMES, 2))
        for checks in (run.prediction, run.prediction._replace(memory=None)):
            tree = build_result(
                state=draws,
                names=Names(("across", "along")),
                summary={"state_mean": run.mean, "state_sd": run.deviation},
                sample_stats={"ess": np.full(FRAMES, float(DRAWS))},
                predictive={name: values for name, values in checks._asdict().items() if values is not None},
            )
            assert tree["predictive/weighted_covariance"].dims == ("frame", "dof", "other_dof")
            found = verdicts(tree)[0]
            assert found.severity == (severity if checks.memory is not None else "info")
            assert ("by importance sampling" in found.text) == (found.severity == "error")
