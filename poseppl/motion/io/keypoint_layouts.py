"""Names of the points of people's detectors, by the number of the point in the detector's list.

Where a body has a marker of the same name, the keypoint is of that marker. Names end in ``_l`` and ``_r`` for the person's left
and right.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_MARKERS = frozenset({"neck", "pelvis", "skull", "crown", *(f"{limb}_{side}" for limb in _LIMBS for side in "lr")})


class Layout(NamedTuple):
    """The points of a detector.

    Attributes:
        names: K names.
    """

    names: tuple[str, ...]

    @property
    def num_points(self) -> int:
        """K."""
        return len(self.names)

    @property
    def markers(self) -> dict[str, int]:
        """The points' numbers by the names of a body's markers; other points are not used."""
        return {name: number for number, name in enumerate(self.names) if name in _MARKERS}


def _layout(text: str) -> Layout:
    return Layout(tuple(text.split()))


def _pairs(*parts: str) -> str:
    return " ".join(f"{part}_l {part}_r" for part in parts)


def _side(side: str, *parts: str) -> str:
    return " ".join(f"{part}_{side}" for part in parts)


_ARM, _LEG, _FOOT = _LIMBS[:3], _LIMBS[3:], ("big_toe", "small_toe", "heel")
_COCO = f"nose {_pairs('eye', 'ear', *_LIMBS)}"
_FACE = "eye_r eye_l ear_r ear_l"
_MEDIAPIPE_FACE = f"nose {_side('l', 'eye_inner', 'eye', 'eye_outer')} {_side('r', 'eye_inner', 'eye', 'eye_outer')}"
_FEET = f"{_side('l', *_FOOT)} {_side('r', *_FOOT)}"

LAYOUTS: Mapping[str, Layout] = {
    "coco17": _layout(_COCO),
    "coco18": _layout(f"nose neck {_side('r', *_ARM)} {_side('l', *_ARM)} {_side('r', *_LEG)} {_side('l', *_LEG)} {_FACE}"),
    "body25": _layout(
        f"nose neck {_side('r', *_ARM)} {_side('l', *_ARM)} pelvis {_side('r', *_LEG)} {_side('l', *_LEG)} {_FACE} {_FEET}"
    ),
    "body25b": _layout(f"{_COCO} skull crown {_FEET}"),
    "halpe26": _layout(f"{_COCO} crown neck pelvis {_pairs('big_toe', 'small_toe', 'heel')}"),
    "mediapipe33": _layout(
        f"{_MEDIAPIPE_FACE} {_pairs('ear', 'mouth', *_ARM)} {_pairs('pinky', 'index', 'thumb', *_LEG, 'heel', 'foot_index')}"
    ),
}
"""MS COCO's 17 points; OpenPose's COCO, BODY_25 and BODY_25B; Halpe's 26, of AlphaPose and RTMPose; MediaPipe's 33."""
