"""The noise of a person's keypoints in a single camera, which nothing else measures.

Nobody has the mean adult's proportions, and a detector's idea of a joint is not a skeleton's: places of keypoints are some
centimetres from where the skeleton of the same pose has them, in all frames alike. Several cameras tell that apart from the
pose, and one does not. With the body's noise alone people are taken to be nearer than they are, with too narrow intervals
(``studies/one_camera.py``). So what is beside the skeleton counts as noise, of the size that it has in the picture.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Cameras, marker_positions
from poseppl.motion.tracking.scene import noise_of

BESIDE = 50.0
"""Standard deviation, mm, of how far keypoints are from a mean adult's skeleton in the same pose; ours, by the intervals of
``studies/one_camera.py``."""


def noise_in_one_camera(body: Body, cameras: Cameras, points: Floats) -> float:
    """Standard deviation, px, of keypoints (T, 1, K, 2) in one camera: the body's noise, and what is beside the skeleton."""
    focal = float(np.abs(np.asarray(cameras.focal, np.float64)).mean())
    return float(np.hypot(noise_of(body, cameras, None)[0, 0], focal * BESIDE / distance_by_size(body, cameras, points)))


def distance_by_size(body: Body, cameras: Cameras, points: Floats) -> float:
    """How far a person is from a camera, mm, by the size of the points (T, 1, K, 2): median over frames, as if at rest."""
    places = np.asarray(marker_positions(body.tree, jnp.asarray(body.rest, float)), np.float64)
    across = (places @ np.asarray(cameras.rotation[0], np.float64).T)[:, :2]
    image = points[:, 0] / np.asarray(cameras.focal[0], np.float64)
    image = image[np.isfinite(image).all(-1).sum(1) > 1]
    own = np.where(np.isfinite(image), across, np.nan)
    sizes = [np.sqrt(np.nansum((each - np.nanmean(each, 1, keepdims=True)) ** 2, (1, 2))) for each in (own, image)]
    return float(np.median(sizes[0] / sizes[1]))
