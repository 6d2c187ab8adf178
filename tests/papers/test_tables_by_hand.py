"""Tables of the reproduction from results that are written by hand, each number worked out beside it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_papers.choo_fleet.claims import FREE_MARKERS
from poseppl_papers.choo_fleet.contest import ContestRuns, contest_table
from poseppl_papers.choo_fleet.frame_tables import frame_errors, frame_tables
from poseppl_papers.choo_fleet.sequence import LEVELS, SequenceRuns, _inside, performance
from poseppl_papers.choo_fleet.single_frame import FrameRuns, FrameTiming
from poseppl_papers.choo_fleet.systems import pose_sequence, stage_of
from poseppl_papers.measured import Interval
from poseppl_papers.recordings import BUILT_IN

from poseppl.runs.results import QUANTILES
from poseppl.runs.run import frame_inputs

RUNS = (0, 1)


@pytest.mark.parametrize(
    ("published", "low", "high", "verdict"),
    [
        (20.0, 11.0, 30.0, "holds"),
        (20.0, 2.0, 8.0, "does not hold"),  # of the same sign, and does not matter
        (20.0, 5.0, 15.0, "undecided"),
        (1.0, -8.0, 3.0, "holds"),  # of the other sign: neither matters
        (1.0, -40.0, -11.0, "does not hold"),
        (1.0, -12.0, -8.0, "undecided"),
        (-20.0, -30.0, -11.0, "holds"),
        (-20.0, 11.0, 30.0, "does not hold"),
        (20.0, -np.inf, np.inf, "undecided"),
        (20.0, np.nan, np.nan, "undecided"),
    ],
)
def test_differences_agree_that_matter_alike(published, low, high, verdict):
    assert Interval((low + high) / 2, low, high).agrees(published, 10.0) == verdict


def test_coverages_of_two_levels_are_two_numbers():
    quantiles = np.array(QUANTILES)[None, :, None] * np.ones((2, 1, 10))  # of a uniform distribution on (0, 1)
    truth = np.array([[0.3, 0.4, 0.6, 0.1, 0.2, 0.8, 0.9, 0.01, 0.02, 0.99]] * 2)
    truth[1] = 0.5
    np.testing.assert_allclose(_inside(quantiles, truth), [[0.3, 1.0], [0.7, 1.0]])
    assert LEVELS == (0.5, 0.9)


def frame_job():
    return FrameRuns(BUILT_IN, "arm", 3, RUNS, 1, 5)


def frame_results():
    """Two runs in two dimensions: posterior variances 4 and 9, correlation 0.5, references off by 0.2 and 0.3."""
    covariance = np.array([[4.0, 3.0], [3.0, 9.0]])
    means = {"particle": [[[2.0, 0.0]], [[0.0, 3.0]]], "hmc": [[[1.0, 0.0]], [[0.0, 1.5]]]}
    found = {f"{method}_means": np.array(values) for method, values in means.items()}
    for method, likelihoods, gradients in (("particle", 320, 0), ("hmc", 4, 68)):
        found[f"{method}_num_likelihood"] = np.full((2, 1), likelihoods)
        found[f"{method}_num_gradient"] = np.full((2, 1), gradients)
    return found | {
        "reference_mean": np.zeros((2, 2)),
        "reference_standard_error": np.array([[0.2, 0.3]] * 2),
        "reference_covariance": np.stack([covariance] * 2),
        "prior_sd": np.array([20.0, 30.0]),
    }


def test_the_references_own_error_is_taken_off():
    job = frame_job()
    errors = frame_errors([job], {job.key: frame_results()}, "arm")[0]
    # squared distance over variance, 1 or 0, less 0.04 / 4 = 0.09 / 9 = 0.01
    np.testing.assert_allclose(errors.squared["particle"][:, 0], [[0.99, -0.01], [-0.01, 0.99]])
    np.testing.assert_allclose(errors.squared["hmc"][:, 0], [[0.24, -0.01], [-0.01, 0.24]])
    np.testing.assert_allclose(errors.reference, 0.01)


def test_volumes_are_products_of_standard_deviations():
    job = frame_job()
    bounds = frame_errors([job], {job.key: frame_results()}, "arm")[0].log_bounds
    np.testing.assert_allclose(bounds["marginal"], np.log10(20 / 2 * 30 / 3))
    np.testing.assert_allclose(bounds["determinant"], np.log10(20 * 30 / np.sqrt(4 * 9 - 3 * 3)))


def test_tables_of_single_frames():
    job = frame_job()
    timing = FrameTiming(BUILT_IN, "arm", 1, 3)
    times = {"particle_seconds": np.array([[1.0], [2.0], [5.0]]), "hmc_seconds": np.array([[0.4], [0.3], [0.6]])}
    tables = {table.name: table for table in frame_tables([job], [timing], {job.key: frame_results(), timing.key: times})}
    rows = {row[3]: row[4:8] for row in tables["variances"].rows}
    assert rows["particle"] == pytest.approx((320, 2.0, 320.0, 0.49)) and rows["hmc"] == pytest.approx((8, 0.4, 72.0, 0.115))
    # means of 0.99 and -0.01, and their standard errors, half their difference
    assert tables["coordinates"].rows[0][3:] == ("particle", 320, "shoulder_r.Z", *map(pytest.approx, (0.49, 0.5)))
    assert tables["volumes"].column("log10_bound", volume="marginal") == pytest.approx([2.0])
    assert tables["references"].rows[0][3:] == pytest.approx((0.01, 0.01 / 0.115))
    # HMC's variance is 0.49 / 0.115 times smaller: particles need so many times more
    assert tables["speed_ups"].column("speed_up", by="seconds") == pytest.approx([5.0 * 0.49 / 0.115])
    assert tables["speed_ups"].column("speed_up", by="evaluations") == pytest.approx([320 / 72 * 0.49 / 0.115])


def test_effective_draws_are_counted_per_second_and_per_evaluation():
    frame = frame_job()
    job = ContestRuns(BUILT_IN, "arm", 3, "ours", "particle", (), RUNS)
    block = {
        "mean": np.array([[2.0, 0.0], [0.0, 3.0]]),
        "seconds": np.array([0.2, 0.3]),
        "num_likelihood": np.array([30.0, 30.0]),
        "num_gradient": np.array([10.0, 30.0]),
    }
    table = contest_table([job], [frame], {frame.key: frame_results(), job.key: block})
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert row["variance"] == pytest.approx(0.49) and row["seconds"] == 0.25 and row["evaluations"] == 50.0
    assert row["effective_draws_per_second"] == pytest.approx(1 / (0.49 * 0.25))
    assert row["effective_draws_per_evaluation"] == pytest.approx(1 / (0.49 * 50))
    # means of the errors over runs are 0.5 in both coordinates; their variance, 0.5, over two runs is taken off
    assert row["bias"] == 0.0


@pytest.mark.full
@pytest.mark.parametrize("system", FREE_MARKERS)
def test_markers_that_free_coordinates_move(system):
    stage = stage_of(BUILT_IN, system)
    problem = pose_sequence(stage, slice(1, 3), stage.points[1:3])
    inputs, free = frame_inputs(problem.inputs, 0), stage.states[1][list(stage.body.free_coordinates)]
    slopes = jax.jacobian(lambda x: problem.model.extras(x, inputs)["markers"])(jnp.asarray(free, float))
    assert np.mean(np.abs(slopes).sum((1, 2)) > 0) == FREE_MARKERS[system]


@pytest.mark.full
def test_summaries_of_sequences_keep_their_columns_apart():
    job = SequenceRuns(BUILT_IN, "arm", "ours", "particle", (), 2, RUNS)
    found = {
        "error": np.array([[10.0, 20.0], [30.0, 40.0]]),
        "error_relative": np.array([[1.0, 2.0], [3.0, 4.0]]),
        "inside_markers": np.array([[[0.4, 0.5], [0.8, 0.9]], [[0.6, 0.5], [0.9, 1.0]]]),  # run, level, frame
        "inside_state": np.array([[[0.1, 0.2], [0.3, 0.4]], [[0.1, 0.2], [0.5, 0.6]]]),
        "markers": np.zeros((2, 2, 1, 3)),
        "num_likelihood": np.full((2, 2), 5.0),
        "num_gradient": np.full((2, 2), 2.0),
        "seconds": np.array([0.5, 0.3]),
    }
    found["markers"][1, :, 0, 0] = 2.0  # variance 2 along one axis of three
    table = performance("summary", [job], {job.key: found})
    row = dict(zip(table.columns, table.rows[0], strict=True))
    expected = {
        "error": 25.0,
        "error_standard_error": 10.0,
        "error_relative": 2.5,
        "markers_in_50": 0.5,
        "markers_in_50_standard_error": 0.05,
        "markers_in_90": 0.9,
        "markers_in_90_standard_error": 0.05,
        "state_in_50": 0.15,
        "state_in_90": 0.45,
        "spread": 2**0.5,
        "frames_per_second": 5.0,
        "evaluations_per_frame": 7.0,
    }
    assert {name: row[name] for name in expected} == pytest.approx(expected)
