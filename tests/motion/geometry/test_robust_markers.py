"""Robust errors of projected markers: density and curvature are those of the same errors written point by point."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.motion.geometry import marker_positions
from poseppl.motion.geometry.cameras import look_at, project
from poseppl.motion.likelihoods import ProjectedMarkers
from poseppl.program import Lorentzian, StateSpaceModel

pytestmark = pytest.mark.full

BODY, CAMERA, NOISE = full_body(), look_at((0.0, -4000.0, 1000.0), (0.0, 0.0, 900.0)), 0.003


def programs(gaussian_of):
    """A body whose points have Lorentzian errors around a Gaussian of its pose."""

    def walk(params, *before_and_inputs):
        numpyro.sample("pose", dist.Normal(jnp.asarray(BODY.rest, float), 1.0))

    def observation(params, state, inputs):
        numpyro.sample("points", Lorentzian(gaussian_of(state["pose"]).to_event(1), 6.0))

    return StateSpaceModel(walk, walk, observation).compile()


def test_they_are_those_of_each_point():
    """Also of a point that is an outlier, and of one that is not seen."""
    closed = programs(lambda pose: ProjectedMarkers(BODY.tree, CAMERA, pose, NOISE))
    plain = programs(lambda pose: dist.Normal(project(CAMERA, marker_positions(BODY.tree, pose)), NOISE))
    x = jnp.asarray(BODY.rest, float) + 0.1
    points = np.array(project(CAMERA, marker_positions(BODY.tree, x)))
    points += NOISE * np.random.default_rng(0).normal(size=points.shape)
    points[0, 3] += 0.2
    points[0, 5] = np.nan
    found = []
    for model in (closed, plain):
        data = model.observe({"points": points})
        value, gradient = jax.jit(jax.value_and_grad(model.log_observation))(x, data)
        found.append((float(value), np.asarray(gradient), np.asarray(jax.jit(model.observation_information)(x, data))))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4 * np.abs(other).max())
    inlier = np.where(np.arange(17)[:, None] == 3, points[0, 4], points[0])[None]
    kept = closed.observe({"points": np.where(np.arange(17)[:, None] == 3, np.nan, inlier)})
    gone = np.asarray(jax.jit(closed.observation_information)(x, kept))
    assert np.abs(found[0][2] - gone).max() < 0.05 * np.abs(gone).max()  # the outlier adds almost nothing
