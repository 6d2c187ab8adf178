"""A correct run has no error among its verdicts, and a run with the wrong noise or walk has one."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.diagnostics import verdicts
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import TrackSettings, observe_motion, track
from poseppl.motion.tracking.placing import camera_names, cameras_around


@pytest.fixture(scope="module")
def scene():
    """The arm of the walk in two cameras; the rest of the body is known."""
    subject = walking_subject("poseppl_models.bodies.choo_fleet:arm", frames="0:30")
    return observe_motion(subject, cameras_around(subject, count=2), camera_names(2))


def with_data(scene, **changes):
    return scene._replace(data=scene.data._replace(**changes))


def errors_of(scene, **settings):
    tree = track(scene, TrackSettings(filter="kalman", options={"num_particles": 100}, max_draws=50, **settings)).result
    return [verdict.text for verdict in verdicts(tree) if verdict.severity == "error"]


@pytest.mark.slow
def test_a_run_that_is_right_has_no_error(scene):
    assert errors_of(scene) == []


@pytest.mark.slow
def test_noise_and_walk_that_are_wrong_are_named_with_their_options(scene):
    (noise,) = (text for text in errors_of(with_data(scene, noise=scene.data.noise / 3)) if text.startswith("Image points"))
    assert 2.7 < float(noise.split()[3]) < 3.3 and "raise noise by that factor" in noise
    assert any("sigma_angle" in text for text in errors_of(scene, sigma_angle=0.05))
    shifted = scene.data.points + np.array([0.0, 0.02])[:, None, None]
    assert any(text.startswith("Points of camera") for text in errors_of(with_data(scene, points=shifted)))
