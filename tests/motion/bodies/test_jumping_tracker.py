"""A tracker of modes that jumps from limb to limb keeps the pose that one camera cannot tell from the truth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.joint_angles import joint_limits

from poseppl.filters import covariance_scaled_filter
from poseppl.kernels.constraints import constraints
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import marker_positions
from poseppl.motion.geometry.cameras import look_at, project
from poseppl.motion.geometry.kinematic_jumps import kinematic_jumps

NOISE = 0.003


def posed():
    """A body whose right arm reaches sideways and away from the camera, its elbow bent: body, model, inputs and data."""
    body = full_body()
    names = body.tree.coordinate_names
    truth = np.array(body.rest, np.float32)
    for name, angle in (("shoulder_r.Y", -0.73), ("shoulder_r.X", 0.56), ("elbow_r.X", 0.92)):
        truth[names.index(name)] = angle
    scale = np.where(np.arange(len(truth)) < 3, 30.0, 0.1)
    scale[[i for i, name in enumerate(names) if name.startswith(("shoulder_r", "elbow_r"))]] = 1.0
    camera = look_at((0.0, -4000.0, 1000.0), (0.0, 0.0, 900.0))
    steps = np.where(np.arange(len(truth)) < 3, 15.0, 0.15)
    noise = jnp.full((1, len(body.tree.marker_names)), NOISE)
    inputs = BodyInputs(camera, noise, *(jnp.asarray(part, jnp.float32) for part in (truth, scale, steps)), body.tree)
    model = body.compile(inputs, body.params)
    points = np.asarray(project(camera, marker_positions(body.tree, jnp.asarray(truth))))
    data = model.observe({"points": points + NOISE * np.random.default_rng(0).normal(size=points.shape)})
    return body, model, inputs, data


@pytest.mark.slow
def test_the_arm_is_kept_leaning_either_way():
    """With jumps there are modes whose wrist is a hand's breadth or more apart in depth; from the mean alone there is one."""
    body, model, inputs, data = posed()
    low, high = joint_limits(body.tree).T
    limits = constraints(len(low), lower=np.minimum(low, body.rest - 0.05), upper=np.maximum(high, body.rest + 0.05))
    wrist = body.tree.marker_names.index("wrist_r")
    depths = {}
    for name, settings in {
        "jumps": {"num_starts": 32, "jumps": kinematic_jumps(body.tree)},
        "mean": {"num_starts": 4},
    }.items():
        built = covariance_scaled_filter(model, 50, num_modes=4, limits=limits, num_steps=40, **settings)
        state, info = jax.jit(built.init)(jax.random.key(0), data, inputs)
        live = np.asarray(state.modes.log_weights) > np.log(0.02)
        positions = np.asarray(jax.vmap(lambda x: marker_positions(body.tree, x))(state.modes.means))
        depths[name] = positions[live][:, wrist, 1]
        images = np.asarray(project(inputs.cameras, jnp.asarray(positions[live])))[0]
        assert not bool(info.failed) and (np.abs(images - np.asarray(data.values["points"])[0]) < 5 * NOISE).all()
        low_enough = np.asarray(state.particles) >= np.asarray(limits.lower) - 1e-4
        assert low_enough.all()
    assert np.ptp(depths["jumps"]) > 80.0  # mm
    assert np.ptp(depths["mean"]) < 1.0
