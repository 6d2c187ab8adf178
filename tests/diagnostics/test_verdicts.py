from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from synthetic import autoregression, synthetic_result

from poseppl.diagnostics import diagnose, frame_ranges, inefficiency, verdicts
from poseppl.results import Names, build_result, load_result, save_result


def _texts(tree: xr.DataTree) -> str:
    return "\n".join(f"{verdict.severity}: {verdict.text}" for verdict in verdicts(tree))


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([3], "frame 3"),
        ([3, 4, 5], "frames 3-5"),
        ([9, 3, 4, 4], "frames 3-4, 9"),
        (range(0, 40, 2), "frames 0, 2, 4, 6, 8, 10 and 14 more"),
        ([], "no frame"),
    ],
)
def test_frames_in_words(frames: list[int], words: str) -> None:
    assert frame_ranges(frames) == words


def test_nothing_to_complain_of() -> None:
    assert _texts(synthetic_result(num_frames=60)).startswith("info: Nothing to complain of.")


def test_a_coordinate_that_mixes_badly_is_named_with_its_frames() -> None:
    rng = np.random.default_rng(0)
    state = autoregression(rng, (10, 100, 12, 3), 0.2)
    state[:, :, 4:8, 2] = autoregression(rng, (10, 100, 4), 0.98)
    tree = diagnose(build_result(state=state, names=Names(("hip_r", "elbow_l", "knee_r")), frames=np.arange(10, 22)))
    worst = tree["diagnostics/tau"].sel(dof="knee_r").max().item()
    assert f"knee_r mixes badly: tau = {worst:.0f} in frames 14-17." in _texts(tree)
    assert "hip_r" not in _texts(tree)


def test_failures_divergences_and_rejection_by_frame() -> None:
    failed, divergences, acceptance = np.zeros(24, bool), np.zeros(24, np.int32), np.full(24, 0.85)
    failed[2], divergences[5:7], acceptance[20:22] = True, 3, 0.3
    stats = {"failed": failed, "divergences": divergences, "acceptance_rate": acceptance}
    texts = _texts(synthetic_result(sample_stats=stats))
    assert texts.startswith("error: Impossible data in frame 12:")
    assert "Divergences in frames 15-16 (6 in all)" in texts
    assert "Rejection rate up to 70 % in frames 30-31" in texts
    assert "Nothing" not in texts


def test_over_and_under_confidence() -> None:
    assert "over-confident" in _texts(synthetic_result(num_frames=60, truth_scale=2.5))
    assert "under-confident" in _texts(synthetic_result(num_frames=60, truth_scale=0.2))
    assert "calibrated" in _texts(synthetic_result(num_frames=60))


def test_degenerate_particles() -> None:
    ess, unique = np.full(24, 500.0), np.full(24, 400)
    ess[3:6], unique[4] = 2.5, 3
    texts = _texts(synthetic_result(weighted=True, sample_stats={"ess": ess, "unique_ancestors": unique}))
    assert "below 10 of 1000 in frames 13-15 (least 2.5)" in texts
    assert "have descendants in frame 14 (least 3)" in texts


def test_unseen_frames_are_remarked() -> None:
    tree = synthetic_result()
    tree["observed_data"]["points"][4:6] = np.nan
    assert "Nothing was observed in frames 14-15" in _texts(tree)


def test_diagnose_adds_one_group_and_survives_the_disk(tmp_path) -> None:  # type: ignore[no-untyped-def]
    tree = synthetic_result(num_frames=5)
    whole = diagnose(tree)
    assert "diagnostics" not in tree.children
    assert diagnose(whole).identical(whole)
    np.testing.assert_allclose(whole["diagnostics/tau"], inefficiency(tree["posterior/state"].values), rtol=1e-10)
    np.testing.assert_allclose(whole["diagnostics/rejection_rate"], 1 - tree["sample_stats/acceptance_rate"])
    save_result(whole, tmp_path / "result.nc")
    assert load_result(tmp_path / "result.nc").identical(whole)


def test_weighted_particles_take_tau_from_the_effective_number() -> None:
    data = diagnose(synthetic_result(weighted=True))["diagnostics"].dataset
    assert (data["tau"] == 1000 / 800).all()
    assert "rhat" not in data
    assert "autocorrelation" not in data


@pytest.mark.parametrize(
    "arguments", [{"num_draws": 1, "num_chains": 1}, {"num_draws": 3}, {"num_frames": 1}, {"with_truth": False}]
)
def test_tiny_results_are_judged_silently(arguments: dict[str, int]) -> None:
    assert verdicts(synthetic_result(**arguments))  # type: ignore[arg-type]
