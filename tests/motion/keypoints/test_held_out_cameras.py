"""Densities of what held-out cameras see, against SciPy's Student t and sums over draws in plain loops."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from scipy.special import expit, logsumexp
from scipy.stats import multivariate_t, t

from poseppl.motion.geometry import join_cameras, look_at
from poseppl.motion.keypoints.held_out_cameras import (
    FREEDOM,
    DrawnPlaces,
    SeenPoints,
    _log_student,
    log_densities,
    log_predictions,
    probabilities,
)

RNG = np.random.default_rng(0)
SIZES = np.array([[640.0, 480.0], [1920.0, 1080.0], [800.0, 600.0]])
OFFSET, LOG_WEIGHT = 6 * RNG.normal(size=(2, 40, 3, 2)), RNG.normal(size=(2, 40))
SCALE, ODDS = RNG.uniform(2.0, 5.0, (2, 3)), RNG.normal(-2.0, 1.0, (2, 3))
SEEN = np.array([[True, True, True], [True, True, False]])
DRAWN = DrawnPlaces(np.where(SEEN[:, None, :, None], OFFSET, 0.0), LOG_WEIGHT)


def density(point: int, draw: int, camera: int) -> float:
    """Density of one camera's detection of one draw; clutter is uniform in its picture."""
    scale, clutter = SCALE[point, camera], expit(ODDS[point, camera])
    peak = multivariate_t(np.zeros(2), scale**2 * np.eye(2), FREEDOM).pdf(OFFSET[point, draw, camera])
    return float(np.log((1 - clutter) * peak + clutter / SIZES[camera].prod()))


EACH = np.array([[[density(n, s, c) if SEEN[n, c] else 0.0 for c in range(3)] for s in range(40)] for n in range(2)])


def test_places_are_drawn_from_students_of_three_dimensions() -> None:
    rng = np.random.default_rng(1)
    roots, means, places = np.tril(rng.normal(size=(2, 3, 3, 3))), rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 5, 3))
    roots[..., range(3), range(3)] = np.abs(roots[..., range(3), range(3)]) + 0.5
    found = _log_student(places, means, np.linalg.inv(roots))
    for n in range(2):
        for p in range(3):
            exact = multivariate_t(means[n, p], roots[n, p] @ roots[n, p].T, FREEDOM).logpdf(places[n])
            np.testing.assert_allclose(found[n, :, p], exact, rtol=1e-8)


def test_a_camera_is_predicted_from_what_the_others_saw() -> None:
    found = log_densities(DRAWN, jnp.asarray(SCALE), jnp.asarray(ODDS), SEEN, SIZES)
    np.testing.assert_allclose(found, EACH, rtol=1e-4)
    predicted = log_predictions(DRAWN, jnp.asarray(SCALE), jnp.asarray(ODDS), SEEN, SIZES)
    for n in range(2):
        for c in range(3):
            others = LOG_WEIGHT[n] + np.delete(EACH[n], c, axis=1).sum(1)
            exact = logsumexp(others + EACH[n, :, c]) - logsumexp(others) if SEEN[n, c] else 0.0
            np.testing.assert_allclose(predicted[n, c], exact, rtol=1e-3, atol=1e-3)


def test_probabilities_are_those_of_the_mixture_given_the_others() -> None:
    cameras = join_cameras([look_at((a, -4000.0, 0.0), (0.0, 0.0, 0.0)) for a in (-500.0, 0.0, 500.0)])
    points = np.where(SEEN[..., None], SIZES * RNG.uniform(0.1, 0.9, (2, 3, 2)), np.nan)
    seen = SeenPoints(cameras, SIZES, np.zeros(2, int), points, np.zeros((2, 3)), np.ones((2, 3)))
    found = probabilities(DRAWN, SCALE, ODDS, seen)
    assert np.isnan(found[1, 2]).all()
    for n, c in np.argwhere(SEEN):
        weight = np.exp(LOG_WEIGHT[n] + np.delete(EACH[n], c, axis=1).sum(1))
        below = weight / weight.sum() @ t.cdf(OFFSET[n, :, c] / SCALE[n, c], FREEDOM)
        clutter = expit(ODDS[n, c])
        np.testing.assert_allclose(found[n, c], (1 - clutter) * below + clutter * points[n, c] / SIZES[c], rtol=1e-4)
