"""Which keypoint of a detector is which marker of a body, by the number of the point in the detector's list."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


class Layout(NamedTuple):
    """The points of a detector.

    Attributes:
        num_points: K.
        markers: The points' numbers by the names of a body's markers; other points are not used.
    """

    num_points: int
    markers: Mapping[str, int]


def _sides(left: tuple[int, ...], right: tuple[int, ...]) -> dict[str, int]:
    pairs = zip(_LIMBS, left, right, strict=True)
    return {name: place for limb, *ends in pairs for name, place in zip((f"{limb}_l", f"{limb}_r"), ends, strict=True)}


_COCO = _sides((5, 7, 9, 11, 13, 15), (6, 8, 10, 12, 14, 16))

LAYOUTS: Mapping[str, Layout] = {
    "coco17": Layout(17, _COCO),
    "coco18": Layout(18, {"neck": 1} | _sides((5, 6, 7, 11, 12, 13), (2, 3, 4, 8, 9, 10))),
    "body25": Layout(25, {"neck": 1, "pelvis": 8} | _sides((5, 6, 7, 12, 13, 14), (2, 3, 4, 9, 10, 11))),
    "body25b": Layout(25, {"skull": 17, "crown": 18} | _COCO),
    "halpe26": Layout(26, {"crown": 17, "neck": 18, "pelvis": 19} | _COCO),
}
"""MS COCO's 17 points; OpenPose's COCO, BODY_25 and BODY_25B; Halpe's 26, of AlphaPose and RTMPose."""
