"""Check a calibration by the person in it: a unit of length that cannot be right, and the axis that points up.

Neither shows in the pictures: a world that is a hundred times as large, or lies on its side, fits them as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, Phrase
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import triangulate, viewing_rays
from poseppl.motion.io.units_and_axes import VerticalAxis, named_axis, vertical_axis
from poseppl.motion.keypoints.calibration_units import LARGEST_FACTOR, STATURE, segment_ratios


def vertical_of_calibration(cameras: Cameras, points: Floats, confidence: Floats, markers: Sequence[str]) -> VerticalAxis:
    """Which axis of a calibration points up; Z, unless a person stands along another one and the cameras agree.

    Args:
        cameras: C cameras.
        points: (T, C, K, 2) of one person's markers, px; NaN where not seen.
        confidence: (T, C, K).
        markers: K names.
    """
    places = triangulate(cameras, points, confidence)
    if not np.isfinite(places).all(-1).any():
        rays = [viewing_rays(cameras, camera, points[:, camera]) for camera in range(points.shape[1])]
        places = np.concatenate(rays)  # the direction from feet to head in a camera's picture
    found = vertical_axis(markers, places, usual="z", kind="calibrations")
    if found.certain and found.axis in ("z", _level(cameras)):
        return found
    seen = f"the person's head is above the feet along {found.axis.upper()}, which the cameras contradict"
    return VerticalAxis("z", seen if found.certain else "no person is seen upright along another axis", False)


def _level(cameras: Cameras) -> str:
    """The axis of the world that is nearest to the cameras' mean upward direction."""
    up = -np.asarray(cameras.rotation, np.float64)[:, 1].mean(0)
    axis = int(np.abs(up).argmax())
    return named_axis(axis, float(up[axis]))


def calibration_notes(places: Floats, markers: Sequence[str]) -> list[str]:
    """Report a person whom the calibration's unit makes too large or too small.

    Args:
        places: (T, K, 3) of the body's markers, mm; NaN where unknown.
        markers: K names.
    """
    table = {name: number for number, name in enumerate(markers)}
    ratios = [ratio for frame in places for ratio in segment_ratios(frame, table)]
    if not ratios or 1 / LARGEST_FACTOR <= (ratio := float(np.median(ratios))) <= LARGEST_FACTOR:
        return []
    return [
        Phrase(
            f"the person is about {STATURE * ratio:.2g} m tall: the calibration's unit of length (",
            Argument("unit"),
            "), or the size of its pictures, is wrong",
        )
    ]
