"""Which layout a detector's points have, from their number, their names or their places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, Location, brief
from poseppl.motion.io.detections import DetectedPeople
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names

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
