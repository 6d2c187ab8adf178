"""Silhouettes as cameras saw them, and how well a body's agree with these, and with how they moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.arrays import Booleans, Floats
from poseppl.compilation import jit
from poseppl.motion.geometry import Cameras, KinematicTree, depth
from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.coverage import hard_coverage, part_distances, project_parts
from poseppl.motion.geometry.flesh import Flesh, parts_of
from poseppl.motion.tracking.scene import Scene

_LONGER_SIDE = 160
"""Points of the grid along the longer side of a picture, at most."""
_CHUNK = 8
"""Frames that are drawn at a time."""


def silhouette_record(seen: SeenSilhouettes) -> dict[str, Floats]:
    """Figures of the silhouettes by themselves.

    Returns:
        ``silhouette_area`` (T, C), px^2 of the image, and ``silhouette_centre`` (T, C, 2), px: NaN where a camera saw nobody.
    """
    person = seen.person == 1
    size = person.sum((2, 3)).astype(float)
    usable = seen.usable & (size > 0)
    rows, columns = (np.arange(length, dtype=float) for length in person.shape[2:])
    middle = np.stack([person.sum(2) @ columns, person.sum(3) @ rows], -1) / np.maximum(size, 1)[..., None]
    centre = (middle + 0.5) / seen.scale[:, None] - 0.5
    return {
        "silhouette_area": np.where(usable, size / seen.scale**2, np.nan),
        "silhouette_centre": np.where(usable[..., None], centre, np.nan),
    }


def overlap(scene: Scene[Any], states: Any) -> Floats:
    """Intersection over union of a body's silhouette with those that were seen, where neither is hidden.

    Args:
        scene: The scene, whose body has flesh.
        states: States of the body (T, d).

    Returns:
        Shares (T, C); NaN where a camera saw nobody.
    """
    body, seen = scene.body, scene.data
    stride = -(-max(seen.person.shape[2:]) // _LONGER_SIDE)
    rows, columns = (np.arange(stride // 2, length, stride) for length in seen.person.shape[2:])
    grid = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    points = jnp.asarray((grid + 0.5) / seen.scale[:, None, None] - 0.5, float)
    known = seen.person[:, :, rows][:, :, :, columns].reshape(*seen.usable.shape, -1)
    ours = np.asarray(_drawn(body.tree, body.flesh, jnp.asarray(states, float), scene.cameras, points))
    both, either = (ours & (known == 1)).sum(-1), ((ours & (known >= 0)) | (known == 1)).sum(-1)
    return np.where(seen.usable & (either > 0), both / np.maximum(either, 1), np.nan)


def _covered(tree: KinematicTree, flesh: Flesh, states: Array, cameras: Cameras, points: Array) -> Array:
    """Which points (C, K, 2, 1) the silhouettes of states (d, N) cover, (C, K, N)."""
    return hard_coverage(part_distances(project_parts(cameras, flesh, parts_of(tree, flesh, states)), points))


_drawn = jit(jax.vmap(batch_last(_covered, chunk=_CHUNK), in_axes=(None, None, 0, None, None)))
"""Drawn silhouettes of a trajectory (T, d): (T, C, K); compiled once for a number of frames."""


class SeenSilhouettes(NamedTuple):
    """Silhouettes in C cameras over T frames.

    Attributes:
        contour: Points on the contours (T, C, K, 2), px.
        on_outline: Which of them are part of the person's outline (T, C, K).
        distance: Signed distances to the silhouettes (T, C, H, W), px of the image, negative inside.
        scale: Pixels of the maps to one of the image (C,).
        usable: Whether a camera's mask says anything in a frame (T, C).
        person: The masks at the maps' size (T, C, H, W): 1 on the person, 0 beside, -1 where the person may be hidden.
        noise: Standard deviation of distances at the body, mm.
        edges: Distances to the nearest edge of the images (T, C, H, W), px of the image; None if edges do not count.
        facing: Name of the camera that the person faces at first, where it is known.
        found: Settings by which the silhouettes were found, for the record.
    """

    contour: Floats
    on_outline: Booleans
    distance: NDArray[np.float32]
    scale: Floats
    usable: Booleans
    person: NDArray[np.int8]
    noise: float
    edges: NDArray[np.float32] | None = None
    facing: str | None = None
    found: Mapping[str, Any] | None = None

    def noise_in_pixels(self, cameras: Cameras, state: Any) -> Floats:
        """Standard deviations (C,) in px of the noise at the place of a state's root."""
        away = np.maximum(np.asarray(depth(cameras, jnp.asarray(state)[:3]), np.float64), 100.0)
        focal = np.abs(np.asarray(cameras.focal, np.float64)).mean(-1)
        return np.asarray(self.noise * focal / away)
