"""The error of the mean posture."""

from __future__ import annotations

import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_papers.peursum.tracks import mean_posture, posture_error

from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS, virtual_markers

BODY = full_body(None)
TREE = BODY.tree
REST = np.asarray(BODY.rest, np.float64)


def markers(state):
    return np.asarray(virtual_markers(TREE.marker_names, BODY.places(state[None])[0]), np.float64)


def particles(count=1):
    return REST + np.random.default_rng(3).normal(size=(count, len(REST))) * np.where(np.arange(len(REST)) < 3, 30.0, 0.2)


@pytest.mark.full
def test_one_particle_has_its_own_distance_without_the_hips():
    state, truth = particles()[0], markers(REST)
    distances = dict(zip(VIRTUAL_MARKERS, np.linalg.norm(markers(state) - truth, axis=-1), strict=True))
    kept = [distance for name, distance in distances.items() if name not in ("hip_l", "hip_r")]
    assert len(kept) == 13
    assert posture_error(TREE, state[None], [2.5], truth) == pytest.approx(np.mean(kept), abs=1e-3)
    assert posture_error(TREE, REST[None], [1.0], truth) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.full
def test_hips_do_not_count():
    truth = markers(REST)
    other = truth.copy()
    other[[VIRTUAL_MARKERS.index(f"hip_{side}") for side in "lr"]] += 1000.0
    assert posture_error(TREE, particles(), [1.0], other) == posture_error(TREE, particles(), [1.0], truth)
    other[VIRTUAL_MARKERS.index("pelvis")] += [0.0, 130.0, 0.0]
    assert posture_error(TREE, REST[None], [1.0], other) == pytest.approx(10.0, abs=1e-3)


@pytest.mark.full
def test_angles_are_averaged_on_the_circle():
    states = np.repeat(REST[None], 2, 0)
    states[:, 3] = np.radians([179.0, -179.0])
    mean = mean_posture(states, [1.0, 1.0])
    assert np.cos(mean[3]) == pytest.approx(-1.0) and abs(np.sin(mean[3])) < 1e-12
    facing_back = REST.copy()
    facing_back[3] = np.pi
    assert posture_error(TREE, states, [0.5, 0.5], markers(facing_back)) == pytest.approx(0.0, abs=1e-3)
    around = particles(5)
    around[:, 3:] += 2 * np.pi * np.random.default_rng(4).integers(-2, 3, around[:, 3:].shape)
    weights = np.array([0.1, 0.2, 0.0, 0.3, 0.4])
    again = mean_posture(around, weights)
    close = mean_posture(particles(5), weights)
    np.testing.assert_allclose(close, np.average(particles(5), 0, weights), atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * again[3:]), np.exp(1j * close[3:]), atol=1e-9)


@pytest.mark.full
def test_particles_without_weight_do_not_matter():
    states = particles(3)
    states[1] = np.nan
    np.testing.assert_allclose(mean_posture(states, [0.3, 0.0, 0.1]), (3 * states[0] + states[2]) / 4)
