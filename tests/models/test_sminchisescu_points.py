"""Bodies seen as points: robust or Gaussian errors, parts that keep apart or not, and limits, as inputs and settings say."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.sminchisescu_triggs.body import superquadric_body
from poseppl_models.sminchisescu_triggs.programs import STRENGTH, point_inputs, point_programs

from poseppl.motion.geometry import look_at, marker_positions, project

pytestmark = pytest.mark.full

NOISE = 3.0


def test_errors_and_parts_are_as_the_inputs_say():
    """Differences of log-densities against the formulae, by hand; an arm bent into itself costs where its parts keep apart."""
    body = superquadric_body("arm")
    camera = look_at((0.0, -3000.0, 1400.0), (0.0, 0.0, 1300.0), 1000.0)
    pose, names = jnp.asarray(body.rest, float), list(body.tree.coordinates)
    bent = pose.at[names.index(("elbow_r", "X"))].set(2.6)
    noise, spread = jnp.full((1, 4), NOISE), jnp.full(8, 0.1)
    exact = np.asarray(project(camera, marker_positions(body.tree, pose)), float)
    astray = exact + np.array([40.0, 0.0])
    found = {}
    for robust, parts in ((True, True), (True, False), (False, False)):
        inputs = point_inputs(camera, noise, pose, spread, spread, body.tree, body.flesh, robust=robust)
        model = point_programs("arm", parts=parts).compile(inputs, {})

        density = jax.jit(model.log_observation)
        kept = {"parts": np.zeros(2)} if parts else {}
        seen = [model.observe({"points": points, **kept}) for points in (exact, astray)]
        found[robust, parts] = [float(density(state, data, inputs)) for state in (pose, bent) for data in seen]
    squared = (40.0 / NOISE) ** 2
    falls = {key: row[0] - row[1] for key, row in found.items()}
    np.testing.assert_allclose(falls[True, False], 4 * 0.5 * STRENGTH * np.log1p(squared / STRENGTH), rtol=1e-3)
    np.testing.assert_allclose(falls[False, False], 4 * 0.5 * squared, rtol=2e-3)
    found[True, False] = [each - np.log(2 * np.pi) for each in found[True, False]]  # of two more normal residuals
    assert abs(found[True, True][0] - found[True, False][0]) < 0.1 and found[True, True][2] < found[True, False][2] - 0.05


def test_limits_are_supports_or_none():
    body = superquadric_body("arm")
    camera = look_at((0.0, -3000.0, 1400.0), (0.0, 0.0, 1300.0), 1000.0)
    pose = jnp.asarray(body.rest, float)
    beyond = pose.at[list(body.tree.coordinates).index(("elbow_r", "X"))].set(2.7)
    inputs = point_inputs(camera, jnp.ones((1, 4)), pose, jnp.ones(8), jnp.ones(8), body.tree, body.flesh)
    models = [point_programs("arm", limits=limits).compile(inputs, {}) for limits in ("support", "none")]
    assert [bool(np.isfinite(model.log_initial(beyond, inputs))) for model in models] == [False, True]
