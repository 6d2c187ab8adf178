"""The first frames of a scene: what a run that stopped has seen."""

from __future__ import annotations

from typing import overload

import numpy as np

from poseppl.motion.tracking.scene import Scene
from poseppl.motion.tracking.silhouette_scene import SilhouetteScene

_PER_FRAME = ("points", "frames", "states", "markers", "contour", "on_outline", "distance", "usable", "person", "edges")


@overload
def first_frames(seen: Scene, count: int) -> Scene: ...


@overload
def first_frames(seen: Scene | SilhouetteScene, count: int) -> Scene | SilhouetteScene: ...


def first_frames(seen: Scene | SilhouetteScene, count: int) -> Scene | SilhouetteScene:
    """Cut a scene.

    Args:
        seen: The scene, of points or of silhouettes.
        count: How many frames are left of it.
    """
    known = {name: getattr(seen, name) for name in _PER_FRAME if getattr(seen, name, None) is not None}
    cut = seen._replace(**{name: values[:count] for name, values in known.items()})
    if isinstance(cut, SilhouetteScene):
        return cut._replace(scene=first_frames(cut.scene, count))
    return cut._replace(noise=cut.noise[:count]) if np.ndim(cut.noise) == 3 else cut
