"""Silhouettes as cameras saw them, from which a start is sought and with which poses are compared."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Booleans, Floats
from poseppl.motion.geometry import Cameras, depth


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
