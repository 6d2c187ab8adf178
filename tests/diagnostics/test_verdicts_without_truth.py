"""Verdicts that need no truth: on and off at both sides of their bounds, and right on a filter that is exact."""

from __future__ import annotations

import numpy as np
import pytest
from verdict_trees import drawn_tree, kalman_tree, points_tree, silhouettes_tree, steps_tree, texts

from poseppl.motion.verdicts import agreement, residuals, steps
from poseppl.motion.verdicts.residuals import MIN_SHARE, image_errors
from poseppl.motion.verdicts.steps import steps_of


def test_scales_of_an_exact_filter_are_one_and_wrong_noise_and_walk_show():
    right = kalman_tree()
    scale, walked = image_errors(right).scale(), steps_of(right)
    expected = np.sqrt(np.sum(walked.standardised**2) / np.sum(walked.expected))
    # 400 frames of 16 residuals and of 5 steps: standard errors of 0.01 and 0.016
    assert scale == pytest.approx(1, abs=0.04) and expected == pytest.approx(1, abs=0.06)
    assert "Image points" not in texts(right) and "walk" not in texts(right)
    # without the posterior's share of the variance, the right run would look wrong
    assert np.sqrt(np.nanmean(image_errors(right).standardised ** 2)) < 0.95
    assert "error: Image points" in texts(kalman_tree(noise=6.0))
    assert "warning: Image points" in texts(kalman_tree(noise=1.5))
    assert "error: Angles" in texts(kalman_tree(told_walk=0.05))
    assert "lower --set sigma_angle" in texts(kalman_tree(told_walk=20.0, noise=0.5, told=0.5))


@pytest.mark.parametrize("wrong", [{"noise": 6.0}, {"told_walk": 0.05}, {"told_walk": 20.0, "noise": 0.5, "told": 0.5}])
def test_with_a_learned_prior_no_option_of_the_walk_is_advised(wrong):
    tree = kalman_tree(**wrong)
    tree.attrs["prior"] = "walk.nc"
    assert "sigma_" not in texts(tree) and "--prior" in texts(tree)


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (0.99 * residuals.SCALE_LOW, "warning: Image points are 0.69 times"),
        (1.01 * residuals.SCALE_LOW, None),
        (0.99 * residuals.SCALE_HIGH, None),
        (1.01 * residuals.SCALE_HIGH, "warning: Image points are 1.11 times"),
        (1.01 * residuals.SCALE_ERROR, "error: Image points are 1.21 times"),
    ],
)
def test_residuals_of_all_points(scale, words):
    found = texts(points_tree(scale))
    assert image_errors(points_tree(scale)).scale() == pytest.approx(scale, rel=1e-6)
    assert words in found and "--noise" in found if words else "Image points" not in found


def test_points_whose_spread_hides_their_noise_are_left_out_of_an_exact_filter():
    """Precise points keep little of their residuals; of the others the identity holds as well as of all."""
    tree = kalman_tree(**dict.fromkeys(("noise", "told"), np.tile([9.0, 0.5, 0.2, 5.0], (2, 1))))
    found = image_errors(tree)
    share = 1 - np.square(tree["summary/points_sd"].values / tree["inputs/noise"].values[..., None])
    assert 0.1 < found.left_out == np.mean(share < MIN_SHARE) < 0.9
    assert found.scale() == pytest.approx(1, abs=0.05) and "Image points" not in texts(tree)


def test_a_spread_that_the_projection_bends_is_no_fault_of_the_points():
    """Half of the points have more variance than their noise, and errors of that size: they do not determine the noise."""
    bent = points_tree(1.0)
    bent["summary"]["points_sd"][:, :, :2] *= 3.0
    found = image_errors(bent)
    assert found.left_out == 0.5 and found.scale() == pytest.approx(1, abs=1e-6) and "Image points" not in texts(bent)
    # as they would count if a twentieth were expected of each
    expected = np.where(np.isfinite(found.expected), found.expected, 0.05)
    assert np.sqrt(np.sum(found.standardised**2) / np.sum(expected)) > residuals.SCALE_ERROR
    far = points_tree(1.5)
    far["summary"]["points_sd"][:, :, :2] *= 3.0
    assert "error: Image points are 1.50 times" in texts(far) and "without the 50 % of points whose posterior SD" in texts(far)
    bent["summary"]["points_sd"][:] = 1e3
    assert image_errors(bent).left_out == 1.0 and "Image points" not in texts(bent)


