"""Errors of virtual markers, with closed forms."""

import numpy as np
import pytest

from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS, marker_errors, over_runs, virtual_markers

NAMES = ("pelvis", "crown", *(f"{joint}_{side}" for side in "lr" for joint in ("shoulder", "elbow", "wrist")))
NAMES += tuple(f"{joint}_{side}" for side in "lr" for joint in ("hip", "knee", "ankle"))
RNG = np.random.default_rng(0)


def test_fifteen_markers_two_of_which_are_midpoints():
    places = RNG.normal(size=(4, len(NAMES), 3))
    found = virtual_markers(NAMES, places)
    assert found.shape == (4, 15, 3) and len(set(VIRTUAL_MARKERS)) == 15
    hips = (places[:, NAMES.index("hip_l")] + places[:, NAMES.index("hip_r")]) / 2
    np.testing.assert_allclose(found[:, VIRTUAL_MARKERS.index("pelvis")], hips)
    np.testing.assert_allclose(found[:, VIRTUAL_MARKERS.index("knee_r")], places[:, NAMES.index("knee_r")])


def test_a_shift_is_absolute_error_alone():
    truth = RNG.normal(0, 500, (7, 4, 3))
    places = truth[:, None] + np.array([30.0, 40.0, 0.0])
    places[:, :, 3, 2] += 12.0
    found = marker_errors(places, np.ones((7, 1)), truth, root=1)
    np.testing.assert_allclose(found.absolute, np.broadcast_to([50, 50, 50, np.hypot(50, 12)], (7, 4)))
    np.testing.assert_allclose(found.relative, np.broadcast_to([0, 0, 0, 12], (7, 4)), atol=1e-9)
    np.testing.assert_allclose(found.weighted, found.absolute.mean(1))
    np.testing.assert_allclose(found.weighted_relative, 3.0)
    np.testing.assert_allclose(found.optimistic, found.weighted)


def test_particles_on_both_sides():
    """Three particles at -30, 10 and 90 mm with weights 3 : 1 : 0: the mean is at -20, and the second is best."""
    truth = np.zeros((1, 5, 3))
    places = np.zeros((1, 3, 5, 3))
    places[0, :, :, 0] = np.array([-30.0, 10.0, 90.0])[:, None]
    found = marker_errors(places, [[3.0, 1.0, 0.0]], truth)
    np.testing.assert_allclose(found.absolute, 20.0)
    np.testing.assert_allclose(found.weighted, 25.0)
    np.testing.assert_allclose(found.optimistic, 10.0)
    np.testing.assert_allclose((found.relative.max(), found.weighted_relative[0]), 0.0, atol=1e-12)


def test_a_particle_of_no_weight_may_be_the_best_or_hold_anything():
    truth = np.zeros((1, 2, 3))
    places = np.stack([np.full((2, 3), 10.0), np.zeros((2, 3)), np.full((2, 3), np.nan)])[None]
    found = marker_errors(places, [[1.0, 0.0, 0.0]], truth)
    np.testing.assert_allclose(found.absolute, 10 * np.sqrt(3))
    np.testing.assert_allclose((found.weighted, found.optimistic), [[10 * np.sqrt(3)], [0.0]])


def test_what_is_unknown_does_not_count():
    truth = np.zeros((2, 3, 3))
    truth[0, 2] = np.nan
    truth[1] = np.nan
    found = marker_errors(np.full((2, 1, 3, 3), 1.0), np.ones((2, 1)), truth)
    np.testing.assert_allclose(found.optimistic, [np.sqrt(3), np.nan])
    assert np.isnan(found.absolute[0, 2]) and np.isnan(found.absolute[1]).all()
    assert over_runs([found.optimistic]).mean == pytest.approx(np.sqrt(3))


def test_mean_and_deviation_over_runs():
    """Runs of means 1, 2 and 6: 3 and the square root of (4 + 1 + 9) / 2; frames are no runs."""
    found = over_runs([[0.0, 2.0], [2.0, 2.0], [np.nan, 6.0]])
    assert found.mean == pytest.approx(3.0) and found.sd == pytest.approx(np.sqrt(7.0))
    assert np.isnan(over_runs([[1.0, 3.0]]).sd)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"places": np.zeros((2, 3, 4))}, "places have shape"),
        ({"weights": np.ones((2, 2))}, "weights have shape"),
        ({"truth": np.zeros((2, 5, 3))}, "truth"),
        ({"weights": np.zeros((2, 3))}, "add up to nothing"),
        ({"weights": np.full((2, 3), np.nan)}, "not finite"),
    ],
)
def test_mismatches_are_reported(change, words):
    given = {"places": np.zeros((2, 3, 4, 3)), "weights": np.ones((2, 3)), "truth": np.zeros((2, 4, 3))} | change
    with pytest.raises(ValueError, match=words):
        marker_errors(**given)


def test_missing_markers_are_named():
    with pytest.raises(ValueError, match="crown"):
        virtual_markers(("hip_l",), np.zeros((1, 3)))
    with pytest.raises(ValueError, match="Expected"):
        virtual_markers(NAMES, np.zeros((3, 3)))
    with pytest.raises(ValueError, match="R of at least 1"):
        over_runs([])


def test_relative_errors_are_measured_from_the_root_that_is_named():
    """Three markers off by 1, 10 and 0 mm: beside the second, by 9, 0 and 10."""
    places = np.zeros((1, 1, 3, 3))
    places[0, 0, :, 0] = [1.0, 10.0, 0.0]
    found = marker_errors(places, [[1.0]], np.zeros((1, 3, 3)), root=1)
    np.testing.assert_allclose(found.relative, [[9.0, 0.0, 10.0]])
    np.testing.assert_allclose(found.weighted_relative, [19.0 / 3])
