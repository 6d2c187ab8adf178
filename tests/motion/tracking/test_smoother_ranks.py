"""The smoother of a detector's keypoints on draws of its own program: the truth ranks like any of its draws, if it is right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.diagnostics.simulation_based import Calibration, calibration_of
from studies import smoother_ranks as benchmark

REPLICATES = 24


@pytest.fixture(scope="module")
def study(data_dir: Path) -> benchmark.Study:
    return benchmark.study(data_dir, cameras=2, corrected=False)


def judged(study: benchmark.Study, case: str) -> Calibration:
    """Ranks of the joints' coordinates, all taken together; replicates count."""
    ranks = np.stack([benchmark.ranks(study, benchmark.CASES[case], seed)["joints"] for seed in range(REPLICATES)])
    return calibration_of(ranks.reshape(REPLICATES, -1, 1), ("joints",))


@pytest.mark.slow
def test_ranks_of_joints_are_uniform(study: benchmark.Study) -> None:
    """Within five standard errors over replicates: neither to one side, nor too narrow or too wide."""
    found = judged(study, "right")
    assert abs(found.bias[0]) < 5 * found.bias_error[0] and abs(found.excess[0]) < 5 * found.excess_error[0], found


@pytest.mark.slow
@pytest.mark.parametrize("case", ["independent", "half"])
def test_a_wrong_smoother_is_noticed(study: benchmark.Study, case: str) -> None:
    """Errors that are taken for independent, and half of the noise, make intervals too narrow, by five standard errors."""
    found = judged(study, case)
    assert found.excess[0] > 5 * found.excess_error[0], found


@pytest.mark.full
def test_uniformity_counts_replicates() -> None:
    """Equal ranks within a replicate are one number, not many; narrow intervals are noticed."""
    rng = np.random.default_rng(0)
    same = np.broadcast_to(rng.random((100, 1)), (100, 40))
    spread = rng.random((100, 40))
    assert benchmark.uniformity(same + 1e-9 * spread)[1] > 0.01
    assert benchmark.uniformity(spread)[1] > 0.01
    assert benchmark.uniformity(rng.beta(0.7, 0.7, (100, 40)))[1] < 1e-6


@pytest.mark.full
def test_calibration_error_is_the_distance_of_coverage_from_its_level() -> None:
    middle = 0.25 + np.random.default_rng(0).random((50, 200)) / 2  # coverage of level a is 2 a, at most 1
    assert benchmark.calibration_error(middle) == pytest.approx(
        np.mean(np.minimum(benchmark.LEVELS, 1 - benchmark.LEVELS)), abs=0.01
    )