def test_a_minority_of_the_points_does_not_judge_the_noise():
    """If the posterior hides the noise of most points, the others are chosen by its variance, and say more about that."""
    hidden = points_tree(1.0)
    hidden["observed_data"]["points"][:, :, 3] += 100.0
    assert "Image points" in texts(hidden)
    hidden["summary"]["points_sd"][:, :, :3] *= 30.0
    found = texts(hidden)
    assert image_errors(hidden).left_out == 0.75 and image_errors(hidden).scale() > 1.5
    assert "Image points" not in found
    assert "info: The noise of the image points cannot be judged by their residuals: for 75 %" in found


def test_residuals_of_few_frames_are_no_evidence():
    assert "Image points" not in texts(points_tree(1.2, frames=1))
    assert "Image points" in texts(points_tree(1.2))


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_camera_and_a_marker_that_stand_out_are_named(factor):
    camera = np.ones((2, 4))
    camera[1] = factor * residuals.CAMERA_HIGH
    found = texts(points_tree(camera))
    assert ("Points of camera side are 1.16 times" in found) == (factor > 1) and "camera front" not in found
    camera[1] = factor * residuals.CAMERA_ERROR
    assert ("error: Points of camera side" in texts(points_tree(camera))) == (factor > 1)
    assert "(worst side 1." in texts(points_tree(camera)) and "--camera" in texts(points_tree(camera))
    marker = np.ones((2, 4))
    marker[:, 2] = factor * residuals.MARKER_HIGH
    assert ("Markers are too far from the body, by factors of ankle 2.0:" in texts(points_tree(marker))) == (factor > 1)


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_camera_that_is_off_on_average_is_reported_by_how_much(factor):
    tree = points_tree(0.0, shift=factor * residuals.BIAS_HIGH * np.array([0.6, -0.8]) * np.array([1, 0])[:, None, None])
    noise = tree["inputs/noise"].values[0]
    found = texts(tree)
    off = factor * residuals.BIAS_HIGH * np.median(noise)
    assert (f"off by ({0.6 * off:+.3g}, {-0.8 * off:+.3g}) in the median, 0.7 times their noise" in found) == (factor > 1)
    assert "camera side" not in found


def test_missing_points_and_points_of_changing_noise_count_as_they_should():
    tree = points_tree(1.01 * residuals.SCALE_HIGH)
    tree["observed_data"]["points"][3:9, 1] = np.nan
    assert image_errors(tree).scale() == pytest.approx(1.01 * residuals.SCALE_HIGH, rel=0.05)
    noise = tree["inputs/noise"].values
    tree["inputs"] = tree["inputs"].to_dataset().drop_vars("noise").assign(noise=(("t", "c", "k"), np.tile(noise, (30, 1, 1))))
    assert "Image points are 1.1" in texts(tree)
    tree["inputs"] = tree["inputs"].to_dataset().drop_vars("noise")
    assert "Image points" not in texts(tree)


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (0.99 * steps.STEPS_LOW, "warning: {} step 0.30 times"),
        (1.01 * steps.STEPS_LOW, None),
        (0.99 * steps.STEPS_HIGH, None),
        (1.01 * steps.STEPS_HIGH, "warning: {} step 2.02 times"),
        (1.01 * steps.STEPS_ERROR, "error: {} step 3.03 times"),
    ],
)
@pytest.mark.parametrize("group", ["Translations", "Angles"])
def test_steps_in_units_of_the_walk(scale, words, group):
    of_group = np.array([group == "Translations"] * 2 + [group == "Angles"] * 3)
    found = texts(steps_tree(np.where(of_group, scale, 1.0)))
    other, option = ("Angles", "--set sigma_position") if group == "Translations" else ("Translations", "--set sigma_angle")
    assert other not in found
    assert (words.format(group) in found and option in found) if words else group not in found


