"""anipose's library: linear triangulation, and its optimisation over all frames, without and with segments of constant length.

Lengths that are to be constant are those of upper arms, forearms, thighs, shanks, and between the hips and between the
shoulders, as its own examples have them. Points of a confidence below 0.05 are not given; the library has no gate of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from aniposelib.cameras import Camera, CameraGroup
from given import Answer, Given
from scipy.spatial.transform import Rotation

NAME, PACKAGE = "anipose", "aniposelib"
SEGMENTS = [
    *((f"{above}_{side}", f"{below}_{side}") for side in "lr" for above, below in (("shoulder", "elbow"), ("elbow", "wrist"))),
    *((f"{above}_{side}", f"{below}_{side}") for side in "lr" for above, below in (("hip", "knee"), ("knee", "ankle"))),
    ("hip_l", "hip_r"),
    ("shoulder_l", "shoulder_r"),
]


def camera_group(given: Given) -> CameraGroup:
    """The cameras as the library has them; lengths are in mm."""
    cameras = []
    for c, number in enumerate(given.cameras):
        turn = Rotation.from_matrix(given.rotation[c]).as_rotvec()
        pose = {"rvec": turn, "tvec": given.translation[c], "name": f"cam_{number}"}
        cameras.append(Camera(given.matrix[c], given.distortion[c], tuple(given.size[c]), **pose))
    return CameraGroup(cameras)


def methods(given: Given) -> dict[str, Callable[[], Answer]]:
    """Methods that are compared."""
    group, points = camera_group(given), np.moveaxis(given.points, 1, 0)
    names = list(given.names)
    constraints = [[names.index(a), names.index(b)] for a, b in SEGMENTS]

    def linear() -> Answer:
        places = group.triangulate(points.reshape(len(points), -1, 2))
        return Answer(places.reshape(*points.shape[1:3], 3))

    def optimised(constraints: list[list[int]]) -> Answer:
        return Answer(group.triangulate_optim(points, constraints=constraints))

    return {
        "triangulate": linear,
        "triangulate_optim": partial(optimised, []),
        "triangulate_optim, constant lengths": partial(optimised, constraints),
    }
