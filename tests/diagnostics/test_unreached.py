"""Coordinates that data hardly reach, on scalar filters of which the right ones are exact, and others drift by chance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from synthetic import checks_of_state

from poseppl.diagnostics import check_unreached, verdicts, weakly_observed_stats
from poseppl.diagnostics.unreached import HARDLY
from poseppl.diagnostics.verdicts.predictive import INFLATION_HIGH
from poseppl.runs.predictive import StatePrediction
from poseppl.runs.results import Names, build_result

FRAMES, RUNS, DRAWS, REPLICATES = 60, 50, 1000, 100
STEP = 0.25
"""Variance of a step."""
NOWHERE, FAINT = np.inf, 30.0
"""Variances of the noise: data that are never seen, and data that tell a few percent a frame."""


class Filtered(NamedTuple):
    """Sequences (T, RUNS), each of one coordinate."""

    prediction: StatePrediction
    mean: np.ndarray
    deviation: np.ndarray
    truth: np.ndarray

    def run(self, index: int | slice) -> tuple[StatePrediction, np.ndarray, np.ndarray, np.ndarray]:
        """Arguments of the figures, of one run or of several together."""
        chosen = slice(index, index + 1) if isinstance(index, int) else index
        prediction = StatePrediction(*(leaf[:, chosen] for leaf in self.prediction if leaf is not None))
        return prediction, self.mean[:, chosen], self.deviation[:, chosen], np.full(FRAMES, float(DRAWS))


def filtered(noise: float, slope: float, *, ancestors: int | None = None, seed: int = 0) -> Filtered:
    """Kalman filters that tell what they know by draws; of those with few ancestors, each frame knows the past by so many."""
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.standard_normal((*shape, RUNS))

    truth, mean, variance = np.zeros((FRAMES, RUNS)), np.zeros(RUNS), np.ones(RUNS)
    told: list[tuple[np.ndarray, ...]] = []
    draws = normal(DRAWS)
    for t in range(FRAMES):
        if t == 0:
            truth[0], predicted, before, states = normal(), np.ones(RUNS), draws[:REPLICATES], normal(REPLICATES)
        else:
            truth[t] = slope * truth[t - 1] + np.sqrt(STEP) * normal()
            if ancestors is not None:
                past = draws[rng.integers(0, DRAWS, ancestors)]
                mean, variance = past.mean(0), past.var(0)
            before = draws[rng.integers(0, DRAWS, REPLICATES)]
            states = slope * before + np.sqrt(STEP) * normal(REPLICATES)
            mean, predicted = slope * mean, slope**2 * variance + STEP
        gain = predicted / (predicted + noise)
        data = truth[t] + (np.sqrt(noise) if np.isfinite(noise) else 0.0) * normal()
        mean, variance = mean + gain * (data - mean), (1 - gain) * predicted
        draws = mean + np.sqrt(variance) * normal(DRAWS)
        spread, centred = states.var(0, ddof=1), before - before.mean(0)
        autoregression = (centred * states).sum(0) / (centred**2).sum(0)
        of_state = states.mean(0), spread, np.sqrt(spread / REPLICATES), autoregression, spread / (spread + noise)
        told.append((*of_state, draws.mean(0), draws.std(0, ddof=1)))
    *checks, means, deviations = (np.array(values) for values in zip(*told, strict=True))
    return Filtered(StatePrediction(*checks), means, deviations, truth)


@pytest.mark.parametrize("slope", [0.5, 0.9, 1.0])
@pytest.mark.parametrize("noise", [NOWHERE, FAINT])
def test_a_filter_that_is_right_is_let_be(noise: float, slope: float) -> None:
    right = filtered(noise, slope)
    found = np.array([weakly_observed_stats(*right.run(index)).inflation.estimate for index in range(RUNS)])
    assert abs(found.mean() - 1) < 4 * found.std(ddof=1) / np.sqrt(RUNS) and found.std() < 0.3
    # of 50 runs of one coordinate; of 60 kinds of sequences, simulated 100 times each, none had more than 2 % accused
    accused = sum(bool(check_unreached(*right.run(index), ["x"])) for index in range(RUNS))
    assert accused <= 0.02 * RUNS


@pytest.mark.parametrize("noise", [NOWHERE, FAINT])
def test_a_filter_that_knows_the_past_by_ten_states_is_an_error(noise: float) -> None:
    wrong = filtered(noise, 0.9, ancestors=10)
    # one coordinate of 60 frames tells three runs in five, ten coordinates tell all
    runs = [wrong.run(slice(start, start + 10)) for start in range(0, RUNS, 10)]
    assert [found.severity for run in runs for found in check_unreached(*run, ["x"] * 10)] == ["error"] * len(runs)
    figures = weakly_observed_stats(*wrong.run(slice(0, RUNS)))
    true = np.square(wrong.mean - wrong.truth).sum() / np.square(wrong.deviation).sum()
    errors = np.square(wrong.mean - wrong.truth).sum(0) / np.square(wrong.deviation).sum(0)
    assert figures.inflation.estimate > INFLATION_HIGH
    assert figures.inflation.estimate == pytest.approx(true, abs=4 * errors.std() / np.sqrt(RUNS))
    assert figures.lost > figures.explained + 0.05


def test_means_that_drift_alone_are_an_error() -> None:
    right = filtered(NOWHERE, 0.9)
    drift = 0.4 * np.random.default_rng(1).standard_normal(right.mean.shape) * right.deviation
    prediction, mean, deviation, ess = right.run(slice(0, RUNS))
    assert check_unreached(prediction, mean, deviation, ess, ["x"] * RUNS) == []
    (found,) = check_unreached(prediction, mean + drift, deviation, ess, ["x"] * RUNS)
    assert found.severity == "error" and "(x, x, x, x and 46 more)" in found.text


def test_coordinates_that_data_reach_are_left_to_the_data() -> None:
    reached = filtered(1.0, 0.9, ancestors=10)
    assert reached.prediction.explained.mean() > 2 * HARDLY
    assert weakly_observed_stats(*reached.run(slice(0, RUNS))) is None
    prediction, *posterior = filtered(NOWHERE, 0.9, ancestors=10).run(0)
    untold = prediction._replace(explained=np.full((FRAMES, 1), np.nan))
    assert weakly_observed_stats(untold, *posterior) is None


def test_a_single_frame_is_no_evidence() -> None:
    prediction, *posterior = filtered(NOWHERE, 0.9, ancestors=10).run(0)
    first = StatePrediction(*(leaf[:1] for leaf in prediction if leaf is not None))
    assert check_unreached(first, *(values[:1] for values in posterior), ["x"]) == []


def test_a_result_is_judged_where_its_data_do_not_reach() -> None:
    for ancestors, severity in ((None, "info"), (4, "error")):
        prediction, mean, deviation, ess = filtered(NOWHERE, 0.9, ancestors=ancestors).run(0)
        draws = mean + deviation * np.random.default_rng(0).standard_normal((4, 50, FRAMES, 1))
        for known in (prediction, None):
            tree = build_result(
                state=draws,
                names=Names(("depth",)),
                summary={"state_mean": mean, "state_sd": deviation},
                sample_stats={"ess": ess},
                predictive=checks_of_state(known, FRAMES),
            )
            found = verdicts(tree)[0]
            assert found.severity == (severity if known is not None else "info")
            assert known is None or tree["predictive/predicted_mean"].dims == ("frame", "state_dim")
            assert ("(depth)" in found.text) == (found.severity == "error")


def test_an_excess_is_handed_on_from_frame_to_frame() -> None:
    """The inflation by the recursion of X_t, frame by frame, where what is inherited changes."""
    frames = 7
    rng = np.random.default_rng(2)
    predicted, deviation = rng.uniform(1.0, 2.0, (frames, 1)), rng.uniform(0.7, 0.9, (frames, 1))
    slope, explained = rng.uniform(0.2, 0.95, (frames, 1)), rng.uniform(0.0, 0.09, (frames, 1))
    centre, mean = rng.standard_normal((2, frames, 1))
    error, ess = rng.uniform(0.1, 0.2, (frames, 1)), rng.uniform(5.0, 50.0, frames)
    excess, total = 0.0, 0.0
    for t in range(frames):
        told = explained[t, 0] * predicted[t, 0]
        variance = deviation[t, 0] ** 2
        by_chance = error[t, 0] ** 2 + variance / ess[t]
        lost = predicted[t, 0] - variance - told
        moved = (mean[t, 0] - centre[t, 0]) ** 2 - told - by_chance
        excess = ((1 - explained[t, 0]) * slope[t, 0]) ** 2 * excess + lost + moved
        total += excess
    found = weakly_observed_stats(StatePrediction(centre, predicted, error, slope, explained), mean, deviation, ess)
    assert found is not None
    assert found.inflation.estimate == pytest.approx(1 + total / np.square(deviation).sum())
    assert found.explained == pytest.approx((explained * predicted).sum() / predicted.sum())
    assert found.lost == pytest.approx(1 - np.square(deviation).sum() / predicted.sum())
