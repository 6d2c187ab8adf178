"""The noise of keypoints in one camera: as far beside the skeleton in mm, wherever the person is."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import body_builder
from poseppl.motion.geometry import Cameras, look_at, marker_positions, project
from poseppl.motion.keypoints.single_camera import BESIDE, distance_by_size, noise_in_one_camera
from poseppl.motion.tracking.default_body import DEFAULT_MODEL

BODY = body_builder(DEFAULT_MODEL)(None)


def seen_from(distance: float) -> tuple[Cameras, Floats]:
    """A camera, and a person at rest in it, of whose points a third is missing."""
    cameras = look_at([distance, 0.0, 900.0], [0.0, 0.0, 900.0], focal=1200.0)
    state = jnp.asarray(BODY.rest, float).at[:3].set(jnp.array([0.0, 0.0, 950.0]))
    points = np.asarray(project(cameras, marker_positions(BODY.tree, state)), float)[None].repeat(5, 0)
    missing = np.random.default_rng(0).random(points.shape[:-1]) < 0.3
    return cameras, np.where(missing[..., None], np.nan, points)


@pytest.mark.parametrize("distance", [2500.0, 5000.0, 9000.0])
def test_noise_is_as_large_in_mm_at_any_distance(distance: float) -> None:
    cameras, points = seen_from(distance)
    assert distance_by_size(BODY, cameras, points) == pytest.approx(distance, rel=0.1)
    beside = np.sqrt(noise_in_one_camera(BODY, cameras, points) ** 2 - (BODY.noise * 1200.0) ** 2)
    assert beside * distance / 1200.0 == pytest.approx(BESIDE, rel=0.1)
