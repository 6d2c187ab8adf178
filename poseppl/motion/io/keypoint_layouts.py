"""Names of the points of people's detectors, by the number of the point; and which layout a detector's points have.

A keypoint belongs to the body's marker of the same name, if there is one. Names end in ``_l`` and ``_r`` for the person's left
and right.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, Location, brief
from poseppl.motion.io.detections import DetectedPeople
from poseppl.motion.io.names import without_prefixes

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


_EYE, _NOSE, _TOE = 15, 0, 19
_NEAR = 0.3
"""Point 15 is an eye if it is nearer to the nose than this share of the nose's distance from a toe."""
_WHOLE_BODIES = {133: ("coco23", "coco17"), 136: ("halpe26",)}
"""Points of the whole body, of which the first ones are those of a layout: COCO-WholeBody, and Halpe's with hands and face."""


def layout_of(points: Floats, at: Location) -> str:
    """Which points (..., K, 2) these are.

    Raises:
        InputError: No layout has K points.
    """
    count = points.shape[-2]
    fitting = [name for name, layout in LAYOUTS.items() if len(layout) == count]
    if not fitting:
        known = ", ".join(f"{name} ({len(layout)})" for name, layout in LAYOUTS.items())
        raise at.error(f"people with {count} points", known)
    if fitting != ["body25", "body25b"]:
        return fitting[0]
    with np.errstate(invalid="ignore"):
        nose = points[..., _NOSE, :]
        ratio = np.linalg.norm(points[..., _EYE, :] - nose, axis=-1) / np.linalg.norm(points[..., _TOE, :] - nose, axis=-1)
    known = ratio[np.isfinite(ratio)]
    return "body25" if known.size and np.median(known) < _NEAR else "body25b"


def _agree(names: Sequence[str], layout: Sequence[str]) -> bool:
    """Whether the joints among names stand where a layout has them."""
    joints = {number: marker for marker, number in markers_of_names(names).items()}
    return len(names) == len(layout) and all(layout[number] == marker for number, marker in joints.items())


def check_layout(layout: str, count: int, at: Location) -> str:
    """Check that a layout is known and has as many points.

    Raises:
        InputError: It is not, or has not.
    """
    if layout not in LAYOUTS:
        raise InputError(brief(layout), field=Argument("layout"), expected=", ".join(LAYOUTS))
    if len(LAYOUTS[layout]) != count:
        raise at.error(f"people with {count} points", f"{len(LAYOUTS[layout])}, as {layout} has")
    return layout


def with_layout(found: DetectedPeople, layout: str | None, at: Location, names: Sequence[str] = ()) -> DetectedPeople:
    """Name the points of a people's detector.

    Args:
        found: Detections with unnamed points.
        layout: Which points these are; found from their number and places if None.
        at: The file, for messages.
        names: Names that the file has for them, taken where no layout has as many points, or other joints in their places.

    Raises:
        InputError: No layout has as many points, or the given one has not, and the file has no names.
    """
    count = found.points.shape[2]
    for of_body in _WHOLE_BODIES.get(count, ()):
        body = LAYOUTS[of_body]
        cut = names[: len(body)] if len(names) == count else body
        if layout in (None, of_body) and _agree(cut, body) and len(markers_of_names(cut)) in (0, len(markers_of_names(body))):
            found = found._replace(points=found.points[:, :, : len(body)], confidence=found.confidence[:, :, : len(body)])
            return found._replace(layout=of_body, names=body)
    if layout is None and len(names) == count and not any(_agree(names, known) for known in LAYOUTS.values()):
        return found._replace(layout="", names=tuple(names))
    chosen = layout_of(found.points, at) if layout is None else check_layout(layout, count, at)
    return found._replace(layout=chosen, names=LAYOUTS[chosen])