def test_leaps_of_single_frames_are_reported_with_their_frames():
    rare, often = texts(steps_tree(leaps=1)), texts(steps_tree(leaps=2))
    assert "Angles" not in rare
    assert "warning: Angles leap, beyond 4 times their random walk, in frames 8-9 (largest 5.5, knee.X in frame 8)" in often


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_single_large_leap_is_an_error(factor):
    found = texts(steps_tree(leaps=1, leap=factor * steps.LEAP_ERROR))
    assert ("error: Angles leap, beyond 4 times their random walk, in frame 8 (largest 10.1" in found) == (factor > 1)
    assert ("Angles leap" in found) == (factor > 1) and "Angles step" not in found


def test_monte_carlo_error_of_means_is_no_leap():
    """A posterior 300 steps wide moves the means of 1,000 draws by 13 steps a frame, which is no motion; 200 steps are."""
    assert "leap" not in texts(drawn_tree(300.0))
    assert "error: Angles leap" in texts(drawn_tree(300.0, leap=200.0))


def test_causes_are_reported_before_their_effects():
    wrong = texts(kalman_tree(told_walk=0.05)).splitlines()
    assert wrong[0].startswith("error: Translations") and any("error: Image points" in line for line in wrong)


def test_smoothed_steps_may_be_small_and_results_may_not_tell_the_walk():
    low = 0.5 * steps.STEPS_LOW
    assert "step" in texts(steps_tree(low)) and "random walk" not in texts(steps_tree(low, smoother=True))
    tree = steps_tree(9.0)
    tree["inputs"] = tree["inputs"].to_dataset().drop_vars("step_scale")
    assert "random walk" not in texts(tree)


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_overlap_by_camera(factor):
    share = np.random.default_rng(0).uniform(0.8, 0.9, (12, 2))
    for bound, severity in ((agreement.OVERLAP_LOW, "warning"), (agreement.OVERLAP_ERROR, "error")):
        share[:, 1] = factor * bound
        found = texts(silhouettes_tree(share))
        named = f"{severity}: Body and silhouettes overlap too little (side {factor * bound:.2f};"
        assert (named in found) == (factor < 1) and "front 0" not in found
    assert "--masks" in found


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_overlap_by_frame(factor):
    share = np.random.default_rng(0).uniform(0.8, 0.9, (12, 2))
    share[4], share[6] = factor * agreement.OVERLAP_FRAME, np.nan
    found = texts(silhouettes_tree(share))
    assert ("warning: Body and silhouettes overlap too little" in found) == (factor < 1)
    assert ("below 0.4 in frame 11)" in found) == (factor < 1)


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_silhouettes_that_leap_or_swell(factor):
    centre, area = np.full((12, 2, 2), 300.0), np.full((12, 2), 40_000.0)
    centre[8:, 1, 0] += factor * agreement.JUMP * 200.0
    assert ("jump or change size suddenly in side (frame 15)" in texts(silhouettes_tree(area=area, centre=centre))) == (
        factor > 1
    )
    slow = texts(silhouettes_tree(area=area, centre=centre, rate=10.0))
    assert "leap" not in slow  # in a tenth of a second somebody can run as far
    still = np.full((12, 2, 2), 300.0)
    area[3:, 0] *= agreement.SWELLING**factor
    assert ("jump or change size suddenly in front (frame 10)" in texts(silhouettes_tree(area=area, centre=still))) == (
        factor > 1
    )


@pytest.mark.full
def test_frames_of_silhouettes_are_missing_where_nobody_is_seen():
    area = np.full((12, 2), 40_000.0)
    assert "Nothing was observed" not in texts(silhouettes_tree(area=area))
    area[4, 0], area[5] = np.nan, np.nan
    assert "info: Nothing was observed in frame 12:" in texts(silhouettes_tree(area=area))
    area[5:8] = np.nan
    assert "warning: Nothing was observed in frames 12-14:" in texts(silhouettes_tree(area=area))
