"""Needs of smoothers of silhouettes: all frames at once, and the scene, whose pictures a result does not contain."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.silhouettes import full_body
from silhouette_rooms import RECORDS, body, masks_of, pose

from poseppl.errors import InputError
from poseppl.motion.silhouettes.scene import silhouette_scene
from poseppl.motion.silhouettes.video_sources import DEFAULT_MODEL
from poseppl.motion.tracking import SmoothSettings, TrackSettings, make_problem, smooth, track
from poseppl.particles.stacks import tree_index
from poseppl.runs.contents import flat_draws
from poseppl.runs.frame_sequence import stacked_inputs

pytestmark = pytest.mark.full

FRAMES = 3
FEW = TrackSettings(DEFAULT_MODEL, "annealed", {"num_particles": 40, "num_layers": 2})


@pytest.fixture(scope="module")
def scene():
    masks = [masks_of(pose(seed)) for seed in range(FRAMES)]
    found = silhouette_scene(
        body(), RECORDS, {record.name: np.stack([each[record.name] for each in masks]) for record in RECORDS}
    )
    states = np.stack([pose(seed) for seed in range(FRAMES)])
    return found._replace(states=states, markers=full_body().places(states), rate=30.0)


def test_all_frames_at_once_are_the_frames_one_by_one(scene):
    problem = make_problem(scene)
    model, data, inputs = problem.model, problem.observations, stacked_inputs(problem.inputs, FRAMES)
    rng = np.random.default_rng(0)
    xs = jnp.asarray(scene.states + rng.normal(0.0, 0.05, (4, *scene.states.shape)), float)  # of four chains

    def density(x, data, inputs):
        return model.log_observation(x, data, inputs)

    together = jax.jit(jax.vmap(jax.vmap(jax.value_and_grad(density)), (0, None, None)))(xs, data, inputs)
    alone = jax.jit(jax.value_and_grad(density))
    for t in range(FRAMES):
        for chain in range(len(xs)):
            value, slope = alone(xs[chain, t], tree_index(data, t), tree_index(inputs, t))
            np.testing.assert_allclose(together[0][chain, t], value, rtol=1e-5)
            np.testing.assert_allclose(together[1][chain, t], slope, rtol=1e-3, atol=1e-3 * np.abs(slope).max())


def test_a_result_is_smoothed_with_its_scene_alone(scene):
    tracked, settings = track(scene, FEW), SmoothSettings("backward-simulation")
    result = tracked.result
    with pytest.raises(InputError, match="does not contain their pictures.*smooth='METHOD'"):
        smooth(result, settings)
    smoothed = smooth(tracked, settings)
    assert smoothed["posterior"].sizes["frame"] == FRAMES
    assert np.isfinite(smoothed["summary"].dataset["markers_mean"].values).all()
    # nothing comes after the last frame: its draws are the filter's, resampled
    last, filtered = (
        flat_draws(each).transpose("chain", "draw", "frame", "state_dim").values[0, :, -1] for each in (smoothed, result)
    )
    assert all((row == filtered).all(1).any() for row in last)
