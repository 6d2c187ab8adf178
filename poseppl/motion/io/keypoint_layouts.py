"""Names of the points of people's detectors, by the number of the point in the detector's list.

Where a body has a marker of the same name, the keypoint is of that marker. Names end in ``_l`` and ``_r`` for the person's left
and right.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_MARKERS = frozenset({"neck", "pelvis", "skull", "crown", *(f"{limb}_{side}" for limb in _LIMBS for side in "lr")})

_SYNONYMS = {"mid_hip": "pelvis", "midhip": "pelvis", "root": "pelvis", "head_top": "crown", "top_head": "crown"}


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


def plain_name(name: str) -> str:
    """A point's name in our form: "LShoulder", "left_shoulder" and "Shoulder L" are ``shoulder_l``.

    >>> [plain_name(name) for name in ("LShoulder", "left_shoulder", "Right Knee", "r_ankle", "ankle1", "MidHip", "mouth_left")]
    ['shoulder_l', 'shoulder_l', 'knee_r', 'ankle_r', 'ankle1', 'pelvis', 'mouth_l']
    """
    apart = re.sub("([a-z0-9])([A-Z])|([LR])([A-Z][a-z])", r"\1\3_\2\4", name.strip())
    words = [word for word in re.split("[^a-z0-9]+", apart.lower()) if word]
    sides = {"left": "l", "right": "r", "l": "l", "r": "r"}
    side = [sides[word] for word in words if word in sides]
    rest = "_".join(word for word in words if word not in sides)
    whole = _SYNONYMS.get(rest, rest)
    return f"{whole}_{side[0]}" if len(side) == 1 and whole else whole


def markers_of_names(names: Sequence[str]) -> dict[str, int]:
    """Numbers of points by the names of a body's markers, where their names tell; others are not used."""
    found: dict[str, int] = {}
    for number, name in enumerate(names):
        plain = plain_name(name)
        if plain in _MARKERS:
            found.setdefault(plain, number)
    return found


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
