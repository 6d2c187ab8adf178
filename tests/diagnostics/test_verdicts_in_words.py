from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from synthetic import autoregression, synthetic_result

from poseppl.diagnostics import diagnose, frame_ranges, inefficiency, verdicts
from poseppl.diagnostics.verdicts.coverage import calibration
from poseppl.runs.results import Names, build_result, load_result, save_result


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


@pytest.mark.parametrize(("weighted", "number"), [(False, 7), (True, 5)])
def test_a_good_result_says_which_checks_were_not_run(weighted: bool, number: int) -> None:
    """Checks of Markov chains, silhouettes and smoothers are for results of another kind, and count for nothing."""
    unchecked = "predictions, weakly informed coordinates, updates (no predictive checks)"
    result = synthetic_result(num_frames=60, with_truth=False, weighted=weighted)
    found = verdicts(result)
    assert found[0].text == (
        f"No problems detected by {number} of {number + 5} checks. Not run: {unchecked}; forecasts (no hindcasts); coverage "
        "(no truth)."
    )
    assert {verdict.severity for verdict in found} == {"info"}


def test_a_coordinate_that_mixes_badly_is_named_with_its_frames() -> None:
    rng = np.random.default_rng(0)
    state = autoregression(rng, (10, 100, 12, 3), 0.2)
    state[:, :, 4:8, 2] = autoregression(rng, (10, 100, 4), 0.98)
    tree = diagnose(build_result(state=state, names=Names(("hip_r", "elbow_l", "knee_r")), frames=np.arange(10, 22)))
    worst = tree["diagnostics/tau"].sel(state_dim="knee_r").max().item()
    assert f"knee_r mixes badly: tau = {worst:.0f} in frames 14-17." in _texts(tree)
    assert "hip_r" not in _texts(tree)


def test_failures_and_rejection_by_frame() -> None:
    failed, acceptance = np.zeros(24, bool), np.full(24, 0.85)
    failed[2], acceptance[20:22] = True, 0.01
    gradients = np.full(24, 3200)
    stats = {"failed": failed, "acceptance_rate": acceptance, "num_gradient": gradients}
    texts = _texts(synthetic_result(sample_stats=stats))
    assert texts.startswith("error: Data with zero likelihood in frame 12:")
    words = "Rejection rate up to 99 % in frames 30-31: the step size is too large; at 35 % (HMC) there would be about"
    assert words in texts and "lower step_size, or raise target_acceptance." in texts
    assert "No problems" not in texts


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ({5: 3}, "info: 0.078 % of trajectories diverge (3): too few to matter."),
        (dict.fromkeys(range(24), 1), "info: 0.62 % of trajectories diverge (24)"),
        (dict.fromkeys(range(24), 2), "warning: 1.2 % of trajectories diverge (48):"),
        (dict.fromkeys(range(24), 9), "error: 5.6 % of trajectories diverge (216):"),
        ({5: 15, 6: 17}, "warning: 0.83 % of trajectories diverge (32), more than 10 % in frame 16:"),
    ],
)
def test_divergences_are_a_share_of_the_trajectories(counts: dict[int, int], words: str) -> None:
    """There are 4 chains of 40 updates a frame, and 24 frames."""
    divergences = np.zeros(24, np.int32)
    divergences[list(counts)] = list(counts.values())
    assert words in _texts(synthetic_result(sample_stats={"divergences": divergences}))


@pytest.mark.parametrize(
    ("apart", "frames", "severity"),
    [(0.8, 1, ""), (0.8, 2, "info"), (0.8, 6, "info"), (0.8, 7, "warning"), (3.0, 60, "warning")],
)
def test_disagreement_of_chains_is_graded_by_its_share(apart: float, frames: int, severity: str) -> None:
    rng = np.random.default_rng(0)
    state = rng.standard_normal((4, 60, 60, 2))
    state[0, :, :frames] += 2 * apart
    state[1, :, :frames] -= 2 * apart
    tree = diagnose(build_result(state=state, names=Names(("hip", "knee")), frames=np.arange(60)))
    assert (f"{severity}: R-hat above 1.2 in {float(f'{100 * frames / 60:.2g}'):g} %" in _texts(tree)) == bool(severity)
    assert ("R-hat" in _texts(tree)) == bool(severity)


