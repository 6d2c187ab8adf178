"""Training against what a synthetic walk is made of, and against hmmlearn's own inference."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from synthetic_walks import LOADINGS, walk, walks

from poseppl.errors import InputError, PosepplError
from poseppl.motion.learned import TrainingSettings, common_rate, train_motion_model
from poseppl.motion.learned.angles import mean_angle
from poseppl.motion.learned.training import baum_welch

SMALL = TrainingSettings(num_components=2, num_states=6, num_rounds=20)


@pytest.fixture(scope="module")
def model():
    return train_motion_model(walks(), "walks", SMALL)


def test_components_are_those_of_the_loop(model):
    assert [model.coordinates[index] for index in model.learned] == ["a.X", "b.X", "c.X"]
    orthonormal, _ = np.linalg.qr(LOADINGS)
    spanned = orthonormal @ orthonormal.T @ model.components
    np.testing.assert_allclose(spanned, model.components, atol=0.01)
    assert 0.99 < model.explained < 1
    np.testing.assert_allclose(np.sum(model.residual_scale**2), 0.02**2, rtol=0.2)  # one dimension of three is left


def test_each_person_has_a_mean_whatever_whole_turns(model):
    first, second = walks()
    for recording in (first, second):
        own = recording.states[:, model.learned]
        features = model.features(recording.states, recording.person)
        again = model.angles(features, recording.person)
        left = (again - own + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(left).max() < 5 * 0.02
        np.testing.assert_allclose(features.mean(0), 0, atol=1e-9)
    between = model.person_means[0] - model.person_means[1]
    assert np.abs((between + np.pi) % (2 * np.pi) - np.pi).max() < 1.0
    assert np.isclose(mean_angle(np.array([3.1, -3.1])) % (2 * np.pi), np.pi)


def test_states_follow_each_other_around(model):
    """In the order of their numbers, forwards or backwards, as a cycle does."""
    moves = model.transition - np.diag(np.diag(model.transition))
    ahead = np.trace(np.roll(moves, -1, 1)) / moves.sum()
    back = np.trace(np.roll(moves, 1, 1)) / moves.sum()
    assert max(ahead, back) > 0.95
    np.testing.assert_array_equal(model.initial, 1 / 6)
    assert (np.diff(model.log_likelihoods) > -1e-3).all() and model.log_likelihoods[-1] > model.log_likelihoods[0]


def test_steps_and_limits_are_those_of_the_training_data(model):
    changes = np.concatenate([np.diff(recording.states, axis=0) for recording in walks()])
    np.testing.assert_allclose(model.largest_step, np.abs(changes).max(0))
    assert np.isinf(model.limits[:4]).all()
    states = np.concatenate([recording.states for recording in walks()])
    np.testing.assert_allclose(model.limits[4], [states[:, 4].min(), states[:, 4].max()])
    assert np.ptp(model.limits[6]) < np.pi


def test_a_state_that_is_left_for_no_other():
    """A recording that ends in a state of its own: nothing is known of where it goes, and all are as likely."""
    features = np.concatenate([np.tile([[0.0], [1.0]], (20, 1)), [[50.0]]])
    found = baum_welch([features + 0.01 * np.random.default_rng(0).standard_normal(features.shape)], 3, num_rounds=5, seed=0)
    np.testing.assert_allclose(found.transition.sum(1), 1.0)
    np.testing.assert_allclose(found.transition[np.argmax(found.means[:, 0])], 1 / 3)


@pytest.mark.parametrize(
    ("recordings", "settings", "words"),
    [
        ([], SMALL, "no recording"),
        ([walk("tall", 0.0, frames=17)], SMALL, "17 frames are too few for 6 states .* 18 or more"),
        ([walk("tall", 0.0), walk("small", 0.0, rate=30.0)], SMALL, "small.bvh: 30 frames a second"),
        ([walk("tall", 0.0), walk("small", 0.0, frames=1)], SMALL, "small.bvh: a single frame"),
        ([walk("tall", 0.0)], SMALL._replace(num_components=4), "components: 4 components of 3 angles"),
        ([walk("tall", 0.0)], SMALL._replace(free=("hip", "tail")), "no joint 'tail'"),
        ([walk("tall", 0.0)], SMALL._replace(free=("neck",)), "the root 'hip' is learned"),
    ],
)
def test_what_cannot_be_learned_from(recordings, settings, words):
    with pytest.raises(InputError, match=words):
        train_motion_model(recordings, "walks", settings)


def test_a_missing_package_is_reported(monkeypatch):
    monkeypatch.setitem(sys.modules, "hmmlearn.hmm", None)
    monkeypatch.setitem(sys.modules, "hmmlearn", None)
    with pytest.raises(PosepplError, match="needs the package hmmlearn.*motion-models"):
        train_motion_model(walks(), "walks", SMALL)


@pytest.mark.full
def test_rates_have_a_common_one():
    assert common_rate([120.0, 60.0, 120.0]) == 60.0
    assert common_rate([100.0, 60.0]) == 20.0
    with pytest.raises(InputError, match="no rate is common"):
        common_rate([100.0, 100.0 * np.sqrt(2)])
