"""Names of the points of people's detectors, by the number of the point in the detector's list.

A keypoint belongs to the body's marker of the same name, if there is one. Names end in ``_l`` and ``_r`` for the person's left
and right.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from poseppl.motion.io.name_matching import without_prefixes

_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
_FOOT = ("big_toe", "small_toe", "heel")
_SIDED = (*_LIMBS, *_FOOT, "eye", "ear")
_MARKERS = frozenset({"neck", "pelvis", "skull", "crown", "nose", *(f"{part}_{side}" for part in _SIDED for side in "lr")})

_TOES = {f"foot_index_{side}": f"big_toe_{side}" for side in "lr"}
"""MediaPipe's tip of the foot."""
_SYNONYMS = {"mid_hip": "pelvis", "midhip": "pelvis", "root": "pelvis", "head_top": "crown", "top_head": "crown"}


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
    for number, name in enumerate(without_prefixes(names)):
        plain = plain_name(name)
        plain = _TOES.get(plain, plain)
        if plain in _MARKERS:
            found.setdefault(plain, number)
    return found


def _pairs(*parts: str) -> str:
    return " ".join(f"{part}_l {part}_r" for part in parts)


def _side(side: str, *parts: str) -> str:
    return " ".join(f"{part}_{side}" for part in parts)


_ARM, _LEG = _LIMBS[:3], _LIMBS[3:]
_COCO = f"nose {_pairs('eye', 'ear', *_LIMBS)}"
_ARMS, _LEGS = (f"{_side('r', *limb)} {_side('l', *limb)}" for limb in (_ARM, _LEG))
_FACE = "eye_r eye_l ear_r ear_l"
_MEDIAPIPE_FACE = f"nose {_side('l', 'eye_inner', 'eye', 'eye_outer')} {_side('r', 'eye_inner', 'eye', 'eye_outer')}"
_FEET = f"{_side('l', *_FOOT)} {_side('r', *_FOOT)}"

_TEXTS = {
    "coco17": _COCO,
    "coco23": f"{_COCO} {_FEET}",
    "coco18": f"nose neck {_ARMS} {_LEGS} {_FACE}",
    "body25": f"nose neck {_ARMS} pelvis {_LEGS} {_FACE} {_FEET}",
    "body25b": f"{_COCO} skull crown {_FEET}",
    "halpe26": f"{_COCO} crown neck pelvis {_pairs('big_toe', 'small_toe', 'heel')}",
    "mediapipe33": " ".join(
        [_MEDIAPIPE_FACE, _pairs("ear", "mouth", *_ARM), _pairs("pinky", "index", "thumb", *_LEG, "heel", "foot_index")]
    ),
}
LAYOUTS: Mapping[str, tuple[str, ...]] = {name: tuple(text.split()) for name, text in _TEXTS.items()}
"""MS COCO's 17 points, and 23 with COCO-WholeBody's feet; OpenPose's COCO, BODY_25 and BODY_25B; Halpe's 26, of AlphaPose and
RTMPose; MediaPipe's 33."""