@pytest.mark.parametrize(
    ("share", "error", "kind"),
    [
        (0.90, 0.02, "calibrated"),
        (0.83, 0.02, "over-confident"),
        (0.881, 0.001, "calibrated"),
        (0.879, 0.001, "over-confident"),
        (0.921, 0.001, "under-confident"),
        (0.86, 0.021, "calibrated"),
        (0.86, 0.019, "over-confident"),
        (0.84, 0.031, "undecided"),
        (0.90, 0.026, "undecided"),
        (0.97, 0.03, "under-confident"),
    ],
)
def test_what_a_coverage_says(share: float, error: float, kind: str) -> None:
    assert calibration(share, error) == kind


def test_coverage_of_coordinates_and_joints() -> None:
    wrong = _texts(synthetic_result(num_frames=60, truth_scale=2.5))
    assert "error: The coverage of 90 % intervals of coordinates is 46 %" in wrong
    assert "error: The coverage of 90 % intervals of joints" in wrong
    assert "raise noise, sigma_angle, sigma_position or num_updates." in wrong
    narrow = _texts(synthetic_result(num_frames=60, truth_scale=1.2))
    assert "warning: The coverage of 90 % intervals of coordinates is 8" in narrow
    assert "underconfident" in _texts(synthetic_result(num_frames=60, truth_scale=0.2))
    somewhat = _texts(synthetic_result(num_frames=60, truth_scale=0.87))
    assert "info: The coverage of 90 % intervals of coordinates is 94 %" in somewhat and "underconfident" not in somewhat
    assert "info: The coverage of 90 % intervals of coordinates is 90 % (± 1): calibrated." in _texts(
        synthetic_result(num_frames=60)
    )


def test_joints_that_differ_from_the_body_are_said_to() -> None:
    """Intervals of joints leave it out; those of coordinates do not depend on it."""
    tree = synthetic_result(num_frames=60, truth_scale=2.5)
    tree.attrs["residual_mm"] = "5.64"
    of_coordinates, of_joints = (text for text in _texts(tree).splitlines() if "90 % intervals of" in text)
    words = "too narrow (they ignore that the body differs from the recording by 5.6 mm): raise noise,"
    assert words in of_joints and "ignore that" not in of_coordinates
    tree.attrs["residual_mm"] = '"none"'
    assert "ignore that" not in _texts(tree)


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


@pytest.mark.full
def test_diagnose_adds_one_group_and_survives_the_disk(tmp_path) -> None:  # type: ignore[no-untyped-def]
    tree = synthetic_result(num_frames=5)
    whole = diagnose(tree)
    assert "diagnostics" not in tree.children
    assert diagnose(whole).identical(whole)
    np.testing.assert_allclose(whole["diagnostics/tau"], inefficiency(tree["unconstrained_posterior/state"].values), rtol=1e-10)
    np.testing.assert_allclose(whole["diagnostics/rejection_rate"], 1 - tree["sample_stats/acceptance_rate"])
    save_result(whole, tmp_path / "result.nc")
    assert load_result(tmp_path / "result.nc").identical(whole)


@pytest.mark.full
def test_weighted_particles_take_tau_from_the_effective_number() -> None:
    data = diagnose(synthetic_result(weighted=True))["diagnostics"].dataset
    assert (data["tau"] == 1000 / 800).all()
    assert "rhat" not in data
    assert "autocorrelation" not in data


@pytest.mark.full
@pytest.mark.parametrize(
    "arguments", [{"num_draws": 1, "num_chains": 1}, {"num_draws": 3}, {"num_frames": 1}, {"with_truth": False}]
)
def test_tiny_results_are_judged_silently(arguments: dict[str, int]) -> None:
    assert verdicts(synthetic_result(**arguments))  # type: ignore[arg-type]
