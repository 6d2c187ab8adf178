"""What a person who was found tells of a calibration that cannot be right: its unit of length, and which of its axes is up.

Neither shows in the pictures: a world that is a hundred times as large, or lies on its side, fits them as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.tracking.calibration_units import LARGEST_FACTOR, STATURE, segment_ratios

_UPRIGHT = 0.5
"""Cosine of the angle between trunk and Z, at least, of a person who stands, sits or bends forward."""
_SHOULDERS, _HIPS = ("shoulder_l", "shoulder_r"), ("hip_l", "hip_r")


def calibration_notes(places: Floats, markers: Sequence[str]) -> list[str]:
    """What the user should know of the calibration, a sentence each.

    Args:
        places: (T, K, 3) of the body's markers, mm; NaN where unknown.
        markers: K names.
    """
    return [*_size_note(places, markers), *_up_note(places, markers)]


def _size_note(places: Floats, markers: Sequence[str]) -> list[str]:
    table = {name: number for number, name in enumerate(markers)}
    ratios = [ratio for frame in places for ratio in segment_ratios(frame, table)]
    if not ratios or 1 / LARGEST_FACTOR <= (ratio := float(np.median(ratios))) <= LARGEST_FACTOR:
        return []
    return [
        f"the person is about {STATURE * ratio:.2g} m tall: the calibration's unit of length (--unit), or the size of its "
        "pictures, is wrong"
    ]


def _up_note(places: Floats, markers: Sequence[str]) -> list[str]:
    if not set(_SHOULDERS + _HIPS) <= set(markers):
        return []
    shoulders, hips = (places[:, [markers.index(name) for name in pair]].mean(1) for pair in (_SHOULDERS, _HIPS))
    trunk = shoulders - hips
    trunk = trunk[np.isfinite(trunk).all(-1)]
    if not len(trunk):
        return []
    along = np.median(trunk / np.linalg.norm(trunk, axis=-1, keepdims=True), 0)
    if along[2] >= _UPRIGHT * np.linalg.norm(along):
        return []
    axis = int(np.abs(along).argmax())
    return [
        f"the person's trunk points along {'-' if along[axis] < 0 else '+'}{'xyz'[axis]} of the calibration, whose z is taken "
        "for up: unless the person lies down, heights, and the pelvis's angles, are wrong; calibrate with z up"
    ]
