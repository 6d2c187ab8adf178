"""Points as FreeMoCap writes them: one NumPy array of all cameras, (cameras, frames, points, 2 or 3) in px.

Points are MediaPipe's 33 of the body; those of hands and face that follow are left out. A point that was not found is NaN, or
at 0, 0. There is no confidence: a point that was found has 1. Cameras are in the order of their names, as in the calibration.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.files.array_reading import read_array
from poseppl.motion.io.detections import MAX_FRAMES, MAX_POINTS, MAX_VALUES, DetectedPeople, people_of_table
from poseppl.motion.io.keypoint_layouts import LAYOUTS

_BODY = LAYOUTS["mediapipe33"]
_EXPECTED = f"numbers by camera, frame, point and x, y, with {len(_BODY)} points of the body first"


def read_freemocap(path: FilePath, camera: str | None, cameras: Sequence[str] = ()) -> DetectedPeople:
    """Read one camera of FreeMoCap's array.

    Args:
        path: The .npy file.
        camera: The camera.
        cameras: All cameras of the calibration, in the order of the array.

    Raises:
        InputError: The file is no such array, or has another number of cameras.
    """
    at = Location(path)
    values = read_array(path, max_values=MAX_VALUES)
    if values.ndim != 4 or values.shape[3] not in (2, 3) or not len(_BODY) <= values.shape[2] <= MAX_POINTS:
        raise at.error(f"an array of shape {values.shape}", _EXPECTED)
    if camera is None or camera not in cameras or len(values) != len(cameras):
        problem = f"the array has {len(values)} cameras, the calibration {len(cameras)}: {', '.join(cameras)}"
        raise at.error(problem, "a calibration of the cameras of the array, in their order")
    if not 0 < values.shape[1] <= MAX_FRAMES:
        raise at.error(f"{values.shape[1]} frames", f"1 to {MAX_FRAMES}")
    own: Floats = np.asarray(values, np.float64)[list(cameras).index(camera)]
    points = own[:, : len(_BODY), :2]
    table = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=2)[:, None]
    return people_of_table(table, np.arange(len(table)), _BODY, at)._replace(layout="mediapipe33")
